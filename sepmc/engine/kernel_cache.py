"""Kernels on disk: split into compile units, compiled in parallel in processes, loaded."""

import hashlib
import os
import sys
from collections.abc import Sequence

import msgspec

from sepmc.code_cache import CACHE_FOLDER, cache_lock
from sepmc.engine import cache_files
from sepmc.engine.compile_workers import Progress, compile_all
from sepmc.engine.written_kernel import Kernel, table
from sepmc.kernel.emit.compile_units import kernel_properties, split
from sepmc.translator.compiler import compile_text

# modules with routines that take seconds to compile
_SLOW = ("sepmc.routines.clearances", "sepmc.routines.splines", "sepmc.routines.peaks")


class CompileUnits(msgspec.Struct, frozen=True):
    """Compile units of a kernel, and its sizes.

    Attributes
    ----------
    names : tuple of str
        Modules in the cache folder, in the order of the table of addresses; the last one is the
        entry.
    size : int
        Number of floats in the workspace.
    n_indicators, n_segments, n_changes : int
        Counts of error indicators, of segments, and of reported times within segments (changes of
        joints, ends of strokes).
    methods : tuple
        For each segment, the names of its integration methods.
    """

    names: tuple[str, ...]
    size: int
    n_indicators: int
    n_segments: int
    n_changes: int
    methods: tuple[tuple[str, ...], ...]


def compile_units_of(text: str) -> CompileUnits:
    """Split the source of a kernel into compile units and write their modules into the cache
    folder; nothing is compiled yet.

    Splitting takes as long as writing the kernel, so the result is stored.
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
    """Write texts as modules into the cache folder, if they are new.

    Returns
    -------
    list of str
        Names of the modules, made of digests of the texts.
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
    """Return True if a module is in the cache folder with the text its name stands for."""
    try:
        return _name_of((CACHE_FOLDER / f"{name}.py").read_text(encoding="utf-8")) == name
    except (OSError, UnicodeDecodeError):
        return False


def _compile(name: str) -> None:
    """Compile a compile unit, by the name of its module, or the loop over blocks
    (`cache_files.LOOP`), and store the object file in the cache folder."""
    if name == cache_files.LOOP:
        from sepmc.engine.block_loop import compile_loop  # noqa: PLC0415  (numba)

        compile_loop()
    else:
        text = (CACHE_FOLDER / f"{name}.py").read_text(encoding="utf-8")
        cache_files.store(name, [name], compile_text(text, name))


def load(units: CompileUnits) -> Kernel:
    """Load a kernel from the object files of its compile units; units whose files are missing in
    the cache folder are compiled in this process first."""
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
    """Names of the modules of compile units that are not compiled yet, slowest first; before them
    that of the loop over blocks, if it is not."""
    absent = [name for name in dict.fromkeys(units.names) if not cache_files.is_stored(name)]
    absent.sort(key=_compile_order, reverse=True)
    return absent if cache_files.is_stored(cache_files.LOOP) else [cache_files.LOOP, *absent]


def _compile_order(name: str) -> tuple[bool, int]:
    """Sort key of a compile unit by its compile time: if it calls slow routines, then its
    length."""
    text = (CACHE_FOLDER / f"{name}.py").read_text(encoding="utf-8")
    return any(module in text for module in _SLOW), len(text)


def compile_in_subprocesses(
    units: CompileUnits, progress: Progress = lambda done, total: None
) -> bool:
    """Compile the missing units and the block loop into the cache folder, in separate processes.

    Parameters
    ----------
    units : CompileUnits
    progress : callable (int, int)
        Called after each unit with the number of compiled units and their total.

    Returns
    -------
    bool
        True if all were compiled.
    """
    try:
        with cache_lock("units"):
            return compile_all(missing_units(units), progress)
    except OSError:
        return False


def serve() -> None:
    """Compile the modules named on standard input, a line each, and answer each with its name."""
    output = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # other output goes to standard error
    for line in sys.stdin:
        name = line.strip()
        _compile(name)
        print(name, file=output, flush=True)
