"""Strangers' files by the million: `python tests/measure/fuzz.py`."""
