"""Kernel specification: structure, events, parameters, tables and methods of a scene."""
