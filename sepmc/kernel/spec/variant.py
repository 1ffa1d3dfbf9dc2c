"""Variants of the kernel of one scene: a more general variant is slower, and integrates cases that
a less general one rejects."""

from enum import IntEnum


class Variant(IntEnum):
    """Kernel variant of a scene, from the fastest to the most general (lower codes are more
    general).

    A kernel rejects a case that it cannot integrate by setting the status of the case: to the code
    of the first variant that may integrate it, or to `FINER_STEPS` (-1) of `sepmc.routines.layout`
    if smaller steps may suffice.
    """

    STANDARD = 0  # joints release in the order of the phases
    ANY_ORDER = -2  # joints may release before or after any event
    LEAST_SQUARES = -3  # besides: all constraint rows, solved for the multipliers of minimum norm
