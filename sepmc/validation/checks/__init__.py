"""Checks of `sepmc verify`: functions that run a scene and return its lines."""
