"""Problems whose phases end with events of the model: the answers are known from statics and ballistics."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from matplotlib.text import Text
from scipy.integrate import quad
from scipy.optimize import minimize

from acausal import (
    Component,
    Equations,
    Real,
    der,
    fixed,
    integer,
    parameter,
    pre,
    quantity,
    reset,
    signal_input,
    time,
    variable,
    when,
    where,
)
from acausal.errors import AcausalError
from acausal.models.optimal_control.ball_target import ThrownBall, gentle_throw
from acausal.models.optimal_control.plate_drilling import CONE, PlateDrilling, least_time
from acausal.optimal_control import Problem
from tests.expected import fails_with
from tests.optimal_control.kinked import Kinked


def static_drilling_time(k_c11: float = 2240e6, z: float = 0.21) -> float:
    """Time of the same plate when feed and speed follow without delay, by Kienzle's law at each depth.

    Equations (1) to (10) of the founding paper: at a depth the thrust or the torque limits the feed per revolution, the
    power then limits the speed, for the feed rate under a given power grows with the feed; both feed rates are capped.
    """
    d, kappa, z_E, t = 16e-3, np.radians(59.0), 2, 20e-3
    slope = 2 * np.tan(kappa)
    h_c = d / slope

    def rate(s: float) -> float:
        d_O, d_I = slope * np.clip(s, 0.0, h_c), slope * np.clip(s - t, 0.0, h_c)
        edge = z_E / 2 * (d_O - d_I) * k_c11 * (np.sin(kappa) / 1e-3) ** -z
        lever = (d_O + d_I) / 4
        force = min(4e3 / np.sin(2 * kappa), 20.0 / lever)
        f_z = (force / edge) ** (1 / (1 - z))
        n = min(20.0, 1e3 / (2 * np.pi * force * lever))
        return float(min(z_E * n * f_z, 20e-3 if s < t else 5e-3))

    parts = [(0.0, h_c), (h_c, t), (t, t + h_c)]
    tiny = 1e-9
    times = [float(quad(lambda s: 1 / rate(s), a + tiny, b - tiny, limit=500)[0]) for a, b in parts]
    return 1e-3 / 20e-3 + sum(times)


def test_time_optimal_drilling_converges_from_the_default_guess(tmp_path: Path) -> None:
    """With five intervals a phase the time is within half a percent of that of statics, 16.134 s."""
    best = least_time().solve()
    assert best.objective == pytest.approx(static_drilling_time(), rel=5e-3)
    iterations = best.stats["iterations"]
    assert isinstance(iterations, int)
    assert iterations <= 40
    held = {name: best.active(name, 0.1) for name, *_ in best.phases}
    assert list(held) == ["air", "entering", "full", "leaving"]
    assert "feed <= 0.02" in held["air"]
    assert {"thrust <= 4000", "power <= 1000"} <= set(held["entering"])
    assert set(held["full"]) == {"thrust <= 4000", "power <= 1000"}
    assert {"torque <= 20", "power <= 1000"} <= set(held["leaving"])
    drawing = best.plot("thrust", "torque", file=tmp_path / "drilling.png")
    words = " ".join(t.get_text() for t in drawing.findobj(Text) if isinstance(t, Text))
    assert all(name in words for name in held)
    # limits in the units of the axes
    assert all(text in words for text in ("thrust \u2264 4 kN", "torque \u2264 20 N\u00b7m", "feed \u2264 20 mm/s"))
    assert f"PlateDrilling in {best.objective:.6g} s" in words
    assert (tmp_path / "drilling.png").stat().st_size > 10_000


@pytest.mark.slow
@pytest.mark.parametrize(
    ("intervals", "k_c11", "z"),
    [
        (5, 1500e6, 0.21),
        *(pytest.param(*v, marks=pytest.mark.slow) for v in ((8, 2240e6, 0.21), (5, 3000e6, 0.25), (4, 1780e6, 0.17))),
    ],
)
def test_other_materials_and_meshes_need_no_more_iterations(intervals: int, k_c11: float, z: float) -> None:
    best = least_time(intervals, parameters={"drill.k_c11": k_c11, "drill.z": z}).solve()
    iterations = best.stats["iterations"]
    assert isinstance(iterations, int)
    assert iterations <= 40
    assert best.objective == pytest.approx(static_drilling_time(k_c11, z), rel=1e-2)


@pytest.mark.slow
@pytest.mark.parametrize(("path", "value", "more"), [("gap", 2e-3, 0.05), ("m", 200.0, 0.0)])
def test_other_ways_to_the_plate_need_no_more_iterations(path: str, value: float, more: float) -> None:
    """A millimetre more of air at 20 mm/s is 0.05 s more; the mass of the axis is of no account in statics."""
    best = least_time(parameters={path: value}).solve()
    iterations = best.stats["iterations"]
    assert isinstance(iterations, int)
    assert iterations <= 40
    assert best.objective == pytest.approx(static_drilling_time() + more, rel=1e-3)


@pytest.mark.slow
def test_thrust_at_the_start_of_a_phase_can_be_demanded() -> None:
    """It follows from the search of the contact, which is an unknown there, too; results evaluate the model itself."""
    problem = Problem(PlateDrilling())
    problem.phase("air", until="depth > 0", intervals=4)
    problem.phase("entering", until=problem["depth"] >= CONE, intervals=4)
    full = problem.phase("full", until=problem["depth"] >= 6e-3, intervals=4)
    for name, limit in {"feed": 20e-3, "torque": 20.0, "power": 1e3, "thrust": 4e3}.items():
        problem.subject_to(name, max=limit)
    problem.subject_to(full.start("thrust"), max=3000.0, name="begin lightly")
    problem.minimize(problem.duration)
    best = problem.solve()
    assert best.multipliers["begin lightly"].level == pytest.approx([3000.0], rel=1e-6)
    begin = int(np.searchsorted(best.time, best.phases[2][1], side="right")) - 1
    assert best["thrust"][begin] == pytest.approx(3000.0, rel=1e-5)


@pytest.mark.slow
def test_feed_per_edge_of_an_optimum_is_that_of_the_contact() -> None:
    """The feed is an unknown of the program, and solves equation (20) of the founding paper with Kienzle's law."""
    best = least_time().solve()
    inside = (best.time > best.phases[1][1] + 1e-3) & (best.time < best.phases[3][2] - 1e-3)
    s, v, ground, f = (best[name][inside] for name in ("depth", "feed", "drill.s_tar", "drill.f_z"))
    n = best["joint.w"][inside] / (2 * np.pi)
    width = 2 * np.tan(np.radians(59.0)) * (np.clip(s, 0.0, CONE) - np.clip(s - 20e-3, 0.0, CONE))
    cut = np.sin(np.radians(118.0)) * width * 2240e6 * f * (np.sin(np.radians(59.0)) * f / 1e-3) ** -0.21
    pressed = 1e8 * (s - ground) + 2e4 * (v - 2 * n * f)
    assert np.abs(pressed - cut).max() < 1e-5 * 4e3


@pytest.mark.slow
def test_drilling_on_a_refined_mesh_is_what_idas_drills() -> None:
    best = least_time().solve(accuracy=1e-3, refinements=10)
    assert best.objective == pytest.approx(static_drilling_time(), rel=1.5e-3)
    replay = best.replay()
    assert best.error(replay)["slide.s"] < 1e-3
    assert max(replay["power"]) < 1005.0
    assert max(replay["torque"]) < 20.1


@pytest.mark.parametrize(("distance", "height"), [(3.0, 0.8), (2.0, 0.5)])
def test_ball_hits_a_target_after_one_bounce(distance: float, height: float) -> None:
    """Ballistics: with v_h given, the instants of bounce and hit follow, and with them v_x; one number is searched."""
    g, e = 9.81, 0.7

    def speed(v_h: float) -> float:
        down = np.sqrt(v_h**2 + 2 * g)
        up = e * down
        if up**2 < 2 * g * height:
            return np.inf
        first = (v_h + down) / g
        hits = [first + (up + s * np.sqrt(up**2 - 2 * g * height)) / g for s in (-1, 1)]
        return float(min((distance / t) ** 2 for t in hits) + v_h**2)

    expected = minimize(lambda v: speed(v[0]), [3.5], method="Nelder-Mead", options={"xatol": 1e-10, "fatol": 1e-12})
    best = gentle_throw(distance, height).solve()
    assert best.objective == pytest.approx(expected.fun, rel=1e-6)
    replay = best.replay()
    assert replay.final("x") == pytest.approx(distance, abs=1e-6)
    assert replay.final("h") == pytest.approx(height, abs=1e-6)
    assert [event.time for event in replay.events] == pytest.approx([best.phases[0][2]], rel=1e-9)


def forgotten() -> Problem:
    """A ball that bounces, with a single phase."""
    problem = Problem(ThrownBall())
    problem.phase(duration=0.8)
    problem.minimize(problem.end("x"))
    return problem


def too_long() -> Problem:
    """One bounce is declared, two happen."""
    problem = Problem(ThrownBall())
    problem.phase("thrown", until="h < 0", intervals=3)
    problem.phase("bounced", duration=1.5, intervals=3)
    problem.minimize(problem.end("x"))
    return problem


def too_short() -> Problem:
    """The guess ends before the ball comes down."""
    problem = Problem(ThrownBall())
    problem.phase("thrown", until="h < 0", expected=0.2)
    problem.minimize(problem.end("x"))
    return problem


@pytest.mark.parametrize(
    ("problem", "code", "named"),
    [(forgotten, "AC608", "v_h"), (too_long, "AC704", "h < 0"), (too_short, "AC705", "expected to take 0.2 s")],
)
def test_events_without_a_phase_are_refused(problem: object, code: str, named: str) -> None:
    assert callable(problem)
    with fails_with(AcausalError, code) as refused:
        problem().solve()
    assert named in str(refused.value)
    assert refused.value.help


class Helped(Component):
    """A rate that is chosen, and 1/s more from half a second on."""

    u: Real = signal_input(unit="1/s", default=0.0, doc="Rate")
    x: Real = variable(unit="1", default=fixed(0.0), doc="What is reached")

    def equations(self) -> Equations:
        yield der(self.x) == self.u + where(time >= 0.5, quantity(1.0, "1/s"), 0.0)


def helped(*phases: float) -> Problem:
    """To 1 in one second with the least integral of u**2: u = 0.5, since the other half is given."""
    problem = Problem(Helped())
    for duration in phases:
        problem.phase(duration=duration, intervals=2)
    problem.subject_to(problem.end("x") == 1.0)
    problem.minimize(problem.integral(problem["u"] ** 2))
    return problem


def test_sources_switch_between_phases_only() -> None:
    assert helped(0.5, 0.5).solve().objective == pytest.approx(0.25, rel=1e-9)
    with fails_with(AcausalError, "AC704", match=r"t = 0.5 s") as refused:
        helped(1.0).solve()
    assert "time >= 0.5" in str(refused.value.help)


def there(least: float) -> Problem:
    """To half a metre, and after a second more at 0.8 m, with the least of what is beyond in between."""
    problem = Problem(Kinked())
    problem.phase("near", until=problem["x"] >= 0.5, duration=(0.1, 5.0), intervals=4)
    far = problem.phase("far", duration=1.0, intervals=10)
    far.subject_to("x", min=least)
    problem.subject_to(problem.end("x") == 0.8)
    problem.minimize(problem.duration + problem.end("y"))
    return problem


def test_an_optimum_on_another_branch_than_the_models_is_refused() -> None:
    """Half a second to there, waiting, and away at full speed: 0.3**2/2 of what is beyond; from nearer it is less."""
    best = there(0.5).solve()
    assert best.objective == pytest.approx(1.5 + 0.3**2 / 2, rel=1e-6)
    assert max(best.error(best.replay()).values()) < 1e-5
    with fails_with(AcausalError, "AC706", match="far") as refused:
        there(-1.0).solve()
    assert refused.value.help


def test_a_demand_that_no_decision_can_meet_is_refused_before_the_search() -> None:
    """In air the thrust is the constant 0: ipopt went to its limit of iterations over it (AC703)."""
    problem = least_time(2)
    problem.subject_to("thrust", min=100.0)
    with fails_with(AcausalError, "AC051") as caught:
        problem.solve()
    assert "in phase air: it is 0 there" in str(caught.value)


class CountedBall(Component):
    """A ball that counts its bounces."""

    e: Real = parameter(default=0.8)
    g: Real = parameter(default=9.81, unit="m/s2")
    h: Real = variable(unit="m", default=fixed(1.0))
    v: Real = variable(unit="m/s", default=fixed(0.0))
    n: Real = integer()

    def equations(self) -> Equations:
        yield der(self.h) == self.v
        yield der(self.v) == -self.g
        bounce = reset(self.v, -self.e * pre(self.v)), reset(self.n, pre(self.n) + 1)
        yield when(self.h < 0.0, *bounce)


@pytest.mark.parametrize(("e", "top", "g"), [(0.7322, 0.563, 13.22), (0.6246, 0.3964, 19.46), (0.8, 0.9, 9.81)])
def test_a_count_at_the_end_of_a_phase_is_no_event_inside_of_it(e: float, top: float, g: float) -> None:
    """Thrown down from 1 m the ball comes back to a given height: v1 = sqrt(2 g top)/e at the floor."""
    problem = Problem(CountedBall(e=e, g=g), free_start=["v"])
    problem.phase(duration=(0.05, 5.0), until="h < 0", intervals=4)
    problem.phase(duration=(0.01, 1.2 * math.sqrt(2.0 * top / g)), intervals=4)
    problem.subject_to(problem.end("v") == 0.0)
    problem.subject_to(problem.end("h") == top)
    problem.subject_to(problem.start("v") <= 0.0)
    problem.minimize(problem.duration)
    best = problem.solve()
    up = math.sqrt(2.0 * g * top)
    thrown = math.sqrt((up / e) ** 2 - 2.0 * g)
    assert best.start["v"] == pytest.approx(-thrown, rel=1e-6)
    assert best.objective == pytest.approx((up / e - thrown) / g + up / g, rel=1e-6)
