"""What the engine is held against: an independent flight, random scenes, other engines."""
