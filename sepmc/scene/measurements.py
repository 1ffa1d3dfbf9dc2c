"""Tables [[measurement]] as data, and checks of them: they name the telemetry of a flight or test
from which parameters are estimated. `sepmc.campaign.measured_channels` reads its files."""

from collections.abc import Iterable
from typing import Annotated

from msgspec import Meta, Struct

from sepmc.scene.messages import Problems, nearest
from sepmc.scene.model import Quantity
from sepmc.schema import Contents, history_columns


class Measurement(Struct, frozen=True, kw_only=True):
    """Pair of a column of the simulated time histories and the channel of a telemetry file that
    measured it, with independent normal errors of standard deviation ``sigma``, in the unit that
    the name of the column ends with.

    ``channel`` is a name with factor and unit, as ``-0.5*gyro_z[rad/s]`` (None: named as the
    column); ``time`` the channel of the time (None: one that is called so). ``delay`` (s) is the
    time of the file at time 0 of the run, ``delay_sigma`` (s) its standard deviation; measurements
    of one file share one deviation.
    """

    column: str
    file: str
    sigma: Annotated[float, Meta(gt=0.0)]
    channel: str | None = None
    time: str | None = None
    delay: Annotated[float, Quantity("time")] = 0.0
    delay_sigma: Annotated[float, Quantity("time"), Meta(ge=0.0)] = 0.0


def check_measurements(
    measurements: Iterable[Measurement], contents: Contents, problems: Problems
) -> None:
    """Add a problem for each measurement whose column is not one of histories, or whose
    ``delay_sigma`` differs from that of another measurement of the same file, which has one clock.
    ``contents`` of the campaign determine the columns of histories."""
    columns = [column.name for column in history_columns(contents)]
    clocks: dict[str, float] = {}
    for number, one in enumerate(measurements):
        key_path = f"measurement.{number}"
        if one.column not in columns:
            reason = f"no such column of histories; {nearest(one.column, columns)}"
            problems.add(f"{key_path}.column", reason, one.column)
        sigma = clocks.setdefault(one.file, one.delay_sigma)
        if one.delay_sigma != sigma:
            reason = f"must be {sigma:g} s as for the other measurements of {one.file}: one clock"
            problems.add(f"{key_path}.delay_sigma_s", reason, one.delay_sigma)
