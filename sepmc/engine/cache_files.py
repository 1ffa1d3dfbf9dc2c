"""Files of the cache folder, sealed by a checksum: one that was cut short or changed counts as not
there. Machine code of functions as such files, and linked into this process.

Code is what Numba made for this processor. Numba's own cache keeps beside that what is needed to
compile more functions with it, and takes 10 ms to load one, thirty times as long.
"""

import hashlib
import json
import os
import threading
from collections.abc import Callable
from pathlib import Path

import numba
from llvmlite import binding

from sepmc.cache_folder import SETTING
from sepmc.jit import CACHE_FOLDER, load_helpers

_DIGEST = hashlib.sha256().digest_size  # bytes
_seen: dict[str, tuple[list[str], bytes]] = {}  # symbols and code that are not linked yet
_linked: dict[str, tuple[int, binding.ExecutionEngine]] = {}  # addresses, and what holds the code


def put(path: Path, content: bytes) -> None:
    """Write a file such that no other process or thread ever sees a part of it."""
    draft = path.with_suffix(f".{os.getpid()}-{threading.get_ident()}")
    try:
        draft.write_bytes(content)
        draft.replace(path)
    except OSError as error:
        draft.unlink(missing_ok=True)
        said = f"{error.strerror} in the cache of kernels; {SETTING} moves it"
        raise OSError(error.errno, said, str(path)) from error


def put_sealed(path: Path, content: bytes) -> None:
    """Write a file with a checksum in front, of its name too: no file stands in for another."""
    put(path, _digest(path, content) + content)


def read_sealed(path: Path) -> bytes | None:
    """The content of a sealed file; None if it is not there as it was written."""
    try:
        written = path.read_bytes()
    except OSError:
        return None
    digest, content = written[:_DIGEST], written[_DIGEST:]
    return content if _digest(path, content) == digest else None


def _digest(path: Path, content: bytes) -> bytes:
    return hashlib.sha256(path.name.encode() + b"\n" + content).digest()


def store(name: str, symbols: list[str], code: bytes) -> None:
    """Write the object file of a function, by the first of ``symbols``; it needs the others."""
    put_sealed(_path(name), json.dumps(symbols).encode() + b"\n" + code)


def is_stored(name: str) -> bool:
    """Whether there is an object file of that name, as it was written."""
    return name in _linked or _read(name) is not None


def link(name: str) -> int:
    """Address of the function of an object file in this process, or 0 if there is no such file, as
    it was written."""
    if name not in _linked:
        kept = _read(name)
        if kept is None:
            return 0
        _linked[name] = _link(*kept)
        del _seen[name]
    return _linked[name][0]


def link_or_make(name: str, make: Callable[[], None]) -> int:
    """`link`; a file that is not there is made first."""
    if not is_stored(name):
        make()
    return link(name)


def _path(name: str) -> Path:
    return CACHE_FOLDER / f"{name}.code"


def _read(name: str) -> tuple[list[str], bytes] | None:
    """Symbols and machine code of an object file, which is read once."""
    if name not in _seen:
        content = read_sealed(_path(name))
        if content is None:
            return None
        symbols, _, code = content.partition(b"\n")
        _seen[name] = json.loads(symbols), code
    return _seen[name]


def _link(symbols: list[str], code: bytes) -> tuple[int, binding.ExecutionEngine]:
    """Load machine code; LLVM would let it call what it does not find, without a word."""
    load_helpers()
    target = binding.Target.from_default_triple().create_target_machine(jit=True)
    engine = binding.create_mcjit_compiler(binding.parse_assembly(""), target)
    symbol, *needed = symbols
    missing = [each for each in needed if not binding.address_of_symbol(each)]
    if missing:
        raise RuntimeError(
            f"machine code of numba {numba.__version__} needs {', '.join(missing)}, which are not "
            "there; install a version of numba that sepmc was tried with"
        )
    engine.add_object_file(binding.ObjectFileRef.from_data(code))
    engine.finalize_object()
    return engine.get_function_address(symbol), engine
