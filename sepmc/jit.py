"""Every compile option, and where compiled code is kept.

The cache folder is named by a digest of all kernel sources: Numba alone looks only at the file that
defines the cached function and would miss a change in one it inlines (numba #1833). Nothing outside
this folder is cached or touched.
"""

import contextlib
import hashlib
import os
import sys
import tempfile
from pathlib import Path
from typing import Any

import numba
from numba.core.compiler import CompilerBase, PassManager
from numba.core.compiler_machinery import register_pass
from numba.core.typed_passes import (
    IRLegalization,
    NativeLowering,
    NoPythonBackend,
    NopythonTypeInference,
    PreLowerStripPhis,
)
from numba.core.untyped_passes import (
    FixupArgs,
    GenericRewrites,
    IRProcessing,
    ReconstructSSA,
    TranslateByteCode,
)
from numba.extending import intrinsic, overload
from platformdirs import user_cache_dir

# Fused multiply-adds only: no flag that lets the compiler assume there is no NaN, which must
# survive to be reported.
_FASTMATH = {"contract"}
config: Any = numba.core.config  # its names are made at run time
_HERE = Path(__file__).parent
# Folders of what is compiled, and files: where a change asks for compiling anew.
_SOURCES = (
    "jit.py",
    "physics/*.py",
    "routines/*.py",
    "engine/*.py",
    "kernel/methods.py",
    "kernel/dop853_coefficients.py",
)


def sources_digest() -> str:
    """Digest of every source that is compiled and of the compiler's version."""
    digest = hashlib.sha256(numba.__version__.encode())
    for path in sorted(path for pattern in _SOURCES for path in _HERE.glob(pattern)):
        digest.update(path.relative_to(_HERE).as_posix().encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def cache_folder() -> Path:
    """Folder of this version's compiled kernels; a temporary one if the user's cache cannot be
    written."""
    base = Path(os.environ.get("SEPMC_CACHE_DIR") or user_cache_dir("sepmc"))
    folder = base / "kernels" / sources_digest()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if os.access(folder, os.W_OK):
            return folder
    except OSError:
        pass
    return Path(tempfile.gettempdir()) / "sepmc-kernels" / sources_digest()


CACHE_FOLDER = cache_folder()


@contextlib.contextmanager
def one_at_a_time(what):
    """Let one process at a time fill the cache with ``what`` it says: several at once can spoil it
    (numba #4807), and would each take as long."""
    try:
        import fcntl  # noqa: PLC0415  (not on every system)
    except ImportError:
        yield
        return
    with open(CACHE_FOLDER.parent / f"{CACHE_FOLDER.name}.{what}.lock", "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def compiling(program: str) -> dict[str, Any]:
    """Command and environment of a process that only fills the cache, by a program text; it imports
    nothing from the working folder."""
    path = os.pathsep.join(each for each in sys.path if each)
    return {
        "args": [sys.executable, "-P", "-c", program],
        "env": {**os.environ, BARE: "1", "PYTHONPATH": path},
    }


def is_module_cached(name: str) -> bool:
    """Whether the entry of a module in the cache folder was compiled before."""
    return config.DISABLE_JIT or any(CACHE_FOLDER.glob(f"*/{name}.*.nbi"))


@register_pass(mutates_CFG=True, analysis_only=False)
class _Lowering(NativeLowering):
    """Lowering without LLVM's passes over a function by itself: they took a quarter of the time to
    compile a piece, and the passes over the module follow once its formulas are copied into it."""

    def run_pass(self, state):
        level, config.OPT = config.OPT, 0
        try:
            return super().run_pass(state)
        finally:
            config.OPT = level


class Lean(CompilerBase):
    """Numba's compiler for functions that have no closures, constant branches or overloads to
    copy: without the passes that look for them."""

    def define_pipelines(self):
        passes = PassManager("lean")
        for each, says in (
            (TranslateByteCode, "bytecode"),
            (FixupArgs, "arguments"),
            (IRProcessing, "blocks"),
            (GenericRewrites, "constant places of tuples"),
            (ReconstructSSA, "one name for one value"),
            (NopythonTypeInference, "types"),
            (PreLowerStripPhis, "values that branches join"),
            (IRLegalization, "ends of lives"),
            (_Lowering, "lowering"),
            (NoPythonBackend, "code"),
        ):
            passes.add_pass(each, says)
        passes.finalize()
        return [passes]


# Wrappers make a function callable from Python. A process that only fills the cache needs none but
# the door's (2 s of compiling).
_BARE: dict[str, Any] = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
BARE = "SEPMC_BARE"  # set in the environment of such a process
_WRAPPED = _BARE if os.environ.get(BARE) else {}
# A formula on scalars and tuples: callable from Python for tests, and always copied into its
# caller, since a loop over cases with a call in it is not vectorised.
formula = numba.njit(fastmath=_FASTMATH, error_model="numpy", forceinline=True, **_WRAPPED)
# A formula too large for that.
long_formula = numba.njit(fastmath=_FASTMATH, error_model="numpy", **_WRAPPED)
# What works on a workspace: called from compiled code only.
routine = numba.njit(fastmath=_FASTMATH, error_model="numpy", **_BARE)


def keep_apart() -> None:
    """First line of a large routine: its code then stands once, not copied to each of its calls,
    which took most of the time to compile."""


def _mark_apart_intrinsic(typing_context):
    """Mark the function that is being compiled as one that is called, never copied into its
    caller."""

    def generate(context, builder, signature, arguments):
        builder.function.attributes.add("noinline")
        return context.get_dummy_value()

    return numba.types.none(), generate


_mark_apart: Any = intrinsic(_mark_apart_intrinsic)


@overload(keep_apart, inline="always")
def _keep_apart():
    return lambda: _mark_apart()


@contextlib.contextmanager
def _own_cache():
    """Where functions decorated meanwhile keep their compiled code."""
    previous = config.CACHE_DIR
    config.CACHE_DIR = str(CACHE_FOLDER)
    try:
        yield
    finally:
        config.CACHE_DIR = previous


def door(function):
    """Compile a function that Python calls: parallel over cases, and kept on disk."""
    with _own_cache():
        return numba.njit(
            parallel=True, cache=True, nogil=True, fastmath=_FASTMATH, error_model="numpy"
        )(function)


def compiled_piece(signature):
    """Compile, at once, a function that is called by its address; kept on disk."""

    def compiled(function):
        if config.DISABLE_JIT:
            return function
        with _own_cache():
            return numba.cfunc(
                signature, cache=True, pipeline_class=Lean, fastmath=_FASTMATH, error_model="numpy"
            )(function)

    return compiled
