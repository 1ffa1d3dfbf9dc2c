"""Expected events that do not occur in a case: releases of joints, observation events, ignitions of
motors and ends of the strokes of springs.

A case with a phase that does not end has the status never-released instead.
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
    """For each event that the campaign file defines, the name of the outcome column with its time.

    Optional releases are included. The keys are ``joint.NAME`` (the joint becomes free),
    ``joint.NAME.KIND`` (it is released to another kind), ``event.NAME``, ``motor.NAME`` (ignition,
    if it waits for an event) and ``spring.NAME`` (the end of its stroke).
    """
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
    """Yield the names of the joints that a release or the end of a phase makes free."""
    yield from (release.joint for release in scene.release if release.to == _FREE)
    for phase, next_phase in pairwise(scene.phase):
        for joint, kind in phase.joints.items():
            if kind != _FREE and next_phase.joints.get(joint, _FREE) == _FREE:
                yield joint


def count_missing(
    campaign: Definition, outcomes: Mapping[str, np.ndarray], ok: np.ndarray
) -> dict[str, int]:
    """Count, for each expected event, the ok cases in which it does not occur.

    Parameters
    ----------
    campaign : Definition
    outcomes : mapping of str to ndarray, shape (n,)
        Outcomes of n cases by column; the time of an event that does not occur is NaN.
    ok : ndarray of bool, shape (n,)
        True for the cases with status ok.

    Returns
    -------
    dict of str to int
        Number of such cases by event, with the keys of `expected_events`; events that occur in all
        ok cases are left out.
    """
    counts = {
        key: int(np.count_nonzero(ok & np.isnan(outcomes[column])))
        for key, column in expected_events(campaign).items()
    }
    return {key: count for key, count in counts.items() if count}


def missing_notes(campaign: Definition, counts: Mapping[str, int], ok: int) -> list[str]:
    """A note for each event in ``counts``, which `count_missing` returned; ``ok`` is the number of
    cases with status ok."""
    return [
        f"{_description(campaign.scene, key)} in {count} of {ok} ok cases: outcomes that wait for "
        "it are NaN there, and do not pass a requirement"
        for key, count in counts.items()
    ]


def missing_of_nominal(campaign: Definition, outcomes: Mapping[str, float]) -> list[str]:
    """A note for each expected event that does not occur in the nominal case; ``outcomes`` are its
    outcomes by column. The end of a stroke is not expected of a spring whose nominal stroke is
    infinite."""
    scene = campaign.scene
    endless = {f"spring.{spring.name}" for spring in scene.spring if math.isinf(spring.stroke)}
    values = {name: np.array([value]) for name, value in outcomes.items()}
    return [
        f"{_description(scene, key)} in the nominal case, which ends at {scene.run.end_time:g} s"
        for key in count_missing(campaign, values, np.array([True]))
        if key not in endless
    ]


def _description(scene: Scene, key: str) -> str:
    """Start of a sentence on an event that does not occur, such as "motor.retro does not light";
    ``key`` is one of the keys of `expected_events`."""
    table, name, *kinds = key.split(".")
    if table == "motor":
        return f"{key} does not light"
    if table == "event":
        return f"{key} does not occur"
    if table == "spring":
        return f"{key} does not reach the end of its stroke, and pushes on"
    releases = [release for release in scene.release if release.joint == name]
    if kinds:
        releases = [release for release in releases if release.to in kinds]
    what = f"is not released to {kinds[0]}" if kinds else "does not become free"
    optional = any(release.optional for release in releases)
    return f"{table}.{name} {what}{' (its release is optional)' if optional else ''}"
