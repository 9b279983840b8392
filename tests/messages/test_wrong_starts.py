"""Starts that cannot be: of what follows from the equations at every time, off a constraint, at a zero factor."""

from __future__ import annotations

import pytest

import acausal
from tests.messages.cases import Case, Corpus

corpus = Corpus()


corpus.table(
    """
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


def test_newtons_method_fails_in_silence(capfd: pytest.CaptureFixture[str]) -> None:
    """CasADi printed a line for every point that was not finite, a thousand of them."""
    with pytest.raises(acausal.AcausalError):
        corpus["NoRoot"].run()
    assert not capfd.readouterr().err
