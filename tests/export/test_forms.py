"""What exports carry of events: functions of one instant have no `when`, sample or discrete equation, and say so.

The ball's own motion would end far below the floor without its impacts: h = 1 - g t^2 / 2 is -43 m at 3 s.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

import acausal
from acausal import (
    Component,
    Equations,
    Real,
    assert_,
    der,
    discrete,
    fixed,
    integer,
    pre,
    reset,
    sample,
    terminate,
    variable,
    when,
)
from acausal.errors import AcausalError
from acausal.models.bouncing_ball import BouncingBall
from tests.expected import fails_with

FORMS: dict[str, Callable[[Component, list[str] | None], Any]] = {
    "casadi": lambda model, outputs: acausal.compile(model).casadi(outputs),
    "linearize": lambda model, outputs: acausal.linearize(model, outputs=outputs),
}


class Controlled(Component):
    """An integrator under a controller that acts every tenth of a second, by a `when` or by a discrete equation."""

    x: Real = variable(default=fixed(1.0))
    u: Real = discrete(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == self.u
        yield when(sample(0.0, 0.1), reset(self.u, -self.x))


class Assigned(Component):
    """The same with a discrete equation."""

    x: Real = variable(default=fixed(1.0))
    low: Real = integer()

    def equations(self) -> Equations:
        yield der(self.x) == 2.0 * self.low - 1.0
        yield self.low == acausal.where(self.x < 0.0, 1.0, acausal.where(self.x > 1.0, 0.0, pre(self.low)))


class Counted(Component):
    """Decay that is counted, watched and ended, none of which its rate depends on."""

    x: Real = variable(default=fixed(1.0))
    y: Real = variable()
    n: Real = integer()

    def equations(self) -> Equations:
        yield der(self.x) == -self.x
        yield self.y == 2.0 * self.x
        yield when(sample(0.0, 0.1), reset(self.n, pre(self.n) + 1))
        yield when(self.x < 0.1, terminate("enough"))
        yield assert_(self.x > 0.0, "x is positive")


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize(
    ("model", "changed"), [(BouncingBall(), "v"), (Controlled(), "u"), (Assigned(), "low")], ids=["ball", "u", "low"]
)
def test_events_that_act_are_refused(form: str, model: Component, changed: str) -> None:
    with fails_with(AcausalError, "AC608", changed) as caught:
        FORMS[form](model, ["h" if changed == "v" else "x"])
    assert "step_function" in str(caught.value.help)


@pytest.mark.parametrize("form", FORMS)
def test_an_output_that_only_events_change_is_refused_and_can_be_left_out(form: str) -> None:
    with fails_with(AcausalError, "AC608", match="leave n out of the outputs"):
        FORMS[form](Counted(), None)
    made = FORMS[form](Counted(), ["y"])
    for lost in ("n keeps its value", "does not end the run", "x is positive"):
        assert any(lost in note for note in made.notes)


def test_steps_carry_events() -> None:
    step = acausal.step_function(acausal.compile(Controlled()), 0.1, "rk4", ["x"])
    assert "u" in step.x.names
