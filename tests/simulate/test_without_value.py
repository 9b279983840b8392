"""An operation on an expression without a value has none: no minimum, sign or step of nan is a number."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import casadi as ca
import pytest

import acausal
from acausal import (
    Component,
    Equations,
    Expr,
    Real,
    asin,
    clamp,
    der,
    discrete,
    fabs,
    fixed,
    floor,
    log,
    lookup,
    maximum,
    minimum,
    no_event,
    parameter,
    reset,
    sign,
    sin,
    sqrt,
    structural,
    time,
    variable,
    when,
    where,
)
from acausal.errors import AcausalError

Operation = Callable[[Expr], Expr]

# Operations without a value for x < 0, as their roots, logarithms and quotients have none; C gives a number for each.
OPERATIONS: dict[str, Operation] = {
    "minimum": lambda x: minimum(sqrt(x), 2.0),
    "maximum": lambda x: maximum(-3.0, log(x)),
    "clamp": lambda x: clamp(x**1.5, -1.0, 1.0),
    "nested": lambda x: maximum(1.0 + minimum(asin(2.0 * x - 1.0), 2.0), 0.5),
    "zero by zero": lambda x: minimum(maximum(x, 0.0) / (x + fabs(x)), 5.0),
    "sign": lambda x: sign(log(x) + 0.2),
    "floor": lambda x: floor(3.0 * sqrt(x)),
    "table": lambda x: lookup([0.0, 1.0, 2.0], [(0.3,), (1.3,)])(sqrt(x)),
    "in a branch": lambda x: where(x > -10.0, minimum(sqrt(x), 2.0), 0.0),
}


class Leaving(Component):
    """x = 1 - t leaves the domain of the `operation` of `OPERATIONS` at t = 1; y is the integral of its value s."""

    operation: str = structural()
    is_shown_only: bool = structural(default=False)
    x: Real = variable(default=fixed(1.0))
    y: Real = variable(default=fixed(0.0))
    s: Real = variable()

    def equations(self) -> Equations:
        yield der(self.x) == -1.0
        yield self.s == OPERATIONS[self.operation](self.x)
        yield der(self.y) == (1.0 if self.is_shown_only else self.s)


_ARGUMENT = ca.MX.sym("x")
ROOT = acausal.External(
    "root",
    lambda: ca.Function("root", [_ARGUMENT], [ca.if_else(_ARGUMENT >= 0.0, ca.sqrt(_ARGUMENT), math.nan)]),
    inputs=((),),
    outputs=((),),
)


class OfParameter(Component):
    """The integral of an operation on a parameter."""

    operation: str = structural()
    p: Real = parameter(default=0.49)
    y: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.y) == OPERATIONS[self.operation](self.p)


class OfExternal(Component):
    """An operation on a root that an external function computes."""

    operation: Callable[[Any], Any] = structural()
    x: Real = variable(default=fixed(1.0))
    root: Real = variable()
    y: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == -1.0
        yield self.root == ROOT(self.x)
        yield der(self.y) == self.operation(self.root)


@pytest.mark.parametrize("solver", ["idas", "cvodes", "rosenbrock", "erk"])
@pytest.mark.parametrize("operation", [lambda q: minimum(q, 2.0), lambda q: maximum(minimum(q, 2.0), 0.1)])
def test_an_operation_on_an_external_function_without_a_value_has_none(operation: Operation, solver: str) -> None:
    """The minimum of the root of x and 2 was 2 for x < 0, so that y became 2/3 + 2."""
    with pytest.raises(AcausalError) as caught:
        acausal.simulate(OfExternal(operation=operation), stop_time=2.0, solver=solver)
    assert caught.value.result is not None  # type: ignore[attr-defined]
    assert caught.value.result.time[-1] <= 1.0 + 5e-3  # type: ignore[attr-defined]
    left_out = acausal.simulate(
        OfExternal(operation=lambda q: where(q > -1.0, minimum(q, 2.0), 0.0)), stop_time=0.5, solver=solver
    )
    assert left_out.final("y") == pytest.approx(2.0 / 3.0 * (1.0 - 0.5**1.5), abs=1e-5)


VALUES = {  # at p = 0.49
    "minimum": 0.7,
    "maximum": math.log(0.49),
    "clamp": 0.343,
    "sign": -1.0,
    "floor": 2.0,
    "in a branch": 0.7,
}


@pytest.mark.parametrize(("operation", "value"), VALUES.items())
def test_an_operation_on_a_parameter_without_a_value_has_none(operation: str, value: float) -> None:
    """The minimum of sqrt(p) and 2 was 2 for p = -1, in a model compiled for p = 0.49."""
    compiled = acausal.compile(OfParameter(operation=operation))
    assert acausal.simulate(compiled, stop_time=1.0).final("y") == pytest.approx(value, abs=1e-9)
    with pytest.raises(AcausalError, match="AC303"):
        acausal.simulate(compiled, stop_time=1.0, parameters={"p": -1.0})


CASES = [(o, "erk") for o in OPERATIONS] + [("minimum", s) for s in ("rosenbrock", "idas", "cvodes", "rk")]


@pytest.mark.parametrize(("operation", "solver"), CASES)
def test_a_run_ends_where_an_operand_loses_its_value(operation: str, solver: str) -> None:
    with pytest.raises(AcausalError) as caught:
        acausal.simulate(
            Leaving(operation=operation), stop_time=2.0, solver=solver, step=0.1 if solver == "rk" else None
        )
    assert caught.value.code in ("AC400", "AC402", "AC403", "AC404")


@pytest.mark.parametrize("operation", OPERATIONS)
def test_exported_functions_give_no_number(operation: str) -> None:
    model = acausal.compile(Leaving(operation=operation)).casadi(["s"], events=True)
    arguments = {name: ca.DM.zeros(*model.ode.size_in(name)) for name in model.ode.name_in()}
    assert math.isnan(model.ode(**{**arguments, "x": [-0.5, 0.0]})["xdot"][1])


def test_what_is_only_shown_has_no_value_either() -> None:
    run = acausal.simulate(Leaving(operation="minimum", is_shown_only=True), stop_time=2.0, output_interval=0.5)
    assert run["s"][:2] == pytest.approx([1.0, math.sqrt(0.5)])
    assert all(math.isnan(v) for v in run["s"][run.time > 1.0])


class Halved(Component):
    """The discrete `level` falls from 0.25 to -0.75 at t = 1."""

    level: Real = discrete(default=fixed(0.25))
    y: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield when(time > 1.0, reset(self.level, self.level - 1.0))
        yield der(self.y) == minimum(sqrt(self.level), 2.0)


def test_a_discrete_variable_may_leave_a_domain_too() -> None:
    assert acausal.simulate(Halved(), stop_time=0.9, solver="erk").final("y") == pytest.approx(0.45)
    with pytest.raises(AcausalError):
        acausal.simulate(Halved(), stop_time=2.0, solver="erk")


class Within(Component):
    """All operands have a value throughout; y' = min(|x|, 0.5) + max(1 - t, 0) with x = 1 - t."""

    x: Real = variable(default=fixed(1.0))
    y: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == -1.0
        yield der(self.y) == minimum(sqrt(self.x**2), 0.5) + no_event(
            maximum(where(self.x > 0, sqrt(self.x) ** 2, 0.0), 0.0)
        )


def test_values_inside_of_the_domain_do_not_change() -> None:
    # 0.5 from each of the outer halves and 0.125 from each of the inner; the second term adds 1/2
    assert acausal.simulate(Within(), stop_time=2.0, tolerance=1e-8).final("y") == pytest.approx(1.25, abs=1e-7)


class Tank(Component):
    """A level falls by a root to its outlet at 0.2, in a branch that is evaluated slightly beyond its condition."""

    h: Real = variable(default=fixed(1.0))
    q: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        outflow = where(self.h > 0.2, 0.8 * sqrt(self.h - 0.2), 0.0)
        yield der(self.h) == -outflow
        yield der(self.q) == minimum(outflow, 5.0)


@pytest.mark.parametrize("solver", ["rosenbrock", "erk"])
def test_an_operation_on_a_branch_goes_on_where_its_domain_ends(solver: str) -> None:
    # what flows out is what the level has lost
    assert acausal.simulate(Tank(), stop_time=4.0, solver=solver).final("q") == pytest.approx(0.8, abs=1e-5)


class Chain(Component):
    """y[k] = sin(y[k - 1]), so that each is defined by the one before."""

    x: Real = variable(default=fixed(1.0))
    y: Real = variable(shape=1200)
    u: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == -1.0
        yield self.y[0] == sqrt(self.x + 3.0)
        for k in range(1, 1200):
            yield self.y[k] == sin(self.y[k - 1])
        yield der(self.u) == minimum(self.y[1199], 2.0) + where(self.y[1199] > 5.0, 1.0, 0.0)


@pytest.mark.slow
def test_definitions_may_form_long_chains() -> None:
    # beyond the depth of Python's recursion; the iterated sine has no slope left: sqrt(3/1200) up to log(n)/n
    assert acausal.simulate(Chain(), stop_time=1.0).final("u") == pytest.approx(math.sqrt(3 / 1200), rel=0.01)
