"""Impacts of bodies that constraints bind, against Lagrange's equations integrated over the instant.

M (v+ - v-) = J^T p + b P and J v+ = 0 are solved here with the masses and the geometry at the instant; the models only
state forces. Sources: F. Pfeiffer, C. Glocker, Multibody Dynamics with Unilateral Contacts, 1996, chapter 8; for the
bar, the discs and the chain the closed forms of any textbook.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import acausal
from acausal import (
    Component,
    Equations,
    Real,
    cos,
    der,
    discrete,
    fixed,
    guess,
    integer,
    parameter,
    pre,
    reset,
    sample,
    sin,
    sqrt,
    structural,
    variable,
    when,
    where,
)
from acausal.errors import AcausalError
from acausal.simulate.events.resets.balance import reciprocity
from tests.expected import fails_with
from tests.stepping import walk

Vector = NDArray[np.float64]
SOLVERS = ["idas", "rosenbrock", "cvodes", "erk"]


def jump(run: Any, names: Sequence[str], number: int = 0) -> tuple[Vector, Vector]:
    """Values before and after the event of this number."""
    k = int(np.flatnonzero(np.diff(run.time) == 0.0)[number])
    return np.array([run[n][k] for n in names]), np.array([run[n][k + 1] for n in names])


def balance(masses: Sequence[float], constraints: Any, normal: Sequence[float], v: Vector, after: float) -> Vector:
    """Velocities behind an impulse along `normal` that makes `normal @ v` what it is `after`; J is `constraints`."""
    n, jac = len(masses), np.atleast_2d(np.array([*np.atleast_2d(constraints), normal], dtype=float))
    rows = len(jac)
    matrix = np.block([[np.diag(masses), -jac.T], [jac, np.zeros((rows, rows))]])
    right = np.concatenate([np.array(masses) * v, np.zeros(rows - 1), [after]])
    return np.linalg.solve(matrix, right)[:n]


class Cart(Component):
    """A cart with a pendulum in x and y on a rod of 1 m; the cart bounces off a wall."""

    M: Real = parameter(default=2.0)
    m: Real = parameter(default=0.7)
    e: Real = parameter(default=0.6)
    named: bool = structural(default=True)
    s: Real = variable(default=fixed(0.0))
    v: Real = variable(default=fixed(1.3))
    x: Real = variable(default=guess(0.5))
    y: Real = variable(default=fixed(-0.6))
    u: Real = variable(default=fixed(0.4))
    w: Real = variable()
    f: Real = variable()
    hit: Real = discrete()
    n: Real = integer()

    def equations(self) -> Equations:
        d = self.x - self.s
        yield der(self.s) == self.v
        yield der(self.x) == self.u
        yield der(self.y) == self.w
        yield self.M * der(self.v) == self.f * d + self.hit
        yield self.m * der(self.u) == -self.f * d
        yield self.m * der(self.w) == -self.f * self.y - self.m * 9.81
        yield d**2 + self.y**2 == 1.0
        rebound = -self.e * pre(self.v)
        impact = reset(self.v, rebound, by=self.hit) if self.named else reset(self.v, rebound)
        yield when(self.s > 0.7, impact, reset(self.n, pre(self.n) + 1))


@pytest.mark.parametrize("named", [True, False])
@pytest.mark.parametrize("form", ["torn", "dae"])
def test_a_cart_with_a_pendulum_hits_a_wall(named: bool, form: str) -> None:
    """Three velocities, one constraint: masses decide. A `reset` of v alone finds the equation it acts in."""
    random = np.random.default_rng(3)
    compiled = acausal.compile(Cart(named=named), formulation=form)
    for solver in SOLVERS:
        numbers = random.uniform([0.5, 0.2, 0.0], [3.0, 2.0, 1.0])
        given: dict[str, float] = dict(zip(("M", "m", "e"), numbers, strict=True))
        run = acausal.simulate(compiled, parameters=given, stop_time=1.0, solver=solver, tolerance=1e-8)
        (s, x, y), _ = jump(run, "sxy")
        before, after = jump(run, "vuw")
        masses = [given["M"], given["m"], given["m"]]
        expected = balance(masses, [s - x, x - s, y], [1, 0, 0], before, -given["e"] * before[0])
        assert after == pytest.approx(expected, abs=1e-7)
        assert run.final("n") == 1.0
        assert run.final("hit") == 0.0
        # the model does not say which force it is, so that the run says what it has taken
        assert named != any("by the constraints that bind them" in str(note) for note in run.stats["notes"])  # type: ignore[attr-defined]


class Dumbbell(Component):
    """Two masses on a rod of 1 m, in x and y, one of which bounces on the floor, then the other."""

    m: Real = parameter(shape=2, default=(1.0, 0.4))
    e: Real = parameter(default=0.7)
    x: Real = variable(shape=2, default=fixed((0.0, 0.8)))
    y: Real = variable(shape=2, default=guess((1.0, 1.6)))
    u: Real = variable(shape=2, default=guess((0.5, 0.0)))
    v: Real = variable(shape=2, default=fixed((0.0, 0.3)))
    f: Real = variable()
    hit: Real = discrete(shape=2)
    energy: Real = variable()

    def equations(self) -> Equations:
        a, b = self.x[1] - self.x[0], self.y[1] - self.y[0]
        for k, side in ((0, 1.0), (1, -1.0)):
            yield der(self.x[k]) == self.u[k]
            yield der(self.y[k]) == self.v[k]
            yield self.m[k] * der(self.u[k]) == side * self.f * a
            yield self.m[k] * der(self.v[k]) == side * self.f * b - self.m[k] * 9.81 + self.hit[k]
            touches = (self.y[k] < 0.0) & (self.v[k] < 0.0)
            yield when(touches, reset(self.v[k], -self.e * pre(self.v[k]), by=self.hit[k]))
        yield a**2 + b**2 == 1.0
        kinetic = sum(0.5 * self.m[k] * (self.u[k] ** 2 + self.v[k] ** 2) for k in range(2))
        yield self.energy == kinetic + sum(9.81 * self.m[k] * self.y[k] for k in range(2))

    def initial_equations(self) -> Equations:
        yield self.y[0] == 1.0
        yield self.u[0] == 0.5


NAMES = ["u[0]", "v[0]", "u[1]", "v[1]"]


@pytest.mark.parametrize("solver", ["idas", "rosenbrock"])
def test_a_dumbbell_bounces_again_and_again(solver: str) -> None:
    """Each impact by the balance of impulses; energy is kept in flight and never grows."""
    random = np.random.default_rng(5)
    m, e = random.uniform(0.2, 2.0, 2), float(random.uniform(0.5, 1.0))
    run = acausal.simulate(Dumbbell(m=tuple(m), e=e), stop_time=2.0, solver=solver, tolerance=1e-9)
    events = np.flatnonzero(np.diff(run.time) == 0.0)
    impacts = 0
    for number, k in enumerate(events):
        at, _ = jump(run, ["x[0]", "y[0]", "x[1]", "y[1]"], number)
        before, after = jump(run, NAMES, number)
        if min(abs(at[1]), abs(at[3])) > 1e-6:  # a speed has changed its sign
            continue
        impacts += 1
        a, b = at[2] - at[0], at[3] - at[1]
        own = 0 if abs(at[1]) < abs(at[3]) else 1
        normal = [0.0, 1.0 - own, 0.0, float(own)]
        expected = balance([m[0], m[0], m[1], m[1]], [-a, -b, a, b], normal, before, -e * before[1 + 2 * own])
        assert after == pytest.approx(expected, abs=1e-6)
        assert run["energy"][k + 1] <= run["energy"][k] + 1e-6
    assert impacts > 3
    for first, last in zip(events[:-1] + 1, events[1:], strict=True):
        assert run["energy"][last] == pytest.approx(run["energy"][first], abs=1e-5)


class Bar(Component):
    """A falling bar with inertia in its own coordinates, whose end hits the floor."""

    m: Real = parameter(default=1.3)
    J: Real = parameter(default=0.2)
    e: Real = parameter(default=0.5)
    mu: Real = parameter(default=0.0)
    y: Real = variable(default=fixed(1.0))
    v: Real = variable(default=fixed(0.0))
    phi: Real = variable(default=fixed(0.4))
    w: Real = variable(default=fixed(-0.3))
    hit: Real = discrete()
    end: Real = variable()

    def equations(self) -> Equations:
        yield der(self.y) == self.v
        yield der(self.phi) == self.w
        yield self.m * der(self.v) == -9.81 * self.m + self.hit
        yield self.J * der(self.w) == -0.5 * cos(self.phi) * self.hit - 0.1 * self.w * sin(self.w) ** 2
        yield self.end == self.y - 0.5 * sin(self.phi)
        speed = der(self.end)
        yield when(self.end < 0.0, reset(speed, -self.e * speed, by=self.hit))


def test_a_velocity_that_is_no_state_is_reset() -> None:
    """Only the force is named: P = -(1 + e) v_n / (1/m + (l cos(phi))^2 / J). Minimal coordinates, all solvers."""
    for solver in SOLVERS:
        run = acausal.simulate(Bar(), stop_time=0.5, solver=solver, tolerance=1e-9)
        (v, w, phi), (v_after, w_after, _) = jump(run, ["v", "w", "phi"])
        arm = 0.5 * np.cos(phi)
        impulse = -1.5 * (v - arm * w) / (1 / 1.3 + arm**2 / 0.2)
        assert v_after == pytest.approx(v + impulse / 1.3, abs=1e-7)
        assert w_after == pytest.approx(w - arm * impulse / 0.2, abs=1e-7)


@pytest.mark.slow
def test_compiled_flights_take_impulses() -> None:
    """The same impacts, interpreted and in C."""
    model = acausal.compile(Bar(), parameters={"e": 0.9})
    runs = [acausal.simulate(model, stop_time=4.0, solver="erk", tolerance=1e-9, native=n) for n in (False, True)]
    events = [run.time[np.flatnonzero(np.diff(run.time) == 0.0)] for run in runs]
    assert len(events[0]) > 6
    assert events[1] == pytest.approx(events[0], abs=1e-5)
    assert runs[1].final("w") == pytest.approx(runs[0].final("w"), abs=1e-4)


class Double(Component):
    """A double pendulum in maximal coordinates, joints by forces, whose tip hits a wall that stands aslant."""

    m: Real = parameter(shape=2, default=(1.0, 0.6))
    J: Real = parameter(shape=2, default=(0.09, 0.05))
    x: Real = variable(shape=2)
    y: Real = variable(shape=2)
    phi: Real = variable(shape=2, default=fixed((0.3, 0.9)))
    w: Real = variable(shape=2, default=fixed((1.5, 2.0)))
    f: Real = variable(shape=(2, 2))
    hit: Real = discrete()
    tip: Real = variable()

    def equations(self) -> Equations:
        half = 0.5
        end: tuple[Any, Any] = (0.0, 0.0)
        for k in range(2):
            sine, cosine = sin(self.phi[k]), cos(self.phi[k])
            yield self.x[k] - half * sine == end[0]
            yield self.y[k] + half * cosine == end[1]
            end = (self.x[k] + half * sine, self.y[k] - half * cosine)
            yield der(self.phi[k]) == self.w[k]
            above = (self.f[k, 0], self.f[k, 1])
            below = (self.f[1, 0], self.f[1, 1]) if k == 0 else (-0.8 * self.hit, -0.6 * self.hit)
            yield self.m[k] * der(der(self.x[k])) == above[0] - below[0]
            yield self.m[k] * der(der(self.y[k])) == above[1] - below[1] - 9.81 * self.m[k]
            turning = cosine * (above[0] + below[0]) + sine * (above[1] + below[1])
            yield self.J[k] * der(self.w[k]) == -half * turning
        yield self.tip == 0.8 * end[0] + 0.6 * end[1]
        speed = der(self.tip)
        yield when(self.tip > 0.2, reset(speed, -0.4 * speed, by=self.hit))


@pytest.mark.parametrize("form", ["torn", "projected"])
def test_the_tip_of_a_double_pendulum_hits_a_wall(form: str) -> None:
    """Against minimal coordinates: M(phi) by Lagrange, w+ = w- + M^-1 b P with b the slope of the tip."""
    run = acausal.simulate(acausal.compile(Double(), formulation=form), stop_time=1.0, tolerance=1e-9)
    phi, _ = jump(run, ["phi[0]", "phi[1]"])
    before, after = jump(run, ["w[0]", "w[1]"])
    (m1, m2), (j1, j2), half = (1.0, 0.6), (0.09, 0.05), 0.5
    across = m2 * 2 * half * half * np.cos(phi[0] - phi[1])
    mass = np.array([[j1 + m1 * half**2 + m2 * (2 * half) ** 2, across], [across, j2 + m2 * half**2]])
    b = 2 * half * (0.8 * np.cos(phi) + 0.6 * np.sin(phi))
    way = np.linalg.solve(mass, b)
    assert after == pytest.approx(before - 1.4 * (b @ before) / (b @ way) * way, abs=1e-6)


class Cradle(Component):
    """Balls in a row, the first of which comes in; with rods between some of them, which an impact does not part."""

    n: int = structural(default=5)
    e: Real = parameter(default=1.0)
    x: Real = variable(shape=5)
    v: Real = variable(shape=5)
    f: Real = variable()
    hit: Real = discrete(shape=4)

    def equations(self) -> Equations:
        for k in range(self.n):
            yield der(self.x[k]) == self.v[k]
            push = (self.hit[k - 1] if k else 0.0) - (self.hit[k] if k < self.n - 1 else 0.0)
            rod = {1: 1.0, 2: -1.0}.get(k, 0.0) * self.f
            yield der(self.v[k]) == push + rod
        yield self.x[2] - self.x[1] == 0.0
        for k in (0, 2, 3):
            closing = self.v[k] - self.v[k + 1]
            touches = (self.x[k] >= self.x[k + 1] - (1e-3 if k == 0 else 0.0)) & (closing > 1e-12)
            yield when(touches, reset(closing, -self.e * closing, by=self.hit[k]))

    def initial_equations(self) -> Equations:
        for k in range(self.n):
            if k != 2:
                yield self.x[k] == (-1.0 if k == 0 else 0.0)
                yield self.v[k] == (1.0 if k == 0 else 0.0)


def test_impulses_pass_through_a_row_of_balls() -> None:
    """v' = (m - M) / (m + M) v and 2 m / (m + M) v, again and again: 1 kg onto a pair that a rod holds, the pair onto
    the next at rest, that one onto the last, and the pair, which is still faster, onto it once more."""
    run = acausal.simulate(Cradle(), stop_time=1.5, solver="rosenbrock")
    final = [run.final(f"v[{k}]") for k in range(5)]
    assert final == pytest.approx([-1 / 3, 2 / 27, 2 / 27, 8 / 27, 8 / 9], abs=1e-9)


class Taut(Component):
    """A mass on a string of 1 m: thrown upwards, it falls freely until the string is taut, which takes its speed."""

    e: Real = parameter(default=0.0)
    x: Real = variable(default=fixed(0.6))
    y: Real = variable(default=fixed(-0.2))
    v: Real = variable(default=fixed(0.5))
    w: Real = variable(default=fixed(1.0))
    r: Real = variable()
    force: Real = variable()
    pull: Real = discrete()
    taut: Real = acausal.boolean()

    def equations(self) -> Equations:
        yield self.r == sqrt(self.x**2 + self.y**2)
        yield der(self.x) == self.v
        yield der(self.y) == self.w
        yield der(self.v) == -(self.force + self.pull) * self.x / self.r
        yield der(self.w) == -(self.force + self.pull) * self.y / self.r - 9.81
        away = (self.x * self.v + self.y * self.w) / self.r
        yield where(self.taut, der(away), self.force) == 0.0
        yield when((self.r > 1.0) & (away > 0.0), reset(away, -self.e * away, by=self.pull), reset(self.taut, True))
        yield when(pre(self.taut) & (self.force < 0.0), reset(self.taut, False))


def test_a_string_becomes_taut() -> None:
    """The radial speed is lost, the other is kept; then it swings as a pendulum that keeps its energy."""
    run = acausal.simulate(Taut(), stop_time=1.2, solver="rosenbrock", tolerance=1e-9)
    (x, y), _ = jump(run, "xy")
    before, after = jump(run, "vw")
    along = np.array([x, y]) / np.hypot(x, y)
    assert after == pytest.approx(before - (before @ along) * along, abs=1e-7)
    energy = 0.5 * (run["v"] ** 2 + run["w"] ** 2) + 9.81 * run["y"]
    k = int(np.flatnonzero(np.diff(run.time) == 0.0)[0])
    assert energy[k] == pytest.approx(energy[0], abs=1e-6)
    assert run["r"].max() == pytest.approx(1.0, abs=1e-5)


class Discs(Component):
    """Two discs that a clutch joins at 0.5 s, on shafts with springs."""

    J: Real = parameter(shape=2, default=(1.3, 0.4))
    phi: Real = variable(shape=2, default=fixed((0.0, 0.0)))
    w: Real = variable(shape=2, default=fixed((3.0, -1.0)))
    torque: Real = variable()
    hit: Real = discrete()
    closed: Real = acausal.boolean()

    def equations(self) -> Equations:
        for k, sign in ((0, -1.0), (1, 1.0)):
            yield der(self.phi[k]) == self.w[k]
            yield self.J[k] * der(self.w[k]) == sign * (self.torque + self.hit) - self.phi[k]
        slip = self.w[0] - self.w[1]
        yield where(self.closed, der(slip), self.torque) == 0.0
        yield when(acausal.time > 0.5, reset(self.closed, True), reset(slip, 0.0, by=self.hit))


@pytest.mark.parametrize("solver", SOLVERS)
def test_discs_are_joined_and_keep_their_momentum(solver: str) -> None:
    """w = (J1 w1 + J2 w2) / (J1 + J2), whatever springs pull; the impact sees the clutch as it was before."""
    run = acausal.simulate(Discs(), stop_time=1.0, solver=solver, tolerance=1e-9)
    k = int(np.flatnonzero(np.diff(run["closed"]))[0])
    before, after = (np.array([run[n][at] for n in ("w[0]", "w[1]")]) for at in (k, k + 1))
    inertia = np.array([1.3, 0.4])
    assert after == pytest.approx(inertia @ before / inertia.sum(), abs=1e-9)
    assert run.final("w[0]") == pytest.approx(run.final("w[1]"), abs=1e-8)


class Sphere(Component):
    """A point on a sphere, with any mass matrix: equations of motion as they are, or solved for accelerations."""

    mass: Any = structural()
    solved: bool = structural(default=False)
    x: Real = variable(default=guess(0.5))
    y: Real = variable(default=fixed(0.6))
    z: Real = variable(default=fixed(0.5))
    u: Real = variable(default=guess(0.1))
    v: Real = variable(default=fixed(0.4))
    w: Real = variable(default=fixed(-0.9))
    f: Real = variable()
    hit: Real = discrete()
    named: bool = structural(default=False)

    def equations(self) -> Equations:
        place, speed = (self.x, self.y, self.z), (self.u, self.v, self.w)
        forces = [-self.f * p for p in place]
        forces[0] = forces[0] + self.hit
        for p, q in zip(place, speed, strict=True):
            yield der(p) == q
        matrix = np.array(self.mass)
        if self.solved:
            matrix = np.linalg.inv(matrix)
        for row, k in zip(matrix.tolist(), range(3), strict=True):
            total: Any = sum(a * (forces[j] if self.solved else der(speed[j])) for j, a in enumerate(row))
            yield der(speed[k]) == total if self.solved else total == forces[k]
        yield self.x**2 + self.y**2 + self.z**2 == 1.0
        yield when(sample(0.1, 10.0), reset(self.u, 2.0, by=self.hit) if self.named else reset(self.u, 2.0))


COUPLED = ((2.0, 0.7, 0.3), (0.7, 1.5, -0.4), (0.3, -0.4, 1.0))


def on_the_sphere(model: Sphere) -> tuple[Vector, Vector]:
    """Velocities behind the reset, and those of the balance of impulses."""
    run = acausal.simulate(model, stop_time=0.2, tolerance=1e-9)
    place, _ = jump(run, "xyz")
    before, after = jump(run, "uvw")
    mass, jac = np.array(model.mass), np.array([place, [1.0, 0.0, 0.0]])
    inverse = np.linalg.inv(mass)
    return after, before + inverse @ jac.T @ np.linalg.solve(jac @ inverse @ jac.T, [0.0, 2.0 - before[0]])


def test_an_own_equation_of_motion_is_found() -> None:
    after, expected = on_the_sphere(Sphere(mass=((2.0, 0, 0), (0, 0.5, 0), (0, 0, 1.1))))
    assert after == pytest.approx(expected, abs=1e-7)


@pytest.mark.parametrize("solved", [True, False])
def test_where_equations_do_not_tell_it_is_refused_and_a_name_helps(solved: bool) -> None:
    """With a full mass matrix der(u) stands in three equations; solved for it, in one that is no balance of forces."""
    with fails_with(AcausalError, "AC508") as caught:
        acausal.simulate(Sphere(mass=COUPLED, solved=solved), stop_time=0.2)
    assert "by=force" in str(caught.value)
    after, expected = on_the_sphere(Sphere(mass=COUPLED, solved=solved, named=True))
    assert after == pytest.approx(expected, abs=1e-7)


@pytest.mark.parametrize(
    ("response", "holds"),
    [
        ([[2.0, 1.0], [1.0, 3.0]], True),
        ([[-2.0, 5.0], [-1.0, 15.0]], True),  # columns times -1 and 5
        ([[2.0, 1.0], [-1.0, 3.0]], False),
        ([[2.0, 1.0, 0.5], [1.0, 3.0, 0.2], [0.5, 0.2, 1.0]], True),
        ([[2.0, 1.0, 0.5], [1.0, 3.0, 0.2], [0.5, 0.3, 1.0]], False),
    ],
)
def test_reciprocity(response: list[list[float]], holds: bool) -> None:
    assert (reciprocity(np.array(response)) is not None) is holds


def test_derivatives_steps_and_loops_take_impulses() -> None:
    """Sensitivities against differences of runs; a step of 1 ms and `casadi(events=True)` against a run."""
    compiled = acausal.compile(Cart())
    found = acausal.sensitivities(compiled, ["e", "M", "m"], ["x", "u"], stop_time=0.6, tolerance=1e-9)

    def final(**given: float) -> Vector:
        run = acausal.simulate(compiled, parameters=given, stop_time=0.6, solver="rosenbrock", tolerance=1e-10)
        return np.array([run.final("x"), run.final("u")])

    for k, (name, value) in enumerate((("e", 0.6), ("M", 2.0), ("m", 0.7))):
        slope = (final(**{name: value + 1e-4}) - final(**{name: value - 1e-4})) / 2e-4
        assert found.final[:, k] == pytest.approx(slope, rel=1e-5, abs=1e-6)
    step = acausal.step_function(compiled, 1e-3, outputs=["x", "u"])
    stepped = walk(step, 600)
    assert [stepped["x"][-1], stepped["u"][-1]] == pytest.approx(final(), abs=1e-6)
    events = compiled.casadi(events=True).events
    assert events is not None
    run = acausal.simulate(compiled, stop_time=0.6, tolerance=1e-9)
    before, after = jump(run, compiled.states)
    before_it = np.array([port.start for port in events.m])
    behind = events.react(before + 1e-9, [], [], compiled.parameter_values, before_it, [])
    assert np.array(behind[0]).ravel() == pytest.approx(after, abs=1e-7)


class Pushed(Component):
    """A mass whose `when` names something that cannot give it its velocity."""

    what: int = structural()
    x: Real = variable(default=fixed(0.0))
    v: Real = variable(default=fixed(1.0))
    a: Real = variable()
    hit: Real = discrete()
    idle: Real = discrete()

    def equations(self) -> Equations:
        factor = 1.0 + 0.1 * self.v**2 if self.what == 1 else 1.0
        yield der(self.x) == self.v
        yield self.a == der(self.v)
        yield self.a == factor * self.hit
        target, by = {0: (self.v, self.idle), 1: (self.v, self.hit), 2: (self.a, self.hit)}[self.what]
        yield when(self.x > 0.5, reset(target, 0.0, by=by))


@pytest.mark.parametrize(
    ("what", "says"),
    [(0, "impulse of idle moves nothing"), (1, "changes what its own effect depends on"), (2, "is no velocity")],
)
def test_what_cannot_be_an_impulse_is_refused(what: int, says: str) -> None:
    with fails_with(AcausalError, "AC210") as caught:
        acausal.compile(Pushed(what=what))
    assert says in str(caught.value)


class Held(Component):
    """Two impulses at once on a mass that say the same, or different things."""

    v: Real = variable(default=fixed(1.0))
    hit: Real = discrete(shape=2)

    def equations(self) -> Equations:
        yield der(self.v) == self.hit[0] + self.hit[1]
        yield when(acausal.time > 0.5, *(reset(1.0 * self.v, 0.0, by=self.hit[k]) for k in range(2)))


@pytest.mark.parametrize("solver", ["idas", "rosenbrock", "erk"])
def test_impulses_that_nothing_determines_are_refused(solver: str) -> None:
    with fails_with(AcausalError, "AC508"):
        acausal.simulate(Held(), stop_time=1.0, solver=solver)


def test_what_is_no_force_is_refused() -> None:
    for by in ("v", "n"):

        class Wrong(Component):
            v: Real = variable(default=fixed(1.0))
            n: Real = integer()

            def equations(self, name: str = by) -> Equations:
                yield der(self.v) == -self.v
                yield when(acausal.time > 0.5, reset(self.v, 0.0, by=getattr(self, name)))

        with fails_with(AcausalError, "AC141"):
            acausal.compile(Wrong())


class Lying(Component):
    """A ball that has come to rest on the floor, and is struck at 3 s."""

    named: bool = structural(default=True)
    after: Real = parameter(default=2.0)
    h: Real = variable(default=fixed(0.5))
    v: Real = variable(default=fixed(0.0))
    kick: Real = discrete()

    def equations(self) -> Equations:
        yield der(self.h) == self.v
        yield der(self.v) == -9.81 + self.kick
        yield when(self.h < 0.0, reset(self.v, -0.5 * pre(self.v)))
        struck = reset(self.v, self.after, by=self.kick) if self.named else reset(self.v, self.after)
        yield when(acausal.time > 3.0, struck)


@pytest.mark.parametrize("solver", ["idas", "rosenbrock"])
@pytest.mark.parametrize("named", [True, False])
def test_what_lies_still_flies_where_it_is_struck(solver: str, named: bool) -> None:
    """Upwards h = 2 t - g t^2 / 2, as rest does not hold it; downwards it bounces, and lies still again."""
    model = acausal.compile(Lying(named=named))
    up = acausal.simulate(model, stop_time=3.3, solver=solver)
    assert up.final("h") == pytest.approx(2.0 * 0.3 - 9.81 * 0.09 / 2, abs=1e-6)
    down = acausal.simulate(model, parameters={"after": -1.0}, stop_time=4.0, solver=solver)
    assert down["h"].min() > -1e-6
    assert down["h"][down.time > 3.01].max() == pytest.approx(0.25 / 19.62, abs=1e-3)
    assert down.final("h") == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("e", [0.5, 0.0])
@pytest.mark.parametrize("solver", ["idas", "rosenbrock"])
def test_impulses_without_end_do_not_let_a_ball_sink_in(solver: str, e: float) -> None:
    """Bounces by `by=` have no rest to end in: it fell through the floor, 5 m within 2 s."""

    class Ball(Component):
        h: Real = variable(default=fixed(0.5))
        v: Real = variable(default=fixed(0.0))
        kick: Real = discrete()

        def equations(self) -> Equations:
            yield der(self.h) == self.v
            yield der(self.v) == -9.81 + self.kick
            yield when(self.h < 0.0, reset(self.v, -e * self.v, by=self.kick))

    with fails_with(AcausalError, "AC502"):
        acausal.simulate(Ball(), stop_time=2.0, solver=solver)
