"""What a run is called in titles: its campaign, its cases, and what was set otherwise than in its
file, so that figures of two runs tell which is which."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

_TOLD = 4  # values that were set; of more, the number
_LONG = 48  # characters of a value
_USUAL = "random"  # sampler
_APART = ("run.cases", "run.seed", "run.sampler")  # a title says these by themselves


def of_run(manifest: Mapping[str, Any]) -> str:
    """A line on campaign, cases, seed and, if it is not the default one, sampler, and a second one
    on what was set, of the manifest of a run."""
    said = f"{manifest['campaign']}, {manifest['cases']:,} cases, seed {manifest['seed']}"
    sampler = manifest.get("sampler", _USUAL)
    if sampler != _USUAL:
        said += f", sampler {sampler}"
    return said + of_settings(manifest.get("settings", {}))


def of_case(campaign: str, number: int | None, settings: Mapping[str, str]) -> str:
    """The same of one case, or of the nominal one."""
    which = "nominal case" if number is None else f"case {number}"
    return f"{campaign}, {which}{of_settings(settings)}"


def of_settings(settings: Mapping[str, str]) -> str:
    """A line, with its break before it, on values that were set, by TOML path; none if there are
    none."""
    told = [f"{path} = {text}" for path, text in settings.items() if path not in _APART]
    left = len(told) - _TOLD
    if left > 0:
        told = [*told[:_TOLD], f"and {left} more"]
    return "\nset: " + ", ".join(told) if told else ""


def as_text(settings: Mapping[str, Any]) -> dict[str, str]:
    """Values that were set as a title shows them: of files their names, of the rest no more than
    fits."""
    shown = {}
    for path, value in settings.items():
        text = Path(value).name if path == "run.samples" else str(value)
        shown[path] = text if len(text) <= _LONG else text[: _LONG - 3] + "..."
    return shown
