"""Hundreds of rates that sleep: all are watched; choices beside them, which bodies that touch have, are named."""

from __future__ import annotations

import pytest

import acausal
from acausal import (
    Component,
    Equations,
    Real,
    der,
    fabs,
    fixed,
    maximum,
    no_event,
    parameter,
    part,
    structural,
    variable,
    where,
)
from acausal.analyse.events.located_kinks import MOST

HALF = 1e-5


class Episode(Component):
    """While a prescribed feed is within `HALF` of `at`, y' is a tent: y rises by one."""

    at: Real = parameter(default=1.0)
    s: Real = variable(default=fixed(0.0))
    y: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.s) == 1.0
        yield der(self.y) == maximum(HALF - fabs(self.s - self.at), 0.0) / HALF**2


class Chosen(Component):
    """The same as a box of height 1/z', by a choice below `no_event` that a moving factor z' meets: no plain rate."""

    at: Real = parameter(default=1.0)
    s: Real = variable(default=fixed(0.0))
    z: Real = variable(default=fixed(0.0))
    y: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.s) == 1.0
        yield der(self.z) == 2.0 - 0.1 * self.z
        yield der(self.y) == (1.0 + self.z) * where(no_event(fabs(self.s - self.at) < HALF), 1.0, 0.0)


class Many(Component):
    """Episodes one after the other, 70 ms apart; `chosen` of them are choices."""

    n: int = structural(default=3)
    chosen: int = structural(default=0)
    episodes: list[Component] = part()

    def build(self) -> None:
        kinds = [Chosen] * self.chosen + [Episode] * (self.n - self.chosen)
        self.episodes = [kind(at=0.1 + 0.07 * k) for k, kind in enumerate(kinds)]


@pytest.mark.slow
@pytest.mark.parametrize("solver", ["idas", "rosenbrock"])
def test_none_of_hundreds_is_slept_through(solver: str) -> None:
    """The area of a tent, 1e-5 to each side and 1e5 high, in runs of 12 s: each is awake for 2e-6 of it."""
    n = MOST + 1
    r = acausal.simulate(Many(n=n), stop_time=12.0, solver=solver, tolerance=1e-6, output_interval=12.0)
    assert [r.final(f"episodes[{k}].y") for k in range(n)] == pytest.approx([1.0] * n, abs=3e-2)
    assert not r.events
    assert not r.stats["notes"]


def test_choices_that_are_too_many_are_named() -> None:
    """Rates are watched all the same: the tents among them have their area."""
    chosen = MOST + 1
    model = Many(n=chosen + 5, chosen=chosen)
    r = acausal.simulate(model, stop_time=9.0, solver="rosenbrock", tolerance=1e-6, output_interval=9.0)
    notes: tuple[str, ...] = r.stats["notes"]  # type: ignore[assignment]
    assert any(n.startswith("AC414") and "episodes[0].s - episodes[0].at" in n and "1/5000" in n for n in notes), notes
    tents = [r.final(f"episodes[{k}].y") for k in range(chosen, chosen + 5)]
    assert tents == pytest.approx([1.0] * 5, abs=3e-2)


def test_the_bound_on_steps_is_kept_beside_a_longer_max_step() -> None:
    """No step is longer than 1/5000 of the run, as AC414 says, so that there are at least as many."""
    model = Many(n=MOST + 1, chosen=MOST + 1)
    r = acausal.simulate(model, stop_time=1.0, solver="rosenbrock", max_step=0.5, output_interval=1.0)
    assert float(str(r.stats["steps"])) >= 5000.0
