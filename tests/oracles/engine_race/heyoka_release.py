"""What happens at the release, as compiled functions of heyoka over many cases at once: its
instant, and one body becoming two."""

from typing import Any

import heyoka as hy

from oracles.engine_race.heyoka_terms import KM, times
from oracles.engine_race.vectors import Array

NEWTON = 6  # iterations, from the root of a parabola: the last changes nothing but round-off


def _polynomial(series: list[Any], h: Any) -> Any:
    value = series[-1]
    for coefficient in series[-2::-1]:
        value = value * h + coefficient
    return value


def at_root(count: int, place: int, order: int) -> Any:
    """Function of the series of ``count`` states (a row a coefficient) and the value sought of the
    one at ``place``.

    Returns the states where that one has its value, and then the time at which it does.
    """
    series = [[hy.expression(f"c{i:02d}_{k:02d}") for k in range(order + 1)] for i in range(count)]
    target = hy.expression("target")
    sought = [series[place][0] - target, *series[place][1:]]
    slope = [float(k) * c for k, c in enumerate(sought)][1:]
    a, b, c = sought[2], sought[1], sought[0]
    h = 2.0 * hy.sqrt(c * c) / (hy.sqrt(b * b) + hy.sqrt(b * b - 4.0 * a * c))
    for _ in range(NEWTON):
        h = h - _polynomial(sought, h) / _polynomial(slope, h)
    return hy.cfunc(
        [*(_polynomial(row, h) for row in series), h], [x for row in series for x in row] + [target]
    )


def parting(old: list[str], new: list[str]) -> Any:
    """Function of the states of the composite body and, behind them, shares and lateral distances:
    states of the two free bodies."""
    D, U, e, w = ([hy.expression(f"{name}{a}") for a in "xyz"] for name in "DUew")
    more = [hy.expression(name) for name in ("share_a", "share_b", "ry", "rz")]
    r = [hy.expression("rx"), *more[2:]]
    swing = times(w, r)
    swing[0] = swing[0] + hy.expression("vx")
    up = KM * hy.sum([x * y for x, y in zip(e, r, strict=True)])
    expressions: dict[str, Any] = {"L": hy.expression("L")}
    for tag, share in zip("ab", more[:2], strict=True):
        expressions[f"z{tag}"] = hy.expression("z") + share * up
        for i, a in enumerate("xyz"):
            expressions |= {f"U{tag}{a}": U[i], f"e{tag}{a}": e[i], f"w{tag}{a}": w[i]}
            expressions |= {f"X{tag}{a}": share * r[i], f"D{tag}{a}": D[i] + share * swing[i]}
    return hy.cfunc(
        [expressions[name] for name in new], [*(hy.expression(name) for name in old), *more]
    )


def evaluate(function: Any, rows: Array) -> Array:
    """A compiled function over rows (k, ...)."""
    return function(rows.reshape(len(rows), -1)).reshape(-1, *rows.shape[1:])
