"""Kernels on disk: their source is split into compile units, these are compiled in parallel
processes, and their machine code is loaded."""

import hashlib
import os
import sys
from collections.abc import Sequence

import msgspec

from sepmc.code_cache import CACHE_FOLDER, cache_lock
from sepmc.engine import cache_files
from sepmc.engine.compile_workers import Progress, compile_all, running
from sepmc.engine.written_kernel import Kernel, table
from sepmc.kernel.emit.compile_units import kernel_properties, split
from sepmc.translator.compiler import compile_text

# modules with routines that take seconds to compile
_SLOW = ("sepmc.routines.clearances", "sepmc.routines.splines", "sepmc.routines.between_nodes")
_SHORT = 12_000  # characters of source that are compiled before another process has started


class CompileUnits(msgspec.Struct, frozen=True):
    """Names of the compile units of a kernel, and properties of the kernel.

    Attributes
    ----------
    names : tuple of str
        Names of the units, which are also those of their modules (Python source) and object files
        in the cache folder. Units call each other by their index here; the last one is the entry of
        the kernel.
    size : int
        Number of floats in the workspace.
    n_indicators, n_segments, n_changes : int
        Numbers of error indicators of a case, of segments, and of reported times within segments
        (changes of joints, ends of strokes).
    methods : tuple of tuple of str
        For each segment, the names of its integration methods.
    """

    names: tuple[str, ...]
    size: int
    n_indicators: int
    n_segments: int
    n_changes: int
    methods: tuple[tuple[str, ...], ...]


def compile_units_of(text: str) -> CompileUnits:
    """Split the Python source of a kernel into compile units and write their modules into the cache
    folder. Nothing is compiled.

    The result is stored in the cache folder, too, since splitting takes as long as writing the
    kernel.
    """
    known = CACHE_FOLDER / f"kernel_{_digest(text)}.sealed"
    stored = cache_files.read_sealed(known)
    if stored is not None:
        units = msgspec.json.decode(stored, type=CompileUnits)
        if all(cache_files.is_stored(name) or _is_written(name) for name in units.names):
            return units
    units = CompileUnits(
        tuple(write_modules([unit.text for unit in split(text)])), **kernel_properties(text)
    )
    cache_files.put_sealed(known, msgspec.json.encode(units))
    return units


def write_modules(texts: Sequence[str]) -> list[str]:
    """Write Python sources as modules into the cache folder; one that is there is not written
    again.

    Returns
    -------
    list of str
        Name of the module of each text, with a digest of the text.
    """
    names = []
    for text in texts:
        name = _name_of(text)
        if not _is_written(name):
            cache_files.put(CACHE_FOLDER / f"{name}.py", text.encode())
        names.append(name)
    return names


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _name_of(text: str) -> str:
    return f"sepmc_unit_{_digest(text)}"


def _is_written(name: str) -> bool:
    """Return True if a module is in the cache folder and its text has the digest in its name."""
    try:
        return _name_of((CACHE_FOLDER / f"{name}.py").read_text(encoding="utf-8")) == name
    except (OSError, UnicodeDecodeError):
        return False


def _compile(name: str) -> None:
    """Compile the compile unit whose module in the cache folder is called ``name``, or the loop
    over blocks (`cache_files.LOOP`), in this process; store the object file in the cache
    folder. Compile units are translated by `sepmc.translator`; only the loop is compiled by
    numba."""
    if name == cache_files.LOOP:
        from sepmc.engine.block_loop import compile_loop  # noqa: PLC0415  (numba)

        compile_loop()
    else:
        text = (CACHE_FOLDER / f"{name}.py").read_text(encoding="utf-8")
        cache_files.store(name, [name], compile_text(text, name))


def load(units: CompileUnits) -> Kernel:
    """Load the machine code of a kernel into this process, from the object files of its compile
    units in the cache folder. Units without such a file are first compiled in this process."""
    for name in units.names:
        if not cache_files.is_stored(name):
            _compile(name)
    addresses = cache_files.link_all(units.names)
    return Kernel(
        addresses[-1],
        units.size,
        table(addresses),
        units.n_indicators,
        units.n_segments,
        units.n_changes,
        units.methods,
    )


def missing_units(units: CompileUnits) -> list[str]:
    """Return the names of the compile units that are not compiled yet, those that take longest
    first. Before them comes the loop over blocks (`cache_files.LOOP`) if it is not compiled."""
    absent = [name for name in dict.fromkeys(units.names) if not cache_files.is_stored(name)]
    absent.sort(key=_compile_order, reverse=True)
    return absent if cache_files.is_stored(cache_files.LOOP) else [cache_files.LOOP, *absent]


def _compile_order(name: str) -> tuple[bool, int]:
    """Return a key by which compile units sort from the shortest expected compile time to the
    longest: whether the unit uses a module of `_SLOW`, then the length of its source."""
    text = (CACHE_FOLDER / f"{name}.py").read_text(encoding="utf-8")
    return any(module in text for module in _SLOW), len(text)


def compile_missing(units: CompileUnits, progress: Progress = lambda done, total: None) -> bool:
    """Compile those units, and the loop over blocks, that are not in the cache folder yet: in
    separate processes in parallel, or in this process if they are short and no other process is
    ready to compile.

    Parameters
    ----------
    units : CompileUnits
    progress : callable (int, int)
        Called after each unit with the number of units compiled so far and their total.

    Returns
    -------
    bool
        True if all were compiled; False if a process failed or could not be started.
    """
    try:
        with cache_lock("units"):
            names = missing_units(units)
            if running() or not _are_short(names):
                return compile_all(names, progress)
            for done, name in enumerate(names, 1):
                _compile(name)
                progress(done, len(names))
            return True
    except OSError:
        return False


def _are_short(names: Sequence[str]) -> bool:
    """Return True if compiling all these modules takes less time than starting a process for it:
    none is slow to compile, and their sources together have at most `_SHORT` characters."""
    if cache_files.LOOP in names:
        return False
    expected = [_compile_order(name) for name in names]
    return not any(slow for slow, _ in expected) and sum(length for _, length in expected) <= _SHORT


def serve() -> None:
    """Run as a compiling process: compile the modules named on standard input, one in each line,
    and print the name of each on standard output when it is done. Returns at the end of input."""
    output = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # other output goes to standard error
    for line in sys.stdin:
        name = line.strip()
        _compile(name)
        print(name, file=output, flush=True)
