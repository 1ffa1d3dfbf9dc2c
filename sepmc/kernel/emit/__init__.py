"""Emitters: the functions of a kernel, one file for each concern of a simulation."""
