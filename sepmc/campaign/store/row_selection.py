"""Rows that a run of statistics saves: rules, columns and precision."""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from typing import Any

import numpy as np

from sepmc.analysis.requirements import margins, violation_masks
from sepmc.scene.messages import InputError, nearest
from sepmc.scene.model import Requirement
from sepmc.schema import Column, Status

ALL, FAILED, VIOLATING, WORST, EVERY = "all", "failed", "violating", "worst", "every"
REASON = Column("kept_as", "", "rules by which the row is kept")
_RULE = re.compile(r"(all|failed|violating)|(worst|every):([1-9][0-9]{0,8})")
_HEAD = ("case", "status", REASON.name)


@dataclass(frozen=True)
class KeepRules:
    """Rules for the rows that are saved, and their columns.

    Attributes
    ----------
    rules : tuple of str
        Some of "all", "failed", "violating", "worst" and "every".
    worst : int
        Number of worst rows of each requirement.
    every : int
        Rows of case numbers that are a multiple of this.
    patterns : tuple of str
        Patterns of column names; all columns if empty.
    single : bool
        Store numbers in single precision.
    """

    rules: tuple[str, ...]
    worst: int = 0
    every: int = 0
    patterns: tuple[str, ...] = ()
    single: bool = False

    @property
    def text(self) -> str:
        """Text of the rules as a manifest stores it."""
        counts = {WORST: f":{self.worst}", EVERY: f":{self.every}"}
        text = ",".join(rule + counts.get(rule, "") for rule in self.rules)
        text += f"; columns {','.join(self.patterns)}" if self.patterns else ""
        return text + ("; float32" if self.single else "")

    @classmethod
    def of_text(cls, text: str) -> "KeepRules":
        """Rules from their `text`, as a manifest stores it. Raises InputError if it is not
        valid."""
        rules, *more = text.split("; ")
        columns = [x.removeprefix("columns ") for x in more if x.startswith("columns ")]
        return _read(rules, tuple(columns[0].split(",")) if columns else (), "float32" in more)

    def columns(self, known: Sequence[Column]) -> list[Column]:
        """Those of the columns ``known`` of a case table that are saved."""
        return [
            column
            for column in known
            if column.name in _HEAD
            or not self.patterns
            or any(fnmatchcase(column.name, pattern) for pattern in self.patterns)
        ]


def parse_keep_rules(
    rules: str,
    patterns: str | None,
    single: bool,
    requirements: Sequence[Requirement],
    columns: Sequence[Column],
) -> KeepRules:
    """Parse and check the rules of the command line.

    Parameters
    ----------
    rules : str
        As ``failed,worst:20``.
    patterns : str, optional
        Patterns of column names, with commas.
    single : bool
        Single precision.
    requirements : sequence of Requirement
    columns : sequence of Column
        Of the case table.

    Returns
    -------
    KeepRules

    Raises
    ------
    InputError
        If a rule is unknown or needs a requirement that there is not, or a pattern matches no
        column.
    """
    names_kept = tuple(x.strip() for x in patterns.split(",")) if patterns else ()
    keep = _read(rules, names_kept, single)
    if not _with_bounds(requirements) and WORST in keep.rules:
        raise InputError("keep = worst: needs a [[requirement]] with at_least or at_most")
    if VIOLATING in keep.rules and not requirements:
        raise InputError("keep = violating: needs a [[requirement]]")
    names = [column.name for column in columns]
    for pattern in names_kept:
        if not any(fnmatchcase(name, pattern) for name in names):
            raise InputError(f"keep_columns = {pattern}: no such column; {nearest(pattern, names)}")
    return keep


def _read(rules: str, patterns: tuple[str, ...], single: bool) -> KeepRules:
    """Rules from the text of their names, such as ``failed,worst:20``. Raises InputError."""
    counts, names = {WORST: 0, EVERY: 0}, []
    for text in (rule.strip() for rule in rules.split(",")):
        match = _RULE.fullmatch(text)
        if match is None:
            raise InputError(
                f"keep = {text}: must be one or several, separated by commas, of all, failed, "
                "violating, worst:N and every:N, such as failed,worst:20"
            )
        names.append(match[1] or match[2])
        if match[2]:
            counts[match[2]] = int(match[3])
    return KeepRules(tuple(dict.fromkeys(names)), counts[WORST], counts[EVERY], patterns, single)


def _with_bounds(requirements: Sequence[Requirement]) -> list[Requirement]:
    """Requirements with a bound on an outcome, not those on a status or other requirements."""
    return [item for item in requirements if not (item.at_least is None and item.at_most is None)]


@dataclass
class RowSelection:
    """Selection of rows from case tables that are seen one after the other, each once.

    Attributes
    ----------
    keep : KeepRules
    requirements : sequence of Requirement
        Of the campaign.
    worst : dict of str to (ndarray, ndarray)
        By requirement: margins and case numbers of the worst cases so far, worst first.
    """

    keep: KeepRules
    requirements: Sequence[Requirement]
    worst: dict[str, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)

    def choose(self, rows: Mapping[str, Any]) -> tuple[np.ndarray, np.ndarray]:
        """Select rows of the next case table, and update the worst cases so far.

        Parameters
        ----------
        rows : mapping of str to array
            Case table by column.

        Returns
        -------
        positions : ndarray, shape (k,)
            Indices of the selected rows of this table. Cases of later tables can replace the
            worst; see `final_reasons`.
        reasons : ndarray of str, shape (k,)
            Reasons for which each row is selected, separated by "; ".
        """
        numbers, ok = np.asarray(rows["case"]), np.asarray(rows["status"]) == Status.OK.label
        reasons = np.full(len(numbers), ALL if ALL in self.keep.rules else "", dtype=object)
        if FAILED in self.keep.rules:
            _add_reason(reasons, ~ok, FAILED)
        if VIOLATING in self.keep.rules:
            for requirement in self.requirements:
                known = np.logical_and(*violation_masks(requirement, rows, self.requirements))
                _add_reason(reasons, known, f"{VIOLATING} {requirement.name}")
        if EVERY in self.keep.rules:
            _add_reason(reasons, numbers % self.keep.every == 0, EVERY)
        for requirement in self._with_worst:
            margin = np.where(
                ok, margins(np.asarray(rows[requirement.metric], float), requirement), np.nan
            )
            self._add(requirement.name, margin, numbers)
            _add_reason(
                reasons,
                np.isin(numbers, self.worst[requirement.name][1]),
                f"{WORST} {requirement.name}",
            )
        positions = np.flatnonzero(reasons != "")
        return positions, reasons[positions]

    def take(self, others: "RowSelection") -> None:
        """Merge the worst cases of another selection."""
        for name, (margin, numbers) in others.worst.items():
            self._add(name, margin, numbers)

    def _add(self, name: str, margin: np.ndarray, numbers: np.ndarray) -> None:
        previous = self.worst.get(name, (np.empty(0), np.empty(0, dtype=np.int64)))
        is_finite = ~np.isnan(margin)
        margins_so_far = np.concatenate([previous[0], margin[is_finite]])
        numbers_so_far = np.concatenate([previous[1], numbers[is_finite]])
        order = np.lexsort((numbers_so_far, margins_so_far))[: self.keep.worst]
        self.worst[name] = margins_so_far[order], numbers_so_far[order]

    def state(self) -> list[np.ndarray]:
        """Margins and numbers of the worst cases, for `restore`."""
        none = np.empty(0)
        pairs = (self.worst.get(item.name, (none, none)) for item in self._with_worst)
        return [array.astype(float) for pair in pairs for array in pair]

    def restore(self, arrays: Iterator[np.ndarray]) -> None:
        """Load arrays of `state`."""
        for requirement in self._with_worst:
            self.worst[requirement.name] = next(arrays), next(arrays).astype(np.int64)

    @property
    def _with_worst(self) -> Sequence[Requirement]:
        return _with_bounds(self.requirements) if WORST in self.keep.rules else ()

    def final_reasons(self, numbers: np.ndarray, reasons: np.ndarray) -> np.ndarray:
        """Final reasons for which each row was saved, once all cases are known.

        Parameters
        ----------
        numbers : ndarray, shape (n,)
            Case numbers.
        reasons : ndarray of str, shape (n,)
            Reasons that `choose` gave.

        Returns
        -------
        ndarray of str, shape (n,)
            Reasons that still hold; empty for a row that was selected only as one of the worst and
            is no longer among them.
        """
        worst_cases = {name: set(worst.tolist()) for name, (_, worst) in self.worst.items()}
        texts = []
        for number, text in zip(numbers.tolist(), reasons, strict=True):
            others = [part for part in text.split("; ") if not part.startswith(WORST)]
            reasons_worst = [
                f"{WORST} {name}" for name, worst in worst_cases.items() if number in worst
            ]
            texts.append("; ".join(others + reasons_worst))
        return np.array(texts, dtype=object)


def _add_reason(reasons: np.ndarray, mask: np.ndarray, word: str) -> None:
    """Append a reason, ``word``, to the reasons (n,) of the rows where ``mask`` (n,) is true, in
    place."""
    for position in np.flatnonzero(mask):
        reasons[position] = f"{reasons[position]}; {word}" if reasons[position] else word
