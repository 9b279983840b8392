"""Fixed steps that are longer than a contact: the run says so, with every method."""

from __future__ import annotations

import pytest

import acausal
from acausal import Component, Equations, Real, der, fixed, minimum, parameter, variable


class Thrown(Component):
    """A mass that flies at a wall without damping, from which it returns as fast: its energy is kept."""

    k: Real = parameter(default=1e4)
    x: Real = variable(default=fixed(1.013))
    v: Real = variable(default=fixed(-1.0))

    def equations(self) -> Equations:
        yield der(self.x) == self.v
        yield der(self.v) == -self.k * minimum(self.x, 0.0)


def _notes(result: acausal.Result) -> list[str]:
    return [note for note in result.stats["notes"] if "are too long at" in note]  # type: ignore[attr-defined]


@pytest.mark.parametrize("output_interval", [0.05, 0.1])
@pytest.mark.parametrize("solver", ["rk2", "rk", "erk", "rosenbrock"])
def test_a_contact_within_a_few_steps_is_noted(solver: str, output_interval: float) -> None:
    """The contact lasts pi/100 s. Steps of 50 ms leave it with another speed than 1 m/s, those of 0.1 ms with that."""
    given = {"stop_time": 2.0, "solver": solver, "output_interval": output_interval, "force": True}
    coarse = acausal.simulate(Thrown(), step=0.05, **given)  # type: ignore[arg-type]
    assert abs(float(str(coarse.final("v"))) - 1.0) > 0.1
    (note,) = _notes(coarse)
    assert "steps of 0.05 s" in note
    fine = acausal.simulate(Thrown(), step=1e-4, **given)  # type: ignore[arg-type]
    assert fine.final("v") == pytest.approx(1.0, abs=1e-3)
    assert not _notes(fine)


def test_a_transient_that_an_implicit_method_forgets_is_not_noted() -> None:
    """x' = -1e6 (x - 1) from zero: x is 1 after one step, whatever its length."""

    class Fast(Component):
        x: Real = variable(default=fixed(0.0))

        def equations(self) -> Equations:
            yield der(self.x) == -1e6 * (self.x - 1.0)

    r = acausal.simulate(Fast(), stop_time=1.0, solver="rosenbrock", step=0.01)
    assert r.final("x") == pytest.approx(1.0, abs=1e-9)
    assert not _notes(r)
