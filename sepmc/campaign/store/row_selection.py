"""Which rows a run keeps that counts its cases and lets them go: rules, columns, precision."""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from typing import Any

import numpy as np

from sepmc.analysis.requirements import margins, violating
from sepmc.scene.messages import InputError, nearest
from sepmc.scene.model import Requirement
from sepmc.schema import Column, Status

ALL, FAILED, VIOLATING, WORST, EVERY = "all", "failed", "violating", "worst", "every"
WHY = Column("kept_as", "", "rules by which the row is kept")
_RULE = re.compile(r"(all|failed|violating)|(worst|every):([1-9][0-9]{0,8})")
_HEAD = ("case", "status", WHY.name)


@dataclass(frozen=True)
class KeepRules:
    """Rules by which rows are kept: ``all``, those that ``failed``, are ``violating`` a
    requirement, the ``worst`` so many of each requirement, ``every`` so manyth case; of these rows
    columns with names that match ``patterns``, and numbers in ``single`` precision."""

    rules: tuple[str, ...]
    worst: int = 0
    every: int = 0
    patterns: tuple[str, ...] = ()
    single: bool = False

    @property
    def text(self) -> str:
        """As a manifest has it."""
        counts = {WORST: f":{self.worst}", EVERY: f":{self.every}"}
        said = ",".join(rule + counts.get(rule, "") for rule in self.rules)
        said += f"; columns {','.join(self.patterns)}" if self.patterns else ""
        return said + ("; float32" if self.single else "")

    @classmethod
    def of_text(cls, text: str) -> "KeepRules":
        """That of which a manifest has the `text`. Raises InputError if it is none."""
        rules, *more = text.split("; ")
        columns = [one.removeprefix("columns ") for one in more if one.startswith("columns ")]
        return _read(rules, tuple(columns[0].split(",")) if columns else (), "float32" in more)

    def columns(self, known: Sequence[Column]) -> list[Column]:
        """Of the columns of a case table those that are kept."""
        return [
            column
            for column in known
            if column.name in _HEAD
            or not self.patterns
            or any(fnmatchcase(column.name, pattern) for pattern in self.patterns)
        ]


def read_keep(
    rules: str,
    patterns: str | None,
    single: bool,
    requirements: Sequence[Requirement],
    columns: Sequence[Column],
) -> KeepRules:
    """Rules as the command line takes them, ``failed,worst:20``, and patterns of the names of
    columns. Raises InputError with what is allowed."""
    chosen = tuple(one.strip() for one in patterns.split(",")) if patterns else ()
    keep = _read(rules, chosen, single)
    if not _bounded(requirements) and WORST in keep.rules:
        raise InputError("keep = worst: of what the file requires with a bound, which is nothing")
    if VIOLATING in keep.rules and not requirements:
        raise InputError("keep = violating: of what the file requires, which is nothing")
    names = [column.name for column in columns]
    for pattern in chosen:
        if not any(fnmatchcase(name, pattern) for name in names):
            raise InputError(f"keep columns = {pattern}: no such column; {nearest(pattern, names)}")
    return keep


def _read(rules: str, patterns: tuple[str, ...], single: bool) -> KeepRules:
    """Rules as text."""
    counts, named = {WORST: 0, EVERY: 0}, []
    for text in (one.strip() for one in rules.split(",")):
        found = _RULE.fullmatch(text)
        if found is None:
            raise InputError(
                f"keep = {text}: must be of all, failed, violating, worst:20, every:1000, with "
                "commas between"
            )
        named.append(found[1] or found[2])
        if found[2]:
            counts[found[2]] = int(found[3])
    return KeepRules(tuple(dict.fromkeys(named)), counts[WORST], counts[EVERY], patterns, single)


def _bounded(requirements: Sequence[Requirement]) -> list[Requirement]:
    """Those that are on a number, with a bound."""
    return [one for one in requirements if not (one.at_least is None and one.at_most is None)]


@dataclass
class RowSelection:
    """Which rows of the cases that pass by are kept. ``worst`` are, by requirement, margins and
    numbers of the worst so far, worst first."""

    keep: KeepRules
    requirements: Sequence[Requirement]
    worst: dict[str, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)

    def choose(self, rows: Mapping[str, Any]) -> tuple[np.ndarray, np.ndarray]:
        """Places (k,) of the rows of a case table that are kept, as far as is known, and why,
        text."""
        numbers, ok = np.asarray(rows["case"]), np.asarray(rows["status"]) == Status.OK.label
        why = np.full(len(numbers), ALL if ALL in self.keep.rules else "", dtype=object)
        if FAILED in self.keep.rules:
            _say(why, ~ok, FAILED)
        if VIOLATING in self.keep.rules:
            for one in self.requirements:
                known = np.logical_and(*violating(one, rows, self.requirements))
                _say(why, known, f"{VIOLATING} {one.name}")
        if EVERY in self.keep.rules:
            _say(why, numbers % self.keep.every == 0, EVERY)
        for one in self._followed:
            margin = np.where(ok, margins(np.asarray(rows[one.metric], float), one), np.nan)
            self._add(one.name, margin, numbers)
            _say(why, np.isin(numbers, self.worst[one.name][1]), f"{WORST} {one.name}")
        places = np.flatnonzero(why != "")
        return places, why[places]

    def take(self, others: "RowSelection") -> None:
        """Take the worst of other cases."""
        for name, (margin, numbers) in others.worst.items():
            self._add(name, margin, numbers)

    def _add(self, name: str, margin: np.ndarray, numbers: np.ndarray) -> None:
        before = self.worst.get(name, (np.empty(0), np.empty(0, dtype=np.int64)))
        there = ~np.isnan(margin)
        every = np.concatenate([before[0], margin[there]])
        which = np.concatenate([before[1], numbers[there]])
        first = np.lexsort((which, every))[: self.keep.worst]
        self.worst[name] = every[first], which[first]

    def state(self) -> list[np.ndarray]:
        """Margins and numbers of the worst so far, for `restore`."""
        none = np.empty(0)
        found = (self.worst.get(one.name, (none, none)) for one in self._followed)
        return [array.astype(float) for pair in found for array in pair]

    def restore(self, arrays: Iterator[np.ndarray]) -> None:
        """Hold what another one held."""
        for one in self._followed:
            self.worst[one.name] = next(arrays), next(arrays).astype(np.int64)

    @property
    def _followed(self) -> Sequence[Requirement]:
        return _bounded(self.requirements) if WORST in self.keep.rules else ()

    def still(self, numbers: np.ndarray, why: np.ndarray) -> np.ndarray:
        """Why rows that were kept are, now that all cases passed by: nothing, of those that others
        turned out to be worse than."""
        of_now = {name: set(worst.tolist()) for name, (_, worst) in self.worst.items()}
        told = []
        for number, text in zip(numbers.tolist(), why, strict=True):
            others = [part for part in text.split("; ") if not part.startswith(WORST)]
            now = [f"{WORST} {name}" for name, worst in of_now.items() if number in worst]
            told.append("; ".join(others + now))
        return np.array(told, dtype=object)


def _say(why: np.ndarray, which: np.ndarray, word: str) -> None:
    """Add a word to the reasons of some rows."""
    for place in np.flatnonzero(which):
        why[place] = f"{why[place]}; {word}" if why[place] else word
