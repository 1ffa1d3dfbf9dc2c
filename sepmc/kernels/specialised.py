"""Kernels written for one scene (`sepmc.compiler.emit`): kept on disk in pieces, compiled apart and side by side, loaded."""

import hashlib
import importlib.util
import os
import subprocess
import sys
from collections.abc import Sequence
from types import ModuleType
from typing import Any

from sepmc.kernels._jit import BARE, CACHE_FOLDER, config, is_module_cached, one_at_a_time
from sepmc.kernels.blocks import compile_blocks
from sepmc.kernels.kernel import Kernel
from sepmc.kernels.pieces import table

_BLOCKS = "from sepmc.kernels.blocks import compile_blocks; compile_blocks()"
_PIECES = """
import sys
from sepmc.kernels import specialised
for name in sys.argv[1:]:
    specialised.module(name)
"""


def write(texts: Sequence[str]) -> list[str]:
    """Put the texts of modules into the cache folder where they are new. Returns the modules' names, digests of the texts."""
    names = []
    for text in texts:
        name = "sepmc_piece_" + hashlib.sha256(text.encode()).hexdigest()[:16]
        path = CACHE_FOLDER / f"{name}.py"
        if not path.is_file():
            draft = path.with_suffix(f".{os.getpid()}")
            draft.write_text(text, encoding="utf-8")
            draft.replace(path)
        names.append(name)
    return names


def module(name: str) -> ModuleType:
    """A module of the cache folder, imported; its piece is loaded from the disk cache, or else compiled."""
    if name not in sys.modules:
        spec = importlib.util.spec_from_file_location(name, CACHE_FOLDER / f"{name}.py")
        assert spec is not None
        assert spec.loader is not None
        sys.modules[name] = importlib.util.module_from_spec(spec)  # compiled code in the cache refers to it by name
        spec.loader.exec_module(sys.modules[name])
    return sys.modules[name]


def load(pieces: Sequence[tuple[str, str]]) -> Kernel:
    """A kernel from its pieces in the order of their table, the last of which is entered: names of functions, and of their modules."""
    compile_blocks()
    addresses = [getattr(module(name), function).address for function, name in pieces]
    entry = module(pieces[-1][1])
    return Kernel(addresses[-1], entry.SIZE_W, table(addresses), entry.GUARDS, entry.STAGES)


def missing(names: Sequence[str]) -> list[str]:
    """The modules whose pieces the disk cache does not hold."""
    if config.DISABLE_JIT:
        return []
    held = {path.name.partition(".")[0] for path in CACHE_FOLDER.glob("*/sepmc_piece_*.nbi")}
    return [name for name in dict.fromkeys(names) if name not in held]


def compile_apart(names: Sequence[str]) -> bool:
    """Compile pieces, and the loop over blocks, into the disk cache, in a process for each core. Returns whether that worked.

    Every campaign flies what the cache holds: code as compiled and the same code loaded can differ in the last bit.
    """
    environment = {**os.environ, BARE: "1", "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    try:
        with one_at_a_time("pieces"):
            programs = [[_PIECES, *share] for share in _shares(missing(names), os.cpu_count() or 1) if share]
            programs += [] if is_module_cached("blocks") else [[_BLOCKS]]
            quiet: dict[str, Any] = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
            started = [subprocess.Popen([sys.executable, "-c", *program], env=environment, **quiet) for program in programs]
            return all([process.wait() == 0 for process in started])
    except OSError:
        return False


def _shares(names: Sequence[str], count: int) -> list[list[str]]:
    """Names dealt to so many processes, the longest texts first, each to who has least."""
    sizes = {name: (CACHE_FOLDER / f"{name}.py").stat().st_size for name in names}
    shares: list[list[str]] = [[] for _ in range(count)]
    for name in sorted(names, key=lambda name: -sizes[name]):
        min(shares, key=lambda share: sum(sizes[one] for one in share)).append(name)
    return shares
