"""Mistakes that Python itself finds in the code of a model: each has a code, the class, the line and a remedy.

The remedies are the spellings of the language that the tutorial and the reference of the functions teach.
"""

from __future__ import annotations

import linecache
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import acausal
from acausal import AcausalError, Component, Equations, Real, boolean, discrete, fixed, part, structural, variable
from acausal.errors import ModelCodeError
from acausal.language.declarations.parts import outer
from acausal.library.electrical import Ground, Resistor
from acausal.library.translational import Mass
from acausal.models.oscillator import Oscillator
from tests.expected import fails_with


class Base(Component):
    """What the wrong equations below speak of."""

    n: int = structural(default=2)
    x: Real = variable(default=fixed(0.0))
    v: Real = variable(shape=3)
    d: Real = discrete()
    b: Real = boolean()
    resistor: Resistor = Resistor(R=1.0)
    ground: Ground = Ground()
    masses: list[Mass] = part()

    def build(self) -> None:
        self.masses = [Mass(m=1.0) for _ in range(self.n)]


NAMES: dict[str, Any] = {**vars(acausal), "math": math, "np": np, "Base": Base, "Resistor": Resistor, "Mass": Mass}


def flattened(line: str) -> None:
    """Flatten a model with this line in its `equations`, from a source that messages can quote."""
    source = f"class Wrong(Base):\n    def equations(self):\n        {line}\n"
    file = f"wrong_{abs(hash(line))}.py"
    linecache.cache[file] = len(source), None, source.splitlines(keepends=True), file
    names = {**NAMES, "__name__": __name__}
    exec(compile(source, file, "exec"), names)
    acausal.flatten(names["Wrong"]())


EQUATIONS = {
    # habits of Modelica
    "yield self.x(0) == 1": ("AC002", "self.x without brackets"),
    "yield self.x == time()": ("AC002", "write time"),
    "yield self.x == self.x.start": ("AC002", "variable(default=fixed(0.0))"),
    "self.x.start = 3; yield self.x == 1": ("AC002", "variable(default=fixed(0.0))"),
    "yield self.x.der == 1": ("AC002", "der(self.x)"),
    "yield self.v.x == 1": ("AC002", "v[0]"),
    "yield self.v.dot(self.v) == 1": ("AC002", "dot(v, w)"),
    "yield self.x == len(self.x)": ("AC103", "one value only"),
    "for k in self.x: yield k == 1": ("AC103", "one value only"),
    "for k in self.n: yield self.x == 1": ("AC002", "range(n)"),
    "for k in range(self.n / 2): yield self.x == 1": ("AC002", "n // 2"),
    # components are no quantities
    "yield self.x == self.resistor + 1": ("AC002", "self.resistor.v"),
    "yield self.x == 2 * self.resistor": ("AC002", "self.resistor.v"),
    "yield self.x == -self.resistor.p": ("AC002", "self.resistor.p.v"),
    "yield self.resistor.p - self.resistor.n == 0": ("AC002", "self.resistor.p.v"),
    "yield self.x == where(self.resistor > 1, 1, 2)": ("AC002", "self.resistor.v"),
    "yield self.resistor(2) == 0": ("AC002", "self.resistor.v"),
    "for r in self.resistor: yield r.i == 0": ("AC002", "self.resistor.v"),
    "yield self.x == float(self.resistor)": ("AC002", "self.resistor.v"),
    "yield self.x == self.masses + 1": ("AC002", "self.masses[0]"),
    "yield sum(self.masses) == 0": ("AC002", "self.masses[0].s"),
    "yield self.masses[0:2].s == 0": ("AC002", "of one element"),
    "for k, mass in self.masses: yield mass.s == k": ("AC002", "enumerate(self.masses)"),
    "yield from super().equations()": ("AC002", "leave it out"),
    # counts and names of arguments
    "yield connect(self.resistor.p)": ("AC002", "connect(first, second, *more)"),
    "yield connect(a=self.resistor.p, b=self.ground.p)": ("AC002", "connect(first, second, *more)"),
    "yield self.x == where(self.x > 0, 1)": ("AC002", "where(condition, a, b"),
    "yield assert_(self.x > 0)": ("AC002", "assert_(condition, message"),
    "yield self.x == sqrt()": ("AC002", "sqrt(x)"),
    "yield self.x == minimum(self.x)": ("AC002", "minimum(x, y)"),
    "yield when()": ("AC002", "when(condition, *actions)"),
    "yield when(self.x > 1, reset(self.d))": ("AC002", "reset(x, value"),
    "yield der(self.x, 2) == 1": ("AC002", "der(der(x))"),
    "yield when(sample(0.1), reset(self.d, 1))": ("AC002", "sample(start, interval)"),
    # functions and operators of Python
    "yield self.x == max(self.x, 0.1)": ("AC101", "maximum(self.x, 0.1)"),
    "yield self.x == min(self.x, 0.1)": ("AC101", "minimum(self.x, 0.1)"),
    "yield self.b == (self.x > 0 and self.x < 1)": ("AC101", "(self.x > 0) & (self.x < 1)"),
    "yield self.b == (self.b or self.x < 1)": ("AC101", "self.b | (self.x < 1)"),
    "yield self.b == (not self.x > 0)": ("AC101", "~(self.x > 0)"),
    "yield self.b == (0 < self.x < 1)": ("AC101", "(0 < self.x) & (self.x < 1)"),
    "yield self.x == (1 if self.x > 0 else 2)": ("AC101", "where(condition, a, b)"),
    "yield self.x == math.sin(self.x)": ("AC104", "acausal.sin"),
    "yield self.x == math.pow(self.x, 2)": ("AC104", "x ** y"),
    "yield self.x == np.where(self.x > 0, 1, 2)": ("AC002", "acausal.where"),
    "yield self.x == 1 / (self.n - 2)": ("AC002", "structural values"),
    "yield self.x == sinn(self.x)": ("AC002", "did you mean sin"),
    "yield x == 1": ("AC002", "write self.x"),
}


@pytest.mark.parametrize("line", EQUATIONS)
def test_a_mistake_in_equations_has_a_code_the_line_and_a_remedy(line: str) -> None:
    code, remedy = EQUATIONS[line]
    with pytest.raises(AcausalError) as caught:
        flattened(line)
    error = caught.value
    assert error.code == code
    assert error.where[0].text == line
    assert remedy in str(error.help)


def test_the_message_marks_the_expression_and_says_what_its_names_are() -> None:
    with pytest.raises(ModelCodeError) as caught:
        flattened("yield self.x == self.resistor + 1")
    assert str(caught.value).splitlines()[2:] == [
        "              yield self.x == self.resistor + 1",
        "                              ^^^^^^^^^^^^^^^^^",
        "          `self.resistor` is a Resistor",
        "  help    a component has no value; take one of its quantities: "
        "self.resistor.v, self.resistor.i, self.resistor.R",
    ]
    assert isinstance(caught.value.__cause__, TypeError)


def test_what_a_model_raises_itself_is_not_reworded() -> None:
    with pytest.raises(ValueError, match=r"^n must be even$"):
        flattened('raise ValueError("n must be even"); yield')


DECLARED = {
    'x: Real = "2.0"': ("AC112", "variable(...)"),
    "x: Real = fixed(0.0)": ("AC112", "variable(default=fixed(...))"),
    "x: float = parameter(default=1.0)": ("AC112", "x: Real = parameter(...)"),
    "x: Resistor = variable()": ("AC112", "x: Real = variable(...)"),
    "r: Real = Resistor(R=1.0)": ("AC112", "the type of its value"),
    "n: Real = structural(default=2)": ("AC112", "the type of its value"),
    "n: int = structural(default=2.5)": ("AC115", "give an int"),
    "m: list[Mass] = [Mass(m=1.0)]": ("AC112", "in `build`"),
    "m: Mass = outer(Mass(m=1.0))": ("AC112", "outer(World)"),
    "x: Real = parameter(default=1.0); y: Real = parameter(default=2 * x)": ("AC110", "default=lambda self"),
}


@pytest.mark.parametrize("line", DECLARED)
def test_a_mistake_in_a_declaration(line: str) -> None:
    code, remedy = DECLARED[line]
    with fails_with(AcausalError, code) as caught:
        exec(f"class Wrong(Component):\n    {line}\n", {**NAMES, "outer": outer, "__name__": __name__})
    assert remedy in str(caught.value.help)


@pytest.mark.parametrize("names", [5, [5], [Oscillator().mass.s], "mass.s"])
@pytest.mark.parametrize(
    "asks",
    [
        lambda names: acausal.simulate(Oscillator(), outputs=names),
        lambda names: acausal.linearize(Oscillator(), outputs=names),
        lambda names: acausal.reduce(Oscillator(), outputs=names),
        lambda names: acausal.sweep(Oscillator(), {"c": [1.0, 2.0]}, signals=names, workers=1),
        lambda names: acausal.fit(Oscillator(), {"mass.s": ([0.0, 1.0], [0.1, 0.1])}, names),
    ],
    ids=["simulate", "linearize", "reduce", "sweep", "fit"],
)
def test_what_is_no_list_of_names(asks: Callable[[Any], object], names: Any) -> None:
    with fails_with(AcausalError, "AC018"):
        asks(names)


def test_an_empty_list_of_parts_shows_the_number_that_made_it_empty() -> None:
    class Chain(Component):
        n: int = structural(default=1)
        masses: list[Mass] = part()

        def build(self) -> None:
            self.masses = [Mass(m=1.0) for _ in range(self.n)]

        def equations(self) -> Equations:
            yield self.masses[0].s == 0.0

    with fails_with(AcausalError, "AC103") as caught:
        acausal.flatten(Chain(n=0))
    assert "Chain has n=0" in caught.value.evidence


def test_one_component_where_a_list_is_declared() -> None:
    class Chain(Component):
        masses: list[Mass] = part()

        def build(self) -> None:
            self.masses = Mass(m=1.0)  # type: ignore[assignment]

    with fails_with(AcausalError, "AC116", "'masses' is a list of Mass, not one"):
        Chain()
