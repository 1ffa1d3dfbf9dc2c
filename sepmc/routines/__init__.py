"""Routines that kernels call: searches, tables, solvers. They work on the workspace of a block of
cases (a flat buffer with all its numbers), most of them for one lane (case) at a time."""
