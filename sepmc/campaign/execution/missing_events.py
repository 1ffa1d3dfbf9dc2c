"""Expected events that do not occur: releases, observation events, ignitions and ends of strokes.

A phase that does not end has the status never-released instead.
"""

import math
from collections.abc import Iterator, Mapping
from itertools import pairwise

import numpy as np

from sepmc.campaign.definition import Definition
from sepmc.scene.model import Scene
from sepmc.schema import (
    event_columns,
    ignition_columns,
    partial_release_columns,
    release_columns,
    stroke_columns,
)

_FREE = "free"


def expected_events(campaign: Definition) -> dict[str, str]:
    """Column of the time of each expected event, by its path in the file: ``joint.NAME``,
    ``event.NAME``, ``motor.NAME``, ``spring.NAME``; of a release to another kind,
    ``joint.NAME.KIND``."""
    contents = campaign.layout.contents
    releases, freed = release_columns(contents), set(_released_joints(campaign.scene))
    partial = partial_release_columns(contents)
    return {
        **{f"joint.{name}": releases[name] for name in contents.joints if name in freed},
        **{f"joint.{joint}.{kind}": column for (joint, kind), column in partial.items()},
        **{f"event.{name}": column for name, column in event_columns(contents).items()},
        **{f"motor.{name}": column for name, column in ignition_columns(contents).items()},
        **{f"spring.{name}": column for name, column in stroke_columns(contents).items()},
    }


def _released_joints(scene: Scene) -> Iterator[str]:
    """Names of the joints that a release or the end of a phase makes free."""
    yield from (release.joint for release in scene.release if release.to == _FREE)
    for phase, next_phase in pairwise(scene.phase):
        for joint, kind in phase.joints.items():
            if kind != _FREE and next_phase.joints.get(joint, _FREE) == _FREE:
                yield joint


def count_missing(
    campaign: Definition, outcomes: Mapping[str, np.ndarray], ok: np.ndarray
) -> dict[str, int]:
    """Count the ok cases without an expected event.

    Parameters
    ----------
    campaign : Definition
    outcomes : mapping of str to ndarray, shape (n,)
        By column; times of events are NaN if they do not occur.
    ok : ndarray of bool, shape (n,)
        Cases with status ok.

    Returns
    -------
    dict of str to int
        Number of cases by event, with the keys of `expected_events`, without zeros.
    """
    counts = {
        key: int(np.count_nonzero(ok & np.isnan(outcomes[column])))
        for key, column in expected_events(campaign).items()
    }
    return {key: count for key, count in counts.items() if count}


def missing_notes(campaign: Definition, counts: Mapping[str, int], ok: int) -> list[str]:
    """Notes on the counts of `count_missing` among ``ok`` ok cases."""
    return [
        f"{_description(campaign.scene, key)} in {count} of {ok} ok cases: outcomes that wait for "
        "it are missing there, and do not pass a requirement"
        for key, count in counts.items()
    ]


def missing_of_nominal(campaign: Definition, outcomes: Mapping[str, float]) -> list[str]:
    """Notes on the expected events that do not occur in the nominal case, from its outcomes by
    column. The end of a stroke is not expected of a spring without a nominal stroke."""
    scene = campaign.scene
    endless = {f"spring.{spring.name}" for spring in scene.spring if math.isinf(spring.stroke)}
    values = {name: np.array([value]) for name, value in outcomes.items()}
    return [
        f"{_description(scene, key)} in the nominal case, which ends at {scene.run.end_time:g} s"
        for key in count_missing(campaign, values, np.array([True]))
        if key not in endless
    ]


def _description(scene: Scene, key: str) -> str:
    """Sentence on an event that does not occur; ``key`` is one of `expected_events`."""
    table, name, *kinds = key.split(".")
    if table == "motor":
        return f"{key} does not light"
    if table == "event":
        return f"{key} does not come"
    if table == "spring":
        return f"{key} does not reach the end of its stroke, and pushes on"
    releases = [release for release in scene.release if release.joint == name]
    if kinds:
        releases = [release for release in releases if release.to in kinds]
    what = f"is not released to {kinds[0]}" if kinds else "does not become free"
    optional = any(release.optional for release in releases)
    return f"{table}.{name} {what}{' (its release is optional)' if optional else ''}"
