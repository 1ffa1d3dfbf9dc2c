"""Independent simulation of one fully resolved case, slow and plain: written from CONVENTIONS.md,
it shares no code with kernels or compiler.

Bodies move in maximal coordinates. Joints are functions C(q, t) and C'(q, u): the rows of the
constraints are C' at unit speeds, their bias is a complex step along the motion, and accelerations
follow from Gauss's principle of least constraint. DOP853 integrates between known discontinuities;
events are roots.
"""

from oracles.independent.flight import CaseResult, simulate

__all__ = ["CaseResult", "simulate"]
