"""Random circuits of resistors, inductors, and capacitors with linear and nonlinear charges: every law, by itself.

Loops of capacitors and sources, and cuts of inductors, constrain what is integrated; parallel elements say so in sums
only. What a run records is judged by Kirchhoff's laws at every node and by each element's law in its integral form,
with Simpson's rule over the recorded points: nothing of the compiler is used.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import cumulative_simpson, solve_ivp

import acausal
from acausal import (
    Component,
    Equations,
    Real,
    connect,
    der,
    exp,
    fixed,
    guess,
    parameter,
    part,
    structural,
    tanh,
    variable,
)
from acausal.library.electrical import Capacitor, Ground, Inductor, Pin, Resistor, SineVoltage
from tests.marks import seeds

Element = tuple[str, int, int, float]
Netlist = tuple[Element, ...]
Vector = NDArray[np.float64]


class ChargeCapacitor(Component):
    """Two charges of opposite sign, as charge-oriented simulators of circuits write it."""

    p: Pin = Pin()
    n: Pin = Pin()
    q_p: Real = variable(unit="C")
    q_n: Real = variable(unit="C")
    C: Real = parameter(unit="F")
    a: Real = parameter(default=0.02, unit="1/V2")

    def equations(self) -> Equations:
        v = self.p.v - self.n.v
        yield self.q_p == self.C * v * (1 + self.a * v * v)
        yield self.q_n == -(self.C * v * (1 + self.a * v * v))
        yield der(self.q_p) == self.p.i
        yield der(self.q_n) == self.n.i


MADE: dict[str, Callable[[float], Component]] = {
    "R": lambda x: Resistor(R=x),
    "L": lambda x: Inductor(L=x, i=fixed(0.0)),
    "C": lambda x: Capacitor(C=x, v=fixed(0.0)),
    "Q": lambda x: ChargeCapacitor(C=x, q_p=fixed(0.0)),
    "E": lambda x: Charge(C=x, saturates=False),
    "S": lambda x: Charge(C=x, saturates=True),
    "V": lambda x: SineVoltage(V=x, f=40.0),
}
RANGE = {"R": (5.0, 50.0), "L": (0.01, 0.1), "V": (2.0, 6.0)} | dict.fromkeys("CQES", (1e-4, 1e-3))


class Charge(Component):
    """One charge, exponential or saturating, of the voltage between two pins."""

    p: Pin = Pin()
    n: Pin = Pin()
    q: Real = variable(default=fixed(0.0), unit="C")
    C: Real = parameter(unit="F")
    size: Real = parameter(default=4.0, unit="V")
    saturates: bool = structural()

    def equations(self) -> Equations:
        if self.saturates:
            curved = self.C * self.size * tanh((self.n.v - self.p.v) / self.size)
            yield self.q == 0.2 * self.C * self.p.v - 0.2 * self.C * self.n.v - curved
        else:
            yield self.q == self.C * self.size * (exp((self.p.v - self.n.v) / self.size) - 1)
        yield der(self.q) == self.p.i
        yield self.p.i + self.n.i == 0


class Circuit(Component):
    elements: list[Component] = part()
    ground: Ground = Ground()
    netlist: Netlist = structural()

    def build(self) -> None:
        self.elements = [MADE[kind](x) for kind, _, _, x in self.netlist]

    def equations(self) -> Equations:
        nodes: dict[int, list[Pin]] = {0: [self.ground.p]}
        elements: list[Any] = list(self.elements)
        for e, (_, a, b, _) in zip(elements, self.netlist, strict=True):
            nodes.setdefault(a, []).append(e.p)
            nodes.setdefault(b, []).append(e.n)
        for pins in nodes.values():
            if len(pins) > 1:
                yield connect(*pins)


def random_netlist(seed: int) -> Netlist:
    """One source, a tree over the nodes, and chords that are often parallel to other elements."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(3, 6))
    ends = [(0, 1), *((int(rng.integers(0, k)), k) for k in range(2, count))]
    ends += [tuple(rng.choice(count, 2, replace=False).tolist()) for _ in range(int(rng.integers(1, 3)))]
    ends += [ends[int(k)] for k in rng.integers(1, len(ends), int(rng.integers(1, 4)))]
    kinds = ["V", *rng.choice(list("RRLCQ"), len(ends) - 1).tolist()]
    return tuple((k, a, b, float(rng.uniform(*RANGE[k]))) for k, (a, b) in zip(kinds, ends, strict=True))


def floating_netlist(seed: int) -> Netlist:
    """Different nonlinear charges in parallel and in loops, between nodes that only resistors join to a source."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(5, 7))
    ends = [(0, 1), (1, 2), (0, 3), (2, 3), *((int(rng.integers(2, k)), k) for k in range(4, count))]
    kinds = ["V", "R", "R", "R", *rng.choice(list("QES"), len(ends) - 4).tolist()]
    for _ in range(int(rng.integers(2, 5))):
        ends.append(tuple(rng.choice(np.arange(2, count), 2, replace=False).tolist()))
        kinds.append(str(rng.choice(list("RQES"))))
    return tuple((k, a, b, float(rng.uniform(*RANGE[k]))) for k, (a, b) in zip(kinds, ends, strict=True))


def law(kind: str, x: float, t: Vector, v: Vector, i: Vector) -> tuple[Vector, Vector]:
    """The two sides of an element's law in its integral form, shape (rows,) each."""
    if kind == "R":
        return v, x * i
    if kind == "V":
        return v, x * np.sin(80.0 * np.pi * t)
    if kind == "L":
        return x * (i - i[0]), cumulative_simpson(v, x=t, initial=0.0)
    if kind in "ES":
        charge = x * (0.2 * v + 4.0 * np.tanh(v / 4.0)) if kind == "S" else x * 4.0 * np.expm1(v / 4.0)
        return charge - charge[0], cumulative_simpson(i, x=t, initial=0.0)
    charge = x * v * (1.0 + (0.02 * v**2 if kind == "Q" else 0.0))
    return charge - charge[0], cumulative_simpson(i, x=t, initial=0.0)


def violations(netlist: Netlist) -> dict[str, float]:
    """The largest violation of each law, by the range of its quantity."""
    result = acausal.simulate(Circuit(netlist=netlist), stop_time=0.02, output_interval=1e-5, tolerance=1e-8)
    t, rows = np.unique(result.time, return_index=True)  # where a kink is passed there are two rows, which are the same
    currents: dict[int, list[tuple[float, np.ndarray]]] = {}
    found = {}
    for k, (kind, a, b, x) in enumerate(netlist):
        here = f"elements[{k}]"
        i, v = result[f"{here}.p.i"][rows], (result[f"{here}.p.v"] - result[f"{here}.n.v"])[rows]
        currents.setdefault(a, []).append((1.0, i))
        currents.setdefault(b, []).append((-1.0, i))
        left, right = law(kind, x, t, v, i)
        found[f"{kind}{k}"] = float(np.max(np.abs(left - right)) / (np.max(np.abs(right)) + 1e-6))
    for node, flows in currents.items():
        if node:
            size = max(float(np.max(np.abs(i))) for _, i in flows)
            found[f"node {node}"] = float(np.max(np.abs(sum(s * i for s, i in flows)))) / (size + 1e-6)
    return found


# C || R || C between two inductors; nonlinear capacitors beside linear ones; a loop of them with the source
FIXED: dict[str, Netlist] = {
    "parallel between inductors": (
        ("V", 1, 0, 4.0), ("L", 1, 2, 0.03), ("C", 2, 3, 4e-4), ("R", 2, 3, 25.0), ("C", 2, 3, 7e-4),
        ("L", 3, 4, 0.02), ("R", 4, 0, 12.0),
    ),
    "a nonlinear one between two resistors": (("V", 1, 0, 4.0), ("R", 1, 2, 15.0), ("Q", 2, 3, 5e-4), ("R", 3, 0, 9.0)),
    "nonlinear beside linear": (
        ("V", 1, 0, 3.0), ("R", 1, 2, 15.0), ("Q", 2, 3, 5e-4), ("C", 2, 3, 3e-4), ("R", 3, 0, 9.0), ("L", 3, 0, 0.05),
    ),
    "a loop with the source": (("V", 1, 0, 3.0), ("C", 1, 2, 5e-4), ("Q", 2, 0, 3e-4), ("R", 2, 0, 20.0)),
}  # fmt: skip


@pytest.mark.parametrize("name", FIXED)
def test_laws_of_circuits_whose_constraints_show_in_sums(name: str) -> None:
    found = violations(FIXED[name])
    assert max(found.values()) < 2e-5, found


@pytest.mark.slow
@pytest.mark.parametrize("drawn", [random_netlist, floating_netlist])
def test_laws_of_random_circuits(drawn: Callable[[int], Netlist]) -> None:
    """A third of the floating charges hide constraints that no sum of their equations shows."""
    assert not _wrong([drawn(seed) for seed in seeds("0:30")[0]])


def _wrong(netlists: list[Netlist]) -> dict[int, dict[str, float]]:
    found = {k: violations(netlist) for k, netlist in enumerate(netlists)}
    return {k: laws for k, laws in found.items() if max(laws.values()) > 2e-5}


class Junction(Component):
    """A charge that grows with a power of its voltage; `named` says whether the voltage has a name."""

    p: Pin = Pin()
    n: Pin = Pin()
    q_p: Real = variable(default=guess(0.0), unit="C")
    q_n: Real = variable(unit="C")
    v: Real = variable(unit="V")
    C: Real = parameter(unit="F")
    a: Real = parameter(unit="1/V2")
    named: bool = structural(default=True)

    def equations(self) -> Equations:
        v = self.v if self.named else self.p.v - self.n.v
        yield self.v == self.p.v - self.n.v
        yield self.q_p == self.C * v * (1 + self.a * v * v)
        yield self.q_n == -(self.C * v * (1 + self.a * v * v))
        yield der(self.q_p) == self.p.i
        yield der(self.q_n) == self.n.i


class Parallel(Component):
    """Two different nonlinear charges side by side between two resistors: one voltage for both."""

    named: bool = structural(default=True)
    V: SineVoltage = SineVoltage(V=5.0, f=40.0)
    R: list[Resistor] = part()
    Q: list[Component] = part()
    ground: Ground = Ground()

    def build(self) -> None:
        self.R = [Resistor(R=10.0), Resistor(R=30.0)]
        first = Junction(C=3e-4, a=0.05, named=self.named, v=fixed(0.0))
        self.Q = [first, Junction(C=2e-4, a=0.3) if self.named else ChargeCapacitor(C=2e-4, a=0.3)]

    def equations(self) -> Equations:
        q: list[Any] = list(self.Q)
        yield connect(self.V.n, self.R[1].n, self.ground.p)
        yield connect(self.V.p, self.R[0].p)
        yield connect(self.R[0].n, q[0].p, q[1].p)
        yield connect(self.R[1].p, q[0].n, q[1].n)


@pytest.mark.parametrize("named", [True, False])
def test_different_charges_in_parallel(named: bool) -> None:
    """By hand: the charges add up, q'(v) v' = (V - v) / 40 Ohm, with q = 5e-4 v + 7.5e-5 v^3.

    Without a name for their voltage no sum of equations shows that one charge follows from the other.
    """
    found = acausal.simulate(Parallel(named=named), stop_time=0.03, tolerance=1e-9)

    def rate(t: float, v: Vector) -> Vector:
        return np.asarray((5.0 * np.sin(80.0 * np.pi * t) - v) / 40.0 / (5e-4 + 3 * 7.5e-5 * v * v))

    expected = solve_ivp(rate, (0.0, 0.03), [0.0], rtol=1e-10, atol=1e-12).y[0, -1]
    assert found.final("Q[0].v") == pytest.approx(expected, abs=1e-7)
    assert found.final("Q[1].q_p") == pytest.approx(2e-4 * expected * (1 + 0.3 * expected**2), rel=1e-6)


def test_equations_of_a_named_combination_are_shown_and_linearised() -> None:
    """At rest v' = -v / 40 Ohm / 5e-4 F: one eigenvalue of -50 1/s, and a state that is named by what it is."""
    compiled = acausal.compile(Parallel(named=False))
    assert compiled.states == ("(R[0].n.v - R[1].v)",)
    assert acausal.linearize(compiled).A == pytest.approx(np.array([[-50.0]]))


@pytest.mark.parametrize("how", [{"formulation": "dae"}, {"freeze": ["R[0].R", "Q[0].C"]}, {"outputs": ["Q[1].q_p"]}])
def test_a_combination_lives_with_other_forms_of_the_model(how: dict[str, Any]) -> None:
    made = acausal.compile(Parallel(named=False), **how)
    expected = acausal.simulate(Parallel(), stop_time=0.01, tolerance=1e-9).final("Q[1].q_p")
    assert acausal.simulate(made, stop_time=0.01, tolerance=1e-9).final("Q[1].q_p") == pytest.approx(expected, rel=1e-6)


def test_other_values_take_the_combination_from_the_cache() -> None:
    acausal.compile(Parallel(named=False))
    values = {"Q[0].C": 5e-4, "Q[1].a": 0.1}
    again = acausal.compile(Parallel(named=False), parameters=values)
    assert "recall" in again.timings
    anew = acausal.compile(Parallel(named=False), parameters=values, cache=False)
    ends = [acausal.simulate(c, stop_time=0.01, tolerance=1e-9).final("Q[0].q_p") for c in (again, anew)]
    assert ends[0] == pytest.approx(ends[1], rel=1e-9)


@pytest.mark.slow
def test_a_ladder_with_more_hidden_constraints_than_rounds() -> None:
    """24 capacitors beside nonlinear ones, none grounded: each hides a constraint, all are found in three rounds."""
    net: list[Element] = [("V", 1, 0, 4.0), ("R", 1, 2, 10.0)]
    for node in range(2, 26):
        net += [("C", node, node + 1, 4e-4), ("Q", node, node + 1, 7e-4), ("R", node + 1, 0, 20.0 + node)]
    assert not _wrong([tuple(net)])
