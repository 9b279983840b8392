"""Formulas as MathML, which browsers draw themselves: a page needs no network and no script."""

from __future__ import annotations

import html
import re
from typing import Any

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.application import Sphinx


def setup(app: Sphinx) -> dict[str, bool]:
    """Sphinx asks this of every extension."""
    app.add_html_math_renderer("mathml", (_inline, None), (_block, None))
    app.connect("doctree-resolved", _in_tables)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _inline(writer: Any, node: nodes.math) -> None:
    writer.body.append(tex2mathml(node.astext()))
    raise nodes.SkipNode


def _block(writer: Any, node: nodes.math_block) -> None:
    writer.body.append(_shown(node.astext()))
    raise nodes.SkipNode


def _shown(formula: str) -> str:
    # A wide one scrolls instead of widening the page; what scrolls in one direction is cut in the other without room.
    return f'<div class="math" style="overflow-x: auto; padding: 0.4em 0">{tex2mathml(formula, as_block=True)}</div>'


def _in_tables(app: Sphinx, document: nodes.document, name: str) -> None:
    """Formulas in what components show of themselves: notebooks find them by their delimiters."""
    for node in document.findall(nodes.raw):
        if node.get("format") == "html" and "\\(" in node.astext():
            text = re.sub(
                r"<div class='math notranslate'>\\\((.*?)\\\)</div>",
                lambda found: _shown(html.unescape(found[1])),
                node.astext(),
                flags=re.DOTALL,
            )
            node.children = [nodes.Text(text)]
