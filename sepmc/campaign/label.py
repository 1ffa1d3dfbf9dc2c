"""Titles of runs and cases for figures: campaign, cases, seed, sampler and settings."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from sepmc.wording import count_cases

_MAX_SETTINGS = 4  # settings shown; beyond, their number
_MAX_LENGTH = 48  # characters of a value
_DEFAULT_SAMPLER = "random"  # sampler
_IN_TITLE = ("run.cases", "run.seed", "run.sampler")  # settings that titles name already


def of_run(manifest: Mapping[str, Any]) -> str:
    """Return the title of a run from its manifest: campaign, number of cases, seed and, unless it
    is random, sampler. A second line has other settings, if any (`of_settings`)."""
    text = f"{manifest['campaign']}, {count_cases(manifest['cases'], ',')}, seed {manifest['seed']}"
    sampler = manifest.get("sampler", _DEFAULT_SAMPLER)
    if sampler != _DEFAULT_SAMPLER:
        text += f", sampler {sampler}"
    return text + of_settings(manifest.get("settings", {}))


def of_case(campaign: str, number: int | None, settings: Mapping[str, str]) -> str:
    """Return the title of one case, or of the nominal case if ``number`` is None; a second line has
    the ``settings`` (texts by TOML path), if any, but not all (`of_settings`)."""
    which = "nominal case" if number is None else f"case {number}"
    return f"{campaign}, {which}{of_settings(settings)}"


def of_settings(settings: Mapping[str, str]) -> str:
    """Return a line break and a line "set: PATH = TEXT, ..." with the settings (texts by TOML path)
    that titles do not show already: all but ``run.cases``, ``run.seed`` and ``run.sampler``. Of
    many settings it has the first `_MAX_SETTINGS` and the number of the others. Empty if there are
    none."""
    texts = [f"{path} = {text}" for path, text in settings.items() if path not in _IN_TITLE]
    n_more = len(texts) - _MAX_SETTINGS
    if n_more > 0:
        texts = [*texts[:_MAX_SETTINGS], f"and {n_more} more"]
    return "\nset: " + ", ".join(texts) if texts else ""


def as_text(settings: Mapping[str, Any]) -> dict[str, str]:
    """Return the values of settings as text for titles, by TOML path, cut to 48 characters. Of a
    sample table (``run.samples``) only the file name is shown."""
    shown = {}
    for path, value in settings.items():
        text = Path(value).name if path == "run.samples" else str(value)
        shown[path] = text if len(text) <= _MAX_LENGTH else text[: _MAX_LENGTH - 3] + "..."
    return shown
