"""One scene: rows of a campaign against an independent flight of each of its cases."""

import math
import traceback
import warnings
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from functools import cache, partial
from typing import Any

import numpy as np

from oracles.independent import CaseResult, simulate
from oracles.random_scenes.draft import Tree
from sepmc.campaign.campaign import Campaign
from sepmc.campaign.execution.accuracy import AchievedAccuracy, deviation, scales, scene_scales
from sepmc.campaign.result import Result
from sepmc.scene.messages import SceneError
from sepmc.scene.model import Scene
from sepmc.scene.read import parse_campaign
from sepmc.schema import AUDIT_BOUNDS, Column, Status

# A row is wrong if it is off by more than three times the error that its run reports: that error is
# a difference to half the step, which lacks what the finer flight is off itself, and the cases of
# the run are few. What is smaller than _NOISE is round-off of the row and of the independent
# flight, which integrate to 1e-12 what events and differences of large numbers magnify.
_MARGIN, _NOISE = 3.0, 1e-9
_OF_SPREAD = 64
# tolerance of the second independent flight, which says how well the first one knows what it says
_ROUGH = 1e-10
# What joints may drift by while their row passes its audit: an outcome that is zero but for
# round-off may differ by as much.
_DRIFT = {"mm": 1e-6, "m/s": 1e-8, "deg": 6e-8, "deg/s": 6e-7, "s": 1e-9}
_NUDGE = 1e-9  # relative change of thresholds, times and masses that must not matter
REFUSED = (
    "unresolved",
    "no-root",
    "too-many-events",
    "singular-joint",
    "not-finite",
    "no-clearance",
    "jammed",
)  # what only the engine may say
FAULTS = ("silent", "wrong", "status", "entry")
Fly = Callable[..., Any]


@dataclass
class Verdict:
    """What became of one scene.

    ``rows`` counts rows by verdict: same; told (wrong, and an audit column says
    so); tie (the case itself does not say); refused by the engine; and the faults silent, wrong
    (not ok, and other outcomes), status; door counts doors that differ, see
    `oracles.random_scenes.entry_points`.
    ``said`` has a line for each fault, ``crash`` the last line of a traceback, ``not_flown`` why
    there is nothing to compare.
    """

    name: str
    features: list[str] = field(default_factory=list)
    rows: dict[str, int] = field(default_factory=dict)
    statuses: dict[str, int] = field(default_factory=dict)
    said: list[str] = field(default_factory=list)
    crash: str = ""
    not_flown: str = ""
    worst: float = 0.0
    reported: float = 0.0
    met: bool = True

    @property
    def fails(self) -> bool:
        """Whether judging crashed or a fault was found."""
        return bool(self.crash) or any(self.rows.get(key) for key in FAULTS)

    def count(self, verdict: str) -> None:
        """Count one more row of a verdict."""
        self.rows[verdict] = self.rows.get(verdict, 0) + 1

    def to_dict(self) -> dict[str, Any]:
        """All fields by name."""
        return asdict(self)


def judge(tree: Tree, name: str, cases: int = 3, reference: Fly = simulate) -> Verdict:
    """Fly a tree as a campaign and hold every row against the independent flight of its case. Never
    raises."""
    verdict = Verdict(name)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            campaign = Campaign(parse_campaign(tree, name))
    except SceneError as error:
        verdict.not_flown = f"refused by the parser: {str(error).splitlines()[0]}"
        return verdict
    except Exception:
        verdict.crash = f"parser: {traceback_summary()}"
        return verdict
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            verdict.features = features(tree)
            result = campaign.run(cases=cases)
            table = result.table
    except Exception:
        verdict.crash = traceback_summary()
        return verdict
    try:
        _compare(verdict, result, table, reference)
    except ValueError as error:  # what the independent flight does not know
        verdict.not_flown = f"independent flight: {error}"
    except Exception:
        verdict.crash = f"independent flight: {traceback_summary()}"
    return verdict


def traceback_summary() -> str:
    """The last line of the traceback at hand, and where it was raised."""
    lines = traceback.format_exc().strip().splitlines()
    places = [line.strip() for line in lines if line.strip().startswith("File")]
    return f"{lines[-1]} ({places[-1].rpartition('/')[2]})" if places else lines[-1]


def _compare(
    verdict: Verdict, result: Result, table: dict[str, np.ndarray], reference: Fly
) -> None:
    columns, count = result.campaign.outcome_columns, len(table["case"])
    # would take the independent flight hours
    unflyable = [str(status) in REFUSED and status != "jammed" for status in table["status"]]
    flown = [
        CaseResult(str(table["status"][i]), {})
        if unflyable[i]
        else reference(result.case(i).to_dict())
        for i in range(count)
    ]
    forbidden = _forbidden(result.campaign, count)
    expected = np.array([[f.outcomes.get(c.name, math.nan) for c in columns] for f in flown])
    found = np.array([table[c.name] for c in columns]).T
    spread = cache(partial(standard_deviations, result.campaign))
    found, scale = (
        snapped(found, expected, columns),
        sizes(expected, columns, result.campaign.scene),
    )
    accuracy = result.accuracy
    told = reported_errors(accuracy)
    reported = np.array([told.get(c.name, 0.0) for c in columns])
    verdict.reported = accuracy.worst[1] if accuracy and told else 0.0
    verdict.met = bool(accuracy is None or accuracy.met)
    for number in range(count):
        status = str(table["status"][number])
        verdict.statuses[status] = verdict.statuses.get(status, 0) + 1
        # neither came to the end of a blow-up
        broken = flown[number].status == "not-finite" and status not in ("ok", "never-released")
        if unflyable[number] or broken or (status in REFUSED and flown[number].status != status):
            verdict.count("refused")
            continue
        if status == Status.INVALID_INPUT.label and forbidden[number]:
            verdict.count("same")
            continue
        if status != flown[number].status:
            said = f"case {number}: {status}, independently {flown[number].status}"
            fault = "status"
        elif status not in ("ok", "never-released"):
            verdict.count("same" if not np.isinf(found[number]).any() else "wrong")
            if np.isinf(found[number]).any():
                verdict.said.append(
                    f"wrong: case {number} {status}: an outcome is infinite, not NaN"
                )
            continue
        else:
            off = (
                differences(
                    found[number],
                    nearest_reached(flown[number], found[number], expected[number], columns),
                    columns,
                )
                / scale[number]
            )
            unclear = [
                c.name in flown[number].indeterminate or (status != "ok" and _is_peak_time(c.name))
                for c in columns
            ]
            off[_jumped(columns, table, number) | unclear] = 0.0
            # of such rows no error is reported
            asked = accuracy.asked if accuracy and status != "ok" else 0.0
            allowed = np.maximum(_MARGIN * np.maximum(reported, asked), _NOISE)
            if (off > allowed).any():
                off *= scale[number] / np.maximum(scale[number], spread())
            at = int(np.argmax(off / allowed))
            if off[at] <= allowed[at]:
                verdict.worst = max(verdict.worst, float(off[at]))
                verdict.count("same")
                continue
            said = (
                f"case {number} {status}: {columns[at].name} = {found[number, at]:.9g}, "
                f"independently {expected[number, at]:.9g}, "
                f"off by {off[at]:.1e}, reported {reported[at]:.1e}"
            )
            fault = "flagged" if _told(table, number) else "silent" if status == "ok" else "wrong"
        if _is_loose(
            result.case(number).to_dict(),
            flown[number],
            found[number],
            scale[number],
            columns,
            status,
            reference,
        ):
            fault = "tie"
        verdict.count(fault)
        verdict.said.append(f"{fault}: {said}")


def reported_errors(accuracy: AchievedAccuracy | None) -> dict[str, float]:
    """Errors by outcome that a run tells; none if no case tells any, which is told as infinite: any
    row would do."""
    known = accuracy is not None and (
        accuracy.cases > 0 or not all(math.isinf(error) for error in accuracy.errors.values())
    )
    return accuracy.errors if accuracy and known else {}


def _forbidden(campaign: Campaign, count: int) -> np.ndarray:
    """Which of the first cases drew what a parameter may not be, such as a negative radius: the
    independent flight knows no such limits."""
    laws = campaign.file.dispersions
    drawn = campaign.sample(0, count)
    off = [~law.allowed(values) for law, values in zip(laws, drawn.T, strict=True)]
    return np.any([*off, np.isnan(campaign.in_si(drawn)).any(axis=1)], axis=0)


def standard_deviations(campaign: Campaign) -> np.ndarray:
    """Standard deviations (o,) of outcomes over more rows than are compared: errors are reported as
    shares of what a campaign has."""
    table = campaign.run(cases=_OF_SPREAD).table
    rows = np.array([table[c.name] for c in campaign.outcome_columns]).T[table["status"] == "ok"]
    return deviation(rows) if len(rows) else np.zeros(rows.shape[1])


def sizes(expected: np.ndarray, columns: list[Column], scene: Scene) -> np.ndarray:
    """What differences are shares of, (n, o), in the units of the columns: see
    `sepmc.campaign.execution.accuracy.errors`."""
    units = [c.unit for c in columns]
    own = scene_scales(scene, units) * np.array([c.scale for c in columns])
    return np.maximum(np.abs(np.nan_to_num(expected)), scales(expected, units, own))


def snapped(found: np.ndarray, expected: np.ndarray, columns: list[Column]) -> np.ndarray:
    """The rows (n, o); what should be zero but for round-off (a joint that stays shut) and is, to
    what joints may drift by, as expected."""
    return np.where(
        _are_still(expected, columns) & (np.abs(found - expected) <= _drift(columns)),
        expected,
        found,
    )


def _drift(columns: list[Column]) -> np.ndarray:
    return np.array([_DRIFT.get(c.unit, 0.0) for c in columns])


def _are_still(expected: np.ndarray, columns: list[Column]) -> np.ndarray:
    """Whether an outcome is zero but for round-off in all rows: a joint that stays shut, say."""
    return np.abs(np.nan_to_num(expected)).max(axis=0, initial=0.0) <= 1e3 * _drift(columns)


def differences(found: np.ndarray, expected: np.ndarray, columns: list[Column]) -> np.ndarray:
    """Difference of every outcome (o,), angles without full turns; infinite where only one is
    NaN."""
    difference = np.where(found == expected, 0.0, np.abs(found - expected))
    flow = np.array([c.name.endswith(("_alpha_deg", "_beta_deg")) for c in columns])
    difference = np.where(flow, np.minimum(difference, np.abs(360.0 - difference)), difference)
    difference = np.where(np.isnan(found) & np.isnan(expected), 0.0, difference)
    return np.where(np.isnan(difference), np.inf, difference)


def nearest_reached(
    flown: Any, found: np.ndarray, expected: np.ndarray, columns: list[Column]
) -> np.ndarray:
    """What is expected (o,), the time of a peak that is as good as reached from one time to another
    as found, if that lies between."""
    spans = [
        flown.reached.get(c.name, (value, value))
        for c, value in zip(columns, expected, strict=True)
    ]
    return np.where(np.isnan(found), expected, np.clip(found, *np.array(spans).reshape(-1, 2).T))


def _jumped(columns: list[Column], table: dict[str, np.ndarray], number: int) -> np.ndarray:
    """Angles that the row itself says may have jumped."""
    singular = bool(table["attitude_singular"][number] == 1.0)
    return np.array(
        [
            singular and c.name.endswith(("_roll_deg", "_pitch_deg", "_yaw_deg", "_ref_deg"))
            for c in columns
        ]
    )


def _is_peak_time(name: str) -> bool:
    """Whether an outcome is the time of a peak, which a flat peak leaves open; of a row that is not
    ok no error says how far."""
    return "_peak_" in name and name.endswith("_time_s")


def _told(table: dict[str, np.ndarray], number: int) -> bool:
    """Whether an audit column of the row is beyond its bound, which ends a run with exit code 3."""
    return any(
        bool(table[name][number] > bound) for name, bound in AUDIT_BOUNDS.items() if name in table
    )


def _is_loose(
    case: dict[str, Any],
    first: Any,
    found: np.ndarray,
    scale: np.ndarray,
    columns: list[Column],
    status: str,
    reference: Fly,
) -> bool:
    """Whether the case itself does not say what its outcomes are: flown less exactly, or from
    numbers that differ by 1e-9, they differ as much as the row does, or have its status."""
    expected = np.array([first.outcomes.get(c.name, math.nan) for c in columns])
    off = differences(found, expected, columns) / scale
    others = [
        reference(case, rtol=_ROUGH),
        *(
            reference(perturbed(case, sign * _NUDGE, part))
            for sign in (-1.0, 1.0)
            for part in (0, 1)
        ),
    ]
    for other in others:
        moved = (
            differences(
                np.array([other.outcomes.get(c.name, math.nan) for c in columns]), expected, columns
            )
            / scale
        )
        if status == first.status and np.all((3.0 * moved >= off) | (off <= _NOISE)):
            return True
        if status != first.status and other.status == status:
            return True
    return False


_THRESHOLDS = (
    "time",
    "burn",
    "ignition",
    "delay",
    "start",
    "end",
    "stroke",
    "distance",
    "angle",
    "altitude",
    "vertical_speed",
)
_FORCES = ("mass", "thrust", "force", "stiffness", "speed")


def perturbed(node: Any, share: float, part: int, key: str = "") -> Any:
    """A case whose thresholds and times (part 0) or masses, forces and speeds (part 1) differ by a
    share."""
    if isinstance(node, dict):
        return {k: perturbed(v, share, part, k) for k, v in node.items()}
    if isinstance(node, list):
        return [perturbed(v, share, part, key) for v in node]
    chosen = key in (_THRESHOLDS, _FORCES)[part] and isinstance(node, float)
    return node * (1.0 + share) if chosen else node


def features(tree: Tree) -> list[str]:
    """What a scene has, for the table of the gate."""
    conditions = [phase["until"] for phase in tree["phase"] if "until" in phase] + [
        item["when"] for key in ("release", "event") for item in tree.get(key, [])
    ]
    found = {
        f"until {_OF_CONDITIONS.get(key) or key.removesuffix('_N_m').rsplit('_', 1)[0]}"
        for c in conditions
        for key in _keys(c)
    }
    found -= {"until joint", "until body"}
    found |= {
        f"joint {kind}"
        for phase in tree["phase"]
        for name, kind in phase.get("joints", {}).items()
        if not _own(tree, name, kind)
    }
    found |= {
        "joint own"
        for phase in tree["phase"]
        for name, kind in phase.get("joints", {}).items()
        if _own(tree, name, kind)
    }
    joints = tree.get("joint", {}).values()
    found |= {"ground"} if any("ground" in j["bodies"] for j in joints) else set()
    found |= {"delay"} if any("delay_s" in j for j in joints) else set()
    found |= (
        {"loop"} if len(tree.get("joint", {})) >= len(tree["body"]) + ("ground" in found) else set()
    )
    found |= {key for key in ("motor", "spring", "load") if tree.get(key)}
    found |= (
        {"aerodynamics"} if any("aerodynamics" in body for body in tree["body"].values()) else set()
    )
    found |= {
        f"motor {key.rsplit('_', 1)[0]}"
        for m in tree.get("motor", [])
        for key in m
        if key in _OF_MOTOR
    }
    return sorted(found | _late_features(tree))


def _late_features(tree: Tree) -> set[str]:
    """Those of the later kinds: releases, tables, guides, events, outputs of loads."""
    environment, bodies = tree.get("environment", {}), tree["body"].values()
    guides = [joint["guide"] for joint in tree.get("joint", {}).values() if "guide" in joint]
    waits = [motor["ignition"] for motor in tree.get("motor", []) if "ignition" in motor]
    profiles = [motor["profile"] for motor in tree.get("motor", []) if "profile" in motor]
    present = {
        "late profile": any(profile["time_s"][0] > 0.0 for profile in profiles),
        **{f"ignition at {key}": any(key in one for one in waits) for key in _INSTANTS},
        "release": tree.get("release"),
        "release optional": any(one.get("optional") for one in tree.get("release", [])),
        "event": tree.get("event"),
        "proximity": tree.get("proximity"),
        "wind profile": "profile" in environment.get("wind", {}),
        "table of the air": "air" in environment,
        "aerodynamic table": any("table" in body.get("aerodynamics", {}) for body in bodies),
        "guide": guides,
        "guide friction": any(guide.get("friction") for guide in guides),
        "clearance": tree.get("clearance"),
        **{
            f"output {key}": tree.get("output", {}).get(key)
            for key in ("loads", "tip_off", "guide", "transverse")
        },
    }
    return {name for name, there in present.items() if there}


def _keys(until: Tree) -> set[str]:
    """Keys of a condition and of those inside it."""
    inside = [part for key in ("any", "all") for part in until.get(key, [])]
    return set(until).union(*map(_keys, inside))


_OF_CONDITIONS = {"burn_out": "burn_out", "vertical_speed_m_s": "vertical_speed"}
_OF_MOTOR = ("ignition_s", "delay_s", "burn_s", "tail_off_s", "build_up_s", "profile")


_INSTANTS = ("event", "release", "joint")


def _own(tree: Tree, joint: str, kind: str) -> bool:
    return kind in tree["joint"].get(joint, {}).get("kind", {})
