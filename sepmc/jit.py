"""Compile options, and the cache folder of compiled code, named by a digest of the kernel sources,
the compiler and the processor.

Nothing outside this folder is cached or changed.
"""

import contextlib
import hashlib
import os
import sys
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import llvmlite
import numba
from llvmlite import binding
from numba import _dynfunc  # type: ignore[attr-defined]
from numba.core import base
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, PassManager
from numba.core.compiler_machinery import register_pass
from numba.core.runtime import _nrt_python  # type: ignore[attr-defined]
from numba.core.typed_passes import (
    IRLegalization,
    NativeLowering,
    NoPythonBackend,
    NopythonTypeInference,
)
from numba.core.untyped_passes import FixupArgs, GenericRewrites, IRProcessing, TranslateByteCode
from numba.extending import lower_builtin, type_callable

from sepmc.cache_folder import SETTING, cache_folder
from sepmc.locks import locked

# Fused multiply-adds only: no flag that lets the compiler assume there is no NaN, which must
# survive to be reported.
_FASTMATH = {"contract"}
config: Any = numba.core.config  # its attributes are set at run time
_VECTORS = {"avx512f": "AVX-512", "avx2": "AVX2", "avx": "AVX", "neon": "NEON", "sse2": "SSE2"}
_HERE = Path(__file__).parent
# Compiled sources: a change asks for compiling again.
_SOURCES = (
    "jit.py",
    "physics/*.py",
    "routines/*.py",
    "engine/*.py",
    "kernel/spec/methods.py",
    "kernel/spec/dop853_coefficients.py",
    "kernel/emit/compile_units.py",
)


def _import_array_maths() -> None:
    """Import Numba's array maths without ``scipy.linalg`` (0.24 s): Numba only checks that it is
    installed, and modules that use it import it."""
    name = "scipy.linalg.cython_blas"
    if name in sys.modules or "numba.np.arraymath" in sys.modules:
        return
    modules: dict[str, Any] = sys.modules
    modules[name] = None  # as if it were not installed
    try:
        from numba.np import arraymath  # noqa: PLC0415
    finally:
        del modules[name]
    arraymath._HAVE_BLAS = True


_import_array_maths()


def processor() -> str:
    """Name of the processor that code is compiled for, as in LLVM."""
    return str(config.CPU_NAME or binding.get_host_cpu_name())


def _features() -> str:
    """Features of the processor that code is compiled for, as in LLVM."""
    return str(config.CPU_FEATURES or binding.get_host_cpu_features().flatten())


def vector_extension() -> str:
    """Name of the widest vector instructions that code is compiled for, such as "AVX2"; "none
    known" if it is none of the names in this module."""
    features = _features().split(",")
    return next((name for flag, name in _VECTORS.items() if f"+{flag}" in features), "none known")


def sources_digest() -> str:
    """Digest (16 hex digits) of all compiled sources, of the versions of the compilers and of the
    processor: the name of the cache folder."""
    versions = (
        numba.__version__,
        llvmlite.__version__,
        sys.version_info[:2],
        binding.get_default_triple(),
        processor(),
        _features(),
    )
    return hashlib.sha256(repr(versions).encode() + digest_of(_SOURCES)).hexdigest()[:16]


def digest_of(patterns: Sequence[str]) -> bytes:
    """SHA-256 digest of the paths and contents of files of this package, given by patterns with
    wildcards relative to its folder."""
    digest = hashlib.sha256()
    for path in sorted(path for pattern in patterns for path in _HERE.glob(pattern)):
        digest.update(path.relative_to(_HERE).as_posix().encode())
        digest.update(path.read_bytes())
    return digest.digest()


CACHE_FOLDER = cache_folder(sources_digest())


@contextlib.contextmanager
def cache_lock(name):
    """Context in which no other process has the lock ``name`` of the cache: several processes that
    compile the same code at once can damage it (numba #4807), and would each take as long."""
    path = CACHE_FOLDER.parent / f"{CACHE_FOLDER.name}.{name}.lock"
    with locked(path, os.O_WRONLY | os.O_CREAT):
        yield


def compile_command(program: str) -> dict[str, Any]:
    """Arguments of `subprocess.Popen` (by keyword) for a Python program, given as source text, that
    only fills the cache. It imports nothing from the working folder."""
    path = os.pathsep.join(folder for folder in sys.path if folder)
    return {
        "args": [sys.executable, "-P", "-c", program],
        "env": {
            **os.environ,
            BARE: "1",
            "PYTHONPATH": path,
            SETTING: str(CACHE_FOLDER.parent.parent),
        },
    }


@register_pass(mutates_CFG=True, analysis_only=False)
class _Lowering(NativeLowering):
    """Lowering without LLVM's function passes: they took a quarter of the compile time of a unit,
    and the module passes follow once its formulas are inlined."""

    def run_pass(self, state):
        """Lower with optimisation off."""
        level, config.OPT = config.OPT, 0
        try:
            return super().run_pass(state)
        finally:
            config.OPT = level


class Lean(CompilerBase):
    """Numba's compiler without passes that compile units do not need: closures, constant branches,
    overloads to inline; static single assignment, which took half of the time of `integrate_block`
    (a variable has one type in a function: `kernel.tracer.text.Text`); lifetimes of variables,
    since a unit owns no memory."""

    before_lowering: Any = ()
    lowering: type[NativeLowering] = _Lowering

    def define_pipelines(self):
        """Pipeline with the passes that are needed."""
        passes = PassManager("lean")
        for numba_pass in (
            TranslateByteCode,
            FixupArgs,
            IRProcessing,
            GenericRewrites,
            NopythonTypeInference,
            *self.before_lowering,
            self.lowering,
            NoPythonBackend,
        ):
            passes.add_pass(numba_pass, numba_pass.__name__)
        passes.finalize()
        return [passes]


class _Linked(JITCodeLibrary):
    """Code that is linked into a compile unit and optimised there; no machine code is made of it
    alone."""

    def _finalize_final_module(self):
        self._finalize_dynamic_globals()
        self._finalized = True


@register_pass(mutates_CFG=True, analysis_only=False)
class _Linking(NativeLowering):
    """Lowering of a function that only compile units call. LLVM's passes simplify a formula before
    it is inlined: without them, loops that call some are not vectorised."""

    def run_pass(self, state):
        """Lower into a library for linking, unless the function needs a Python wrapper."""
        if not state.flags.no_cpython_wrapper:
            return super().run_pass(state)
        name = state.func_id.func_qualname
        state.library = _Linked(state.targetctx.codegen(), name)
        state.flags.no_compile = True
        super().run_pass(state)
        if state.flags.forceinline:
            state.library.finalize()
        lowered = state["cr"]
        called = _dynfunc.make_function(
            lowered.fndesc.lookup_module(), name, "", 0, lowered.env, (state.library,)
        )
        state.targetctx.insert_user_function(called, lowered.fndesc, [state.library])
        state["cr"] = lowered._replace(cfunc=called)
        return True


class Callee(Lean):
    """Compiler of functions that compile units call: the workspace argument stays referenced until
    they return."""

    before_lowering = (IRLegalization,)
    lowering: type[NativeLowering] = _Linking


# Wrappers make a function callable from Python. A process that only fills the cache needs only that
# of the block loop (saves 2 s).
_BARE: dict[str, Any] = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
BARE = "SEPMC_BARE"  # environment variable of such a process
_WRAPPED = _BARE if os.environ.get(BARE) else {}
_CALLED: dict[str, Any] = {"fastmath": _FASTMATH, "error_model": "numpy", "pipeline_class": Callee}


def for_any_numbers(function):
    """Compile a function once, not anew for each integer literal in its calls. (Where these are
    loop counts, specialised code is faster.)"""
    if config.DISABLE_JIT:
        return function
    template = function.get_call_template
    function.get_call_template = lambda args, kws: template(
        [numba.types.unliteral(arg) for arg in args], kws
    )
    return function


def formula(function) -> Any:
    """Decorator that compiles a formula on scalars and tuples.

    The result can be called from Python, in tests. Compiled code always inlines it: a loop over
    cases with a call in it is not vectorised.
    """
    return for_any_numbers(numba.njit(forceinline=True, **_CALLED, **_WRAPPED)(function))


# A formula too large to be inlined everywhere.
long_formula = numba.njit(**_CALLED, **_WRAPPED)
# A function of a workspace, called from compiled code only.
routine = numba.njit(**_CALLED, **_BARE)


def noinline() -> None:
    """Keep a routine from being inlined. As the first line of a large routine it saves most of the
    compile time of its callers."""


@type_callable(noinline)
def _noinline_type(context):
    """Numba's type of a call of `noinline`."""
    return lambda: numba.types.none


@lower_builtin(noinline)
def _add_noinline(context, builder, signature, arguments):
    """Add LLVM's attribute ``noinline`` to the function that is being compiled."""
    builder.function.attributes.add("noinline")
    return context.get_dummy_value()


def compiled(function, signature, **options: Any) -> Any:
    """Compile a function of a Numba signature as a C function (`numba.cfunc`), which is called by
    its address; ``options`` are Numba's."""
    return numba.cfunc(signature, fastmath=_FASTMATH, error_model="numpy", **options)(function)


def machine_code(function: Any) -> tuple[list[str], bytes]:
    """Symbols and object file of a compiled function.

    Returns
    -------
    symbols : list of str
        Its own symbol, then those that it needs of others.
    code : bytes
    """
    library = function._library
    needed = [
        symbol.name
        for symbol in (*library._final_module.functions, *library._final_module.global_variables)
        if symbol.is_declaration and not symbol.name.startswith("llvm.")
    ]
    return [function.native_name, *needed], library._get_compiled_object()


@cache
def load_helpers() -> None:
    """Register the functions that Numba's machine code calls by name."""
    binding.initialize_native_target()
    binding.initialize_native_asmprinter()
    base._load_global_helpers()
    for name, address in _nrt_python.c_helpers.items():
        binding.add_symbol(name if name.startswith("_") else f"NRT_{name}", address)
