"""Store of selected integration steps, in memory and in the cache folder.

Steps follow from the scene, its dispersions, the kernel, the code, the number of calibration cases
and whether histories are stored, not from the seed or the number of cases: they are selected once.
"""

import contextlib
import hashlib
import itertools
import pickle
from functools import cache
from pathlib import Path

from sepmc.campaign.definition import Definition
from sepmc.campaign.execution.calibration_cases import CalibrationSize
from sepmc.campaign.execution.integration import Integration
from sepmc.recent_items import RecentItems

# sources that steps follow from, in addition to the compiled ones
_SOURCES = ("analysis/*.py", "campaign/**/*.py", "kernel/**/*.py", "scene/*.py", "schema.py")
_MAX_FILES, _PRUNE_EVERY = 1000, 100  # some 15 kB each
_count = itertools.count(1)  # files that this process stored
_in_memory: RecentItems[str, Integration] = RecentItems(32)


def key_of(campaign: Definition, history: bool, size: CalibrationSize) -> str:
    """Key of the steps of a campaign: a digest of all that they follow from. It is also part of the
    name of their file in the cache folder.

    Parameters
    ----------
    campaign : Definition
    history : bool
        True if histories are stored.
    size : CalibrationSize
        Number of calibration cases.

    Returns
    -------
    str
        32 hexadecimal digits.
    """
    text = campaign.ordered_text + repr((history, tuple(size))).encode()
    return hashlib.sha256(text + _sources_digest()).hexdigest()[:32]


@cache
def _sources_digest() -> bytes:
    from sepmc.code_cache import digest_of  # noqa: PLC0415  (llvmlite)

    return digest_of(_SOURCES)


def in_memory(key: str) -> Integration | None:
    """Integration with a key (`key_of`) that was selected or loaded earlier in this process, with
    its kernels; None if there is none, or it is no longer among those used last."""
    return _in_memory.get(key)


def stored(key: str) -> Integration | None:
    """Integration with a key (`key_of`) from its file in the cache folder, without kernels
    (`Integration.packed`); None if the file is missing or damaged."""
    from sepmc.code_cache import CACHE_FOLDER  # noqa: PLC0415
    from sepmc.engine.cache_files import read_sealed  # noqa: PLC0415  (llvmlite)

    content = read_sealed(CACHE_FOLDER / f"steps_{key}.sealed")
    # the folder holds machine code of this user alone; a file has a checksum
    integration: Integration | None = None if content is None else pickle.loads(content)
    return integration


def remember(key: str, integration: Integration) -> None:
    """Store an integration in memory under a key (`key_of`), for `in_memory`; only the 32 that were
    used last are kept."""
    _in_memory.put(key, integration)


def forget() -> None:
    """Remove all integrations from memory; files in the cache folder stay."""
    _in_memory.clear()


def store(key: str, integration: Integration) -> None:
    """Store an integration under a key (`key_of`) in memory and, without its kernels, in the cache
    folder; old files there are removed at times."""
    from sepmc.code_cache import CACHE_FOLDER  # noqa: PLC0415
    from sepmc.engine.cache_files import put_sealed  # noqa: PLC0415  (llvmlite)

    remember(key, integration)
    put_sealed(CACHE_FOLDER / f"steps_{key}.sealed", pickle.dumps(integration.packed))
    if next(_count) % _PRUNE_EVERY == 0:
        _prune(CACHE_FOLDER)


def _prune(folder: Path) -> None:
    """Remove all files of steps from the cache folder but the newest thousand."""
    with contextlib.suppress(OSError):  # another process may remove them, too
        files = sorted(folder.glob("steps_*.sealed"), key=lambda path: path.stat().st_mtime)
        for path in files[:-_MAX_FILES]:
            path.unlink(missing_ok=True)
