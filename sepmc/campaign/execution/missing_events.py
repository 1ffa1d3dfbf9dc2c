"""Expected events that do not occur: releases, observation events and ignitions.

A phase that does not end has the status never-released instead.
"""

from collections.abc import Iterator, Mapping
from itertools import pairwise

import numpy as np

from sepmc.campaign.definition import Definition
from sepmc.scene.model import Scene
from sepmc.schema import event_columns, ignition_columns, release_columns

_FREE = "free"


def expected_events(campaign: Definition) -> dict[str, str]:
    """Time column of each expected event, by its key in the file."""
    contents = campaign.plan.contents
    releases, freed = release_columns(contents), set(_released_joints(campaign.scene))
    return {
        **{f"joint.{name}": releases[name] for name in contents.joints if name in freed},
        **{f"event.{name}": column for name, column in event_columns(contents).items()},
        **{f"motor.{name}": column for name, column in ignition_columns(contents).items()},
    }


def _released_joints(scene: Scene) -> Iterator[str]:
    """Joints that a release or the end of a phase makes free."""
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
        By column.
    ok : ndarray of bool, shape (n,)

    Returns
    -------
    dict of str to int
        By key in the file, without zeros.
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


def missing_of_one(
    campaign: Definition, outcomes: Mapping[str, float], springs: Mapping[str, float], case: str
) -> list[str]:
    """Notes on the events that do not occur in one case, and on springs whose stroke does not end.

    ``springs`` are times of the ends of strokes, s, NaN if not reached; ``case`` names the case.
    """
    values = {name: np.array([value]) for name, value in outcomes.items()}
    end = campaign.scene.run.end_time
    notes = [
        _description(campaign.scene, key)
        for key in count_missing(campaign, values, np.array([True]))
    ]
    notes += [
        f"spring.{name} does not reach the end of its stroke, and pushes on"
        for name, time in springs.items()
        if np.isnan(time)
    ]
    return [f"{note} in {case}, which ends at {end:g} s" for note in notes]


def _description(scene: Scene, key: str) -> str:
    """Describe the missing event in words."""
    table, _, name = key.partition(".")
    if table == "motor":
        return f"{key} does not light"
    if table == "event":
        return f"{key} does not come"
    optional = any(release.joint == name and release.optional for release in scene.release)
    return f"{key} does not become free{' (its release is optional)' if optional else ''}"
