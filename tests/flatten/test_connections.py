"""Junctions: potentials equal, flows sum to zero, inside and outside of hierarchical connectors told apart.

All circuits are resistors to ground potential 0 fed by one current source; expected values are Kirchhoff's.
"""

from __future__ import annotations

import pytest

import acausal
from acausal import (
    Component,
    Connector,
    Equations,
    Real,
    connect,
    flow,
    parameter,
    part,
    structural,
    variable,
)
from acausal.errors import StructureError

CURRENT = 6.0


class Pin(Connector):
    v: Real = variable(unit="V")
    i: Real = flow(unit="A")


class Load(Component):
    """A resistor to the potential zero."""

    pin: Pin = Pin()
    R: Real = parameter(unit="Ohm")

    def equations(self) -> Equations:
        yield self.pin.v == self.R * self.pin.i


class Supply(Component):
    pin: Pin = Pin()

    def equations(self) -> Equations:
        yield self.pin.i == -CURRENT


class Wire(Component):
    """A leaf that connects its own pins."""

    a: Pin = Pin()
    b: Pin = Pin()

    def equations(self) -> Equations:
        yield connect(self.a, self.b)


class Box(Component):
    """Loads behind one outer pin, `depth` shells deep."""

    pin: Pin = Pin()
    inner: Box | None = part()
    loads: list[Load] = part()
    depth: int = structural(default=0)

    def build(self) -> None:
        self.inner = Box(depth=self.depth - 1) if self.depth else []  # type: ignore[assignment]
        self.loads = [Load(R=2.0), Load(R=3.0)]

    def equations(self) -> Equations:
        yield connect(self.pin, *(load.pin for load in self.loads))
        if self.depth and isinstance(self.inner, Box):
            yield connect(self.pin, self.inner.pin)


def test_three_way_junction() -> None:
    """v = I / (1/R1 + 1/R2)."""

    class Circuit(Component):
        supply: Supply = Supply()
        a: Load = Load(R=2.0)
        b: Load = Load(R=3.0)

        def equations(self) -> Equations:
            yield connect(self.supply.pin, self.a.pin, self.b.pin)

    result = acausal.simulate(Circuit())
    v = CURRENT / (1 / 2 + 1 / 3)
    assert result.final("supply.pin.v") == pytest.approx(v)
    assert result.final("a.pin.i") == pytest.approx(v / 2)
    assert result.final("b.pin.i") == pytest.approx(v / 3)


@pytest.mark.parametrize("depth", [0, 1, 3])
def test_hierarchical_connectors(depth: int) -> None:
    """Every shell adds the conductance 1/2 + 1/3, and passes on what the inner shells take."""

    class Circuit(Component):
        supply: Supply = Supply()
        box: Box = Box(depth=depth)

        def equations(self) -> Equations:
            yield connect(self.supply.pin, self.box.pin)

    result = acausal.simulate(Circuit())
    per_shell = 1 / 2 + 1 / 3
    v = CURRENT / (per_shell * (depth + 1))
    path = "box"
    for level in range(depth + 1):
        assert result.final(f"{path}.pin.v") == pytest.approx(v)
        assert result.final(f"{path}.pin.i") == pytest.approx(v * per_shell * (depth + 1 - level))
        assert result.final(f"{path}.loads[0].pin.i") == pytest.approx(v / 2)
        path += ".inner"


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_wires_in_series(order: tuple[int, int]) -> None:
    """A leaf that short-circuits its own pins: what enters at a leaves at b; written in either order."""

    class Circuit(Component):
        supply: Supply = Supply()
        wires: list[Wire] = part()
        load: Load = Load(R=2.0)

        def build(self) -> None:
            self.wires = [Wire(), Wire()]

        def equations(self) -> Equations:
            first, last = (self.wires[k] for k in order)
            yield connect(first.b, last.a)
            yield connect(self.supply.pin, first.a)
            yield connect(last.b, self.load.pin)

    result = acausal.simulate(Circuit())
    for k in (0, 1):
        assert result.final(f"wires[{k}].a.i") == pytest.approx(CURRENT)
        assert result.final(f"wires[{k}].b.i") == pytest.approx(-CURRENT)
    assert result.final("load.pin.v") == pytest.approx(2.0 * CURRENT)


def test_what_is_not_connected_carries_nothing() -> None:
    class Alone(Component):
        load: Load = Load(R=2.0)
        box: Box = Box(depth=1)

    result = acausal.simulate(Alone())
    for name in ("load.pin.i", "box.pin.i", "box.inner.pin.i", "box.inner.loads[1].pin.i"):
        assert result.final(name) == pytest.approx(0.0, abs=1e-15)


def test_outer_connector_of_the_model_itself() -> None:
    """The model's own pin is connected inside only; outside there is nothing, so its flow is zero."""

    class Circuit(Component):
        pin: Pin = Pin()
        supply: Supply = Supply()
        load: Load = Load(R=2.0)

        def equations(self) -> Equations:
            yield connect(self.pin, self.supply.pin)
            yield connect(self.load.pin, self.pin)

    result = acausal.simulate(Circuit())
    assert result.final("pin.i") == 0.0
    assert result.final("load.pin.i") == pytest.approx(CURRENT)


def test_repeated_and_circular_connections_say_nothing_new() -> None:
    class Circuit(Component):
        supply: Supply = Supply()
        a: Load = Load(R=2.0)
        b: Load = Load(R=2.0)

        def equations(self) -> Equations:
            yield connect(self.supply.pin, self.a.pin)
            yield connect(self.a.pin, self.b.pin)
            yield connect(self.b.pin, self.supply.pin)
            yield connect(self.supply.pin, self.a.pin)

    assert acausal.simulate(Circuit()).final("a.pin.v") == pytest.approx(CURRENT)


def test_equations_of_a_junction_name_their_members() -> None:
    class Circuit(Component):
        box: Box = Box(depth=0)
        supply: Supply = Supply()

        def equations(self) -> Equations:
            yield connect(self.box.pin, self.supply.pin)

    flat = acausal.flatten(Circuit())
    flows = {flat.text(e) for e in flat.equations if "sum to zero" in flat.text(e)}
    assert flows == {
        "the i of box.pin, supply.pin sum to zero",
        "the i of box.pin, box.loads[0].pin, box.loads[1].pin sum to zero",
    }


def test_a_circuit_of_wires_leaves_their_currents_open() -> None:
    """Two wires side by side: nobody knows how the current is shared."""

    class Parallel(Component):
        supply: Supply = Supply()
        load: Load = Load(R=2.0)
        a: Wire = Wire()
        b: Wire = Wire()

        def equations(self) -> Equations:
            yield connect(self.supply.pin, self.a.a, self.b.a)
            yield connect(self.load.pin, self.a.b, self.b.b)

    with pytest.raises(StructureError, match=r"AC2\d\d"):
        acausal.simulate(Parallel())
