"""How one parameter varies: a law resolved against its nominal, in the unit of its TOML key."""

import math
from dataclasses import dataclass

import numpy as np

from sepmc.scene.fields import allowed
from sepmc.scene.input_table import InputTable, check_column
from sepmc.scene.messages import Problems
from sepmc.scene.model import Law, Scene
from sepmc.scene.parameters import Parameter, UnknownPath, find, value

LAWS = ("uniform", "normal", "triangular", "discrete", "constant")

_CENTRED = ("uniform", "triangular", "normal")
_FAR_FROM_NOMINAL = 10.0  # times the nominal: a law so far off was meant in the unit of its key
_FARTHEST = 40.0  # sigma: beyond, a normal law has no values


@dataclass(frozen=True)
class Dispersion:
    """A parameter and its law.

    ``numbers`` by law, in the unit of the key: uniform (low, high); normal (mean, sigma, truncation
    in sigmas or inf); triangular (low, mode, high); discrete the values; constant (value,); given
    quantiles at equal steps of probability. Where a ``column`` of the plan gives each case its
    value, the law is how these are distributed.
    """

    parameter: Parameter
    law: str
    numbers: tuple[float, ...]
    weights: tuple[float, ...] = ()
    column: str = ""

    @property
    def sentence(self) -> str:
        """The law in words: ``body.upper.mass_kg: uniform (438, 478)``."""
        if self.column:
            low, high = self.support
            return f"{self.parameter.key}: column {self.column} of run.samples ({low:g}, {high:g})"
        weights = f", weights ({', '.join(f'{x:g}' for x in self.weights)})" if self.weights else ""
        return (
            f"{self.parameter.key}: {self.law} "
            f"({', '.join(f'{x:g}' for x in self.numbers)}){weights}"
        )

    @property
    def support(self) -> tuple[float, float]:
        """Smallest and largest value the law can give."""
        if self.law == "normal":
            mean, sigma, cut = self.numbers
            reach = sigma * cut if sigma > 0.0 else 0.0
            return mean - reach, mean + reach
        return min(self.numbers), max(self.numbers)

    @property
    def reach(self) -> tuple[float, float]:
        """As ``support``, but of a normal law that is not cut only three sigma: finite, and what
        nearly all cases stay within."""
        if self.law == "normal" and math.isinf(self.numbers[2]):
            mean, sigma, _ = self.numbers
            return mean - 3.0 * sigma, mean + 3.0 * sigma
        return self.support

    @property
    def has_tails(self) -> bool:
        """Whether the law, a normal one that is not cut, can give what its parameter may not be."""
        return (
            self.law == "normal"
            and math.isinf(self.numbers[2])
            and self.parameter.field is not None
        )

    def beyond(self) -> tuple[float, float]:
        """What share of values a law with tails gives that its parameter may not have, and how many
        sigma off its mean the nearest of them lies."""
        mean, sigma = self.numbers[:2]

        def fits(z: float) -> bool:
            return bool(self.allowed(np.array([mean + z * sigma]))[0])

        share, nearest = 0.0, math.inf
        for side in (-_FARTHEST, _FARTHEST):
            low, high, within = 0.0, side, fits(0.0)
            if fits(side) != within:  # a bound lies between
                while abs(high - low) > _FARTHEST * 1e-12:
                    middle = 0.5 * (low + high)
                    low, high = (middle, high) if fits(middle) == within else (low, middle)
            elif within:
                continue
            tail = 0.5 * math.erfc(abs(high) / math.sqrt(2.0))
            share, nearest = share + (tail if within else 0.5 - tail), min(nearest, abs(high))
        return share, nearest if fits(0.0) else 0.0

    def allowed(self, values: np.ndarray) -> np.ndarray:
        """Which of the values (n,), in the unit of the key, the parameter may have."""
        field = self.parameter.field
        return (
            np.isfinite(values)
            if field is None
            else allowed(field.type, values * self.parameter.factor)
        )


def resolve(
    scene: Scene, laws: dict[str, Law], problems: Problems, table: InputTable | None = None
) -> tuple[Dispersion, ...]:
    """Resolve the laws of a file against the scene's nominal values, and against the columns of a
    plan, which come before laws, noting every problem."""
    result: list[Dispersion] = []
    seen: dict[str, str] = {}
    columns: dict[str, str] = {}
    for key, law in laws.items():
        place = f"dispersion.{key}"
        try:
            parameter = find(scene, key)
        except UnknownPath as error:
            problems.add(place, str(error.args[0]))
            continue
        if parameter.path in seen:
            problems.add(place, f"given twice, also as {seen[parameter.path]!r}")
            continue
        if _is_structure(parameter.path.split(".")):
            problems.add(place, "is a setting of the scene, which cannot vary from case to case")
            continue
        if parameter.column in columns:
            problems.add(
                place,
                f"has the column {parameter.column}, as {columns[parameter.column]!r} has: rename "
                "one of their tables",
            )
            continue
        seen[parameter.path] = columns[parameter.column] = key
        if law.column is not None or (table and table.has(parameter.column)):
            given = _of_column(law, parameter, table, place, problems)
            result += [given] if given else []
            continue
        found = _resolve_one(
            law, parameter, value(scene, parameter.path) / parameter.factor, place, problems
        )
        if found:
            result.append(found)
    return tuple(result)


def _of_column(
    law: Law, parameter: Parameter, table: InputTable | None, place: str, problems: Problems
) -> Dispersion | None:
    """A parameter that takes its values from a column of the plan: one that is named, or that has
    the name of its own column in a case table."""
    if law.column is not None:
        if [name for name in LAWS if getattr(law, name) is not None] or law.weights:
            problems.add(place, "give a column of run.samples, or a law")
            return None
        if table is None:
            problems.add(f"{place}.column", "needs run.samples, the table that has it", law.column)
            return None
    assert table is not None
    name = law.column or parameter.column
    if not check_column(table, name, place, problems):
        return None
    return Dispersion(parameter, *table.law(name), column=name)


def _is_structure(parts: list[str]) -> bool:
    """Whether a path names a number that all cases share: run and solver settings, signs, the zero
    of alpha_ref."""
    return (
        parts[0] in ("run", "solver", "clearance", "output")
        or (parts[0] == "joint" and parts[2] in ("apart", "kind"))
        or parts[:2] == ["initial", "path_reference"]
        or parts[-1] == "pins"
    )


def _resolve_one(
    law: Law, parameter: Parameter, nominal: float, place: str, problems: Problems
) -> Dispersion | None:
    given = [name for name in LAWS if getattr(law, name) is not None]
    if len(given) != 1:
        problems.add(
            place,
            "give exactly one of "
            + ", ".join((*LAWS, "column"))
            + (f", not {' and '.join(given)}" if given else ""),
        )
        return None
    name = given[0]
    scale = nominal if law.relative else 1.0
    if law.relative and nominal == 0.0:
        problems.add(
            place, "relative to a nominal of 0 is always 0; give the law in the unit of the key"
        )
        return None
    raw = getattr(law, name)
    if law.relative and isinstance(raw, tuple) and name in _CENTRED:
        centre = float(raw[0] if name == "normal" else raw[len(raw) // 2])
        if abs(centre) > _FAR_FROM_NOMINAL:
            problems.add(
                place,
                f"relative = true multiplies all numbers by the nominal {nominal:g}: {centre:g} "
                f"becomes {centre * nominal:g}; give fractions of the nominal, near 1, or leave "
                "relative out",
                list(raw),
            )
            return None
    numbers = (
        tuple(float(x) * scale for x in raw) if isinstance(raw, tuple) else (float(raw) * scale,)
    )
    count = len(problems)
    weights: tuple[float, ...] = ()
    if name in ("uniform", "triangular", "normal") and not isinstance(raw, tuple):
        width = abs(numbers[0])
        if float(raw) < 0.0:
            problems.add(place, "the half-width or sigma must be >= 0", raw)
        numbers = {
            "uniform": (nominal - width, nominal + width),
            "triangular": (nominal - width, nominal, nominal + width),
        }.get(name, (nominal, width))
    if name == "normal":
        if law.relative and isinstance(raw, tuple):
            numbers = (numbers[0], float(raw[1]) * abs(nominal))
        if numbers[1] < 0.0:
            problems.add(place, "sigma must be >= 0", raw)
        numbers = (*numbers, law.truncate_sigma or math.inf)
    elif law.truncate_sigma is not None:
        problems.add(place, "truncate_sigma belongs to the normal law")
    if name in ("uniform", "triangular") and list(numbers) != sorted(numbers):
        if law.relative and nominal < 0.0:
            numbers = tuple(sorted(numbers))
        else:
            problems.add(place, "must rise from low to high", raw)
    if name == "discrete":
        weights = law.weights or tuple(1.0 for _ in numbers)
        if (
            not numbers
            or len(weights) != len(numbers)
            or min(weights) < 0.0
            or not 0.0 < sum(weights) < math.inf
        ):
            problems.add(
                place, "discrete needs values, and as many weights >= 0 with a positive, finite sum"
            )
    elif law.weights is not None:
        problems.add(place, "weights belong to the discrete law")
    if len(problems) > count:
        return None
    return Dispersion(parameter, name, numbers, weights)
