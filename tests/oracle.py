"""The independent reference solution of a whole flight (scipy, minimal coordinates), for the tests."""

from sepmc.trust.classical_loads import density
from sepmc.trust.lagrange import fly

__all__ = ["density", "fly"]
