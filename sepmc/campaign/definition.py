"""Definition of a campaign: scene and dispersions, and the table columns and samples of inputs that
follow from them. Nothing here integrates a case."""

import hashlib
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from html import escape
from typing import Any

import msgspec
import numpy as np

from sepmc import schema
from sepmc.analysis.inline_figures import position_svg
from sepmc.analysis.rare_values import RareValue, rare_values
from sepmc.analysis.variance_indices import LHS, PLAN
from sepmc.campaign import cases
from sepmc.campaign.case_selection import CaseSelection
from sepmc.campaign.case_selection import read as read_numbers
from sepmc.campaign.cases import SIZE_DEPENDENT
from sepmc.engine.dispatch import check_int
from sepmc.kernel.spec.parameter_layout import (
    ParameterLayout,
    make_parameter_layout,
    separation_sign,
)
from sepmc.scene import parameters
from sepmc.scene.checks import breaks_triangle, tensor
from sepmc.scene.limits import CASES, SEED
from sepmc.scene.load_checks import SHORTEST
from sepmc.scene.messages import InputError, SceneError
from sepmc.scene.model import Requirement, Scene
from sepmc.scene.read import CampaignFile
from sepmc.scene.units import unit_text
from sepmc.schema import Column

_NO_OUTCOME = (
    "title",
    "name",
    "requirement",
    "reference",
    "scenario",
    "map",
    "size",
    "measurement",
)  # keys of a file that change no row
# keys of [run] that change no row, and the path of the sample table, which has a digest of its own
_NOT_IN_DIGEST = ("cases", "seed", "chunk", "samples")
_TENSOR_PARTS = (("xx", "yy", "zz"), ("xy", "xz", "yz"))


@dataclass(frozen=True, repr=False)
class Case:
    """One case of a campaign, with the values of all its parameters.

    Attributes
    ----------
    number : int
        Case number; -1 for the nominal case.
    scene : Scene
        Scene with the values of the case, SI.
    inputs : dict of str to float
        Dispersed inputs by column name, in the units of the campaign file; empty if nominal.
    reach : dict of str to (float, float)
        Smallest and largest value that each input can have, by column name, in the unit of
        ``inputs``; mean +- 3 sigma for a normal distribution without truncation. Empty if nominal.
    """

    number: int
    scene: Scene
    inputs: dict[str, float]
    reach: dict[str, tuple[float, float]] = field(default_factory=dict)

    def __repr__(self) -> str:
        title = "nominal" if self.number < 0 else f"{self.number}"
        inputs = [f"{name}={value:.6g}" for name, value in list(self.inputs.items())[:3]]
        rest = [f"{len(self.inputs) - 3} more inputs"] if len(self.inputs) > 3 else []
        return f"<Case {title}{': ' if inputs else ''}{', '.join(inputs + rest)}>"

    def _repr_html_(self) -> str:
        """HTML table for notebooks: each input, its value, and a figure of its position within its
        range."""
        rows = "".join(
            f"<tr><td>{escape(name)}</td><td>{value:.9g}</td>"
            f"<td>{position_svg(value, *self.reach.get(name, (value, value)))}</td></tr>"
            for name, value in self.inputs.items()
        )
        head = "nominal case" if self.number < 0 else f"case {self.number}"
        return f"<p>{head}</p><table>{rows}</table>"

    def to_dict(self) -> dict[str, Any]:
        """Return the scene of the case as nested data.

        Returns
        -------
        dict
            Nested dicts and lists, in SI and radians; fields that are None are left out.
        """
        return _without_none(msgspec.to_builtins(self.scene))


def _without_none(node: Any) -> Any:
    """Return nested dicts and lists without the dict entries that are None, at any depth. Tuples
    become lists."""
    if isinstance(node, dict):
        return {key: _without_none(value) for key, value in node.items() if value is not None}
    return [_without_none(item) for item in node] if isinstance(node, list | tuple) else node


class Definition:
    """Scene and dispersions of a campaign, and the columns and samples that follow from them.

    Parameters
    ----------
    file : CampaignFile
        Parsed campaign file.
    settings : mapping of str to str, optional
        Values by TOML path, as text, that ``file`` already has in place of those of the file on
        disk; used only to show and store them.
    """

    def __init__(self, file: CampaignFile, settings: Mapping[str, str] | None = None):
        self.file = file
        self.settings = dict(settings or {})

    @property
    def name(self) -> str:
        """Name of the campaign."""
        return self.file.name

    @property
    def scene(self) -> Scene:
        """Nominal scene."""
        return self.file.scene

    @cached_property
    def layout(self) -> ParameterLayout:
        """Parameter vector of the kernel: index and nominal value of every parameter.

        Raises
        ------
        SceneError
            If two columns of the case table have one name.
        """
        layout = make_parameter_layout(self.scene, dispersed=self.dispersed)
        layout = replace(layout, extremes=cases.extremes(self.scene, self.file.dispersions))
        names = Counter(
            column.name for column in [*self.input_columns, *schema.result_columns(layout.contents)]
        )
        if repeated := [name for name, count in names.items() if count > 1]:
            reason = "would be the name of two columns of the case table; rename a body or joint"
            raise SceneError([f"{self.name}: {name!r} {reason}" for name in repeated])
        return layout

    @cached_property
    def dispersed(self) -> frozenset[str]:
        """TOML paths of the dispersed parameters, without units."""
        return frozenset(d.parameter.path for d in self.file.dispersions)

    @cached_property
    def rare_values(self) -> tuple[RareValue, ...]:
        """Values whose occurrences a run counts: all of discrete distributions, of whatever
        probability below 1, and pairs of values of two correlated ones that the correlation makes
        more probable; see `sepmc.analysis.rare_values`."""
        return rare_values(self.file.dispersions, self.file.copulas)

    @property
    def has_histories(self) -> bool:
        """True if runs store separations over time: ``run.history_step_s`` is above 0, and the
        scene has joints."""
        return self.scene.run.history_step > 0.0 and bool(self.scene.joint)

    def stored_history_columns(self, wanted: bool = True) -> list[Column]:
        """Return the columns of the separations over time that a run stores, which follow ``case``
        and ``time_s``.

        Parameters
        ----------
        wanted : bool
            Set False for a run that stores no histories.

        Returns
        -------
        list of Column
            Empty if no histories are stored.
        """
        joints = list(self.layout.joints)
        return schema.separation_columns(joints) if wanted and self.has_histories else []

    @property
    def reference(self) -> dict[str, dict[str, float]] | None:
        """Reference statistics that the file gives, by outcome and then by name (mean, sigma, min
        or max), in the units of the outcomes; None if it gives none."""
        if self.file.reference is None:
            return None
        outcome = msgspec.to_builtins(self.file.reference.outcome)
        return {
            name: {k: v for k, v in row.items() if v is not None} for name, row in outcome.items()
        }

    @cached_property
    def input_columns(self) -> list[Column]:
        """Columns of the dispersed parameters, in the units of the file."""
        return [
            Column(d.parameter.column, unit_text(d.parameter.unit), d.sentence)
            for d in self.file.dispersions
        ]

    @cached_property
    def outcome_columns(self) -> list[Column]:
        """Columns of the outcomes, which are the first of `result_columns`."""
        return schema.outcome_columns(self.layout.contents)

    @cached_property
    def result_columns(self) -> list[Column]:
        """Columns of all results of the kernel, in its order: outcomes, then audit columns."""
        return schema.result_columns(self.layout.contents)

    @cached_property
    def columns(self) -> list[Column]:
        """Columns of the case table: case number, status, inputs and results."""
        head = [
            Column("case", "1", "number of the case"),
            Column("status", "", "ok, or why the case failed"),
        ]
        return [*head, *self.input_columns, *self.result_columns]

    @property
    def summary_inputs(
        self,
    ) -> tuple[list[str], list[str], dict[str, float], tuple[Requirement, ...]]:
        """Names of outcomes, names of audit columns, audit bounds by name, and requirements: the
        arguments of `TableStatistics` after the case table."""
        outcomes, audits = (
            [c.name for c in columns] for columns in (self.outcome_columns, schema.audit_columns())
        )
        return outcomes, audits, schema.AUDIT_BOUNDS, self.file.requirements

    @cached_property
    def slots(self) -> np.ndarray:
        """Indices (d,) of the d dispersed parameters in the parameter vector of the kernel."""
        return np.array(
            [self.layout.slots[d.parameter.path] for d in self.file.dispersions], dtype=np.int64
        )

    @cached_property
    def factors(self) -> np.ndarray:
        """Factors (d,) that convert the dispersed inputs from the units of the file to SI."""
        return np.array([d.parameter.factor for d in self.file.dispersions])

    def in_si(self, inputs: np.ndarray) -> np.ndarray:
        """Convert the inputs of n cases to SI, and mark invalid ones for the kernel.

        Parameters
        ----------
        inputs : ndarray, shape (n, d)
            In the units of the file.

        Returns
        -------
        ndarray, shape (n, d)
            SI. NaN where the model does not allow a value, and in all inputs of a case with a load
            that does not end after its start; a kernel does not integrate cases with NaN.
        """
        inputs_si = inputs * self.factors
        for i, dispersion in enumerate(self.file.dispersions):
            if dispersion.has_tails:
                inputs_si[~dispersion.allowed(inputs[:, i]), i] = np.nan
        inputs_si[self.ends_before_start(inputs_si)] = np.nan
        return inputs_si

    def ends_before_start(self, inputs_si: np.ndarray) -> np.ndarray:
        """Find the cases in which a load with dispersed times does not end after its start.

        Parameters
        ----------
        inputs_si : ndarray, shape (n, d)
            Dispersed inputs, SI.

        Returns
        -------
        ndarray of bool, shape (n,)
            True for the cases found.
        """
        index = {d.parameter.path: i for i, d in enumerate(self.file.dispersions)}
        is_early = np.zeros(len(inputs_si), dtype=bool)
        for load in self.scene.load:
            times = {f"load.{load.name}.start": load.start, f"load.{load.name}.end": load.end}
            if not index.keys().isdisjoint(times):
                start, end = (
                    inputs_si[:, index[path]] if path in index else value
                    for path, value in times.items()
                )
                is_early |= end - start <= SHORTEST
        return is_early

    @property
    def digest(self) -> str:
        """Digest (16 hexadecimal digits) of all in the file and its sample table that determines
        the outcomes of a case, but for the seed: runs of equal digest and seed have equal rows. It
        does not depend on the version of sepmc."""
        text = msgspec.json.encode(self._contents, order="deterministic")
        return hashlib.sha256(text).hexdigest()[:16]

    @property
    def ordered_text(self) -> bytes:
        """JSON text of all that determines the outcomes of a case, but for the seed. Keys are in
        the order of the file, from which the order of parameters and columns follows; a campaign
        file and the resolved copy in its run folder have the same text."""
        return msgspec.json.encode(_as_written(self._contents))

    @property
    def _contents(self) -> dict[str, Any]:
        """TOML tree of the file without the keys that change no outcome of a case, and without
        number of cases, seed and chunk of the run; the sample table is represented by its
        digest."""
        tree = {k: v for k, v in self.file.tree.items() if k not in _NO_OUTCOME}
        tree["run"] = {k: v for k, v in tree.get("run", {}).items() if k not in _NOT_IN_DIGEST}
        if self.file.input_table:
            tree["run"]["plan"] = self.inputs_digest  # the key that digests were made with
        return tree

    @property
    def inputs_digest(self) -> str:
        """Digest of the case numbers of the sample table and of its columns that give inputs; empty
        text without a table."""
        used = [d.column for d in self.file.dispersions if d.column]
        return self.file.input_table.digest(used) if self.file.input_table else ""

    def sample(
        self, first: int, count: int, seed: int | None = None, total: int | None = None
    ) -> np.ndarray:
        """Sample inputs of cases ``first`` to ``first + count`` - 1.

        Without a sample table, a random or Sobol sample has every case number from 0 on, also
        beyond ``total``.

        Parameters
        ----------
        first, count : int
            Number of the first case, and number of cases.
        seed : int, optional
            That of the file if None.
        total : int, optional
            Number of cases of the whole sample, on which some samplers depend; that of the file if
            None.

        Returns
        -------
        ndarray, shape (count, d)
            In the units of the file.

        Raises
        ------
        InputError
            If a case is not in the sample table, or not in a sample of this size, if ``seed`` is
            out of range, or if the sampler cannot have ``total`` cases.
        """
        sampling = self.sampling_of(total)
        first = check_int("first", first, 0, CASES - 1)
        end = sampling.cases if self.scene.run.sampler in SIZE_DEPENDENT else CASES
        count = check_int("count", count, 0, max(end - first, 0))
        dispersions, inputs = self.file.dispersions, self.file.input_table
        table = cases.sample(dispersions, self.checked_seed(seed), first, count, sampling)
        if inputs is not None:
            try:
                rows = inputs.rows(first, count)
            except KeyError as error:
                raise InputError(f"case = {error}: no such case in {inputs.path.name}") from None
            for k, dispersion in enumerate(dispersions):
                if dispersion.column:
                    table[:, k] = inputs.columns[dispersion.column][rows]
        return table

    @property
    def numbers(self) -> CaseSelection:
        """Cases that the file asks for: the first ``run.cases``, or those of its sample table."""
        inputs = self.file.input_table
        return (
            CaseSelection.first(self.scene.run.cases)
            if inputs is None
            else CaseSelection.of(inputs.numbers)
        )

    def select_cases(self, cases: Any = None) -> tuple[CaseSelection, int]:
        """Convert a request for cases to a selection, and check that these cases exist.

        Parameters
        ----------
        cases : int, str, iterable of int or CaseSelection, optional
            A number of cases (the first ones, also of a sample table) or case numbers; see
            `sepmc.campaign.case_selection.read`. Those of `numbers` if None.

        Returns
        -------
        selection : CaseSelection
        total : int
            Number of cases of the sample that the selected ones belong to: for a number of cases
            without a sample table that number, else one more than the largest case number of those
            selected and of the file.

        Raises
        ------
        InputError
            If a case is not in the sample table, or not in a sample of fixed size, or the sampler
            cannot have this number of cases.
        """
        of_file, inputs = self.numbers, self.file.input_table
        selection = of_file if cases is None else read_numbers(cases)
        if isinstance(selection, int):
            if inputs is None:
                self.sampling_of(selection)
                return CaseSelection.first(selection), selection
            if selection > of_file.count:
                table = inputs.path.name
                raise InputError(f"cases = {selection}: {table} has only {of_file.count} cases")
            selection = CaseSelection.of(inputs.numbers[:selection])
        fixed = inputs is not None or self.scene.run.sampler in SIZE_DEPENDENT
        if fixed and (missing := selection.count - selection.count_common(of_file)):
            message = (
                f"{missing} of them are not among {of_file}, the cases of the sample table or, "
                "without one, of run.cases"
            )
            raise InputError(f"cases = {selection}: {message}")
        total = max(of_file.end, selection.end)
        self.sampling_of(total)
        return selection, total

    def sampling_of(self, total: int | None = None) -> cases.Sampling:
        """Return the sampler, the number of cases and the correlations of a whole sample.

        Parameters
        ----------
        total : int, optional
            Number of cases of the sample; that of the file if None.

        Returns
        -------
        Sampling

        Raises
        ------
        InputError
            If the number of cases is not from 1 to `CASES`, or the sampler cannot have it.
        """
        run = self.scene.run
        size = run.cases if total is None else check_int("total", total, 1, CASES)
        sampling = cases.Sampling(run.sampler, size, self.file.copulas)
        if fault := cases.size_fault(sampling, len(self.file.dispersions)):
            raise InputError(f"cases = {size}: {fault}")
        return sampling

    @property
    def design(self) -> str:
        """Name of the sampling design, a key of `sepmc.analysis.variance_indices.ESTIMATORS`:
        `PLAN` if a sample table gives inputs and the sampler is random or lhs; else the sampler."""
        sampler = self.scene.run.sampler
        return PLAN if self.file.input_table and sampler in ("random", LHS) else sampler

    @property
    def correlated(self) -> list[list[str]]:
        """Names of the columns of correlated inputs, a list for each correlated group."""
        dispersions = self.file.dispersions
        return [[dispersions[k].parameter.column for k in c.places] for c in self.file.copulas]

    def case(self, number: int, seed: int | None = None, total: int | None = None) -> Case:
        """Sample one case alone, and return it with the values of all its parameters.

        Parameters
        ----------
        number : int
            Case number, from 0.
        seed, total : int, optional
            As for `sample`.

        Returns
        -------
        Case

        Raises
        ------
        InputError
            If there is no such case. Without a sample table, a random or Sobol sample has every
            case number from 0 on, also beyond the number of cases of the file.
        """
        total = self.scene.run.cases if total is None else total
        depends_on_size = self.scene.run.sampler in cases.SIZE_DEPENDENT
        number = check_int("case", number, 0, (total if depends_on_size else CASES) - 1)
        inputs = self.sample(number, 1, seed, total)[0]
        values = {
            d.parameter.path: float(x)
            for d, x in zip(self.file.dispersions, inputs * self.factors, strict=True)
        }
        return Case(
            number,
            parameters.replace(self.nominal().scene, values),
            {c.name: float(x) for c, x in zip(self.input_columns, inputs, strict=True)},
            {d.parameter.column: d.reach for d in self.file.dispersions},
        )

    def nominal(self) -> Case:
        """Return the nominal case: the values of the file, also where a parameter is dispersed. Its
        scene also has two kinds of values that are computed from the nominal scene and shared by
        all cases: the direction from which ``alpha_ref`` is measured, and the separation signs of
        the joints.

        Returns
        -------
        Case
            Number -1, without inputs.
        """
        initial = self.scene.initial
        if initial.path_reference is None:
            initial = msgspec.structs.replace(initial, path_reference=initial.pitch - initial.alpha)
        joints = {
            name: msgspec.structs.replace(joint, apart=separation_sign(self.scene, name))
            for name, joint in self.scene.joint.items()
        }
        return Case(-1, msgspec.structs.replace(self.scene, initial=initial, joint=joints), {})

    def checked_seed(self, seed: int | None) -> int:
        """Return a seed after checking its range, or the seed of the file.

        Parameters
        ----------
        seed : int or None
            The seed of the file is returned if None.

        Returns
        -------
        int

        Raises
        ------
        InputError
            If it is out of range.
        """
        return self.scene.run.seed if seed is None else check_int("seed", seed, 0, SEED)

    def implausible_inertias(self, inputs: np.ndarray) -> int:
        """Count cases in which the inertia tensor of a body is positive definite but breaks the
        triangle inequality, so that no solid body can have it. Only bodies with dispersed inertia
        count.

        Parameters
        ----------
        inputs : ndarray, shape (n, d)
            Dispersed inputs of n cases, in the units of the campaign file.

        Returns
        -------
        int
            Number of such cases.
        """
        index = {d.parameter.path: i for i, d in enumerate(self.file.dispersions)}
        is_broken = np.zeros(len(inputs), dtype=bool)
        for name in self.scene.body:
            prefixes = (f"body.{name}.inertia.", f"body.{name}.inertia_products.")
            if any(path.startswith(prefixes) for path in index):
                values = {
                    path: inputs[:, index[path]] * self.factors[index[path]]
                    if path in index
                    else parameters.value(self.scene, path)
                    for path in (
                        prefix + part
                        for prefix, parts in zip(prefixes, _TENSOR_PARTS, strict=True)
                        for part in parts
                    )
                }
                tensors = np.moveaxis(
                    tensor(*[np.broadcast_to(v, len(inputs)) for v in values.values()]), -1, 0
                )
                principal = np.linalg.eigvalsh(tensors)
                is_broken |= (principal[:, 0] > 0.0) & breaks_triangle(principal)
        return int(np.count_nonzero(is_broken))


def _as_written(value: Any) -> Any:
    """Return a tree of TOML values with the keys of each table in the order of a resolved campaign
    file: first plain values, then arrays of tables, then tables. Plain values and tables keep their
    order; arrays of tables are sorted by key."""
    if isinstance(value, list):
        return [_as_written(item) for item in value]
    if not isinstance(value, dict):
        return value

    def order(item: tuple[str, Any]) -> tuple[int, str]:
        key, content = item
        if isinstance(content, dict):
            return 2, ""
        is_array_of_tables = isinstance(content, list) and any(isinstance(x, dict) for x in content)
        return (1, key) if is_array_of_tables else (0, "")

    return {key: _as_written(content) for key, content in sorted(value.items(), key=order)}
