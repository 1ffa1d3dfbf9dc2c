"""Figures and pages of a run (the only room that imports matplotlib)."""
