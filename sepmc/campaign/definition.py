"""Definition of a campaign: a scene, its dispersions, and the columns and samples that follow. No
integration."""

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
    """One case, fully resolved.

    Attributes
    ----------
    number : int
        -1 for the nominal case.
    scene : Scene
        Values of the case, SI.
    inputs : dict of str to float
        Dispersed inputs by column, in the units of the campaign file.
    reach : dict of str to (float, float)
        Smallest and largest value of each input; 3 sigma for a normal distribution without
        truncation.
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
        """Inputs as a table, each with its position within its distribution, for notebooks."""
        rows = "".join(
            f"<tr><td>{escape(name)}</td><td>{value:.9g}</td>"
            f"<td>{position_svg(value, *self.reach.get(name, (value, value)))}</td></tr>"
            for name, value in self.inputs.items()
        )
        head = "nominal case" if self.number < 0 else f"case {self.number}"
        return f"<p>{head}</p><table>{rows}</table>"

    def to_dict(self) -> dict[str, Any]:
        """Scene of the case as nested data.

        Returns
        -------
        dict
            Nested dicts and lists, in SI and radians, without unset values.
        """
        return _without_none(msgspec.to_builtins(self.scene))


def _without_none(node: Any) -> Any:
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
        Texts of the values that replaced those of the file, by TOML path; for titles.
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
        """Layout of the kernel parameters.

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
            message = "two columns of the case table would be called {!r}; rename a body or joint"
            raise SceneError([f"{self.name}: {message.format(name)}" for name in repeated])
        return layout

    @cached_property
    def dispersed(self) -> frozenset[str]:
        """Paths of the dispersed parameters."""
        return frozenset(d.parameter.path for d in self.file.dispersions)

    @cached_property
    def rare_values(self) -> tuple[RareValue, ...]:
        """Values of discrete distributions, and pairs of values of correlated ones, whose
        occurrences are counted; see `sepmc.analysis.rare_values`."""
        return rare_values(self.file.dispersions, self.file.copulas)

    @property
    def has_histories(self) -> bool:
        """True if separations over time are stored: requested, and the scene has joints."""
        return self.scene.run.history_step > 0.0 and bool(self.scene.joint)

    def stored_history_columns(self, wanted: bool = True) -> list[Column]:
        """Columns of the stored separations over time.

        Parameters
        ----------
        wanted : bool
            If False, there are none.

        Returns
        -------
        list of Column
        """
        joints = list(self.layout.joints)
        return schema.separation_columns(joints) if wanted and self.has_histories else []

    @property
    def reference(self) -> dict[str, dict[str, float]] | None:
        """Reference statistics of the file by outcome: those of mean, sigma, min and max that it
        gives; None if it has no reference."""
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
        """Columns of the outcomes."""
        return schema.outcome_columns(self.layout.contents)

    @cached_property
    def result_columns(self) -> list[Column]:
        """Columns of all results of the kernel, in its order."""
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
        """Arguments of statistics: names of outcomes and audit columns, audit bounds, and
        requirements."""
        outcomes, audits = (
            [c.name for c in columns] for columns in (self.outcome_columns, schema.audit_columns())
        )
        return outcomes, audits, schema.AUDIT_BOUNDS, self.file.requirements

    @cached_property
    def slots(self) -> np.ndarray:
        """Indices (d,) of the dispersed parameters in the parameter vector of the kernel."""
        return np.array(
            [self.layout.slots[d.parameter.path] for d in self.file.dispersions], dtype=np.int64
        )

    @cached_property
    def factors(self) -> np.ndarray:
        """Factors (d,) from the units of the file to SI."""
        return np.array([d.parameter.factor for d in self.file.dispersions])

    def in_si(self, inputs: np.ndarray) -> np.ndarray:
        """Inputs in SI for a kernel.

        Parameters
        ----------
        inputs : ndarray, shape (n, d)
            In the units of the file.

        Returns
        -------
        ndarray, shape (n, d)
            NaN where a parameter is invalid; a kernel does not integrate these cases.
        """
        inputs_si = inputs * self.factors
        for i, dispersion in enumerate(self.file.dispersions):
            if dispersion.has_tails:
                inputs_si[~dispersion.allowed(inputs[:, i]), i] = np.nan
        inputs_si[self.ends_before_start(inputs_si)] = np.nan
        return inputs_si

    def ends_before_start(self, inputs_si: np.ndarray) -> np.ndarray:
        """Find cases with a load that ends before it starts, or at its start.

        Parameters
        ----------
        inputs_si : ndarray, shape (n, d)
            Dispersed inputs, SI.

        Returns
        -------
        ndarray of bool, shape (n,)
            True for these cases.
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
        """Digest of all that determines the outcomes of a case: runs of equal digest and seed have
        equal rows."""
        text = msgspec.json.encode(self._contents, order="deterministic")
        return hashlib.sha256(text).hexdigest()[:16]

    @property
    def ordered_text(self) -> bytes:
        """JSON text of all that determines the outcomes of a case, in the order of the file, which
        is that of parameters and columns. A file and its resolved copy have the same text."""
        return msgspec.json.encode(_as_written(self._contents))

    @property
    def _contents(self) -> dict[str, Any]:
        """Contents of the file that determine the outcomes of a case."""
        tree = {k: v for k, v in self.file.tree.items() if k not in _NO_OUTCOME}
        tree["run"] = {k: v for k, v in tree.get("run", {}).items() if k not in _NOT_IN_DIGEST}
        if self.file.input_table:
            tree["run"]["plan"] = self.inputs_digest  # the key that digests were made with
        return tree

    @property
    def inputs_digest(self) -> str:
        """Digest of the columns of the sample table that give inputs; empty without a table."""
        used = [d.column for d in self.file.dispersions if d.column]
        return self.file.input_table.digest(used) if self.file.input_table else ""

    def sample(
        self, first: int, count: int, seed: int | None = None, total: int | None = None
    ) -> np.ndarray:
        """Sample inputs of cases ``first`` to ``first + count`` - 1.

        Parameters
        ----------
        first, count : int
        seed : int, optional
            Of the file if None.
        total : int, optional
            Number of cases of the sample; of the file if None.

        Returns
        -------
        ndarray, shape (count, d)
            In the units of the file.

        Raises
        ------
        InputError
            If a case is not in the sample table, or not in a sample of this size.
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
        """Cases of the file: its first cases, or those of its sample table."""
        inputs = self.file.input_table
        return (
            CaseSelection.first(self.scene.run.cases)
            if inputs is None
            else CaseSelection.of(inputs.numbers)
        )

    def select_cases(self, cases: Any = None) -> tuple[CaseSelection, int]:
        """Select cases.

        Parameters
        ----------
        cases : int, str, iterable of int or CaseSelection, optional
            See `sepmc.campaign.case_selection.read`; the cases of the file if None.

        Returns
        -------
        selection : CaseSelection
        total : int
            Number of cases of the sample that they belong to.

        Raises
        ------
        InputError
            If there are no such cases.
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
            message = f"{missing} of them are not among {of_file}, the cases of the file"
            raise InputError(f"cases = {selection}: {message}")
        total = max(of_file.end, selection.end)
        self.sampling_of(total)
        return selection, total

    def sampling_of(self, total: int | None = None) -> cases.Sampling:
        """Sampler, number of cases and correlations of a sample.

        Parameters
        ----------
        total : int, optional
            Number of cases; default that of the file.

        Returns
        -------
        Sampling

        Raises
        ------
        InputError
            If the sampler cannot have this number of cases.
        """
        run = self.scene.run
        size = run.cases if total is None else check_int("total", total, 1, CASES)
        sampling = cases.Sampling(run.sampler, size, self.file.copulas)
        if fault := cases.size_fault(sampling, len(self.file.dispersions)):
            raise InputError(f"cases = {size}: {fault}")
        return sampling

    @property
    def design(self) -> str:
        """Sampling design, a key of `sepmc.analysis.variance_indices.ESTIMATORS`: the name of the
        sampler, or `PLAN` if a sample table gives inputs that are otherwise random or a Latin
        hypercube."""
        sampler = self.scene.run.sampler
        return PLAN if self.file.input_table and sampler in ("random", LHS) else sampler

    @property
    def correlated(self) -> list[list[str]]:
        """Names of the columns of correlated inputs, a list for each group."""
        dispersions = self.file.dispersions
        return [[dispersions[k].parameter.column for k in c.places] for c in self.file.copulas]

    def case(self, number: int, seed: int | None = None, total: int | None = None) -> Case:
        """Resolve one case in SI, without sampling the others.

        Parameters
        ----------
        number : int
        seed, total : int, optional
            As for `sample`.

        Returns
        -------
        Case

        Raises
        ------
        InputError
            If there is no such case.
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
        """Nominal case, with the values that follow from the nominal scene and that all cases
        share: the direction that ``alpha_ref`` counts from, and the separation signs of joints.

        Returns
        -------
        Case
            Its number is -1.
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
        """Check a seed.

        Parameters
        ----------
        seed : int or None
            None: the seed of the file.

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
        """Count cases in which the inertia of a body breaks the triangle inequality.

        Parameters
        ----------
        inputs : ndarray, shape (n, d)
            Dispersed inputs in the units of the campaign file.

        Returns
        -------
        int
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
    """A tree of TOML values in the order of a resolved campaign file: values, arrays of tables,
    tables. Values and tables keep their order; arrays of tables are sorted by key."""
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
