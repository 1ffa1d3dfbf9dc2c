"""Figures, animations and HTML pages of runs (the only subpackage that imports matplotlib)."""
