"""Time derivatives by the chain rule, against central differences along known curves."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest

from acausal.flatten.pool import Pool
from acausal.flatten.scalars.differentiate import differentiate
from acausal.numeric.evaluate import values

# Curves x(t) with their derivatives; within every domain that follows.
CURVES: list[tuple[Callable[[float], float], Callable[[float], float]]] = [
    (lambda t: 0.4 + 0.2 * math.sin(t), lambda t: 0.2 * math.cos(t)),
    (lambda t: 0.7 * math.exp(-0.3 * t), lambda t: -0.21 * math.exp(-0.3 * t)),
]
T = 0.83


class Scene:
    """Variables 0 and 1 on the curves, their derivatives, one parameter, and time."""

    def __init__(self) -> None:
        self.pool = Pool()
        first = self.pool.new_variables(2)
        self.x, self.y = self.pool.var(first), self.pool.var(first + 1)
        self.k = self.pool.par(0)

    def at(self, node: int, t: float) -> float:
        def variable(index: int) -> float:
            base = self.pool.integral_of.get(index)
            return CURVES[index][0](t) if base is None else CURVES[base][1](t)

        return float(values(self.pool, [node], {"var": variable, "par": lambda _: 1.3, "time": lambda _: t})[node])


def _slope(scene: Scene, node: int, h: float = 1e-5) -> float:
    """Five-point central difference: its error is about h^4, far below the tolerance."""
    f = [scene.at(node, T + k * h) for k in (-2, -1, 1, 2)]
    return (f[0] - 8 * f[1] + 8 * f[2] - f[3]) / (12 * h)


UNARY = ["sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "exp", "log", "sqrt", "fabs", "neg"]
BINARY = ["add", "sub", "mul", "div", "pow", "atan2", "min", "max"]


@pytest.mark.parametrize("op", UNARY)
def test_unary(op: str) -> None:
    scene = Scene()
    node = scene.pool.make(op, scene.x)
    assert scene.at(differentiate(scene.pool, node), T) == pytest.approx(_slope(scene, node), rel=1e-9)


@pytest.mark.parametrize("op", BINARY)
@pytest.mark.parametrize("operands", ["xy", "yx", "xk", "kx", "xt", "tx"])
def test_binary(op: str, operands: str) -> None:
    scene = Scene()
    pick = {"x": scene.x, "y": scene.y, "k": scene.k, "t": scene.pool.time}
    node = scene.pool.make(op, *(pick[c] for c in operands))
    assert scene.at(differentiate(scene.pool, node), T) == pytest.approx(_slope(scene, node), rel=1e-9, abs=1e-10)


@pytest.mark.parametrize("op", ["sign", "floor", "ceil"])
def test_steps_have_slope_zero(op: str) -> None:
    scene = Scene()
    assert differentiate(scene.pool, scene.pool.make(op, scene.x)) == scene.pool.zero


def test_branches_are_differentiated_one_by_one() -> None:
    scene = Scene()
    pool = scene.pool
    for relation in ("lt", "gt"):
        node = pool.where(pool.make(relation, scene.x, scene.y), pool.mul(scene.x, scene.y), pool.make("sin", scene.x))
        assert scene.at(differentiate(pool, node), T) == pytest.approx(_slope(scene, node), rel=1e-9)


def test_homotopy_is_differentiated_in_both_parts() -> None:
    scene = Scene()
    pool = scene.pool
    node = pool.make("homotopy", pool.mul(scene.x, scene.y), scene.x)
    slope = differentiate(pool, node)
    assert scene.at(slope, T) == pytest.approx(_slope(scene, node), rel=1e-9)
    assert pool.nodes[slope][2] == pool.var(pool.derivative(0))


def test_second_derivative() -> None:
    """d2/dt2 of x y = x'' y + 2 x' y' + x y''; the difference of the first derivative is the judge."""
    scene = Scene()
    pool = scene.pool
    first = differentiate(pool, pool.mul(pool.time, pool.make("sin", pool.mul(scene.k, pool.time))))
    assert scene.at(differentiate(pool, first), T) == pytest.approx(_slope(scene, first), rel=1e-8)


def test_parameters_and_constants_have_slope_zero() -> None:
    pool = Pool()
    for node in (pool.const(3.0), pool.par(0), pool.make("sin", pool.par(1)), pool.div(pool.one, pool.par(0))):
        assert differentiate(pool, node) == pool.zero
    assert differentiate(pool, pool.time) == pool.one


def test_rate_given_by_a_rule_is_used() -> None:
    """der(R) = R skew(w): the rule of the modeller replaces the derivative's own variable."""
    pool = Pool()
    x, w = pool.new_variables(1), pool.new_variables(1)
    pool.slope[x] = pool.mul(pool.const(2.0), pool.var(w))
    assert differentiate(pool, pool.neg(pool.var(x))) == pool.neg(pool.slope[x])
    assert x not in pool.derivative_of


def test_what_is_kept_between_events_has_no_slope() -> None:
    """Modelica 3.6, section 3.7.2: der of a discrete-time expression is zero."""
    pool = Pool()
    x = pool.var(pool.new_variables(1))
    held = pool.make("pre", x)
    for node in (pool.make("lt", x, pool.one), held, pool.make("not", held), pool.make("initial")):
        assert differentiate(pool, node) == pool.zero


def test_no_event_is_differentiated_through() -> None:
    pool = Pool()
    x = pool.var(pool.new_variables(1))
    slope = differentiate(pool, pool.make("noevent", pool.mul(x, x)))
    assert pool.nodes[slope][0] == "noevent"
    assert pool.variables_in(slope) == {0, pool.derivative(0)}


def test_shared_expressions_are_differentiated_once() -> None:
    """f_k = f_(k-1)^2: the tree has 2^40 leaves, the pool grows by a few nodes per level."""
    pool = Pool()
    node = pool.var(pool.new_variables(1))
    for _ in range(40):
        node = pool.mul(node, node)
    before = len(pool.nodes)
    differentiate(pool, node)
    assert len(pool.nodes) - before < 5 * 40
