"""Texts of written kernels, kept in the cache folder: to write one takes as long as to fly ten
thousand cases with it."""

import hashlib
import pickle

from sepmc.engine.host_process import loading
from sepmc.kernel.spec.kernel_spec import KernelSpec
from sepmc.routines.layout import NO_HISTORY

# beside what is compiled: where a change asks for a new text
_WRITERS = ("kernel/**/*.py", "schema.py")


def written(shape: KernelSpec, method_name: str, history: int = NO_HISTORY) -> str:
    """The text of a kernel, as `sepmc.kernel.emit.module.emit` writes it, once."""
    # imported here: numba
    from sepmc.engine.cache_files import put_sealed, read_sealed  # noqa: PLC0415
    from sepmc.jit import CACHE_FOLDER, digest_of  # noqa: PLC0415

    shaped = shape.layout, shape.names, sorted(shape.dispersed), shape.variant
    asked = pickle.dumps((*shaped, method_name, history))
    digest = hashlib.sha256(asked + digest_of(_WRITERS)).hexdigest()[:32]
    path = CACHE_FOLDER / f"text_{digest}.sealed"
    kept = read_sealed(path)
    if kept is not None:
        return kept.decode()
    with loading:  # what is written, and the formulas that are imported for it
        from sepmc.kernel.emit.module import emit  # noqa: PLC0415

        text = emit(shape, method_name, history)
    put_sealed(path, text.encode())
    return text
