"""Problems with answers in closed form, solved and replayed: one mass on a line, pushed."""

from __future__ import annotations

import casadi
import numpy as np
import pytest

from acausal import (
    Component,
    Equations,
    Real,
    concatenate,
    der,
    fixed,
    integer,
    pre,
    reset,
    signal_input,
    variable,
    when,
)
from acausal.errors import AcausalError, OptimizationError
from acausal.optimal_control import Optimum, Problem
from tests.expected import fails_with
from tests.export.scenes import DrivenSlider, Slider


def least_time(distance: float, **options: float) -> Optimum:
    """From rest to rest with a force of at most 1 N on 1 kg."""
    problem = Problem(Slider())
    problem.phase(duration=(0.1, 20.0), intervals=8)
    problem.subject_to("u", min=-1.0, max=1.0)
    problem.subject_to(problem.end("mass.s") == distance)
    problem.subject_to(problem.end("mass.v") == 0.0)
    problem.minimize(problem.duration)
    return problem.solve(**options)  # type: ignore[arg-type]


def rest_to_rest(problem: Problem) -> None:
    """From rest at 0 to rest at 1."""
    problem.subject_to(problem.end("mass.s") == 1.0)
    problem.subject_to(problem.end("mass.v") == 0.0)


def test_the_integral_of_one_is_the_time() -> None:
    """Over two phases, of which each has its own duration: T = 2 sqrt(d/a), as above."""
    problem = Problem(Slider())
    for _ in range(2):
        problem.phase(duration=(0.1, 5.0), intervals=4)
    problem.subject_to("u", min=-1.0, max=1.0)
    rest_to_rest(problem)
    problem.subject_to(problem.end(1.0) + problem.end("mass.v") == 1.0)
    problem.minimize(problem.integral(1.0))
    assert problem.solve().objective == pytest.approx(2.0, rel=1e-6)


@pytest.mark.parametrize("distance", [0.25, 4.0])
def test_least_time_from_rest_to_rest(distance: float) -> None:
    """T = 2 sqrt(d/a): L. S. Pontryagin et al., The mathematical theory of optimal processes, 1962, chapter 1."""
    best = least_time(distance)
    assert best.objective == pytest.approx(2 * np.sqrt(distance), rel=1e-6)
    middle = best.objective / 2
    np.testing.assert_allclose(best.at([0.3 * middle, 1.7 * middle], "u"), [1.0, -1.0], atol=1e-4)
    assert best.final("mass.s") == pytest.approx(distance, abs=1e-9)
    assert best.multipliers["-1 <= u <= 1"].active.mean() > 0.9


def test_multipliers_are_prices() -> None:
    """dT/dd = 1/sqrt(d): what a longer way costs in time; the sum over the limits of u is dT/da = -sqrt(d)/a**1.5."""
    best = least_time(0.25)
    assert best.multipliers["mass.s at the end == 0.25"].value == pytest.approx(2.0, rel=1e-5)
    force = best.multipliers["-1 <= u <= 1"].value
    assert np.abs(force).sum() == pytest.approx(0.5, rel=1e-3)


@pytest.mark.parametrize("control", [0, 1, 2])
def test_replay_ends_where_the_optimum_does(control: int) -> None:
    """IDAS with the optimal force and nothing else; a force in Bernstein form never leaves its limits."""
    best = least_time(4.0, control=control)
    replay = best.replay()
    assert max(best.error(replay).values()) < 1e-6
    assert replay.final("mass.s") == pytest.approx(4.0, abs=1e-6)
    t = np.linspace(0.0, best.time[-1], 1001)
    assert np.abs(np.asarray(best.at(t, "u"))).max() <= 1.0 + 1e-7


def test_least_effort_needs_no_refinement_of_the_mesh() -> None:
    """Unit mass, distance and time: u = 6 - 12 t, its square integrates to 12 (Euler-Lagrange); s is a cubic."""
    problem = Problem(Slider())
    problem.phase(duration=1.0, intervals=4)
    rest_to_rest(problem)
    problem.minimize(problem.integral(problem["u"] ** 2))
    best = problem.solve()
    assert best.objective == pytest.approx(12.0, rel=1e-9)
    t = np.linspace(0.0, 1.0, 57)
    np.testing.assert_allclose(best.at(t, "u"), 6 - 12 * t, atol=1e-6)
    np.testing.assert_allclose(best.at(t, "mass.s"), 3 * t**2 - 2 * t**3, atol=1e-8)
    np.testing.assert_allclose(best.at(t, "power"), (6 - 12 * t) * (6 * t - 6 * t**2), atol=1e-6)
    # Bending the path by more end distance: d(12 d**2)/dd = 24.
    assert best.multipliers["mass.s at the end == 1"].value == pytest.approx(24.0, rel=1e-6)
    assert best.stats["interval_error"] < 1e-8  # type: ignore[operator]
    assert best.plot("u").get_supxlabel() == "phase 1, 0 to 1 s: nothing is at a limit"  # no key to thick lines


def test_mesh_is_refined_until_idas_agrees() -> None:
    """The drive's current i obeys u = i + i**3; i is 6 - 12 t, which makes u no parabola."""
    problem = Problem(DrivenSlider())
    problem.phase(duration=1.0, intervals=5)
    rest_to_rest(problem)
    problem.minimize(problem.integral(problem["current"] ** 2))
    coarse, fine = problem.solve(), problem.solve(accuracy=1e-6)
    assert coarse.stats["interval_error"] > 1e-6  # type: ignore[operator]
    assert fine.stats["interval_error"] <= 1e-6  # type: ignore[operator]
    assert fine.objective == pytest.approx(12.0, rel=1e-6)
    i = np.asarray(fine["current"])
    np.testing.assert_allclose(fine["u"], i + i**3, rtol=1e-6, atol=1e-6)
    errors = [max(best.error(best.replay()).values()) for best in (coarse, fine)]
    assert errors[1] < 1e-4 < errors[0]


def test_a_coarse_mesh_is_noted() -> None:
    """One interval, in which the voltage i + i**3 of the optimum is no parabola."""
    problem = Problem(DrivenSlider())
    problem.phase(duration=1.0, intervals=1)
    rest_to_rest(problem)
    problem.minimize(problem.integral(problem["current"] ** 2))
    coarse, fine = problem.solve(), problem.solve(accuracy=1e-5, refinements=8)
    assert any("interval 1 of 1" in note for note in coarse.stats["notes"])  # type: ignore[attr-defined]
    assert not fine.stats["notes"]


def test_parameter_as_a_decision() -> None:
    """Kinetic energy m v**2/2 after F = 1 N for 1 s, against a price of 1/8 J/kg: 1/(2 m) + m/8 is least at m = 2."""
    problem = Problem(Slider())
    problem.phase(duration=1.0, intervals=2)
    m = problem.decide("m", min=0.1, max=10.0)
    problem.subject_to("u", equals=1.0)
    problem.minimize(m * problem.end("mass.v") ** 2 / 2 + m / 8)
    best = problem.solve()
    assert best.parameters["m"] == pytest.approx(2.0, rel=1e-6)
    assert best.objective == pytest.approx(0.5, rel=1e-8)
    assert best.replay().final("mass.v") == pytest.approx(0.5, rel=1e-6)


def test_free_start_and_periodic_states() -> None:
    """Least mean power of u**2 that goes 1 m in 1 s with equal speed at both ends: coasting at 1 m/s."""
    problem = Problem(Slider(), free_start=["mass.v"])
    problem.phase(duration=1.0, intervals=3)
    problem.periodic("mass.v")
    problem.periodic("mass.s", shift=1.0)
    problem.minimize(problem.integral(problem["u"] ** 2))
    best = problem.solve()
    assert best.start["mass.v"] == pytest.approx(1.0, abs=1e-6)
    assert best.objective == pytest.approx(0.0, abs=1e-9)
    assert best.replay().final("mass.s") == pytest.approx(1.0, abs=1e-6)


def test_path_constraint_on_what_is_only_observed() -> None:
    """Power u v <= 1 W on 1 kg: full force 1 N to 1 m/s, then v = sqrt(1 + 2 (t - 1)), s and all else follow."""
    problem = Problem(Slider())
    problem.phase(duration=1.0, intervals=1)
    problem.phase(duration=1.5, intervals=6)
    problem.subject_to("u", min=0.0, max=1.0)
    problem.subject_to("power", max=1.0)
    problem.minimize(-problem.end("mass.v"))
    best = problem.solve()
    assert best.final("mass.v") == pytest.approx(2.0, rel=1e-5)
    assert best.active("phase 1")[0] == "0 <= u <= 1"
    assert "power <= 1" in best.active("phase 2")


def demand_too_much() -> Problem:
    problem = Problem(Slider())
    problem.phase(duration=1.0, intervals=4)
    problem.subject_to("u", min=-1.0, max=1.0)
    problem.subject_to(problem.end("mass.s") >= 2.0, name="far")
    problem.minimize(problem.integral(problem["u"] ** 2))
    return problem


def bound_nothing() -> Problem:
    problem = Problem(Slider())
    problem.phase(duration=1.0, intervals=4)
    problem.minimize(-problem.end("mass.s"))
    return problem


@pytest.mark.parametrize(
    ("problem", "code", "named"), [(demand_too_much, "AC701", "far"), (bound_nothing, "AC702", "u")]
)
def test_no_optimum_is_said_by_name(problem: object, code: str, named: str) -> None:
    assert callable(problem)
    with fails_with(OptimizationError, code) as refused:
        problem().solve()
    assert named in " ".join(refused.value.evidence)
    assert refused.value.help


def test_unknown_names_are_refused_with_near_ones() -> None:
    problem = Problem(Slider())
    for ask in (
        lambda: problem["mass.sv"],
        lambda: problem.subject_to("mass.ss", max=1.0),
        lambda: problem.decide("mm"),
        lambda: Problem(Slider(), free_start=["mass.a"]),
        lambda: Problem(Slider()).phase(until="mass.s > 3"),
    ):
        with fails_with(AcausalError, "AC010", match=r"mass|'mm'|event"):
            ask()


def test_demands_that_say_nothing_are_refused() -> None:
    problem = Problem(Slider())
    problem.phase("push", duration=1.0)
    problem.phase("brake", duration=1.0).subject_to("u", max=1.0, name="force")
    problem.subject_to(problem.duration <= 3.0)
    problem.minimize(problem.end("mass.s"))
    other = Problem(Slider())
    for ask, code in (
        (lambda: problem.subject_to("u"), "AC051"),
        (lambda: problem.subject_to("u", max=2.0, name="force"), "AC051"),
        (lambda: problem.phase("push"), "AC050"),
        (lambda: problem.phase(duration=(2.0, 1.0)), "AC050"),
        (lambda: problem.phase(duration="3 s"), "AC050"),  # type: ignore[arg-type]
        (lambda: problem.phase(duration=1.0, intervals=2.5), "AC050"),  # type: ignore[arg-type]
        (lambda: problem.subject_to("u", max=1.0, equals=2.0), "AC051"),
        (lambda: problem.subject_to(problem["u"] <= 1.0, min=-1.0), "AC051"),
        (lambda: problem.subject_to("u", max=float("nan")), "AC051"),
        (lambda: problem.guess(lines={"mass.s": (0.0, 1.0, 2.0)}), "AC051"),  # type: ignore[dict-item]
        (lambda: problem.minimize(problem["mass.s"]), "AC053"),
        (lambda: problem.minimize("mass.s"), "AC053"),
        (lambda: problem.solve(accuracy=-1.0), "AC053"),
        (lambda: problem.subject_to(problem.end("mass.s") == float("nan")), "AC051"),
        (lambda: problem.subject_to(problem.end("mass.s") == float("inf")), "AC051"),
        (lambda: problem.subject_to(other.end("mass.s") == 1.0), "AC053"),
        (lambda: problem.minimize(other.duration), "AC053"),
        (lambda: problem.decide("m", min=2.0, max=1.0), "AC051"),
        (lambda: (problem["m"], problem.decide("m", min=1.0)), "AC053"),  # before this call m was a number
        (lambda: (other.decide("m", min=1.0), other.decide("m", min=2.0)), "AC053"),
        (lambda: problem.solve(), "AC051"),
    ):
        with fails_with(AcausalError, code):
            ask()


class Pair(Component):
    """Two pushed coordinates, and a count."""

    a: Real = signal_input(min=-1.0, max=1.0)
    x: Real = variable(shape=2, default=fixed(0.0), unit="s")
    n: Real = integer(default=fixed(0))

    def equations(self) -> Equations:
        yield der(self.x) == concatenate(self.a, -self.a)
        yield when(self.x[0] > 0.2, reset(self.n, pre(self.n) + 1))


def test_the_start_of_a_vector_is_a_decision_and_that_of_a_count_is_not() -> None:
    """x goes 1 s at full rate to 0.2, where an event counts: it begins at -0.8, its image at 0.8."""
    problem = Problem(Pair(), free_start=["x"])
    problem.phase(until="x[0] > 0.2")
    problem.phase(duration=0.1).subject_to("a", min=0.5)
    problem.guess(inputs={"a": 1.0}, lines={"x": (0.0, 0.0)})
    problem.subject_to(problem.start("x[0]") == -0.8)
    problem.subject_to(problem.start("x[1]") == 0.8)
    problem.minimize(problem.duration)
    best = problem.solve()
    assert best.objective == pytest.approx(1.1, rel=1e-6)
    assert set(best.start) == {"x[0]", "x[1]"}
    assert best.replay().final("n") == 1.0
    with fails_with(AcausalError, "AC053", match="n has no values between"):
        Problem(Pair(), free_start=["n"])


def test_options_that_a_solver_does_not_have_are_refused() -> None:
    problem = demand_too_much()
    with fails_with(AcausalError, "AC053", match="no_such"):
        problem.solve(options={"no_such": 1})


def test_phases_are_declared_before_anything_is_said_of_all() -> None:
    """Otherwise the limit would hold in a phase that nobody declared, and not in this one."""
    problem = Problem(Slider())
    problem.subject_to("u", max=1.0)
    with fails_with(AcausalError, "AC050", match="phase"):
        problem.phase(duration=1.0)


class Plane(Component):
    """Two coordinates with chosen rates."""

    u: Real = signal_input(shape=2, default=0.0)
    x: Real = variable(shape=2, default=fixed(0.0), unit="s")

    def equations(self) -> Equations:
        yield der(self.x) == self.u


def test_vectors_at_ends_and_their_integrals() -> None:
    """The integral c of x over T costs 3 c**2 / T**3 with u = 3 c (T - t) / T**3."""
    problem = Problem(Plane())
    problem.phase(duration=2.0, intervals=4)
    problem.subject_to(problem.integral("x") == casadi.DM([0.5, 1.0]))
    problem.minimize(problem.integral(casadi.sumsqr(problem["u"])))
    assert problem.solve().objective == pytest.approx(3 * (0.5**2 + 1.0) / 8, rel=1e-6)
    problem = Problem(Plane())
    problem.phase(duration=(0.1, 9.0), intervals=4)
    problem.subject_to("u", min=-1.0, max=1.0)
    problem.subject_to(problem.end("x") == 2.0)
    problem.minimize(problem.duration)
    assert problem.solve().objective == pytest.approx(2.0, rel=1e-6)
