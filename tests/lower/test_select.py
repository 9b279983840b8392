"""What wanted outputs keep, what never moves, and what parameters made numbers leave over."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import acausal
from acausal import (
    Component,
    Equations,
    Real,
    assert_,
    connect,
    der,
    fixed,
    guess,
    parameter,
    part,
    reset,
    sqrt,
    terminate,
    variable,
    when,
    where,
)
from acausal.errors import AcausalError, UsageError
from acausal.library.multibody import Body, BodyShape, FreeMotion, Revolute, World
from acausal.library.translational import Fixed, Mass, Spring
from acausal.lower.compiled import CompiledModel


class TwoIslands(Component):
    """Two oscillators that know nothing of each other, and a counter of the bounces of a ball."""

    wall: Fixed = Fixed()
    spring_a: Spring = Spring(c=100.0)
    mass_a: Mass = Mass(m=1.0, s=fixed(0.1), v=fixed(0.0))
    spring_b: Spring = Spring(c=400.0)
    mass_b: Mass = Mass(m=1.0, s=fixed(0.2), v=fixed(0.0))
    h: Real = variable(unit="m", default=fixed(1.0))
    v: Real = variable(unit="m/s", default=fixed(0.0))

    def equations(self) -> Equations:
        yield connect(self.wall.flange, self.spring_a.flange_a, self.spring_b.flange_a)
        yield connect(self.spring_a.flange_b, self.mass_a.flange_a)
        yield connect(self.spring_b.flange_b, self.mass_b.flange_a)
        yield der(self.h) == self.v
        yield der(self.v) == -9.81
        yield when(self.h < 0, reset(self.v, -0.7 * self.v))


def run(compiled: CompiledModel, **options: Any) -> acausal.Result:
    return acausal.simulate(compiled, stop_time=1.0, tolerance=1e-9, native=False, **options)


def left(compiled: CompiledModel, kind: str) -> set[str]:
    assert compiled.selection is not None
    return {item.name for item in compiled.selection.dropped if item.kind == kind}


def test_only_the_cone_of_an_output_is_kept() -> None:
    compiled = acausal.compile(TwoIslands(), outputs=["spring_a.f"])
    assert set(compiled.states) == {"mass_a.s", "mass_a.v"}
    assert left(compiled, "state") == {"mass_b.s", "mass_b.v", "h", "v"}
    assert left(compiled, "event")
    result = run(compiled)
    # s = 0.1 cos(10 t), the force pulls back: closed form of the oscillator
    np.testing.assert_allclose(result["mass_a.s"], 0.1 * np.cos(10.0 * result.time), atol=1e-7)
    assert not result.events


def test_events_belong_to_the_cone() -> None:
    compiled = acausal.compile(TwoIslands(), outputs=["h"])
    assert set(compiled.states) == {"h", "v"}
    result = run(compiled)
    # the first bounce of a fall from 1 m, sqrt(2/g), with 0.7 of its speed
    first = np.sqrt(2.0 / 9.81)
    assert result.events[0].time == pytest.approx(first, abs=1e-9)
    after = 1.0 - first
    assert result.final("h") == pytest.approx(0.7 * 9.81 * first * after - 0.5 * 9.81 * after**2, abs=1e-7)


def test_simulate_takes_outputs_too() -> None:
    result = acausal.simulate(TwoIslands(), outputs=["mass_b.s"], stop_time=1.0)
    assert result.stats["states"] == 2
    with pytest.raises(UsageError, match="already"):
        acausal.simulate(acausal.compile(TwoIslands()), outputs=["h"], stop_time=1.0)


def test_a_run_says_what_it_left_out() -> None:
    result = run(acausal.compile(TwoIslands(), outputs=["h"]))
    with pytest.raises(UsageError, match="mass_a") as caught:
        _ = result["mass_a.s"]
    assert "outputs" in str(caught.value)


class Watched(Component):
    """Two decays; one ends the run, and each has an assertion about it."""

    limit: Real = parameter(default=0.0)
    x: Real = variable(default=fixed(1.0))
    y: Real = variable(default=fixed(1.0))
    z: Real = variable(default=fixed(1.0))

    def equations(self) -> Equations:
        yield der(self.x) == -self.x
        yield der(self.y) == -2 * self.y
        yield der(self.z) == -3 * self.z
        yield when(self.y < 0.5, terminate("y is small"))
        yield assert_(self.x > self.limit, "x is large enough")
        yield assert_(self.z > self.limit, "z is large enough")


@pytest.mark.parametrize("freeze", [[], ["limit"], ["zeros"]])
def test_what_ends_a_run_is_kept_and_assertions_about_what_is_kept(freeze: list[str]) -> None:
    compiled = acausal.compile(Watched(), outputs=["x"], freeze=freeze)
    assert set(compiled.states) == {"x", "y"}
    assert left(compiled, "assert") == {"z is large enough"}
    result = run(compiled)
    assert "not checked, because no output depends on its variables: z is large enough" in str(result.stats["notes"])
    # y = exp(-2 t) falls below 0.5 at ln(2)/2
    assert result.time[-1] == pytest.approx(np.log(2.0) / 2.0, abs=1e-7)
    if not freeze:
        with pytest.raises(AcausalError, match="x is large enough"):
            run(compiled, parameters={"limit": 0.8})


class Falling(Component):
    """A free body in three dimensions with nothing but its weight."""

    world: World = part()
    free: FreeMotion = part()
    body: Body = part()

    def build(self) -> None:
        self.world = World(g=9.81, n=(0.0, 0.0, -1.0))
        self.free = FreeMotion(
            r_rel_a=fixed((0.0, 0.0, 3.0)), v_rel_a=fixed((0.0, 0.0, 0.0)), w_rel_b=fixed((0.0, 0.0, 0.0))
        )
        self.body = Body(m=2.0)

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.free.frame_a)
        yield connect(self.free.frame_b, self.body.frame_a)


def test_a_falling_body_keeps_two_of_thirteen_states() -> None:
    assert len(acausal.compile(Falling()).states) == 13
    compiled = acausal.compile(Falling(), outputs=["body.frame_a.r_0"])
    assert compiled.states == ("free.r_rel_a[2]", "free.v_rel_a[2]")
    assert compiled.selection is not None
    assert set(compiled.selection.constant) == {"body.frame_a.r_0[0]", "body.frame_a.r_0[1]"}
    for g in (9.81, 1.62):  # on the moon too: nothing is frozen
        result = run(compiled, parameters={"world.g": g})
        np.testing.assert_allclose(result["body.frame_a.r_0"][-1], [0.0, 0.0, 3.0 - g / 2], atol=1e-9)


class Arm(Component):
    """Three links in a vertical plane; the middle hinge could turn out of it, but starts at rest in it."""

    world: World = part()
    hinges: list[Revolute] = part()
    links: list[BodyShape] = part()

    def build(self) -> None:
        self.world = World(g=9.81, n=(0.0, -1.0, 0.0))
        axes = ((0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
        self.hinges = [Revolute(n=n, phi=fixed(a), w=fixed(0.0)) for n, a in zip(axes, (0.3, 0.0, 0.1), strict=True)]
        self.links = [BodyShape(m=1.0, r=(1.0, 0.0, 0.0), r_CM=(0.5, 0.0, 0.0), I_33=0.1) for _ in range(3)]

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.hinges[0].frame_a)
        for k in range(3):
            yield connect(self.hinges[k].frame_b, self.links[k].frame_a)
            if k < 2:
                yield connect(self.links[k].frame_b, self.hinges[k + 1].frame_a)


def test_planar_motion_needs_the_zeros_among_the_parameters() -> None:
    outputs = ["links[2].frame_b.r_0"]
    full = acausal.compile(Arm())
    assert len(acausal.compile(Arm(), outputs=outputs).states) == 6
    compiled = acausal.compile(Arm(), outputs=outputs, freeze=["zeros"])
    assert set(compiled.states) == {"hinges[0].phi", "hinges[0].w", "hinges[2].phi", "hinges[2].w"}
    assert compiled.rhs.n_instructions() < 0.3 * full.rhs.n_instructions()
    for options in ({}, {"parameters": {"links[1].m": 3.0}}):
        a, b = run(full, **options)[outputs[0]], run(compiled, **options)[outputs[0]]
        np.testing.assert_allclose(b, a, atol=2e-7)


class Rails(Component):
    """Two balls on parallel rails, a penalty force between them, the first one pushed by a spring."""

    c: Real = parameter(default=1.0, unit="N/m")
    k: Real = parameter(default=1e4, unit="N/m")
    m: Real = parameter(default=1.0, unit="kg", min=0.0)
    distance: Real = parameter(default=0.5, unit="m", min=0.0)
    radius: Real = parameter(default=0.1, unit="m", min=0.0)
    x: Real = variable(unit="m", shape=2, default=fixed((0.0, 0.4)))
    v: Real = variable(unit="m/s", shape=2, default=fixed((1.0, 0.0)))
    y: Real = variable(unit="m", shape=2)
    f: Real = variable(unit="N")
    gap: Real = variable(unit="m")

    def equations(self) -> Equations:
        apart = self.x[1] - self.x[0]
        yield self.y[0] == 0.0
        yield self.y[1] == self.distance
        span = sqrt(apart**2 + (self.y[1] - self.y[0]) ** 2)
        yield self.gap == span - 2 * self.radius
        yield self.f == where(self.gap < 0, -self.k * self.gap, 0.0)
        yield der(self.x) == self.v
        yield self.m * der(self.v[0]) == -self.c * self.x[0] - self.f
        yield self.m * der(self.v[1]) == self.f


def test_balls_on_distant_rails_never_touch() -> None:
    """0.5 m apart with radii of 0.1 m: sqrt(dx^2 + 0.25) - 0.2 > 0 whatever dx is."""
    compiled = acausal.compile(Rails(), outputs=["x"], freeze=["distance", "radius"])
    assert left(compiled, "relation") == {"gap < 0"}
    assert set(compiled.states) == {"x[0]", "v[0]"}
    result = run(compiled)
    np.testing.assert_allclose(result["x[0]"], np.sin(result.time), atol=1e-7)
    np.testing.assert_array_equal(result["x[1]"], 0.4)


@pytest.mark.parametrize("options", [{}, {"freeze": ["distance"], "parameters": {"distance": 0.1}}])
def test_balls_that_might_touch_keep_their_contact(options: dict[str, Any]) -> None:
    compiled = acausal.compile(Rails(), outputs=["x"], **options)
    assert not left(compiled, "relation")
    assert len(compiled.states) == 4


class Start(Component):
    """Two states whose starts are found together, a third that neither needs."""

    a: Real = variable(default=guess(1.0))
    b: Real = variable(default=guess(1.0))
    c: Real = variable(default=fixed(1.0))

    def equations(self) -> Equations:
        yield der(self.a) == -self.a
        yield der(self.b) == -2 * self.b
        yield der(self.c) == -self.c * self.b

    def initial_equations(self) -> Equations:
        yield self.a + self.b == 3.0
        yield self.a - self.b == 1.0


def test_what_determines_the_start_is_kept() -> None:
    compiled = acausal.compile(Start(), outputs=["a"])
    assert set(compiled.states) == {"a", "b"}
    assert run(compiled).final("a") == pytest.approx(2.0 * np.exp(-1.0), rel=1e-7)


class Swing(Component):
    """A point mass on a circle in a plane that nothing leaves; the constraint is stabilised."""

    x: Real = variable(default=fixed(0.6))
    y: Real = variable(default=guess(-0.8))
    z: Real = variable(default=fixed(0.25))
    v: Real = variable(default=fixed(0.0))
    w: Real = variable()
    f: Real = variable()

    def equations(self) -> Equations:
        yield der(self.x) == self.v
        yield der(self.y) == self.w
        yield der(self.v) == -self.x * self.f
        yield der(self.w) == -self.y * self.f - 9.81
        yield self.x**2 + self.y**2 == 1.0
        yield der(self.z) == 0.0


def test_what_never_moves_runs_without_the_constraints_beside_it() -> None:
    compiled = acausal.compile(Swing(), outputs=["z"])
    assert not compiled.states
    assert run(compiled)["z"] == pytest.approx(0.25)
