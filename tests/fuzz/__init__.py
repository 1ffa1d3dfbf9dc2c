"""Strangers' files by the million: `python tests/measure_fuzz.py`."""
