"""More rates that sleep than a run watches: no step is longer than a small part of the run, which a note says."""

from __future__ import annotations

import pytest

import acausal
from acausal import Component, Equations, Real, der, fabs, fixed, maximum, parameter, part, structural, variable
from acausal.analyse.sleeping import MOST


class Episode(Component):
    """While a prescribed feed is within 4 ms of `at`, y' is a tent 4 high: y rises by 0.016."""

    at: Real = parameter(default=1.0)
    s: Real = variable(default=fixed(0.0))
    y: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.s) == 1.0
        yield der(self.y) == maximum(4e-3 - fabs(self.s - self.at), 0.0) * 1e3


class Many(Component):
    """Episodes one after the other, 70 ms apart."""

    n: int = structural(default=3)
    episodes: list[Episode] = part()
    t: Real = variable(default=fixed(0.0))

    def build(self) -> None:
        self.episodes = [Episode(at=0.1 + 0.07 * k) for k in range(self.n)]

    def equations(self) -> Equations:
        yield der(self.t) == 1.0


@pytest.mark.parametrize("solver", ["idas", "cvodes", "rosenbrock", "erk"])
@pytest.mark.parametrize("n", [45, MOST + 5])
def test_none_of_many_is_slept_through(solver: str, n: int) -> None:
    """The area of a tent, 4e-3 to each side and 4 high. idas and cvodes passed all of them with more than 40."""
    r = acausal.simulate(Many(n=n), stop_time=10.0, solver=solver, tolerance=1e-6, output_interval=1.0)
    assert [r.final(f"episodes[{k}].y") for k in range(n)] == pytest.approx([0.016] * n, rel=1e-2)
    notes: tuple[str, ...] = r.stats["notes"]  # type: ignore[assignment]
    assert any("1/5000 of the run" in note for note in notes) == (n > MOST)
    assert not r.events
