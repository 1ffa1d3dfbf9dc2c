"""Kernels written for one scene (`sepmc.compiler.emit`): kept on disk, imported, compiled."""

import hashlib
import importlib.util
import os
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import numpy as np

from sepmc.kernels._jit import BARE, CACHE_FOLDER, is_cached, one_at_a_time
from sepmc.kernels.layout import STRUCTURE

_PREFIX = "sepmc_scene_"


def load(text: str) -> ModuleType:
    """The module with this text: from the cache folder, where it is written if it is new. Its name is a digest of the text."""
    name = _PREFIX + hashlib.sha256(text.encode()).hexdigest()[:16]
    if name in sys.modules:
        return sys.modules[name]
    path = CACHE_FOLDER / f"{name}.py"
    if not path.is_file():
        draft = path.with_suffix(f".{os.getpid()}")
        draft.write_text(text, encoding="utf-8")
        draft.replace(path)
    return _import(path)


def _import(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[path.stem] = module  # compiled code in the cache refers to it by name
    spec.loader.exec_module(module)
    return module


def is_compiled(module: ModuleType) -> bool:
    """Whether the disk cache holds the kernel."""
    return is_cached(module.fly)


def compile_door(module: ModuleType) -> None:
    """Compile the kernel, or load it from the disk cache, by flying no case: its types are those of any scene."""
    integers, numbers = np.zeros(0, dtype=np.int64), np.zeros(0)
    table, block = np.zeros((0, 0)), np.zeros((0, 0, 0))
    scene = np.zeros(1, dtype=STRUCTURE)
    module.fly(scene, integers, numbers, numbers, integers, table, integers, 0.0, table, table, block, integers)


def compile_apart(module: ModuleType) -> bool:
    """Compile the kernel into the disk cache in a process of its own. Returns whether that worked.

    Every campaign flies what the cache holds: code as compiled and the same code loaded can differ in the last bit.
    """
    program = (
        "import sys; from pathlib import Path; from sepmc.kernels import specialised as s; "
        f"s.compile_door(s._import(Path({str(module.__file__)!r})))"
    )
    environment = {**os.environ, BARE: "1", "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    try:
        with one_at_a_time():
            if is_compiled(module):
                return True
            return subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, check=False).returncode == 0
    except OSError:
        return False
