"""Other engines fly whole campaigns, for speed: heyoka, MuJoCo, Exudyn and scipy.

Each has equations and loads of its own (`oracles.external_engines` lends the formulas of the air);
what is timed, `race` says.
"""

from oracles.engine_race.entry import Entry, error, worst
from oracles.engine_race.race import race

__all__ = ["Entry", "error", "race", "worst"]
