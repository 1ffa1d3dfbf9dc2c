"""A campaign file in TOML to a validated `CampaignFile`, and back to TOML text."""

import copy
import tomllib
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tomli_w

from sepmc.scene.checks import check_dispersion, check_scene, inertia_fault, inertia_tensor
from sepmc.scene.dispersion import Dispersion, resolve
from sepmc.scene.fields import fields_of
from sepmc.scene.messages import Problems, SceneError, SceneWarning, nearest
from sepmc.scene.model import Law, Reference, Scene
from sepmc.scene.parameters import replace
from sepmc.scene.tables import read_table
from sepmc.scene.units import split_unit

_OWN_TABLES = ("name", "title", "dispersion", "reference")


@dataclass(frozen=True)
class CampaignFile:
    """A campaign as read: the scene, what varies, what to compare with, and the TOML tree it came from."""

    name: str
    title: str
    scene: Scene
    dispersions: tuple[Dispersion, ...]
    reference: Reference | None
    tree: dict[str, Any]

    @property
    def toml(self) -> str:
        """The resolved campaign as TOML text."""
        return tomli_w.dumps(self.tree)


def shipped_campaigns() -> dict[str, Path]:
    """Campaign files that come with sepmc, by file name."""
    package = Path(__file__).resolve().parent.parent
    for folder in (package / "campaigns", package.parent / "campaigns"):
        if folder.is_dir():
            return {path.name: path for path in sorted(folder.glob("*.toml"))}
    return {}


def find_file(file: str | Path) -> Path:
    """The path of a campaign: a file, a run folder's ``campaign.toml``, or the bare name of a shipped campaign."""
    path = Path(file)
    if path.is_dir() and (path / "campaign.toml").is_file():
        return path / "campaign.toml"
    if path.is_file():
        return path
    shipped = shipped_campaigns()
    for name in (path.name, path.name + ".toml"):
        if len(path.parts) == 1 and name in shipped:
            return shipped[name]
    hint = nearest(path.name, shipped) if len(path.parts) == 1 else "shipped campaigns: " + ", ".join(shipped)
    raise SceneError([f"{file}: no such file, nor a shipped campaign; {hint}"])


def read_campaign(file: str | Path, settings: dict[str, Any] | None = None) -> CampaignFile:
    """Read and validate a campaign.

    Parameters
    ----------
    file : path, run folder, or name of a shipped campaign
    settings : dict, optional
        Values to put in place first, by TOML path: ``{"body.upper.mass_kg": 460.0}``.

    Raises
    ------
    SceneError
        With every problem found, each as ``file: place = value: what is allowed``.
    """
    path = find_file(file)
    try:
        tree = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise SceneError([f"{path}: is not TOML: {error}"]) from None
    except OSError as error:
        raise SceneError([f"{path}: cannot be read: {error.strerror}"]) from None
    return parse_campaign(tree, str(path.name), settings, default_name=path.stem)


def parse_campaign(
    tree: dict[str, Any], source: str, settings: dict[str, Any] | None = None, default_name: str = "campaign"
) -> CampaignFile:
    """Validate a TOML tree; see `read_campaign`."""
    problems = Problems()
    tree = copy.deepcopy(tree)
    for key, value in (settings or {}).items():
        _put(tree, key.split(".") if not key.startswith("dispersion.") else ["dispersion", key[11:]], value, problems, key)
    name = tree.get("name", default_name)
    for key in ("name", "title"):
        if not isinstance(tree.get(key, ""), str):
            problems.add(key, "must be text", tree[key])
    known = [*_OWN_TABLES, *(k for field in fields_of(Scene).values() for k in field.keys)]
    for key in tree:
        if key not in known:
            problems.add(key, "unknown key; " + nearest(key, known))
    scene = read_table(Scene, {k: v for k, v in tree.items() if k not in _OWN_TABLES and k in known}, "", problems)
    laws = _read_laws(tree.get("dispersion", {}), problems)
    reference = read_table(Reference, tree["reference"], "reference", problems) if "reference" in tree else None
    problems.raise_if_any(source)
    check_scene(scene, problems)
    dispersions = resolve(scene, laws, problems)
    for dispersion in dispersions:
        check_dispersion(dispersion, problems)
    problems.raise_if_any(source)
    _warn_inertia_range(scene, dispersions, source)
    return CampaignFile(str(name), tree.get("title", ""), scene, dispersions, reference, tree)


def _read_laws(tree: Any, problems: Problems) -> dict[str, Law]:
    if not isinstance(tree, dict):
        problems.add("dispersion", "must be a table", tree)
        return {}
    laws = {}
    for key, law in tree.items():
        if isinstance(law, dict) and law and all(isinstance(v, dict) for v in law.values()):
            problems.add(f"dispersion.{key}", 'put the path in quotes: "body.upper.mass_kg" = { uniform = 20.0 }')
            continue
        read = read_table(Law, law, f"dispersion.{key}", problems)
        if read is not None:
            laws[key] = read
    return laws


def _warn_inertia_range(scene: Scene, dispersions: tuple[Dispersion, ...], source: str) -> None:
    """Warn if independent ranges of a body's inertias can reach a tensor that no solid body has."""
    by_path = {d.parameter.path: d for d in dispersions}
    for name in scene.body:
        axes = [by_path.get(f"body.{name}.inertia.{axis}") for axis in ("xx", "yy", "zz")]
        for heavy in range(3):
            corner = {}
            for axis, dispersion in enumerate(axes):
                if dispersion is not None:
                    bound = dispersion.support[1 if axis == heavy else 0] * dispersion.parameter.factor
                    corner[dispersion.parameter.path] = bound
            fault = inertia_fault(inertia_tensor(replace(scene, corner).body[name])) if corner else None
            if fault:
                warnings.warn(f"{source}: dispersion of body.{name}.inertia can give a case that {fault}", SceneWarning, stacklevel=4)
                break


def _put(node: Any, parts: list[str], value: Any, problems: Problems, key: str) -> None:
    """Put a value at a TOML path, replacing the same parameter if it was given in another unit."""
    head, rest = parts[0], parts[1:]
    if isinstance(node, list):
        match = [item for item in node if isinstance(item, dict) and item.get("name") == head]
        names = [item.get("name") for item in node if isinstance(item, dict)]
        if match and rest:
            _put(match[0], rest, value, problems, key)
        elif not match and not rest and head in _COMPONENTS and all(isinstance(x, int | float) for x in node):
            place = _COMPONENTS[head] if len(node) == 3 else "yz".find(head)
            node[place] = value
        else:
            problems.add(key, f"no {head!r} here; {nearest(head, [n for n in names if n])}")
        return
    if not isinstance(node, dict):
        problems.add(key, "the path ends before " + repr(head))
        return
    if rest:
        _put(node.setdefault(head, {}), rest, value, problems, key)
        return
    for other in list(node):
        if other != head and split_unit(other)[0] == split_unit(head)[0] and split_unit(other)[1] and split_unit(head)[1]:
            del node[other]
    node[head] = value


_COMPONENTS = {"x": 0, "y": 1, "z": 2, "xx": 0, "yy": 1, "zz": 2, "xy": 0, "xz": 1, "yz": 2}


def parse_setting(text: str) -> tuple[str, Any]:
    """``path=value`` of the command line; the value is TOML, or text if it is not."""
    key, separator, raw = text.partition("=")
    if not separator or not key.strip():
        raise SceneError([f"--set {text}: must read path=value, such as body.upper.mass_kg=460"])
    try:
        value = tomllib.loads(f"value = {raw.strip()}")["value"]
    except tomllib.TOMLDecodeError:
        value = raw.strip()
    return key.strip().replace('"', ""), value
