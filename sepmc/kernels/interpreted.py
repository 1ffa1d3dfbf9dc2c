"""Written kernels as plain Python: the same text, one lane, nothing compiled. For a few cases of a new scene, and for a debugger.

The formulas that a text calls are imported a second time with the compiler off; the compiled ones stay as they are.
"""

import contextlib
import math
import sys
from collections.abc import Iterator
from types import ModuleType, SimpleNamespace

import numpy as np

import sepmc.kernels
from sepmc.kernels._jit import config
from sepmc.kernels.kernel import Kernel

_PACKAGE = "sepmc.kernels"
_plain: dict[str, ModuleType] = {}  # second copies, by name
_loaded: dict[str, Kernel] = {}  # kernels, by their text
# Compiled code divides by zero as numpy does, so a root must be one of numpy's numbers.
_MATH = SimpleNamespace(**vars(math) | {"sqrt": lambda x: np.float64(math.sqrt(x) if x >= 0.0 else math.nan)})


def _ours() -> dict[str, ModuleType]:
    return {name: module for name, module in sys.modules.items() if name == _PACKAGE or name.startswith(_PACKAGE + ".")}


@contextlib.contextmanager
def _without_compiler() -> Iterator[None]:
    """Let the package of kernels, imported meanwhile, be its second copy."""
    compiled, switch = _ours(), config.DISABLE_JIT
    package = sys.modules["sepmc"]
    for name in compiled:
        del sys.modules[name]
    sys.modules.update(_plain)
    config.DISABLE_JIT = 1
    try:
        yield
    finally:
        config.DISABLE_JIT = switch
        _plain.update(_ours())
        for name in _ours():
            del sys.modules[name]
        sys.modules.update(compiled)
        package.kernels = sepmc.kernels  # type: ignore[attr-defined]


def load(text: str) -> Kernel:
    """The kernel with this text, to be flown by `sepmc.kernels.blocks.fly` in plain Python."""
    if text not in _loaded:
        module = ModuleType("sepmc_scene")
        with _without_compiler():
            exec(compile(text, "<kernel>", "exec"), module.__dict__)
        for plain in (module, *_plain.values()):
            if getattr(plain, "math", None) is math:
                plain.math = _MATH  # type: ignore[attr-defined]
        _loaded.clear()  # one scene at a time: a thousand would fill the memory
        _loaded[text] = Kernel(guards=module.GUARDS, stages=module.STAGES, changes=module.CHANGES, plain=module)
    return _loaded[text]
