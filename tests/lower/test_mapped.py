"""Equations by patterns give what the equations of every instance give, and so do their derivatives."""

from __future__ import annotations

import cProfile
import gc
import pstats
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import event, given
from hypothesis import strategies as st
from numpy.typing import NDArray

import acausal
from acausal import (
    Component,
    Equations,
    External,
    Real,
    connect,
    der,
    fixed,
    parameter,
    part,
    structural,
    time,
    variable,
    where,
)
from acausal.analyse.blocks.elimination import distances
from acausal.collector import collector_paused
from acausal.library.electrical import (
    Capacitor,
    Conductor,
    ConstantVoltage,
    Ground,
    Inductor,
    Resistor,
)
from acausal.lower.columns import mapped as lowering
from acausal.lower.columns import patterns as search
from acausal.lower.columns.mapped import Mapped
from acausal.lower.compiled import CompiledModel
from acausal.models.mass_chain import MassSpringDamperChain
from acausal.models.pendulum_chain import PendulumChain
from acausal.models.rc_ladder import RCLadder
from acausal.simulate.equations.problem import Problem
from tests.lower.mechanisms import Balls, Tree

LARGE = 300
"""Sections from which a ladder is lowered by patterns."""


def anyhow(patch: pytest.MonkeyPatch) -> None:
    """Patterns from two of a kind on, whether it pays or not."""
    patch.setattr(search, "FEW", 2)
    patch.setattr(lowering, "LEAST", 0)
    patch.setattr(lowering, "MOST_COLOURS", 1000)
    patch.setattr(lowering, "pays", lambda found: True)


def of(compiled: CompiledModel, p: Any = None) -> Mapped:
    """The model's equations by patterns, which there must be."""
    values = np.array(compiled.parameter_values) if p is None else p
    found = compiled.mapped(tuple(np.flatnonzero(values == 0.0).tolist()))
    assert found is not None
    return found


def compare(compiled: CompiledModel, p: Any = None, points: int = 3) -> None:
    """Both forms of the scaled equations and all four Jacobians at random points."""
    p = np.array(compiled.parameter_values) if p is None else p
    form, rng = of(compiled, p), np.random.default_rng(1)
    problem = Problem(compiled, p, np.zeros(0))
    flat_t, flat_x, flat_z, flat_p, ode, alg = problem.scaled.scaled
    none = ca.SX(0, 1)
    flat = ca.Function("flat", [flat_t, flat_x, flat_z, flat_p, ca.SX(0, 1)], [ode, alg, none, none])
    columns = form.dae(problem.scale_x, problem.scale_z, np.array(form.constants(p, [])).ravel())
    derivatives = [f.jacobian() for f in (flat, columns)]
    n, nz = flat.numel_in(1), flat.numel_in(2)
    for _ in range(points):
        numbers = problem.numbers(rng.integers(0, 2, compiled.n_modes).astype(float), rng.normal(size=n + 1), 0.25)
        at = [0.7, rng.normal(size=n), rng.normal(size=nz), numbers[: flat.numel_in(3)], []]
        for a, b in zip(list(flat(*at)), list(columns(*at)), strict=True):
            np.testing.assert_allclose(np.array(b), np.array(a), rtol=1e-13, atol=1e-13)
        slopes: list[Any] = [d(*at, *([0] * 4)) for d in derivatives]
        for k in (1, 2, 6, 7):  # d ode and d alg by x and z
            one, other = (np.array(ca.densify(s[k])) for s in slopes)
            np.testing.assert_allclose(other, one, rtol=1e-12, atol=1e-12)


class Cell(Component):
    """A bistable cell: a cubic, a kink that is no event, and a term that acts while the drive is on."""

    a: Real = parameter(default=1.0, unit="")
    b: Real = parameter(default=0.0, unit="")
    x: Real = variable(default=fixed(0.1), unit="")
    push: Real = variable(unit="")

    def equations(self) -> Equations:
        yield self.push == where(time < 0.5, self.a, -self.a) + self.b * self.x
        yield der(self.x) == self.push + self.x - self.x**3 / (1.0 + acausal.maximum(self.x, 0.2))


class Cells(Component):
    """Cells, a state that follows their mean, ever slower, and a rate that is a number all cells have in them."""

    n: int = structural(default=400)
    cells: list[Cell] = part()
    mean: Real = variable(default=fixed(0.0), unit="")
    age: Real = variable(default=fixed(0.0), unit="")

    def build(self) -> None:
        self.cells = [Cell(a=0.5 + 0.001 * i) for i in range(self.n)]

    def equations(self) -> Equations:
        yield der(self.age) == 1.0
        mean = sum((c.x for c in self.cells[1:]), self.cells[0].x) / self.n
        yield der(self.mean) == (mean - self.mean) / (1.0 + self.age)


def test_ladder_is_a_handful_of_operations() -> None:
    compiled = acausal.compile(RCLadder(n=LARGE))
    form = of(compiled)
    assert form.operations < 60
    assert form.operations == of(acausal.compile(RCLadder(n=2 * LARGE))).operations
    compare(compiled)


def test_chain_with_and_without_damping() -> None:
    compiled = acausal.compile(MassSpringDamperChain(n=LARGE))
    compare(compiled)
    p = np.array(compiled.parameter_values)
    p[compiled.parameters.index("d")] = 0.0
    assert of(compiled, p).operations < of(compiled).operations
    compare(compiled, p)


def test_nonlinear_cells_with_modes_and_a_sum_over_all() -> None:
    compiled = acausal.compile(Cells())
    assert compiled.n_modes == 1
    compare(compiled)


def test_what_is_not_repeated_stays_as_it_is() -> None:
    assert acausal.compile(PendulumChain(n=8)).mapped() is None
    assert acausal.compile(RCLadder(n=20)).mapped() is None


@pytest.mark.parametrize("solver", ["idas", "cvodes", "rosenbrock", "erk"])
def test_solvers_take_the_same_steps(solver: str, monkeypatch: pytest.MonkeyPatch) -> None:
    compiled = acausal.compile(RCLadder(n=LARGE), cache=False)
    every = replace(compiled)  # what is kept of a model belongs to the object
    how: dict[str, Any] = {"solver": solver, "stop_time": 0.2, "native": False}
    assert compiled.mapped() is not None
    columns = acausal.simulate(compiled, **how)
    monkeypatch.setattr(CompiledModel, "mapped", lambda self, zeros=(): None)
    flat = acausal.simulate(every, **how)
    assert columns.stats.get("steps") == flat.stats.get("steps")
    for name in ("capacitors[0].v", f"capacitors[{LARGE - 1}].v", "source.i"):
        np.testing.assert_allclose(columns[name], flat[name], rtol=1e-9, atol=1e-12)


Plan = tuple[tuple[str, int, int, float], ...]
NODES = 4
SIZES = st.sampled_from([0.5, 1.0, 2.0])


@st.composite
def plans(draw: st.DrawFn) -> Plan:
    """Parts that join all nodes, and some more."""
    tree = [(draw(st.sampled_from("RGCL")), k, draw(st.integers(0, k - 1)), draw(SIZES)) for k in range(1, NODES)]
    node = st.integers(0, NODES - 1)
    more = draw(st.lists(st.tuples(st.sampled_from("RRGCCLV"), node, node, SIZES), max_size=5))
    return tuple(p for p in (*tree, *more) if p[1] != p[2])


class Copies(Component):
    """Copies of one random circuit, each with a resistor to the next copy."""

    plan: Plan = structural()
    copies: int = structural(default=4)
    parts: list[Component] = part()
    ground: Ground = Ground()

    def build(self) -> None:
        kinds: dict[str, Any] = {
            "R": lambda v: Resistor(R=v),
            "G": lambda v: Conductor(G=v),
            "C": lambda v: Capacitor(C=v),
            "L": lambda v: Inductor(L=v),
            "V": lambda v: ConstantVoltage(V=v),
        }
        self.parts = [kinds[kind](size) for _ in range(self.copies) for kind, _, _, size in self.plan]
        self.parts += [Resistor(R=1.0) for _ in range(self.copies)]

    def equations(self) -> Equations:
        pins: dict[tuple[int, int], list[Any]] = {}
        for k in range(self.copies):
            for i, (_, a, b, _) in enumerate(self.plan):
                component: Any = self.parts[k * len(self.plan) + i]
                pins.setdefault((k, a), []).append(component.p)
                pins.setdefault((k, b), []).append(component.n)
            link: Any = self.parts[self.copies * len(self.plan) + k]
            pins.setdefault((k, 0), []).append(link.p)
            pins.setdefault(((k + 1) % self.copies, 1), []).append(link.n)
        for (_, node), joined in pins.items():
            if node == NODES - 1:
                yield connect(self.ground.p, *joined)
            elif len(joined) > 1:
                yield connect(*joined)


@given(plans(), st.sets(st.integers(0, 40), max_size=4))
def test_random_circuits(plan: Plan, zeros: set[int]) -> None:
    """Conductances of zero are left out, whichever they are."""
    with pytest.MonkeyPatch.context() as patch:
        anyhow(patch)
        try:
            compiled = acausal.compile(Copies(plan=plan), cache=False)
        except acausal.AcausalError as error:
            event(f"refused: {error.code}")
            return
        if not compiled.states:
            event("no states")
            return
        p = np.array(compiled.parameter_values)
        p[[k for k in zeros if k < len(p) and compiled.parameters[k].endswith(".G")]] = 0.0
        zero = tuple(np.flatnonzero(p == 0.0).tolist())
        if compiled.mapped(zero) is None:
            event("divided by zero")
            return
        event("compared")
        compare(compiled, p, points=1)


def _cubic() -> Any:
    u = ca.SX.sym("u")
    return ca.Function("cubic", [u], [u**3], {"never_inline": True})


CUBIC = External("cubic", _cubic, inputs=((),), outputs=((),))


class Decay(Component):
    x: Real = variable()
    k: Real = parameter(default=1.0)

    def equations(self) -> Equations:
        yield der(self.x) == -self.k * CUBIC(self.x) + 0 * (self.x * 1.5 + self.k) * self.x


class Row(Component):
    parts: list[Decay] = part()

    def build(self) -> None:
        self.parts = [Decay(x=fixed(1.0), k=0.5 + 0.01 * k) for k in range(260)]


@pytest.mark.parametrize("solver", ["idas", "rosenbrock"])
def test_each_follows_its_own_closed_form(solver: str) -> None:
    """x' = -k x**3 from 1: x = (1 + 2 k t)**(-1/2)."""
    result = acausal.simulate(Row(), stop_time=1.0, solver=solver, tolerance=1e-8, native=False)
    found = [result.final(f"parts[{k}].x") for k in range(260)]
    assert found == pytest.approx(1.0 / np.sqrt(1.0 + 2.0 * (0.5 + 0.01 * np.arange(260))), abs=1e-6)


def calls(n: int) -> int:
    gc.collect()  # what tests before have left would be finalized in between, by calls that count
    profile = cProfile.Profile()
    profile.enable()
    acausal.compile(RCLadder(n=n), cache=False)
    profile.disable()
    return int(pstats.Stats(profile).total_calls)  # type: ignore[attr-defined]


@pytest.mark.slow
def test_calls_grow_with_the_model() -> None:
    """Twice as many sections more, of ten equations each, take twice as many calls more, to the power of 1.05."""
    calls(180)  # what is made and imported once
    # above a hundred equal parts, where patterns begin, and 500 equations to match, where SciPy does
    few, some, many = (calls(n) for n in (180, 300, 540))
    assert (many - some) / (some - few) < 2.0**1.05
    assert (many - some) / 240 < 3700  # 3520 when this was written, 3970 before


@pytest.fixture
def frozen_again() -> Iterator[None]:
    """Freeze again what `conftest.py` has frozen; otherwise every later collection of a session would traverse it."""
    yield
    gc.freeze()


@pytest.mark.usefixtures("frozen_again")
def test_what_was_made_is_old() -> None:
    """A hundred thousand lists made in a pause are in the oldest generation behind it, without a collection."""
    gc.unfreeze()  # nothing made is old where a user has frozen, as conftest.py has
    runs = sum(s["collections"] for s in gc.get_stats())
    with collector_paused():
        with collector_paused():
            made = [[k] for k in range(200_000)]
        assert not gc.isenabled()
    assert gc.isenabled()
    assert gc.get_count()[0] < len(made) / 2
    old = {id(x) for x in gc.get_objects(generation=2)}
    assert all(id(x) in old for x in made[::1000])
    assert sum(s["collections"] for s in gc.get_stats()) <= runs + 3  # the walk for this assertion itself may be one


@pytest.mark.usefixtures("frozen_again")
def test_pause_leaves_what_the_user_froze() -> None:
    """`gc.freeze` is the user's: nothing is thawed."""
    gc.freeze()
    try:
        frozen = gc.get_freeze_count()
        with collector_paused():
            made = [[k] for k in range(200_000)]
        assert gc.get_freeze_count() >= frozen - 1000
        assert made
    finally:
        gc.unfreeze()


Vector = NDArray[np.float64]


def operations(compiled: Any) -> int:
    """Operations of the right-hand side with parameters as numbers."""
    t, x = ca.SX.sym("t"), ca.SX.sym("x", len(compiled.states))
    ode, _ = compiled.rhs(t, x, [], [], compiled.parameter_values, [])
    return int(ca.Function("f", [t, x], [ode]).n_instructions())


@pytest.mark.slow
@pytest.mark.parametrize(
    "model",
    [
        PendulumChain,
        lambda n: Tree(n=n),
    ],
    ids=["chain", "arms"],
)
def test_operations_per_body_do_not_grow(model: Any) -> None:
    """The articulated-body algorithm costs the same for every body (Featherstone 2008, table 10.1).

    What is next to the ground costs less, so that the share of each still grows a little: from 16 bodies to 48, where a
    mass matrix solved densely would cost nine times as much per body, and Markowitz's order twice as much.
    """
    few, many = (acausal.compile(model(n=n), cache=False) for n in (16, 48))
    assert few.algebraic == many.algebraic == ()
    assert operations(many) / 48 < 1.3 * operations(few) / 16


def rates(compiled: Any, x: Vector) -> Vector:
    """Rates of the states; algebraic variables, which are linear here, by one dense Newton step."""
    nz = len(compiled.algebraic)
    z = ca.SX.sym("z", nz)
    p = compiled.parameter_values
    rhs = ca.Function("f", [z], list(compiled.rhs(0.0, x, z, [], p, [])))
    if nz:
        jacobian = ca.Function("J", [z], [ca.jacobian(compiled.rhs(0.0, x, z, [], p, [])[1], z)])
        solved = np.zeros(nz)
        for _ in range(2):  # once more, against rounding
            solved = solved - np.linalg.solve(np.array(jacobian(solved)), np.array(rhs(solved)[1]).ravel())
        return np.array(rhs(solved)[0]).ravel()
    return np.array(rhs(np.zeros(0))[0]).ravel()


@pytest.mark.parametrize(
    "model",
    [Tree(n=9, springs=2), Tree(n=9, arms=1), Tree(n=12, arms=3), Balls(n=3)],
    ids=["tree with springs", "chain", "three arms", "ball joints"],
)
def test_accelerations_are_those_of_the_whole_system(model: Component) -> None:
    """Against the same equations with no block solved, as one dense linear system."""
    solved = acausal.compile(model, cache=False)
    whole = acausal.compile(model, formulation="dae", cache=False)
    assert solved.algebraic == ()
    assert solved.states == whole.states
    assert len(whole.algebraic) > 20
    random = np.random.default_rng(4)
    for _ in range(3):
        x = random.standard_normal(len(solved.states))
        expected = rates(whole, x)
        np.testing.assert_allclose(rates(solved, x), expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


def test_links_on_ball_joints_keep_their_energy() -> None:
    """Released at rest from the horizontal: as much kinetic energy as height lost, by links of 1 kg and 0.5 m."""
    n = 3
    run = acausal.simulate(Balls(n=n), stop_time=1.0, tolerance=1e-9)
    energy = 0.0
    for k in range(n):
        v = np.array([run[f"links[{k}].v_0[{i}]"] for i in range(3)])
        w = np.array([run[f"links[{k}].w_a[{i}]"] for i in range(3)])
        R = np.array([[run[f"links[{k}].frame_a.R[{i},{j}]"] for j in range(3)] for i in range(3)])
        arm = 0.25 * R[:, 0]
        v = v + np.einsum("ij...,j...->i...", R, 0.25 * np.array([0.0 * w[0], w[2], -w[1]]))
        height = run[f"links[{k}].r_0[1]"] + arm[1]
        spin = 0.01 * w[0] ** 2 + 0.02 * w[1] ** 2 + 0.02 * w[2] ** 2
        energy = energy + 0.5 * (v**2).sum(axis=0) + 0.5 * spin + 9.80665 * height
    assert np.abs(energy).max() < 1e-5


def test_distances_are_those_of_the_graph() -> None:
    """Rows 0-1-2 in a line by variables 5 and 6, and row 3 apart."""
    found = distances([{5}, {5, 6}, {6, 7}, {8}], 0)
    assert found.rows == (0, 2, 4, 0)
    assert found.variables == {5: 1, 6: 3, 7: 5, 8: 0}
    assert found.furthest == 2
    assert found.out(1, 6) == 2
