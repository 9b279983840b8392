"""Layout and drawing in this process: `diagram.js` and ELK, run by Duktape."""

from __future__ import annotations

from functools import cache
from typing import Any

from acausal.browser.page import asset
from acausal.diagram.graph import Graph
from acausal.errors import InternalError, UsageError

# ELK asks for a worker of its own; without one it works at once, when there is something that waits.
_SHIMS = """
var global = this, module = {exports: {}}, exports = module.exports;
var setTimeout = function (call) { call(); };
"""


def to_svg(graph: Graph, opened: list[str]) -> str:
    """The picture of a graph with the inside of the blocks at `opened` shown, too.

    Raises
    ------
    UsageError
        AC084 when dukpy is not installed.
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
    """An interpreter that has read ELK, which takes a second, and the drawing."""
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
