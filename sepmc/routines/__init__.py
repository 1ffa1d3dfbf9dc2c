"""Routines on the workspace of a block of cases, lane by lane: searches, tables, solvers."""
