"""Errors and warnings for users, and the texts they consist of: key, value and what is allowed."""

import difflib
import re
import sys
import warnings
from collections.abc import Callable, Iterable

Log = Callable[[str], None]  # receives one line of progress or result text


class InputError(ValueError):
    """A request that cannot be satisfied: the command line prints the message and ends. Any other
    ValueError is a bug."""


class SceneError(InputError):
    """Invalid campaign. ``problems`` has a line for each problem, ``file: key_path = value: what is
    allowed``; the message is all lines."""

    def __init__(self, problems: list[str]):
        self.problems = problems
        super().__init__("\n".join(problems))


class SceneWarning(UserWarning):
    """Warning about valid input that is probably a mistake."""


class RunWarning(UserWarning):
    """Warning with a note on a run, issued if the Python caller passes no function ``announce`` to
    receive notes."""


_PACKAGE = __name__.partition(".")[0]


def warn(text: str, kind: type[Warning]) -> None:
    """Issue a warning of a kind, at the line of the user's code that called this package."""
    level, frame = 1, sys._getframe()
    while frame.f_back and frame.f_globals.get("__name__", "").partition(".")[0] == _PACKAGE:
        level, frame = level + 1, frame.f_back
    warnings.warn(text, kind, stacklevel=level)


_MAX_LISTED = 24  # words that a message lists
_MAX_PROBLEMS = 100  # of a file: reading stops then


def no_log(_: str) -> None:
    """Discard a message: the `Log` of a caller that wants none."""


class TooManyProblems(Exception):
    """Raised by `Problems.add` to stop reading a file that has too many problems."""


class Problems(list[str]):
    """List of the problems that readers and checks of a campaign found, a line of text each."""

    def add(self, key_path: str, allowed: str, value: object = None) -> None:
        """Append the line ``key_path = value: allowed``, or ``key_path: allowed`` if there is no
        value. If the list has 100 problems already, append, in place of this one, a line that says
        so and raise TooManyProblems."""
        if len(self) == _MAX_PROBLEMS:
            self.append("there are more problems; only the first 100 are listed")
            raise TooManyProblems
        shown = "" if value is None else f" = {shorten(value)}"
        self.append(f"{key_path}{shown}: {allowed}")

    def raise_if_any(self, source: str) -> None:
        """Raise SceneError if there are problems; each line begins with ``source``, such as the
        name of the file."""
        if self:
            raise SceneError([f"{source}: {line}" for line in self])


def shorten(value: object, limit: int = 60) -> str:
    """Text of a value (its repr, but ``true`` and ``false`` as in TOML); a longer one is cut to
    ``limit`` characters, of which the last three are dots."""
    text = str(value).lower() if isinstance(value, bool) else repr(value)
    return text if len(text) <= limit else text[: limit - 3] + "..."


def printable(text: str, limit: int = 300) -> str:
    """Text of a file with control characters written as escape codes; a longer one is cut to
    ``limit`` characters, of which the last three are dots."""
    shown = "".join(c if c.isprintable() else repr(c)[1:-1] for c in text[: limit + 1])
    return shown if len(shown) <= limit else shown[: limit - 3] + "..."


# Names of joint kinds and distributions in other tools and textbooks.
_SYNONYMS = {
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


def nearest(word: str, known: Iterable[str]) -> str:
    """Suggest a known word for an unknown one.

    Parameters
    ----------
    word : str
    known : iterable of str

    Returns
    -------
    str
        "did you mean ...?" with a known word: the equivalent of a term of other tools, one that
        contains all parts of ``word``, or one of similar spelling. Without any, "known here: ..."
        with the known words ("nothing" if there are none); of more than 24, those that share a
        part with ``word``, or else the first ones.
    """
    known, parts = list(known), _parts(word)
    if _SYNONYMS.get(word.lower()) in known:
        return f"did you mean {_SYNONYMS[word.lower()]!r}?"
    whole = [each for each in known if each != word and set(parts) <= set(_parts(each))]
    if len(parts) > 1 and whole:
        return f"did you mean {min(whole, key=len)!r}?"
    match = difflib.get_close_matches(word, known, n=1, cutoff=0.6)
    if match and match[0] != word:
        return f"did you mean {match[0]!r}?"
    if len(known) <= _MAX_LISTED:
        return "known here: " + (", ".join(known) or "nothing")
    alike = [each for each in known if any(p in each.lower() for p in parts if len(p) > 2)]
    shown = (alike or known)[:_MAX_LISTED]
    return f"known here: {', '.join(shown)} and {len(known) - len(shown)} more"
