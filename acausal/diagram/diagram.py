"""`acausal.diagram`: a model's connections as a picture."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from acausal.diagram.graph import Graph, graph_of
from acausal.diagram.layout import to_svg
from acausal.diagram.page import to_page
from acausal.errors import UsageError, nearest
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
            close = nearest(path, list(composites))
            raise UsageError(
                "AC020",
                f"{graph['name']} has no block '{path}' that could be opened",
                evidence=[f"nearest  {', '.join(close)}"] if close else [],
                help=f"blocks with parts: {', '.join(sorted(composites)[:12]) or 'none'}",
            )
    shown = [path for path, level in composites.items() if level < depth or path in opened]
    # An open block shows nothing while one around it is closed.
    around = {path[:k] for path in opened for k, letter in enumerate(path) if letter == "."}
    return Diagram(graph, tuple(p for p in composites if p in shown or p in around))


def _composites(graph: Graph, level: int) -> Iterator[tuple[str, int]]:
    for block in graph["blocks"]:
        if block["blocks"]:
            yield block["path"], level + 1
            yield from _composites(block, level + 1)
