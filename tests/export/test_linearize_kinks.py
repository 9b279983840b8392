"""Points without slopes: a kink or a jump exactly there is refused, and what only looks like one is not.

Law: where the one-sided derivatives of x' differ, no matrix A is right; where they agree, A is their common value.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import acausal
from acausal import (
    Component,
    Equations,
    Expr,
    Real,
    der,
    fabs,
    fixed,
    floor,
    maximum,
    minimum,
    no_event,
    sign,
    sin,
    sqrt,
    structural,
    tanh,
    time,
    variable,
    where,
)
from acausal.errors import ExportError
from acausal.export.kinks import two_sides
from acausal.models.drilling_breakthrough import ConstantForceDrilling

Rate = Callable[[Any], Expr]
KINKS: dict[str, tuple[Rate, float]] = {
    "fabs": (lambda x: -fabs(x), 0.0),
    "maximum": (lambda x: -maximum(x, 0.0), 0.0),
    "minimum elsewhere": (lambda x: 3.0 - minimum(2.0 * x, 3.0), 1.5),
    "relation": (lambda x: where(x > 0.0, -x, -2.0 * x), 0.0),
    "relation, closed": (lambda x: where(x >= 0.0, -x, -2.0 * x), 0.0),
    "no event": (lambda x: where(no_event(x > 0.0), -x, -2.0 * x), 0.0),
    "jump": (lambda x: where(x > 0.0, -1.0 - x, 1.0 - x), 0.0),
    "sign": (lambda x: -x * sign(x), 0.0),
    "floor": (lambda x: -floor(x) - x, 2.0),
    "root": (lambda x: -sqrt(fabs(x)), 0.0),
    "small": (lambda x: -1e6 * x - fabs(x), 0.0),
}
SMOOTH: dict[str, tuple[Rate, float, float]] = {
    "square of each side": (lambda x: -x * fabs(x) - x, 0.0, -1.0),
    "equal sides": (lambda x: where(x > 0.0, -x, -x), 0.0, -1.0),
    "beside": (lambda x: -maximum(x, 0.0), 1e-6, -1.0),
    "steep": (lambda x: -tanh(x / 1e-6), 0.0, -1e6),
    "narrow": (lambda x: -x * sqrt(x * x + 1e-18) - x, 0.0, -1.0 - 1e-9),
    "inactive": (lambda x: -x - maximum(fabs(x) - 1.0, 0.0), 0.0, -1.0),
}


class Kinked(Component):
    """x' = f(x) through an algebraic variable."""

    f: Any = structural()
    x: Real = variable(default=fixed(0.0))
    z: Real = variable()

    def equations(self) -> Equations:
        yield self.z == self.x
        yield der(self.x) == self.f(self.z)


@pytest.mark.parametrize("kink", KINKS)
def test_a_point_with_two_sides_is_refused(kink: str) -> None:
    f, x = KINKS[kink]
    with pytest.raises(ExportError, match=r"AC604[\s\S]*on one side and") as error:
        acausal.linearize(Kinked(f=f), x={"x": x})
    assert "der(x)" in str(error.value)


@pytest.mark.parametrize("case", SMOOTH)
def test_what_has_slopes_is_linearized(case: str) -> None:
    f, x, slope = SMOOTH[case]
    np.testing.assert_allclose(acausal.linearize(Kinked(f=f), x={"x": x}).A, [[slope]], rtol=1e-9)


def test_a_drill_that_begins_to_touch_has_no_slopes() -> None:
    """Its tip stands on the surface at the start: the force has a slope on one side only (equation 20 of the paper)."""
    with pytest.raises(ExportError, match="AC604"):
        acausal.linearize(ConstantForceDrilling())


@pytest.mark.parametrize("kink", [0.0, 1e-6, 1.0])
def test_rounding_errors_are_no_kink_and_hide_none(kink: float) -> None:
    """A slope that is known to eight digits only, as those of an arm whose inertia matrix is nearly singular."""

    def at(share: float) -> Any:
        return np.array([[2.0 + kink * (share > 0.0) + 1e-8 * np.sin(1e15 * share)]])

    assert (two_sides(at) is None) == (kink == 0.0)


class Relay(Component):
    """x1' = x2, driven onto the moving line x1 + x2/5 = 10 000 sin(t/10), on which it slides."""

    x1: Real = variable(default=fixed(2e3))
    x2: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x1) == self.x2
        yield der(self.x2) == where(self.x1 + 0.2 * self.x2 > 1e4 * sin(0.1 * time), -3e5, 3e5)


def test_a_sliding_run_has_no_linearization(tmp_path: Path) -> None:
    """On the line x2' = 5 (1e3 cos(t/10) - x2), not 3e5: states beside it by their error have the rates of one side."""
    run = acausal.simulate(Relay(), stop_time=1.0, tolerance=1e-6, solver="idas")
    (start,) = (event.time for event in run.events)
    for t in (start, 0.5, 1.0):
        with pytest.raises(ExportError, match=r"AC604[\s\S]*sliding mode from"):
            acausal.linearize(Relay(), t, result=run)
    np.testing.assert_allclose(acausal.linearize(Relay(), 0.0, result=run).rates, [0.0, -3e5])  # before it: 2000 > 0
    run.save(tmp_path / "relay.npz")
    assert "sliding mode" in acausal.linearize(Relay(), 0.5, result=acausal.load(tmp_path / "relay.npz")).notes[-1]
