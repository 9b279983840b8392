"""Scenes of the planar pendulum in `stability_scenes.json`: drift, static-state, index3-direct, inconsistent (a).

Gravity is (2*K)**2 with the complete elliptic integral K of modulus 1/sqrt(2), so that the period is 2 s.
"""

from __future__ import annotations

import numpy as np
import pytest

import acausal
from acausal.errors import InitializationError
from acausal.models.stability.pendulum import PendulumDirect, PendulumDrift, PendulumInconsistent, PendulumStaticState


def test_drift_criterion() -> None:
    """`drift`: |x**2 + y**2 - 1| <= 100*rtol at t = 1000; back at (1, 0) at even times.

    The acceleration-level form reaches 2.7e-2 at t = 100 and 1.7 at t = 1000 with IDAS at 1e-6.
    """
    result = acausal.simulate(PendulumDrift(), solver="idas", tolerance=1e-6, output_interval=0.777 * 10)
    assert np.max(np.abs(result["length2"] - 1.0)) <= 1e-4
    # what the integration itself had drifted before the projection, not only the recorded points
    drift = result.stats["drift"]
    assert isinstance(drift, float)
    assert drift <= 1e-4
    assert result.final("x") == pytest.approx(1.0, abs=1e-3)


def test_drift_verdict() -> None:
    study = acausal.stability(PendulumDrift(), stop_time=20.0)
    finding = next(f for f in study.verdict.findings if f.kind == "constraint")
    assert "x ** 2 + y ** 2 == 1" in finding.fact
    assert "stabilised" in finding.remedy
    assert "its second derivative alone" in {a.method for a in study.verdict.avoid}
    assert study.verdict.kind == "oscillating"


def test_static_state_criterion() -> None:
    """`static-state`: passes the lowest point at t = 0.47079423603649512667 s and swings through, time and again."""
    result = acausal.simulate(PendulumStaticState(), solver="erk", stop_time=25.0, output_interval=0.37)
    assert result.at(0.47079423603649512667, "x") == pytest.approx(0.0, abs=1e-8)
    assert result["x"].min() < -0.9
    assert np.ptp(result["energy"]) < 1e-5


def test_static_state_verdict() -> None:
    study = acausal.stability(PendulumStaticState())
    finding = next(f for f in study.verdict.findings if f.kind == "constraint")
    assert "no fixed choice of states is safe" in finding.remedy
    assert study.verdict.solver in ("erk", "rosenbrock")


def test_index3_direct() -> None:
    """`index3-direct`: the tool reduces the index itself, and the verdict names the constraint; period 2."""
    study = acausal.stability(PendulumDirect())
    assert study.facts.constraints == ("x ** 2 + y ** 2 == 1",)
    assert "BDF for the constraint as stated" in {a.method for a in study.verdict.avoid}
    result = acausal.simulate(PendulumDirect())
    assert result.final("x") == pytest.approx(1.0, abs=1e-7)
    assert result.final("y") == pytest.approx(0.0, abs=1e-7)


@pytest.mark.parametrize(("x0", "vx0", "named"), [(1.01, 0.0, "x == x0"), (1.0, 0.1, "vx == vx0")])
def test_inconsistent_start_is_refused_by_name(x0: float, vx0: float, named: str) -> None:
    """`inconsistent` (a): started off the circle, or with a radial speed of 0.1; study and run refuse alike."""
    model = PendulumInconsistent(x0=x0, vx0=vx0)
    for function in (acausal.simulate, acausal.stability):
        with pytest.raises(InitializationError) as refused:
            function(model)
        assert named in str(refused.value)
        assert "x ** 2 + y ** 2 == 1" in str(refused.value)
