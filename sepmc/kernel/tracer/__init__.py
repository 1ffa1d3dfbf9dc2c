"""Tracing: formulas called on symbolic values become lines of a kernel."""
