"""Whole campaigns by other engines, for speed: heyoka, MuJoCo, Exudyn and scipy.

Each has its own equations and loads (`oracles.external_engines` supplies the formulas of the air);
`race` defines the timing.
"""

from oracles.engine_race.entry import Entry, error, worst
from oracles.engine_race.race import race

__all__ = ["Entry", "error", "race", "worst"]
