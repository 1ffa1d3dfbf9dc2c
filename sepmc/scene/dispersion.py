"""Dispersion of one parameter: its distribution in absolute numbers, in the unit of the TOML key,
computed from what a file gives and the nominal value."""

import math
from dataclasses import dataclass

import numpy as np

from sepmc.scene.fields import allowed
from sepmc.scene.input_table import InputTable, check_column
from sepmc.scene.messages import Problems
from sepmc.scene.model import Distribution, Scene
from sepmc.scene.parameters import Parameter, UnknownPath, find, value

DISTRIBUTIONS = ("uniform", "normal", "triangular", "discrete", "constant")

_CENTRED = ("uniform", "triangular", "normal")
# times the nominal: a relative distribution centred farther off was meant in the unit of its key
_FAR_FROM_NOMINAL = 10.0
_FARTHEST = 40.0  # sigma: beyond, the normal density underflows


@dataclass(frozen=True)
class Dispersion:
    """A parameter and its distribution.

    Attributes
    ----------
    parameter : Parameter
    distribution : str
        One of `DISTRIBUTIONS`, or "given" for quantiles of a column of ``run.samples``.
    numbers : tuple of float
        In the unit of the key. uniform: (low, high); normal: (mean, sigma, truncation in sigma or
        inf); triangular: (low, mode, high); discrete: the values; constant: (value,); given:
        quantiles at equal steps of probability.
    weights : tuple of float
        Of the values of a discrete distribution, in any scale; empty for other distributions.
    column : str
        Column of ``run.samples`` that gives each case its value; the distribution is then that of
        the column. Empty if the values are sampled.
    """

    parameter: Parameter
    distribution: str
    numbers: tuple[float, ...]
    weights: tuple[float, ...] = ()
    column: str = ""

    @property
    def sentence(self) -> str:
        """The dispersion as text: ``body.upper.mass_kg: uniform (438, 478)``, with all ``numbers``
        of the distribution in brackets; of a column of run.samples its name and support."""
        if self.column:
            low, high = self.support
            return f"{self.parameter.key}: column {self.column} of run.samples ({low:g}, {high:g})"
        weights = f", weights ({', '.join(f'{x:g}' for x in self.weights)})" if self.weights else ""
        return (
            f"{self.parameter.key}: {self.distribution} "
            f"({', '.join(f'{x:g}' for x in self.numbers)}){weights}"
        )

    @property
    def support(self) -> tuple[float, float]:
        """Smallest and largest possible value, in the unit of the key; infinite for a normal
        distribution without truncation whose sigma is not 0."""
        if self.distribution == "normal":
            mean, sigma, cut = self.numbers
            reach = sigma * cut if sigma > 0.0 else 0.0
            return mean - reach, mean + reach
        return min(self.numbers), max(self.numbers)

    @property
    def reach(self) -> tuple[float, float]:
        """Smallest and largest value to expect, in the unit of the key: the `support`, or mean -+ 3
        sigma for a normal distribution without truncation."""
        if self.distribution == "normal" and math.isinf(self.numbers[2]):
            mean, sigma, _ = self.numbers
            return mean - 3.0 * sigma, mean + 3.0 * sigma
        return self.support

    @property
    def has_tails(self) -> bool:
        """True for a normal distribution without truncation of a parameter that is a field of the
        model: the field may have bounds, which values in the tails violate."""
        return (
            self.distribution == "normal"
            and math.isinf(self.numbers[2])
            and self.parameter.field is not None
        )

    def beyond(self) -> tuple[float, float]:
        """Probability of values outside the bounds of the parameter, and the distance, in sigma,
        from the mean to the nearest such value: infinite if every value is within the bounds, 0 if
        the mean itself is outside. For distributions with `has_tails` only."""
        mean, sigma = self.numbers[:2]

        def fits(z: float) -> bool:
            return bool(self.allowed(np.array([mean + z * sigma]))[0])

        probability, nearest = 0.0, math.inf
        for side in (-_FARTHEST, _FARTHEST):
            low, high, within = 0.0, side, fits(0.0)
            if fits(side) != within:  # a bound lies between: bisect
                while abs(high - low) > _FARTHEST * 1e-12:
                    middle = 0.5 * (low + high)
                    low, high = (middle, high) if fits(middle) == within else (low, middle)
            elif within:
                continue
            tail = 0.5 * math.erfc(abs(high) / math.sqrt(2.0))
            probability += tail if within else 0.5 - tail
            nearest = min(nearest, abs(high))
        return probability, nearest if fits(0.0) else 0.0

    def allowed(self, values: np.ndarray) -> np.ndarray:
        """Mask (n,), True where ``values`` (n,), in the unit of the key, are finite and within the
        bounds of the parameter."""
        field = self.parameter.field
        return (
            np.isfinite(values)
            if field is None
            else allowed(field.type, values * self.parameter.factor)
        )


def resolve(
    scene: Scene,
    distributions: dict[str, Distribution],
    problems: Problems,
    table: InputTable | None = None,
) -> tuple[Dispersion, ...]:
    """Convert the distributions of a file, which may be relative to nominal values, to dispersions
    in absolute numbers.

    Parameters
    ----------
    scene : Scene
    distributions : dict
        By key of [dispersion], in the order of the file.
    problems : Problems
        Receives every problem; a distribution with one is left out of the result.
    table : InputTable, optional
        The table that ``run.samples`` names. A parameter whose column is in it takes its values
        from there, not from its distribution.

    Returns
    -------
    dispersions : tuple of Dispersion
    """
    dispersions: list[Dispersion] = []
    key_of_path: dict[str, str] = {}
    key_of_column: dict[str, str] = {}
    for key, distribution in distributions.items():
        key_path = f"dispersion.{key}"
        try:
            parameter = find(scene, key)
        except UnknownPath as error:
            problems.add(key_path, str(error.args[0]))
            continue
        if parameter.path in key_of_path:
            problems.add(key_path, f"given twice, also as {key_of_path[parameter.path]!r}")
            continue
        if is_structure(parameter.path):
            problems.add(key_path, "is a setting of the scene, which cannot vary from case to case")
            continue
        column = parameter.column
        if column in key_of_column:
            problems.add(
                key_path,
                f"would have the column {column}, which is that of {key_of_column[column]!r}: "
                "rename the table of one of these two parameters",
            )
            continue
        key_of_path[parameter.path] = key_of_column[column] = key
        if distribution.column is not None or (table and table.has(column)):
            dispersion = _from_column(distribution, parameter, table, key_path, problems)
        else:
            nominal = value(scene, parameter.path) / parameter.factor
            dispersion = _from_distribution(distribution, parameter, nominal, key_path, problems)
        if dispersion:
            dispersions.append(dispersion)
    return tuple(dispersions)


def _from_column(
    distribution: Distribution,
    parameter: Parameter,
    table: InputTable | None,
    key_path: str,
    problems: Problems,
) -> Dispersion | None:
    """Dispersion from a column of the table of samples: the ``column`` that the distribution names,
    else the one named like the parameter's column. None, after adding a problem, if it is not
    valid. If there is no table (None), a distribution that names a column is a problem; with one
    that names none, the caller must give a table."""
    if distribution.column is not None:
        if _given(distribution) or distribution.weights:
            problems.add(key_path, "give a column of run.samples or a distribution, not both")
            return None
        if table is None:
            reason = "needs run.samples, the table with this column"
            problems.add(f"{key_path}.column", reason, distribution.column)
            return None
    assert table is not None
    name = distribution.column or parameter.column
    if not check_column(table, name, key_path, problems):
        return None
    return Dispersion(parameter, *table.distribution(name), column=name)


def _given(distribution: Distribution) -> list[str]:
    """Names of the `DISTRIBUTIONS` that an entry of [dispersion] sets; valid is exactly one."""
    return [name for name in DISTRIBUTIONS if getattr(distribution, name) is not None]


def is_structure(path: str) -> bool:
    """True if the number at a path cannot be dispersed, because all cases share it: run and solver
    settings, clearances, outputs, ``apart`` and ``kind`` of a joint, numbers of pins, and
    ``initial.path_reference``."""
    parts = path.split(".")
    return (
        parts[0] in ("run", "solver", "clearance", "output")
        or (parts[0] == "joint" and parts[2] in ("apart", "kind"))
        or parts[:2] == ["initial", "path_reference"]
        or parts[-1] == "pins"
    )


def _from_distribution(
    spec: Distribution, parameter: Parameter, nominal: float, key_path: str, problems: Problems
) -> Dispersion | None:
    """Dispersion from the distribution ``spec`` of a file; ``nominal`` is the parameter's nominal
    value in the unit of its key. None, after adding a problem, if the distribution is not valid in
    itself; whether its values are within the bounds of the parameter is not checked here."""
    names = _given(spec)
    if len(names) != 1:
        problems.add(
            key_path,
            "give exactly one of "
            + ", ".join((*DISTRIBUTIONS, "column"))
            + (f", not {' and '.join(names)}" if names else ""),
        )
        return None
    name = names[0]
    scale = nominal if spec.relative else 1.0
    if spec.relative and nominal == 0.0:
        problems.add(
            key_path,
            "relative to a nominal of 0 is always 0; give the distribution in the unit of the key",
        )
        return None
    raw = getattr(spec, name)
    if spec.relative and isinstance(raw, tuple) and name in _CENTRED:
        centre = float(raw[0] if name == "normal" else raw[len(raw) // 2])
        if abs(centre) > _FAR_FROM_NOMINAL:
            problems.add(
                key_path,
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
            problems.add(key_path, "the half-width or sigma must be >= 0", raw)
        numbers = {
            "uniform": (nominal - width, nominal + width),
            "triangular": (nominal - width, nominal, nominal + width),
        }.get(name, (nominal, width))
    if name == "normal":
        if spec.relative and isinstance(raw, tuple):
            numbers = (numbers[0], float(raw[1]) * abs(nominal))
        if numbers[1] < 0.0:
            problems.add(key_path, "sigma must be >= 0", raw)
        numbers = (*numbers, spec.truncate_sigma or math.inf)
    elif spec.truncate_sigma is not None:
        problems.add(key_path, "truncate_sigma belongs to the normal distribution")
    if name in ("uniform", "triangular") and list(numbers) != sorted(numbers):
        if spec.relative and nominal < 0.0:
            numbers = tuple(sorted(numbers))
        else:
            problems.add(key_path, "must be low <= high, or low <= mode <= high", raw)
    if name == "discrete":
        weights = spec.weights or tuple(1.0 for _ in numbers)
        if (
            not numbers
            or len(weights) != len(numbers)
            or min(weights) < 0.0
            or not 0.0 < sum(weights) < math.inf
        ):
            problems.add(
                key_path,
                "discrete needs values; weights, if given, must be one for each value, >= 0, "
                "with a positive, finite sum",
            )
    elif spec.weights is not None:
        problems.add(key_path, "weights belong to the discrete distribution")
    if len(problems) > count:
        return None
    return Dispersion(parameter, name, numbers, weights)
