"""Kernels written for one scene (`sepmc.kernel.emit.module`): kept on disk in pieces, compiled
apart and side by side, loaded."""

import gc
import hashlib
import importlib.util
import os
import sys
from collections.abc import Sequence
from functools import partial
from types import ModuleType

import msgspec

from sepmc.engine import blocks, cache_files, call_types
from sepmc.engine.compile_units import table
from sepmc.engine.compile_workers import Progress, compile_all
from sepmc.engine.written_kernel import Kernel
from sepmc.jit import CACHE_FOLDER, cache_lock, machine_code
from sepmc.kernel.emit.compile_units import ALIKE, split, told

# What is left to the collector before it looks: looking took a fifth of the time to compile.
_GARBAGE = 1_000_000
# modules whose routines take seconds to compile, however short what calls them
_LONG = ("sepmc.routines.clearances", "sepmc.routines.splines", "sepmc.routines.peaks")


class CompileUnits(msgspec.Struct, frozen=True):
    """The pieces of a kernel: names of their modules in the cache folder, in the order of their
    table, and what the kernel says of itself (`sepmc.kernel.emit.compile_units.told`)."""

    names: tuple[str, ...]
    size: int
    n_indicators: int
    n_segments: int
    n_changes: int
    methods: tuple[tuple[str, ...], ...]


def compile_units_of(text: str) -> CompileUnits:
    """The pieces of a kernel, whose modules are written into the cache folder unless they are
    known: to split a kernel takes as long as to write it."""
    known = CACHE_FOLDER / f"kernel_{_digest(text)}.sealed"
    kept = cache_files.read_sealed(known)
    if kept is not None:
        found = msgspec.json.decode(kept, type=CompileUnits)
        if all(cache_files.is_stored(name) or _is_written(name) for name in found.names):
            return found
    found = CompileUnits(tuple(write_modules([piece.text for piece in split(text)])), **told(text))
    cache_files.put_sealed(known, msgspec.json.encode(found))
    return found


def write_modules(texts: Sequence[str]) -> list[str]:
    """Put the texts of modules into the cache folder where they are new. Returns the modules'
    names, digests of the texts."""
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
    return f"sepmc_piece_{_digest(text)}"


def _is_written(name: str) -> bool:
    """Whether a module is in the cache folder, with the text that its name stands for."""
    try:
        return _name_of((CACHE_FOLDER / f"{name}.py").read_text(encoding="utf-8")) == name
    except (OSError, UnicodeDecodeError):
        return False


def load_module(name: str) -> ModuleType:
    """A module of the cache folder, whose piece is compiled as it is imported."""
    spec = importlib.util.spec_from_file_location(name, CACHE_FOLDER / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    found = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(found)
    return found


def _compile(name: str) -> None:
    """Compile the loop over blocks, or a piece, into the cache folder."""
    if name == blocks.NAME:
        blocks.compile_blocks()
    else:
        cache_files.store(name, *machine_code(getattr(load_module(name), ALIKE)))


def load(pieces: CompileUnits) -> Kernel:
    """A kernel from its pieces, the last of which is entered; what is not in the cache folder is
    compiled there."""
    addresses = [cache_files.link_or_make(name, partial(_compile, name)) for name in pieces.names]
    return Kernel(
        addresses[-1],
        pieces.size,
        table(addresses),
        pieces.n_indicators,
        pieces.n_segments,
        pieces.n_changes,
        pieces.methods,
    )


def missing_units(pieces: CompileUnits) -> list[str]:
    """What the cache folder does not hold: the loop over blocks, modules of these pieces; what
    takes longest first."""
    left = [name for name in dict.fromkeys(pieces.names) if not cache_files.is_stored(name)]
    left.sort(key=_takes, reverse=True)
    return left if cache_files.is_stored(blocks.NAME) else [blocks.NAME, *left]


def _takes(name: str) -> tuple[bool, int]:
    """What tells how long a piece takes to compile: whether it calls long routines, its length."""
    text = (CACHE_FOLDER / f"{name}.py").read_text(encoding="utf-8")
    return any(module in text for module in _LONG), len(text)


def compile_in_subprocesses(
    pieces: CompileUnits, progress: Progress = lambda done, total: None
) -> bool:
    """Compile what is missing of pieces, and the loop over blocks, into the cache folder, in
    processes of their own; ``progress`` is told after each. Returns whether that worked.

    Every campaign flies what the cache holds: code as compiled and the same code loaded can differ
    in the last bit.
    """
    try:
        with cache_lock("pieces"):
            return compile_all(missing_units(pieces), progress)
    except OSError:
        return False


def serve() -> None:
    """Compile what the lines of the standard input name, and give each name back when that is
    done."""
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # what anything prints is no answer
    gc.set_threshold(_GARBAGE)
    call_types.cache_call_types()
    for line in sys.stdin:
        name = line.strip()
        _compile(name)
        print(name, file=answers, flush=True)
