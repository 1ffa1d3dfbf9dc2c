"""Structs of the published statistics of outcomes that a campaign file may give for comparison."""

from typing import Annotated

from msgspec import Struct, field

from sepmc.scene.model import Positive


class Expected(Struct, frozen=True, kw_only=True):
    """Published mean, standard deviation, minimum and maximum of one outcome, in the unit of its
    column; None for those not published."""

    mean: float | None = None
    sigma: Annotated[float, Positive] | None = None
    min: float | None = None
    max: float | None = None


class Reference(Struct, frozen=True, kw_only=True):
    """Published statistics to compare a campaign with: a text on their source, and the statistics
    of each outcome by its column name."""

    source: str
    outcome: dict[str, Expected] = field(default_factory=dict)
