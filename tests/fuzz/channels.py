"""Telemetry in MATLAB, HDF5, TDMS and MDF files, damaged at random.

The packages of HDF5, TDMS and MDF are those of the extras; a file whose package is missing is left
out.
"""

import struct
import tempfile
from contextlib import contextmanager, suppress
from functools import cache
from io import BytesIO
from pathlib import Path

import numpy as np
from scipy.io import savemat
from scipy.sparse import eye

from fuzz.brought_files import read_flight
from fuzz.places import scratch
from fuzz.watch import Wrong, turns
from sepmc import processes
from sepmc.formats import telemetry

_TIME = np.arange(6) * 0.1
_RATE = np.array([0.5, -0.25, 3.0, 1e-3, -7.0, 2.0])
_COLUMN = "upper_omega_y_deg_s"
_MAPS = (
    (f"{_COLUMN}=gyro",), (f"{_COLUMN}=-gyro[rad/s]",), (f"{_COLUMN}=imu.acc",), (),
    (f"{_COLUMN}=count",), (f"{_COLUMN}=sub.deep.z",), (f"{_COLUMN}=nothing",),
)  # fmt: skip
# values of four or eight bytes that sizes, types and dimensions of a file may take
_NUMBERS = (0, 1, 2, 3, 5, 9, 14, 15, 255, 256, 2**15, 2**16, 2**24, 2**31 - 1, 2**31, 2**32 - 1)


def channels(rng, count, until, tried):
    """Damaged files, read with and without a map."""
    seeds = _seeds()
    with scratch() as folder, _kept_process() as process:
        for number in turns(count, until, tried):
            ending, data = rng.choice(seeds)
            damaged = _damaged(rng, data)
            path = folder / f"{number % 8}{rng.choice((ending, ending, ending, ending, '.mat'))}"
            path.write_bytes(damaged)
            options = {"maps": rng.choice(_MAPS), "time": rng.choice((None, None, "t", "clock"))}
            process.start(seeds)  # not a part of the time
            said = (path.name, options, damaged.hex() if len(damaged) < 3000 else len(damaged))
            is_whole = damaged == data and path.suffix == ending
            tried.look(said, lambda p=path, o=options, w=is_whole: _read(p, o, w, tried))


def _read(path, options, is_whole, tried):
    """Read channels; those of a file without damage are right, if the map is of one of them."""
    try:
        result = read_flight(path, options)
    except Exception as error:
        if "the library that reads it crashes" in str(error):
            tried.counts["crashes of a library"] += 1
        raise
    mapped = options["maps"]
    if is_whole and mapped and "=gyro" in mapped[0] and options["time"] != "clock":
        times, values = result[_COLUMN]
        if not (np.array_equal(times, _TIME) and np.array_equal(values, _RATE)):
            raise Wrong("a file without damage is read with other numbers")
    return result


def _damaged(rng, data):
    """Bytes changed, left out, doubled, moved, or replaced by a number that means a size."""
    data = bytearray(data)
    for _ in range(rng.choice((0, 1, 1, 1, 2, 3, 6))):
        at, way = rng.randrange(len(data) or 1), rng.randrange(8)
        length = rng.choice((1, 4, 8, 64))
        if not data:
            break
        if way == 0:
            data[at] ^= 1 << rng.randrange(8)
        elif way == 1:
            data[at] = rng.randrange(256)
        elif way == 2:
            del data[at : at + length]
        elif way == 3:
            data[at:at] = data[max(0, at - length) : at]
        elif way == 4:
            at -= at % 8
            data[at : at + 4] = struct.pack(rng.choice("<>") + "I", rng.choice(_NUMBERS))
        elif way == 5:
            at -= at % 8
            data[at : at + 8] = struct.pack("<Q", rng.choice((*_NUMBERS, 2**63, 2**64 - 1)))
        elif way == 6:
            other = rng.randrange(len(data))
            data[at : at + length] = data[other : other + length]
        else:
            del data[max(1, at) :]
    return bytes(data) or b"\0"


@cache
def _seeds():
    """Endings and bytes of small files."""
    flat = {"t": _TIME, "gyro": _RATE, "count": np.arange(6, dtype=np.uint16)}
    deep = {
        **flat,
        "imu": {"time": _TIME[:3] + 7.0, "acc": _RATE[:3]},
        "sub": {"deep": {"t": _TIME, "z": _RATE.astype(np.float32)}},
        "name": "FGH",
        "cells": np.array([_RATE, "x"], dtype=object),
        "records": np.array([(1.0, 2)], dtype=[("a", float), ("b", int)]),
        "sparse": eye(3).tocsc(),
        "complex": _RATE * 1j,
        "square": np.eye(3),
        "flag": _RATE > 0.0,
    }
    seeds = [
        (".mat", _matlab(flat, format="4")),
        (".mat", _matlab(flat)),
        (".mat", _matlab(deep)),
        (".mat", _matlab(deep, do_compression=True)),
    ]
    with suppress(ImportError):
        seeds += _hdf5_files()
    with suppress(ImportError):
        seeds += _tdms_files()
    with suppress(ImportError):
        seeds += _mdf_files()
    return seeds


def _matlab(content, **options):
    stream = BytesIO()
    savemat(stream, content, **options)
    return stream.getvalue()


def _hdf5_files():
    import h5py

    files = []
    for options in ({}, {"libver": "latest"}, {"userblock_size": 512}):
        stream = BytesIO()
        with h5py.File(stream, "w", **options) as file:
            file["t"], file["gyro"] = _TIME[None], _RATE[:, None]
            file["imu/time"], file["imu/acc"] = _TIME[:3], _RATE[:3]
            file["sub/deep/t"], file["sub/deep/z"] = _TIME, _RATE.astype(">f4")
            file["name"] = np.array([[70, 71]], np.uint16)
            file["name"].attrs["MATLAB_class"] = np.bytes_("char")
            file["text"], file["soft"] = "FGH", h5py.SoftLink("/gyro")
            chunked = {"chunks": (4,), "compression": "gzip", "shuffle": True}
            file.create_dataset("count", data=np.arange(6), maxshape=(None,), **chunked)
            file.create_dataset("filled", (6,), "f8", fillvalue=3.0)
        data = stream.getvalue()
        if options.get("userblock_size"):
            files.append((".mat", b"MATLAB 7.3 MAT-file".ljust(512) + data[512:]))
        else:
            files.append((".h5", data))
    return files


def _tdms_files():
    import nptdms

    files = []
    for is_waveform in (True, False):
        wave = {"wf_increment": 0.1, "wf_start_offset": 0.0} if is_waveform else {}
        parts = [nptdms.ChannelObject("imu", "acc", _RATE, {"unit_string": "m/s2", **wave})]
        parts += [nptdms.ChannelObject("imu", "count", np.arange(6), wave)]
        if not is_waveform:
            parts.append(nptdms.ChannelObject("imu", "t", _TIME, {"unit_string": "s"}))
            parts.append(nptdms.ChannelObject("imu", "gyro", _RATE, {}))
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "f.tdms"
            with nptdms.TdmsWriter(path) as writer:
                writer.write_segment(parts)
                if not is_waveform:
                    writer.write_segment(parts[:1])
            files.append((".tdms", path.read_bytes()))
    return [files[1], files[0]]


def _mdf_files():
    import asammdf

    files = []
    for version, options in (("4.10", {}), ("4.10", {"compression": 2}), ("3.30", {})):
        signals = [
            asammdf.Signal(_RATE, _TIME, name="gyro"),
            asammdf.Signal(np.arange(6, dtype=np.uint16), _TIME, name="count", unit="1"),
        ]
        with tempfile.TemporaryDirectory() as folder, asammdf.MDF(version=version) as file:
            file.append(signals, common_timebase=True)
            acceleration = asammdf.Signal(_RATE[:3], _TIME[:3], name="imu.acc", unit="m/s^2")
            file.append([acceleration])
            path = file.save(Path(folder) / "f.mf4", overwrite=True, **options)
            files.append((path.suffix, path.read_bytes()))
    return files


class _Process:
    """Process that reads files, in place of one for each; replaced after a crash or hang."""

    def __init__(self):
        self.context = self.pool = None

    def start(self, seeds):
        """Start the process, if it has ended, and let it import the libraries."""
        if self.pool is None:
            self.context = processes.processes(1)
            self.pool = self.context.__enter__()
            for ending, data in seeds:
                with tempfile.TemporaryDirectory() as folder:
                    path = Path(folder) / "f"
                    path.write_bytes(data)
                    self.pool.submit(telemetry._by_library, path, ending, None).exception()

    def end(self, error=None):
        """End the process; kill it after an error."""
        with suppress(BaseException):
            self.context.__exit__(error and type(error), error, None)
        self.context = self.pool = None

    @contextmanager
    def lent(self, count):
        """The process, in place of ``sepmc.processes.processes``."""
        try:
            yield self.pool
        except BaseException as error:
            if not isinstance(error, telemetry.FormatError) or "crashes" in str(error):
                self.end(error)
            raise


@contextmanager
def _kept_process():
    """Context in which files are read by one process."""
    process = _Process()
    before, telemetry.processes = telemetry.processes, process.lent
    try:
        yield process
    finally:
        telemetry.processes = before
        process.end()
