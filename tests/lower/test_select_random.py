"""Random models, reduced to some of their outputs, against the same models whole: the outputs are the same."""

from __future__ import annotations

from typing import Any

import hypothesis.strategies as st
import numpy as np
from hypothesis import HealthCheck, example, given, settings
from numpy.typing import NDArray

import acausal
from acausal import (
    Component,
    Equations,
    Expr,
    Real,
    der,
    fixed,
    maximum,
    parameter,
    sin,
    structural,
    time,
    variable,
    where,
)

N = 5
Term = tuple[str, int, int, float]
KINDS = ("linear", "product", "sine", "contact", "kink", "time", "parameter")


class Web(Component):
    """States x with random rates, unknowns y that follow from them, one of them by an implicit equation.

    A term (kind, i, j, c) is a function of x[i] and x[j]; many are zero as long as their states are.
    """

    terms: tuple[tuple[Term, ...], ...] = structural(default=())
    starts: tuple[float, ...] = structural(default=(0.0,) * N)
    k: Real = parameter(default=(1.0, 0.0, 0.5, 0.0, 2.0), shape=N)
    w: Real = parameter(default=1.0, unit="rad/s")
    x: Real = variable(shape=N)
    y: Real = variable(shape=N)
    z: Real = variable()

    def build(self) -> None:
        self.x = fixed(self.starts)

    def term(self, kind: str, i: int, j: int, c: float) -> Expr:
        a, b = self.x[i], self.x[j]
        return {
            "linear": lambda: c * a,
            "product": lambda: c * a * b,
            "sine": lambda: c * sin(a),
            "contact": lambda: where(a * a + b * b < -0.25, c * a + 1.0, 0.0),
            "kink": lambda: c * maximum(a, b),
            "time": lambda: c * sin(self.w * time) * b,
            "parameter": lambda: c * self.k[i] * b,
        }[kind]()

    def equations(self) -> Equations:
        for i, row in enumerate(self.terms):
            rate = -self.x[i] * 0.3
            for term in row:
                rate = rate + self.term(*term)
            yield der(self.x[i]) == rate
        for i in range(N):
            yield self.y[i] == self.x[i] * self.x[(i + 1) % N] + self.k[i] * self.x[(i + 2) % N]
        yield self.z + 0.1 * sin(self.z) == self.y[0] + self.k[3]


terms = st.tuples(
    st.sampled_from(KINDS), st.integers(0, N - 1), st.integers(0, N - 1), st.sampled_from([0.0, -0.4, 0.3, 0.1])
)
webs = st.tuples(*[st.lists(terms, max_size=2).map(tuple) for _ in range(N)])
starts = st.tuples(*[st.sampled_from([0.0, 0.0, 0.0, 0.6, -0.3]) for _ in range(N)])
names = st.lists(st.sampled_from([*(f"x[{i}]" for i in range(N)), *(f"y[{i}]" for i in range(N)), "z"]), min_size=1)
QUICK = settings(max_examples=12, suppress_health_check=[HealthCheck.too_slow])


def run(model: Component, **options: Any) -> acausal.Result:
    compiled = acausal.compile(model, **options)
    return acausal.simulate(compiled, stop_time=2.0, tolerance=1e-9, output_interval=0.25, native=False)


def rows(result: acausal.Result, name: str) -> NDArray[np.float64]:
    """At the times that were asked for: a kink that is watched, in one of two models perhaps, adds a row."""
    return np.array([result[name][result.time == t][-1] for t in np.arange(0.0, 2.125, 0.25)])


@QUICK
@given(webs, starts, names, st.sampled_from([(), ("zeros",), ("k",), ("k[1]", "k[3]")]))
@example((((),) * N), (0.0,) * N, ["z"], ())
@example(
    ((("linear", 3, 0, -0.4),), (("linear", 2, 0, -0.4), ("kink", 0, 1, -0.4)), (), (("kink", 1, 4, -0.4),), ()),
    (0.0, 0.6, 0.6, 0.0, 0.0),
    ["x[0]"],
    (),
)
@example(((("parameter", 1, 1, 0.3),), ((),), (), (), ()), (0.6, 0.0, 0.0, 0.0, 0.0), ["x[0]"], ("zeros",))
def test_outputs_are_those_of_the_full_model(
    web: tuple[tuple[Term, ...], ...], start: tuple[float, ...], wanted: list[str], frozen: tuple[str, ...]
) -> None:
    web = tuple(tuple(t for t in row if t) for row in web)
    full = run(Web(terms=web, starts=start))
    part = run(Web(terms=web, starts=start), outputs=wanted, freeze=frozen)
    for name in wanted:
        np.testing.assert_allclose(rows(part, name), rows(full, name), rtol=2e-8, atol=2e-9, err_msg=name)


@QUICK
@given(webs, starts, names, st.sampled_from([0.0, 0.7, -1.2]))
def test_parameters_change_without_compiling(
    web: tuple[tuple[Term, ...], ...], start: tuple[float, ...], wanted: list[str], value: float
) -> None:
    """What is folded is folded for all values of parameters."""
    new = (value, 0.3, value, -0.2, 1.0)
    model = Web(terms=web, starts=start)
    part = acausal.compile(model, outputs=wanted)
    options: dict[str, Any] = {"stop_time": 2.0, "tolerance": 1e-9, "output_interval": 0.25, "native": False}
    values: Any = {"k": new}
    changed = acausal.simulate(part, parameters=values, **options)
    anew = acausal.simulate(acausal.compile(model, parameters=values), **options)
    for name in wanted:
        np.testing.assert_allclose(rows(changed, name), rows(anew, name), rtol=2e-8, atol=2e-9, err_msg=name)
