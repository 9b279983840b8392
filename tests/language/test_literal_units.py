"""Literal numbers are dimensionless; quantities and unitless values say otherwise."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import acausal
from acausal import (
    Component,
    Equations,
    Expr,
    Real,
    clamp,
    delay,
    der,
    exp,
    fixed,
    maximum,
    parameter,
    quantity,
    reset,
    sample,
    sin,
    sqrt,
    time,
    unitless,
    variable,
    when,
    where,
)
from acausal.errors import DeclarationError, UnitError
from acausal.flatten.instances.statements import statements
from acausal.language.expressions.expression import Equation
from tests.expected import fails_with


class Quantities(Component):
    """One of many kinds, to write an equation with."""

    rule: Callable[[Any], Any] = acausal.structural(default=None)
    m: Real = parameter(default=2.0, unit="kg")
    T_c: Real = parameter(default=2.0, unit="s")
    E: Real = variable(unit="J")
    f: Real = variable(unit="N")
    s: Real = variable(unit="m")
    v: Real = variable(unit="m/s")
    T: Real = variable(unit="K")
    phi: Real = variable(unit="rad")
    w: Real = variable(unit="rad/s")
    share: Real = variable(unit="1")
    r: Real = variable(unit="m", shape=3)
    plain: Real = variable()

    def equations(self) -> Equations:
        yield self.rule(self)


def check(rule: Callable[[Any], Any]) -> None:
    list(statements(Quantities(rule=rule)))


@pytest.mark.parametrize(
    ("rule", "named"),
    [
        (lambda q: q.E == 0.5 * q.m * q.v, ("in N.m", "in kg.m/s", 'quantity(0.5, "m/s")')),
        (lambda q: q.f == q.m * 9.81, ("in N", "in kg", 'quantity(9.81, "m/s2")')),
        (lambda q: q.f == -1e3 * q.s, ("in N", "in m", 'quantity(-1000, "N/m")')),
        (lambda q: q.s == q.f / 1e3, ("in m", "in N", 'quantity(1000, "N/m")')),
        (lambda q: q.plain == q.T - 273.15, ("K", 'quantity(273.15, "K")')),
        (lambda q: q.f == 1.0 + q.f, ("N", 'quantity(1, "N")')),
        (lambda q: der(q.v) == -2.0 * q.s, ("m/s2", "in m", 'quantity(-2, "1/s2")')),
        (lambda q: q.share == exp(-q.v / 3.0), ("m/s", 'quantity(3, "m/s")')),
        (lambda q: q.share == sin(2.0 * q.s), ("m", 'quantity(2, "1/m")')),
        (lambda q: q.v == q.w * 0.1, ("m/s", 'quantity(0.1, "m")')),
        (lambda q: q.s == 3.0 * sqrt(q.s), ("m", 'quantity(3, "m^(1/2)")')),
        (lambda q: q.f == 10.0 * sin(q.phi), ("N", 'quantity(10, "N")')),
        (lambda q: q.f == 10.0 * sin(q.w * time), ("N", 'quantity(10, "N")')),
        (lambda q: q.s == q.v * (1.0 - time / q.T_c), ("in m", "in m/s")),
        (lambda q: q.s == where(q.v > 0, 2.0 * q.v, q.s), ("m/s and m",)),
        (lambda q: q.plain == maximum(2.0 * q.v, q.s), ("m/s and m",)),
        (lambda q: q.r == 2.0 * q.r * q.v, ("in m", "in m2/s")),
        (lambda q: q.s == delay(q.s, 2.0 * q.v), ("m/s",)),
        (lambda q: when(sample(0.0, 1.0), reset(q.s, 2.0 * q.v)), ("in m", "in m/s")),
        (lambda q: when(sample(q.m, 1.0), reset(q.s, 1.0)), ("in kg",)),
        (lambda q: q.s == time, ("in m", "in s")),
        (lambda q: q.s == unitless(q.v) * q.v, ("in m", "in m/s")),
        (lambda q: q.f == quantity(9.81, "m/s") * q.m, ("in N", "kg.m/s")),
    ],
)
def test_a_literal_does_not_hide_a_missing_unit(rule: Callable[[Any], Any], named: tuple[str, ...]) -> None:
    with pytest.raises(UnitError) as caught:
        check(rule)
    text = str(caught.value)
    assert caught.value.code == "AC155"
    assert caught.value.where  # the line
    for words in named:
        assert words in text, text


@pytest.mark.parametrize(
    "rule",
    [
        lambda q: q.E == 0.5 * q.m * q.v**2,
        lambda q: q.E == q.m / 2 * q.v * q.v,
        lambda q: q.f == q.m * quantity(9.81, "m/s2"),
        lambda q: q.plain == q.T - quantity(20.0, "degC"),
        lambda q: q.v == 3.0,
        lambda q: q.v - q.v == 0,
        lambda q: q.v == clamp(q.v, -1.0, 1.0),
        lambda q: q.v == where(q.s > 0.1, 2.0, -2.0),
        lambda q: q.f == 10.0 * sin(3.0 * time + 0.5),
        lambda q: q.f == where(time < 1.0, 5.0 * (time - 0.5), 0.0),
        lambda q: q.s == q.v * (time - 1.0),
        lambda q: q.s == q.v * 2.0 * time,
        lambda q: q.v + 0.0 * q.s == q.v,
        lambda q: maximum(q.v, float("-inf")) == q.v,
        lambda q: q.phi == 0.5 + q.phi,
        lambda q: q.plain == 2.0 * q.plain + q.v,
        lambda q: q.f == unitless(q.v),
        lambda q: q.f == where(q.s > 0, unitless(q.v), 0.0),
        lambda q: q.r == (q.s, 0.1, 0.0),
        lambda q: q.r == q.r + quantity((1.0, 2.0, 3.0), "mm"),
        lambda q: q.share == exp(-q.s / quantity(3.0, "cm")),
        lambda q: q.share == 2.0**q.share,
        lambda q: q.s == delay(q.s, 0.5),
        lambda q: when(sample(0.0, q.T_c), reset(q.s, 0.2)),
        lambda q: when(time > 2.0, reset(q.s, 0.2)),
    ],
)
def test_what_has_the_units_it_needs(rule: Callable[[Any], Any]) -> None:
    check(rule)


def test_time_and_numbers_alone_need_no_units() -> None:
    class Free(Component):
        x: Real = variable(default=fixed(0.0))

        def equations(self) -> Equations:
            yield der(self.x) == -2.0 * self.x + sin(3.0 * time)

    assert len(list(statements(Free()))) == 1


@pytest.mark.parametrize(
    ("value", "unit", "si"),
    # SI brochure, 9th edition, tables 7 and 8
    [
        (16.0, "mm", 0.016),
        (20.0, "degC", 293.15),
        (90.0, "deg", np.pi / 2),
        (1.0, "kOhm", 1e3),
        (60.0, "rpm", 2 * np.pi),
    ],
)
def test_a_quantity_is_converted(value: float, unit: str, si: float) -> None:
    class Source(Component):
        y: Real = variable()

        def equations(self) -> Equations:
            yield self.y == quantity(value, unit)

    assert acausal.simulate(Source(), stop_time=1.0)["y"][-1] == pytest.approx(si, rel=1e-15)


class Body(Component):
    m: Real = parameter(default=quantity(500.0, "g"), unit="kg")
    s: Real = variable(unit="m")

    def equations(self) -> Equations:
        yield self.m * der(self.s) == quantity(1.0, "kg.m/s")


def test_a_quantity_is_the_value_of_a_parameter_and_of_a_start() -> None:
    # s = 0.02 m + 1 kg.m/s / 0.25 kg * 1 s
    r = acausal.simulate(Body(m=quantity(0.25, "kg"), s=quantity(20.0, "mm")), stop_time=1.0)
    assert r["s"][-1] == pytest.approx(4.02, rel=1e-12)
    assert r["s"][0] == pytest.approx(0.02, rel=1e-15)
    assert acausal.simulate(Body(s=fixed(0.0)), stop_time=1.0)["s"][-1] == pytest.approx(2.0, rel=1e-12)


@pytest.mark.parametrize(
    "given", [{"m": quantity(1.0, "m")}, {"s": fixed(quantity(1.0, "s"))}, {"s": quantity(1.0, "K")}]
)
def test_a_quantity_of_another_dimension_is_no_value(given: dict[str, Any]) -> None:
    with fails_with(UnitError, "AC151"):
        Body(**given)


def test_a_quantity_is_a_number() -> None:
    q = Quantities(rule=abs)
    with fails_with(DeclarationError, "AC106"):
        quantity(q.s, "m")  # type: ignore[arg-type]
    with fails_with(UnitError, "AC150"):
        quantity(1.0, "metre_per_fortnite")


def test_as_text() -> None:
    q = Quantities(rule=abs)
    e: Expr = q.m * quantity(9.81, "m/s2") + unitless(q.f)
    assert str(e) == 'm * quantity(9.81, "m/s2") + unitless(f)'
    assert str(quantity((0.0, 1.5, 2.0), "mm")) == 'quantity((0, 1.5, 2), "mm")'
    assert isinstance(q.r == quantity(1.0, "mm"), Equation)  # a number fills a vector, with its unit or without
