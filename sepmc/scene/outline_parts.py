"""Parts of outlines that a clearance is measured between."""

from collections.abc import Iterator

from sepmc.scene.model import Clearance, Part, Scene
from sepmc.scene.parameters import item_names


def selected_numbers(scene: Scene, clearance: Clearance, side: int) -> list[int]:
    """Indices of the parts that a clearance names of its first (``side`` 0) or second (1) body; of
    all parts if it names none. Unknown names are left out."""
    body, names = clearance.bodies[side], clearance.outlines[side]
    outline = scene.body[body].outline if body in scene.body else ()
    return [number for number, name in enumerate(item_names(outline)) if not names or name in names]


def selected_parts(scene: Scene, clearance: Clearance, side: int) -> list[Part]:
    """Parts of an outline that a clearance names; see `selected_numbers`."""
    numbers = selected_numbers(scene, clearance, side)
    return [scene.body[clearance.bodies[side]].outline[number] for number in numbers]


def element_count(part: Part) -> int:
    """Number of elements of a part: 1 for a frustum and 1 more for its sector, or its number of
    points."""
    return (part.stations is not None) + (part.sector is not None) + len(part.points)


def packed_runs(scene: Scene, clearance: Clearance, side: int) -> Iterator[tuple[int, int]]:
    """Yield the runs of consecutive elements (`element_count`) of a body's outline that a clearance
    names of its first (``side`` 0) or second (1) body: index of the first, and count."""
    chosen = set(selected_numbers(scene, clearance, side))
    first = end = position = 0
    for number, part in enumerate(scene.body[clearance.bodies[side]].outline):
        count = element_count(part)
        if number in chosen:
            if end != position:
                if end > first:
                    yield first, end - first
                first = position
            end = position + count
        position += count
    if end > first:
        yield first, end - first
