"""Selection of the parts of two outlines between which a clearance is measured, and their elements
in the arrays of kernels."""

from collections.abc import Iterator

from sepmc.scene.model import Clearance, Part, Scene
from sepmc.scene.parameters import item_names


def selected_numbers(scene: Scene, clearance: Clearance, side: int) -> list[int]:
    """Indices, in the outline of a clearance's first (``side`` 0) or second (1) body, of the parts
    that the clearance names; of all parts if it names none. Unknown names are left out."""
    body, names = clearance.bodies[side], clearance.outlines[side]
    outline = scene.body[body].outline if body in scene.body else ()
    return [number for number, name in enumerate(item_names(outline)) if not names or name in names]


def selected_parts(scene: Scene, clearance: Clearance, side: int) -> list[Part]:
    """Parts of a clearance's first (``side`` 0) or second (1) body whose indices `selected_numbers`
    returns."""
    numbers = selected_numbers(scene, clearance, side)
    return [scene.body[clearance.bodies[side]].outline[number] for number in numbers]


def element_count(part: Part) -> int:
    """Number of elements that a part of an outline has in the kernel's arrays: 1 for a frustum, 2
    if it has a sector, or its number of points."""
    return (part.stations is not None) + (part.sector is not None) + len(part.points)


def packed_runs(scene: Scene, clearance: Clearance, side: int) -> Iterator[tuple[int, int]]:
    """Yield (index of the first element, count) for each run of consecutive elements of the parts
    that `selected_numbers` returns; the index counts the elements (`element_count`) of the whole
    outline of the clearance's first (``side`` 0) or second (1) body."""
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
