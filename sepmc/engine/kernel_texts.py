"""Texts of written kernels, stored in the cache folder: writing one takes as long as integrating
ten thousand cases."""

import hashlib
import pickle

from sepmc.engine.host_process import loading
from sepmc.kernel.spec.kernel_spec import KernelSpec
from sepmc.routines.layout import NO_HISTORY

# sources of the texts, in addition to the compiled ones: a change asks for new texts
_WRITERS = ("kernel/**/*.py", "schema.py")


def written(spec: KernelSpec, method_name: str, history: int = NO_HISTORY) -> str:
    """Text of a kernel (`sepmc.kernel.emit.module.emit`), loaded from the cache folder or written.

    Parameters
    ----------
    spec : KernelSpec
        Structure of the kernel.
    method_name : str
        Integration method.
    history : int
        NO_HISTORY, SEPARATION_HISTORY or FULL_HISTORY.

    Returns
    -------
    str
        Python source.
    """
    # imported here: numba
    from sepmc.engine.cache_files import put_sealed, read_sealed  # noqa: PLC0415
    from sepmc.jit import CACHE_FOLDER, digest_of  # noqa: PLC0415

    structure = spec.layout, spec.names, sorted(spec.dispersed), spec.variant
    key = pickle.dumps((*structure, method_name, history))
    digest = hashlib.sha256(key + digest_of(_WRITERS)).hexdigest()[:32]
    path = CACHE_FOLDER / f"text_{digest}.sealed"
    stored = read_sealed(path)
    if stored is not None:
        return stored.decode()
    with loading:  # emitting imports formulas
        from sepmc.kernel.emit.module import emit  # noqa: PLC0415

        text = emit(spec, method_name, history)
    put_sealed(path, text.encode())
    return text
