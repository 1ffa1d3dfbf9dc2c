"""Stresses of inputs that no dispersion should sample (not finite, not physical, absurdly large),
and of scenes that must be refused. Every stress is a function that simulates such cases and returns
their judged lines."""

import copy
import math
from dataclasses import replace
from typing import Any

import numpy as np

from sepmc.campaign.campaign import Campaign
from sepmc.campaign.execution import step_selection
from sepmc.engine.dispatch import Block, interpreted, load_kernel
from sepmc.kernel.spec.parameter_layout import make_parameter_layout
from sepmc.scene.dispersion import Dispersion
from sepmc.scene.messages import SceneError
from sepmc.scene.parameters import Parameter
from sepmc.scene.read import parse_campaign
from sepmc.schema import Status
from sepmc.validation.stresses.line import EXACT, FORM, NONE, Bound, Stress, beyond
from sepmc.validation.stresses.scenes import Tree, make, pair, pushed

HUGE, TINY = 1e300, 1e-300


class _Varied:
    """Scene in which every number that may vary is an input of the kernel. The kernel runs as plain
    Python, in steps of the length that the scene gives; ``nominal`` has the nominal value of each
    input, SI, by path."""

    def __init__(self, tree: Tree):
        file = parse_campaign(copy.deepcopy(tree), "stress", None)
        layout = make_parameter_layout(file.scene)
        self.nominal = {
            path: float(layout.nominal[slot])
            for path, slot in layout.slots.items()
            if not path.startswith("run.")
        }
        dispersions = [
            Dispersion(Parameter(path, path, "", 1.0, None), "constant", (value,))
            for path, value in self.nominal.items()
        ]
        self.campaign = Campaign(replace(file, dispersions=tuple(dispersions)))
        with interpreted():
            kernel = load_kernel(step_selection.kernel_text(self.campaign))
        steps, durations = (
            np.ones(kernel.n_segments, dtype=np.int64),
            np.full(kernel.n_segments, math.inf),
        )
        self.integration = step_selection.Integration(
            kernel=kernel, steps=steps, durations=durations, step=file.scene.solver.step
        )

    def simulate(self, changed: list[dict[str, float]]) -> Block:
        """Integrate one case for each entry of ``changed``, with the values in it, SI, by path, and
        all others nominal; return the block of results."""
        return step_selection.integrate(
            self.campaign,
            self.integration,
            np.array([list((self.nominal | values).values()) for values in changed]),
        )

    def row(self, block: Block, i: int) -> dict[str, float]:
        """Outcomes and audit values of case ``i`` of a block, by column name, but in SI units,
        whatever the unit in the name."""
        return {
            c.name: x for c, x in zip(self.campaign.result_columns, block.outcomes[i], strict=True)
        }

    def line(
        self,
        label: str,
        quantity: str,
        error: float,
        bound: Bound,
        block: Block,
        i: int,
        resolved: bool = False,
    ) -> Stress:
        """Line of `sepmc stress` on case ``i`` of a block, with its status and, if that is ok, its
        audit columns beyond their bounds.

        ``label`` names the hard input. With ``resolved`` the line passes only if it is accurate,
        else also if it is flagged. ``quantity``, ``error`` and ``bound`` are as in `Stress`.
        """
        status = Status(int(block.status[i])).label
        return Stress(
            label,
            quantity,
            error,
            bound,
            status,
            beyond(self.row(block, i)) if status == Status.OK.label else (),
            resolved,
        )


def _varied() -> _Varied:
    """Scene with many inputs: two bodies, the second with aerodynamics, a motor, a spring with a
    stroke, a load, and a joint that is released."""
    tree = pushed(0.04, end=0.4, spring={"stroke_m": 0.1, "stiffness_N_per_m": 1.0})
    air = {
        "reference_area_m2": 0.1,
        "reference_length_m": 1.0,
        "axial": {"const": 0.3},
        "normal": {"alpha": 1.0},
    }
    tree["body"]["aft"]["aerodynamics"] = air
    tree["environment"] = {"atmosphere": "us1976", "gravity": "inverse-square"}
    tree["initial"] |= {"altitude_m": 20_000.0, "speed_m_s": 500.0}
    tree["motor"] = [
        {
            "name": "retro",
            "body": "aft",
            "thrust_N": 5.0,
            "build_up_s": 0.1,
            "burn_s": 0.2,
            "tail_off_s": 0.1,
            "station_m": 3.5,
        }
    ]
    tree["load"] = [
        {"name": "side", "body": "aft", "force_N": [0.0, 0.1, 0.0], "start_s": 0.1, "end_s": 0.3}
    ]
    return _Varied(tree)


def not_finite() -> list[Stress]:
    """Lines of `sepmc stress` on NaN and infinities in every input in turn, each of which must be
    flagged, and on a valid case before and after them in the block, which must not change. Of each
    of the three values there is one line for all inputs, one for the valid cases, and one for each
    input whose case is ok in spite of the value."""
    varied, lines = _varied(), []
    count, alone = len(varied.nominal), varied.simulate([{}])
    for value in (math.nan, math.inf, -math.inf):
        block = varied.simulate([{}, *({path: value} for path in varied.nominal), {}])
        for i, path in enumerate(varied.nominal, 1):
            if int(block.status[i]) == Status.OK:
                lines.append(varied.line(f"{path} = {value}", "any", math.nan, NONE, block, i))
        lines.append(
            varied.line(
                f"{value} in {count} parameters in turn", "any", math.nan, NONE, block, count
            )
        )
        error = float(np.nanmax(np.abs(block.outcomes[[0, -1]] - alone.outcomes)))
        lines.append(
            varied.line(f"valid cases beside {value}", "all outcomes", error, EXACT, block, 0, True)
        )
    return lines


def not_physical() -> list[Stress]:
    """Lines of `sepmc stress` on impossible masses and inertias, each of which must be flagged."""
    varied, lines = _varied(), []
    for path, values in (
        ("body.aft.mass", (0.0, -0.0, -1.0)),
        ("body.aft.inertia.xx", (0.0, -1.0)),
        ("body.aft.inertia_products.xy", (2.0, 1e6)),
        ("body.aft.inertia_factor", (0.0, -1.0)),
    ):
        block = varied.simulate([{path: value} for value in values])
        lines += [
            varied.line(f"{path} = {value:g}", "any", math.nan, NONE, block, i)
            for i, value in enumerate(values)
        ]
    return lines


def absurd() -> list[Stress]:
    """Three lines of `sepmc stress` on every input in turn at 1e300, -1e300 and 1e-300: number of
    cases that are not flagged and have an outcome that is not finite, which must be 0. Times of
    releases and of ends of strokes may be NaN."""
    varied, lines = _varied(), []
    # without calibration cases there is no error estimate
    needed = [
        c.name
        for c in varied.campaign.result_columns
        if not c.name.endswith(("release_time_s", "stroke_end_time_s")) and c.name != "error"
    ]
    for value in (HUGE, -HUGE, TINY):
        block, faults = varied.simulate([{path: value} for path in varied.nominal]), []
        for i, path in enumerate(varied.nominal):
            row = varied.row(block, i)
            if (
                int(block.status[i]) == Status.OK
                and not beyond(row)
                and not all(math.isfinite(row[name]) for name in needed)
            ):
                faults.append(path)
        label = f"{value:.0e} in {len(varied.nominal)} parameters" + (
            f", {faults[0]}" if faults else ""
        )
        lines.append(
            Stress(label, "ok, not finite: cases", float(len(faults)), EXACT, Status.OK.label)
        )
    return lines


def rods_without_length() -> list[Stress]:
    """Lines of `sepmc stress` on the length error of a rod whose ends a dispersion brings together,
    or nearly: rods of 1 mm and more must be accurate, shorter ones may be flagged. (In a file, a
    rod without length is refused.)"""
    tree = pair("rod", end=0.2, step=0.01)
    tree["joint"]["link"]["second_point_m"] = [2.5, 0.1, 0.0]
    varied, lines = _Varied(tree), []
    lengths = (0.5, 1e-3, 1e-6, 1e-9, 1e-12, 1e-15, 0.0)
    block = varied.simulate([{"joint.link.point.x": 2.5 - length} for length in lengths])
    for i, length in enumerate(lengths):
        error = varied.row(block, i)["joint_gap_residual_m"]
        lines.append(
            varied.line(
                f"rod dispersed to {length:g} m", "length, m", error, FORM, block, i, length >= 1e-3
            )
        )
    return lines


def _refusal(label: str, tree: Tree) -> Stress:
    """Line of `sepmc stress` on the scene ``tree``, with the input ``label``: it is flagged
    "refused" if reading the scene raises SceneError, else its verdict is SILENT."""
    try:
        make(tree)
    except SceneError:
        return Stress(label, "any", math.nan, NONE, "refused")
    return Stress(label, "any", math.nan, NONE, Status.OK.label)


def refused() -> list[Stress]:
    """Lines of `sepmc stress` on impossible scenes, which must be refused when they are read."""

    def with_(path: str, value: Any) -> Tree:
        """Tree of a weld of two bodies with the value at ``path`` replaced."""
        tree = copy.deepcopy(pair("fixed"))  # other stresses share its bodies
        *keys, last = path.split(".")
        node = tree
        for key in keys:
            node = node[key]
        node[last] = value
        return tree

    rod = pair("rod")
    rod["joint"]["link"]["second_point_m"] = rod["joint"]["link"]["point_m"]
    return [
        _refusal("rod without length, in the scene file", rod),
        _refusal(
            "singular inertia, in the scene file", with_("body.aft.inertia_kg_m2", [0.0, 1.0, 1.0])
        ),
        _refusal(
            "inertia of no body, in the scene file",
            with_("body.aft.inertia_kg_m2", [1.0, 1.0, 3.0]),
        ),
        _refusal("mass NaN, in the scene file", with_("body.aft.mass_kg", math.nan)),
        _refusal(
            "rate infinite, in the scene file", with_("initial.omega_rad_s", [math.inf, 0.0, 0.0])
        ),
        _refusal("step 0, in the scene file", with_("solver.step_s", 0.0)),
        _refusal(
            "parallel joint axes, in the scene file", with_("joint.link.y_axis", [1.0, 0.0, 0.0])
        ),
    ]
