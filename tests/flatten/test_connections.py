"""Connections: potentials equal, flows sum to zero, signals have one source; idle ends are told."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

import acausal
from acausal import (
    Component,
    Connector,
    Equations,
    Real,
    connect,
    der,
    fixed,
    flow,
    parameter,
    part,
    signal_input,
    signal_output,
    structural,
    variable,
)
from acausal.errors import DeclarationError, StructureError, UnitError
from acausal.library.electrical import Capacitor, Ground, Resistor
from acausal.library.multibody import BodyShape, PointMass, Revolute, World
from acausal.library.rotational import Damper, IdealGearWithSupport, Inertia, RelSpeedSensor, TorqueSensor
from tests.expected import fails_with

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


class Source(Component):
    y: Real = signal_output(unit="A")

    def equations(self) -> Equations:
        yield self.y == 4.0


class Sink(Component):
    u: Real = signal_input(unit="A")
    y: Real = signal_output(unit="A")

    def equations(self) -> Equations:
        yield self.y == 2 * self.u


class Filter(Component):
    """Its own input feeds a part, whose output is its own output."""

    u: Real = signal_input(unit="A")
    y: Real = signal_output(unit="A")
    sink: Sink = Sink()

    def equations(self) -> Equations:
        yield connect(self.u, self.sink.u)
        yield connect(self.sink.y, self.y)


def test_signals_through_the_hierarchy() -> None:
    class Line(Component):
        source: Source = Source()
        filter: Filter = Filter()
        many: list[Sink] = part()

        def build(self) -> None:
            self.many = [Sink(), Sink()]

        def equations(self) -> Equations:
            yield connect(self.source.y, self.filter.u)
            yield connect(self.filter.y, *(s.u for s in self.many))

    result = acausal.simulate(Line())
    assert result.final("filter.y") == 8.0
    assert result.final("many[1].y") == 16.0


@pytest.mark.parametrize(("given", "expected"), [({"u": 5.0}, 10.0), ({}, 3.0)])
def test_input_bound_or_defaulted_and_passed_on(given: dict[str, Any], expected: float) -> None:
    """An input with a number of its own that its component connects to a part."""

    class Defaulted(Component):
        u: Real = signal_input(unit="A", default=1.5)
        sink: Sink = Sink()

        def equations(self) -> Equations:
            yield connect(self.u, self.sink.u)

    class Line(Component):
        defaulted: Defaulted = Defaulted(**given)

    assert acausal.simulate(Line()).final("defaulted.sink.y") == expected
    assert acausal.simulate(Defaulted(**given)).final("sink.y") == expected


def test_input_bound_and_connected() -> None:
    class Both(Component):
        source: Source = Source()
        sink: Sink = Sink(u=3.0)

        def equations(self) -> Equations:
            yield connect(self.source.y, self.sink.u)

    with fails_with(DeclarationError, "AC137"):
        acausal.flatten(Both())


def test_two_sources_on_one_signal() -> None:
    class Twice(Component):
        a: Source = Source()
        b: Source = Source()
        sink: Sink = Sink()

        def equations(self) -> Equations:
            yield connect(self.a.y, self.sink.u)
            yield connect(self.b.y, self.sink.u)

    with fails_with(DeclarationError, "AC132") as caught:
        acausal.flatten(Twice())
    assert {"a.y", "b.y"} <= set(caught.value.fact.replace(":", " ").split())


class LoadSignals(Component):
    pin: Pin = Pin()
    R: Real = parameter(unit="Ohm")


class Angle(Component):
    u: Real = signal_input(unit="rad")


@pytest.mark.parametrize(
    ("make", "code", "kind"),
    [
        (lambda: connect(Pin(), Source().y), "AC120", DeclarationError),
        (lambda: connect(Source().y, Angle().u), "AC154", UnitError),
        (lambda: connect(LoadSignals(R=1.0).R, Source().y), "AC121", DeclarationError),
        (lambda: connect(LoadSignals(R=1.0), LoadSignals(R=1.0)), "AC121", DeclarationError),  # type: ignore[type-var]
    ],
)
def test_what_cannot_be_connected(make: Callable[[], object], code: str, kind: type[DeclarationError]) -> None:
    with fails_with(kind, code):
        make()


class Pendulum(Component):
    """A pendulum whose bearing is damped, or only seems to be."""

    world: World = World()
    joint: Revolute = Revolute(phi=fixed(0.0), w=fixed(0.0))
    body: BodyShape = BodyShape(m=1.0, r=(1.0, 0.0, 0.0), r_CM=(0.5, 0.0, 0.0))
    damper: Damper = Damper(d=5.0)

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.joint.frame_a)
        yield connect(self.joint.frame_b, self.body.frame_a)
        yield connect(self.joint.axis, self.damper.flange_b)


class Damped(Pendulum):
    def equations(self) -> Equations:
        yield connect(self.joint.support, self.damper.flange_a)


NOTE = "damper.flange_a is connected to nothing: nothing flows through damper, as if it were not there"


def test_a_damper_with_an_open_end_is_told() -> None:
    """Its loss is none, that of one with both ends is what the pendulum has lost; other ends are open in both."""
    lost = {}
    for model in (Pendulum, Damped):
        result = acausal.simulate(model(), stop_time=2.0)
        lost[model] = abs(result["damper.loss_power"]).max()
        assert (NOTE in result.stats["notes"]) is (model is Pendulum)  # type: ignore[operator]
    assert lost[Pendulum] < 1e-12 < lost[Damped]


def test_open_ends_that_lose_nothing_are_no_notes() -> None:
    class Shafts(Component):
        a: Inertia = Inertia(J=1.0, phi=fixed(0.0), w=fixed(1.0))
        b: Inertia = Inertia(J=2.0)
        torque: TorqueSensor = TorqueSensor()
        speed: RelSpeedSensor = RelSpeedSensor()

        def equations(self) -> Equations:
            yield connect(self.a.flange_b, self.torque.flange_a, self.speed.flange_a)
            yield connect(self.torque.flange_b, self.b.flange_a, self.speed.flange_b)

    assert acausal.flatten(Shafts()).notes == ()


def test_an_open_pin() -> None:
    class Circuit(Component):
        c: Capacitor = Capacitor(C=1.0, v=fixed(1.0))
        r: Resistor = Resistor(R=1.0)
        ground: Ground = Ground()

        def equations(self) -> Equations:
            yield connect(self.c.p, self.r.p)
            yield connect(self.c.n, self.ground.p)

    assert any(note.startswith("r.n is connected to nothing") for note in acausal.flatten(Circuit()).notes)


def test_a_gear_without_a_housing_is_refused() -> None:
    """It would transmit no torque: the second shaft would stand still beside the first."""

    class Geared(Component):
        a: Inertia = Inertia(J=1.0, phi=fixed(0.0), w=fixed(1.0))
        gear: IdealGearWithSupport = IdealGearWithSupport(ratio=2.0)
        b: Inertia = Inertia(J=1.0)

        def equations(self) -> Equations:
            yield connect(self.a.flange_b, self.gear.flange_a)
            yield connect(self.gear.flange_b, self.b.flange_a)

    with fails_with(StructureError, "AC212"):
        acausal.compile(Geared())


class Falling(Component):
    """A mass under gravity, of which the strength or the whole vector may be given."""

    world: World = World()
    mass: PointMass = PointMass(m=1.0, r_0=fixed((0.0, 0.0, 0.0)), v_0=fixed((0.0, 0.0, 0.0)))


class Upwards(Component):
    """Gravity as a vector: its strength `world.g` is no part of it."""

    world: World = World(g_0=(0.0, 3.0, 0.0))
    mass: PointMass = PointMass(m=1.0, r_0=fixed((0.0, 0.0, 0.0)), v_0=fixed((0.0, 0.0, 0.0)))


@pytest.mark.parametrize("compiled", [False, True])
@pytest.mark.parametrize(("model", "way"), [(Falling, -1.0), (Upwards, 1.5)])
def test_a_gravity_that_nobody_feels_is_told(model: type[Component], way: float, compiled: bool) -> None:
    """A fall of one second is half the gravity that acts; where that is not the one set, a note says so."""
    made = acausal.compile(model()) if compiled else model()
    result = acausal.simulate(made, stop_time=1.0, parameters={"world.g": 2.0})
    assert result.final("mass.r_0[1]") == pytest.approx(way, abs=1e-9)
    told = "world.g is set, but nothing in the model depends on it" in result.stats["notes"]  # type: ignore[operator]
    assert told is (model is Upwards)


def test_what_acts_at_the_start_or_through_another_parameter_is_heard() -> None:
    class Decay(Component):
        k: Real = parameter(default=1.0)
        twice: Real = parameter(default=lambda self: 2.0 * self.k)
        begin: Real = parameter(default=3.0)
        idle: Real = parameter(default=(1.0, 2.0), shape=2)
        x: Real = variable(default=lambda self: fixed(self.begin))

        def equations(self) -> Equations:
            yield der(self.x) == -self.twice * self.x

    values = {"k": 0.5, "begin": 2.0, "idle": (3.0, 4.0)}
    assert acausal.flatten(Decay(), parameters=values).notes == ("idle is set, but nothing in the model depends on it",)


def test_a_part_in_a_list_is_told_too() -> None:
    """Its index is no index of the parameter."""

    class Decay(Component):
        idle: Real = parameter(default=1.0)
        x: Real = variable(default=fixed(1.0))

        def equations(self) -> Equations:
            yield der(self.x) == -self.x

    class Row(Component):
        members: list[Decay] = part()

        def build(self) -> None:
            self.members = [Decay(), Decay()]

    assert acausal.flatten(Row(), parameters={"members[1].idle": 2.0}).notes == (
        "members[1].idle is set, but nothing in the model depends on it",
    )
