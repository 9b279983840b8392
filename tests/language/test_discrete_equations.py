"""Discrete equations, assertions and `when`s as the flat system holds them; `reset` of vectors."""

from __future__ import annotations

import numpy as np
import pytest

import acausal
from acausal import (
    Component,
    Equations,
    Real,
    assert_,
    boolean,
    boolean_input,
    boolean_output,
    concatenate,
    connect,
    der,
    discrete,
    fill,
    fixed,
    integer,
    parameter,
    part,
    pre,
    reset,
    sample,
    structural,
    terminate,
    time,
    variable,
    when,
    where,
)
from acausal.analyse.aliases import reduce
from acausal.errors import DeclarationError
from acausal.flatten.text import to_text


class Inverter(Component):
    """Not."""

    u: Real = boolean_input()
    y: Real = boolean_output()

    def equations(self) -> Equations:
        yield self.y == ~self.u


class Chain(Component):
    """Inverters in a row behind a condition of time."""

    n: int = structural(default=3)
    inverters: list[Inverter] = part()

    def build(self) -> None:
        self.inverters = [Inverter(u=time > 1.0), *(Inverter() for _ in range(self.n - 1))]

    def equations(self) -> Equations:
        for left, right in zip(self.inverters, self.inverters[1:], strict=False):
            yield connect(left.y, right.u)


def assigned(model: Component) -> dict[str, str]:
    """Text of every discrete equation by the name of its variable, as far as the compiler has reduced it."""
    flat = acausal.flatten(model)
    reduced = reduce(flat)

    def name_of(kind: str, number: int) -> str:
        return reduced.name(number) if kind == "var" else flat.parameter_names[number]

    return {
        flat.scalar_name(a.scalar): to_text(reduced.pool, node, name_of)
        for a, node in zip(flat.assignments, reduced.assignments, strict=True)
    }


def test_connected_signals_are_one_variable_with_one_equation() -> None:
    assert assigned(Chain()) == {
        "inverters[0].u": "time > 1",
        "inverters[0].y": "~inverters[0].u",
        "inverters[1].y": "~inverters[0].y",
        "inverters[2].y": "~inverters[1].y",
    }


class Counter(Component):
    """Both directions: a discrete variable on the left is assigned, on the right it is a number."""

    x: Real = variable(default=fixed(0.0))
    y: Real = variable()
    n: Real = integer(default=5)
    up: Real = boolean(default=True)
    both: Real = boolean(shape=2)
    kept: Real = discrete(unit="m", default=2.0)

    def equations(self) -> Equations:
        yield der(self.x) == self.n
        yield 2.0 * self.y == self.n
        yield self.up == (self.x > 0.5)
        yield self.n == where(self.up, pre(self.n) + 1, pre(self.n))
        yield self.both[0] == self.up
        yield self.both[1] == ~self.up
        yield when(self.x > 1.0, reset(self.kept, 3.0), terminate("far"), terminate("enough"))
        yield assert_(self.x < 9.0, "x is out of hand", level="warning")


def test_the_side_decides_what_an_equation_is() -> None:
    """`2*y == n` is an equation for y: Python must not turn it round because n is a symbol."""
    flat = acausal.flatten(Counter())
    assert assigned(Counter()) == {
        "up": "x > 0.5",
        "n": "where(up, 1 + pre(n), pre(n))",
        "both[0]": "up",
        "both[1]": "~up",
    }
    assert [str(e.source) for e in flat.equations[:2]] == ["der(x) == n", "2 * y == n"]


def test_every_discrete_variable_has_a_rate_of_zero_and_a_value_before_the_start() -> None:
    flat = acausal.flatten(Counter())
    held = [flat.scalar_name(flat.pool.nodes[e.left][1]) for e in flat.equations if isinstance(e.source, str)]
    assert held == ["der(n)", "der(up)", "der(both[0])", "der(both[1])", "der(kept)"]
    starts = {flat.scalar_name(k): flat.pool.value(s.node) for k, s in flat.starts.items()}
    assert starts == {"x": 0.0, "n": 5.0, "up": 1.0, "both[0]": 0.0, "both[1]": 0.0, "kept": 2.0}
    assert all(s.is_fixed for s in flat.starts.values())


def test_whens_and_assertions_keep_their_words() -> None:
    flat = acausal.flatten(Counter())
    (clause,) = flat.whens
    assert clause.terminate == "far; enough"
    assert str(clause.source) == 'when(x > 1, reset(kept, 3), terminate("far; enough"))'
    (assertion,) = flat.asserts
    assert (assertion.message, assertion.level, assertion.component) == ("x is out of hand", "warning", "")
    assert str(assertion.source) == 'assert_(x < 9, "x is out of hand")'
    assert flat.text(flat.assignments[0]) == "up == (x > 0.5)"


def test_free_inputs_of_the_model_have_neither_equation_nor_rate() -> None:
    flat = acausal.flatten(Inverter())
    assert [flat.scalar_name(k) for k in flat.inputs] == ["u"]
    assert [e.source for e in flat.equations] == ["y is discrete"]
    assert [flat.scalar_name(a.scalar) for a in flat.assignments] == ["y"]


def test_equal_structure_is_compiled_once_and_other_logic_is_not() -> None:
    """The signature of the cache sees discrete equations."""
    from acausal.lower.cache.cache import signature

    class Same(Component):
        u: Real = boolean_input()
        y: Real = boolean_output()

        def equations(self) -> Equations:
            yield self.y == (self.u & True)

    first, second, other = (signature(acausal.flatten(m), "torn") for m in (Inverter(), Inverter(), Same()))
    assert first == second
    assert first != other


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
