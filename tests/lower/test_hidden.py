"""Constraints that only the numbers show, not the structure, are found and used; numbers that cancel are no pivots."""

from __future__ import annotations

import math

import numpy as np
import pytest

import acausal
from acausal import (
    AcausalError,
    Component,
    Equations,
    Real,
    as_expr,
    connect,
    der,
    fixed,
    guess,
    parameter,
    part,
    sin,
    structural,
    time,
    variable,
)
from acausal.analyse.aliases import reduce
from acausal.analyse.analyse import analyse
from acausal.analyse.blocks.solve import solve
from acausal.analyse.hidden import HiddenConstraint
from acausal.errors import StructureError
from acausal.flatten.pool import Pool
from acausal.library.electrical import Capacitor, Conductor, Ground, Resistor
from acausal.library.electrical import ConstantVoltage as Voltage
from acausal.numeric.evaluate import values
from acausal.numeric.samples import is_significant
from tests.expected import fails_with


class Bank(Component):
    """A source charges capacitors side by side through a resistor on each side: no pin of theirs is grounded."""

    n: int = structural(default=2)
    is_nonlinear: bool = structural(default=False)
    ground: Ground = Ground()
    source: Voltage = Voltage(V=10.0)
    before: Resistor = Resistor(R=1.0)
    after: Resistor = Resistor(R=1.0)
    capacitors: list[Capacitor] = part()
    current: Real = variable()

    def build(self) -> None:
        self.capacitors = [Capacitor(C=0.1 * (k + 1), v=guess(0.0)) for k in range(self.n)]

    def equations(self) -> Equations:
        yield connect(self.source.n, self.ground.p, self.after.n)
        yield connect(self.source.p, self.before.p)
        yield connect(self.before.n, *(c.p for c in self.capacitors))
        yield connect(self.after.p, *(c.n for c in self.capacitors))
        i = self.before.i / 1.0
        if self.is_nonlinear:
            # Something nonlinear in the same block, of no effect on the circuit.
            yield self.current**3 + self.current == self.before.v + 0 * i
        else:
            yield self.current == 0.0


@pytest.mark.parametrize("n", [2, 3, 5])
@pytest.mark.parametrize("formulation", ["torn", "dae"])
def test_capacitors_side_by_side(n: int, formulation: str) -> None:
    """One state; v = V (1 - exp(-t / (2 R C))) with the sum of the capacitances."""
    compiled = acausal.compile(Bank(n=n), formulation=formulation)
    assert len(compiled.states) == 1
    result = acausal.simulate(compiled, stop_time=1.0, tolerance=1e-9)
    total = 0.1 * sum(range(1, n + 1))
    expected = 10 * (1 - math.exp(-1.0 / (2 * total)))
    for k in range(n):
        assert result.final(f"capacitors[{k}].v") == pytest.approx(expected, rel=1e-7)


class Diode(Component):
    """Exponential conductance between two nodes, with two capacitors beside it."""

    a: Real = variable()
    b: Real = variable()
    u1: Real = variable(default=fixed(0.5))
    u2: Real = variable()
    i1: Real = variable()
    i2: Real = variable()
    i: Real = variable()

    def equations(self) -> Equations:
        yield self.u1 == self.a - self.b
        yield self.u2 == self.a - self.b
        yield der(self.u1) == self.i1
        yield der(self.u2) == self.i2
        yield self.i == acausal.exp(self.a - self.b) - 1
        yield self.i1 + self.i2 + self.i == 0.0
        yield self.a + self.b == acausal.sin(self.i)


def test_in_a_block_with_nonlinear_equations() -> None:
    """2 u' = 1 - exp(u): exp(-u) = 1 + (exp(-u0) - 1) exp(-t/2)."""
    result = acausal.simulate(Diode(), stop_time=1.0, tolerance=1e-10)
    expected = -math.log(1 + (math.exp(-0.5) - 1) * math.exp(-0.5))
    assert result.final("u1") == pytest.approx(expected, rel=1e-8)
    assert result.final("u2") == pytest.approx(expected, rel=1e-8)


class Scaled(Component):
    """The same with parameters for factors: k a - k b twice."""

    k: Real = parameter(default=3.0)
    a: Real = variable()
    b: Real = variable()
    x: Real = variable(default=fixed(1.0))
    y: Real = variable()
    drive: Real = variable()

    def equations(self) -> Equations:
        yield self.x == self.k * (self.a - self.b)
        yield self.y == self.k * (self.a - self.b)
        yield der(self.x) == self.drive - self.x
        yield der(self.y) == -self.drive - self.y
        yield self.a + self.b == self.drive


def test_with_parameters_as_factors() -> None:
    """x = y needs drive = 0: x = exp(-t)."""
    compiled = acausal.compile(Scaled())
    for k in (3.0, -0.5):
        result = acausal.simulate(compiled, stop_time=1.0, tolerance=1e-9, parameters={"k": k})
        assert result.final("y") == pytest.approx(math.exp(-1.0), rel=1e-7)
        assert result.final("drive") == pytest.approx(0.0, abs=1e-8)


class Contradicting(Component):
    """a + b is x and also y, but both are prescribed apart: nothing is hidden, the model is wrong."""

    a: Real = variable()
    b: Real = variable()
    x: Real = variable(default=fixed(0.0))
    y: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield self.a + self.b == self.x
        yield self.a + self.b == self.y
        yield der(self.x) == 1.0
        yield der(self.y) == 2.0


def test_a_wrong_model_keeps_its_first_message() -> None:
    with fails_with(StructureError, "AC204"):
        acausal.compile(Contradicting())


def test_the_stages_alone_say_what_is_hidden() -> None:
    """Who calls the stages one by one gets the message, and the equation that can take the place of another."""
    flat = acausal.flatten(Bank())
    with pytest.raises(HiddenConstraint) as caught:
        solve(analyse(reduce(flat)))
    (k, node), *_ = caught.value.equations.items()
    assert 0 <= k < len(flat.equations)
    names = {flat.scalar_name(v) for v in flat.pool.variables_in(node)}
    assert names == {"capacitors[0].v", "capacitors[1].v"}


def test_conductors_need_nothing_of_this() -> None:
    """Side by side they are one block with a solution."""

    class Pair(Component):
        ground: Ground = Ground()
        source: Voltage = Voltage(V=1.0)
        a: Conductor = Conductor(G=1.0)
        b: Conductor = Conductor(G=2.0)

        def equations(self) -> Equations:
            yield connect(self.source.n, self.ground.p, self.a.n, self.b.n)
            yield connect(self.source.p, self.a.p, self.b.p)

    assert acausal.simulate(Pair()).final("source.i") == pytest.approx(-3.0)


N = 4
Rows = tuple[tuple[float, ...], ...]


class Implicit(Component):
    """E x' = A x + (1, 2, 3, 4) with a singular matrix E, all entries literal numbers."""

    E: Rows = structural(default=())
    A: Rows = structural(default=())
    x: Real = variable(shape=N)

    def equations(self) -> Equations:
        for i in range(N):
            left, right = as_expr(0.0), as_expr(i + 1.0)
            for k in range(N):
                left = left + self.E[i][k] * der(self.x[k])
                right = right + self.A[i][k] * self.x[k]
            yield left == right


def degree(E: Rows, A: Rows) -> int:
    """Degree of det(s E - A), the number of modes; -1 for a singular pencil."""
    points = np.arange(1.0, N + 2)
    values = [round(float(np.linalg.det(s * np.array(E) - np.array(A)))) for s in points]
    found = np.polyfit(points, values, N)
    places = np.flatnonzero(np.abs(found) > 1e-4)
    return N - int(places[0]) if len(places) else -1


@pytest.mark.parametrize("seed", [*range(30), 40, 50, 78, 86, 89, 122, 124])
def test_states_are_as_many_as_modes(seed: int) -> None:
    random = np.random.default_rng(seed)
    rank = int(random.integers(1, N))
    singular = random.integers(-2, 3, (N, rank)) @ random.integers(-2, 3, (rank, N))
    E: Rows = tuple(tuple(float(v) for v in row) for row in singular)
    kept = random.integers(-3, 4, (N, N)) * (random.random((N, N)) < 0.7)
    A: Rows = tuple(tuple(float(v) for v in row) for row in kept)
    modes = degree(E, A)
    if modes < 0:
        with pytest.raises(StructureError):
            acausal.compile(Implicit(E=E, A=A))
    else:
        assert len(acausal.compile(Implicit(E=E, A=A)).states) == modes


THIRD = 1.0 / 3.0


def certain(pool: Pool, node: int, parameters: list[float]) -> bool:
    found = values(pool, [node], {"par": parameters.__getitem__, "time": lambda _: 0.0})
    return bool(is_significant(pool, node, found, {}))


@pytest.mark.parametrize(
    ("a", "b", "expected"),
    [
        (2.0 * THIRD, 0.5, True),  # the sum of two thirds and a half: a number
        (2.0 * THIRD, 2.0 * THIRD, False),  # 5.6e-17
        (2.0 * THIRD, 2.0 * THIRD * (1.0 - 1e-14), False),  # as inexact as the parameters themselves
        (2.0 * THIRD, 2.0 * THIRD * (1.0 - 1e-6), True),  # small, and right to ten digits
        (1e-30, 0.0, True),  # small numbers are numbers
    ],
)
def test_sums(a: float, b: float, expected: bool) -> None:
    pool = Pool()
    assert certain(pool, pool.sub(pool.par(0), pool.par(1)), [a, b]) is expected


def test_cancelled_terms_stay_uncertain_in_what_is_made_of_them() -> None:
    """1/3 + 1/3 - 2/3 divided by 1e-17 is of size 1, and as wrong."""
    pool = Pool()
    third = pool.div(pool.one, pool.par(0))
    noise = pool.sub(pool.add(third, third), pool.div(pool.par(1), pool.par(0)))
    assert not certain(pool, pool.div(noise, pool.par(2)), [3.0, 2.0, 1e-17])
    assert not certain(pool, pool.make("sin", noise), [3.0, 2.0])
    assert certain(pool, pool.make("cos", noise), [3.0, 2.0])


class Cancelling(Component):
    """(a/c + a/c - b/c) y + x == 1 and the same in z: with 2a = b it says x == 1, and y stays open."""

    a: Real = parameter(default=1.0)
    b: Real = parameter(default=2.0)
    c: Real = parameter(default=3.0)
    is_open: bool = structural(default=True)
    x: Real = variable(default=fixed(1.0))
    y: Real = variable()
    z: Real = variable()

    def equations(self) -> Equations:
        factor = self.a / self.c + self.a / self.c - self.b / self.c
        yield der(self.x) == -self.x
        yield factor * self.y + self.z == 1.0
        yield self.z - self.x == (0.0 if self.is_open else self.y - 1.0)


def test_no_division_by_rounding_errors() -> None:
    """y = (1 - x)/6e-17 would be a solution to the computer."""
    with pytest.raises(AcausalError, match="AC2"):
        acausal.compile(Cancelling())
    result = acausal.simulate(Cancelling(is_open=False), stop_time=1.0)
    assert result.final("z") == pytest.approx(1.0)


class TwiceDifferentiated(Component):
    a: Real = variable()
    y: Real = variable()
    z: Real = variable()

    def equations(self) -> Equations:
        yield self.a == der(der(self.y))
        yield self.y == self.z
        yield self.z == 0.5 + sin(3 * time)


def test_the_second_derivative_of_an_alias_of_a_function_of_time() -> None:
    result = acausal.simulate(TwiceDifferentiated(), stop_time=1.0)
    assert result["a"] == pytest.approx(-9.0 * np.sin(3.0 * result.time), abs=1e-12)
