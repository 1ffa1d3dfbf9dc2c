"""Output folder of a benchmark."""

from pathlib import Path

from sepmc.campaign.store.folders import StoreError, make_writable

SUMMARY = "bench.json"


def open_folder(folder: Path, overwrite: bool = False) -> Path:
    """Prepare a folder for a benchmark, and return it: create it if needed, and delete
    ``bench.json`` and all Parquet and PNG files in it.

    Raises
    ------
    StoreError
        If it is a file, contains files but no ``bench.json``, contains a benchmark and
        ``overwrite`` is False, or is not writable.
    """
    if folder.exists() and not folder.is_dir():
        raise StoreError(f"{folder}: is a file; --out must be a folder")
    if folder.is_dir() and any(folder.iterdir()):
        if not (folder / SUMMARY).is_file():
            raise StoreError(
                f"{folder}: contains other files and no {SUMMARY}, so it is not the folder of a "
                "benchmark; choose another --out"
            )
        if not overwrite:
            raise StoreError(
                f"{folder}: contains a benchmark; add --overwrite to replace it, or choose "
                "another --out"
            )
    make_writable(folder)
    for old in [folder / SUMMARY, *folder.glob("*.parquet"), *folder.glob("*.png")]:
        old.unlink(missing_ok=True)
    return folder
