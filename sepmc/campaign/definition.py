"""What a campaign is: a scene, what varies in it, and what follows from both, columns and draws
among them. It knows no flight."""

import hashlib
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import msgspec
import numpy as np

from sepmc import schema
from sepmc.analysis.rare_values import RareValue, rare_values
from sepmc.analysis.variance_indices import LHS, PLAN
from sepmc.campaign import cases
from sepmc.campaign.case_selection import CaseSelection
from sepmc.campaign.case_selection import read as read_numbers
from sepmc.campaign.cases import OF_ITS_SIZE
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

# keys of [run] that change no row, and the path of the sample table, which has a digest of its own
_NOT_IN_DIGEST = ("cases", "seed", "chunk", "samples")
_TENSOR_PARTS = (("xx", "yy", "zz"), ("xy", "xz", "yz"))


@dataclass(frozen=True, repr=False)
class Case:
    """One case, fully resolved.

    ``scene`` holds its values in SI; ``inputs`` the dispersed ones, by column, in the units of the
    campaign file.
    """

    number: int
    scene: Scene
    inputs: dict[str, float]

    def __repr__(self) -> str:
        which = "nominal" if self.number < 0 else f"{self.number}"
        some = [f"{name}={value:.6g}" for name, value in list(self.inputs.items())[:3]]
        more = [f"{len(self.inputs) - 3} more inputs"] if len(self.inputs) > 3 else []
        return f"<Case {which}{': ' if some else ''}{', '.join(some + more)}>"

    def _repr_html_(self) -> str:
        """A notebook's view: the inputs."""
        rows = "".join(f"<tr><td>{k}</td><td>{v:.9g}</td></tr>" for k, v in self.inputs.items())
        head = "nominal case" if self.number < 0 else f"case {self.number}"
        return f"<p>{head}</p><table>{rows}</table>"

    def to_dict(self) -> dict[str, Any]:
        """The scene as plain nested dicts and lists, SI and radians; what is not set is left
        out."""
        return _set_only(msgspec.to_builtins(self.scene))


def _set_only(node: Any) -> Any:
    if isinstance(node, dict):
        return {key: _set_only(value) for key, value in node.items() if value is not None}
    return [_set_only(item) for item in node] if isinstance(node, list | tuple) else node


class Definition:
    """A scene, its dispersions and its run settings, as a file gives them; ``settings`` tells which
    values were put in place of its own, by TOML path."""

    def __init__(self, file: CampaignFile, settings: Mapping[str, str] | None = None):
        self.file = file
        self.settings = dict(settings or {})

    @property
    def name(self) -> str:
        """Name of the campaign."""
        return self.file.name

    @property
    def scene(self) -> Scene:
        """The scene of the file."""
        return self.file.scene

    @cached_property
    def plan(self) -> ParameterLayout:
        """What the scene needs of a kernel. Raises SceneError if two columns of the case table
        would have one name."""
        plan = make_parameter_layout(self.scene, dispersed=self.dispersed)
        plan = replace(plan, extremes=cases.extremes(self.scene, self.file.dispersions))
        names = Counter(
            column.name for column in [*self.input_columns, *schema.result_columns(plan.contents)]
        )
        if twice := [name for name, count in names.items() if count > 1]:
            said = "names of bodies and joints make two columns {!r}; rename one"
            raise SceneError([f"{self.name}: {said.format(name)}" for name in twice])
        return plan

    @cached_property
    def dispersed(self) -> frozenset[str]:
        """Paths of the parameters that vary."""
        return frozenset(d.parameter.path for d in self.file.dispersions)

    @cached_property
    def rare_values(self) -> tuple[RareValue, ...]:
        """Values and pairs of values that the file gives a probability."""
        return rare_values(self.file.dispersions, self.file.copulas)

    @property
    def has_histories(self) -> bool:
        """Whether rows come with separation over time: asked for, of a scene with joints."""
        return self.scene.run.history_step > 0.0 and bool(self.scene.joint)

    def stored_history_columns(self, wanted: bool = True) -> list[Column]:
        """Columns of the separations over time that rows come with; none if they have none, or
        these are not ``wanted``."""
        joints = list(self.plan.joints)
        return schema.separation_columns(joints) if wanted and self.has_histories else []

    @property
    def reference(self) -> dict[str, dict[str, float]] | None:
        """Statistics to compare with, by outcome: those given of mean, sigma, min, max."""
        if self.file.reference is None:
            return None
        outcome = msgspec.to_builtins(self.file.reference.outcome)
        return {
            name: {k: v for k, v in row.items() if v is not None} for name, row in outcome.items()
        }

    @cached_property
    def input_columns(self) -> list[Column]:
        """Columns of the dispersed parameters, each in the unit of the file."""
        return [
            Column(d.parameter.column, unit_text(d.parameter.unit), d.sentence)
            for d in self.file.dispersions
        ]

    @cached_property
    def outcome_columns(self) -> list[Column]:
        """Columns of the outcomes."""
        return schema.outcome_columns(self.plan.contents)

    @cached_property
    def result_columns(self) -> list[Column]:
        """All that the kernel writes of a case, in its order."""
        return schema.result_columns(self.plan.contents)

    @cached_property
    def columns(self) -> list[Column]:
        """Columns of the case table."""
        head = [
            Column("case", "1", "number of the case"),
            Column("status", "", "ok, or why the case failed"),
        ]
        return [*head, *self.input_columns, *self.result_columns]

    @property
    def summary_inputs(
        self,
    ) -> tuple[list[str], list[str], dict[str, float], tuple[Requirement, ...]]:
        """What statistics are made of: names of outcomes and of audit columns, the bounds of these,
        and what is required."""
        outcomes, audits = (
            [c.name for c in columns] for columns in (self.outcome_columns, schema.audit_columns())
        )
        return outcomes, audits, schema.AUDIT_BOUNDS, self.file.requirements

    @cached_property
    def slots(self) -> np.ndarray:
        """Places of the dispersed parameters in the kernel's vector."""
        return np.array(
            [self.plan.slots[d.parameter.path] for d in self.file.dispersions], dtype=np.int64
        )

    @cached_property
    def factors(self) -> np.ndarray:
        """Factors (d,) that take draws in the units of the file to SI."""
        return np.array([d.parameter.factor for d in self.file.dispersions])

    def in_si(self, drawn: np.ndarray) -> np.ndarray:
        """A case table (n, d) in SI, as a kernel takes it; NaN, which no kernel flies, where laws
        give what may not be."""
        draws = drawn * self.factors
        for i, dispersion in enumerate(self.file.dispersions):
            if dispersion.has_tails:
                draws[~dispersion.allowed(drawn[:, i]), i] = np.nan
        draws[self._early(draws)] = np.nan
        return draws

    def _early(self, draws: np.ndarray) -> np.ndarray:
        """Which rows of a case table in SI hold a load that ends before it starts (n,)."""
        place = {d.parameter.path: i for i, d in enumerate(self.file.dispersions)}
        early = np.zeros(len(draws), dtype=bool)
        for load in self.scene.load:
            times = {f"load.{load.name}.start": load.start, f"load.{load.name}.end": load.end}
            if not place.keys().isdisjoint(times):
                start, end = (
                    draws[:, place[path]] if path in place else value
                    for path, value in times.items()
                )
                early |= end - start <= SHORTEST
        return early

    @property
    def digest(self) -> str:
        """Digest of all that decides a case's outcome: two runs of equal digest and seed hold equal
        rows."""
        told = ("title", "name", "requirement", "reference")
        tree = {k: v for k, v in self.file.tree.items() if k not in told}
        tree["run"] = {k: v for k, v in tree.get("run", {}).items() if k not in _NOT_IN_DIGEST}
        if self.file.input_table:
            tree["run"]["plan"] = self.inputs_digest  # the key that digests were made with
        return hashlib.sha256(msgspec.json.encode(tree, order="deterministic")).hexdigest()[:16]

    @property
    def inputs_digest(self) -> str:
        """Digest of the numbers that a plan gives; of none, empty."""
        used = [d.column for d in self.file.dispersions if d.column]
        return self.file.input_table.digest(used) if self.file.input_table else ""

    def sample(
        self, first: int, count: int, seed: int | None = None, total: int | None = None
    ) -> np.ndarray:
        """Case table (count, d) of cases ``first`` to ``first + count`` of ``total``, as the file
        says that they are drawn, or as its plan gives them, in the units of its keys. Raises
        InputError if there is no such case: of the plan, or of a sampler whose cases depend on how
        many there are."""
        sampling = self.sampling_of(total)
        first = check_int("first", first, 0, CASES - 1)
        last = sampling.cases if self.scene.run.sampler in OF_ITS_SIZE else CASES
        count = check_int("count", count, 0, max(last - first, 0))
        laws, inputs = self.file.dispersions, self.file.input_table
        table = cases.sample(laws, self._seed(seed), first, count, sampling)
        if inputs is not None:
            try:
                rows = inputs.rows(first, count)
            except KeyError as error:
                raise InputError(f"case = {error}: no such case in {inputs.path.name}") from None
            for place, law in enumerate(laws):
                if law.column:
                    table[:, place] = inputs.columns[law.column][rows]
        return table

    @property
    def numbers(self) -> CaseSelection:
        """Cases that the file asks for: the first so many, or those of its plan."""
        inputs = self.file.input_table
        return (
            CaseSelection.first(self.scene.run.cases)
            if inputs is None
            else CaseSelection.of(inputs.numbers)
        )

    def select_cases(self, cases: Any = None) -> tuple[CaseSelection, int]:
        """Cases that are asked for, as `sepmc.campaign.case_selection.read` takes them or as the
        file has them, and how many they are drawn of. Raises InputError if there are no such
        cases."""
        own, inputs = self.numbers, self.file.input_table
        found = own if cases is None else read_numbers(cases)
        if isinstance(found, int):
            if inputs is None:
                self.sampling_of(found)
                return CaseSelection.first(found), found
            if found > own.count:
                raise InputError(f"cases = {found}: {inputs.path.name} has {own.count}")
            found = CaseSelection.of(inputs.numbers[:found])
        fixed = inputs is not None or self.scene.run.sampler in OF_ITS_SIZE
        if fixed and (missing := found.count - found.common(own)):
            raise InputError(f"cases = {found}: {missing} of them are not among {own}")
        total = max(own.end, found.end)
        self.sampling_of(total)
        return found, total

    def sampling_of(self, total: int | None = None) -> cases.Sampling:
        """How so many cases are drawn. Raises InputError if so many cannot be."""
        run = self.scene.run
        size = run.cases if total is None else check_int("total", total, 1, CASES)
        sampling = cases.Sampling(run.sampler, size, self.file.copulas)
        if fault := cases.size_fault(sampling, len(self.file.dispersions)):
            raise InputError(f"cases = {size}: {fault}")
        return sampling

    @property
    def design(self) -> str:
        """How cases are drawn, a key of `sepmc.analysis.variance_indices.ESTIMATORS`: a sampler, or
        a plan whose other inputs are drawn at random."""
        sampler = self.scene.run.sampler
        return PLAN if self.file.input_table and sampler in ("random", LHS) else sampler

    @property
    def correlated(self) -> list[list[str]]:
        """Columns of inputs that the file lets vary together, group by group."""
        laws = self.file.dispersions
        return [[laws[k].parameter.column for k in c.places] for c in self.file.copulas]

    def case(self, number: int, seed: int | None = None, total: int | None = None) -> Case:
        """Case ``number`` of the campaign, or of so many cases in ``total``, fully resolved in SI,
        drawn without the others. Raises InputError if there is no such case: a Latin hypercube or
        a Saltelli design has no other cases than its own."""
        total = self.scene.run.cases if total is None else total
        of_its_size = self.scene.run.sampler in cases.OF_ITS_SIZE
        number = check_int("case", number, 0, (total if of_its_size else CASES) - 1)
        drawn = self.sample(number, 1, seed, total)[0]
        values = {
            d.parameter.path: float(x)
            for d, x in zip(self.file.dispersions, drawn * self.factors, strict=True)
        }
        return Case(
            number,
            parameters.replace(self.nominal().scene, values),
            {c.name: float(x) for c, x in zip(self.input_columns, drawn, strict=True)},
        )

    def nominal(self) -> Case:
        """The case without dispersion, number -1. What all cases share is pinned: the zero of
        ``alpha_ref``, the sign of apart."""
        initial = self.scene.initial
        if initial.path_reference is None:
            initial = msgspec.structs.replace(initial, path_reference=initial.pitch - initial.alpha)
        joints = {
            name: msgspec.structs.replace(joint, apart=separation_sign(self.scene, name))
            for name, joint in self.scene.joint.items()
        }
        return Case(-1, msgspec.structs.replace(self.scene, initial=initial, joint=joints), {})

    def _seed(self, seed: int | None) -> int:
        return self.scene.run.seed if seed is None else check_int("seed", seed, 0, SEED)

    def implausible_inertias(self, drawn: np.ndarray) -> int:
        """Number of rows of a case table (n, d) in which some body's inertia breaks the triangle
        inequality."""
        place = {d.parameter.path: i for i, d in enumerate(self.file.dispersions)}
        broken = np.zeros(len(drawn), dtype=bool)
        for name in self.scene.body:
            prefixes = (f"body.{name}.inertia.", f"body.{name}.inertia_products.")
            if any(path.startswith(prefixes) for path in place):
                values = {
                    path: drawn[:, place[path]] * self.factors[place[path]]
                    if path in place
                    else parameters.value(self.scene, path)
                    for path in (
                        prefix + part
                        for prefix, parts in zip(prefixes, _TENSOR_PARTS, strict=True)
                        for part in parts
                    )
                }
                tensors = np.moveaxis(
                    tensor(*[np.broadcast_to(v, len(drawn)) for v in values.values()]), -1, 0
                )
                principal = np.linalg.eigvalsh(tensors)
                broken |= (principal[:, 0] > 0.0) & breaks_triangle(principal)
        return int(np.count_nonzero(broken))
