"""Scenes `undamped`, `fast-slow`, `ringing`, `order-reduction`, `gimbal`, `quaternion-drift`, `invariant`,
`missed-pulse`, `inconsistent` (b).
"""

from __future__ import annotations

import math

import numpy as np
import pytest

import acausal
from acausal.models.ivp.e5 import E5
from acausal.models.stability.attitude import GimbalAngles, GimbalMatrix, QuaternionDrift
from acausal.models.stability.nonlinear import DiodeStart
from acausal.models.stability.oscillators import FastSlow, UndampedOscillator
from acausal.models.stability.stiff import OrderReduction, Ringing
from acausal.models.stability.switching import MissedPulse
from acausal.simulate.step_limit.amplification import METHODS


def avoided(study: object) -> set[str | None]:
    """Solvers and methods that a verdict speaks against."""
    verdict = study.verdict  # type: ignore[attr-defined]
    return {a.solver for a in verdict.avoid} | {a.method for a in verdict.avoid}


@pytest.mark.slow
def test_undamped() -> None:
    """`undamped`: amplitude within 1e-3 after 1000 periods at 1e-6, never growing; IDAS at 1e-4: tens of tolerances."""
    study = acausal.stability(UndampedOscillator())
    assert (study.verdict.kind, study.verdict.solver) == ("oscillating", "erk")
    assert {"idas", "cvodes", "rk2"} <= avoided(study)
    effects = {e.order: e.effect for e in study.bdf[0][1]}
    assert (effects[1], effects[3]) == ("damps", "grows")
    result = acausal.simulate(UndampedOscillator(), solver=study.verdict.solver)
    assert result.final("amplitude") == pytest.approx(1.0, abs=1e-3)
    assert result["amplitude"].max() <= 1.0 + 1e-9
    damped = acausal.simulate(UndampedOscillator(), solver="idas", tolerance=1e-4)
    assert abs(float(damped.final("amplitude")) - 1.0) > 2e-3


def test_fast_slow() -> None:
    """`fast-slow`: error below 1e-5 in fewer than 2000 steps; IDAS needs 198484 steps at 1e-6."""
    study = acausal.stability(FastSlow())
    assert (study.verdict.kind, study.verdict.solver) == ("ringing", "rosenbrock")
    assert {"idas", "cvodes", "erk", "rk", "rk2", "trapezoidal rule"} <= avoided(study)
    assert study.character.ringing is not None
    assert study.character.ringing.eigenvalue.imag == pytest.approx(1e4, rel=1e-6)
    result = acausal.simulate(FastSlow(), solver=study.verdict.solver, tolerance=3e-6)
    assert np.max(np.abs(result["x"] - np.cos(result.time))) < 1e-5
    assert float(result.stats["steps"]) < 2000  # type: ignore[arg-type]
    crawling = acausal.simulate(FastSlow(), solver="idas", stop_time=1.0)
    assert float(crawling.stats["steps"]) > 5000  # type: ignore[arg-type]


def test_ringing() -> None:
    """`ringing`: error below 1e-6 at t = 1; the trapezoidal rule with h = 0.01 keeps 96 % of the start error."""
    study = acausal.stability(Ringing())
    assert (study.verdict.kind, study.verdict.solver) == ("stiff", "rosenbrock")
    assert {"trapezoidal rule", "implicit midpoint", "Gauss, 2 stages", "erk", "rk", "rk2"} <= avoided(study)
    trapezoid = next(m for m in METHODS if m.name == "trapezoid")
    assert complex(trapezoid.amplification(-1e6 * 0.01)).real == pytest.approx(-0.9996, abs=1e-6)
    assert acausal.simulate(Ringing()).final("y") == pytest.approx(math.cos(1.0), abs=1e-6)


def test_order_reduction() -> None:
    """`order-reduction`: stiffly accurate methods are preferred; Gauss with 2 stages falls from order 4 to 2."""
    study = acausal.stability(OrderReduction())
    assert study.verdict.solver == "rosenbrock"
    gauss = next(a for a in study.verdict.avoid if a.method == "Gauss, 2 stages")
    assert "its order drops on stiff components" in gauss.why
    assert next(m for m in METHODS if m.name == "rosenbrock").stiffly_accurate
    # Radau IIA: observed order 3 instead of 5, at h = 1/10 and 1/20
    errors = [
        abs(
            float(acausal.simulate(OrderReduction(), solver="collocation", step=h, output_interval=h).final("y"))
            - math.sin(1)
        )
        for h in (0.1, 0.05)
    ]
    assert max(errors) < 1e-9


def test_gimbal() -> None:
    """`gimbal`: attitude error <= 100*rtol in fewer than 500 steps with the matrix; angles stop DOP853."""
    angles = acausal.stability(GimbalAngles())
    assert angles.verdict.kind == "singular"
    failed = next(f for f in angles.verdict.findings if f.kind == "failed")
    assert float(failed.fact.split("t = ")[1].split(" s")[0]) == pytest.approx(1.0, abs=0.01)
    matrix = acausal.stability(GimbalMatrix())
    assert (matrix.verdict.kind, matrix.verdict.solver) == ("smooth", "erk")
    result = acausal.simulate(GimbalMatrix(), solver="erk", tolerance=1e-8)
    end = np.array([[result.final(f"R[{i},{j}]") for j in range(3)] for i in range(3)], dtype=float)
    assert np.max(np.abs(end - np.eye(3))) <= 1e-6
    alone = acausal.simulate(GimbalMatrix(), solver="erk", tolerance=1e-8, output_interval=2.0)  # outputs are steps
    assert float(alone.stats["steps"]) < 500  # type: ignore[arg-type]


@pytest.mark.slow
def test_quaternion_drift() -> None:
    """`quaternion-drift`: ||q| - 1| <= 10*rtol after 1000 s at 10 rad/s; IDAS loses 3e-2 at 1e-6 without the norm."""
    study = acausal.stability(QuaternionDrift(), stop_time=100.0)
    assert (study.verdict.kind, study.verdict.solver) == ("oscillating", "erk")
    assert "constraint" in {f.kind for f in study.verdict.findings}
    result = acausal.simulate(QuaternionDrift(), solver=study.verdict.solver, tolerance=1e-6)
    norm = np.sqrt(sum(result[name] ** 2 for name in ("s", "q[0]", "q[1]", "q[2]")))
    assert np.max(np.abs(norm - 1.0)) <= 1e-5
    # the projection has not much to do: the integrated quaternion itself keeps its norm
    assert float(result.stats["drift"]) <= 1e-5  # type: ignore[arg-type]
    # half the angle of 10 000 rad
    assert result.final("s") == pytest.approx(math.cos(5000.0), abs=1e-3)


def test_invariant() -> None:
    """`invariant`: problem E5, three digits of y2 = y3 = 8.86123352e-23; y2 is not integrated."""
    study = acausal.stability(E5())
    finding = next(f for f in study.verdict.findings if f.kind == "invariant")
    assert finding.fact.startswith("y2 ")
    assert (study.verdict.kind, study.verdict.solver) == ("stiff", "rosenbrock")
    result = acausal.simulate(E5())
    assert result.final("y2") == pytest.approx(8.86123352e-23, rel=1e-3)
    assert result.final("y3") == pytest.approx(8.86123352e-23, rel=1e-3)


def test_missed_pulse() -> None:
    """`missed-pulse`: 0.01 within 1e-12; six solvers return 0."""
    study = acausal.stability(MissedPulse())
    finding = next(f for f in study.verdict.findings if f.kind == "time-events")
    assert "shortest stretch is 0.01 s" in finding.fact
    assert "a solver that has to discover the switch" in avoided(study)
    assert acausal.simulate(MissedPulse()).final("x") == pytest.approx(0.01, abs=1e-12)


@pytest.mark.parametrize("start", [0.0, 0.6, 0.7, 1.0, 5.0])
def test_inconsistent_guess(start: float) -> None:
    """`inconsistent` (b): the diode's voltage from every guess; IDAS's own start-up fails from 5."""
    model = DiodeStart(v=acausal.guess(start))
    assert acausal.simulate(model).final("v") == pytest.approx(0.69249037522418502165, abs=1e-9)
    study = acausal.stability(model, points=3)
    assert study.verdict.solver in ("rosenbrock", "idas")
    assert study.facts.algebraic == 1
