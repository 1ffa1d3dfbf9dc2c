"""Variants of the kernel of one scene: the more general one integrates cases that another
rejects."""

from enum import IntEnum


class Variant(IntEnum):
    """Kernel variant of a scene, from the fastest to the most general.

    A kernel that rejects a case gives the code of the first variant that may integrate it as the
    status of the case (`FINER_STEPS` of `sepmc.routines.layout` if smaller steps may do).
    """

    STANDARD = 0  # joints release in the order of the phases
    ANY_ORDER = -2  # joints may release before or after any event
    LEAST_SQUARES = -3  # besides: all constraint rows, solved for the multipliers of minimum norm
