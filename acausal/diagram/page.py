"""The page of a diagram, in which blocks open on a click."""

from __future__ import annotations

from acausal.browser.page import Wrapped, page
from acausal.diagram.graph import Graph

_BODY = """\
<header><h1></h1><span class="hint">click a block marked + to open it, its title to close it; wheel and drag to look
around</span><button id="fit">whole diagram</button></header>
<div id="view"></div>"""
ELK = Wrapped("elk-worker.min.js", "elkModule")


def to_page(graph: Graph, opened: list[str]) -> str:
    """One HTML file with the graph and ELK, which lays it out again whenever a block opens."""
    data = {"graph": graph, "opened": opened}
    return page(graph["name"], _BODY, data, (ELK, "diagram.js", "diagram-page.js"), ("diagram-page.css",))
