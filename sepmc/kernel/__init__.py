"""Writes the kernel of a scene: its specification, the tracer, and the functions it emits."""
