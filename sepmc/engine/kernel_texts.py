"""Texts of kernels (their Python source), cached in memory and in the cache folder: writing one
takes as long as integrating ten thousand cases.

A text depends on the structure of a scene, not on its values, which a kernel reads from the
parameter vector of a case. The code that writes a kernel may only compare a value with another one
or with 0, 1, -1 or infinity (a motor without build-up, a spring without end). Scenes whose values
compare alike share one text.
"""

import hashlib
import math
from collections.abc import Iterator
from dataclasses import fields
from functools import cache
from typing import Any

import msgspec
import numpy as np

from sepmc.engine.host_process import loading
from sepmc.kernel.spec.kernel_spec import KernelSpec
from sepmc.recent_items import RecentItems
from sepmc.routines.layout import NO_HISTORY

# sources of the texts, in addition to the compiled ones: a change asks for new texts
_WRITERS = ("kernel/**/*.py", "schema.py", "scene/formula.py", "scene/signals.py")
_COMPARED = (-1.0, 0.0, 1.0, math.inf)  # constants that values are compared with
_texts: RecentItems[str, str] = RecentItems(64)  # by digest


def written(spec: KernelSpec, method_name: str, history: int = NO_HISTORY) -> str:
    """Return the text of a kernel: from memory, from the cache folder, or newly written by
    `sepmc.kernel.emit.module.emit` and then stored in both.

    Parameters
    ----------
    spec : KernelSpec
        Structure of the kernel.
    method_name : str
        Name of the integration method.
    history : int
        NO_HISTORY, SEPARATION_HISTORY or FULL_HISTORY (`sepmc.routines.layout`): the rows over time
        that the kernel writes.

    Returns
    -------
    str
        Python source.
    """
    key = structure_of(spec) + f"{method_name} {history}".encode()
    digest = hashlib.sha256(key + _writers_digest()).hexdigest()[:32]
    text = _texts.get(digest)
    if text is None:
        text = _stored_or_emitted(digest, spec, method_name, history)
        _texts.put(digest, text)
    return text


def _stored_or_emitted(digest: str, spec: KernelSpec, method_name: str, history: int) -> str:
    """Return the text of a kernel from the cache folder, where ``digest`` names it; if it is
    missing there, write it (other arguments as in `written`) and store it."""
    # imported here: llvmlite
    from sepmc.code_cache import CACHE_FOLDER  # noqa: PLC0415
    from sepmc.engine.cache_files import put_sealed, read_sealed  # noqa: PLC0415

    path = CACHE_FOLDER / f"text_{digest}.sealed"
    stored = read_sealed(path)
    if stored is not None:
        return stored.decode()
    with loading:  # emitting imports formulas
        from sepmc.kernel.emit.module import emit  # noqa: PLC0415

        text = emit(spec, method_name, history)
    put_sealed(path, text.encode())
    return text


@cache
def _writers_digest() -> bytes:
    from sepmc.code_cache import digest_of  # noqa: PLC0415  (llvmlite)

    return digest_of(_WRITERS)


def structure_of(spec: KernelSpec) -> bytes:
    """Return the structure of a kernel as bytes: all that its text depends on, besides the
    integration method and the kind of history.

    Each value of the scene is replaced by its rank among all values and the constants 0, 1, -1 and
    infinity. In the tables only whole numbers are kept, since they may be counts.

    Parameters
    ----------
    spec : KernelSpec

    Returns
    -------
    bytes
        Key of the text, to be hashed: kernels with equal structures have the same text.
    """
    tree, layout = msgspec.to_builtins(spec.scene), spec.layout
    values = sorted({*_values(tree), *_COMPARED})
    ranks = {value: rank for rank, value in enumerate(values)}
    numbers = layout.model.numbers
    counts = np.where(numbers == np.rint(numbers), numbers, np.nan)
    derived = {f.name: getattr(spec, f.name) for f in fields(spec)}
    # formulas have the names of the file, and factors of units are written into the text
    names = (spec.names.of, spec.scene.driven) if spec.scene.signal else None
    derived |= {"dispersed": sorted(spec.dispersed), "layout": None, "names": names}
    parts = (
        _ranked(tree, ranks),
        [ranks[value] for value in _COMPARED],
        derived,
        (layout.slots, layout.bodies, layout.joints, layout.phases, layout.outlines),
        (layout.contents, layout.model.scene.tolist(), layout.model.table.tolist()),
    )
    return repr(parts).encode() + counts.tobytes()


def _values(node: Any) -> Iterator[float]:
    """Yield all floats in nested dicts and lists, except NaN."""
    if isinstance(node, float) and not math.isnan(node):
        yield node
    elif isinstance(node, dict | list | tuple):
        for item in node.values() if isinstance(node, dict) else node:
            yield from _values(item)


def _ranked(node: Any, ranks: dict[float, int]) -> Any:
    """Return a copy of nested dicts and lists with each float replaced by its rank, from ``ranks``,
    or by -1 if it is not among these, as NaN never is."""
    if isinstance(node, float):
        return ranks.get(node, -1)  # -1: NaN
    if isinstance(node, dict):
        return {key: _ranked(item, ranks) for key, item in node.items()}
    return [_ranked(item, ranks) for item in node] if isinstance(node, list | tuple) else node
