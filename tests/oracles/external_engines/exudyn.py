"""Simulation by Exudyn: redundant coordinates, its rigid bodies and joints, its implicit integrator
for index-3 systems.

J. Gerstmayr, "Exudyn - a C++-based Python package for flexible multibody systems", Multibody System
Dynamics 60, 2024. Bodies are `ObjectRigidBody` on nodes with Euler parameters, joints
`ObjectJointGeneric` (rods `ObjectConnectorDistance`), whose Lagrange multipliers are the joint
forces. The integrator is the generalised-alpha method, of second order; three runs with steps h,
h/2 and h/4 between the same switches, each with its own release times, are extrapolated to h = 0
(Richardson), which gives order four or better, and their spread is an error estimate.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from itertools import pairwise
from typing import Any

import exudyn as exu
import exudyn.itemInterface as items
import numpy as np
from scipy.optimize import brentq

from oracles.external_engines import loads
from oracles.external_engines.case import GROUND, Array, Case, Motion, cross
from oracles.external_engines.schedule import Guard, Mode, PeerFlight, Wrench
from oracles.external_engines.schedule import fly as fly_through

STEPS = 1000  # of the coarsest flight, over the whole time
LEAST = 8  # of its steps between two switches: after each, the method takes some to reach its order
# of Newton; the next one where round-off keeps it from converging, as in very short steps
TOLERANCES = (1e-12, 1e-10, 1e-8)
OUT = exu.OutputVariableType
CURRENT = exu.ConfigurationType.Current


def _settings(spectral_radius: float) -> Any:
    s = exu.SimulationSettings()
    s.solution.file.write = False
    s.solution.sensors.writePeriod = 1e9
    s.timeIntegration.verboseMode = 0
    s.timeIntegration.adaptiveStep = False
    s.timeIntegration.automaticStepSize = False
    s.timeIntegration.minimumStepSize = 1e-15
    s.timeIntegration.newton.useModifiedNewton = False
    s.timeIntegration.newton.absoluteTolerance = 1e-13
    s.timeIntegration.newton.maxIterations = 12
    s.timeIntegration.generalizedAlpha.spectralRadius = spectral_radius
    s.timeIntegration.generalizedAlpha.computeInitialAccelerations = True
    return s


class Exudyn:
    """One run: between switches, steps no longer than ``step`` (s) divided by ``refine``."""

    def __init__(self, case: Case, step: float, refine: int = 1, spectral_radius: float = 0.9):
        self.case, self.coarse, self.refine, self.mode, self.t = case, step, refine, Mode(), 0.0
        self.system = exu.SystemContainer()
        self.mbs = self.system.AddSystem()
        self.settings = _settings(spectral_radius)
        self.nodes: dict[str, Any] = {}
        self.objects: dict[str, Any] = {GROUND: self.mbs.AddObject(items.ObjectGround())}
        self.joints: dict[str, Any] = {}
        self.markers: dict[str, list[Any]] = {}  # of joints
        self.rods: dict[str, Any] = {}
        self._known: tuple[Any, Any] = (None, None)
        self._multipliers: dict[str, Wrench] = {}
        for name, motion in case.initial().items():
            if name != GROUND:
                self._add_body(name, motion)
        for name in case.joints:
            self._add_joint(name)
        self.mbs.Assemble()

    def _add_body(self, name: str, motion: Motion) -> None:
        body, mbs = self.case.bodies[name], self.mbs
        made = mbs.CreateRigidBody(
            inertia=exu.rigidBodyUtilities.RigidBodyInertia(
                mass=body.mass, inertiaTensor=body.inertia, com=[0.0, 0.0, 0.0]
            ),
            referencePosition=motion.x,
            referenceRotationMatrix=motion.R,
            initialVelocity=motion.v,
            initialAngularVelocity=motion.R @ motion.w,
            nodeType=exu.NodeType.RotationEulerParameters,
            returnDict=True,
        )
        self.objects[name], self.nodes[name] = made["bodyNumber"], made["nodeNumber"]
        marker = mbs.AddMarker(
            items.MarkerBodyRigid(bodyNumber=made["bodyNumber"], localPosition=[0.0, 0.0, 0.0])
        )
        mbs.AddLoad(
            items.LoadForceVector(
                markerNumber=marker,
                loadVectorUserFunction=lambda m, t, _, n=name: self._load(t, n, 0),
            )
        )
        mbs.AddLoad(
            items.LoadTorqueVector(
                markerNumber=marker,
                bodyFixed=True,
                loadVectorUserFunction=lambda m, t, _, n=name: self._load(t, n, 1),
            )
        )

    def _add_joint(self, name: str) -> None:
        joint = self.case.joints[name]
        places = self._places(name, (0, 1, 2))
        bodies = [self.objects[body] for body in (joint.first, joint.second)]
        markers = [
            self.mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=b, localHT=p))
            for b, p in zip(bodies, places, strict=True)
        ]
        self.markers[name] = markers
        if any(p.get("joints", {}).get(name) == "rod" for p in self.case.data["phase"]):
            self.rods[name] = self.mbs.AddObject(
                items.ObjectConnectorDistance(markerNumbers=markers, distance=joint.length)
            )
        else:
            self.joints[name] = self.mbs.AddObject(items.ObjectJointGeneric(markerNumbers=markers))

    def _places(self, name: str, order: tuple[int, int, int]) -> list[Array]:
        """Joint frame in the first and in the second body; the ground has the axes of the moving
        frame."""
        joint, axes = self.case.joints[name], _ordered(self.case.joints[name].axes, order)
        turns = [
            self.case.R0 if body == GROUND else np.eye(3) for body in (joint.first, joint.second)
        ]
        return [
            exu.HT(rotation=R @ axes, translation=R @ arm)
            for R, arm in zip(turns, (joint.arm_first, joint.arm_second), strict=True)
        ]

    def _set_joint(self, name: str, item: Any) -> None:
        """Set a generic joint to its kind in the mode."""
        held = self.case.held(name, self.mode.kinds[name])
        order = _axes_of(held)
        flags = [held[k] for k in order] + [held[3 + k] for k in order]
        self.mbs.SetObjectParameter(item, "constrainedAxes", [int(h) for h in flags])
        self.mbs.SetObjectParameter(item, "activeConnector", any(held))
        for marker, place in zip(self.markers[name], self._places(name, order), strict=True):
            self.mbs.SetMarkerParameter(marker, "localHT", place)

    def _load(self, t: float, name: str, part: int) -> Array:
        q = np.concatenate(
            [
                self.mbs.systemData.GetODE2Coordinates(),
                self.mbs.systemData.GetODE2Coordinates_t(),
                [t],
            ]
        )
        if self._known[0] is None or not np.array_equal(q, self._known[0]):
            self._known = (q, loads.body_loads(self.case, self.motions(t), t, self.mode))
        return self._known[1][name][part]

    def switch(self, mode: Mode) -> None:
        """Set every joint to its kind, then compute the accelerations and multipliers of the
        state."""
        self.mode, self._known = mode, (None, None)
        for name, item in self.joints.items():
            self._set_joint(name, item)
        for name, item in self.rods.items():
            self.mbs.SetObjectParameter(item, "activeConnector", mode.kinds[name] == "rod")
        self._settle()

    def _settle(self) -> None:
        """Compute Exudyn's initial accelerations and multipliers from positions and velocities."""
        state = self.mbs.systemData.GetSystemState(configuration=CURRENT)
        self._start(state, self.t + 1e-3, 1)
        solver = exu.MainSolverImplicitSecondOrder()
        if not solver.InitializeSolver(self.mbs, self.settings):
            raise RuntimeError(f"Exudyn: no initial accelerations at {self.t} s")
        self._multipliers = self._read_joints()
        solver.FinalizeSolver(self.mbs, self.settings)
        self.mbs.systemData.SetSystemState(state, configuration=CURRENT)

    def _start(self, state: Any, t_end: float, steps: int) -> None:
        self.mbs.systemData.SetSystemState(state, configuration=exu.ConfigurationType.Initial)
        s = self.settings.timeIntegration
        s.startTime, s.endTime, s.numberOfSteps = self.t, t_end, steps

    def _fly(self, state: Any, t_end: float, steps: int) -> None:
        """Integrate from a state at the present time, which is not changed."""
        for tolerance in TOLERANCES:
            self._start(state, t_end, steps)
            self.settings.timeIntegration.newton.relativeTolerance = tolerance
            try:
                self.mbs.SolveDynamic(
                    self.settings,
                    solverType=exu.DynamicSolverType.GeneralizedAlpha,
                    showHints=False,
                )
            except exu.SolverError:
                continue
            return
        raise RuntimeError(f"Exudyn: no convergence between {self.t} and {t_end} s")

    def advance(self, t_end: float, guards: list[Guard]) -> tuple[float, Guard | None]:
        """Integrate to ``t_end`` in equal steps; if a guard is passed, again in as many steps to
        the root of the integrated motion."""
        start, state = self.t, self.mbs.systemData.GetSystemState(configuration=CURRENT)
        steps = max(LEAST, math.ceil((t_end - start) / self.coarse - 1e-9)) * self.refine

        def fly_to(t: float) -> None:
            self.t = start
            if t > start:
                self._fly(state, t, steps)
            else:
                self.mbs.systemData.SetSystemState(state, configuration=CURRENT)
            self.t = t

        def value(guard: Guard) -> float:
            if guard.on_load:
                self._settle()
            return guard.value(self.case, self.motions(), self.t, wrenches=self._multipliers)

        def after(t: float, guard: Guard) -> float:
            fly_to(t)
            return value(guard)

        fly_to(t_end)
        passed = [g for g in guards if value(g) >= 0.0]
        roots = [
            (brentq(after, start, t_end, args=(g,), xtol=1e-14, rtol=1e-14), i)
            for i, g in enumerate(passed)
        ]
        stop, first = min(roots, default=(t_end, -1))
        if passed:
            fly_to(stop)
        self._settle()
        return stop, passed[first] if passed else None

    def motions(self, t: float | None = None) -> dict[str, Motion]:
        """Present motion of every body and of the ground; of the ground at ``t``, s, if given."""
        out = {GROUND: self.case.ground_motion(self.t if t is None else t)}
        for name, node in self.nodes.items():
            tell = self.mbs.GetNodeOutput
            R = np.array(tell(node, OUT.RotationMatrix)).reshape(3, 3)
            out[name] = Motion(
                tell(node, OUT.Position),
                tell(node, OUT.Velocity),
                R,
                tell(node, OUT.AngularVelocityLocal),
            )
        return out

    def _read_joints(self) -> dict[str, Wrench]:
        """Force and moment of every joint from its multipliers."""
        motions, out = self.motions(), {}
        for name, joint in self.case.joints.items():
            a, b = motions[joint.first], motions[joint.second]
            gap = a.R.T @ (b.point(joint.arm_second) - a.point(joint.arm_first))
            force, moment = np.zeros(3), np.zeros(3)  # on the second body, axes of the first
            if name in self.rods:
                if self.mode.kinds[name] == "rod":
                    force = -self._tell(self.rods[name], OUT.Force) * gap / np.linalg.norm(gap)
            elif any(self.case.held(name, self.mode.kinds[name])):
                held = self.case.held(name, self.mode.kinds[name])
                order = _axes_of(held)
                axes = _ordered(joint.axes, order)
                axes_b = a.R.T @ b.R @ axes
                force = -axes @ self._tell(self.joints[name], OUT.ForceLocal)
                multipliers = self._tell(self.joints[name], OUT.TorqueLocal)
                for k, (of_second, of_first) in _rotation_rows(
                    tuple(held[3 + n] for n in order)
                ).items():
                    moment -= multipliers[k] * cross(axes_b[:, of_second], axes[:, of_first])
            out[name] = (-force, -moment - cross(gap, force), force, moment)
        return out

    def _tell(self, item: Any, what: Any) -> Any:
        return self.mbs.GetObjectOutput(item, what)

    def wrenches(self) -> dict[str, Wrench]:
        """Wrenches of every joint on both bodies, each at its own joint point."""
        return self._multipliers


def _axes_of(held: tuple[bool, ...]) -> tuple[int, int, int]:
    """Joint axes that become x, y, z of Exudyn's joint.

    With a single rotation constrained, its joint keeps y of the first and z of the second body
    perpendicular; here the two axes depend on the rotation (CONVENTIONS.md) and become its y and z.
    """
    if sum(held[3:]) != 1:
        return 0, 1, 2
    return ((0, 2, 1), (1, 2, 0), (2, 1, 0))[held[3:].index(True)]


def _ordered(axes: Array, order: tuple[int, int, int]) -> Array:
    """Right-handed axes: columns in this order, the sign of the first changed if necessary."""
    out = axes[:, order].copy()
    out[:, 0] = cross(out[:, 1], out[:, 2])
    return out


def _rotation_rows(held: tuple[bool, ...]) -> dict[int, tuple[int, int]]:
    """Rows of Exudyn's generic joint: multiplier to the axes (of the second, of the first body)
    whose product it keeps at zero."""
    if all(held):
        return {0: (1, 2), 1: (0, 2), 2: (1, 0)}
    if sum(held) == 2:
        free = held.index(False)
        return {k: (k, free) for k in range(3) if k != free}
    return {0: (2, 1)} if any(held) else {}


@dataclass
class Extrapolated:
    """Runs with steps h, h/2, h/4 (``levels``), and their extrapolation to h = 0 (``flight``)."""

    flight: PeerFlight
    levels: list[PeerFlight]


def _combine(levels: list[Any]) -> Any:
    """Richardson extrapolation: removes the error of order h^2, then, with a third level, that of
    order h^3."""
    if isinstance(levels[0], dict):
        return {key: _combine([level[key] for level in levels]) for key in levels[0]}
    table, power = [np.asarray(level) for level in levels], 2
    while len(table) > 1:
        table = [fine + (fine - coarse) / (2**power - 1) for coarse, fine in pairwise(table)]
        power += 1
    return table[0]


def fly(
    data: dict[str, Any],
    times: Sequence[float],
    step: float | None = None,
    levels: int = 3,
    spectral_radius: float = 0.9,
) -> Extrapolated:
    """Simulate a case.

    Parameters
    ----------
    data : dict
        `Case.to_dict` of a case: SI, radians.
    times : sequence of float
        Output times, s, ascending.
    step : float
        Longest step of the coarsest run, s; each further one halves it. None: 1/1000 of the time.
    levels : int
        Number of runs.
    spectral_radius : float
        Of the integrator at infinite frequency.

    Returns
    -------
    Extrapolated
    """
    case = Case(data)
    step = step or case.end_time / STEPS
    flights = [
        fly_through(Exudyn(case, step, 2**k, spectral_radius), case, times) for k in range(levels)
    ]
    parts = {
        f.name: _combine([getattr(flight, f.name) for flight in flights])
        for f in fields(PeerFlight)
    }
    return Extrapolated(PeerFlight(**parts), flights)
