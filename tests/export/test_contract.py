"""What `compiled.casadi()` promises: every function, minimal coordinates, events, finite derivatives, C."""

from __future__ import annotations

import math
import subprocess
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest

import acausal
from acausal import (
    Component,
    Equations,
    Real,
    der,
    discrete,
    fixed,
    guess,
    initial,
    integer,
    maximum,
    minimum,
    parameter,
    pre,
    reset,
    sample,
    signal_input,
    sin,
    time,
    variable,
    when,
    where,
)
from acausal.errors import AcausalError
from acausal.lower.casadi_model import CasadiModel
from acausal.models.bouncing_ball import BouncingBall
from acausal.models.clutches import ThreeClutchDrive
from acausal.models.ivp.andrews_squeezer import AndrewsSqueezer
from acausal.models.optimal_control.cart_pole import CartPole
from acausal.simulate.native import cache
from tests.export.scenes import DrivenSlider, numbers

needs_compiler = pytest.mark.skipif(cache.compiler() is None, reason="no C compiler")


class Rod(Component):
    """A point mass on a rod in x and y: index 3, two states too many."""

    L: Real = parameter(default=0.7, unit="m")
    g: Real = parameter(default=9.81, unit="m/s2")
    x: Real = variable(default=fixed(0.7), unit="m")
    y: Real = variable(default=guess(0.0), unit="m")
    vx: Real = variable(default=guess(0.0), unit="m/s")
    vy: Real = variable(default=fixed(0.3), unit="m/s")
    F: Real = variable(unit="1/s2")

    def equations(self) -> Equations:
        yield der(self.x) == self.vx
        yield der(self.y) == self.vy
        yield der(self.vx) == -self.F * self.x
        yield der(self.vy) == -self.F * self.y - self.g
        yield self.x**2 + self.y**2 == self.L**2


def code_of(call: Any) -> str:
    with pytest.raises(AcausalError) as caught:
        call()
    return caught.value.code


def test_implicit_and_outputs_say_what_dae_says() -> None:
    model = acausal.compile(DrivenSlider()).casadi()
    x, z, u, p = [0.3, 0.2], [0.4], [0.5], model.p.start
    ode, alg, y = model.dae(x, z, u, p)
    np.testing.assert_allclose(
        numbers(model.implicit([7.0, 8.0], x, z, u, p)), [*([7.0, 8.0] - numbers(ode)), *numbers(alg)]
    )
    np.testing.assert_array_equal(numbers(model.outputs(x, z, u, p)), numbers(y))


class Swinging(Component):
    """x'' = -x + sin(a t)."""

    a: Real = parameter(default=0.5, unit="rad/s")
    x: Real = variable(default=fixed(1.0))
    v: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == self.v
        yield der(self.v) == -self.x + sin(self.a * time)


def test_a_step_has_order_four_and_its_length_as_argument() -> None:
    """x = cos t + (sin(a t) - a sin t)/(1 - a^2); halving the step takes 2^4 from the error."""
    model = acausal.compile(Swinging()).casadi()
    assert not model.autonomous
    exact = math.cos(1.0) + (math.sin(0.5) - 0.5 * math.sin(1.0)) / 0.75
    errors = []
    for n in (10, 20):
        x = model.x.start
        for k in range(n):
            x, _ = model.step(k / n, x, [], model.p.start, 1 / n)
        errors.append(abs(float(x[0]) - exact))
    assert math.log2(errors[0] / errors[1]) == pytest.approx(4.0, abs=0.3)


def test_invariants_by_level() -> None:
    """x^2 + y^2 - L^2 and its derivative 2 (x vx + y vy), up to sign and a constant factor."""
    model = acausal.compile(Rod()).casadi()
    place = [model.x.position(n) for n in ("x", "y", "vx", "vy")]
    rng = np.random.default_rng(3)
    values = []
    for _ in range(2):
        x = np.zeros(4)
        x[place] = rng.normal(size=4)
        a, b, va, vb = x[place]
        position, velocity = model.invariants(x, np.zeros(len(model.z)), [], model.p.start)
        values.append([float(position) / (a * a + b * b - 0.49), float(velocity) / (2 * (a * va + b * vb))])
    np.testing.assert_allclose(values[0], values[1], rtol=1e-12)
    assert values[0][0] == pytest.approx(values[0][1])


def test_minimal_coordinates_are_the_angle() -> None:
    """theta'' = -(g/L) sin(theta + offset): at the start, level with the pivot, gravity turns it with g/L."""
    compiled = acausal.compile(Rod())
    model = compiled.casadi(["x", "y"], minimal=True)
    assert len(model.x) == 2
    assert "L" not in model.p.names
    assert any("L" in note for note in model.notes)
    x0, z0 = model.init(model.p.start)
    rate, _, y = model.dae(x0, z0, [], model.p.start)
    np.testing.assert_allclose(numbers(y), [0.7, 0.0], atol=1e-12)
    assert abs(float(rate[1])) == pytest.approx(9.81 / 0.7, rel=1e-12)
    assert abs(float(x0[1])) == pytest.approx(0.3 / 0.7, rel=1e-12)
    assert code_of(lambda: compiled.casadi(parameters=["L"], minimal=True)) == "AC053"


def test_followers_of_a_closed_loop_become_algebraic() -> None:
    """Seven angles, one degree of freedom; along a run the constraints and the rates are those of the run."""
    compiled = acausal.compile(AndrewsSqueezer())
    full, model = compiled.casadi(), compiled.casadi(minimal=True)
    assert (len(model.x), len(model.z) + len(model.x)) == (2, len(full.x))
    run = acausal.simulate(compiled, stop_time=0.01, tolerance=1e-10)
    for t in (0.0, 0.004, 0.01):
        at: dict[str, Any] = {n: run.at(t, n) for n in full.x.names}
        x, z = [at[n] for n in model.x.names], [at[n] for n in model.z.names]
        ode, alg, _ = model.dae(x, z, [], model.p.start)
        assert np.abs(numbers(alg)).max() < 1e-6 * (1 + max(abs(v) for v in z))
        whole = numbers(full.dae([at[n] for n in full.x.names], [], [], full.p.start)[0])
        expected = [whole[full.x.position(n)] for n in model.x.names]
        np.testing.assert_allclose(numbers(ode), expected, rtol=1e-9)
        solved = numbers(model.ode(x, [], model.p.start)[0]) if t == 0.0 else expected
        np.testing.assert_allclose(solved, expected, rtol=1e-6)


def test_parameters_by_name_and_unknown_ones() -> None:
    compiled = acausal.compile(Swinging())
    assert compiled.casadi(parameters=["a"]).p.names == ("a",)
    assert compiled.casadi(parameters=[]).ode(0.0, [1.0, 2.0], [], [])[0].elements() == [2.0, -1.0]
    assert code_of(lambda: compiled.casadi(parameters=["b"])) == "AC020"
    assert code_of(lambda: acausal.compile(BouncingBall()).casadi()) == "AC608"


class Ticking(Component):
    """x' = u, and every 0.3 s u = -x: x falls by 30 % an interval."""

    x: Real = variable(default=fixed(1.0))
    u: Real = discrete(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == self.u
        yield when(sample(0.0, 0.3), reset(self.u, -self.x))


def test_samples_react_when_their_clock_ticks() -> None:
    model = acausal.compile(Ticking()).casadi(events=True)
    assert model.events is not None
    first, interval = (float(v) for v in model.events.clocks(model.p.start))
    assert (first, interval) == (0.0, 0.3)
    x, m, values = np.array(model.x.start), np.array(model.events.m.start), []
    for k in range(1, 5):
        rate = numbers(model.events.dae(0.0, x, [], [], [], m)[0])
        x, _, m, settled = (
            numbers(v) for v in model.events.react(k * interval, x + interval * rate, [], [], [], m, [1])
        )
        values.append(x[model.x.position("x")])
        assert settled == 1
    np.testing.assert_allclose(values, 0.7 ** np.arange(1, 5), rtol=1e-14)


class Valve(Component):
    """Hysteresis: filled at 1, closed above 0.8, drained at -0.5, opened below 0.2."""

    level: Real = variable(default=fixed(0.5))
    open: Real = discrete(default=fixed(1.0))

    def equations(self) -> Equations:
        yield der(self.level) == where(self.open > 0.5, 1.0, -0.5)
        yield when(self.level > 0.8, reset(self.open, 0.0))
        yield when(self.level < 0.2, reset(self.open, 1.0))


def test_relations_flip_and_follow_each_other() -> None:
    """At 0.8 the valve closes, and with it the relation in the rate: both in one reaction."""
    model = acausal.compile(Valve()).casadi(events=True)
    events: Any = model.events
    x, m = np.array(model.x.start), np.array(events.m.start)
    rates = []
    for way in (0.3, -0.6, 0.6):
        rate = numbers(events.dae(x, [], [], [], m)[0])[0]
        rates.append(rate)
        x[0] += way
        x, _, m, settled = (numbers(v) for v in events.react(x, [], [], [], m, []))
        assert settled == 1
    assert rates == [1.0, -0.5, 1.0]


@pytest.mark.parametrize(
    "f",
    [
        lambda x: acausal.sqrt(maximum(x, 0.0)),
        lambda x: maximum(x, 0.0) ** 1.3,
        lambda x: maximum(x, 0.0) ** 0.7,
        lambda x: acausal.fabs(x) ** 1.5,
        lambda x: acausal.acos(minimum(maximum(x, -1.0), 1.0)),
        lambda x: acausal.asin(minimum(maximum(x, -1.0), 1.0)),
        lambda x: acausal.sqrt(x * x + (x - x**3) ** 2),
        lambda x: where(x > 0.0, acausal.log(x), 0.0),
        lambda x: minimum(x, 0.0) ** 2 * maximum(x, 0.0) ** 0.21,
    ],
)
def test_derivatives_are_finite_and_those_of_differences(f: Any) -> None:
    """Values and both derivatives at points within, at and beyond every limit; differences away from the limits."""

    class Held(Component):
        x: Real = signal_input()
        y: Real = variable()

        def equations(self) -> Equations:
            yield self.y == f(self.x)

    model = acausal.compile(Held()).casadi(["y"])
    u = ca.SX.sym("u")
    y = model.outputs([], [], u, [])
    both = ca.Function("both", [u], [y, *ca.hessian(y, u)[::-1]])
    h = 1e-4
    for at in (-2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0):
        value, first, second = (float(v) for v in both(at))
        assert np.isfinite([value, first, second]).all()
        if at not in (-1.0, 0.0, 1.0):
            below, above = (float(both(at + k * h)[0]) for k in (-1, 1))
            assert first == pytest.approx((above - below) / (2 * h), abs=1e-6)
            assert second == pytest.approx((above - 2 * value + below) / h**2, abs=1e-5)


class Quartic(Component):
    """z^4 + 0.3 z^2 + 1 == u has no root below u = 1."""

    u: Real = signal_input(default=2.0)
    x: Real = variable(default=fixed(0.0))
    z: Real = variable(default=guess(1.0))

    def equations(self) -> Equations:
        yield der(self.x) == self.z
        yield self.z**4 + 0.3 * self.z**2 + 1.0 == self.u


def built(model: CasadiModel, folder: Path, change: Any = str) -> str:
    """What the main prints."""
    names = []
    for name, text in model.source().items():
        (folder / name).write_text(change(text) if name.endswith("_main.c") else text, encoding="utf-8")
        names += [name] * name.endswith(".c")
    compiler = str(cache.compiler())
    subprocess.run([compiler, "-O0", *names, "-lm", "-o", "main"], cwd=folder, check=True, capture_output=True)
    return subprocess.run([str(folder / "main")], check=False, capture_output=True, text=True).stdout


@needs_compiler
@pytest.mark.parametrize(
    ("model", "options"),
    [
        (DrivenSlider(), {}),
        (CartPole(), {"minimal": True}),
        (BouncingBall(), {"events": True}),
        pytest.param(ThreeClutchDrive(), {"events": True}, marks=pytest.mark.slow),
        pytest.param(AndrewsSqueezer(), {"minimal": True}, marks=pytest.mark.slow),
    ],
    ids=["rootfinder", "angle", "events", "clutches", "loop"],
)
def test_c_gives_the_numbers_of_the_functions(model: Component, options: Any, tmp_path: Path) -> None:
    made = acausal.compile(model).casadi(**options)
    printed = {tuple(line.split()[:2]): line.split()[2:] for line in built(made, tmp_path).splitlines()}
    given: dict[str, Any] = {"t": [made.start_time], "h": [1e-3], **{v: getattr(made, v).start for v in "xzup"}}
    if made.events is not None:
        given["m"] = made.events.m.start
    for name, f in made.functions.items():
        arguments = [given.get(f.name_in(k), [0.0] * f.numel_in(k)) for k in range(f.n_in())]
        for k, expected in enumerate(f.call([ca.DM(a) for a in arguments])):
            found = [float(v) for v in printed[name.replace(".", "_"), f.name_out(k)]]
            np.testing.assert_allclose(found, numbers(ca.densify(expected)), rtol=1e-9, atol=1e-12)


@needs_compiler
def test_c_says_that_there_is_no_root(tmp_path: Path) -> None:
    """u = 0.5 is below the minimum 1 of the left-hand side; CasADi's own C would return 0 and some number."""
    model = acausal.compile(Quartic()).casadi()
    call = (
        "failed = 0; double bad[1] = {0.5}, r[2], y[8]; "
        'printf("%d ", quartic_ode(quartic_x_start, bad, quartic_p_start, r, y)); printf("%g\\n", r[0]);'
    )
    assert built(model, tmp_path, lambda text: text.replace("failed = 0;", call, 1)).startswith("1 nan")


def test_memory_of_the_past_and_delays_are_refused() -> None:
    class Late(Component):
        x: Real = variable(default=fixed(1.0))

        def equations(self) -> Equations:
            yield der(self.x) == -acausal.delay(self.x, 0.1)

    assert code_of(lambda: acausal.compile(Late()).casadi(events=True)) == "AC035"


class Opened(Component):
    """x begins at twice the parameter, which `initial()` says."""

    k: Real = parameter(default=1.5)
    x: Real = variable(default=fixed(0.0))
    n: Real = integer()

    def equations(self) -> Equations:
        yield der(self.x) == -self.x
        yield when(initial(), reset(self.x, 2.0 * self.k))
        yield when(self.x < 1.0, reset(self.n, pre(self.n) + 1))


def test_what_initial_sets_is_the_start_and_noted() -> None:
    """x begins at 2 k = 3; init(p) is the start before that, of any k."""
    model = acausal.compile(Opened()).casadi(events=True)
    assert model.x.start == [3.0, 0.0]
    assert any("those after initial() for the declared parameters" in note for note in model.notes)
    assert model.events is not None
    after, _, _, settled = model.events.react(model.x.start, [], [], model.p.start, model.events.m.start, [])
    assert np.array(after).ravel().tolist() == [3.0, 0.0]
    assert float(settled) == 1.0
