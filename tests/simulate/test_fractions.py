"""Integers stay whole (Modelica 3.6, section 4.9.3): what would make a fraction of one ends the run."""

from pathlib import Path
from typing import Any

import pytest

import acausal
from acausal import Component, Equations, Real, der, fixed, floor, integer, pre, reset, structural, variable, when
from acausal.errors import EventError


class Counting(Component):
    """x' = 1; at x = 0.5 and x = 1.2 an integer is set to 3 x, by an equation or a reset, rounded or not."""

    by_reset: bool = structural(default=True)
    rounded: bool = structural(default=False)
    x: Real = variable(default=fixed(0.0))
    n: Real = integer(default=0)

    def equations(self) -> Equations:
        yield der(self.x) == 1.0
        value = floor(3.0 * self.x + 1e-6) if self.rounded else 3.0 * self.x
        if self.by_reset:
            yield when(self.x > 0.5, reset(self.n, value)).elsewhen(self.x > 1.2, reset(self.n, value))
        else:
            yield self.n == pre(self.n) + acausal.where(acausal.edge(self.x > 0.5), value, 0.0)


@pytest.mark.parametrize("by_reset", [True, False])
@pytest.mark.parametrize(
    "run", [{"solver": s, "native": False} for s in ("idas", "rosenbrock", "erk")] + [{"solver": "erk", "native": True}]
)
def test_a_fraction_ends_the_run(by_reset: bool, run: dict[str, Any]) -> None:
    with pytest.raises(EventError, match=r"AC147.*n is an integer and became 1\.5") as caught:
        acausal.simulate(Counting(by_reset=by_reset), stop_time=1.0, **run)
    assert caught.value.result is not None
    assert caught.value.result.time[-1] >= 0.5
    line = Path(__file__).read_text().splitlines()[caught.value.where[0].line - 1]
    assert ("reset(self.n" if by_reset else "yield self.n ==") in line  # the statement, not where all of them begin


@pytest.mark.parametrize(("by_reset", "last"), [(True, 3.0), (False, 1.0)])
def test_what_is_rounded_is_an_integer(by_reset: bool, last: float) -> None:
    """floor(1.5) is 1 and floor(3.6) is 3."""
    r = acausal.simulate(Counting(by_reset=by_reset, rounded=True), stop_time=2.0)
    assert r.final("n") == last
