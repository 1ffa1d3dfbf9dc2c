"""What a scene waits for: joints to become free, events, motors to light; and in how many cases
that does not come. A phase that does not end is a status of its own, never-released."""

from collections.abc import Iterator, Mapping
from itertools import pairwise

import numpy as np

from sepmc.campaign.definition import Definition
from sepmc.scene.model import Scene
from sepmc.schema import event_columns, ignition_columns, release_columns

_FREE = "free"


def awaited(campaign: Definition) -> dict[str, str]:
    """Column of the time of each thing that is waited for, by its place in the file."""
    contents = campaign.plan.contents
    releases, freed = release_columns(contents), set(_freed(campaign.scene))
    return {
        **{f"joint.{name}": releases[name] for name in contents.joints if name in freed},
        **{f"event.{name}": column for name, column in event_columns(contents).items()},
        **{f"motor.{name}": column for name, column in ignition_columns(contents).items()},
    }


def _freed(scene: Scene) -> Iterator[str]:
    """Joints that a release, or the end of a phase, makes free."""
    yield from (release.joint for release in scene.release if release.to == _FREE)
    for before, after in pairwise(scene.phase):
        for joint, kind in before.joints.items():
            if kind != _FREE and after.joints.get(joint, _FREE) == _FREE:
                yield joint


def count_missing(
    campaign: Definition, outcomes: Mapping[str, np.ndarray], ok: np.ndarray
) -> dict[str, int]:
    """In how many cases whose status is ok (n,) what is waited for does not come, by its place in
    the file, of what does not always come; ``outcomes`` (n,) by column."""
    counts = {
        place: int(np.count_nonzero(ok & np.isnan(outcomes[column])))
        for place, column in awaited(campaign).items()
    }
    return {place: count for place, count in counts.items() if count}


def missing_notes(campaign: Definition, counts: Mapping[str, int], ok: int) -> list[str]:
    """A sentence on each count of `count_missing`, of so many ``ok`` cases."""
    return [
        f"{_what(campaign.scene, place)} in {count} of {ok} ok cases: outcomes that wait for it "
        "are missing there, and do not pass a requirement"
        for place, count in counts.items()
    ]


def missing_of_one(
    campaign: Definition, outcomes: Mapping[str, float], springs: Mapping[str, float], case: str
) -> list[str]:
    """A sentence on each thing that does not come in one ``case``, which came to its end, and on
    each of its ``springs`` whose stroke does not end, of which the time of that is NaN."""
    found = {name: np.array([value]) for name, value in outcomes.items()}
    end = campaign.scene.run.end_time
    said = [
        _what(campaign.scene, place) for place in count_missing(campaign, found, np.array([True]))
    ]
    said += [
        f"spring.{name} does not come to the end of its stroke, and pushes on"
        for name, time in springs.items()
        if np.isnan(time)
    ]
    return [f"{one} in {case}, which ends at {end:g} s" for one in said]


def _what(scene: Scene, place: str) -> str:
    """That something does not come, in words."""
    table, _, name = place.partition(".")
    if table == "motor":
        return f"{place} does not light"
    if table == "event":
        return f"{place} does not come"
    optional = any(release.joint == name and release.optional for release in scene.release)
    return f"{place} does not become free{' (its release is optional)' if optional else ''}"
