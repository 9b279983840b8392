"""Parts that are replaced, by a modifier or by inheritance, and records (Modelica 3.6, sections 7.3 and 4.7)."""

from __future__ import annotations

import math

import pytest

import acausal
from acausal import Component, Equations, Real, Record, connect, der, fixed, parameter, part, variable
from acausal.errors import DeclarationError
from acausal.library.translational import Fixed, Mass, Spring, SpringDamper
from acausal.library.translational.interfaces import PartialTwoFlanges
from tests.expected import fails_with


class Suspended(Component):
    """A mass on something compliant that may be replaced."""

    mass: Mass = Mass(m=1.0, s=fixed(0.1), v=fixed(0.0))
    holder: PartialTwoFlanges = Spring(c=100.0)
    wall: Fixed = Fixed()

    def equations(self) -> Equations:
        yield connect(self.wall.flange, self.holder.flange_a)
        yield connect(self.holder.flange_b, self.mass.flange_a)


class Damped(Suspended):
    """Replaced by inheritance: aperiodic, with two equal roots -10 1/s."""

    holder: PartialTwoFlanges = SpringDamper(c=100.0, d=20.0)


def end(model: Component) -> float:
    return float(acausal.simulate(model, stop_time=0.5, tolerance=1e-9).final("mass.s"))


def test_a_part_is_replaced_in_a_modifier_and_by_inheritance() -> None:
    """x'' + x' d / m + x c / m = 0: undamped 0.1 cos(10 t); aperiodic 0.1 (1 + 10 t) exp(-10 t)."""
    assert end(Suspended()) == pytest.approx(0.1 * math.cos(5.0), abs=1e-7)
    aperiodic = pytest.approx(0.1 * 6.0 * math.exp(-5.0), abs=1e-7)
    assert end(Damped()) == aperiodic
    assert end(Suspended(holder=SpringDamper(c=100.0, d=20.0))) == aperiodic
    assert end(Damped(holder=Spring(c=100.0))) == pytest.approx(0.1 * math.cos(5.0), abs=1e-7)


def test_a_part_that_build_makes_is_replaced_too() -> None:
    class Built(Component):
        c: Real = parameter(default=100.0, unit="N/m")
        inner: Suspended = part()

        def build(self) -> None:
            self.inner = Suspended(holder=Spring(c=self.c))

    given = Built(inner=Suspended(holder=Spring(c=25.0)))
    result = acausal.simulate(given, stop_time=0.5, tolerance=1e-9)
    assert result.final("inner.mass.s") == pytest.approx(0.1 * math.cos(2.5), abs=1e-7)


def test_another_kind_of_part_is_refused() -> None:
    with fails_with(DeclarationError, "AC116", match="declared as PartialTwoFlanges, Fixed is none") as caught:
        Suspended(holder=Fixed())  # type: ignore[arg-type]
    with fails_with(DeclarationError, "AC126", match="is declared again") as caught:

        class Wrong(Suspended):
            holder: Fixed = Fixed()  # type: ignore[assignment]

    assert "Suspended.holder is declared as PartialTwoFlanges, Fixed is none" in str(caught.value)


def test_a_part_of_another_class_names_the_class_that_both_have() -> None:
    class Rigid(Component):
        load: Spring = Spring(c=1.0)

    with fails_with(DeclarationError, "AC126", match="declare it in Rigid as their base: load: PartialTwoFlanges"):

        class Soft(Rigid):
            load: SpringDamper = SpringDamper(c=1.0, d=1.0)  # type: ignore[assignment]


class Material(Record):
    """Conducts and stores heat."""

    k: Real = parameter(unit="W/(m.K)", doc="Conductivity")
    rho: Real = parameter(default=7800.0, unit="kg/m3", doc="Density")


class Bar(Component):
    """A bar that weighs what its material weighs."""

    material: Material = Material(k=50.0)
    V: Real = parameter(default=0.5, unit="m3")
    m: Real = variable(unit="kg")

    def equations(self) -> Equations:
        yield self.m == self.material.rho * self.V


class Frame(Component):
    """Two bars of one material, one of its own."""

    steel: Material = Material(k=45.0, rho=8000.0)
    left: Bar = part()
    right: Bar = part()
    other: Bar = Bar(V=2.0)

    def build(self) -> None:
        self.left = Bar(material=self.steel)
        self.right = Bar(material=self.steel, V=0.25)


def test_a_record_is_shared_and_set_in_one_place() -> None:
    compiled = acausal.compile(Frame())
    for rho in (8000.0, 1000.0):
        result = acausal.simulate(compiled, stop_time=1.0, parameters={"steel.rho": rho})
        assert result.final("left.m") == pytest.approx(0.5 * rho)
        assert result.final("right.m") == pytest.approx(0.25 * rho)
        assert result.final("other.m") == pytest.approx(2.0 * 7800.0)
        assert result.final("left.material.k") == 45.0


def test_a_record_holds_parameters_only() -> None:
    with fails_with(DeclarationError, "AC190", match="'x' is no parameter"):

        class Wrong(Record):
            x: Real = variable()

    with pytest.raises(DeclarationError, match="'equations' is no parameter"):

        class Stating(Record):
            x: Real = parameter(default=1.0)

            def equations(self) -> Equations:
                yield der(self.x) == 0.0
