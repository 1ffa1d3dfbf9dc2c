"""Writes the kernel of a scene, the Python module that integrates its cases: the specification of
the kernel (`spec`), the tracer of formulas (`tracer`), and the writers of its functions
(`emit`)."""
