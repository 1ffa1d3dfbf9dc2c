"""One case by itself, with all there is to know of it over time: by the kernel written for its scene, as plain Python, or by the general
one."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from sepmc import schema
from sepmc.campaign.search import usual_lengths
from sepmc.campaign.settle import longest_step, settle_case, settle_one
from sepmc.compiler.emit import emit
from sepmc.compiler.plan import Plan, make_plan
from sepmc.compiler.shape import Shape, brief_transient, make_shape, reasons
from sepmc.door import fly_block, fly_everything, interpreted, specialised_kernel
from sepmc.kernels.layout import ANOTHER_KERNEL, FINER_STEPS, FULL_HISTORY
from sepmc.scene.model import Scene
from sepmc.schema import Column, Status

_FEWEST = 2  # steps of a stage that are tried first
_HOPELESS = 256  # with so many, a case that the kernel does not vouch for is none of its cases
_MOST = 2048  # steps of a stage: more take plain Python minutes, and the general kernel less
_SAME_TIME = 1e-12  # s
_NONE = np.empty((0, 3))  # instants of which rows are wanted


@dataclass
class Single:
    """A case that is flown: its outcomes and audit (o,) in SI, rows (n, columns) in SI at ``times`` (n,) and in ``phases`` (n,), by
    number, and what is to be told of it."""

    kernel: str
    plan: Plan
    status: Status
    outcomes: np.ndarray
    times: np.ndarray
    phases: np.ndarray
    rows: np.ndarray
    notes: list[str]


class _LostError(Exception):
    """The kernel does not vouch for the case."""


def fly_single(scene: Scene, columns: list[Column], every_s: float) -> Single | None:
    """A case, as ``scene`` has it, at the step that is given, or else in steps at which its outcomes (``columns``) have settled to the
    accuracy asked: a row every so many seconds, and two at each end of a phase. None if no kernel is written for the scene, or the kernel
    does not vouch for the case."""
    plan = make_plan(scene)
    if reasons(plan, frozenset()) or (scene.solver.step and scene.run.end_time / scene.solver.step > _MOST):
        return None
    shape = make_shape(plan)
    found = None if _lets_go_in_part(shape) else _fly_shape(shape, plan, columns, every_s)
    if found is None and shape.may_lose:
        shape = make_shape(plan, any_order=True)
        found = None if _lets_go_in_part(shape) else _fly_shape(shape, plan, columns, every_s)
    return found


def _lets_go_in_part(shape: Shape) -> bool:
    """Whether joints of which it is not known beforehand when they let go may go on holding something: that instant is not noted."""
    return shape.any_order and any(len(stage.may[joint]) > 1 + len(stage.free(joint)) for stage in shape.stages for joint in stage.masked)


def _fly_shape(shape: Shape, plan: Plan, columns: list[Column], every_s: float) -> Single | None:
    """`fly_single` by the kernel of a shape."""
    scene = plan.scene
    with interpreted():
        kernel = specialised_kernel(emit(shape, scene.solver.method, FULL_HISTORY))
    usual, ends = np.full(kernel.stages, np.inf), np.zeros(kernel.stages)
    one, notes = np.ones(kernel.stages, dtype=np.int64), list[str]()

    def flown(steps: np.ndarray, instants: np.ndarray = _NONE) -> tuple[np.ndarray, int, np.ndarray]:
        outcomes, status, ends[:], rows = fly_everything(kernel, plan, steps, usual, instants)
        if status in (Status.OK, Status.NEVER_RELEASED) and np.isinf(usual).all():
            usual[:] = usual_lengths(ends[:, None], np.ones(1, dtype=bool))
        return outcomes, status, rows

    if scene.solver.step is None:
        try:
            steps, notes = _settled(flown, one, scene, columns)
        except _LostError:
            return None
    else:
        steps = one
        flown(steps)  # to learn how long phases last
    releases = [place for place, column in enumerate(columns) if column.name.endswith("release_time_s")]
    found, status, rows = flown(steps)
    instants, phases = _instants(shape, np.fmin(ends, scene.run.end_time), found[releases], every_s)
    found, status, rows = flown(steps, instants)
    if status > Status.NEVER_RELEASED and scene.solver.step is None:  # the step in which it fails has no rows
        steps = np.maximum(steps, min(_MOST, math.ceil(scene.run.end_time / every_s)))
        found, status, rows = flown(steps, instants)
    if status < 0:
        return None
    there = ~np.isnan(rows).all(axis=1)
    return Single("written", plan, Status(status), found, instants[there, 0], phases[there], rows[there], notes)


def _settled(flown: Callable[[np.ndarray], Any], one: np.ndarray, scene: Scene, columns: list[Column]) -> tuple[np.ndarray, list[str]]:
    """Steps (stages,) at which a case has settled, and what is to be told of that; ``one`` step of every stage is (stages,) ones. Raises
    _LostError if the kernel does not vouch for the case."""
    fewest = max(_FEWEST, math.ceil(scene.run.end_time / longest_step(scene, brief=brief_transient(scene))))

    def tried(share: float, _: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        steps = round(fewest / share)
        if steps > _MOST:
            raise _LostError
        found, status, _ = flown(steps * one)
        if status == ANOTHER_KERNEL or (status == FINER_STEPS and steps >= max(_HOPELESS, 2 * fewest)):
            raise _LostError
        return found[None, : len(columns)], np.array([Status.UNRESOLVED if status < 0 else status])

    share, notes = settle_one(tried, 1.0, scene, columns)
    return round(fewest / share) * one, notes


def _instants(shape: Shape, ends: np.ndarray, releases: np.ndarray, every_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Times, stages and sides (n, 3) of the rows of a history, and their phases (n,), by number: every so many seconds, and both sides of
    the end of a phase and of the ``releases`` of joints within. A joint that is late is late in the phase after."""
    grid = np.arange(int(ends[-1] / every_s + 1e-9) + 1) * every_s
    found: list[tuple[float, int, int]] = []
    phases: list[int] = []
    begin = 0.0
    for number, (stage, end) in enumerate(zip(shape.stages, ends, strict=True)):
        late = 0.0 if stage.delay is None else float(shape.plan.nominal[stage.delay])
        for until, phase in ((max(begin, end - late), _phase(shape, number)), (end, _phase(shape, number + (stage.delay is not None)))):
            if until - begin > _SAME_TIME:
                changes = np.unique(releases[(releases > begin + _SAME_TIME) & (releases < until - _SAME_TIME)])
                steady = [t for t in grid if begin + _SAME_TIME < t < until - _SAME_TIME and (np.abs(changes - t) > _SAME_TIME).all()]
                rows = [(t, number, 0) for t in (begin, *steady, until)] + [(t, number, side) for t in changes for side in (-1, 1)]
                found += sorted(rows)
                phases += len(rows) * [phase]
                begin = until
    return np.array(found), np.array(phases)


def _phase(shape: Shape, number: int) -> int:
    """The phase of a stage; that in which joints are late is part of the next."""
    following = next(stage for stage in shape.stages[number:] if not stage.late)
    return [phase.name for phase in shape.scene.phase].index(following.phase)


def fly_single_generally(scene: Scene, columns: list[Column], every_s: float, unfit: np.ndarray) -> Single:
    """The same by the general kernel, at the step that is given if there is one; ``unfit`` (k,) are places of parameters that are none."""
    given = scene.solver.step or len(unfit)
    step, notes = (scene.solver.step, []) if given else settle_case(scene, columns)
    plan = make_plan(scene, history_step=every_s, step=step)
    counts = plan.model.scene[0]
    changes = counts.n_events + counts.n_joints * (counts.n_phases + counts.n_releases)  # each with a row before and one after
    room, width = int(scene.run.end_time / every_s) + 2 * int(changes) + 4, len(schema.history_columns(plan.contents))
    block = fly_block(plan, unfit, np.full((1, len(unfit)), np.nan), room, width, FULL_HISTORY)
    n, status = int(block.rows[0]), Status(int(block.status[0]))
    return Single("general", plan, status, block.outcomes[0], block.times[0, :n], block.phases[0, :n], block.history[0, :n], notes)
