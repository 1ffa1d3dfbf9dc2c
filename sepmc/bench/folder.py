"""The folder of a bench."""

from pathlib import Path

from sepmc.campaign.store.folders import StoreError, make_writable

SUMMARY = "bench.json"


def open_folder(folder: Path, overwrite: bool = False) -> Path:
    """Make a folder ready to be written; only what a bench has made in it is replaced, and only if
    so asked.

    Raises
    ------
    StoreError
        If it holds something else, or a bench and ``overwrite`` is not given, or cannot be written.
    """
    if folder.exists() and not folder.is_dir():
        raise StoreError(f"{folder}: is a file; give --out a folder")
    if folder.is_dir() and any(folder.iterdir()):
        if not (folder / SUMMARY).is_file():
            raise StoreError(
                f"{folder}: holds other files and no {SUMMARY}, so it is not a bench; choose "
                "another --out"
            )
        if not overwrite:
            raise StoreError(
                f"{folder}: holds a bench; add --overwrite to replace it, or choose another --out"
            )
    make_writable(folder)
    for old in [folder / SUMMARY, *folder.glob("*.parquet"), *folder.glob("*.png")]:
        old.unlink(missing_ok=True)
    return folder
