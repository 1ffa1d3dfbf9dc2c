"""Every compile option, and the name of the folder of compiled code: a digest of all kernel
sources, of the compiler and of the processor.

Nothing outside this folder is cached or touched.
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
from numba.core.untyped_passes import (
    FixupArgs,
    GenericRewrites,
    IRProcessing,
    TranslateByteCode,
)
from numba.extending import lower_builtin, type_callable

from sepmc.cache_folder import SETTING, cache_folder
from sepmc.locks import locked

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
    "kernel/spec/methods.py",
    "kernel/spec/dop853_coefficients.py",
    "kernel/emit/compile_units.py",
)


def _import_array_maths() -> None:
    """Import Numba's array maths without ``scipy.linalg`` (0.24 s): it only asks whether that is
    there, and those who use it import it again."""
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
    """Name of the processor that code is made for, as LLVM has it."""
    return str(config.CPU_NAME or binding.get_host_cpu_name())


def sources_digest() -> str:
    """Digest of every source that is compiled, of what compiles it and of the processor."""
    made_by = (
        numba.__version__,
        llvmlite.__version__,
        sys.version_info[:2],
        binding.get_default_triple(),
        processor(),
        config.CPU_FEATURES or binding.get_host_cpu_features().flatten(),
    )
    return hashlib.sha256(repr(made_by).encode() + digest_of(_SOURCES)).hexdigest()[:16]


def digest_of(patterns: Sequence[str]) -> bytes:
    """Digest of files of this package, by names with wildcards."""
    digest = hashlib.sha256()
    for path in sorted(path for pattern in patterns for path in _HERE.glob(pattern)):
        digest.update(path.relative_to(_HERE).as_posix().encode())
        digest.update(path.read_bytes())
    return digest.digest()


CACHE_FOLDER = cache_folder(sources_digest())


@contextlib.contextmanager
def cache_lock(what):
    """Let one process at a time fill the cache with ``what`` it says: several at once can spoil it
    (numba #4807), and would each take as long."""
    path = CACHE_FOLDER.parent / f"{CACHE_FOLDER.name}.{what}.lock"
    with locked(path, os.O_WRONLY | os.O_CREAT):
        yield


def compile_command(program: str) -> dict[str, Any]:
    """Command and environment of a process that only fills the cache, by a program text; it imports
    nothing from the working folder."""
    path = os.pathsep.join(each for each in sys.path if each)
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
    """Lowering without LLVM's passes over a function by itself: they took a quarter of the time to
    compile a piece, and the passes over the module follow once its formulas are copied into it."""

    def run_pass(self, state):
        level, config.OPT = config.OPT, 0
        try:
            return super().run_pass(state)
        finally:
            config.OPT = level


class Lean(CompilerBase):
    """Numba's compiler without passes that a piece has no need of: those that look for closures,
    constant branches and overloads to copy; a name for each value of a variable, which took half
    of the time of `fly_block` (in a function a variable has one type: `kernel.text.Text`); ends of
    lives, since a piece owns no memory."""

    before_lowering: Any = ()
    lowering: type[NativeLowering] = _Lowering

    def define_pipelines(self):
        passes = PassManager("lean")
        for each in (
            TranslateByteCode,
            FixupArgs,
            IRProcessing,
            GenericRewrites,
            NopythonTypeInference,
            *self.before_lowering,
            self.lowering,
            NoPythonBackend,
        ):
            passes.add_pass(each, each.__name__)
        passes.finalize()
        return [passes]


class _Linked(JITCodeLibrary):
    """Code that is linked into a piece, which optimises it: no machine code is made of it alone."""

    def _finalize_final_module(self):
        self._finalize_dynamic_globals()
        self._finalized = True


@register_pass(mutates_CFG=True, analysis_only=False)
class _Linking(NativeLowering):
    """Lowering of a function that pieces call, and nothing else. LLVM's passes make a formula
    straight before it is copied: without them, loops that call some are not vectorised."""

    def run_pass(self, state):
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
    """The same for what pieces call: it holds the workspace it is given until it ends."""

    before_lowering = (IRLegalization,)
    lowering: type[NativeLowering] = _Linking


# Wrappers make a function callable from Python. A process that only fills the cache needs none but
# the door's (2 s of compiling).
_BARE: dict[str, Any] = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
BARE = "SEPMC_BARE"  # set in the environment of such a process
_WRAPPED = _BARE if os.environ.get(BARE) else {}
_CALLED: dict[str, Any] = {"fastmath": _FASTMATH, "error_model": "numpy", "pipeline_class": Callee}


def for_any_numbers(function):
    """Compile a function once, and not anew for whole numbers that stand in calls of it. (Where
    these say how long a loop is, code made for them is faster.)"""
    if config.DISABLE_JIT:
        return function
    template = function.get_call_template
    function.get_call_template = lambda args, kws: template(
        [numba.types.unliteral(arg) for arg in args], kws
    )
    return function


def formula(function) -> Any:
    """Compile a formula on scalars and tuples: callable from Python for tests, and always copied
    into its caller, since a loop over cases with a call in it is not vectorised."""
    return for_any_numbers(numba.njit(forceinline=True, **_CALLED, **_WRAPPED)(function))


# A formula too large for that.
long_formula = numba.njit(**_CALLED, **_WRAPPED)
# What works on a workspace: called from compiled code only.
routine = numba.njit(**_CALLED, **_BARE)


def noinline() -> None:
    """First line of a large routine: its code then stands once, not copied to each of its calls,
    which took most of the time to compile."""


@type_callable(noinline)
def _type_of_mark(context):
    return lambda: numba.types.none


@lower_builtin(noinline)
def _mark_apart(context, builder, signature, arguments):
    """Mark the function that is being compiled as one that is called, never copied into its
    caller."""
    builder.function.attributes.add("noinline")
    return context.get_dummy_value()


def compiled(function, signature, **options: Any) -> Any:
    """Compile a function that is called by its address."""
    return numba.cfunc(signature, fastmath=_FASTMATH, error_model="numpy", **options)(function)


def machine_code(function: Any) -> tuple[list[str], bytes]:
    """The symbol of a compiled function and those that it needs of others, and its object file."""
    library = function._library
    needed = [
        each.name
        for each in (*library._final_module.functions, *library._final_module.global_variables)
        if each.is_declaration and not each.name.startswith("llvm.")
    ]
    return [function.native_name, *needed], library._get_compiled_object()


@cache
def load_helpers() -> None:
    """Let machine code find what Numba has it call, by name."""
    binding.initialize_native_target()
    binding.initialize_native_asmprinter()
    base._load_global_helpers()
    for name, address in _nrt_python.c_helpers.items():
        binding.add_symbol(name if name.startswith("_") else f"NRT_{name}", address)
