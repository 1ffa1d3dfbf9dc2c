"""Oracles of the engine: an independent simulation, random scenes, external engines."""
