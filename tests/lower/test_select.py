"""What wanted outputs keep, what never moves, and what parameters made numbers leave over."""

from __future__ import annotations

from typing import Any

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from numpy.typing import NDArray

import acausal
from acausal import (
    Component,
    Equations,
    Expr,
    Real,
    assert_,
    connect,
    der,
    fixed,
    guess,
    maximum,
    parameter,
    part,
    reset,
    sin,
    sqrt,
    structural,
    terminate,
    time,
    variable,
    when,
    where,
)
from acausal.errors import AcausalError, UsageError
from acausal.library.multibody import Body, BodyShape, FreeMotion, Revolute, World
from acausal.library.translational import Fixed, Mass, Spring
from acausal.lower.compiled import CompiledModel
from tests.expected import fails_with


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

    world: World = World(g=9.81, n=(0.0, 0.0, -1.0))
    free: FreeMotion = FreeMotion(
        r_rel_a=fixed((0.0, 0.0, 3.0)), v_rel_a=fixed((0.0, 0.0, 0.0)), w_rel_b=fixed((0.0, 0.0, 0.0))
    )
    body: Body = Body(m=2.0)

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

    world: World = World(g=9.81, n=(0.0, -1.0, 0.0))
    hinges: list[Revolute] = part()
    links: list[BodyShape] = part()

    def build(self) -> None:
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


def compared(model: Component, **options: Any) -> acausal.Result:
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
    full = compared(Web(terms=web, starts=start))
    part = compared(Web(terms=web, starts=start), outputs=wanted, freeze=frozen)
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


class Leaf(Component):
    k: Real = parameter(default=2.0)
    r: Real = parameter(default=(1.0, 0.0, 3.0), shape=3)
    x: Real = variable(shape=3, nominal=1e-3, default=fixed((1.0, 1.0, 1.0)))

    def equations(self) -> Equations:
        yield der(self.x) == -self.k * self.r + 0.0 * self.x


class Tree(Component):
    n: int = structural(default=2)
    scale: Real = parameter(default=1.0)
    leaves: list[Leaf] = part()

    def build(self) -> None:
        self.leaves = [Leaf(k=self.scale) for _ in range(self.n)]

    def equations(self) -> Equations:
        yield from ()


def free(*names: str) -> set[str]:
    return set(acausal.compile(Tree(), freeze=names).parameters)


ALL = {"scale", *(f"leaves[{k}].r[{i}]" for k in range(2) for i in range(3))}


def test_names_that_can_be_given() -> None:
    assert free() == ALL
    assert free("scale") == ALL - {"scale"}
    assert free("leaves[0]") == ALL - {f"leaves[0].r[{i}]" for i in range(3)}
    assert free("leaves[1].r") == ALL - {f"leaves[1].r[{i}]" for i in range(3)}
    assert free("leaves[1].r[2]") == ALL - {"leaves[1].r[2]"}
    assert free("zeros") == ALL - {"leaves[0].r[1]", "leaves[1].r[1]"}
    assert free("*") == set()


def test_frozen_values_are_those_of_the_model_and_of_this_compilation() -> None:
    compiled = acausal.compile(Tree(), parameters={"scale": 5.0}, freeze=["scale", "leaves[0]"])
    result = acausal.simulate(compiled, stop_time=1.0, parameters={"leaves[1].r[0]": 2.0})
    # x = 1 - k r t, closed form
    np.testing.assert_allclose(result["leaves[0].x"][-1], [-4.0, 1.0, -14.0], rtol=1e-7)
    np.testing.assert_allclose(result["leaves[1].x"][-1], [-9.0, 1.0, -14.0], rtol=1e-7)
    assert result["scale"][0] == 5.0
    assert result["leaves[0].r"][0].tolist() == [1.0, 0.0, 3.0]


def test_a_frozen_parameter_cannot_be_changed() -> None:
    compiled = acausal.compile(Tree(), freeze=["leaves[0].r[1]"])
    values: tuple[Any, ...] = ({"leaves[0].r[1]": 1.0}, {"leaves[0].r": (1.0, 1.0, 1.0)})
    for value in values:
        with fails_with(UsageError, "AC022", match="frozen"):
            acausal.simulate(compiled, stop_time=1.0, parameters=value)
    acausal.simulate(compiled, stop_time=1.0, parameters={"leaves[0].r[2]": 1.0})


@pytest.mark.parametrize(("name", "told"), [("leafs[0].r", "leaves[0].r"), ("leaves[0].x", "only parameters")])
def test_unknown_names(name: str, told: str) -> None:
    with fails_with(UsageError, "AC020") as caught:
        acausal.compile(Tree(), freeze=[name])
    assert told in str(caught.value)


@pytest.mark.parametrize(
    ("outputs", "code", "told"),
    [
        (["leaves[0].y"], "AC010", "leaves[0].x"),
        (["leaves[0]"], "AC010", "leaves[0].*"),
        (["scale"], "AC010", "parameter"),
        ([], "AC018", "outputs="),
        ("leaves[0].x", "AC018", "outputs=['leaves[0].x']"),
    ],
)
def test_outputs_that_cannot_be(outputs: list[str], code: str, told: str) -> None:
    with fails_with(UsageError, code) as caught:
        acausal.compile(Tree(), outputs=outputs)
    assert told in str(caught.value)


def test_patterns_and_entries_are_outputs() -> None:
    selection = acausal.compile(Tree(), outputs=["leaves[0].*", "leaves[1].x[2]"]).selection
    assert selection is not None
    assert selection.outputs == ("leaves[0].x[0]", "leaves[0].x[1]", "leaves[0].x[2]", "leaves[1].x[2]")


def test_freezing_does_not_change_tolerances() -> None:
    """Zeros join variables of different nominal sizes; absolute tolerances stay what they were."""
    full, frozen = acausal.compile(Tree()), acausal.compile(Tree(), freeze=["*"])
    sizes = dict(zip(full.states, full.nominal_x, strict=True))
    assert all(sizes[name] == size for name, size in zip(frozen.states, frozen.nominal_x, strict=True))
