"""Comparison of the rows of a campaign with independent simulations of their cases."""

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

# A row is wrong if it differs by more than three times the reported error: that error is a
# difference to half the step, which lacks the error of the finer simulation, and the cases of the
# run are few. Below _NOISE is round-off of the row and of the independent simulation, which
# integrate to 1e-12; events and differences of large numbers magnify it.
_MARGIN, _NOISE = 3.0, 1e-9
_CASES_OF_DEVIATION = 64
# tolerance of a second independent simulation, which shows the sensitivity of the case
_ROUGH = 1e-10
# Drift of joints that passes the audit: allowed difference of outcomes that are zero but for
# round-off.
_DRIFT = {"mm": 1e-6, "m/s": 1e-8, "deg": 6e-8, "deg/s": 6e-7, "s": 1e-9}
_NUDGE = 1e-9  # relative change of thresholds, times and masses that should not matter
# statuses that only the engine may report
REFUSED = (
    "unresolved",
    "no-root",
    "too-many-events",
    "singular-joint",
    "not-finite",
    "no-clearance",
    "jammed",
)
FAULTS = ("silent", "wrong", "status", "entry")
Fly = Callable[..., Any]


@dataclass
class Verdict:
    """Verdict on one scene.

    ``rows`` counts rows by verdict: same; flagged (wrong, and an audit column is beyond its bound);
    tie (the case itself is too sensitive); refused by the engine; and the faults silent, wrong
    (status not ok, other outcomes), status. It also counts differing entry points, see
    `oracles.random_scenes.entry_points`. ``said`` has a line for each fault, ``crash`` the last
    line of a traceback, ``not_flown`` the reason why nothing is compared. ``worst`` is the largest
    relative difference among rows judged the same, of outcome ``column``, whose reported error is
    ``reported``.
    """

    name: str
    features: list[str] = field(default_factory=list)
    rows: dict[str, int] = field(default_factory=dict)
    statuses: dict[str, int] = field(default_factory=dict)
    said: list[str] = field(default_factory=list)
    crash: str = ""
    not_flown: str = ""
    worst: float = 0.0
    column: str = ""
    reported: float = 0.0
    met: bool = True

    @property
    def fails(self) -> bool:
        """True if judging crashed or a fault was found."""
        return bool(self.crash) or any(self.rows.get(key) for key in FAULTS)

    def count(self, verdict: str) -> None:
        """Count one more row with a verdict."""
        self.rows[verdict] = self.rows.get(verdict, 0) + 1

    def to_dict(self) -> dict[str, Any]:
        """All fields by name."""
        return asdict(self)


def judge(tree: Tree, name: str, cases: int = 3, reference: Fly = simulate) -> Verdict:
    """Run a tree as a campaign and compare every row with the independent simulation of its case.
    Never raises.

    Parameters
    ----------
    tree : dict
        Campaign file.
    name : str
    cases : int
    reference : callable
        Independent simulation of a case, with a keyword ``rtol``.
    """
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
    except ValueError as error:  # not known to the independent simulation
        verdict.not_flown = f"independent simulation: {error}"
    except Exception:
        verdict.crash = f"independent simulation: {traceback_summary()}"
    return verdict


def traceback_summary() -> str:
    """Last line of the present traceback, and the line that raised."""
    lines = traceback.format_exc().strip().splitlines()
    places = [line.strip() for line in lines if line.strip().startswith("File")]
    return f"{lines[-1]} ({places[-1].rpartition('/')[2]})" if places else lines[-1]


def _compare(
    verdict: Verdict, result: Result, table: dict[str, np.ndarray], reference: Fly
) -> None:
    """Fill a verdict with the comparison of all rows."""
    columns, count = result.campaign.outcome_columns, len(table["case"])
    # could take the independent simulation hours
    unfinished = [str(status) in REFUSED and status != "jammed" for status in table["status"]]
    references = [
        CaseResult(str(table["status"][i]), {})
        if unfinished[i]
        else reference(result.case(i).to_dict())
        for i in range(count)
    ]
    forbidden = _forbidden(result.campaign, count)
    expected = np.array([[f.outcomes.get(c.name, math.nan) for c in columns] for f in references])
    values = np.array([table[c.name] for c in columns]).T
    spread = cache(partial(standard_deviations, result.campaign))
    values, scale = (
        snapped(values, expected, columns),
        sizes(expected, columns, result.campaign.scene),
    )
    accuracy = result.accuracy
    errors_by_outcome = reported_errors(accuracy)
    reported = np.array([errors_by_outcome.get(c.name, 0.0) for c in columns])
    verdict.met = bool(accuracy is None or accuracy.met)
    for number in range(count):
        status = str(table["status"][number])
        verdict.statuses[status] = verdict.statuses.get(status, 0) + 1
        # a blow-up, which neither finished
        broken = references[number].status == "not-finite" and status not in (
            "ok",
            "never-released",
        )
        if (
            unfinished[number]
            or broken
            or (status in REFUSED and references[number].status != status)
        ):
            verdict.count("refused")
            continue
        if status == Status.INVALID_INPUT.label and forbidden[number]:
            verdict.count("same")
            continue
        if status != references[number].status:
            said = f"case {number}: {status}, independently {references[number].status}"
            fault = "status"
        elif status not in ("ok", "never-released"):
            verdict.count("same" if not np.isinf(values[number]).any() else "wrong")
            if np.isinf(values[number]).any():
                verdict.said.append(
                    f"wrong: case {number} {status}: an outcome is infinite, not NaN"
                )
            continue
        else:
            relative = (
                differences(
                    values[number],
                    nearest_reached(references[number], values[number], expected[number], columns),
                    columns,
                )
                / scale[number]
            )
            indeterminate = [
                c.name in references[number].indeterminate
                or (status != "ok" and _is_peak_time(c.name))
                for c in columns
            ]
            relative[_jumped(columns, table, number) | indeterminate] = 0.0
            # no error is reported of such rows
            requested = accuracy.asked if accuracy and status != "ok" else 0.0
            allowed = np.maximum(_MARGIN * np.maximum(reported, requested), _NOISE)
            if (relative > allowed).any():
                relative *= scale[number] / np.maximum(scale[number], spread())
            worst_column = int(np.argmax(relative / allowed))
            if relative[worst_column] <= allowed[worst_column]:
                if relative[worst_column] > verdict.worst:
                    verdict.worst = float(relative[worst_column])
                    verdict.column = columns[worst_column].name
                    verdict.reported = float(reported[worst_column])
                verdict.count("same")
                continue
            said = (
                f"case {number} {status}: {columns[worst_column].name} = "
                f"{values[number, worst_column]:.9g}, "
                f"independently {expected[number, worst_column]:.9g}, "
                f"off by {relative[worst_column]:.1e}, reported {reported[worst_column]:.1e}"
            )
            fault = (
                "flagged" if _is_flagged(table, number) else "silent" if status == "ok" else "wrong"
            )
        if _is_sensitive(
            result.case(number).to_dict(),
            references[number],
            values[number],
            scale[number],
            columns,
            status,
            reference,
        ):
            fault = "tie"
        verdict.count(fault)
        verdict.said.append(f"{fault}: {said}")


def reported_errors(accuracy: AchievedAccuracy | None) -> dict[str, float]:
    """Reported errors by outcome; empty if the run estimates none, or infinite ones only, with
    which any row would agree."""
    known = accuracy is not None and (
        accuracy.cases > 0 or not all(math.isinf(error) for error in accuracy.errors.values())
    )
    return accuracy.errors if accuracy and known else {}


def _forbidden(campaign: Campaign, count: int) -> np.ndarray:
    """True (count,) for cases with inputs outside of the limits of their parameters, such as a
    negative radius: the independent simulation has no such limits."""
    dispersions = campaign.file.dispersions
    samples = campaign.sample(0, count)
    relative = [
        ~dispersion.allowed(values)
        for dispersion, values in zip(dispersions, samples.T, strict=True)
    ]
    return np.any([*relative, np.isnan(campaign.in_si(samples)).any(axis=1)], axis=0)


def standard_deviations(campaign: Campaign) -> np.ndarray:
    """Standard deviations (o,) of outcomes over `_CASES_OF_DEVIATION` rows: errors are reported
    relative to those of the campaign."""
    table = campaign.run(cases=_CASES_OF_DEVIATION).table
    rows = np.array([table[c.name] for c in campaign.outcome_columns]).T[table["status"] == "ok"]
    return deviation(rows) if len(rows) else np.zeros(rows.shape[1])


def sizes(expected: np.ndarray, columns: list[Column], scene: Scene) -> np.ndarray:
    """Scales (n, o) of differences, in the units of the columns; see
    `sepmc.campaign.execution.accuracy.errors`."""
    units = [c.unit for c in columns]
    in_columns = scene_scales(scene, units) * np.array([c.scale for c in columns])
    return np.maximum(np.abs(np.nan_to_num(expected)), scales(expected, units, in_columns))


def snapped(values: np.ndarray, expected: np.ndarray, columns: list[Column]) -> np.ndarray:
    """Rows (n, o), with outcomes replaced by the expected ones where those are zero but for
    round-off (a joint that stays shut) and the difference is within the allowed drift."""
    return np.where(
        _are_still(expected, columns) & (np.abs(values - expected) <= _drift(columns)),
        expected,
        values,
    )


def _drift(columns: list[Column]) -> np.ndarray:
    """Allowed drift (o,) of outcomes that are zero."""
    return np.array([_DRIFT.get(c.unit, 0.0) for c in columns])


def _are_still(expected: np.ndarray, columns: list[Column]) -> np.ndarray:
    """True (o,) for outcomes that are zero but for round-off in all rows, as of a joint that stays
    shut."""
    return np.abs(np.nan_to_num(expected)).max(axis=0, initial=0.0) <= 1e3 * _drift(columns)


def differences(values: np.ndarray, expected: np.ndarray, columns: list[Column]) -> np.ndarray:
    """Absolute differences (o,), angles modulo full turns; infinite where only one value is NaN."""
    difference = np.where(values == expected, 0.0, np.abs(values - expected))
    flow = np.array([c.name.endswith(("_alpha_deg", "_beta_deg")) for c in columns])
    difference = np.where(flow, np.minimum(difference, np.abs(360.0 - difference)), difference)
    difference = np.where(np.isnan(values) & np.isnan(expected), 0.0, difference)
    return np.where(np.isnan(difference), np.inf, difference)


def nearest_reached(
    references: Any, values: np.ndarray, expected: np.ndarray, columns: list[Column]
) -> np.ndarray:
    """Expected values (o,), with the time of a peak that is reached over an interval replaced by
    the nearest time in it."""
    spans = [
        references.reached.get(c.name, (value, value))
        for c, value in zip(columns, expected, strict=True)
    ]
    return np.where(np.isnan(values), expected, np.clip(values, *np.array(spans).reshape(-1, 2).T))


def _jumped(columns: list[Column], table: dict[str, np.ndarray], number: int) -> np.ndarray:
    """True (o,) for angles that may have jumped according to the row."""
    singular = bool(table["attitude_singular"][number] == 1.0)
    return np.array(
        [
            singular and c.name.endswith(("_roll_deg", "_pitch_deg", "_yaw_deg", "_ref_deg"))
            for c in columns
        ]
    )


def _is_peak_time(name: str) -> bool:
    """True if an outcome is the time of a peak; for rows that are not ok no error is reported of
    it."""
    return "_peak_" in name and name.endswith("_time_s")


def _is_flagged(table: dict[str, np.ndarray], number: int) -> bool:
    """True if an audit column of the row is beyond its bound, which ends a run with exit code 3."""
    return any(
        bool(table[name][number] > bound) for name, bound in AUDIT_BOUNDS.items() if name in table
    )


def _is_sensitive(
    case: dict[str, Any],
    nominal: Any,
    values: np.ndarray,
    scale: np.ndarray,
    columns: list[Column],
    status: str,
    reference: Fly,
) -> bool:
    """True if the case is too sensitive: simulated with a larger tolerance, or from numbers changed
    by 1e-9, its outcomes change as much as the row differs, or its status becomes that of the
    row."""
    expected = np.array([nominal.outcomes.get(c.name, math.nan) for c in columns])
    relative = differences(values, expected, columns) / scale
    others = [
        reference(case, rtol=_ROUGH),
        *(
            reference(perturbed(case, sign * _NUDGE, part))
            for sign in (-1.0, 1.0)
            for part in (0, 1)
        ),
    ]
    for other in others:
        change = (
            differences(
                np.array([other.outcomes.get(c.name, math.nan) for c in columns]), expected, columns
            )
            / scale
        )
        if status == nominal.status and np.all((3.0 * change >= relative) | (relative <= _NOISE)):
            return True
        if status != nominal.status and other.status == status:
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


def perturbed(node: Any, fraction: float, part: int, key: str = "") -> Any:
    """Case with times and thresholds (part 0) or masses, forces and speeds (part 1) changed by a
    fraction."""
    if isinstance(node, dict):
        return {k: perturbed(v, fraction, part, k) for k, v in node.items()}
    if isinstance(node, list):
        return [perturbed(v, fraction, part, key) for v in node]
    chosen = key in (_THRESHOLDS, _FORCES)[part] and isinstance(node, float)
    return node * (1.0 + fraction) if chosen else node


def features(tree: Tree) -> list[str]:
    """Features of a scene, by which the table of random scenes groups."""
    conditions = [phase["until"] for phase in tree["phase"] if "until" in phase] + [
        item["when"] for key in ("release", "event") for item in tree.get(key, [])
    ]
    values = {
        f"until {_OF_CONDITIONS.get(key) or key.removesuffix('_N_m').rsplit('_', 1)[0]}"
        for c in conditions
        for key in _keys(c)
    }
    values -= {"until joint", "until body"}
    values |= {
        f"joint {kind}"
        for phase in tree["phase"]
        for name, kind in phase.get("joints", {}).items()
        if not _is_custom(tree, name, kind)
    }
    values |= {
        "joint own"
        for phase in tree["phase"]
        for name, kind in phase.get("joints", {}).items()
        if _is_custom(tree, name, kind)
    }
    joints = tree.get("joint", {}).values()
    values |= {"ground"} if any("ground" in j["bodies"] for j in joints) else set()
    values |= {"delay"} if any("delay_s" in j for j in joints) else set()
    values |= (
        {"loop"}
        if len(tree.get("joint", {})) >= len(tree["body"]) + ("ground" in values)
        else set()
    )
    values |= {key for key in ("motor", "spring", "load") if tree.get(key)}
    values |= (
        {"aerodynamics"} if any("aerodynamics" in body for body in tree["body"].values()) else set()
    )
    values |= {
        f"motor {key.rsplit('_', 1)[0]}"
        for m in tree.get("motor", [])
        for key in m
        if key in _OF_MOTOR
    }
    return sorted(values | _late_features(tree))


def _late_features(tree: Tree) -> set[str]:
    """Features of the later kinds: releases, tables, guides, events, load outputs."""
    environment, bodies = tree.get("environment", {}), tree["body"].values()
    guides = [joint["guide"] for joint in tree.get("joint", {}).values() if "guide" in joint]
    waits = [motor["ignition"] for motor in tree.get("motor", []) if "ignition" in motor]
    profiles = [motor["profile"] for motor in tree.get("motor", []) if "profile" in motor]
    present = {
        "late profile": any(profile["time_s"][0] > 0.0 for profile in profiles),
        **{f"ignition at {key}": any(key in item for item in waits) for key in _INSTANTS},
        "release": tree.get("release"),
        "release optional": any(item.get("optional") for item in tree.get("release", [])),
        "event": tree.get("event"),
        "proximity": tree.get("proximity"),
        "wind profile": "profile" in environment.get("wind", {}),
        "table of the air": "air" in environment,
        "aerodynamic table": any("table" in body.get("aerodynamics", {}) for body in bodies),
        "relative axes": any("axes" in entry for entry in tree.get("proximity", [])),
        "return factor": any(
            "return_factor" in spring.get("table", {}) for spring in tree.get("spring", [])
        ),
        "signal": tree.get("signal"),
        **{
            f"signal {key.removesuffix('_s')}": any(key in item for item in tree.get("signal", []))
            for key in _OF_SIGNAL
        },
        "push only": any(spring.get("push_only") for spring in tree.get("spring", [])),
        "guide": guides,
        "guide friction": any(guide.get("friction") for guide in guides),
        "clearance": tree.get("clearance"),
        **{
            f"output {key}": tree.get("output", {}).get(key)
            for key in ("loads", "tip_off", "guide", "transverse")
        },
    }
    return {name for name, value in present.items() if value}


def _keys(until: Tree) -> set[str]:
    """Keys of a condition and of nested ones."""
    inside = [part for key in ("any", "all") for part in until.get(key, [])]
    return set(until).union(*map(_keys, inside))


_OF_CONDITIONS = {"burn_out": "burn_out", "vertical_speed_m_s": "vertical_speed"}
_OF_MOTOR = ("ignition_s", "delay_s", "burn_s", "tail_off_s", "build_up_s", "profile")


_OF_SIGNAL = ("lag_s", "rate_limit", "servo", "integral", "sample_s")
_INSTANTS = ("event", "release", "joint")


def _is_custom(tree: Tree, joint: str, kind: str) -> bool:
    """True if a kind of a joint is a custom one."""
    return kind in tree["joint"].get(joint, {}).get("kind", {})
