"""Kernels written for one scene (`sepmc.kernel.emit`): kept on disk in pieces, compiled apart and
side by side, loaded."""

import gc
import hashlib
import importlib.util
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType

from sepmc.engine import call_types
from sepmc.engine.blocks import compile_blocks
from sepmc.engine.compilers import Progress, compile_all
from sepmc.engine.pieces import table
from sepmc.engine.written import Kernel
from sepmc.jit import CACHE_FOLDER, config, is_module_cached, one_at_a_time
from sepmc.kernel.pieces import ALIKE, split

# What is left to the collector before it looks: looking took a fifth of the time to compile.
_GARBAGE = 1_000_000
# modules whose routines take seconds to compile, however short what calls them
_LONG = ("sepmc.routines.clearances", "sepmc.routines.splines", "sepmc.routines.peaks")
_BLOCKS = "blocks"  # in place of the name of a piece: the loop over blocks


def names_of(text: str) -> list[str]:
    """Names of the modules of a kernel's pieces, in the order of their table, in the cache folder;
    they are written there unless they are known: to split a kernel takes as long as to write
    it."""
    known = CACHE_FOLDER / f"kernel_{_digest(text)}.txt"
    try:
        names = known.read_text(encoding="utf-8").split()
    except OSError:
        names = []
    if names and all((CACHE_FOLDER / f"{name}.py").is_file() for name in names):
        return names
    names = write([piece.text for piece in split(text)])
    _put(known, "\n".join(names))
    return names


def write(texts: Sequence[str]) -> list[str]:
    """Put the texts of modules into the cache folder where they are new. Returns the modules'
    names, digests of the texts."""
    names = []
    for text in texts:
        name = f"sepmc_piece_{_digest(text)}"
        path = CACHE_FOLDER / f"{name}.py"
        if not path.is_file():
            _put(path, text)
        names.append(name)
    return names


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _put(path: Path, text: str) -> None:
    """Write a file such that no other process ever sees a part of it."""
    draft = path.with_suffix(f".{os.getpid()}")
    draft.write_text(text, encoding="utf-8")
    draft.replace(path)


def module(name: str) -> ModuleType:
    """A module of the cache folder, imported; its piece is loaded from the disk cache, or else
    compiled."""
    if name not in sys.modules:
        spec = importlib.util.spec_from_file_location(name, CACHE_FOLDER / f"{name}.py")
        assert spec is not None
        assert spec.loader is not None
        # compiled code in the cache refers to it by name
        sys.modules[name] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(sys.modules[name])
    return sys.modules[name]


def load(names: Sequence[str]) -> Kernel:
    """A kernel from the modules of its pieces in the order of their table, the last of which is
    entered."""
    compile_blocks()
    addresses = [getattr(module(name), ALIKE).address for name in names]
    entry = module(names[-1])
    return Kernel(
        addresses[-1],
        entry.SIZE_W,
        table(addresses),
        entry.GUARDS,
        entry.STAGES,
        entry.CHANGES,
        entry.METHODS,
    )


def missing(names: Sequence[str]) -> list[str]:
    """What the disk cache does not hold: the loop over blocks, modules of these pieces; what takes
    longest first."""
    if config.DISABLE_JIT:
        return []
    held = {path.name.partition(".")[0] for path in CACHE_FOLDER.glob("*/sepmc_piece_*.nbi")}
    left = [name for name in dict.fromkeys(names) if name not in held]
    left.sort(key=_takes, reverse=True)
    return left if is_module_cached(_BLOCKS) else [_BLOCKS, *left]


def _takes(name: str) -> tuple[bool, int]:
    """What tells how long a piece takes to compile: whether it calls long routines, its length."""
    text = (CACHE_FOLDER / f"{name}.py").read_text(encoding="utf-8")
    return any(module in text for module in _LONG), len(text)


def compile_apart(names: Sequence[str], progress: Progress = lambda done, total: None) -> bool:
    """Compile pieces, and the loop over blocks, into the disk cache, in processes of their own;
    ``progress`` is told after each. Returns whether that worked.

    Every campaign flies what the cache holds: code as compiled and the same code loaded can differ
    in the last bit.
    """
    try:
        with one_at_a_time("pieces"):
            return compile_all(missing(names), progress)
    except OSError:
        return False


def serve() -> None:
    """Compile what the lines of the standard input name, and give each name back when that is
    done."""
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # what anything prints is no answer
    gc.set_threshold(_GARBAGE)
    call_types.keep()
    for line in sys.stdin:
        name = line.strip()
        if name == _BLOCKS:
            compile_blocks()
        else:
            module(name)
        print(name, file=answers, flush=True)
