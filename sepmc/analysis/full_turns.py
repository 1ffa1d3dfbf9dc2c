"""Angles that jump by a full turn, as from 180 to -180 deg."""

import numpy as np

TURN = 360.0  # deg


def nearest_turn(angles: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Return angles, deg, plus the full turns that bring each within half a turn of ``others``."""
    return np.asarray(angles + TURN * np.round((others - angles) / TURN))


def continuous(angles: np.ndarray) -> np.ndarray:
    """Return angles, deg, along the last axis, plus the full turns that leave no jump of more than
    half a turn between neighbours. NaN stays NaN, and what follows it has the turns before it."""
    turns = np.nan_to_num(np.round(np.diff(angles, axis=-1) / TURN))
    result = np.array(angles, dtype=float)
    result[..., 1:] -= TURN * np.cumsum(turns, axis=-1)
    return result
