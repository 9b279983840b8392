"""`reset` of vectors, of their elements and slices: what it does to each entry is what it does to a scalar."""

from __future__ import annotations

import numpy as np
import pytest

import acausal
from acausal import (
    Component,
    Equations,
    Real,
    boolean,
    concatenate,
    der,
    discrete,
    fill,
    fixed,
    integer,
    parameter,
    pre,
    reset,
    sample,
    structural,
    time,
    variable,
    when,
)
from acausal.errors import DeclarationError


class ShiftRegister(Component):
    """The times of the last `n` ticks, the newest first; how often it ticked, whether the time before was late."""

    n: int = structural(default=4)
    held: Real = discrete(shape=lambda self: self.n, unit="s")
    count: Real = integer(shape=2)
    late: Real = boolean(shape=lambda self: self.n)

    def equations(self) -> Equations:
        yield when(
            sample(0.1, 0.1),
            reset(self.held[1:], pre(self.held)[:-1]),
            reset(self.held[0], time),
            reset(self.count, pre(self.count) + fill(1, 2)),
            reset(self.late, pre(self.held) > 0.15),
        )


def test_a_shift_register() -> None:
    r = acausal.simulate(ShiftRegister(), stop_time=0.55)
    assert r.final("held") == pytest.approx([0.5, 0.4, 0.3, 0.2], abs=1e-12)
    assert r.final("count") == pytest.approx([5, 5])
    assert r.final("late") == pytest.approx([1, 1, 1, 0])


class Saws(Component):
    """Three saw teeth, each reset where it reaches its own height."""

    height: Real = parameter(default=(1.0, 0.7, 0.31), shape=3)
    x: Real = variable(shape=3, default=fixed((0.0, 0.0, 0.0)))
    n: Real = integer(shape=3)

    def equations(self) -> Equations:
        yield der(self.x) == fill(1.0, 3)
        for k in range(3):
            yield when(self.x[k] > self.height[k], reset(self.x[k], 0.0), reset(self.n[k], pre(self.n[k]) + 1))
        yield when(time > 3.3, reset(self.x, 0.0))


@pytest.mark.parametrize("solver", ["rosenbrock", "idas", "erk"])
def test_elements_are_reset_each_by_itself_and_all_at_once(solver: str) -> None:
    height = np.array([1.0, 0.7, 0.31])
    r = acausal.simulate(Saws(), stop_time=3.95, solver=solver)
    assert r.final("n") == pytest.approx(np.floor(3.3 / height) + np.floor(0.65 / height))
    assert r.at(3.2, "x") == pytest.approx(np.mod(3.2, height), abs=1e-9)
    assert r.at(3.9, "x") == pytest.approx(np.mod(0.6, height), abs=1e-9)


class Wrong(Component):
    """What each test sets."""

    x: Real = variable(shape=3, default=fixed((0.0, 0.0, 0.0)))
    k: Real = parameter(default=(1.0, 2.0), shape=2)
    way: str = structural(default="")

    def equations(self) -> Equations:
        yield der(self.x) == fill(1.0, 3)
        if self.way == "longer":
            yield when(time > 0.5, reset(self.x, concatenate(self.x, 1.0)))
        elif self.way == "a vector for an element":
            yield when(time > 0.5, reset(self.x[0], self.x))
        elif self.way == "a parameter":
            yield when(time > 0.5, reset(self.k[0], 1.0))
        elif self.way == "no variable":
            yield when(time > 0.5, reset((2.0 * self.x)[0], 1.0))
        else:
            yield when(time > 0.5, reset(self.x, 0.0), reset(self.x[1], 1.0))


@pytest.mark.parametrize(
    ("way", "code"),
    [
        ("longer", "AC105"),
        ("a vector for an element", "AC105"),
        ("a parameter", "AC141"),
        ("no variable", "AC141"),
        ("twice", "AC145"),
    ],
)
def test_what_cannot_be_reset_is_refused(way: str, code: str) -> None:
    with pytest.raises(DeclarationError, match=code):
        acausal.flatten(Wrong(way=way))
