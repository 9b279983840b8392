"""Relations whose sides are equal and stay so are what their words say: `x > 0` is false at zero, `x >= 0` is true.

Modelica 3.6, section 8.5: at an event all relations are evaluated. A relation that comes to its guard with a rate is on
the side to which that rate takes it; one that is put there and stays has no rate to tell by.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import acausal
from acausal import (
    Component,
    Equations,
    Real,
    der,
    fixed,
    floor,
    integer,
    maximum,
    pre,
    reset,
    sign,
    time,
    variable,
    when,
    where,
)
from acausal.lower.compiled import CompiledModel
from tests.stepping import walk

STOP = 4.0


class PutOnZero(Component):
    """Rates that follow the sign of what is reset to zero at 1 s, from above and from below."""

    high: Real = variable(default=fixed(1.0))
    low: Real = variable(default=fixed(-1.0))
    x: Real = variable(default=fixed(0.0), doc="Grows while high > 0")
    y: Real = variable(default=fixed(0.0), doc="Grows while low >= 0")
    n: Real = integer(doc="Counts low < 0 becoming false")

    def equations(self) -> Equations:
        yield der(self.high) == 0.0
        yield der(self.low) == 0.0
        yield der(self.x) == where(self.high > 0, 1.0, 0.0)
        yield der(self.y) == where(self.low >= 0, 1.0, 0.0)
        yield when(time > 1, reset(self.high, 0.0), reset(self.low, 0.0))
        yield when(~(self.low < 0), reset(self.n, pre(self.n) + 1))


class Stairs(Component):
    """Each step of x / 0.7 is taken over by a clause, behind which both sides of its relation are the same number."""

    p: Real = variable(default=fixed(0.0))
    x: Real = variable(default=fixed(0.0), doc="Grows where the whole part of p is 2 or 3")
    f: Real = variable()
    y: Real = integer()
    n: Real = integer()

    def equations(self) -> Equations:
        yield der(self.p) == 1.0
        yield der(self.x) == where((floor(self.p) >= 2.0) & (floor(self.p) <= 3.0), 1.0, 0.0)
        yield self.f == where(self.p > 1, where(self.p > 2, 2.0, 1.0), 0.0) + where(self.p > 3, 1.0, 0.0)
        yield when(self.f > pre(self.y), reset(self.y, pre(self.y) + 1))
        yield when(floor(self.p / 0.7) > pre(self.n), reset(self.n, floor(self.p / 0.7)))


class Signs(Component):
    """Signs of what stays at zero, leaves it, is limited to it, or is held there by the sign itself."""

    still: Real = variable(default=fixed(0.0))
    late: Real = variable(default=fixed(0.0), doc="Leaves zero at 1 s")
    falls: Real = variable(default=fixed(1.0), doc="At zero at 1 s")
    slides: Real = variable(default=fixed(0.7), doc="At zero from 1 s on, until 3 s")
    a: Real = variable(default=fixed(0.0))
    b: Real = variable(default=fixed(0.0))
    c: Real = variable(default=fixed(0.0))
    d: Real = variable(default=fixed(0.0), doc="Integral of the force that holds")

    def equations(self) -> Equations:
        yield der(self.still) == 0.0
        yield der(self.late) == where(time < 1, 0.0, -1.0)
        yield der(self.falls) == -1.0
        yield der(self.slides) == where(time < 3, 0.3, 2.0) - sign(self.slides)
        yield der(self.a) == sign(self.still)
        yield der(self.b) == sign(self.late)
        yield der(self.c) == sign(maximum(self.falls, 0.0))
        yield der(self.d) == sign(self.slides)


MODELS: dict[str, Component] = {"put on zero": PutOnZero(), "stairs": Stairs(), "signs": Signs()}
EXPECTED = {
    "put on zero": {"x": 1.0, "y": STOP - 1.0, "n": 1.0},
    "signs": {"a": 0.0, "b": 1.0 - STOP, "c": 1.0, "d": 1.0 + 0.3 * 2.0 + (STOP - 3.0), "slides": STOP - 3.0},
    "stairs": {"x": STOP - 2.0, "y": 3.0, "n": float(np.floor(STOP / 0.7))},
}


@cache
def _compiled(model: str) -> CompiledModel:
    return acausal.compile(MODELS[model])


@pytest.mark.parametrize("model", list(EXPECTED))
@pytest.mark.parametrize(
    ("solver", "native"), [("idas", False), ("cvodes", False), ("rosenbrock", False), ("erk", False), ("erk", True)]
)
def test_sides_that_stay_equal(model: str, solver: str, native: bool) -> None:
    result = acausal.simulate(_compiled(model), stop_time=STOP, solver=solver, native=native)
    for name, value in EXPECTED[model].items():
        assert result.final(name) == pytest.approx(value, abs=1e-6), name


@pytest.mark.parametrize("model", list(EXPECTED))
def test_in_exported_steps(model: str) -> None:
    h = 0.05
    step = acausal.step_function(_compiled(model), h, "rk4", list(EXPECTED[model]))
    found = walk(step, round(STOP / h))
    for name, value in EXPECTED[model].items():
        if name not in ("slides", "d"):  # steps do not slide
            assert found[name][-1] == pytest.approx(value, abs=1e-6), name
