"""Reading of telemetry channels (values over time) from tables in text and Parquet, and from files
of MATLAB, HDF5, MDF (ASAM) and TDMS (LabVIEW)."""

import logging
import math
import re
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from sepmc.formats.columns import plain, split_header, values_in_si
from sepmc.formats.text_table import FormatError, read_bytes, read_table, without_number
from sepmc.paths import EXTRA
from sepmc.processes import processes
from sepmc.scene.messages import InputError, nearest, printable, shorten
from sepmc.scene.units import UNITS, split_unit, unit_kind, unit_text

FILE_BYTES = 200_000_000  # of a file
# time, s, that a library may take: to start, and for a file, with more for each megabyte
_LONGEST_S, _BASE_S, _PER_MEGABYTE_S = 300.0, 3.0, 30.0
_MEMORY = 4 << 30  # bytes that it may use
_MAP = re.compile(r"([+-]?)\s*(?:(\d+\.?\d*(?:[eE][+-]?\d+)?|\.\d+)\s*\*)?\s*(.+?)\s*")
_UNIT = re.compile(r"(.*?)\s*\[([^\[\]]*)\]")
_NAMED = "--time (time in a campaign and in Python)"
_TIMES = ("time", "t", "times", "timestamp", "timestamps", "timesec", "seconds")
# packages that read a kind of file, and their extras; MATLAB 7.3 is HDF5
_PACKAGES = {
    ".mf4": ("asammdf", "telemetry"), ".mdf": ("asammdf", "telemetry"),
    ".tdms": ("nptdms", "telemetry"), ".h5": ("h5py", "export"), ".hdf5": ("h5py", "export"),
}  # fmt: skip
_HDF5 = (b"MATLAB 7.3", b"\x89HDF\r\n\x1a\n")  # first bytes
_DEPTH = 4  # of structs within each other
_LONGEST_REASON = 1000  # letters
_LONGEST_REMARK, _MOST_REMARKS = 120, 3  # letters of a warning of a library, and warnings
_MOST_VECTORS = 20_000  # of a file in HDF5


@dataclass(frozen=True)
class MappedChannel:
    """Pair of a column of the simulated time histories and the telemetry channel that measures it.

    Attributes
    ----------
    column, channel : str
        Name of the column, and name of the channel.
    factor : float
        Factor on the values of the channel.
    unit : str
        Unit of the channel. If empty, it is the one in brackets after the name; without brackets
        the one in the file, or, if there is none, that of the column.
    """

    column: str
    channel: str
    factor: float = 1.0
    unit: str = ""


@dataclass(frozen=True)
class _Raw:
    """Channel as it is in a file: times (n,), s, and values (n,), in ``unit`` (empty: in that of
    the title, if it has one). ``lines`` has the line number of each sample in a text file; it is
    empty for other files."""

    time: np.ndarray
    values: np.ndarray
    unit: str
    lines: tuple[int, ...] = ()


def parse_map(text: str, columns: Sequence[str], option: str = "map") -> MappedChannel:
    """Parse the text ``COLUMN=[-][FACTOR*]CHANNEL[UNIT]``, which maps a channel to a column.

    Parameters
    ----------
    text : str
        Such as ``upper_omega_y_deg_s=-gyro_z[rad/s]``.
    columns : sequence of str
        Names of the columns of time histories.
    option : str
        Name of the option or key, for messages.

    Returns
    -------
    MappedChannel
        Its ``channel`` includes the unit in brackets; `read_telemetry` separates it.

    Raises
    ------
    InputError
        If the text has another form, there is no such column, or the factor is 0 or not finite.
    """
    column, equal, right = (part.strip() for part in text.partition("="))
    match = _MAP.fullmatch(right)
    if not equal or match is None:
        raise InputError(f"{option} {shorten(text)}: must be COLUMN=CHANNEL, such as {_EXAMPLE}")
    if column not in columns:
        hint = nearest(column, columns)
        raise InputError(f"{option} {shorten(text)}: no column {column} of histories; {hint}")
    factor = float(match[2] or 1.0) * (-1.0 if match[1] == "-" else 1.0)
    if not (math.isfinite(factor) and factor):
        raise InputError(f"{option} {shorten(text)}: the factor must be finite and not 0")
    return MappedChannel(column, match[3], factor)


_EXAMPLE = "upper_omega_y_deg_s=-gyro_z[rad/s]"


def read_telemetry(
    path: Path, mapped: Sequence[MappedChannel], columns: Sequence[str], time: str | None = None
) -> tuple[dict[str, tuple[np.ndarray, np.ndarray]], list[str]]:
    """Read the channels of a telemetry file that measure columns of time histories.

    Parameters
    ----------
    path : Path
        ``.mat``, ``.h5``, ``.hdf5``, ``.mf4``, ``.mdf``, ``.tdms``, ``.parquet``; any other ending
        is a text table.
    mapped : sequence of MappedChannel
        Channels to read; if empty, those whose title is the name of a column, in any unit.
    columns : sequence of str
        Names of the columns of time histories.
    time : str, optional
        Name of the channel of the time; by default the one called "time", "t" or the like.

    Returns
    -------
    channels : dict of str to (ndarray (n,), ndarray (n,))
        By column: times, s, not falling, and values in the unit of the column; samples that are not
        finite are left out.
    understood : list of str
        Sentences on what was read, for the user.

    Raises
    ------
    FormatError
        If the file cannot be read, or a channel or its time is missing, not unique or not valid,
        such as one with fewer than two finite samples.
    InputError
        If the library that reads such files is not installed.
    """
    channels, remarks = _channels(path, time)
    if not mapped:
        mapped = [
            MappedChannel(column, title)
            for title in channels
            for column in columns
            if without_number(title) == column
            or split_header(without_number(title), _kind(column))[0] == split_unit(column)[0]
        ]
        if not mapped:
            raise FormatError(
                "no channel has the name of a column; name one by --map (map in Python), such as "
                f"{_EXAMPLE}; channels: {_listed(channels)}"
            )
    result: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    understood = [f"the library that reads the file warns: {remark}" for remark in remarks]
    for each in mapped:
        if each.column in result:
            raise FormatError(f"has two channels for the column {each.column}; choose one by --map")
        own = _resolve(each, channels)
        raw = channels[own.channel]
        values, unit, is_assumed = _in_unit_of_column(own, raw)
        kept = np.isfinite(values) & np.isfinite(raw.time)
        times, values = raw.time[kept], values[kept]
        if len(times) < 2:
            raise FormatError(
                f"channel {own.channel}: has {len(times)} samples that are numbers: must have 2 or "
                "more"
            )
        falling = np.flatnonzero(np.diff(times) < 0.0)
        if len(falling):
            k = int(falling[0])
            later = int(np.flatnonzero(kept)[k + 1])
            where = f"in line {raw.lines[later]}" if raw.lines else f"at its sample {later + 1}"
            raise FormatError(
                f"channel {own.channel}: the time falls from {times[k]:.14g} to "
                f"{times[k + 1]:.14g} s {where}"
            )
        result[each.column] = times, values
        factor = "" if own.factor == 1.0 else f"{own.factor:g} * "
        assumed = ", which the file does not say" if is_assumed else ""
        gaps = f"; {len(kept) - len(times)} more have no number" if not kept.all() else ""
        span = f"{times[0]:.14g} to {times[-1]:.14g} s{gaps}"
        understood.append(
            f"{each.column} = {factor}{own.channel}, in {unit_text(unit)}{assumed}: {len(times)} "
            f"samples, {span}"
        )
    return result, understood


def _listed(channels: Mapping[str, Any]) -> str:
    names = list(channels)
    more = f" and {len(names) - 12} more" if len(names) > 12 else ""
    return ", ".join(printable(name, 60) for name in names[:12]) + more


def _kind(column: str) -> str:
    unit = split_unit(column)[1]
    return unit_kind(unit) if unit else ""


def _resolve(mapped: MappedChannel, channels: Mapping[str, _Raw]) -> MappedChannel:
    """Copy of a mapping with the full title in the file as ``channel``; `_titles` says which titles
    a name may mean. If there is none for the name ``channel`` as it is, a unit in brackets at its
    end (``gyro_z[rad/s]``) is split off, and becomes ``unit`` if that is empty. Raises FormatError
    if the name means no channel or several."""
    name, unit = mapped.channel, ""
    titles = _titles(name, channels)
    if not titles and (match := _UNIT.fullmatch(name)):
        name, unit = match[1], match[2]
        titles = _titles(name, channels)
    if not titles:
        raise FormatError(f"no channel {shorten(name)}; {nearest(name, list(channels))}")
    if len(titles) > 1:
        raise FormatError(f"several channels {name}: {', '.join(titles[:6])}; give one of these")
    return replace(mapped, channel=titles[0], unit=mapped.unit or unit)


def _titles(name: str, channels: Mapping[str, _Raw]) -> list[str]:
    """Titles of the channels that a name may mean: the title equal to it, else all whose
    part after the last dot is it, else all that are the name followed by a number (``#1``) or a
    unit in brackets; empty if none."""
    if name in channels:
        return [name]
    ends = [title for title in channels if title.rpartition(".")[2] == name]
    return ends or [
        title
        for title in channels
        if without_number(title) == name
        or re.match(rf"{re.escape(name)}\s*[(\[]", without_number(title))
    ]


def _in_unit_of_column(mapped: MappedChannel, raw: _Raw) -> tuple[np.ndarray, str, bool]:
    """Convert the values of a channel, times its factor, to the unit of its column. Returns the
    values (n,), the unit that they had in the file, and True if that is not known and was taken to
    be the column's; without conversion, "" and False if the column has no unit. Raises FormatError
    for a unit of another kind of quantity."""
    values, own = mapped.factor * raw.values, split_unit(mapped.column)[1]
    if not own:
        return values, "", False
    kind = unit_kind(own)
    unit = mapped.unit or raw.unit
    if unit:
        unit = split_header(f"channel [{unit}]", kind)[1]
    else:
        unit = split_header(mapped.channel, kind)[1]
    if not unit:
        return values, own, True
    try:
        in_si = values_in_si(values, mapped.channel, unit, kind)
    except FormatError:
        raise FormatError(
            f"channel {mapped.channel}: {unit!r} is no unit of {kind}, which are "
            f"{', '.join(UNITS[kind])}; name one in the map, such as "
            f"{mapped.column}={mapped.channel}[{own}], with a factor where it needs one"
        ) from None
    return in_si / UNITS[kind][own], unit, False


def _channels(path: Path, time: str | None) -> tuple[dict[str, _Raw], list[str]]:
    """Read all channels of a file, by title, and the warnings of the library that reads it (none
    for a table). ``time`` is the name of the channel of the time; None: the one called "time", "t"
    or the like. Raises FormatError if the file is damaged, has no channels or takes too long to
    read, InputError if the library is not installed."""
    kind = path.suffix.lower()
    if kind not in (".mat", *_PACKAGES):
        table = read_table(path, most=FILE_BYTES, gaps=True)
        return _of_table(table.columns, time, lines=table.lines), []
    data = read_bytes(path, FILE_BYTES)
    if data.startswith(_HDF5) and kind == ".mat":
        kind = ".h5"
    package, extra = _PACKAGES.get(kind, ("scipy.io", ""))
    missing = InputError(
        f"{path.name}: needs {package}, of the extra {extra} ({EXTRA.format(extra)})"
    )
    if find_spec(package) is None:
        raise missing
    limit = min(_LONGEST_S, _BASE_S + _PER_MEGABYTE_S * len(data) / 1e6)
    # in a process of its own: damaged files can crash or stall these libraries
    with processes(1) as pool:
        try:
            pool.submit(_prepare, package).result(timeout=_LONGEST_S)
            channels, remarks = pool.submit(_by_library, path, kind, time).result(timeout=limit)
        except ImportError:  # of a package that it needs itself
            raise missing from None
        except BrokenExecutor:
            raise FormatError("is damaged: the library that reads it crashes") from None
        except TimeoutError:
            raise FormatError(f"takes more than {limit:.0f} s to read: is it damaged?") from None
    if not channels:
        raise FormatError("has no channel of numbers over time")
    return channels, remarks


def _prepare(package: str) -> None:
    """Import a library and limit the memory of this process, since a damaged file may ask for any
    size; it is not limited on systems that cannot. Runs in the process that reads the file. Raises
    ImportError if the library, or one that it needs, is missing."""
    import_module(package)
    with suppress(ImportError, OSError, ValueError):  # not on all systems
        resource = import_module("resource")
        most = resource.getrlimit(resource.RLIMIT_DATA)[1]
        limit = _MEMORY if most == resource.RLIM_INFINITY else min(_MEMORY, most)
        resource.setrlimit(resource.RLIMIT_DATA, (limit, most))


@contextmanager
def _collected_warnings() -> Iterator[list[str]]:
    """Context in which warnings, and log messages at the level of a warning or above, of libraries
    are collected in a list, which it yields, instead of being printed; lesser messages are
    discarded. The warnings are in it only after the context ends."""
    texts: list[str] = []

    def collect(_: logging.Logger, record: logging.LogRecord) -> None:
        if record.levelno >= logging.WARNING:
            texts.append(record.getMessage())

    print_record = logging.Logger.callHandlers
    logging.Logger.callHandlers = collect  # type: ignore[method-assign, assignment]
    try:
        with warnings.catch_warnings(record=True) as raised:
            warnings.simplefilter("default")
            yield texts
        texts += [str(one.message) for one in raised]
    finally:
        logging.Logger.callHandlers = print_record  # type: ignore[method-assign]


def _by_library(path: Path, kind: str, time: str | None) -> tuple[dict[str, _Raw], list[str]]:
    """Read all channels of a file by a library, by title, and the library's first three different
    warnings, shortened. ``kind`` is the ending of the file's format, such as ".mat", ``time`` the
    name of the channel of the time, or None, as for `_channels`. Raises FormatError for any error
    of the library."""
    readers: dict[str, Callable[[Path, str | None], dict[str, _Raw]]]
    readers = {".mat": _of_matlab, ".mf4": _of_mdf, ".mdf": _of_mdf, ".tdms": _of_tdms}
    readers |= dict.fromkeys((".h5", ".hdf5"), _of_hdf5)
    try:
        with _collected_warnings() as texts:
            channels = readers[kind](path, time)
        remarks = [printable(text, _LONGEST_REMARK) for text in dict.fromkeys(texts)]
        return {printable(k): v for k, v in channels.items()}, remarks[:_MOST_REMARKS]
    except FormatError as error:
        raise FormatError(printable(str(error), _LONGEST_REASON)) from None
    except Exception as error:  # what libraries raise on damaged files has no common type
        reason = printable(str(error).partition("\n")[0])
        raise FormatError(f"cannot be read: {reason or type(error).__name__}") from None


def _of_table(
    columns: Mapping[str, np.ndarray],
    time: str | None,
    stem: str = "",
    lines: tuple[int, ...] = (),
) -> dict[str, _Raw]:
    """Channels from columns of equal length, one of which is the time, by title with ``stem`` in
    front; the time itself is no channel. ``time`` is as for `_time_title`, ``lines`` are the line
    numbers of the rows. Raises FormatError without one column of time, if its unit is none of time,
    or if it has no finite number; whether times rise is not checked here."""
    title = _time_title(columns, time)
    unit = split_header(title, "time")[1]
    factor = UNITS["time"].get(unit or "s")
    if factor is None:
        raise FormatError(f"column {title}: {unit!r} is no unit of time; known: s, ms, min")
    seconds = columns[title] * factor
    if not np.isfinite(seconds).any():
        raise FormatError(
            f"column {title}: has no number; times must be numbers, in s unless it has a unit"
        )
    return {stem + k: _Raw(seconds, v, "", lines) for k, v in columns.items() if k != title}


def _time_title(columns: Mapping[str, Any], time: str | None) -> str:
    """Title of the column of the time: the one called ``time`` or, if that is None, "time", "t" or
    the like. Case, punctuation and a unit in the titles are ignored, unless a title equals ``time``
    exactly. Raises FormatError if no column or several have such a title."""
    if time is not None and time in columns:
        return time
    wanted = _TIMES if time is None else (plain(time),)
    titles = [title for title in columns if plain(split_header(title, "time")[0]) in wanted]
    if len(titles) != 1:
        what = "no column" if not titles else f"{len(titles)} columns"
        raise FormatError(
            f"has {what} of time, must have one; name the column to use by {_NAMED}; the columns "
            f"are {_listed(columns)}"
        )
    return titles[0]


def _of_matlab(path: Path, time: str | None) -> dict[str, _Raw]:
    """Read the channels of a MATLAB file of a version up to 7.2: its vectors and those in its
    structs, with ``time`` and errors as for `_of_structs`."""
    from scipy.io import loadmat  # noqa: PLC0415

    content = loadmat(path, simplify_cells=True)
    return _of_structs({k: v for k, v in content.items() if not k.startswith("__")}, time)


def _of_hdf5(path: Path, time: str | None) -> dict[str, _Raw]:
    """Read the channels of an HDF5 file, which MATLAB 7.3 writes too: its vectors and those in its
    groups, with ``time`` as for `_of_structs`.

    Links are not followed, and data stored in other files are not read. Raises FormatError if there
    are too many groups and data sets, or numbers.
    """
    h5py = import_module("h5py")
    count = size = 0

    def read(group: Any, depth: int) -> dict[str, Any]:
        nonlocal count, size
        struct: dict[str, Any] = {}
        for name in group:
            count += 1
            if count > _MOST_VECTORS:
                raise FormatError(
                    f"has more than {_MOST_VECTORS:,} groups and data sets: export fewer channels"
                )
            if name.startswith("#") or not isinstance(group.get(name, getlink=True), h5py.HardLink):
                continue  # references of MATLAB, links
            item = group[name]
            if isinstance(item, h5py.Group):
                struct[name] = read(item, depth + 1) if depth < _DEPTH else {}
            elif (
                isinstance(item, h5py.Dataset)
                and item.dtype.kind in "fiu"
                and max(item.shape, default=0) == item.size > 0
                and not (item.external or item.is_virtual or "MATLAB_empty" in item.attrs)
                and item.attrs.get("MATLAB_class", b"") not in (b"char", b"cell")
            ):
                size += 8 * item.size  # what a small file unpacks to has no limit of its own
                if size > FILE_BYTES:
                    raise FormatError(
                        f"has more than {FILE_BYTES // 8:,} numbers: export fewer channels"
                    )
                struct[name] = np.asarray(item[()]).reshape(-1)
        return struct

    with h5py.File(path, "r") as file:
        return _of_structs(read(file, 0), time)


def _of_structs(content: Mapping[str, Any], time: str | None) -> dict[str, _Raw]:
    """Channels from the vectors in ``content``, the vectors and structs of a file by name, by
    dotted title. A vector is a channel if its struct has a vector of time of the same length. That
    is the one called ``time`` (of a dotted name, its last part) or, if that is None, "time", "t" or
    the like. Structs nested more than four deep are left out. Raises FormatError if there are no
    channels."""
    channels: dict[str, _Raw] = {}
    _add_vectors(channels, content, "", time, 0)
    if not channels:
        raise FormatError(
            f"has no vectors with a vector of time beside them; name its channel by {_NAMED}"
        )
    return channels


def _add_vectors(
    channels: dict[str, _Raw], struct: Mapping[str, Any], stem: str, time: str | None, depth: int
) -> None:
    vectors = {
        str(name): np.asarray(value, dtype=float)
        for name, value in struct.items()
        if isinstance(value, np.ndarray) and value.ndim == 1 and value.dtype.kind in "fiu"
    }
    clock = None if time is None else time.rpartition(".")[2]
    with suppress(FormatError):  # without a time beside them, vectors are no channels
        title = _time_title(vectors, clock)
        length = len(vectors[title])
        same = {name: vector for name, vector in vectors.items() if len(vector) == length}
        channels |= _of_table(same, title, stem)
    for name, value in struct.items():
        if isinstance(value, dict) and depth < _DEPTH:
            _add_vectors(channels, value, f"{stem}{name}.", time, depth + 1)


def _of_mdf(path: Path, time: str | None) -> dict[str, _Raw]:
    """Read the channels of an MDF file, each of which has its own time; ``time`` is not used.
    Channels that share a name are all read, with titles such as ``group 3.NAME``. The
    time itself, and channels without samples or whose samples are not single numbers, are left
    out."""
    asammdf = import_module("asammdf")

    channels: dict[str, _Raw] = {}
    with asammdf.MDF(path) as file:
        for name, entries in file.channels_db.items():
            for group, index in entries:
                signal = file.get(name, group=group, index=index)
                if signal.samples.ndim != 1 or signal.samples.dtype.kind not in "fiub":
                    continue
                if len(signal.timestamps) == 0 or np.array_equal(signal.samples, signal.timestamps):
                    continue  # the time itself
                title = name if len(entries) == 1 else f"group {group}.{name}"
                channels[title] = _Raw(
                    np.asarray(signal.timestamps, dtype=float),
                    np.asarray(signal.samples, dtype=float),
                    str(signal.unit or ""),
                )
    return channels


def _of_tdms(path: Path, time: str | None) -> dict[str, _Raw]:
    """Read the channels of a TDMS file, with titles ``GROUP.NAME``. The time of a channel is that
    of its waveform, if it has one and ``time`` is None, else the channel of the time in its group,
    which ``time`` may name; channels of another length than that one are left out. Raises
    FormatError if a group has no channel of the time, or its unit is no unit of time."""
    nptdms = import_module("nptdms")

    channels: dict[str, _Raw] = {}
    for group in nptdms.TdmsFile.read(path).groups():
        vectors = {
            channel.name: channel
            for channel in group.channels()
            if len(channel) and np.asarray(channel[:]).dtype.kind in "fiu"
        }
        for name, channel in vectors.items():
            unit = str(channel.properties.get("unit_string", ""))
            title = f"{group.name}.{name}"
            values = np.asarray(channel[:], dtype=float)
            if channel.properties.get("wf_increment") and time is None:
                channels[title] = _Raw(np.asarray(channel.time_track(), float), values, unit)
                continue
            clock = _time_title(vectors, None if time is None else time.rpartition(".")[2])
            if name == clock or len(vectors[clock]) != len(values):
                continue
            clock_unit = str(vectors[clock].properties.get("unit_string", "")) or "s"
            factor = UNITS["time"].get(split_header(f"time [{clock_unit}]", "time")[1])
            if factor is None:
                raise FormatError(
                    f"channel {clock}: {clock_unit!r} is no unit of time; known: s, ms, min"
                )
            seconds = np.asarray(vectors[clock][:], dtype=float) * factor
            channels[title] = _Raw(seconds, values, unit)
    return channels
