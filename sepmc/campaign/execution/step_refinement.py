"""How short steps have to be for the outcomes of a case to settle, each by itself."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from sepmc.campaign.cases import extremes, quantile
from sepmc.campaign.execution.accuracy import decisive, errors, scales, scene_scales
from sepmc.engine.dispatch import status_in
from sepmc.kernel.spec.heights import rows_step
from sepmc.kernel.spec.methods import method
from sepmc.scene.dispersion import Dispersion
from sepmc.scene.model import Scene
from sepmc.schema import Column, Status

_TRANSIENTS = ("build_up", "tail_off")
# time constants after an ignition or a burn-out: there 2 % of the change are still to come
_SEEN = 4.0
_RARE = 0.001  # of the cases may have shorter ones than are looked for
_MOST_FIRST = 2**15  # steps that are tried first, however close the rows
HALVINGS = 9  # at most
# in a row: across a kink, such as the edge of a layer of air, errors do not fall evenly, and one
# may be luck
AGREEMENTS = 2
# halvings that may pass without the change falling to half: then round-off or a jump is what is
# left
_PATIENCE = 3
_FINE = 2.0**-6  # of the first step: halvings that did not help until here

_FLOWN = (Status.OK, Status.NEVER_RELEASED)
TOO_LONG = (Status.NOT_FINITE, Status.UNRESOLVED)  # a shorter step may help

# stages of a step that is far too long end so too
DOUBTFUL = (Status.OUTSIDE_ATMOSPHERE, Status.OUTSIDE_TABLE, Status.JAMMED)
_SURE = 64.0  # times as short are steps that tell whether a case truly ends so

# step and cases to outcomes (n, o) and status (n,)
Integrate = Callable[[float, np.ndarray], tuple[np.ndarray, np.ndarray]]


def longest_step(scene: Scene, laws: Sequence[Dispersion] = (), brief: float = 0.0) -> float:
    """Step, s, beyond which no stage of the method sees a thrust build up or tail off, or what
    stands between rows of a table over height: where that cancels otherwise, halving such a step
    tells nothing. Infinite if all thrusts are sudden or steady, or have time constants shorter than
    ``brief``, s, and no table is passed."""
    constants = [getattr(motor, key) for motor in scene.motor for key in _TRANSIENTS]
    constants += [
        float(quantile(d, np.array([_RARE]))[0] * d.parameter.factor)
        for d in laws
        if d.parameter.path.endswith(_TRANSIENTS)
    ]
    nodes = method(scene.solver.method).c
    transients = (
        _SEEN
        * min((x for x in constants if x > brief), default=math.inf)
        / float(nodes[nodes > 0.0].min())
    )
    return min(
        transients, max(rows_step(scene, extremes(scene, laws)), scene.run.end_time / _MOST_FIRST)
    )


@dataclass
class Converged:
    """Steps (n,) in s at which cases were flown last, the status (n,) they ended with, what the
    last halvings changed, (n, o), and whether that has settled, (n,)."""

    step: np.ndarray
    status: np.ndarray
    change: np.ndarray
    settled: np.ndarray


def changes(
    found: np.ndarray,
    status: np.ndarray,
    finer: np.ndarray,
    finer_status: np.ndarray,
    scale: np.ndarray,
    decides: np.ndarray,
) -> np.ndarray:
    """Errors (n, o) of outcomes against those at a finer resolution. In what ``decides`` (o,), a
    case that ends otherwise there is infinitely wrong, and one that both steps are too long for is
    wrong altogether. A case that cannot be flown has no error."""
    table = errors(found, finer, scale)
    table[(status == finer_status) & ~status_in(status, _FLOWN)] = 0.0
    table[np.ix_((status == finer_status) & status_in(status, TOO_LONG), decides)] = 1.0
    table[np.ix_(status != finer_status, decides)] = np.inf
    return table


def _too_early(
    integrate: Integrate, step: float, cases: np.ndarray, status: np.ndarray
) -> np.ndarray:
    """Which of some cases (n,) or draws (n, d), flown at a step, left the air or a table or jammed
    only because it is far too long."""
    found = status_in(status, DOUBTFUL)
    if found.any():
        found[found] = ~status_in(integrate(step / _SURE, cases[found])[1], DOUBTFUL)
    return found


def refine_steps(
    integrate: Integrate,
    count: int,
    step: float,
    goal: float,
    scale: np.ndarray,
    decides: np.ndarray,
    most_lost: int = HALVINGS,
    agreements: int = AGREEMENTS,
) -> Converged:
    """Halve the step of each of ``count`` cases until two halvings in a row, or as many as
    ``agreements``, change its outcomes by no more than the goal.

    ``fly`` is called with a step and the numbers of the cases that have not settled, so its last
    call for a case is at the step told. Outcomes that do not ``decides`` (o,) do not count. A case
    whose changes have stopped falling is left as it is, and so is one that is still lost after
    ``most_lost`` halvings.
    """
    left = np.arange(count)
    outcomes, status = integrate(step, left)
    early = _too_early(integrate, step, left, status)
    steps, change = np.full(count, step), np.full((count, len(scale)), np.inf)
    last, least = np.full((count, len(scale)), np.inf), np.full(count, np.inf)
    agreed, stale = np.zeros(count, dtype=int), np.zeros(count, dtype=int)
    for halving in range(1, HALVINGS + 1):
        step *= 0.5
        finer, finer_status = integrate(step, left)
        now = changes(outcomes[left], status[left], finer, finer_status, scale, decides)
        waiting = early[left] & status_in(finer_status, DOUBTFUL)
        now[np.ix_(waiting & (status[left] == finer_status), decides)] = 1.0
        worst = now[:, decides].max(axis=1, initial=0.0)
        agreed[left] = np.where(worst <= goal, agreed[left] + 1, 0)
        fell = (worst <= 0.5 * least[left]) | status_in(finer_status, TOO_LONG) | waiting
        stale[left] = np.where(fell, 0, stale[left] + 1)
        least[left] = np.where(worst > goal, np.minimum(worst, least[left]), least[left])
        first = np.isinf(last[left]) | (agreements == 1)
        change[left] = np.where(first, now, np.maximum(last[left], now))
        outcomes[left], status[left], steps[left], last[left] = finer, finer_status, step, now
        lost = (finer_status == Status.UNRESOLVED) & (halving >= most_lost)
        left = left[(agreed[left] < agreements) & (stale[left] < _PATIENCE) & ~lost]
        if not len(left):
            break
    return Converged(steps, status, change, agreed >= agreements)


def refine_case_steps(
    integrate: Integrate, step: float, scene: Scene, columns: list[Column]
) -> tuple[float, np.ndarray, list[str]]:
    """The longest of ``step``, half of it, ... at which one case has settled; by how much its
    outcomes (o,) still changed; what is to be told of that. ``fly`` takes a step and the case,
    number 0."""
    units, decides = [c.unit for c in columns], decisive(columns)
    one, goal = np.zeros(1, dtype=np.int64), scene.solver.accuracy
    least = step / 2.0**HALVINGS
    scale = scales(integrate(step, one)[0], units, scene_scales(scene, units))
    before, first = math.inf, step
    while True:
        found = refine_steps(integrate, 1, step, goal, scale, decides)
        step = float(found.step[0])
        change = np.where(decides, found.change[0], 0.0)
        if found.settled[0] and change.max() <= goal:
            return step, found.change[0], []
        step /= 2.0
        # each round is of several halvings: if the change is not half of what it was after the last
        # one, in steps that see what happens, more do not help
        if step < least or (step < _FINE * first and change.max() > 0.5 * before):
            break
        before = float(change.max())
    worst = int(change.argmax())
    return (
        2.0 * step,
        found.change[0],
        [
            f"a shorter step changes {columns[worst].name} by {change[worst]:.1e} of its size, "
            f"more than the accuracy {goal:g} that was "
            "asked, however short the step: the error of this case is about as large"
        ],
    )
