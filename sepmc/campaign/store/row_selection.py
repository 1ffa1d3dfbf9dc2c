"""Selection of the case rows that a run, which otherwise stores statistics only, saves: rules,
columns and precision."""

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
    """Rules that select the case rows to be saved, their columns and their precision.

    Attributes
    ----------
    rules : tuple of str
        One or several of "all", "failed", "violating" (a requirement, or ok without its outcome),
        "worst" and "every"; a row is saved if any of them selects it.
    worst : int
        For the rule "worst": number of worst cases that are saved for each requirement.
    every : int
        For the rule "every": cases are saved whose number is a multiple of this.
    patterns : tuple of str
        Patterns with * and ? for the names of the columns to be saved besides ``case``, ``status``
        and ``kept_as``, which always are; all columns if empty.
    single : bool
        True: numbers are stored in single precision.
    """

    rules: tuple[str, ...]
    worst: int = 0
    every: int = 0
    patterns: tuple[str, ...] = ()
    single: bool = False

    @property
    def text(self) -> str:
        """The rules as text, as a manifest stores it and `of_text` reads it: such as
        ``failed,worst:20; columns in_*; float32``."""
        counts = {WORST: f":{self.worst}", EVERY: f":{self.every}"}
        text = ",".join(rule + counts.get(rule, "") for rule in self.rules)
        text += f"; columns {','.join(self.patterns)}" if self.patterns else ""
        return text + ("; float32" if self.single else "")

    @classmethod
    def of_text(cls, text: str) -> "KeepRules":
        """Read rules from their `text`, as a manifest stores it. Raises InputError if it is not
        valid."""
        rules, *more = text.split("; ")
        columns = [x.removeprefix("columns ") for x in more if x.startswith("columns ")]
        return _read(rules, tuple(columns[0].split(",")) if columns else (), "float32" in more)

    def columns(self, known: Sequence[Column]) -> list[Column]:
        """Select the columns to save from all columns ``known`` of a case table: those that match
        a pattern (all without patterns), and always case number, status and reason."""
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
    """Read and check the rules for saved rows that a user gives.

    Parameters
    ----------
    rules : str
        Rules separated by commas, such as ``failed,worst:20``.
    patterns : str, optional
        Patterns of column names, separated by commas; all columns if None.
    single : bool
        True for single precision.
    requirements : sequence of Requirement
        Requirements of the campaign.
    columns : sequence of Column
        Columns of the case table.

    Returns
    -------
    KeepRules

    Raises
    ------
    InputError
        If a rule is unknown, a pattern matches no column, the rule "violating" is given without a
        requirement, or "worst" without one that has a bound (``at_least`` or ``at_most``).
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
    """Read rules from text such as ``failed,worst:20``; ``patterns`` and ``single`` are taken as
    they are. Of a rule with a number that is given twice, the last one counts. Raises InputError if
    a rule is unknown or blank."""
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
    """Select the requirements that have a bound (``at_least`` or ``at_most``), so that cases have a
    margin and one case is the worst."""
    return [item for item in requirements if not (item.at_least is None and item.at_most is None)]


@dataclass
class RowSelection:
    """Selection of the rows to be saved from successive case tables, each passed to `choose` once.

    Attributes
    ----------
    keep : KeepRules
        Rules that select rows.
    requirements : sequence of Requirement
        Requirements of the campaign.
    worst : dict of str to (ndarray, ndarray)
        By name of the requirement, with the rule "worst": margins (k,) and case numbers (k,) of the
        worst cases of all tables so far, the smallest margin first.
    """

    keep: KeepRules
    requirements: Sequence[Requirement]
    worst: dict[str, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)

    def choose(self, rows: Mapping[str, Any]) -> tuple[np.ndarray, np.ndarray]:
        """Select rows of the next case table; its cases are also added to the worst cases so far.

        Parameters
        ----------
        rows : mapping of str to array
            Case table: values (n,) by column.

        Returns
        -------
        positions : ndarray, shape (k,)
            Indices, in this table, of the selected rows. Later tables can have worse cases than
            those selected as the worst here; see `final_reasons`.
        reasons : ndarray of str, shape (k,)
            For each selected row, the rules that selected it, with the name of the requirement
            after "violating" and "worst", separated by "; ".
        """
        numbers, ok = np.asarray(rows["case"]), np.asarray(rows["status"]) == Status.OK.label
        reasons = np.full(len(numbers), ALL if ALL in self.keep.rules else "", dtype=object)
        if FAILED in self.keep.rules:
            _add_reason(reasons, ~ok, FAILED)
        if VIOLATING in self.keep.rules:
            for requirement in self.requirements:
                reason = f"{VIOLATING} {requirement.name}"
                violates, known = violation_masks(requirement, rows, self.requirements)
                _add_reason(reasons, violates & known, reason)
                _add_reason(reasons, ok & ~known, f"{reason}, no outcome")
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
        """Add the worst cases of another selection, of other cases, to those of this one."""
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
        """Arrays of the worst cases so far, for `restore`: for each requirement with a bound its
        margins, then its case numbers; empty without the rule "worst"."""
        none = np.empty(0)
        pairs = (self.worst.get(item.name, (none, none)) for item in self._with_worst)
        return [array.astype(float) for pair in pairs for array in pair]

    def restore(self, arrays: Iterator[np.ndarray]) -> None:
        """Take the arrays of `state` from an iterator, and set the worst cases to them. Raises
        StopIteration if there are too few."""
        for requirement in self._with_worst:
            self.worst[requirement.name] = next(arrays), next(arrays).astype(np.int64)

    @property
    def _with_worst(self) -> Sequence[Requirement]:
        return _with_bounds(self.requirements) if WORST in self.keep.rules else ()

    def final_reasons(self, numbers: np.ndarray, reasons: np.ndarray) -> np.ndarray:
        """Reasons for which each saved row is still selected when all cases are known.

        Parameters
        ----------
        numbers : ndarray, shape (n,)
            Case numbers.
        reasons : ndarray of str, shape (n,)
            Reasons that `choose` returned for these cases, separated by "; ".

        Returns
        -------
        ndarray of str, shape (n,)
            Reasons that still apply; empty for a row that was selected only as one of the worst
            and is not one of the worst of all cases.
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
    """Append a reason, ``word``, to the texts ``reasons`` (n,) where ``mask`` (n,) is True, in
    place, after "; " if there is a reason already."""
    for position in np.flatnonzero(mask):
        reasons[position] = f"{reasons[position]}; {word}" if reasons[position] else word
