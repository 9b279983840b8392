"""Fixed steps that are too long, for a contact or for the whole run: the run says so, with every method."""

from __future__ import annotations

import numpy as np
import pytest

import acausal
from acausal import Component, Equations, Real, der, fixed, minimum, parameter, variable
from acausal.models.components.multibody import ConstrainedBodies


class Thrown(Component):
    """A mass that flies at a wall without damping, from which it returns as fast: its energy is kept."""

    k: Real = parameter(default=1e4)
    x: Real = variable(default=fixed(1.013))
    v: Real = variable(default=fixed(-1.0))

    def equations(self) -> Equations:
        yield der(self.x) == self.v
        yield der(self.v) == -self.k * minimum(self.x, 0.0)


def _notes(result: acausal.Result) -> list[str]:
    return [note for note in result.stats["notes"] if "are too long" in note]  # type: ignore[attr-defined]


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


class Swinging(Component):
    """x'' = -x from 1: x is cos(t)."""

    x: Real = variable(default=fixed(1.0))
    v: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == self.v
        yield der(self.v) == -self.x


@pytest.mark.parametrize("rows_per_step", [1.0, 0.25])
@pytest.mark.parametrize(
    ("solver", "step", "stop"),
    [("rk2", 0.05, 800.0), ("rk", 0.5, 800.0), ("erk", 1.25, 800.0), ("collocation", 1.25, 800.0)],
)
def test_errors_that_add_up_are_noted(solver: str, step: float, stop: float, rows_per_step: float) -> None:
    """The error against cos(t) grows with time: the whole run has a note, and its first eighth, or half steps, none."""

    def run(step: float, stop: float) -> tuple[float, list[str]]:
        given = {"solver": solver, "step": step, "output_interval": step / rows_per_step, "force": True}
        r = acausal.simulate(Swinging(), stop_time=stop, **given)  # type: ignore[arg-type]
        return float(np.abs(r["x"] - np.cos(r["time"])).max()), _notes(r)

    error, notes = run(step, stop)
    assert error > 0.2
    (note,) = notes
    assert "too long for the whole run: with half of that" in note
    error, notes = run(step / 4, stop / 8)
    assert error < 0.05
    assert not notes


def test_a_step_that_fails_is_noted() -> None:
    """Both speeds are equal. A step of `rosenbrock` next to a pivot that vanishes changed that of `held` by 5 %."""
    span = ConstrainedBodies.experiment.stop_time
    r = acausal.simulate(ConstrainedBodies(), solver="rosenbrock", step=span / 4000)
    off = abs(float(str(r.final("held.w_a[2]"))) - float(str(r.final("joint.w"))))
    assert off < 1e-3 or "too long for the whole run" in _notes(r)[0]
