"""Other engines fly whole campaigns, for speed: heyoka, MuJoCo, Exudyn and scipy.

Each has equations and loads of its own (`sepmc.trust.peers` lends the formulas of the air); what is
timed, `race` says.
"""

from sepmc.bench.peers.entry import Entry, error, worst
from sepmc.bench.peers.race import race

__all__ = ["Entry", "error", "race", "worst"]
