"""Campaign files by name: paths of files, of run folders, and names of those shipped with sepmc."""

from pathlib import Path

from sepmc.paths import PathError, as_path
from sepmc.scene.messages import SceneError, nearest, shorten


def shipped_campaigns() -> dict[str, Path]:
    """Paths of the campaign files shipped with sepmc, by file name (``table1.toml``); empty if
    their folder is missing."""
    package = Path(__file__).resolve().parent.parent
    for folder in (package / "campaigns", package.parent / "campaigns"):
        if folder.is_dir():
            return {path.name: path for path in sorted(folder.glob("*.toml"))}
    return {}


def find_file(file: str | Path) -> Path:
    """Path of the campaign file that ``file`` means: that file, the ``campaign.toml`` of that run
    folder, or the shipped campaign of that name, with or without ``.toml``. Raises SceneError if
    there is none, or ``file`` is no name or path."""
    if isinstance(file, dict):
        reason = (
            "must be the name of a file or run folder, not a dict; to change values of a file, "
            "give them as settings"
        )
        raise SceneError([f"campaign = {shorten(file)}: {reason}"])
    try:
        path = as_path(file)
    except PathError as error:
        raise SceneError([str(error)]) from None
    try:
        if path.is_dir() and (path / "campaign.toml").is_file():
            return path / "campaign.toml"
        if path.is_file():
            return path
    except (OSError, ValueError):  # no valid file name
        raise SceneError([f"{shorten(str(file))}: no such file, nor a shipped campaign"]) from None
    shipped = shipped_campaigns()
    for name in (path.name, path.name + ".toml"):
        if len(path.parts) == 1 and name in shipped:
            return shipped[name]
    if file and path.is_dir():
        raise SceneError(
            [f"{file}: is a folder, and not that of a run; give a file, or a run folder"]
        )
    hint = "shipped campaigns: " + ", ".join(shipped)
    if len(path.parts) == 1:  # without the suffix, in which all names agree
        hint = nearest(path.stem, [Path(name).stem for name in shipped])
    raise SceneError([f"{file}: no such file, nor a shipped campaign; {hint}"])
