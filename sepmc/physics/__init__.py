"""Formulas on numbers and tuples, without layout and without loops over bodies."""
