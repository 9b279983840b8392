"""What is stated and not yielded would be lost; it is refused with its line (AC186)."""

from __future__ import annotations

from typing import Any

from acausal import (
    Component,
    Equations,
    Real,
    assert_,
    connect,
    der,
    discrete,
    equals,
    fixed,
    flatten,
    parameter,
    part,
    reset,
    variable,
    when,
    where,
)
from acausal.errors import DeclarationError
from acausal.library import translational
from tests.expected import fails_with


class Oscillator(Component):
    """A mass on a spring; subclasses damp it, or forget to."""

    mass: translational.Mass = translational.Mass(m=1.0, s=fixed(0.1))
    spring: translational.Spring = translational.Spring(c=100.0)
    damper: translational.Damper = translational.Damper(d=1.0)
    wall: translational.Fixed = translational.Fixed()

    def equations(self) -> Equations:
        yield connect(self.wall.flange, self.spring.flange_a)
        yield connect(self.spring.flange_b, self.mass.flange_a)


def refused(model: Any) -> DeclarationError:
    with fails_with(DeclarationError, "AC186") as caught:
        flatten(model())
    return caught.value


def line_of(error: DeclarationError) -> str:
    with open(error.where[0].file) as source:
        return source.read().splitlines()[error.where[0].line - 1].strip()


def test_a_connection_that_is_not_yielded() -> None:
    class Damped(Oscillator):
        def equations(self) -> Equations:
            connect(self.wall.flange, self.damper.flange_a)  # forgotten
            yield connect(self.damper.flange_b, self.mass.flange_a)

    error = refused(Damped)
    assert "Damped.equations makes `connect(wall.flange, damper.flange_a)`" in str(error)
    assert line_of(error).endswith("# forgotten")


def test_several_in_a_list_of_which_one_is_lost() -> None:
    class Damped(Oscillator):
        def equations(self) -> Equations:
            made = [
                connect(self.wall.flange, self.damper.flange_a),
                connect(self.damper.flange_b, self.mass.flange_a),
            ]
            yield made[0]

    assert "damper.flange_b" in str(refused(Damped))


def test_an_equation_of_a_leaf() -> None:
    class Decay(Component):
        x: Real = variable(default=1.0)
        y: Real = variable()

        def equations(self) -> Equations:
            yield der(self.x) == -self.x
            y = self.y == 2.0 * self.x  # noqa: F841

    assert "`y == 2 * x`" in str(refused(Decay))


def test_what_build_states_is_lost() -> None:
    class Damped(Oscillator):
        def build(self) -> None:
            connect(self.wall.flange, self.damper.flange_a)
            connect(self.damper.flange_b, self.mass.flange_a)

    error = refused(Damped)
    assert "Damped.build" in str(error)
    assert "and 1 more" in str(error)


def test_what_build_states_of_a_component_without_equations() -> None:
    class Pair(Component):
        a: translational.Mass = translational.Mass(m=1.0)
        b: translational.Mass = translational.Mass(m=1.0)

        def build(self) -> None:
            connect(self.a.flange_b, self.b.flange_a)

    refused(Pair)


def test_what_build_keeps_and_equations_yield_is_not_lost() -> None:
    class Damped(Oscillator):
        def build(self) -> None:
            self.ends = [
                connect(self.wall.flange, self.damper.flange_a),
                connect(self.damper.flange_b, self.mass.flange_a),
            ]

        def equations(self) -> Equations:
            yield from self.ends

    assert flatten(Damped()).equations


def test_a_build_that_yields() -> None:
    class Damped(Oscillator):
        def build(self) -> Equations:
            yield connect(self.wall.flange, self.damper.flange_a)

    with fails_with(DeclarationError, "AC129", match=r"Damped\.build yields"):
        Damped()


def test_a_reset_outside_of_a_when() -> None:
    class Counter(Component):
        x: Real = variable(default=1.0)
        n: Real = discrete()

        def equations(self) -> Equations:
            yield der(self.x) == -self.x
            add = reset(self.n, 1.0)
            yield when(self.x < 0.5, reset(self.x, 1.0))
            del add

    assert "reset(n, 1)" in str(refused(Counter))


def test_a_when_and_an_assertion() -> None:
    class Counter(Component):
        x: Real = variable(default=1.0)

        def equations(self) -> Equations:
            yield der(self.x) == -self.x
            when(self.x < 0.5, reset(self.x, 1.0))
            assert_(self.x > 0.0, "x is positive")

    assert "and 1 more" in str(refused(Counter))


def test_a_helper_that_nobody_asks() -> None:
    class Decay(Component):
        x: Real = variable(default=1.0)
        y: Real = variable()

        def outputs(self) -> Equations:
            yield self.y == self.x

        def equations(self) -> Equations:
            yield der(self.x) == -self.x
            self.outputs()

    error = refused(Decay)
    assert "calls `self.outputs()`" in str(error)
    assert line_of(error) == "self.outputs()"


def test_what_is_used_is_not_refused() -> None:
    """Lists, branches of a `when`, helpers, conditions: whatever reaches a yield."""

    class Rate(Component):
        k: Real = parameter(default=2.0)
        x: Real = variable(default=1.0)
        n: Real = discrete()
        on: Real = variable()

        def rates(self, x: Any) -> Equations:
            yield der(x) == -self.k * x

        def equations(self) -> Equations:
            later = [self.on == where(equals(self.n, 1.0), 1.0, 0.0)]
            once = reset(self.n, 1.0)
            clause = when(self.x < 0.5, once)
            clause = clause.elsewhen(self.x < 0.2, reset(self.n, 2.0))
            yield from self.rates(self.x)
            yield clause
            yield from later

    class Two(Component):
        rates: list[Rate] = part()

        def build(self) -> None:
            self.rates = [Rate(k=float(k)) for k in (1, 2)]

    assert len(flatten(Two()).equations) == len(flatten(Rate()).equations) * 2


def test_a_branch_that_is_not_yielded() -> None:
    """At the line of the `elsewhen`."""

    class Branched(Oscillator):
        n: Real = discrete()

        def equations(self) -> Equations:
            first = when(self.mass.s > 0.1, reset(self.n, 1.0))
            yield first
            first.elsewhen(self.mass.s > 0.05, reset(self.n, 2.0))

    assert line_of(refused(Branched)).startswith("first.elsewhen")


def test_an_expression_alone_on_a_line() -> None:
    class Summed(Oscillator):
        def equations(self) -> Equations:
            self.damper.s_rel - self.spring.s_rel
            yield connect(self.damper.flange_b, self.mass.flange_a)

    class Compared(Oscillator):
        def equations(self) -> Equations:
            yield connect(self.damper.flange_b, self.mass.flange_a)
            self.mass.s > 0.0  # noqa: B015

    assert line_of(refused(Summed)).startswith("self.damper.s_rel - ")
    assert line_of(refused(Compared)).startswith("self.mass.s > ")


def test_a_connection_outside_of_a_component() -> None:
    """Of a model that exists already: nothing would yield it, and the mass would swing undamped."""
    model = Oscillator()
    with fails_with(DeclarationError, "AC186", match=r"`connect\(damper.flange_b, mass.flange_a\)` is made outside"):
        connect(model.damper.flange_b, model.mass.flange_a)
