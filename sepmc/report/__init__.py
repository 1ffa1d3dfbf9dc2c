"""What a reader sees of a run: figures and pages (the only room that imports matplotlib)."""
