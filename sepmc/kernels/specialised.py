"""Kernels written for one scene (`sepmc.compiler.emit`): kept on disk, compiled apart, imported."""

import hashlib
import importlib.util
import os
import subprocess
import sys
from types import ModuleType
from typing import Any

from sepmc.kernels._jit import BARE, CACHE_FOLDER, is_module_cached, one_at_a_time
from sepmc.kernels.blocks import compile_blocks


def write(text: str) -> str:
    """Put the text of a module into the cache folder if it is new. Returns the module's name, a digest of the text."""
    name = "sepmc_scene_" + hashlib.sha256(text.encode()).hexdigest()[:16]
    path = CACHE_FOLDER / f"{name}.py"
    if not path.is_file():
        draft = path.with_suffix(f".{os.getpid()}")
        draft.write_text(text, encoding="utf-8")
        draft.replace(path)
    return name


def load(name: str) -> ModuleType:
    """Import a module from the cache folder; its kernel is loaded from the disk cache, or else compiled."""
    if name in sys.modules:
        return sys.modules[name]
    spec = importlib.util.spec_from_file_location(name, CACHE_FOLDER / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # compiled code in the cache refers to it by name
    spec.loader.exec_module(module)
    compile_blocks()
    return module


def is_compiled(name: str) -> bool:
    """Whether the disk cache holds the kernel of a module, and the loop that calls it."""
    return is_module_cached(name) and is_module_cached("blocks")


def compile_apart(name: str) -> bool:
    """Compile a kernel, and the loop over blocks, into the disk cache, each in a process of its own. Returns whether that worked.

    Every campaign flies what the cache holds: code as compiled and the same code loaded can differ in the last bit.
    """
    programs = ("from sepmc.kernels.blocks import compile_blocks; compile_blocks()", _load_program(name))
    environment = {**os.environ, BARE: "1", "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    try:
        with one_at_a_time():
            if is_compiled(name):
                return True
            quiet: dict[str, Any] = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
            started = [subprocess.Popen([sys.executable, "-c", program], env=environment, **quiet) for program in programs]
            return all([process.wait() == 0 for process in started])
    except OSError:
        return False


def _load_program(name: str) -> str:
    return (
        "import sys, importlib.util; from sepmc.kernels._jit import CACHE_FOLDER; "
        f"spec = importlib.util.spec_from_file_location({name!r}, CACHE_FOLDER / {name + '.py'!r}); "
        f"module = importlib.util.module_from_spec(spec); sys.modules[{name!r}] = module; spec.loader.exec_module(module)"
    )
