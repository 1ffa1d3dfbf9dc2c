"""Checks of the files that a campaign file names, which must lie in its folder or in a folder below
it; and paths of files in settings."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Protocol

from sepmc.scene.messages import Problems, SceneError, shorten
from sepmc.wording import setting


class FileReader(Protocol):
    """Type of a function that replaces, in the TOML tree of a campaign, each key ``file`` by the
    keys that it reads from that file."""

    def __call__(self, tree: dict[str, Any], folder: Path, problems: Problems) -> list[str]:
        """Replace each key ``file`` in ``tree``, in place, by keys with the contents of that file;
        relative paths begin at ``folder``. Adds problems, and returns sentences on what was
        read."""


def check_paths(tree: dict[str, Any], path: Path) -> None:
    """Check that a campaign file, which may be untrusted, names no file outside its folder.

    Parameters
    ----------
    tree : dict
        TOML tree of the campaign file.
    path : Path
        Path of that file.

    Raises
    ------
    SceneError
        If a key ``file`` or ``run.samples`` names a file outside the folder.
    """
    folder = path.parent.resolve()
    for key_path, file in _paths(tree):
        try:
            is_beside = (folder / file).resolve().is_relative_to(folder)
        except (OSError, ValueError, RuntimeError):  # a loop of links, no valid file name
            is_beside = False
        if not is_beside:
            reason = "must lie beside the campaign, or in a folder there"
            any_other = f"{setting(key_path, 'PATH')} takes any path"
            raise SceneError([f"{path.name}: {key_path} = {shorten(file)}: {reason}; {any_other}"])


def _paths(tree: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield the TOML path and the value of each key that names a file: ``file`` in any table below
    ``tree``, and ``run.samples``. A value that is no printable text is left out."""
    stack: list[tuple[str, Any]] = [("", tree)]
    while stack:
        parent, node = stack.pop()
        if isinstance(node, list):
            names = (
                item.get("name", k) if isinstance(item, dict) else k for k, item in enumerate(node)
            )
            stack += [(f"{parent}.{name}", item) for name, item in zip(names, node, strict=True)]
        elif isinstance(node, dict):
            for key, value in node.items():
                key_path = f"{parent}.{key}".lstrip(".")
                if _names_file(key_path) and isinstance(value, str) and value.isprintable():
                    yield key_path, value
                else:
                    stack.append((key_path, value))


def _names_file(key_path: str) -> bool:
    """True if the value at a TOML path is the path of a file: its last key is ``file``, or it is
    ``run.samples``."""
    return key_path.rpartition(".")[2] == "file" or key_path == "run.samples"


def locate(settings: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Make paths of files in settings absolute where the file exists relative to the working folder
    but not relative to the folder of the campaign.

    Parameters
    ----------
    settings : dict
        Values by TOML path; keys ``file`` in them, at any depth, and ``run.samples`` name files.
    folder : Path
        Folder of the campaign file.

    Returns
    -------
    dict
        A copy of the settings in which all other values are unchanged.
    """

    def located(key_path: str, value: Any) -> Any:
        if isinstance(value, dict):
            return {name: located(f"{key_path}.{name}", item) for name, item in value.items()}
        if isinstance(value, list):
            return [located(key_path, item) for item in value]
        if not (_names_file(key_path) and isinstance(value, str) and value.isprintable()):
            return value
        try:
            is_here = not (folder / value).exists() and Path(value).is_file()
        except (OSError, ValueError):
            return value
        return str(Path(value).absolute()) if is_here else value

    return {key: located(str(key), value) for key, value in settings.items()}
