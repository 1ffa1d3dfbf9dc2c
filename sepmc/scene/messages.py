"""Errors and warnings that speak to an engineer: where, what was given, what is allowed."""

import difflib
import re
import sys
import warnings
from collections.abc import Callable

Log = Callable[[str], None]  # receives one line of progress or result text


class InputError(ValueError):
    """What was asked for cannot be done as asked. The program says so and ends; any other
    ValueError is a fault of its own."""


class SceneError(InputError):
    """Bad input. One line per problem: ``file: place = value: what is allowed``."""

    def __init__(self, problems: list[str]):
        self.problems = problems
        super().__init__("\n".join(problems))


class SceneWarning(UserWarning):
    """Input that can be flown but deserves a look."""


class RunWarning(UserWarning):
    """A note on a run that deserves a look, for who flies it from Python and listens to nothing."""


_PACKAGE = __name__.partition(".")[0]


def warn(text: str, kind: type[Warning]) -> None:
    """Give a warning that points at the line of the user which led to it: the innermost one outside
    this package."""
    level, frame = 1, sys._getframe()
    while frame.f_back and frame.f_globals.get("__name__", "").partition(".")[0] == _PACKAGE:
        level, frame = level + 1, frame.f_back
    warnings.warn(text, kind, stacklevel=level)


_LISTED = 24  # words that a message lists
_TOLD = 100  # problems of a file: it is read no further then


def nobody(_: str) -> None:
    """Listens to what is announced, and tells no one."""


class TooManyProblems(Exception):
    """A file has so many problems that no more of them are looked for."""


class Problems(list[str]):
    """Collects problems while a file is read."""

    def add(self, place: str, allowed: str, value: object = None) -> None:
        """Note a problem: ``place = value: allowed``, or ``place: allowed`` without a value. Raises
        TooManyProblems if there are a hundred."""
        if len(self) == _TOLD:
            self.append("there are more problems than these")
            raise TooManyProblems
        shown = "" if value is None else f" = {shorten(value)}"
        self.append(f"{place}{shown}: {allowed}")

    def raise_if_any(self, source: str) -> None:
        """Raise SceneError with all problems, each after the name of the source, if there are
        any."""
        if self:
            raise SceneError([f"{source}: {line}" for line in self])


def shorten(value: object, limit: int = 60) -> str:
    """A value as text, cut to ``limit`` characters."""
    text = str(value).lower() if isinstance(value, bool) else repr(value)
    return text if len(text) <= limit else text[: limit - 3] + "..."


def printable(text: str, limit: int = 300) -> str:
    """A text of a file as a screen can show it: what controls one is written as its code."""
    shown = "".join(c if c.isprintable() else repr(c)[1:-1] for c in text[: limit + 1])
    return shown if len(shown) <= limit else shown[: limit - 3] + "..."


# What other tools and textbooks call joint kinds and laws.
_ELSEWHERE = {
    "hinge": "revolute",
    "pin": "revolute",
    "prismatic": "slider",
    "translational": "slider",
    "sliding": "slider",
    "ball": "spherical",
    "socket": "spherical",
    "weld": "fixed",
    "rigid": "fixed",
    "locked": "fixed",
    "cardan": "universal",
    "hooke": "universal",
    "inline": "point-on-line",
    "inplane": "point-on-plane",
    "gaussian": "normal",
    "gauss": "normal",
    "triangle": "triangular",
    "rectangular": "uniform",
    "choice": "discrete",
}


def _parts(name: str) -> list[str]:
    return [part for part in re.split(r"[^a-z0-9]+", name.lower()) if part]


def nearest(word: str, known) -> str:
    """A phrase that names the nearest known word or, if none is near, all of them; of many those
    that have a part of the word, or else the first. Near is what another tool's word means, what
    has all parts of the word in another order, or what is spelled alike."""
    known, parts = list(known), _parts(word)
    if _ELSEWHERE.get(word.lower()) in known:
        return f"did you mean {_ELSEWHERE[word.lower()]!r}?"
    whole = [each for each in known if each != word and set(parts) <= set(_parts(each))]
    if len(parts) > 1 and whole:
        return f"did you mean {min(whole, key=len)!r}?"
    match = difflib.get_close_matches(word, known, n=1, cutoff=0.6)
    if match and match[0] != word:
        return f"did you mean {match[0]!r}?"
    if len(known) <= _LISTED:
        return "known here: " + (", ".join(known) or "nothing")
    alike = [each for each in known if any(p in each.lower() for p in parts if len(p) > 2)]
    shown = (alike or known)[:_LISTED]
    return f"known here: {', '.join(shown)} and {len(known) - len(shown)} more"
