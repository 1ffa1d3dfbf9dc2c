"""Air: the 1976 standard atmosphere layer by layer, tables of air and wind, aerodynamic
coefficients."""

import itertools
import math
from collections.abc import Collection
from typing import Any

import numpy as np
from scipy.interpolate import CubicHermiteSpline, CubicSpline, PchipInterpolator, make_interp_spline

from oracles.independent.case import COEFFICIENTS, DERIVATIVES, Table
from oracles.independent.state import Array
from sepmc.validation.classical_loads import EARTH_RADIUS, LAYER_BASE, LAYER_LAPSE, polynomial

_GAS, _GRAVITY = 8314.32 / 28.9644, 9.80665  # J/(kg K), m/s2
# base heights of the layers, m; the last is the top
EDGES = EARTH_RADIUS * LAYER_BASE / (EARTH_RADIUS - LAYER_BASE)
EDGES[-1] = 86000.0  # its geopotential height is printed rounded


def _in_layer(
    geopotential: float, layer: int, temperature: float, pressure: float
) -> tuple[float, float]:
    """Temperature, K, and pressure, Pa, in a layer from those at its base; equations 23 and 33 of
    the standard."""
    rise, lapse = geopotential - LAYER_BASE[layer], LAYER_LAPSE[layer]
    hotter = temperature + lapse * rise
    if lapse == 0.0:
        return hotter, pressure * math.exp(-_GRAVITY * rise / (_GAS * temperature))
    return hotter, pressure * (temperature / hotter) ** (_GRAVITY / (_GAS * lapse))


_BASES = [(288.15, 101325.0)]
for _layer, _top in enumerate(LAYER_BASE[1:-1]):
    _BASES.append(_in_layer(_top, _layer, *_BASES[-1]))


class Standard:
    """US Standard Atmosphere 1976."""

    edges = EDGES

    def at(self, height: float, layer: int) -> tuple[float, float]:
        """Density, kg/m3, and speed of sound, m/s, at a height, m, by the formula of a layer;
        extrapolates beyond the edges of the layer."""
        temperature, pressure = _in_layer(
            EARTH_RADIUS * height / (EARTH_RADIUS + height), layer, *_BASES[layer]
        )
        return pressure / (_GAS * temperature), math.sqrt(1.4 * _GAS * temperature)


class Tabled:
    """Air tabulated over height: the logarithm of density and the speed of sound between rows."""

    def __init__(self, table: Table):
        self.edges = np.array([table["altitude"][0], table["altitude"][-1]])
        sound_speed = table["speed_of_sound"] or (1.0,) * len(table["altitude"])
        self.curve = curve(
            table["altitude"],
            np.transpose([np.log(table["density"]), sound_speed]),
            table["interpolation"],
        )

    def at(self, height: float, _layer: int) -> tuple[float, float]:
        """Density, kg/m3, and speed of sound, m/s, at a height, m; 1 m/s if the table has no speed
        of sound."""
        logarithm, sound_speed = self.curve(height)
        return math.exp(logarithm), sound_speed


class Wind:
    """Wind velocity in ground axes: a steady part and a profile over height, constant beyond its
    ends."""

    def __init__(self, table: Table):
        self.steady = _level(table["speed"], table["direction"])
        self.curve, profile = None, table["profile"]
        if profile:
            factor, turn = profile["factor"], profile["turn"]
            self.turn = np.array(
                [
                    [math.cos(turn), 0.0, -math.sin(turn)],
                    [0.0, 1.0, 0.0],
                    [math.sin(turn), 0.0, math.cos(turn)],
                ]
            )
            rows = [
                _level(factor * speed, direction)
                for speed, direction in zip(profile["speed"], profile["direction"], strict=True)
            ]
            self.curve, self.ends = (
                clamped_curve(profile["altitude"], rows, profile["interpolation"]),
                (profile["altitude"][0], profile["altitude"][-1]),
            )

    def at(self, height: float) -> Array:
        """Wind velocity, m/s, ground axes, at a height, m."""
        return (
            self.steady
            if self.curve is None
            else self.steady + self.turn @ self.curve(min(max(height, self.ends[0]), self.ends[1]))
        )


def _level(speed: float, direction: float) -> Array:
    """Horizontal velocity (3,), m/s, from speed, m/s, and direction, rad."""
    return speed * np.array([math.cos(direction), 0.0, math.sin(direction)])


def curve(points: Array, rows: Array, interpolation: str) -> Any:
    """Function through ``rows`` at ``points``: a spline, lines, or cubics without overshoot."""
    if interpolation == "linear":
        return make_interp_spline(points, np.array(rows, float), k=1)
    if interpolation == "monotone":
        return PchipInterpolator(points, np.array(rows, float))
    return CubicSpline(points, np.array(rows, float))


def clamped_curve(points: Array, rows: Array, interpolation: str) -> Any:
    """Function through ``rows``, continued as a constant: with zero slope at both ends unless it is
    made of lines."""
    values = np.array(rows, float)
    if interpolation == "linear":
        return curve(points, values, interpolation)
    if interpolation == "monotone":
        slopes = PchipInterpolator(points, values).derivative()(points)
        slopes[[0, -1]] = 0.0
        return CubicHermiteSpline(points, values, slopes)
    return CubicSpline(points, values, bc_type="clamped")


def _monotone(axes: list[Array], rows: Array, point: list[float], flat_ends: bool = False) -> Array:
    """Values (functions,) at a point of rows (n1, n2, ..., functions): the slopes along the first
    axis are interpolated along the others as the values are."""
    if not axes:
        return rows
    slopes = PchipInterpolator(axes[0], rows).derivative()(axes[0])
    if flat_ends:
        slopes[[0, -1]] = 0.0
    here, there = (
        np.moveaxis(_monotone(axes[1:], np.moveaxis(each, 0, -1), point[1:], flat_ends), -1, 0)
        for each in (rows, slopes)
    )
    return np.asarray(CubicHermiteSpline(axes[0], here, there)(point[0]))


class Increments:
    """Increments of the six coefficients over a separation distance or a relative motion, constant
    beyond the ends."""

    def __init__(self, table: Table):
        axes = {"distance": table["distance"]} if table["axes"] is None else table["axes"]
        self.axes = {name: np.array(points, float) for name, points in axes.items() if points}
        zero = np.zeros([len(points) for points in self.axes.values()])
        grids = [np.array(table[key] or zero, float) for key in COEFFICIENTS]
        self.rows = np.moveaxis(np.array(grids), 0, -1)
        self.interpolation = table["interpolation"]
        self.factor = table["factor"]
        self.cardinals = [
            clamped_curve(points, np.eye(len(points)), self.interpolation)
            for points in self.axes.values()
        ]

    def at(self, motion: dict[str, float]) -> Array:
        """Increments (6,) at a separation distance, m, or a relative motion, m and rad."""
        point = [
            min(max(motion[name], points[0]), points[-1]) for name, points in self.axes.items()
        ]
        if self.interpolation == "monotone":
            return self.factor * _monotone(list(self.axes.values()), self.rows, point, True)
        rows = self.rows
        for cardinal, x in zip(self.cardinals, point, strict=True):
            rows = np.tensordot(cardinal(x), rows, 1)
        return self.factor * rows


def _by_rate(
    terms: dict[str, float] | None, signals: Collection[str]
) -> list[tuple[str, float, str]]:
    """Terms of a polynomial without their rate or signal, coefficients, and rates p, q, r, signals
    or none."""
    result = []
    for term, value in (terms or {}).items():
        if term in signals:
            result.append(("const", value, term))
            continue
        *angles, last = term.split("_")
        rate = last if last in ("p", "q", "r") else ""
        result.append(("_".join(angles) or "const" if rate else term, value, rate))
    return result


def _factors(term: str, value: float) -> tuple[float, int, int]:
    """Coefficient and powers of alpha and beta of a term."""
    return polynomial({term: value})[0]


class Coefficients:
    """C_A, C_N, C_Y, C_l, C_n, C_m of a body: polynomials of alpha, beta, reduced rates and signals
    plus a table over Mach, alpha and beta."""

    def __init__(self, table: Table, signals: Collection[str]):
        self.terms = [
            [(*_factors(term, value), rate) for term, value, rate in _by_rate(table[key], signals)]
            for key in COEFFICIENTS
        ]
        # axis (0 Mach, 1 alpha, 2 beta) and its points
        self.axes: list[tuple[int, Array]] = []
        self.grid = None
        if table["table"]:
            axes = [np.array(table["table"][key], float) for key in ("mach", "alpha", "beta")]
            shape = tuple(max(1, len(points)) for points in axes)
            zero = np.zeros(shape)
            # the derivatives that a table has come after the coefficients
            self.derivatives = [key for key in DERIVATIVES if table["table"][key]]
            self.grid = np.array(
                [
                    np.reshape(table["table"][key] or zero, shape)
                    for key in (*COEFFICIENTS, *self.derivatives)
                ]
            )
            self.axes = [(i, points) for i, points in enumerate(axes) if len(points) > 1]
            self.interpolation = table["table"]["interpolation"]
            self.cardinals = [
                curve(points, np.eye(len(points)), self.interpolation) for _, points in self.axes
            ]

    def at(self, mach: float, alpha: float, beta: float, rates: dict[str, float]) -> Array:
        """Coefficients (6,) at a Mach number, angles alpha and beta, rad, and the reduced rates p,
        q, r and signals."""
        coefficients = np.array(
            [
                sum(c * alpha**i * beta**j * (rates[r] if r else 1.0) for c, i, j, r in terms)
                for terms in self.terms
            ],
            float,
        )
        if self.grid is None:
            return coefficients
        grid, flow = self.grid, (mach, alpha, beta)
        if self.interpolation == "monotone":
            axes = [points for _, points in self.axes]
            rows = grid.reshape(len(grid), *map(len, axes))
            grid = _monotone(axes, np.moveaxis(rows, 0, -1), [flow[i] for i, _ in self.axes])
        else:
            for (i, _), cardinal in zip(reversed(self.axes), reversed(self.cardinals), strict=True):
                grid = np.tensordot(grid, cardinal(flow[i]), (i + 1, 0))
        values = grid.ravel()
        coefficients += values[:6]
        for key, value in zip(self.derivatives, values[6:], strict=True):
            coefficient, rate = key.split("_")
            coefficients[COEFFICIENTS.index(coefficient)] += value * rates[rate]
        return coefficients

    def beyond(self, mach: float, alpha: float, beta: float) -> list[float]:
        """Distance of the flow beyond each edge of the table; negative inside."""
        flow = (mach, alpha, beta)
        return list(
            itertools.chain(
                *((points[0] - flow[i], flow[i] - points[-1]) for i, points in self.axes)
            )
        )
