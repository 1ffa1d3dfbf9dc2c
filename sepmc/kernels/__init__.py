"""Compiled physics: formulas on tuples, the constraint force equations, one flight, one door."""
