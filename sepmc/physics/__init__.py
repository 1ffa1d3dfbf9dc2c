"""Formulas on numbers and tuples: no layout, no loops over bodies."""
