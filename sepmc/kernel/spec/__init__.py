"""Kernel specification of a scene: its structure, events, parameters and tables, and the
Runge-Kutta methods that integrate it."""
