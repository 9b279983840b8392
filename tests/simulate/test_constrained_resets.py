"""A `reset` of what a stabilised constraint binds: the constraint holds behind it, or the run is refused."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import acausal
from acausal import (
    Component,
    Equations,
    Real,
    connect,
    der,
    fixed,
    guess,
    parameter,
    part,
    pre,
    reset,
    sample,
    variable,
    when,
)
from acausal.errors import AcausalError
from acausal.library.multibody import (
    Body,
    Fixed,
    FixedTranslation,
    Prismatic,
    Revolute,
    RevolutePlanarLoopConstraint,
    World,
)
from tests.expected import fails_with

SOLVERS = ["idas", "rosenbrock", "cvodes", "erk"]
Action = Callable[[Any], Any]


class Pendulum(Component):
    """1 kg on a rod of 1 m in x and y: a constraint without a safe choice of states."""

    x: Real = variable(default=fixed(1.0))
    y: Real = variable(default=guess(0.0))
    v: Real = variable(doc="Along x")
    w: Real = variable(default=fixed(0.0), doc="Along y")
    f: Real = variable()

    def equations(self) -> Equations:
        yield der(self.x) == self.v
        yield der(self.y) == self.w
        yield der(self.v) == -self.f * self.x
        yield der(self.w) == -self.f * self.y - 9.81
        yield self.x**2 + self.y**2 == 1.0


def kicked(*actions: Action, guard: Action | None = None) -> Component:
    """The pendulum with these actions at 0.3 s, or where the guard becomes true."""

    def equations(self: Any) -> Equations:
        condition = sample(0.3, 10.0) if guard is None else guard(self)
        yield when(condition, *[act(self) for act in actions])

    return type("Kicked", (Pendulum,), {"equations": equations})()  # type: ignore[no-any-return]


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("interval", [0.05, 3.0])
def test_the_other_velocity_follows(solver: str, interval: float) -> None:
    """x v + y w = 0 holds behind the reset; 3 s between outputs hid that it was off by 2.9 m/s."""
    run = acausal.simulate(kicked(lambda s: reset(s.v, 2.0)), stop_time=3.0, output_interval=interval, solver=solver)
    k = int(np.flatnonzero(np.diff(run.time) == 0.0)[0])
    x, y, v, w = (run[n] for n in "xyvw")
    assert v[k + 1] == 2.0
    assert x[k + 1] == pytest.approx(x[k], abs=1e-7)
    assert w[k + 1] == pytest.approx(-2.0 * x[k] / y[k], rel=1e-5)
    # energy of the motion from there on
    energy = 0.5 * (v**2 + w**2) + 9.81 * y
    assert energy[-1] == pytest.approx(energy[k + 1], abs=1e-4)


def test_a_wall_turns_the_whole_velocity() -> None:
    """At x = 0.2 the speed along x is turned by 0.5; the rod turns that along y with it, so the swing halves."""
    model = kicked(lambda s: reset(s.v, -0.5 * pre(s.v)), guard=lambda s: s.x < 0.2)
    run = acausal.simulate(model, stop_time=0.6, solver="rosenbrock")
    k = int(np.flatnonzero(np.diff(run.time) == 0.0)[0])
    for name in "vw":
        assert run[name][k + 1] == pytest.approx(-0.5 * run[name][k], rel=1e-6)


def test_what_follows_is_seen_by_the_next_round() -> None:
    """A `when` on the velocity that follows acts at the same instant."""

    def equations(self: Any) -> Equations:
        yield when(sample(0.3, 10.0), reset(self.v, 2.0))
        yield when(self.w > 4.0, reset(self.seen, 1.0))

    own = {"equations": equations, "__annotations__": {"seen": Real}, "seen": acausal.discrete()}
    run = acausal.simulate(type("Seen", (Pendulum,), own)(), stop_time=0.4, solver="rosenbrock")
    k = int(np.flatnonzero(np.diff(run.time) == 0.0)[0])
    assert run["w"][k + 1] > 4.0
    assert run["seen"][k + 1] == 1.0


def test_all_given_are_taken_as_they_are() -> None:
    model = kicked(lambda s: reset(s.v, -2.0 * s.y), lambda s: reset(s.w, 2.0 * s.x))
    run = acausal.simulate(model, stop_time=0.6)
    k = int(np.flatnonzero(np.diff(run.time) == 0.0)[0])
    assert np.hypot(run["v"][k + 1], run["w"][k + 1]) == pytest.approx(2.0, rel=1e-7)


@pytest.mark.parametrize(
    ("actions", "names"),
    [
        ([lambda s: reset(s.x, 0.5)], ["leave open what becomes of", "y, v and w"]),
        ([lambda s: reset(s.v, 1.0), lambda s: reset(s.w, 1.0)], ["cannot be satisfied"]),
        ([lambda s: reset(s.x, 1.5), lambda s: reset(s.v, 0.0), lambda s: reset(s.w, 0.0)], ["cannot be satisfied"]),
    ],
)
@pytest.mark.parametrize("solver", ["idas", "rosenbrock"])
def test_what_is_open_or_impossible_is_refused(actions: list[Action], names: list[str], solver: str) -> None:
    with fails_with(AcausalError, "AC508") as caught:
        acausal.simulate(kicked(*actions), stop_time=6.0, output_interval=3.0, solver=solver)
    for text in names:
        assert text in str(caught.value)


FORMS: dict[str, Callable[[Component], object]] = {
    "step": lambda model: acausal.step_function(acausal.compile(model), 0.01),
    "sensitivities": lambda model: acausal.sensitivities(model, ["nothing"], ["x"], stop_time=0.5),
}


@pytest.mark.parametrize("form", FORMS)
def test_forms_that_carry_events_refuse_it(form: str) -> None:
    with fails_with(AcausalError, "AC608"):
        FORMS[form](kicked(lambda s: reset(s.v, 2.0)))


class Loop(Component):
    """Planar links between joints, the crank given another speed at 0.2 s."""

    points: tuple[tuple[float, float], ...] = acausal.structural()
    world: World = part()
    base: Fixed = part()
    end: Fixed = part()
    joints: list[Revolute] = part()
    rods: list[FixedTranslation] = part()
    bodies: list[Body] = part()
    close: RevolutePlanarLoopConstraint = RevolutePlanarLoopConstraint()

    def build(self) -> None:
        p = [(*q, 0.0) for q in self.points]
        self.world, self.base, self.end = World(), Fixed(r=p[0]), Fixed(r=p[-1])
        free = len(p) - 3
        starts: list[dict[str, Any]] = [{"phi": fixed(0.0), "w": fixed(1.0)} if k < free else {} for k in range(len(p))]
        self.joints = [Revolute(**starts[k]) for k in range(len(p) - 1)]
        ways = [tuple(float(b - a) for a, b in zip(q, r, strict=True)) for q, r in itertools.pairwise(p)]
        self.rods = [FixedTranslation(r=way) for way in ways]
        self.bodies = [Body(m=1.0, r_CM=tuple(0.5 * c for c in way), I_33=0.02) for way in ways]

    def equations(self) -> Equations:
        frame = self.base.frame_b
        for joint, rod, body in zip(self.joints, self.rods, self.bodies, strict=True):
            yield connect(frame, joint.frame_a)
            yield connect(joint.frame_b, rod.frame_a, body.frame_a)
            frame = rod.frame_b
        yield connect(frame, self.close.frame_a)
        yield connect(self.close.frame_b, self.end.frame_b)
        yield when(sample(0.2, 10.0), reset(self.joints[0].w, -3.0))


def test_a_crank_that_is_given_a_speed_turns_its_loop() -> None:
    """Velocities of the closing point by the angles and speeds of the joints: zero behind the reset."""
    points = ((0.0, 0.0), (0.1, 0.4), (0.9, 0.7), (1.0, 0.0))
    run = acausal.simulate(Loop(points=points), stop_time=0.4, output_interval=0.2)
    k = int(np.flatnonzero(np.diff(run.time) == 0.0)[0]) + 1
    assert run["joints[0].w"][k] == -3.0
    phi = np.cumsum([run[f"joints[{j}].phi"][k] for j in range(3)])
    w = np.cumsum([run[f"joints[{j}].w"][k] for j in range(3)])
    links = np.diff(np.array(points), axis=0) @ np.array([1.0, 1j])
    assert abs(np.sum(1j * w * links * np.exp(1j * phi))) < 1e-8
    assert np.abs(w[1:]).min() > 0.1


def test_a_loop_of_two_freedoms_leaves_it_open() -> None:
    points = ((0.0, 0.0), (0.1, 0.4), (0.5, 0.9), (0.9, 0.7), (1.0, 0.0))
    with fails_with(AcausalError, "AC508") as caught:
        acausal.simulate(Loop(points=points), stop_time=0.4, output_interval=0.2)
    assert "joints[1].w" in str(caught.value)


class SliderCrank(Component):
    """A crank of 0.3 m and a rod of 0.8 m; the crank is turned on by an angle at 0.1 s, and stopped there."""

    by: Real = parameter(default=0.0, unit="rad")
    world: World = World(g=0.0)
    base: Fixed = Fixed()
    crank: Revolute = Revolute(phi=fixed(0.7), w=fixed(0.0))
    arm: FixedTranslation = FixedTranslation(r=(0.3, 0.0, 0.0))
    pin: Revolute = Revolute(phi=guess(-1.0))
    rod: FixedTranslation = FixedTranslation(r=(0.8, 0.0, 0.0))
    load: Body = Body(m=1.0, r_CM=(0.4, 0.0, 0.0), I_33=0.05)
    guide: Prismatic = Prismatic(s=guess(1.0))
    slider: Body = Body(m=1.0)
    close: RevolutePlanarLoopConstraint = RevolutePlanarLoopConstraint()

    def equations(self) -> Equations:
        yield connect(self.base.frame_b, self.crank.frame_a, self.guide.frame_a)
        yield connect(self.crank.frame_b, self.arm.frame_a)
        yield connect(self.arm.frame_b, self.pin.frame_a)
        yield connect(self.pin.frame_b, self.rod.frame_a, self.load.frame_a)
        yield connect(self.rod.frame_b, self.close.frame_a)
        yield connect(self.guide.frame_b, self.slider.frame_a, self.close.frame_b)
        turned = reset(self.crank.phi, pre(self.crank.phi) + self.by)
        yield when(sample(0.1, 10.0), turned, reset(self.crank.w, 0.0))


@pytest.mark.parametrize("by", [-3.0, 1.0, 2.5, 5.0])
def test_a_loop_is_not_taken_apart_by_a_reset_of_its_crank(by: float) -> None:
    """s = r cos(phi) + sqrt(l^2 - r^2 sin(phi)^2); with the other root the slider is behind the crank."""
    run = acausal.simulate(SliderCrank(by=by), stop_time=0.2, tolerance=1e-8)
    phi = 0.7 + by
    s = 0.3 * np.cos(phi) + np.sqrt(0.8**2 - (0.3 * np.sin(phi)) ** 2)
    assert run.final("crank.phi") == pytest.approx(phi, abs=1e-7)
    assert run.final("guide.s") == pytest.approx(s, abs=1e-7)
