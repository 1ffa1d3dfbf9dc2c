"""Tables in plain text."""

from collections.abc import Collection, Sequence


def text_table(rows: Sequence[Sequence[str]], left: Collection[int] = (0,)) -> list[str]:
    """Render rows of cells as lines of text with aligned columns, two blanks between columns.

    Parameters
    ----------
    rows : sequence of rows of cells
        All rows have the same number of cells; the first row is usually the header.
    left : collection of int
        Indices, from 0, of the columns aligned to the left; all others are aligned to the right.

    Returns
    -------
    list of str
        One line per row, without trailing blanks.
    """
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    sides = [str.ljust if k in left else str.rjust for k in range(len(widths))]
    return [
        "  ".join(
            side(cell, width) for side, cell, width in zip(sides, row, widths, strict=True)
        ).rstrip()
        for row in rows
    ]
