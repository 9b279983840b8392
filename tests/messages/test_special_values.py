"""Values that cannot be: a parameter outside its limits, limits the wrong way round, a zero where one divides."""

from __future__ import annotations

import math

import pytest

import acausal
from acausal import (
    AcausalError,
    Component,
    Equations,
    Real,
    connect,
    der,
    discrete,
    fixed,
    log,
    parameter,
    part,
    reset,
    sample,
    structural,
    variable,
    when,
    where,
)
from acausal.library import blocks, electrical, rotational
from tests.expected import fails_with
from tests.messages.cases import Case, Corpus

corpus = Corpus()


@corpus.broken(
    "AC204",
    "c.C = 0",
    "electrical.Capacitor(C=0.0, v=fixed(0.0))",
    text="""
error[AC204]: ZeroCapacity: equations of c do not determine der(c.v) for c.C = 0
  at      test_special_values.py:N
              c: electrical.Capacitor = electrical.Capacitor(C=0.0, v=fixed(0.0))
                                        ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
          in these it cancels for that value:
            c.i == c.C * der(c.v)   (Capacitor, electrical/components.py:N)
  cause   with other values of these parameters the equations would determine their unknowns
  help    change c.C, or model the effect that this value neglects
""",
)
class ZeroCapacity(Component):
    """Nothing is stored: the voltage of the capacitor is no state."""

    source: electrical.ConstantVoltage = electrical.ConstantVoltage(V=10.0)
    r: electrical.Resistor = electrical.Resistor(R=1.0)
    c: electrical.Capacitor = electrical.Capacitor(C=0.0, v=fixed(0.0))
    ground: electrical.Ground = electrical.Ground()

    def equations(self) -> Equations:
        yield connect(self.source.p, self.r.p)
        yield connect(self.r.n, self.c.p)
        yield connect(self.c.n, self.source.n, self.ground.p)


@corpus.broken(
    "AC204",
    "J_load = 0",
    "rotational.Inertia(J=self.J_load)",
    'J_load: Real = parameter(default=0.0, unit="kg.m2", min=0.0, doc="Inertia of the load")',
)
class ZeroInertia(Component):
    """The value is that of the model, and handed down to a part."""

    J_load: Real = parameter(default=0.0, unit="kg.m2", min=0.0, doc="Inertia of the load")
    motor: rotational.Inertia = rotational.Inertia(J=1.0)
    shaft: rotational.Spring = rotational.Spring(c=10.0)
    load: rotational.Inertia = part()

    def build(self) -> None:
        self.load = rotational.Inertia(J=self.J_load)

    def equations(self) -> Equations:
        yield connect(self.motor.flange_b, self.shaft.flange_a)
        yield connect(self.shaft.flange_b, self.load.flange_a)


corpus.table(
    """
AC178 e = 2 -- contact.HuntCrossley(k=1e5, n=1.0, e=2.0, v_0=0.01)

InfiniteFactor AC303 der(x) has no finite value at the start
x: Real = variable(default=fixed(0.0))
> yield der(self.x) == math.inf * self.x

TwoWorlds AC206 two and world
# Two origins of one mechanism, and the body hangs on both.
world: multibody.World = multibody.World()
two: multibody.World = multibody.World()
body: multibody.Body = multibody.Body(m=1.0)
> yield connect(self.world.frame_b, self.body.frame_a, self.two.frame_b)

RootOfADifference AC303 x
# What is under the root is written out, with its value.
a: Real = parameter(default=2.0)
x: Real = variable(default=fixed(1.0))
> yield der(self.x) == (self.x - self.a) ** 0.5

LimitsTheWrongWayRound AC139 limit
# The library states what its parameters must satisfy together.
wave: blocks.Sine = blocks.Sine(f=1.0)
limit: blocks.Limiter = <<blocks.Limiter(u_max=-1.0, u_min=1.0)>>
yield connect(self.wave.y, self.limit.u)

OwnDemand AC139 shorter
# A demand of the author's own, on parameters alone.
inner: Real = parameter(default=2.0, unit="m", doc="Inner length")
outer: Real = parameter(default=1.0, unit="m", doc="Outer length")
x: Real = variable(default=fixed(0.0))
yield der(self.x) == 1
> yield assert_(self.inner < self.outer, "the inner length must be shorter than the outer one")

PulseWithoutPeriod AC136 pulse.period
# The value is bound to a parameter of the model, which has no limits itself.
T: Real = parameter(default=0.0, unit="s")
pulse: blocks.Pulse = part()
build: self.pulse = <<blocks.Pulse(period=self.T)>>

default_that_asks_a_part AC114 mass
class Shadow(Component):
>     m: Real = parameter(default=lambda self: self.mass.J, unit="kg.m2")
    mass: rotational.Inertia = part()
Shadow()

DivisionByAParameter AC303 k = 0
# The parameter is to blame, not the state.
> k: Real = parameter(default=0.0, doc="Factor")
x: Real = variable(default=fixed(1.0))
> yield der(self.x) == 1 / self.k
""",
    globals(),
)


@pytest.mark.parametrize("case", corpus.cases, ids=str)
def test_message(case: Case) -> None:
    case.check()


def test_values_of_a_run_are_judged_like_those_of_the_model() -> None:
    """A compiled model that is run with other parameters."""

    class Lag(Component):
        T: Real = parameter(default=1.0, unit="s")
        lag: blocks.FirstOrder = part()

        def build(self) -> None:
            self.lag = blocks.FirstOrder(T=2 * self.T, u=1.0, y=fixed(0.0))

    compiled = acausal.compile(Lag())
    with pytest.raises(AcausalError, match=r"lag\.T = 0 s is not positive"):
        acausal.simulate(compiled, stop_time=1.0, parameters={"T": 0.0})


def test_a_component_can_be_asked_what_it_has() -> None:
    """`hasattr` and `getattr` with a default, as of any object of Python."""
    mass = rotational.Inertia(J=1.0)
    assert hasattr(mass, "phi")
    assert not hasattr(mass, "angle")
    assert getattr(mass, "angle", None) is None


def test_the_rate_of_stabilisation_is_no_parameter_of_the_author() -> None:
    """The constraint of a pendulum in x and y is kept by a rate that the compiler brings in; it is not listed."""

    class Pendulum(Component):
        m: Real = parameter(default=0.0)
        x: Real = variable(default=fixed(1.0))
        y: Real = variable()
        u: Real = variable()
        v: Real = variable(default=fixed(0.0))
        force: Real = variable()

        def equations(self) -> Equations:
            yield der(self.x) == self.u
            yield der(self.y) == self.v
            yield der(self.u) == -self.force * self.x
            yield der(self.v) == -self.force * self.y - 9.81 / self.m
            yield self.x**2 + self.y**2 == 1.0

    with fails_with(AcausalError, "AC303", match=r"for m = 0") as caught:
        acausal.simulate(Pendulum(), stop_time=1.0)
    assert "stabilisation" not in str(caught.value)


@pytest.mark.parametrize("name", ["m", "c"])
def test_an_infinite_parameter_is_named(name: str) -> None:
    """A product with it is no number, and a motion cannot be divided by it."""

    class Swing(Component):
        m: Real = parameter(default=1.0)
        c: Real = parameter(default=1.0)
        x: Real = variable(default=fixed(0.0))
        v: Real = variable(default=fixed(0.0))

        def equations(self) -> Equations:
            yield der(self.x) == self.v
            yield self.m * der(self.v) == -self.c * self.x

    with fails_with(AcausalError, "AC303", match=rf"for {name} = inf") as caught:
        acausal.simulate(Swing(), parameters={name: float("inf")}, stop_time=1.0)
    assert "division by zero" not in str(caught.value)
    assert caught.value.help


@pytest.mark.parametrize("value", [math.inf, -math.inf, math.nan])
def test_a_start_value_that_is_no_number_is_named(value: float) -> None:
    class Decay(Component):
        x: Real = variable(default=fixed(value))

        def equations(self) -> Equations:
            yield der(self.x) == -self.x

    with fails_with(AcausalError, "AC303", match=rf"x starts at {value:g}") as caught:
        acausal.simulate(Decay(), stop_time=1.0)
    assert "x: Real" in str(caught.value)


@pytest.mark.parametrize(("solver", "other"), [("rosenbrock", "idas"), ("idas", "rosenbrock")])
def test_the_solver_that_stopped_is_not_recommended(solver: str, other: str) -> None:
    """x = 1 - sqrt(1 - 2 t) ends at t = 0.5."""

    class Ends(Component):
        x: Real = variable(default=fixed(0.0))

        def equations(self) -> Equations:
            yield der(self.x) == 1 / (1 - self.x)

    with pytest.raises(AcausalError, match=r"stopped at t = 0\.(5|4999)") as caught:
        acausal.simulate(Ends(), stop_time=1.0, solver=solver)
    assert f"--solver {solver}" not in str(caught.value)
    assert "--solver" not in str(caught.value) or f"--solver {other}" in str(caught.value)


class Undefined(Component):
    """x = t; at t = 0.5, when x passes 0.5 or at a tick, the logarithm of 0.2 - x = -0.3 is taken."""

    at_ticks: bool = structural(default=False)
    x: Real = variable(default=fixed(0.0))
    y: Real = variable(default=fixed(1.0))
    d: Real = discrete()
    e: Real = discrete()

    def equations(self) -> Equations:
        yield der(self.x) == 1.0
        yield der(self.y) == -self.y
        if self.at_ticks:
            yield self.e == where(sample(0.5, 10.0), log(0.2 - self.x), 0.0)
        else:
            yield when(self.x > 0.5, reset(self.y, 2.0), reset(self.d, log(0.2 - self.x)))


@pytest.mark.parametrize("native", [False, True])
@pytest.mark.parametrize("solver", ["rosenbrock", "idas"])
@pytest.mark.parametrize(("at_ticks", "name"), [(False, "d"), (True, "e")])
def test_what_an_event_sets_to_nan_is_named(at_ticks: bool, name: str, solver: str, native: bool) -> None:
    """nan differs from itself: the iteration ended with AC501, which named nothing."""
    with fails_with(AcausalError, "AC509", match=rf"{name} becomes nan.* at t = 0\.5 s") as caught:
        acausal.simulate(Undefined(at_ticks=at_ticks), stop_time=1.0, solver=solver, native=native)
    assert "log(0.2 - x)" in str(caught.value)
    assert caught.value.where
