"""Starts: over-fixed, under-determined, impossible, off a constraint, undefined."""

from __future__ import annotations

from typing import cast

import pytest

import acausal
from acausal import Component, Equations, Real, connect, der, fixed, guess, variable
from acausal.library import translational
from tests.messages.cases import Case, Corpus

corpus = Corpus()


@corpus.broken(
    "AC302",
    "spring.s_rel",
    "translational.Spring(c=1.0, s_rel=fixed(2.0))",
    text="""
error[AC302]: OverFixed: the start value spring.s_rel = 2 contradicts mass.s = 1, which makes it 1
  at      test_start_messages.py:N
              spring: translational.Spring = translational.Spring(c=1.0, s_rel=fixed(2.0))
                                             ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
          also given:
            mass.s = 1   (test_start_messages.py:N)
  cause   more is fixed at the start than the 2 states can satisfy: mass.s and mass.v
  help    remove one of them, or make it a guess: s_rel=guess(2)
""",
)
class OverFixed(Component):
    """The length of the spring follows from the position of the mass, and both are fixed."""

    wall: translational.Fixed = translational.Fixed()
    spring: translational.Spring = translational.Spring(c=1.0, s_rel=fixed(2.0))
    mass: translational.Mass = translational.Mass(m=1.0, s=fixed(1.0), v=fixed(0.0))

    def equations(self) -> Equations:
        yield connect(self.wall.flange, self.spring.flange_a)
        yield connect(self.spring.flange_b, self.mass.flange_a)


class Decay(Component):
    """Two independent states."""

    x: Real = variable()
    y: Real = variable()

    def equations(self) -> Equations:
        yield der(self.x) == -self.x
        yield der(self.y) == -self.y


corpus.table(
    """
OneTooMany AC302 y == 5
# One state, a start value and a start equation.
x: Real = variable(default=fixed(1.0))
y: Real = variable()
yield der(self.x) == -self.x
yield self.y == 2.0 * self.x
> start: yield self.y == 5.0

SumTwice(Decay) AC302 x + y == 1
# Two start equations for two states, which say the same with different numbers.
> start: yield self.x + self.y == 1.0
> start: yield self.x + self.y == 2.0

DivisionByZero AC303 y
# 1/x at x = 0; y is only observed.
x: Real = variable(default=fixed(0.0))
y: Real = variable()
yield der(self.x) == 1.0
> yield self.y == 1.0 / self.x

LogarithmOfZero AC303 y
# The rate would be finite again: 1/log(0) is 0.
x: Real = variable(default=fixed(0.0))
y: Real = variable()
yield der(self.x) == 1.0 / self.y
> yield self.y == log(self.x)

AtASource AC302 capacitor.v
# A capacitor beside an ideal source has the voltage of that, from the start on.
source: electrical.ConstantVoltage = electrical.ConstantVoltage(V=5.0)
capacitor: electrical.Capacitor = <<electrical.Capacitor(C=1.0, v=fixed(1.0))>>
ground: electrical.Ground = electrical.Ground()
yield connect(self.source.p, self.capacitor.p)
yield connect(self.source.n, self.capacitor.n, self.ground.p)

OffTheCircle AC302 x * x + y * y == 1
# A pendulum of index 3, started beside its circle.
x: Real = variable(default=fixed(1.0))
y: Real = variable(default=fixed(1.0))
v: Real = variable()
w: Real = variable()
tension: Real = variable()
yield der(self.x) == self.v
yield der(self.y) == self.w
yield der(self.v) == -self.tension * self.x
yield der(self.w) == -self.tension * self.y - 9.81
> yield self.x * self.x + self.y * self.y == 1.0

OffTheTangent AC302 d/dt (x * x + y * y == 1)
# A pendulum of index 3 on its circle that starts with a velocity across it.
x: Real = variable(default=fixed(1.0))
y: Real = variable(default=guess(0.0))
v: Real = variable(default=fixed(1.0))
w: Real = variable(default=fixed(0.0))
tension: Real = variable()
yield der(self.x) == self.v
yield der(self.y) == self.w
yield der(self.v) == -self.tension * self.x
yield der(self.w) == -self.tension * self.y - 9.81
> yield self.x * self.x + self.y * self.y == 1.0

ZeroFactor AC304 y
# y x = 1 where x starts at zero.
x: Real = variable(default=fixed(0.0))
y: Real = variable()
yield der(self.x) == 1.0
> yield self.y * self.x == 1.0

NoRoot AC301 x
# x^2 = -1.
x: Real = variable(default=guess(1.0))
y: Real = variable(default=fixed(0.0))
> yield self.x * self.x == -1.0
yield der(self.y) == self.x
""",
    globals(),
)


@pytest.mark.parametrize("case", corpus.cases, ids=str)
def test_message(case: Case) -> None:
    case.check()


class Exchange(Component):
    """A steady state is a line: x == y."""

    x: Real = variable(default=guess(3.0))
    y: Real = variable(default=guess(3.0))

    def equations(self) -> Equations:
        yield der(self.x) == self.y - self.x
        yield der(self.y) == self.x - self.y

    def initial_equations(self) -> Equations:
        yield der(self.x) == 0.0
        yield der(self.y) == 0.0


def test_a_start_that_the_guesses_have_decided_is_noted() -> None:
    """Both conditions say x == y; whatever the guesses are, the run stays there."""
    result = acausal.simulate(Exchange(), stop_time=1.0)
    notes = cast("tuple[str, ...]", result.stats["notes"])
    assert "the start conditions do not determine x and y: their guesses have decided" in notes
    assert result.final("x") == pytest.approx(result.final("y"), abs=1e-9)


def test_start_values_that_nobody_gave_are_noted() -> None:
    """Two states without a start value begin at 0, and the user is told."""
    notes = cast("tuple[str, ...]", acausal.simulate(Decay(), stop_time=1.0).stats["notes"])
    assert notes[0] == "2 start values not given; taken: x = 0, y = 0  (say so with fixed(...))"


def test_newtons_method_fails_in_silence(capfd: pytest.CaptureFixture[str]) -> None:
    """CasADi printed a line for every point that was not finite, a thousand of them."""
    with pytest.raises(acausal.AcausalError):
        corpus["NoRoot"].run()
    assert not capfd.readouterr().err
