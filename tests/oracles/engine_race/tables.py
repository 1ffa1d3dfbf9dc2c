"""Other engines on the same cases, beside the engine: `oracles.engine_race`."""

from typing import Any

import numpy as np
import pandas as pd

from oracles.engine_race import Entry, race
from oracles.engine_race.race import CASES
from sepmc.bench.reference import Reference
from sepmc.bench.study import Study
from sepmc.bench.work_precision import PER, own_variants, rows_of

OURS = "sepmc"
QUICK = {"heyoka": 0, "mujoco": 64, "scipy": 1, "exudyn": 1}


def measure(study: Study, reference: Reference) -> pd.DataFrame:
    """A row for each engine and setting: error, time, and the ratio to the engine's time at an
    error as small or smaller.

    The engine is timed again, directly before the others, since the load of the machine changes
    within minutes.

    Raises
    ------
    ValueError
        If the other engines do not run such a scene, naming those that they run.
    """
    ours = rows_of(study, reference, own_variants(study, reference))
    most = QUICK if study.quick else CASES
    entries = race(
        study.campaign,
        study.threads,
        study.say,
        {name: min(n, len(reference.valid)) for name, n in most.items()},
        study.repeats,
    )
    rows = [_ours({str(k): v for k, v in row.items()}) for row in ours.to_dict("records")]
    rows += [_theirs(entry, _error(study, reference, entry), study.cases) for entry in entries]
    frame = pd.DataFrame(rows)
    frame["over_ours"] = [
        _ratio(row, frame[frame["engine"] == OURS], reference.floor) for row in rows
    ]
    return frame


def _error(study: Study, reference: Reference, entry: Entry) -> float:
    """Error as the engine's is computed; columns in SI. Unfinished cases are left out."""
    columns = [entry.outcomes[c.name] / c.scale for c in study.campaign.outcome_columns]
    values = np.column_stack(columns)
    return study.error_of(
        values, np.asarray(np.isfinite(values).all(axis=1)), reference.outcomes, reference.valid
    )[0]


def _ours(row: dict[str, Any]) -> dict[str, Any]:
    kept = {
        name: row[name]
        for name in ("error", "ms", "cases", "repeats", "scaled", "default", "spread")
    }
    note = "the scene's own kernel" + (", as the pilot chose" if row["default"] else "")
    return {
        "engine": OURS,
        "setting": f"{row['method']}, {row['setting']}",
        **kept,
        "compile_s": np.nan,
        "note": note,
    }


def _theirs(entry: Entry, off: float, cases: int) -> dict[str, Any]:
    return {
        "engine": entry.engine,
        "setting": entry.setting,
        "error": off,
        "ms": 1e3 * PER * entry.seconds_per_case,
        "cases": entry.cases,
        "repeats": entry.repeats,
        "spread": entry.spread,
        "default": False,
        "scaled": entry.extrapolated or entry.cases < cases,
        "compile_s": entry.compile_s,
        "note": entry.note,
    }


def _ratio(row: dict[str, Any], ours: pd.DataFrame, floor: float) -> float:
    """Time over that of the engine's fastest setting with no larger error; errors below ``floor``
    are equal."""
    good = ours[ours["error"] <= max(row["error"], floor)]
    return float(row["ms"] / good["ms"].min()) if len(good) else np.nan
