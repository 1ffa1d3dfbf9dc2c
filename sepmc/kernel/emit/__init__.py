"""Emitters: the functions of a kernel, one file for each part of a flight."""
