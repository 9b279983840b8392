"""Parameters: numbers, bindings to others, defaults as functions, values from outside."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import acausal
from acausal import Component, Equations, Expr, Real, fixed, parameter, part, sqrt, structural, time, variable
from acausal.errors import AcausalError
from acausal.simulate.options import parameter_vector
from tests.expected import fails_with


class Disc(Component):
    """Parameters in a chain: r, d = 2 r, area = pi d^2 / 4; the mass is free."""

    r: Real = parameter(unit="m", default=0.5, min=0.0)
    d: Real = parameter(unit="m", default=lambda self: 2 * self.r)
    area: Real = parameter(unit="m2", default=lambda self: math.pi * self.d**2 / 4)
    m: Real = parameter(unit="kg", min=0.0)
    axis: Real = parameter(shape=3, default=(0.0, 0.0, 1.0), min=-1.0, max=1.0)
    load: Real = variable(unit="kg/m2")

    def equations(self) -> Equations:
        yield self.load == self.m / self.area


class Pair(Component):
    m: Real = parameter(unit="kg", default=3.0)
    a: Disc = part()
    b: Disc = part()

    def build(self) -> None:
        self.a = Disc(m=self.m)
        self.b = Disc(m=self.m / 3, r=2 * self.a.r)


def test_binding_chains() -> None:
    """a: m = 3, r = 0.5; b: m = 1, r = 1, area = pi."""
    result = acausal.simulate(Pair())
    assert result.final("a.m") == 3.0
    assert result.final("b.m") == pytest.approx(1.0)
    assert result.final("b.d") == pytest.approx(2.0)
    assert result.final("b.area") == pytest.approx(math.pi)
    assert result.final("b.load") == pytest.approx(1 / math.pi)


def test_free_parameters_are_those_with_numbers() -> None:
    flat = acausal.flatten(Pair())
    free = [p.path for p in flat.parameters if p.free]
    assert free == ["m", "a.r", "a.axis", "b.axis"]
    axes = [f"{disc}.axis[{k}]" for disc in "ab" for k in range(3)]
    assert flat.parameter_names == ("m", "a.r", *axes)


@pytest.mark.parametrize("order", [("a.axis", "a.axis[1]"), ("a.axis[1]", "a.axis")])
@pytest.mark.parametrize("make", [Pair, lambda: acausal.compile(Pair())])
def test_an_entry_replaces_that_of_the_whole_in_any_order(order: tuple[str, str], make: Any) -> None:
    values = {"a.axis": (0.1, 0.2, 0.3), "a.axis[1]": 0.5}
    result = acausal.simulate(make(), parameters={name: values[name] for name in order})
    np.testing.assert_array_equal(result["a.axis"][0], [0.1, 0.5, 0.3])


def test_values_from_outside_go_through_the_chain() -> None:
    """r = 1 doubles a.d and, through b.r = 2 a.r, b.d."""
    compiled = acausal.compile(Pair())
    result = acausal.simulate(compiled, parameters={"a.r": 1.0, "m": 6.0})
    assert result.final("a.d") == 2.0
    assert result.final("b.d") == 4.0
    assert result.final("b.load") == pytest.approx(2.0 / (4 * math.pi))
    assert acausal.simulate(compiled).final("a.d") == 1.0  # and the compiled model keeps its own


def test_a_bound_parameter_is_cut_off_by_compiling_with_a_value() -> None:
    compiled = acausal.compile(Pair(), parameters={"b.m": 7.0})
    result = acausal.simulate(compiled, parameters={"m": 30.0})
    assert (result.final("a.m"), result.final("b.m")) == (30.0, 7.0)


def test_numbers_made_by_functions_of_numbers_stay_free() -> None:
    """2 * sqrt(2) is an expression only in the eyes of Python."""
    compiled = acausal.compile(Disc(m=2 * sqrt(2.0)))
    assert "m" in compiled.parameters
    assert acausal.simulate(compiled).final("m") == pytest.approx(2 * math.sqrt(2), abs=1e-15)
    assert acausal.simulate(compiled, parameters={"m": 1.0}).final("m") == 1.0


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({"axis": (1.0, 0.0, 0.5)}, [1.0, 0.0, 0.5]),
        ({"axis": [1, 0, 0]}, [1.0, 0.0, 0.0]),
        ({"axis": np.array([0.1, 0.2, 0.3])}, [0.1, 0.2, 0.3]),
        ({"axis": 0.5}, [0.5, 0.5, 0.5]),
        ({"m": np.float64(2.0)}, [0.0, 0.0, 1.0]),
        ({"m": True}, [0.0, 0.0, 1.0]),
    ],
)
def test_shapes_of_values(given: dict[str, Any], expected: list[float]) -> None:
    """Given to the compiler or to a compiled model: the same."""
    compiled = acausal.compile(Disc(m=1.0))
    for result in (acausal.simulate(compiled, parameters=given), acausal.simulate(Disc(m=1.0), parameters=given)):
        np.testing.assert_array_equal(result.final("axis"), expected)


def test_one_entry_of_a_compiled_vector() -> None:
    compiled = acausal.compile(Disc(m=1.0))
    np.testing.assert_array_equal(acausal.simulate(compiled, parameters={"axis[1]": 0.5}).final("axis"), [0, 0.5, 1])


WRONG = [
    pytest.param({"k": 1.0}, "AC020", id="unknown"),
    pytest.param([1.0], "AC023", id="a list"),
    pytest.param("m=1", "AC023", id="text"),
    pytest.param({"axis": (1.0, 2.0)}, "AC023", id="too short"),
    pytest.param({"m": (1.0, 2.0)}, "AC023", id="not a scalar"),
    pytest.param({"m": "1 m"}, "AC151", id="length"),
    pytest.param({"m": None}, "AC023", id="None"),
    pytest.param({"m": -1.0}, "AC136", id="below its limit"),
    pytest.param({"m": math.nan}, "AC136", id="nan"),
    pytest.param({"axis": (0.0, 0.0, 1.5)}, "AC136", id="entry above its limit"),
]


@pytest.mark.parametrize(("given", "code"), WRONG)
def test_wrong_values(given: Any, code: str) -> None:
    with fails_with(AcausalError, code):
        acausal.flatten(Disc(m=1.0), given)
    compiled = acausal.compile(Disc(m=1.0))
    with fails_with(AcausalError, code):
        parameter_vector(compiled, given)


@pytest.mark.parametrize(
    ("given", "code"),
    [
        pytest.param({"d": 2.0}, "AC022", id="bound to others"),
        pytest.param({"axis[1]": 2.0}, "AC136", id="limit of the vector"),
        pytest.param({"axis[3]": 0.0}, "AC020", id="no such entry"),
        pytest.param({"load": 0.0}, "AC020", id="no parameter"),
    ],
)
def test_wrong_values_for_a_compiled_model(given: dict[str, Any], code: str) -> None:
    with fails_with(AcausalError, code):
        parameter_vector(acausal.compile(Disc(m=1.0)), given)


class List(Component):
    discs: list[Disc] = part()

    def build(self) -> None:
        self.discs = [Disc(m=1.0)]


def test_a_list_of_parts_is_no_parameter() -> None:
    with fails_with(AcausalError, "AC020"):
        parameter_vector(acausal.compile(List()), {"discs": 5.0})
    vector = parameter_vector(acausal.compile(List()), {"discs[0].m": 5.0})
    assert 5.0 in vector


class Circle(Component):
    a: Real = parameter(default=lambda self: self.b + 1)
    b: Real = parameter(default=lambda self: self.a - 1)


class Timed(Component):
    a: Real = parameter(default=lambda self: 2 * time)


class Following(Component):
    x: Real = variable(default=fixed(0.0))
    a: Real = parameter(default=lambda self: self.x)


class TimedStart(Component):
    x: Real = variable(default=fixed(3 * time))


@pytest.mark.parametrize(
    ("model", "code"),
    [
        pytest.param(Circle(), "AC134", id="circle"),
        pytest.param(Timed(), "AC135", id="time"),
        pytest.param(Following(), "AC135", id="variable"),
        pytest.param(TimedStart(), "AC135", id="start in time"),
        pytest.param(Disc(), "AC133", id="no value"),  # type: ignore[call-arg]
    ],
)
def test_what_is_no_value(model: Component, code: str) -> None:
    with fails_with(AcausalError, code):
        acausal.flatten(model)


class Polynomial(Component):
    """Structural values decide the equations; parameters only fill them."""

    n: int = structural(default=2)
    c: Real = parameter(default=2.0)
    y: Real = variable()

    def equations(self) -> Equations:
        total: Expr = self.c * 1
        for _ in range(self.n - 1):
            total = total * self.c
        yield self.y == total


@pytest.mark.parametrize("n", [1, 2, 5])
def test_structural_values_decide_the_equations(n: int) -> None:
    compiled = acausal.compile(Polynomial(n=n))
    assert acausal.simulate(compiled, parameters={"c": 3.0}).final("y") == pytest.approx(3.0**n)


def test_a_structural_value_is_not_set_from_outside() -> None:
    with fails_with(AcausalError, "AC021"):
        acausal.flatten(Polynomial(), {"n": 3})


@pytest.mark.parametrize("compiled", [False, True])
def test_values_from_outside_may_have_units(compiled: bool) -> None:
    """300 g on a disc of 20 mm radius: 0.3 / (pi 0.02**2) = 238.732 kg/m2."""
    given = {"m": "300 g", "r": "2 cm"}
    disc = Disc(m=1.0)
    result = (
        acausal.simulate(acausal.compile(disc), stop_time=1.0, parameters=given)
        if compiled
        else acausal.simulate(disc, stop_time=1.0, parameters=given)
    )
    assert result.final("load") == pytest.approx(238.732, rel=1e-5)


@pytest.mark.parametrize(("text", "code"), [("3 s", "AC151"), ("3 gg", "AC150"), ("three", "AC152")])
def test_texts_that_are_no_values_are_refused(text: str, code: str) -> None:
    for model in (Disc(m=1.0), acausal.compile(Disc(m=1.0))):
        with fails_with(AcausalError, code) as caught:
            acausal.simulate(model, parameters={"m": text})
        assert "m" in str(caught.value)
