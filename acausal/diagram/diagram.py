"""`acausal.diagram`: connection diagrams of models."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from acausal.browser.page import Wrapped, asset, page
from acausal.diagram.graph import Graph, graph_of
from acausal.errors import InternalError, UsageError, meant
from acausal.language.component import Component
from acausal.result.files import atomic, check_suffix

FORMATS = (".svg", ".html")


@dataclass(frozen=True, eq=False)
class Diagram:
    """The graph of a model, and the paths of the blocks whose inside is shown."""

    graph: Graph
    opened: tuple[str, ...] = ()

    def svg(self) -> str:
        """The picture; UsageError AC084 without dukpy."""
        return to_svg(self.graph, list(self.opened))

    def html(self) -> str:
        """A page in which blocks open and close on a click; laid out in the browser, without a network."""
        return to_page(self.graph, list(self.opened))

    def _repr_svg_(self) -> str:
        return self.svg()

    def save(self, path: str | Path) -> Path:
        """Write `.svg` or `.html`; UsageError AC012 or AC013."""
        path = check_diagram_file(Path(path))
        content = self.svg() if path.suffix.lower() == ".svg" else self.html()
        with atomic(path) as file:
            file.write(content.encode())
        return path


def check_diagram_file(path: Path) -> Path:
    """The path itself; UsageError AC013 when its suffix is none of `FORMATS`."""
    check_suffix(path, FORMATS, "format of diagrams")
    return path


def diagram(model: Component, *, depth: int = 1, opened: Sequence[str] = ()) -> Diagram:
    """Draw the connection diagram of a model.

    Parameters
    ----------
    model
        A component; parameters need no values.
    depth
        How many levels of composition are shown: 1 shows the parts of the model, 2 the parts of these, too.
    opened
        Paths of further blocks whose parts are shown.

    Raises
    ------
    UsageError
        AC020 for a path that is no block with parts.
    """
    graph = graph_of(model)
    composites = {path: level for path, level in _composites(graph, 0)}
    for path in opened:
        if path not in composites:
            raise UsageError(
                "AC020",
                f"{graph['name']} has no block '{path}' that could be opened",
                evidence=meant(path, list(composites)),
                help=f"blocks with parts: {', '.join(sorted(composites)[:12]) or 'none'}",
            )
    shown = [path for path, level in composites.items() if level < depth or path in opened]
    # an open block is visible only if the blocks around it are open
    enclosing = {path[:k] for path in opened for k, letter in enumerate(path) if letter == "."}
    return Diagram(graph, tuple(p for p in composites if p in shown or p in enclosing))


def _composites(graph: Graph, level: int) -> Iterator[tuple[str, int]]:
    for block in graph["blocks"]:
        if block["blocks"]:
            yield block["path"], level + 1
            yield from _composites(block, level + 1)


# ELK expects a web worker; without one it runs synchronously, given a setTimeout.
_SHIMS = """
var global = this, module = {exports: {}}, exports = module.exports;
var setTimeout = function (call) { call(); };
"""


def to_svg(graph: Graph, opened: list[str]) -> str:
    """The picture of a graph with the inside of the blocks at `opened` shown, too.

    Raises UsageError: AC084 when dukpy is not installed.
    """
    answer: dict[str, Any] = _engine().evaljs(
        """
        var found = {}, opened = {};
        for (var i = 0; i < dukpy.opened.length; i++) opened[dukpy.opened[i]] = true;
        function drawn(layout) { found.svg = diagramSvg(layout); }
        function failed(error) { found.error = String(error.message || error); }
        diagramLayout(dukpy.graph, opened, Elk, drawn, failed);
        found
        """,
        graph=graph,
        opened=opened,
    )
    if "svg" not in answer:
        raise InternalError("AC908", f"the layout of {graph['name']} failed: {answer.get('error')}")
    return str(answer["svg"])


@cache
def _engine() -> Any:
    """A JavaScript interpreter with ELK, which takes a second to load, and the drawing functions."""
    try:
        import dukpy
    except ImportError as error:
        raise UsageError("AC084", "diagrams are laid out with dukpy", help="python -m pip install dukpy") from error
    engine = dukpy.JSInterpreter()
    engine.evaljs(
        f"{_SHIMS}\n(function () {{ {asset('elk-worker.min.js')} \n}})(); var Elk = module.exports['default']; 1"
    )
    engine.evaljs(asset("diagram.js") + "\n1")
    return engine


_BODY = """\
<header><h1></h1><span class="hint">click a block marked + to open it, its title to close it; wheel and drag to look
around</span><button id="fit">whole diagram</button></header>
<div id="view"></div>"""
ELK = Wrapped("elk-worker.min.js", "elkModule")


def to_page(graph: Graph, opened: list[str]) -> str:
    """One HTML file with the graph and ELK, which lays it out again whenever a block opens."""
    data = {"graph": graph, "opened": opened}
    return page(graph["name"], _BODY, data, (ELK, "diagram.js", "diagram-page.js"), ("diagram-page.css",))
