"""Diagrams: what is connected in them is what is connected in the model, and Figures 3 and 5 of the founding paper."""

from __future__ import annotations

import importlib
from itertools import product
from pathlib import Path

import pytest

import acausal
from acausal import Component, Connector, Equations, Real, connect, flow, signal_input, signal_output, variable
from acausal.diagram.graph import graph_of
from acausal.errors import UsageError
from acausal.library.blocks import Gain, Sine
from acausal.library.drilling import DrillingForce
from acausal.library.electrical import Capacitor, Ground, HeatingResistor, Resistor, StepVoltage
from acausal.library.multibody import Prismatic, Revolute
from acausal.models.drilling_control import ForceControlledDrilling
from acausal.models.drilling_dynamic import ThickBlock
from acausal.models.oscillator import Oscillator
from acausal.models.pendulum_chain import PendulumChain
from acausal.models.rc_circuit import RCCircuit
from tests.browser.chromium import probe
from tests.diagram.drawn import crossing, drawn, slanted, squares, text_boxes

pytest.importorskip("dukpy")


class Pipe(Connector):
    """A connector of another domain."""

    p: Real = variable(unit="Pa")
    q: Real = flow(unit="m3/s")


class Tank(Component):
    """One connector."""

    port: Pipe = Pipe()
    level: Real = signal_output(unit="m")

    def equations(self) -> Equations:
        yield self.port.p == 1.0
        yield self.level == 1.0


class Inner(Component):
    """A composite with a signal in, a signal out, and a circuit."""

    u: Real = signal_input()
    y: Real = signal_output()
    first: Gain = Gain(k=2.0)
    second: Gain = Gain(k=3.0)
    tank: Tank = Tank()
    other: Tank = Tank()

    def equations(self) -> Equations:
        yield connect(self.u, self.first.u)
        yield connect(self.first.y, self.second.u)
        yield connect(self.second.y, self.y)
        yield connect(self.tank.port, self.other.port)


class Outer(Component):
    """Two levels."""

    sine: Sine = Sine(f=1.0)
    inner: Inner = Inner()
    gain: Gain = Gain(k=1.0)

    def equations(self) -> Equations:
        yield connect(self.sine.y, self.inner.u)
        yield connect(self.inner.y, self.gain.u)


def test_edges_are_the_connections_from_sources_to_sinks() -> None:
    graph = graph_of(Outer())
    ends = {(".".join(e["from"]), ".".join(e["to"])) for e in graph["edges"]}
    assert ends == {("sine.y", "inner.u"), ("inner.y", "gain.u")}
    (inner,) = (b for b in graph["blocks"] if b["path"] == "inner")
    kinds = {(".".join(e["from"]), ".".join(e["to"]), e["domain"]) for e in inner["edges"]}
    assert kinds == {
        ("inner.u", "inner.first.u", "signal"),
        ("inner.first.y", "inner.second.u", "signal"),
        ("inner.second.y", "inner.y", "signal"),
        ("inner.tank.port", "inner.other.port", "other"),
    }


def test_a_connection_of_many_has_a_line_less_than_ends() -> None:
    """Trees: n ends need n - 1 lines; the circuit has 7 ends in 3 connections."""
    edges = graph_of(RCCircuit())["edges"]
    assert len(edges) == 7 - 3
    assert {e["domain"] for e in edges} == {"electrical"}
    assert not any(e["directed"] for e in edges)


def test_figure_5_of_the_paper() -> None:
    """Sources, prismatic and revolute joint, drill and workpiece: from the left to the right, the drives from above."""
    picture = drawn(ThickBlock().diagram().svg())
    x = {path: place[0] for path, place in picture.blocks.items()}
    y = {path: place[1] for path, place in picture.blocks.items()}
    assert set(x) == {p.split(".")[0] for p in x} == set(ThickBlock()._parts)
    assert x["world"] < x["slide"] < x["spindle"] < x["drill"]
    assert x["world"] < x["workpiece"]
    assert x["force_table"] < x["force"] < x["slide"]
    assert x["speed_table"] < x["turns_to_radians"] < x["speed"] < x["spindle"]
    assert y["force"] < y["slide"]
    assert y["speed"] < y["spindle"]
    assert picture.classes["speed.flange - spindle.axis"] == "rotational"
    assert picture.classes["force.flange - slide.axis"] == "translational"
    assert picture.classes["workpiece.frame_b - drill.frame_w"] or picture.classes["drill.frame_w - workpiece.frame_b"]
    assert not slanted(picture)
    assert not crossing(picture)


def test_figure_3_of_the_paper() -> None:
    """DrillGeometry -> DrillDepthCalculation -> DrillContactForce, though the force goes back to the depth."""
    picture = drawn(acausal.diagram(DrillingForce(t=0.05, k=1e8, d_c=2e4)).svg())
    x = {path: place[0] for path, place in picture.blocks.items()}
    assert list(sorted(x, key=lambda p: x[p])) == ["geometry", "depth", "force"]
    assert {"geometry.s - depth.s", "depth.s_tar - force.s_tar", "geometry.d_O - force.d_O"} <= set(picture.lines)
    assert {"DrillGeometry", "DrillDepthCalculation", "DrillContactForce", "s_tar"} <= set(picture.texts)
    assert not slanted(picture)
    assert not crossing(picture)


@pytest.mark.parametrize(
    "model",
    [Oscillator(), RCCircuit(), PendulumChain(n=5), ForceControlledDrilling(), Outer()],
    ids=lambda m: type(m).__name__,
)
def test_lines_are_orthogonal_and_keep_out_of_blocks(model: Component) -> None:
    picture = drawn(model.diagram().svg())
    assert len(picture.lines) == len(graph_of(model)["edges"])
    assert not slanted(picture)
    assert not crossing(picture)


def test_connectors_are_where_lines_end() -> None:
    """frame_a at the left, frame_b at the right, the drive on top, half way along the side of a symbol."""
    picture = drawn(ThickBlock().diagram().svg())
    x, y, width, height = picture.blocks["spindle"]
    ends = [p for sections in picture.lines.values() for points in sections for p in (points[0], points[-1])]
    for place in ((x, y + height / 2), (x + width, y + height / 2), (x + width / 2, y)):
        assert any(abs(u - place[0]) <= 6.1 and abs(v - place[1]) <= 6.1 for u, v in ends), place


def test_depth_on_demand() -> None:
    closed = drawn(Outer().diagram().svg())
    assert set(closed.blocks) == {"sine", "inner", "gain"}
    for opened in (Outer().diagram(depth=2), Outer().diagram(opened=["inner"])):
        picture = drawn(opened.svg())
        assert set(picture.compounds) == {"", "inner"}
        assert set(picture.blocks) == {"sine", "gain", "inner.first", "inner.second", "inner.tank", "inner.other"}
        x, y, width, height = picture.compounds["inner"]
        for path in ("inner.first", "inner.tank"):
            u, v, w, h = picture.blocks[path]
            assert x < u < u + w < x + width
            assert y < v < v + h < y + height
        assert "inner.u - inner.first.u" in picture.lines
        assert not crossing(picture)
    with pytest.raises(UsageError, match="AC020"):
        Outer().diagram(opened=["gain"])


def test_values_that_were_given_are_shown() -> None:
    class Circuit(Component):
        """As in a textbook."""

        source: StepVoltage = StepVoltage(V=10.0)
        R1: Resistor = Resistor(R=47.0)
        C1: Capacitor = Capacitor(C=1e-6)
        ground: Ground = Ground()

        def equations(self) -> Equations:
            yield connect(self.source.p, self.R1.p)
            yield connect(self.R1.n, self.C1.p)
            yield connect(self.C1.n, self.source.n, self.ground.p)

    texts = drawn(Circuit().diagram().svg()).texts
    assert {"R = 47 Ohm", "C = 1e-06 F", "V = 10 V"} <= set(texts)


def test_every_symbol_belongs_to_a_class_and_is_svg() -> None:
    import xml.etree.ElementTree as ET

    from acausal.cli.arguments.catalogue import library_parts
    from acausal.diagram.symbols import _symbols, family_of

    classes = [getattr(importlib.import_module(p.module), p.name) for p in library_parts()]
    names = {(family, c.__name__) for cls in classes for c in cls.__mro__ for family in ("", family_of(c))}
    for key, symbol in _symbols().items():
        family, _, name = key.rpartition(".")
        assert (family, name) in names, key
        ET.fromstring(f"<g>{symbol}</g>")


@pytest.mark.parametrize("cls", [Prismatic, Revolute, Resistor, HeatingResistor])
def test_no_connector_lies_on_a_name(cls: type[Component]) -> None:
    """Joints have drives above and below; the name stands beside the line of the upper one."""
    svg = cls().diagram().svg()
    pairs = list(product(text_boxes(svg), squares(svg)))
    assert pairs
    for (a, b, c, d), (x, y, u, v) in pairs:
        assert c <= x or u <= a or d <= y or v <= b


def test_every_shipped_model_has_a_graph() -> None:
    from acausal.cli.arguments.shipped import shipped_models

    for shipped in shipped_models():
        model = getattr(importlib.import_module(shipped.module), shipped.name)()
        graph = graph_of(model)
        assert {b["name"] for b in graph["blocks"]} == {
            i for name, p in model._parts.items() for i in _names(name, p) if not name.startswith("_")
        }


def _names(name: str, value: object) -> list[str]:
    members = value if isinstance(value, list) else [value]
    shown = [m for m in members if not isinstance(m, Connector)]
    return [f"{name}[{k}]" for k in range(len(shown))] if isinstance(value, list) else [name] * len(shown)


def test_the_picture_needs_no_browser() -> None:
    """Programs that convert and print SVG know no variables of CSS: what they do not know is black."""
    svg = ThickBlock().diagram().svg()
    assert "var(" not in svg
    assert "color-mix" not in svg
    assert "prefers-color-scheme" in svg


def test_the_page_opens_and_closes_blocks(tmp_path: Path) -> None:
    script = """
      await app.ready;
      const closed = app.blocks();
      await app.open("inner");
      const open = app.blocks();
      document.querySelector('[data-path="inner"]').dispatchEvent(new MouseEvent("click", {bubbles: true}));
      await new Promise((r) => setTimeout(r, 500));
      return {closed, open, again: app.blocks()};
    """
    found = probe(acausal.diagram(Outer()).html(), script, tmp_path)
    assert set(found["closed"]) == {"", "sine", "inner", "gain"} == set(found["again"])
    assert {"inner.first", "inner.tank"} <= set(found["open"])
