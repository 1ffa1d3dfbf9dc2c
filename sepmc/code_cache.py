"""Cache folder of compiled code, named by a digest of its sources, the compilers and the processor.

All that is cached is in this folder; only the files of its locks (`cache_lock`) lie beside it.
"""

import contextlib
import hashlib
import importlib.metadata
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import llvmlite
from llvmlite import binding

from sepmc.cache_folder import SETTING, cache_folder
from sepmc.locks import locked

# Environment variables, as Numba's: the loop over cases is compiled by Numba.
_CPU_NAME, _CPU_FEATURES = "NUMBA_CPU_NAME", "NUMBA_CPU_FEATURES"
_VECTORS = {"avx512f": "AVX-512", "avx2": "AVX2", "avx": "AVX", "neon": "NEON", "sse2": "SSE2"}
_HERE = Path(__file__).parent
# Compiled sources, and what compiles them: a change asks for compiling again.
_SOURCES = (
    "code_cache.py",
    "jit.py",
    "physics/*.py",
    "routines/*.py",
    "translator/*.py",
    "engine/*.py",
    "kernel/spec/methods.py",
    "kernel/spec/dop853_coefficients.py",
    "kernel/emit/compile_units.py",
)


def processor() -> str:
    """Return LLVM's name of the processor that code is compiled for: the environment variable
    NUMBA_CPU_NAME, or else the processor of this machine."""
    return os.environ.get(_CPU_NAME) or str(binding.get_host_cpu_name())


def features() -> str:
    """Return the features of the processor that code is compiled for as LLVM lists them, such as
    ``+avx2,-avx512f``: NUMBA_CPU_FEATURES, or else those of this machine."""
    return os.environ.get(_CPU_FEATURES) or str(binding.get_host_cpu_features().flatten())


def vector_extension() -> str:
    """Return the name of the widest vector instructions that code is compiled for, such as "AVX2";
    "none known" if the processor has none of those in `_VECTORS`."""
    flags = features().split(",")
    return next((name for flag, name in _VECTORS.items() if f"+{flag}" in flags), "none known")


def sources_digest() -> str:
    """Return 16 hex digits that change with any source that is compiled, the versions of the
    compilers and of Python, and the processor: the name of the cache folder."""
    versions = (
        importlib.metadata.version("numba"),
        llvmlite.__version__,
        sys.version_info[:2],
        binding.get_default_triple(),
        processor(),
        features(),
    )
    return hashlib.sha256(repr(versions).encode() + digest_of(_SOURCES)).hexdigest()[:16]


def digest_of(patterns: Sequence[str]) -> bytes:
    """Return the SHA-256 digest of the paths and contents of all files of this package that match
    one of some patterns with wildcards, such as ``physics/*.py``, relative to its folder. A file
    that matches two patterns counts twice; a pattern without files adds nothing."""
    digest = hashlib.sha256()
    for path in sorted(path for pattern in patterns for path in _HERE.glob(pattern)):
        digest.update(path.relative_to(_HERE).as_posix().encode())
        digest.update(path.read_bytes())
    return digest.digest()


CACHE_FOLDER = cache_folder(sources_digest())


@contextlib.contextmanager
def cache_lock(name):
    """Context that takes the lock ``name`` of the cache, after waiting until no other process has
    it. Processes that compile the same code at once can damage it (numba #4807), and would all do
    the same work."""
    path = CACHE_FOLDER.parent / f"{CACHE_FOLDER.name}.{name}.lock"
    with locked(path, os.O_WRONLY | os.O_CREAT):
        yield


def compile_command(program: str) -> dict[str, Any]:
    """Return the keyword arguments of `subprocess.Popen` that start a Python program, given as
    source text, which uses the same cache folder as this process. The program imports nothing from
    the working folder."""
    path = os.pathsep.join(folder for folder in sys.path if folder)
    return {
        "args": [sys.executable, "-P", "-c", program],
        "env": {
            **os.environ,
            "PYTHONPATH": path,
            SETTING: str(CACHE_FOLDER.parent.parent),
        },
    }
