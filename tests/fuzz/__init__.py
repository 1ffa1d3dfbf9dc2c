"""Random changes of untrusted files: `python tests/measure/fuzz.py`."""
