"""Tracer: formulas called on symbolic expressions become lines of a kernel."""
