"""Checks of an installation, with known answers: `sepmc verify` (closed forms, other formulations,
conservation laws) and `sepmc stress` (numerically hard inputs)."""
