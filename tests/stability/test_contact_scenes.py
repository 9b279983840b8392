"""Scenes `explicit-penalty`, `hunt-crossley`, `drill-dynamic`, `abstol`, `wind-up`, `power-law`, `kv-tension`."""

from __future__ import annotations

import json
import math
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

import acausal
from acausal.errors import IntegrationError
from acausal.models.stability.contact import ExplicitPenalty, HuntCrossleyImpact, KelvinVoigtImpact
from acausal.models.stability.drilling import DrillDynamic, PowerLaw, WindUp
from tests.expected import fails_with
from tests.marks import slow_but


# `explicit-penalty`: k = 1e8, m = 10, zeta = 1 has a double eigenvalue -omega: RK2 2/omega, RK4 2.785/omega; without
# damping RK4 2.828/omega and RK2 none; Euler 2*zeta/omega.
@pytest.mark.parametrize(
    ("zeta", "euler", "rk2", "rk4"),
    [(1.0, 2.0, 2.0, 2.785293563), (0.0, 0.0, 0.0, math.sqrt(8.0)), (0.1, 0.2, None, None)],
)
def test_explicit_penalty_limits(zeta: float, euler: float, rk2: float | None, rk4: float | None) -> None:
    omega = math.sqrt(1e8 / 10.0)
    study = acausal.stability(ExplicitPenalty(zeta=zeta), points=4, stop_time=0.1)
    for name, limit in (("euler", euler), ("rk2", rk2), ("rk4", rk4)):
        if limit is not None:
            # a double eigenvalue is known to the square root of rounding
            assert study.largest_step(name) * omega == pytest.approx(limit, rel=1e-6)


@pytest.mark.parametrize(("solver", "number"), [("rk2", "0.0006325"), ("rk", "0.0008808")])
def test_explicit_penalty_is_refused_with_the_number(solver: str, number: str) -> None:
    """A step of 1 ms blows up with RK2 and RK4: refused before the run."""
    with fails_with(IntegrationError, "AC405", number) as refused:
        acausal.simulate(ExplicitPenalty(), solver=solver, step=1e-3)
    assert "states s, v" in refused.value.evidence[0] or "states v, s" in refused.value.evidence[0]


def test_explicit_penalty_verdict() -> None:
    study = acausal.stability(ExplicitPenalty())
    assert (study.verdict.kind, study.verdict.solver) == ("stiff", "rosenbrock")
    assert {"rk2", "rk", "erk"} <= {a.solver for a in study.verdict.avoid}


@pytest.mark.parametrize(
    ("a", "rebound"),
    slow_but(
        [(0.2, 0.88218998624730637932), (0.5, 0.74843493159743415812), (1.0, 0.59362426004004009232)],
        (0.5, 0.74843493159743415812),
    ),
)
def test_hunt_crossley(a: float, rebound: float) -> None:
    """`hunt-crossley`: rebound speed to 10*rtol; no method fails, so none but fixed steps is advised against."""
    assert acausal.simulate(HuntCrossleyImpact(a=a)).final("v") == pytest.approx(-rebound, abs=1e-7)
    study = acausal.stability(HuntCrossleyImpact(a=a), points=6)
    assert (study.verdict.kind, study.verdict.solver) == ("smooth", "erk")
    assert {a.solver for a in study.verdict.avoid} == {None}


# clipped law, release in ms after touch; the plain law would pull by 27 to 67 N before release
@pytest.mark.parametrize(
    ("zeta", "restitution", "release"),
    slow_but([(0.05, 0.858758, 9.6303), (0.2, 0.571740, 8.8397), (0.5, 0.298436, 7.6476)], (0.2, 0.571740, 8.8397)),
)
def test_kv_tension(zeta: float, restitution: float, release: float) -> None:
    """`kv-tension`: no negative normal force, restitution to 6 digits, touch and release located as events."""
    result = acausal.simulate(KelvinVoigtImpact(zeta=zeta))
    times = [event.time for event in result.events]
    assert min(abs(t - 1e-3) for t in times) < 1e-12
    assert any(abs(t - 1e-3 - 1e-3 * release) < 1e-7 for t in times)
    assert result["f"].min() >= -1e-9  # N: at release itself rounding remains
    assert -result.final("v") == pytest.approx(restitution, abs=6e-7)
    study = acausal.stability(KelvinVoigtImpact(zeta=zeta), points=6)
    assert study.verdict.solver in ("erk", "rosenbrock")
    assert {f.kind for f in study.verdict.findings} & {"kinks", "events"}


# s(10) [m], from IDAS at 1e-12 in segments, self-agreement 1e-13 m
DEPTHS = [
    (1e6, 10.0, 1.0, 1.284243480e-2),
    pytest.param(1e7, 10.0, 1.0, 1.282439797e-2, marks=pytest.mark.slow),
    pytest.param(1e8, 10.0, 1.0, 1.282259563e-2, marks=pytest.mark.slow),
    pytest.param(1e8, 1.0, 1.0, 1.282259583e-2, marks=pytest.mark.slow),
    (1e8, 50.0, 0.1, 1.282259965e-2),
]


@pytest.mark.parametrize(("k", "m", "zeta", "depth"), DEPTHS)
def test_drill_dynamic(k: float, m: float, zeta: float, depth: float) -> None:
    """`drill-dynamic`: s(10) within 1e-9 m with the solver that the verdict names."""
    study = acausal.stability(DrillDynamic(k=k, m=m, zeta=zeta), points=10, check=False)
    assert study.verdict.solver == "rosenbrock" or study.verdict.kind == "smooth"
    result = acausal.simulate(DrillDynamic(k=k, m=m, zeta=zeta), solver=study.verdict.solver, tolerance=1e-8)
    assert result.final("s") == pytest.approx(depth, abs=1e-9)


@pytest.mark.slow
def test_drill_dynamic_limits_are_those_of_the_table() -> None:
    """README of the reference data, at the drilling equilibrium, zeta = 1, k = 1e8, m = 1: 1.86e-4, 1.86e-4, 2.60e-4.

    At 6 s, in the middle of the full force; 'unstable' there for RK2 and RK4 at 1 ms and m = 10.
    """
    study = acausal.stability(DrillDynamic(k=1e8, m=1.0, zeta=1.0), points=40, check=False)
    middle = min(study.locals, key=lambda local: abs(local.point.t - 6.0))
    for name, limit in (("euler", 1.86e-4), ("rk2", 1.86e-4), ("rk4", 2.60e-4)):
        method = next(q.method for q in study.limits if q.method.name == name)
        assert method.largest_step(middle.eigenvalues)[0] == pytest.approx(limit, rel=1e-2)
    for solver in ("rk2", "rk"):
        with pytest.raises(IntegrationError, match="largest stable step"):
            acausal.simulate(DrillDynamic(k=1e8), solver=solver, step=1e-3)


def test_abstol() -> None:
    """`abstol`: error 3.3e-6 m at rtol 1e-4 with atol 1e-6 for metres; with nominals per variable below 1e-6 m."""
    result = acausal.simulate(DrillDynamic(k=1e6), tolerance=1e-4)
    assert result.final("s") == pytest.approx(1.284243480e-2, abs=7.5e-7)
    study = acausal.stability(DrillDynamic(k=1e6), points=4, check=False)
    assert "one absolute tolerance for all units" in {a.method for a in study.verdict.avoid}
    finding = next(f for f in study.verdict.findings if f.kind == "scale")
    assert "scaled by nominal values, variable by variable" in finding.remedy


def test_wind_up() -> None:
    """`wind-up`: s_tar unchanged to 1e-15 m during approach and after lift-off, though the damper alone feeds."""
    result = acausal.simulate(WindUp())
    t, s, s_tar = result.time, result["s"], result["s_tar"]
    touch = t[s > s_tar][0]
    assert 0.05 < touch < 0.15
    assert np.max(np.abs(s_tar[t < touch])) <= 1e-15
    gone = t > t[s > s_tar][-1] + 1e-6
    assert np.count_nonzero(gone) > 10
    assert np.ptp(s_tar[gone]) <= 1e-15
    assert s_tar[-1] > 1e-5
    study = acausal.stability(WindUp(), points=10)
    kinds = {f.kind for f in study.verdict.findings}
    assert "time-events" in kinds
    assert kinds & {"kinks", "events"}


def test_a_contact_shorter_than_the_rows_is_seen() -> None:
    # overdamped: -(zeta +- sqrt(zeta^2 - 1)) w with w = sqrt(k/m) = 1e4 1/s, for half a millisecond of 20 ms
    study = acausal.stability(KelvinVoigtImpact(k=1e8, zeta=1.5), points=8, check=False)
    assert study.fastest_mode is not None
    assert study.fastest_mode.eigenvalue.real == pytest.approx(-1e4 * (1.5 + math.sqrt(1.25)), rel=1e-6)
    assert study.largest_step("rk2") == pytest.approx(2e-4 / (1.5 + math.sqrt(1.25)), rel=1e-6)
    # it is there for a short while only: no reason to call the run stiff
    assert study.verdict.solver == "erk"


def test_power_law_has_finite_derivatives() -> None:
    """`power-law`: finite first derivatives of the feed for all forces; the printed form has an infinite slope."""
    compiled = acausal.compile(PowerLaw())
    dae = compiled.casadi(outputs=["f"]).dae
    slope = dae.factory("slope", ["t", "x", "z", "u", "p"], ["jac:y:p", "jac:ode:p", "jac:ode:t"])
    p = np.array(compiled.parameter_values, dtype=float)
    where = compiled.parameters.index("force")
    for force in (-4881.0, -1e-9, 0.0, 1e-300, 1e-9, 4881.0):
        p[where] = force
        for part in slope(0.1, [0.0], [], [], p):
            assert np.isfinite(np.array(ca.DM(part))).all()


def test_power_law_verdict() -> None:
    study = acausal.stability(PowerLaw(), points=8)
    assert study.verdict.solver == "erk"
    printed = acausal.stability(PowerLaw(inverted=False), points=8)
    # rosenbrock has no slope at zero feed to start with; erk needs none, but 2.3e5 1/s soon after ask it for 1e5 steps
    assert printed.verdict.solver == "idas"
    assert printed.character.explicit_steps > 20 * printed.character.steps
    assert "Newton's method through that point" in {a.method for a in printed.verdict.avoid}
    singular = next(f for f in printed.verdict.findings if f.kind == "singular")
    assert "no finite linearisation at t = 0 s" in singular.fact
    assert "infinite slope" in singular.fact


def test_scenes_are_those_of_the_reference(reference: Path) -> None:
    """Every scene of the reference data is one of the models of the gallery, by its docstring, or problem E5."""
    scenes = json.loads((reference / "ivp" / "stability_scenes.json").read_text(encoding="utf-8"))["scenes"]
    folder = Path(__file__).resolve().parents[2] / "models" / "stability"
    text = "".join(path.read_text(encoding="utf-8") for path in folder.glob("*.py"))
    assert {s["id"] for s in scenes if f"`{s['id']}`" not in text} == {"invariant"}
