"""One fully resolved case, flown plainly and slowly: written from CONVENTIONS.md, sharing no code
with kernels or compiler.

Bodies move in maximal coordinates. Joints are functions C(q, t) and C'(q, u): the rows of the
constraints are C' at unit speeds, their bias is a complex step along the motion, and accelerations
follow from Gauss's principle of least constraint. DOP853 integrates between known discontinuities;
events are roots.
"""

from oracles.independent.flight import Flown, fly

__all__ = ["Flown", "fly"]
