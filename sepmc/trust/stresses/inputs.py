"""Case rows that no dispersion should draw: not finite, not physical, absurdly large; and scenes that must be refused."""

import math
from typing import Any

import numpy as np

from sepmc.campaign.campaign import Campaign
from sepmc.compiler.emit import emit
from sepmc.compiler.plan import Plan, make_plan
from sepmc.compiler.shape import make_shape
from sepmc.door import Block, fly_block, fly_specialised, interpreted, specialised_kernel, warm_up
from sepmc.kernels.layout import NO_HISTORY
from sepmc.scene.messages import SceneError
from sepmc.schema import Status, result_columns
from sepmc.trust.stresses.line import EXACT, NONE, Bound, Stress, beyond
from sepmc.trust.stresses.scenes import Tree, make, pair, pushed
from sepmc.trust.written import LEFT, WRITTEN, as_written

HUGE, TINY = 1e300, 1e-300


def _campaign() -> Campaign:
    """A scene with many parameters: two bodies with air, a motor, a spring with a stroke, a load, and a joint that is released."""
    tree = pushed(0.04, end=0.4, spring={"stroke_m": 0.1, "stiffness_N_per_m": 1.0})
    air = {"reference_area_m2": 0.1, "reference_length_m": 1.0, "axial": {"const": 0.3}, "normal": {"alpha": 1.0}}
    tree["body"]["aft"]["aerodynamics"] = air
    tree["environment"] = {"atmosphere": "us1976", "gravity": "inverse-square"}
    tree["initial"] |= {"altitude_m": 20_000.0, "speed_m_s": 500.0}
    tree["motor"] = [
        {"name": "retro", "body": "aft", "thrust_N": 5.0, "build_up_s": 0.1, "burn_s": 0.2, "tail_off_s": 0.1, "station_m": 3.5}
    ]
    tree["load"] = [{"name": "side", "body": "aft", "force_N": [0.0, 0.1, 0.0], "start_s": 0.1, "end_s": 0.3}]
    return make(tree)


def _block(plan: Plan, path: str, values: list[float]) -> Block:
    """Cases that differ in one parameter, SI."""
    warm_up()
    return fly_block(plan, np.array([plan.slots[path]]), np.array(values)[:, None], 0, 0, NO_HISTORY)


def _row(plan: Plan, block: Block, i: int) -> dict[str, float]:
    return {c.name: x for c, x in zip(result_columns(plan.contents), block.outcomes[i], strict=True)}


def _line(given: str, quantity: str, error: float, bound: Bound, plan: Plan, block: Block, i: int, resolved: bool = False) -> Stress:
    status = Status(int(block.status[i])).label
    return Stress(given, quantity, error, bound, status, beyond(_row(plan, block, i)) if status == Status.OK.label else (), resolved)


def not_finite() -> list[Stress]:
    """NaN and infinities in every parameter in turn, with a fair case before and after, which must not notice."""
    plan, lines = _campaign().plan, []
    for value in (math.nan, math.inf, -math.inf):
        fair: list[float] = []
        for path in plan.slots:
            at = float(plan.nominal[plan.slots[path]])
            block = _block(plan, path, [at, value, at])
            if int(block.status[1]) == Status.OK:
                lines.append(_line(f"{path} = {value}", "any", math.nan, NONE, plan, block, 1))
            if math.isfinite(at):
                alone = _block(plan, path, [at])
                fair += [float(np.nanmax(np.abs(block.outcomes[i] - alone.outcomes[0]))) for i in (0, 2)]
        lines.append(_line(f"{value} in {len(plan.slots)} parameters in turn", "any", math.nan, NONE, plan, block, 1))
        lines.append(_line(f"fair cases beside {value}", "all outcomes", max(fair), EXACT, plan, block, 0, True))
    return lines


def not_physical() -> list[Stress]:
    """Masses and inertias no body has: each is told."""
    plan, lines = _campaign().plan, []
    for path, values in (
        ("body.aft.mass", (0.0, -0.0, -1.0)),
        ("body.aft.inertia.xx", (0.0, -1.0)),
        ("body.aft.inertia_products.xy", (2.0, 1e6)),
        ("body.aft.inertia_factor", (0.0, -1.0)),
    ):
        block = _block(plan, path, list(values))
        lines += [_line(f"{path} = {value:g}", "any", math.nan, NONE, plan, block, i) for i, value in enumerate(values)]
    return lines


def absurd() -> list[Stress]:
    """Every parameter in turn at +-1e300 and 1e-300: what is called ok has finite outcomes."""
    plan, lines = _campaign().plan, []
    columns = [c.name for c in result_columns(plan.contents)]
    needed = np.array([not name.endswith("release_time_s") for name in columns])
    for value in (HUGE, -HUGE, TINY):
        worst, shown, faults = None, "", 0
        for path in plan.slots:
            block = _block(plan, path, [value])
            ok = int(block.status[0]) == Status.OK and not beyond(_row(plan, block, 0))
            bad = ok and not np.all(np.isfinite(block.outcomes[0][needed]))
            faults += bad
            if bad or worst is None:
                worst, shown = block, path
        assert worst is not None
        given = f"{value:.0e} in {len(plan.slots)} parameters" + (f", {shown}" if faults else "")
        lines.append(Stress(given, "ok, not finite: cases", float(faults), EXACT, Status.OK.label))
    return lines


def vouched() -> list[Stress]:
    """The same by a kernel written for that scene with every parameter dispersed: a row that it vouches for was given as a finite number,
    and has finite outcomes. All others are left to the general kernel."""
    campaign = as_written(_campaign())
    dispersed = frozenset(campaign.plan.slots)
    plan, lines = make_plan(campaign.scene, dispersed=dispersed), []
    with interpreted():
        kernel = specialised_kernel(emit(make_shape(plan, dispersed), campaign.scene.solver.method))
    steps, usual = np.full(kernel.stages, 4), np.full(kernel.stages, math.inf)
    names = [c.name for c in result_columns(plan.contents)]
    needed = np.array([not name.endswith("release_time_s") for name in names])
    nothing = np.empty(0, dtype=np.int64), np.empty((1, 0))
    fair = LEFT if fly_specialised(kernel, plan, steps, usual, *nothing)[0].status[0] else Status.OK.label
    lines.append(Stress("the same scene as it stands", "vouched for", 0.0, EXACT, fair, resolved=True, kernel=WRITTEN))
    for value in (math.nan, math.inf, HUGE, -HUGE):
        faults = []
        for path, slot in plan.slots.items():
            block, _ = fly_specialised(kernel, plan, steps, usual, np.array([slot]), np.array([[value]]))
            row = block.outcomes[0]
            ok = block.status[0] == Status.OK and not beyond(dict(zip(names, row, strict=True)))
            if ok and not (math.isfinite(value) and np.isfinite(row[needed]).all()):
                faults.append(path)
        given = f"{value:.0e} in {len(plan.slots)} parameters" + (f", {faults[0]}" if faults else "")
        lines.append(Stress(given, "ok, not finite: cases", float(len(faults)), EXACT, Status.OK.label, kernel=WRITTEN))
    return lines


def rods_without_length() -> list[Stress]:
    """A rod whose ends a dispersion brings together, or nearly: told in flight. By file it is refused."""
    tree = pair("rod", end=0.2, step=0.01)
    tree["joint"]["link"]["second_point_m"] = [2.5, 0.1, 0.0]
    plan, lines = make(tree).plan, []
    lengths = (0.5, 1e-3, 1e-6, 1e-9, 1e-12, 1e-15, 0.0)
    block = _block(plan, "joint.link.point.x", [2.5 - length for length in lengths])
    for i, length in enumerate(lengths):
        error = _row(plan, block, i)["joint_gap_residual_m"]
        lines.append(
            _line(
                f"rod dispersed to {length:g} m", "length, m", error, Bound(1e-10, "of every closed form"), plan, block, i, length >= 1e-3
            )
        )
    return lines


def _refusal(given: str, tree: Tree) -> Stress:
    """The line of a scene that must not be read."""
    try:
        make(tree)
    except SceneError:
        return Stress(given, "any", math.nan, NONE, "refused")
    return Stress(given, "any", math.nan, NONE, Status.OK.label)


def refused() -> list[Stress]:
    """Scenes that can only be wrong are refused when they are read."""

    def with_(path: str, value: Any) -> Tree:
        tree = pair("fixed")
        *keys, last = path.split(".")
        node = tree
        for key in keys:
            node = node[key]
        node[last] = value
        return tree

    rod = pair("rod")
    rod["joint"]["link"]["second_point_m"] = rod["joint"]["link"]["point_m"]
    return [
        _refusal("rod without length, by file", rod),
        _refusal("singular inertia, by file", with_("body.aft.inertia_kg_m2", [0.0, 1.0, 1.0])),
        _refusal("inertia of no body, by file", with_("body.aft.inertia_kg_m2", [1.0, 1.0, 3.0])),
        _refusal("mass NaN, by file", with_("body.aft.mass_kg", math.nan)),
        _refusal("rate infinite, by file", with_("initial.omega_rad_s", [math.inf, 0.0, 0.0])),
        _refusal("step 0, by file", with_("solver.step_s", 0.0)),
        _refusal("parallel joint axes, by file", with_("joint.link.y_axis", [1.0, 0.0, 0.0])),
    ]
