"""Inheritance: fields unite, equations of every class count once and base first; where values come from."""

from __future__ import annotations

from types import new_class
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

import acausal
from acausal import Component, Equations, Real, der, fixed, parameter, part, structural, variable
from acausal.errors import DeclarationError
from acausal.flatten.flatten import flatten
from acausal.flatten.instances.statements import statements
from tests.expected import fails_with


def make(name: str, bases: tuple[type[Component], ...], fields: tuple[str, ...] = ()) -> type[Component]:
    """A class that declares variables and states one equation for each: its own name tells whose it is."""

    def equations(self: Any) -> Equations:
        for k, field in enumerate(fields):
            yield getattr(self, field) == float(k)

    def body(namespace: dict[str, Any]) -> None:
        namespace["__module__"] = __name__
        namespace["__annotations__"] = dict.fromkeys(fields, "Real")
        namespace.update({field: variable(doc=name) for field in fields})
        if fields:
            namespace["equations"] = equations

    return new_class(name, bases or (Component,), exec_body=body)


# For every class the numbers of its bases among those before it.
hierarchies = st.lists(st.lists(st.integers(0, 6), max_size=2, unique=True), min_size=1, max_size=6)


@given(hierarchies)
def test_fields_unite_and_equations_count_once(plan: list[list[int]]) -> None:
    """Whatever the hierarchy, diamonds too: what Python's own order of classes says, base first."""
    made: list[type[Component]] = []
    for k, wanted in enumerate(plan):
        bases = tuple(made[b] for b in sorted(wanted, reverse=True) if b < len(made))
        try:
            made.append(make(f"C{k}", bases, (f"x{k}", f"y{k}")))
        except TypeError:  # Python has no order for these bases
            return
    last = made[-1]
    linear = [c for c in reversed(last.__mro__) if c in made]
    instance = last()
    assert set(instance._declarations) == {f"{letter}{made.index(c)}" for c in linear for letter in "xy"}
    stated = [str(item.left) for item, _ in statements(instance)]
    assert stated == [f"{letter}{made.index(c)}" for c in linear for letter in "xy"]
    assert len(flatten(instance).equations) == 2 * len(linear)


@given(st.integers(0, 3), st.booleans())
def test_a_field_cannot_be_declared_twice(depth: int, as_value: bool) -> None:
    """At any distance, and be it by a plain number: one of the two would silently win."""
    here = make("Base", (), ("x",))
    for k in range(depth):
        here = make(f"Between{k}", (here,), (f"z{k}",))

    def last() -> object:
        if as_value:
            return new_class("Last", (here,), exec_body=lambda namespace: namespace.update(x=2.0))
        return make("Last", (here,), ("x",))

    with fails_with(DeclarationError, "AC126", "Last.x"):
        last()


class Base(Component):
    k: Real = parameter(default=1.0)
    x: Real = variable()

    def equations(self) -> Equations:
        yield der(self.x) == -self.k * self.x


class Faster(Base):
    """A value for an inherited parameter is set in `build`."""

    def build(self) -> None:
        self.k = 5.0


class Twice(Base):
    y: Real = variable()

    def equations(self) -> Equations:
        yield der(self.y) == self.x


class Owner(Component):
    part_: Base = part()
    which: type[Base] = structural(default=Base)

    def build(self) -> None:
        self.part_ = self.which()


@pytest.mark.parametrize(("cls", "k", "unknowns"), [(Base, 1.0, 1), (Faster, 5.0, 1), (Twice, 1.0, 2)])
def test_a_subclass_takes_the_place_of_its_base(cls: type[Base], k: float, unknowns: int) -> None:
    flat = flatten(Owner(which=cls))
    assert dict(zip(flat.parameter_names, flat.parameter_values, strict=True))["part_.k"] == k
    assert len(flat.equations) == unknowns


def test_the_constructor_wins_over_build() -> None:
    """What `build` of a class sets is a default, as a modification in `extends` (Modelica 3.6, section 7.2.4).

    What is given would be lost otherwise: `Faster(k=3.0)` was five, and nothing said so.
    """

    class Started(Faster):
        def build(self) -> None:
            super().build()
            self.x = fixed(2.0)

    assert flatten(Faster(k=3.0)).parameter_values[0] == 3.0
    assert flatten(Started(k=4.0)).parameter_values[0] == 4.0
    assert acausal.simulate(Started(x=fixed(7.0)), stop_time=0.1)["x"][0] == 7.0


def test_a_structural_value_that_build_overrules_is_refused() -> None:
    class Sized(Component):
        n: int = structural(default=2)
        x: Real = variable()

        def build(self) -> None:
            self.n = 3

        def equations(self) -> Equations:
            yield self.x == float(self.n)

    assert Sized().n == Sized(n=3).n == 3
    with pytest.raises(DeclarationError, match=r"AC118.*'n' to 3, but the constructor is given 5"):
        Sized(n=5)


class One(Component):
    y: Real = variable()

    def equations(self) -> Equations:
        yield self.y == 1.0


class Holder(Component):
    inner: Component = One()


class Replaced(Holder):
    inner: Component = Faster()


class Untouched(Holder):
    pass


class Diamond(Untouched, Replaced):
    pass


def test_a_part_replaced_on_one_side_of_a_diamond_stays_replaced() -> None:
    """As of methods: the class that replaces comes before the base of both in Python's order (C3, PEP 253)."""
    assert type(Diamond().inner) is Faster
    assert Diamond.__mro__.index(Replaced) < Diamond.__mro__.index(Holder)


def test_two_bases_that_declare_a_field_differently_are_refused() -> None:
    """Modelica 3.6, section 7.1: elements of one name that are inherited from several classes have to be identical."""

    class Long(Component):
        x: Real = variable(unit="m")

    class Heavy(Component):
        x: Real = variable(unit="kg")

    class LongToo(Component):
        x: Real = variable(unit="m", doc="the same quantity")

    with pytest.raises(DeclarationError, match=r"AC126.*two different fields x, of Long and Heavy") as caught:
        type("Both", (Long, Heavy), {})
    assert len(caught.value.where) == 3
    both: Any = type("Same", (Long, LongToo), {})
    assert list(both._declarations) == ["x"]


def test_another_class_does_not() -> None:
    class Stranger(Component):
        x: Real = variable()

        def equations(self) -> Equations:
            yield self.x == 1.0

    with fails_with(DeclarationError, "AC116"):
        Owner(which=Stranger)  # type: ignore[arg-type]
