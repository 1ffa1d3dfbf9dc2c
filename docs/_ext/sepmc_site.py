"""Sphinx extension: tables generated from the package, and equations as MathML.

A line ``{{ table: NAME }}`` of a page becomes the table of that name in `tables.TABLES`. MathML
needs no script from a network, so the site can be read offline.
"""

import re
from typing import Any

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml
from tables import TABLES

_TABLE = re.compile(r"^\{\{ table: (\w+) \}\}$", re.MULTILINE)


def _insert_tables(app: Any, name: str, source: list[str]) -> None:
    """Replace table marks in the text of a page."""
    source[0] = _TABLE.sub(lambda match: TABLES[match[1]](), source[0])


def _inline(translator: Any, node: Any) -> None:
    """Write inline mathematics."""
    translator.body.append(tex2mathml(node.astext()))
    raise nodes.SkipNode


def _block(translator: Any, node: Any) -> None:
    """Write a displayed equation, with its label as the target of links."""
    label = f' id="{node["ids"][0]}"' if node["ids"] else ""
    math = tex2mathml(node.astext(), as_block=True)
    translator.body.append(f'<div class="equation"{label}>{math}</div>\n')
    raise nodes.SkipNode


def setup(app: Any) -> dict[str, bool]:
    """Register with Sphinx."""
    app.connect("source-read", _insert_tables)
    app.add_html_math_renderer("mathml", (_inline, None), (_block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
