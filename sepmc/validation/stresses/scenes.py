"""Scenes of the stresses, as trees: the nested tables of a campaign file, with its keys and
units."""

import copy
from typing import Any

import numpy as np

from sepmc.campaign.campaign import Campaign
from sepmc.scene.read import parse_campaign
from sepmc.validation import references as ref
from sepmc.validation.flights import NominalRun, arm, tensor
from sepmc.validation.stresses.line import relative

Tree = dict[str, Any]
SPACE = {"atmosphere": "none", "gravity": "none"}


def body(
    mass: float,
    inertia: list[float],
    cg: list[float],
    products: list[float] | None = None,
    **other_tables: Any,
) -> Tree:
    """Table of a body: mass, kg, moments and products of inertia, kg m2 (None: no products), mass
    centre as a layout point, m; ``other_tables`` has further keys, as in a file."""
    return {
        "mass_kg": mass,
        "inertia_kg_m2": inertia,
        "inertia_products_kg_m2": products or [0.0, 0.0, 0.0],
        "cg_m": cg,
        **other_tables,
    }


def joint(first: str, second: str, point: list[float], **other_tables: Any) -> Tree:
    """Table of a joint between two bodies at a layout point, m; ``other_tables`` has further keys,
    as in a file."""
    return {"bodies": [first, second], "point_m": point, **other_tables}


def scene(
    bodies: Tree,
    joints: Tree,
    phases: list[Tree],
    end: float,
    step: float,
    omega: list[float] | None = None,
    **other_tables: Any,
) -> Tree:
    """Tree of a scene of bodies in empty space, at rest or with the rates ``omega``, rad/s; end
    time and step in s. ``other_tables`` has further tables, as in a file; of a table that is here
    already, only the keys that they give are replaced, also in the ``bodies`` and ``joints`` that
    the caller passed: nothing is copied."""
    tree: Tree = {
        "environment": dict(SPACE),
        "body": bodies,
        "joint": joints,
        "phase": phases,
        "initial": {"altitude_m": 0.0, "speed_m_s": 0.0, "omega_rad_s": omega or [0.0, 0.0, 0.0]},
        "run": {"end_time_s": end},
        "solver": {"step_s": step},
    }
    for key, value in other_tables.items():
        if isinstance(value, dict):
            tree.setdefault(key, {}).update(value)
        else:
            tree[key] = value
    return tree


def phase_of(**kinds: str) -> list[Tree]:
    """List of one phase, "held", without an end; each keyword is the name of a joint, and its value
    the kind."""
    return [{"name": "held", "joints": kinds}]


def make(tree: Tree) -> Campaign:
    """Campaign of a scene; the tree stays as it is. Raises SceneError if the scene is not valid."""
    return Campaign(parse_campaign(copy.deepcopy(tree), "stress", None))


def without_step(tree: Tree) -> Tree:
    """Copy of a tree without ``solver.step_s``, if it has that, so that its steps are converged to
    an accuracy of 1e-9. All tables but ``solver``, which must be there, are shared with the
    tree."""
    return tree | {
        "solver": {key: value for key, value in tree["solver"].items() if key != "step_s"}
    }


def simulate(tree: Tree, rows: int = 20) -> NominalRun:
    """Nominal run of a scene, with history rows at intervals of its end time over ``rows``, from 0
    to the end of the case, and two rows at each phase boundary."""
    campaign = make(tree)
    return NominalRun(campaign, campaign.scene.run.end_time / rows)


# Two bodies without equal numbers, from which the variations start.
FORE = body(3.0, [3.0, 4.0, 5.0], [1.0, 0.05, -0.02])
AFT = body(1.0, [1.0, 2.0, 2.2], [3.0, -0.04, 0.03], [0.2, -0.1, 0.15])
OMEGA = [0.9, -0.5, 0.7]


def pair(
    kind: str,
    end: float = 2.0,
    step: float = 0.02,
    fore: Tree = FORE,
    aft: Tree = AFT,
    **other_tables: Any,
) -> Tree:
    """Tree of two bodies, ``fore`` and ``aft``, turning at `OMEGA` in empty space, connected to the
    end by the joint ``link`` of a kind; end time and step in s. ``other_tables`` are other
    arguments of `scene`; ``omega`` among them replaces `OMEGA`."""
    tables = {"omega": OMEGA, **other_tables}
    return scene(
        {"fore": fore, "aft": aft},
        {"link": joint("fore", "aft", [2.0, 0.1, 0.0])},
        phase_of(link=kind),
        end,
        step,
        **tables,
    )


def pushed(
    stroke: float,
    kind: str = "slider",
    end: float = 1.0,
    step: float = 0.05,
    spring: Tree | None = None,
    **until: Any,
) -> Tree:
    """Tree of bodies ``fore`` (3 kg) and ``aft`` (1 kg) on the joint ``link`` of a kind, pushed
    apart along its x axis through both mass centres with 1.5 N: a relative acceleration of 2 m/s2.

    The joint is released at a stroke, m, or at a condition in ``until``, keys of the table of that
    name in a file, whichever is first.
    ``spring`` has other keys of the spring that pushes; end time and step in s.
    """
    push = {
        "name": "push",
        "bodies": ["fore", "aft"],
        "point_m": [2.0, 0.0, 0.0],
        "axis": [-1.0, 0.0, 0.0],
        "force_N": 1.5,
    }
    bodies = {
        "fore": body(3.0, [1.0, 2.0, 2.0], [1.0, 0.0, 0.0]),
        "aft": body(1.0, [1.0, 2.0, 2.0], [3.0, 0.0, 0.0]),
    }
    end_of = {"joint": "link", "stroke_m": stroke, **until}
    phases: list[Tree] = [
        {"name": "guided", "joints": {"link": kind}, "until": end_of},
        {"name": "free"},
    ]
    return scene(
        bodies,
        {"link": joint("fore", "aft", [2.0, 0.0, 0.0])},
        phases,
        end,
        step,
        spring=[push | (spring or {})],
    )


class Composite:
    """Closed form of a run without loads whose bodies are all welded together, and the errors of
    the run.

    ``rate`` (n, 3), rad/s, and ``attitude`` (n, 3, 3) are those of the composite body at the n
    times of the run. ``force``, N, and ``moment``, N m, (n, 3), body axes, are those of all welds
    on the body ``second``, the moment about the layout point ``point``.
    """

    def __init__(self, run: NominalRun, second: str, point: list[float]):
        scene_, self.run, self.second = run.scene, run, second
        names = list(scene_.body)
        positions, masses = (
            [-arm(scene_, b, point) for b in names],
            [scene_.body[b].mass for b in names],
        )
        tensors = [tensor(scene_, b) for b in names]
        combined, k = ref.composite(masses, tensors, positions), names.index(second)
        self.rate, self.attitude = ref.asymmetric_top(run.t, combined.inertia, scene_.initial.omega)
        self.force, self.moment = ref.weld_wrench(
            combined, masses[k], tensors[k], positions[k], np.zeros(3), self.rate
        )

    def rate_error(self, name: str | None = None) -> float:
        """Largest relative error (`relative`) of the angular rates of a body, by default of the
        second one, over the run."""
        return relative(self.run.body(name or self.second).w, self.rate)

    def attitude_error(self, name: str | None = None) -> float:
        """Largest relative error (`relative`) of the attitude matrices of a body, by default of the
        second one, over the run."""
        return relative(self.run.body(name or self.second).r, self.attitude)

    def force_error(self, joint_name: str = "link") -> float:
        """Largest relative error (`relative`) of the force of a joint on the second body over the
        run; the joint must be the only one of that body."""
        return relative(self.run.columns(f"{joint_name}_force_on_{self.second}_*_N"), self.force)
