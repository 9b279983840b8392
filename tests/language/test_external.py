"""External functions through every stage: declared, called, flattened, differentiated, lowered, simulated, exported."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest

import acausal
from acausal import Component, Equations, External, Real, der, fixed, parameter, time, variable
from acausal.errors import DeclarationError, UnitError
from acausal.export.casadi.functions import casadi_model
from acausal.flatten.pool import Pool
from acausal.flatten.scalars.differentiate import differentiate
from acausal.language.expressions.expression import Expr
from acausal.language.expressions.external import Call
from acausal.lower.build import Builder
from acausal.numeric.evaluate import gradients, values
from tests.expected import fails_with


def polar(kind: Any, options: dict[str, Any]) -> Any:
    """Length of a vector, and the vector turned by a matrix that is not symmetric."""
    r, R = kind.sym("r", 3), kind.sym("R", 3, 3)
    return ca.Function("polar", [r, R], [ca.norm_2(r), R @ r], options)


INLINE = External("polar", lambda: polar(ca.SX, {}), inputs=((3,), (3, 3)), outputs=((), (3,)), units=("m", "m"))
CALLED = External(
    "polar", lambda: polar(ca.MX, {"never_inline": True}), inputs=((3,), (3, 3)), outputs=((), (3,)), units=("m", "m")
)
BOTH = pytest.mark.parametrize("function", [INLINE, CALLED], ids=["inlined", "one call"])

TURN = ((1.0, 2.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def model(function: External) -> Component:
    """x = x0 exp(-t), and what the function and its two time derivatives make of it."""

    class Decay(Component):
        T: Real = parameter(default=1.0, unit="s")
        x: Real = variable(unit="m", shape=3, default=fixed((1.0, 2.0, 3.0)))
        length: Real = variable(unit="m")
        turned: Real = variable(unit="m", shape=3)
        rate: Real = variable(unit="m/s")
        bend: Real = variable(unit="m/s2")

        def equations(self) -> Equations:
            length, turned = function(self.x, TURN)
            yield self.T * der(self.x) == -self.x
            yield self.length == length
            yield self.turned == turned
            yield self.rate == der(self.length)
            yield self.bend == der(self.rate)

    return Decay()


def test_outputs_are_expressions_with_shape_and_text() -> None:
    length, turned = INLINE((3.0, 0.0, 4.0), TURN)
    assert isinstance(length, Expr)
    assert length.shape == ()
    assert turned.shape == (3,)
    assert str(length).startswith("polar((3, 0, 4)")


def test_one_output_is_the_expression_itself() -> None:
    single = External("square", lambda: None, inputs=((),), outputs=((),))
    assert isinstance(single(2.0), Expr)


def test_wrong_arguments_are_named() -> None:
    with fails_with(DeclarationError, "AC162", match="polar takes 2 arguments: vector of 3, 3x3 matrix") as caught:
        INLINE((1.0, 2.0), TURN)
    assert "vector of 2" in caught.value.evidence[0]


def test_units_and_outputs_must_be_as_many() -> None:
    with fails_with(DeclarationError, "AC161"):
        External("f", lambda: None, inputs=((),), outputs=((), ()), units=("m",))


@pytest.mark.parametrize("shape", [1, "x", (1, 2, 3), (0,), (2.0,)])
def test_what_is_no_shape_is_named(shape: Any) -> None:
    for inputs, outputs in (((shape,), ((),)), (((),), (shape,))):
        with fails_with(DeclarationError, "AC161", match="external function f is declared with"):
            External("f", lambda: None, inputs=inputs, outputs=outputs)


def test_a_factory_that_makes_something_else_is_named() -> None:
    wrong = External("polar", lambda: polar(ca.SX, {}), inputs=((3,), (3, 3)), outputs=((), (2,)))

    class Wrong(Component):
        y: Real = variable(shape=2)

        def equations(self) -> Equations:
            yield self.y == wrong((1.0, 2.0, 3.0), TURN)[1]

    with fails_with(DeclarationError, "AC163"):
        acausal.simulate(Wrong(), stop_time=1.0)


def unreadable() -> object:
    raise OSError("no file")


@pytest.mark.parametrize(("factory", "fact"), [(unreadable, "raised OSError: no file"), (lambda: len, "returns a")])
def test_a_factory_that_fails_is_named_with_its_place(factory: Any, fact: str) -> None:
    failing = External("failing", factory, inputs=((),), outputs=((),))

    class Wrong(Component):
        y: Real = variable()

        def equations(self) -> Equations:
            yield self.y == failing(time)

    with pytest.raises(DeclarationError, match=rf"AC163.*failing {fact}") as caught:
        acausal.simulate(Wrong(), stop_time=1.0)
    assert caught.value.where[0].file == __file__


def test_units_of_outputs_are_checked() -> None:
    class Mixed(Component):
        f: Real = variable(unit="N")

        def equations(self) -> Equations:
            yield self.f == INLINE((1.0, 2.0, 3.0), TURN)[0]

    with pytest.raises(UnitError, match="left side is in N"):
        acausal.flatten(Mixed())


def test_equal_calls_are_one_node() -> None:
    pool = Pool()
    operands = [pool.var(k) for k in range(12)]
    assert pool.make(Call(INLINE, 0), *operands) == pool.make(Call(INLINE, 0), *operands)
    assert pool.make(Call(INLINE, 0), *operands) != pool.make(Call(INLINE, 1), *operands)
    assert pool.make(Call(INLINE, 0), *operands) != pool.make(Call(CALLED, 0), *operands)


@BOTH
def test_values_gradients_and_time_derivative_of_a_node(function: External) -> None:
    """d|r|/dr = r/|r|; turned = R r, whose derivative by R[0, 1] is r[1]: rows come before columns."""
    pool = Pool()
    first = pool.new_variables(12)
    operands = [pool.var(first + k) for k in range(12)]
    point = {first + k: v for k, v in enumerate((3.0, 0.0, 4.0, *np.ravel(TURN)))}
    length, x, y = (pool.make(Call(function, k), *operands) for k in range(3))
    leaves: dict[str, Any] = {"var": point.__getitem__}
    found = values(pool, [length, x, y], leaves)
    assert [float(found[n][0]) for n in (length, x, y)] == pytest.approx([5.0, 3.0, 0.0])
    by_r, turned = gradients(pool, [length, x], range(12), leaves)
    assert [float(by_r[k][0]) for k in range(3)] == pytest.approx([0.6, 0.0, 0.8])
    assert float(turned[3 + 2][0]) == pytest.approx(4.0)  # d(R r)[0]/dR[0, 2]
    slope = differentiate(pool, length)
    rates = {pool.derivative(first + k): float(k == 2) for k in range(12)}
    found = values(pool, [slope], {"var": lambda v: {**point, **rates}[v]})
    assert float(found[slope][0]) == pytest.approx(0.8)


@BOTH
def test_lowering_calls_the_function_once(function: External) -> None:
    pool = Pool()
    operands = [pool.var(k) for k in range(12)]
    x = ca.SX.sym("x", 12)
    builder = Builder(pool, ca.SX(0), ca.SX(0, 1), {})
    builder.assign(range(12), x)
    lowered = builder.lower([pool.make(Call(function, k), *operands) for k in range(4)])
    f = ca.Function("f", [x], lowered)
    calls = sum(f.instruction_id(k) == ca.OP_CALL for k in range(f.n_instructions()))
    assert calls == (1 if function is CALLED else 0)
    found = f(ca.DM([3.0, 0.0, 4.0, *np.ravel(TURN)]))
    assert [float(v) for v in found] == pytest.approx([5.0, 3.0, 0.0, 4.0])


@BOTH
@pytest.mark.parametrize("solver", ["idas", "rosenbrock", "erk"])
def test_simulation_meets_the_closed_form(function: External, solver: str) -> None:
    """Everything decays as exp(-t), and the length as well, so that its second derivative is the length again."""
    result = acausal.simulate(model(function), stop_time=1.0, solver=solver, tolerance=1e-9)
    e = np.exp(-1.0)
    assert result.final("length") == pytest.approx(np.sqrt(14.0) * e, rel=1e-7)
    assert result.final("rate") == pytest.approx(-np.sqrt(14.0) * e, rel=1e-7)
    assert result.final("bend") == pytest.approx(np.sqrt(14.0) * e, rel=1e-7)
    assert result.final("turned[0]") == pytest.approx(5.0 * e, rel=1e-7)


@BOTH
def test_compiled_and_exported(function: External, tmp_path: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """In generated C, and in the functions for optimal control with their second derivatives."""
    compiled = acausal.compile(model(function))
    result = acausal.simulate(compiled, stop_time=1.0, solver="rosenbrock", tolerance=1e-9, native=True)
    assert result.final("length") == pytest.approx(np.sqrt(14.0) * np.exp(-1.0), rel=1e-7)
    exported = casadi_model(compiled, ["length"])
    x = ca.SX.sym("x", 3)
    y = exported.ode(x, [], ca.DM(compiled.parameter_values))[1]
    hessian = ca.Function("h", [x], [ca.hessian(y, x)[0]])(ca.DM([3.0, 0.0, 4.0]))
    # Hessian of |x|: (I - n n')/|x|.
    assert np.asarray(hessian) == pytest.approx((np.eye(3) - np.outer([0.6, 0, 0.8], [0.6, 0, 0.8])) / 5, abs=1e-12)
