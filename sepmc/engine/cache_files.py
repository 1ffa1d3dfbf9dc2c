"""Files of the cache folder, each with a checksum: a truncated or changed file counts as missing.
Object files of compiled functions, and their linking into this process.

Object files are specific to the processor.
"""

import hashlib
import json
import os
import threading
from collections.abc import Callable, Sequence
from pathlib import Path

import llvmlite
from llvmlite import binding

from sepmc.cache_folder import SETTING
from sepmc.code_cache import CACHE_FOLDER

LOOP = "blocks"  # name of the object file of the loop over blocks (`sepmc.engine.block_loop`)
_DIGEST = hashlib.sha256().digest_size  # bytes
_seen: dict[str, tuple[list[str], bytes]] = {}  # symbols and code, read but not linked
_linked: dict[str, tuple[int, binding.ExecutionEngine]] = {}  # addresses, owners of the code


def put(path: Path, content: bytes) -> None:
    """Write a file atomically: no other process or thread sees a partial file.

    Raises
    ------
    OSError
        If it cannot be written; with the reason, the path, and the environment variable that moves
        the cache.
    """
    draft = path.with_suffix(f".{os.getpid()}-{threading.get_ident()}")
    try:
        draft.write_bytes(content)
        draft.replace(path)
    except OSError as error:
        draft.unlink(missing_ok=True)
        reason = f"{error.strerror} in the cache of kernels; {SETTING} moves it"
        raise OSError(error.errno, reason, str(path)) from error


def put_sealed(path: Path, content: bytes) -> None:
    """Write a file with a checksum of its name and content in front, so that no file can replace
    another."""
    put(path, _digest(path, content) + content)


def read_sealed(path: Path) -> bytes | None:
    """Content of a file that `put_sealed` wrote; None if it is missing or damaged."""
    try:
        written = path.read_bytes()
    except OSError:
        return None
    digest, content = written[:_DIGEST], written[_DIGEST:]
    return content if _digest(path, content) == digest else None


def _digest(path: Path, content: bytes) -> bytes:
    """Checksum of a file's name and content."""
    return hashlib.sha256(path.name.encode() + b"\n" + content).digest()


def store(name: str, symbols: list[str], code: bytes) -> None:
    """Write the object file of a function.

    Parameters
    ----------
    name : str
        Name of the file in the cache folder.
    symbols : list of str
        Symbol of the function, then the symbols that it needs of others.
    code : bytes
        Object file.
    """
    put_sealed(_path(name), json.dumps(symbols).encode() + b"\n" + code)


def is_stored(name: str) -> bool:
    """Return True if an undamaged object file of this name is in the cache folder."""
    return name in _linked or _read(name) is not None


def link(name: str) -> int:
    """Address of the function of an object file in this process; 0 if the file is missing or
    damaged.

    Raises
    ------
    RuntimeError
        If a symbol that the code needs is not in this process.
    """
    return link_all([name])[0] if is_stored(name) else 0


def link_or_make(name: str, make: Callable[[], None]) -> int:
    """Address, in this process, of the function of an object file; if the file is missing or
    damaged, ``make()`` writes it first."""
    if not is_stored(name):
        make()
    return link(name)


def link_all(names: Sequence[str]) -> list[int]:
    """Addresses of the functions of stored object files in this process.

    New ones are linked together: each linker takes 1 ms to make.

    Raises
    ------
    RuntimeError
        If a symbol that the code needs is not in this process.
    """
    stored = {name: _read(name) for name in dict.fromkeys(names) if name not in _linked}
    objects = {name: content for name, content in stored.items() if content is not None}
    assert len(objects) == len(stored)
    if objects:
        addresses, engine = _link(list(objects.values()))
        for name, address in zip(objects, addresses, strict=True):
            _linked[name] = address, engine
            del _seen[name]
    return [_linked[name][0] for name in names]


def _path(name: str) -> Path:
    return CACHE_FOLDER / f"{name}.code"


def _read(name: str) -> tuple[list[str], bytes] | None:
    """Symbols (as in `store`) and content of an object file, read once; None if it is missing or
    damaged."""
    if name not in _seen:
        content = read_sealed(_path(name))
        if content is None:
            return None
        symbols, _, code = content.partition(b"\n")
        _seen[name] = json.loads(symbols), code
    return _seen[name]


def _link(objects: Sequence[tuple[list[str], bytes]]) -> tuple[list[int], binding.ExecutionEngine]:
    """Load object files, each given with its symbols (as in `store`). Returns the address of the
    function of each, and the engine that owns their code and must stay referenced.

    Raises RuntimeError if a symbol that they need is missing: LLVM would load them without an
    error.
    """
    binding.initialize_native_target()
    binding.initialize_native_asmprinter()
    target = binding.Target.from_default_triple().create_target_machine(jit=True)
    engine = binding.create_mcjit_compiler(binding.parse_assembly(""), target)
    needed = dict.fromkeys(name for symbols, _ in objects for name in symbols[1:])
    missing = [name for name in needed if not binding.address_of_symbol(name)]
    if missing:
        raise RuntimeError(
            f"machine code (llvmlite {llvmlite.__version__}) needs {', '.join(missing)}, not "
            "defined in this process; install a version of numba that sepmc was tested with"
        )
    for _, code in objects:
        engine.add_object_file(binding.ObjectFileRef.from_data(code))
    engine.finalize_object()
    return [engine.get_function_address(symbols[0]) for symbols, _ in objects], engine
