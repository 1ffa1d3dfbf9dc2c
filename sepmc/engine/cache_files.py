"""Files of the cache folder, with a checksum, so that a truncated or changed file counts as missing
(`put` alone writes none); and linking of its object files (machine code of functions) into this
process.

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
    """Write a file atomically: no other process or thread sees a partial file. Its folder must
    exist. The content is written as it is, without a checksum (`put_sealed` adds one).

    Raises
    ------
    OSError
        If it cannot be written; the error gives the reason, the path, and the environment variable
        that moves the cache.
    """
    draft = path.with_suffix(f".{os.getpid()}-{threading.get_ident()}")
    try:
        draft.write_bytes(content)
        draft.replace(path)
    except OSError as error:
        draft.unlink(missing_ok=True)
        reason = (
            f"{error.strerror} in the cache of kernels; the environment variable {SETTING} moves it"
        )
        raise OSError(error.errno, reason, str(path)) from error


def put_sealed(path: Path, content: bytes) -> None:
    """Write a file, whose folder must exist, with a checksum in front of its content, atomically.
    The checksum includes the name, so that a copy of one file under the name of another is
    rejected. Raises OSError if the file cannot be written."""
    put(path, _digest(path, content) + content)


def read_sealed(path: Path) -> bytes | None:
    """Return the content of a file that `put_sealed` wrote, without the checksum; None if the file
    is missing or damaged."""
    try:
        written = path.read_bytes()
    except OSError:
        return None
    digest, content = written[:_DIGEST], written[_DIGEST:]
    return content if _digest(path, content) == digest else None


def _digest(path: Path, content: bytes) -> bytes:
    """Return the checksum of a file's name and content."""
    return hashlib.sha256(path.name.encode() + b"\n" + content).digest()


def store(name: str, symbols: list[str], code: bytes) -> None:
    """Write the object file of a function into the cache folder.

    Parameters
    ----------
    name : str
        Name of the file there, without suffix.
    symbols : list of str
        Symbol of the function in the object file, then the symbols outside of it that it needs.
    code : bytes
        Content of the object file.

    Raises
    ------
    OSError
        As `put`.
    """
    put_sealed(_path(name), json.dumps(symbols).encode() + b"\n" + code)


def is_stored(name: str) -> bool:
    """Return True if the object file ``name`` is linked already, or is in the cache folder
    undamaged."""
    return name in _linked or _read(name) is not None


def link(name: str) -> int:
    """Link the object file ``name`` into this process; return the address of its function, 0 if the
    file is missing or damaged.

    Raises
    ------
    RuntimeError
        If a symbol that the code needs is not in this process.
    """
    return link_all([name])[0] if is_stored(name) else 0


def link_or_make(name: str, make: Callable[[], None]) -> int:
    """Link the object file ``name`` into this process; return the address of its function. If the
    file is missing or damaged, ``make()`` is called first, which must write it."""
    if not is_stored(name):
        make()
    return link(name)


def link_all(names: Sequence[str]) -> list[int]:
    """Link object files, which must be stored, into this process; return the addresses of their
    functions, in order.

    Files that are not linked yet are linked together: creating a linker takes 1 ms.

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
    """Return the symbols (as in `store`) and the content of an object file; None if it is missing
    or damaged. It is read once, then kept in memory until it is linked."""
    if name not in _seen:
        content = read_sealed(_path(name))
        if content is None:
            return None
        symbols, _, code = content.partition(b"\n")
        _seen[name] = json.loads(symbols), code
    return _seen[name]


def _link(objects: Sequence[tuple[list[str], bytes]]) -> tuple[list[int], binding.ExecutionEngine]:
    """Link object files, each given as (symbols as in `store`, content), into this process. Returns
    the address of the function of each, and LLVM's engine, which owns their code and must stay
    referenced.

    Raises RuntimeError if a symbol that they need is not defined in this process: LLVM would link
    them without an error.
    """
    binding.initialize_native_target()
    binding.initialize_native_asmprinter()
    target = binding.Target.from_default_triple().create_target_machine(jit=True)
    engine = binding.create_mcjit_compiler(binding.parse_assembly(""), target)
    needed = dict.fromkeys(name for symbols, _ in objects for name in symbols[1:])
    missing = [name for name in needed if not binding.address_of_symbol(name)]
    if missing:
        raise RuntimeError(
            f"machine code (llvmlite {llvmlite.__version__}) needs {', '.join(missing)}: not a "
            "symbol of this process, so it cannot be run; install another version of numba, which "
            "brings another llvmlite"
        )
    for _, code in objects:
        engine.add_object_file(binding.ObjectFileRef.from_data(code))
    engine.finalize_object()
    return [engine.get_function_address(symbols[0]) for symbols, _ in objects], engine
