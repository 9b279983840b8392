"""Slips of a modeller: code, thing that is named in the first line, and place, one row each."""

from __future__ import annotations

import math
import re
from typing import Any

import pytest

import acausal
from acausal import (
    AcausalError,
    Component,
    Equations,
    Real,
    connect,
    der,
    fixed,
    guess,
    part,
    structural,
    variable,
)
from acausal.errors import RunError
from acausal.library import multibody, rotational
from tests.expected import fails_with
from tests.messages.cases import Case, Corpus

corpus = Corpus()


class Shafts(Component):
    """Three inertias in a list."""

    shafts: list[rotational.Inertia] = part()

    def build(self) -> None:
        self.shafts = [rotational.Inertia(J=1.0) for _ in range(3)]


class Pull(Component):
    """A force and the position that it follows from."""

    f: Real = variable(unit="N")
    x: Real = variable(unit="m", shape=2)


class Bound(Component):
    """Begins at 1."""

    x: Real = variable(default=fixed(1.0))

    def equations(self) -> Equations:
        yield der(self.x) == 1.0


class Made(Component):
    """A constructor of its own that calls nobody."""

    x: Real = variable()

    def __init__(self) -> None:
        pass


class Asking(Made):
    """Another one, that asks for a field."""

    def __init__(self) -> None:
        assert self.x is not None


@corpus.broken("AC109", "Made defines __init__", "def __init__(self) -> None:")
class HoldsOne(Component):
    made: Made = Made()


@corpus.broken("AC109", "Made defines __init__", "def __init__(self) -> None:")
class ByDefault(Component):
    made: Made = Made()


@corpus.wrong("AC109", "Asking defines __init__", "def __init__(self) -> None:")
def asked() -> None:
    Asking()


@corpus.broken(
    "AC129", "Singular.equation is never called: the method is `equations`", "def equation(self) -> Equations:"
)
class Singular(Component):
    x: Real = variable()

    def equation(self) -> Equations:
        yield self.x == 1.0


@corpus.broken(
    "AC129",
    "Lost.initial_equation is never called: the method is `initial_equations`",
    "def initial_equation(self) -> Equations:",
)
class Lost(Component):
    """It compiled, and started from somewhere else."""

    x: Real = variable()

    def equations(self) -> Equations:
        yield der(self.x) == 1.0

    def initial_equation(self) -> Equations:
        yield self.x == 3.0


@corpus.broken("AC129", "Lost.initial_equation", "def initial_equation(self) -> Equations:")
class HoldsLost(Component):
    inner: Lost = Lost()


corpus.table(
    """
AC153 1 deg = 0.0174533 rad => unit="rad" -- variable(unit="deg")
AC153 1 deg/s = 0.0174533 rad/s => unit="rad/s" -- variable(unit="deg/s")
AC153 1 rpm = 0.10472 rad/s => unit="rad/s" -- variable(unit="rpm")
AC153 0 degC = 273.15 K, 1 degC = 274.15 K => unit="K" -- variable(unit="degC")
AC153 = 1.66667e-05 m/s => unit="m/s" -- variable(unit="mm/min")
AC150 unknown unit "OHM" => did you mean Ohm -- variable(unit="OHM")
AC150 unknown unit "dge" => declare in SI -- variable(unit="dge")

BoundToState(Bound) AC135 k is bound to x, which varies in time
> k: Real = parameter(default=lambda self: self.x)

StartsAtState(Bound) AC135 the start of y is bound to x, which varies in time
> y: Real = variable(default=lambda self: fixed(self.x))
yield der(self.y) == self.x

OneTooFar(Shafts) AC103 `shafts` is a list of 3 Inertia; it has no element [3]
eq: for k in range(3):
> eq:     yield connect(self.shafts[k].flange_b, self.shafts[k + 1].flange_a)

ByName(Shafts) AC103 `shafts` is a list of 3 Inertia; it has no element ['first']
eq: name: Any = "first"
> yield self.shafts[name].w == 1.0

FromOutside AC103 `inner.shafts` is a list of 3 Inertia; it has no element [-4]
inner: Shafts = Shafts()
> yield self.inner.shafts[-4].w == 1.0

LastOfNone(Shafts) AC103 `shafts` is a list of no parts
last: rotational.Inertia = part()
build: self.shafts = []
> build: self.last = self.shafts[-1]

FieldOfAList(Shafts) AC127 `shafts` is a list of 3 Inertia; the list has no field 'w'
eq: shafts: Any = self.shafts
> yield shafts.w == 1.0

ReplacedTooLate(Shafts) AC118 `shafts` is a list of 3 Inertia; none of them can be replaced
> eq: self.shafts[0] = rotational.Inertia(J=2.0)
yield self.shafts[0].w == 1.0

Assigned(Pull) AC118 Assigned.equations assigns self.f: write `yield self.f == ...`
> eq: self.f = 2.0
yield self.x == 1.0

AtTheStart(Pull) AC118 AtTheStart.initial_equations assigns self.f: write `yield self.f == ...`
yield self.x == 1.0
> start: self.f = 0.0
start: yield self.x[0] == 0.0

OfAPart AC118 OfAPart.equations assigns self.pull.f: write `yield self.pull.f == ...`
pull: Pull = Pull()
> eq: self.pull.f = 2.0
yield self.pull.x == 1.0

Element(Pull) AC118 `x[0]` is assigned: write `yield self.x[0] == ...`
eq: x: Any = self.x
> eq: x[0] = 1.0
yield self.f == 1.0

Shortcut(Pull) AC118 Shortcut.equations assigns self.h, which is not declared
> eq: self.h = 2.0 * self.f
yield self.f == self.h

TooLate(rotational.Inertia) AC118 TooLate.equations assigns self.J, a parameter
> eq: self.J = 2.0
yield self.w == 1.0

EqualAbscissae AC160 lookup (CombiTable1D): this is no table: row 3 of 3, (1.0, 3.0), does not lie beyond
lookup: blocks.CombiTable1D = <<blocks.CombiTable1D(table=((0.0, 1.0), (1.0, 2.0), (1.0, 3.0)))>>
yield self.lookup.u == time

OneOfThousands AC160 row 778 of 2000, (5.0, 0.0)
lookup: blocks.CombiTable1D = part()
build: self.lookup = <<blocks.CombiTable1D(table=tuple((5.0 if k == 777 else float(k), 0.0) for k in range(2000)))>>
yield self.lookup.u == time

OwnTable AC160 OwnTable: this is no table: row 2 of 2, (0, 2), does not lie beyond
y: Real = variable()
> yield self.y == 0.0 + blocks.table([(0, 1), (0, 2)], time)

MissingValue AC160 lookup (CombiTable1D): this is no table: row 2 of 3, (1.0, nan), holds a number that is not
lookup: blocks.CombiTable1D = <<blocks.CombiTable1D(table=((0.0, 1.0), (1.0, math.nan), (2.0, 3.0)))>>
yield self.lookup.u == time

MissingLevel AC130 source (TimeTable): row 1 of 2 of the table, (0.0, inf), holds a number that is not finite
source: blocks.TimeTable = <<blocks.TimeTable(table=((0.0, math.inf), (1.0, 2.0)))>>

TwoOutputs AC132 two sources drive one signal: sine.y and gain.y => to invert a model state `sine.y == gain.y`
sine: blocks.Sine = blocks.Sine(f=1.0)
gain: blocks.Gain = blocks.Gain(k=2.0)
> yield connect(self.sine.y, self.gain.y)

AloneResistor AC203 R.p and R.n: R is connected to nothing => or leave it out
R: electrical.Resistor = <<electrical.Resistor(R=1.0)>>
ground: electrical.Ground = electrical.Ground()

AloneJoint AC203 joint.frame_a: joint is connected to nothing => or leave it out
world: multibody.World = multibody.World()
joint: multibody.Revolute = <<multibody.Revolute()>>

RodBetweenSprings AC203 rod.frame_a: nothing moved by left and right has mass => connect a Body to rod.frame_a
# World was advised, which would hold the rod.
world: multibody.World = multibody.World()
left: multibody.Spring = multibody.Spring(c=10.0)
rod: multibody.FixedTranslation = <<multibody.FixedTranslation(r=(1.0, 0.0, 0.0))>>
right: multibody.Spring = multibody.Spring(c=10.0)
yield connect(self.world.frame_b, self.left.frame_a, self.right.frame_b)
yield connect(self.left.frame_b, self.rod.frame_a)
yield connect(self.rod.frame_b, self.right.frame_a)

RodOnABall AC203 rod.frame_a: nothing moved by ball has mass => connect a Body to rod.frame_a
world: multibody.World = multibody.World()
ball: multibody.Spherical = multibody.Spherical()
rod: multibody.FixedTranslation = <<multibody.FixedTranslation(r=(1.0, 0.0, 0.0))>>
yield connect(self.world.frame_b, self.ball.frame_a)
yield connect(self.ball.frame_b, self.rod.frame_a)

OpenHeatPort AC212 coil.heatPort is not connected => connect coil.heatPort
# With an inductor in series it compiled, and no start was found for the current.
source: electrical.SineVoltage = electrical.SineVoltage(V=10.0, f=5.0)
coil: electrical.HeatingResistor = <<electrical.HeatingResistor(R_ref=5.0, alpha=1e-3)>>
inductor: electrical.Inductor = electrical.Inductor(L=1.0)
ground: electrical.Ground = electrical.Ground()
yield connect(self.source.p, self.coil.p)
yield connect(self.coil.n, self.inductor.p)
yield connect(self.inductor.n, self.source.n, self.ground.p)

OpenBrake AC212 brake.heatPort is not connected => connect brake.heatPort
rotor: rotational.Inertia = rotational.Inertia(J=1.0, w=fixed(3.0))
brake: rotational.EddyCurrentTorque = <<rotational.EddyCurrentTorque(tau_nominal=1.0, w_nominal=10.0)>>
yield connect(self.rotor.flange_b, self.brake.flange)
yield self.brake.exc == 1.0

PointOnTheAxis AC204 equations of outer, rod and mass
# A point on the axis of the second joint does not turn with it: no loop is closed here, and none is named.
world: multibody.World = multibody.World()
inner: multibody.Revolute = multibody.Revolute()
outer: multibody.Revolute = <<multibody.Revolute(n=(1.0, 0.0, 0.0))>>
rod: multibody.FixedTranslation = <<multibody.FixedTranslation(r=(1.0, 0.0, 0.0))>>
mass: multibody.PointMass = <<multibody.PointMass(m=1.0)>>
yield connect(self.world.frame_b, self.inner.frame_a)
yield connect(self.inner.frame_b, self.outer.frame_a)
yield connect(self.outer.frame_b, self.rod.frame_a)
yield connect(self.rod.frame_b, self.mass.frame_a)

NothingToMove AC201 free.r_rel_a[0] => connect a Body there
world: multibody.World = multibody.World()
free: multibody.FreeMotion = <<multibody.FreeMotion()>>
rod: multibody.FixedTranslation = multibody.FixedTranslation(r=(1.0, 0.0, 0.0))
yield connect(self.world.frame_b, self.free.frame_a)
yield connect(self.free.frame_b, self.rod.frame_a)
""",
    globals(),
)


@pytest.mark.parametrize("case", corpus.cases, ids=str)
def test_message(case: Case) -> None:
    case.check()


@pytest.mark.parametrize("model", [rotational.Inertia, rotational.Inertia(J=1.0)])
def test_a_step_is_that_of_a_compiled_model(model: Any) -> None:
    with fails_with(AcausalError, "AC028", match="Inertia is no compiled model") as caught:
        acausal.step_function(model, 1e-3)
    assert "acausal.compile" in (caught.value.help or "")


def test_a_generator_that_is_called_has_any_name() -> None:
    """`equation` of one's own is no slip where `equations` yields from it."""

    class Called(Component):
        x: Real = variable(default=fixed(1.0))

        def equation(self) -> Equations:
            yield der(self.x) == -self.x

        def equations(self) -> Equations:
            yield from self.equation()

    assert acausal.compile(Called()).states == ("x",)


class FourBar(Component):
    """Base, crank, coupler and rocker of given lengths; the crank starts at 1 rad/s."""

    lengths: tuple[float, ...] = structural()
    start: tuple[float, ...] = structural(doc="Angle of the crank, and where the search for the two others begins")
    world: multibody.World = multibody.World()
    joints: list[multibody.Revolute] = part()
    bars: list[multibody.BodyCylinder] = part()
    base: multibody.FixedTranslation = part()
    last: multibody.RevolutePlanarLoopConstraint = part()

    def build(self) -> None:
        first, *others = self.start
        self.joints = [multibody.Revolute(phi=fixed(first), w=fixed(1.0))]
        self.joints += [multibody.Revolute(phi=guess(angle)) for angle in others]
        self.bars = [multibody.BodyCylinder(r=(length, 0.0, 0.0), diameter=0.05) for length in self.lengths[1:]]
        self.base = multibody.FixedTranslation(r=(self.lengths[0], 0.0, 0.0))
        self.last = multibody.RevolutePlanarLoopConstraint()

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.joints[0].frame_a, self.base.frame_a)
        for k, (joint, bar) in enumerate(zip(self.joints, self.bars, strict=True)):
            yield connect(joint.frame_b, bar.frame_a)
            yield connect(bar.frame_b, [*self.joints[1:], self.last][k].frame_a)
        yield connect(self.last.frame_b, self.base.frame_b)


class DrivenFourBar(FourBar):
    """At constant speed, whatever that takes."""

    motor: rotational.Speed = part()

    def build(self) -> None:
        super().build()
        self.joints[0] = multibody.Revolute(phi=fixed(self.start[0]))
        self.motor = rotational.Speed()

    def equations(self) -> Equations:
        yield connect(self.motor.flange, self.joints[0].axis)
        yield self.motor.w_ref == 1.0


@pytest.mark.parametrize(("angle", "crank", "others"), [(0.5, 1.0, (5.0, 1.5, 1.5)), (3.0, 1.0, (2.0, 1.5, 0.5))])
def test_a_loop_that_cannot_close_is_named_with_its_gap(
    angle: float, crank: float, others: tuple[float, float, float]
) -> None:
    """A four-bar whose crank is given: the gap is what its end is away from the other pivot, less both bars."""
    base, coupler, rocker = others
    gap = math.hypot(base - crank * math.cos(angle), crank * math.sin(angle)) - coupler - rocker

    with fails_with(AcausalError, "AC301") as caught:
        acausal.simulate(FourBar(lengths=(base, crank, coupler, rocker), start=(angle, 0.0, 0.0)), stop_time=0.1)
    found = re.search(r"no start satisfies `.*last\.frame_b\.r_0.*`: it is off by ([\d.]+)", caught.value.fact)
    assert found is not None, caught.value
    assert float(found[1]) == pytest.approx(gap, rel=1e-4)
    assert "self.last = " in caught.value.where[0].text


def test_the_solver_prints_nothing_of_its_own(capfd: pytest.CaptureFixture[str]) -> None:
    """x' = x^2 ends at t = 1; SUNDIALS said so fifteen times, beside the error, and where a second try went well."""

    class Growth(Component):
        x: Real = variable(default=fixed(1.0))

        def equations(self) -> Equations:
            yield der(self.x) == self.x * self.x

    with pytest.raises(AcausalError):
        acausal.simulate(Growth(), stop_time=2.0, solver="idas")
    assert capfd.readouterr().err == ""


def test_a_mechanism_that_is_stretched_out_is_named_by_its_loop() -> None:
    """At 1 rad/s from 0.3 rad coupler and rocker are in line when the diagonal is as long as both: law of cosines.

    It was said that a speed "grows without bound", because of "feedback that nothing limits".
    """
    base, crank, coupler, rocker = 2.0, 1.5, 1.0, 1.0
    angle = math.acos((base**2 + crank**2 - (coupler + rocker) ** 2) / (2.0 * base * crank))
    model = DrivenFourBar(lengths=(base, crank, coupler, rocker), start=(0.3, 1.0, -2.5))
    with fails_with(RunError, "AC402", "last.frame_b.r_0") as caught:
        acausal.simulate(model, stop_time=3.0, solver="rosenbrock")
    assert "self.last = " in caught.value.where[0].text
    stopped = re.search(r"stopped at t = ([\d.]+) s", caught.value.fact)
    assert stopped is not None
    assert float(stopped[1]) == pytest.approx(angle - 0.3, abs=1e-5)
