"""Tracer: formulas called on symbolic expressions become lines of source code of a kernel."""
