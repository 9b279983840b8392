"""Scenes `zeno`, `friction-stop`, `bang-bang`, `change-point` of `stability_scenes.json`."""

from __future__ import annotations

import math

import numpy as np
import pytest

import acausal
from acausal.models.stability.nonlinear import ChangePoint
from acausal.models.stability.switching import BangBang, FrictionStop, ZenoBall

REST = 4.0637127688715781401
"""Accumulation point of the bounces [s]: sqrt(2*h0/g)*(1 + e)/(1 - e)."""


def test_zeno() -> None:
    """`zeno`: h = 0 within 1e-9 at t = 5, fewer than 200 events, no fall through the floor."""
    assert math.sqrt(2.0 / 9.81) * 1.8 / 0.2 == pytest.approx(REST, rel=1e-12)
    result = acausal.simulate(ZenoBall())
    assert result.final("h") == pytest.approx(0.0, abs=1e-9)
    assert result["h"].min() > -1e-9
    assert np.max(np.abs(result["h"][result.time > REST])) < 1e-9
    assert len(result.events) < 200


def test_zeno_verdict() -> None:
    study = acausal.stability(ZenoBall())
    kinds = {f.kind for f in study.verdict.findings}
    assert {"events", "accumulation"} <= kinds
    assert "restarting at every event" in {a.method for a in study.verdict.avoid}


def test_friction_stop() -> None:
    """`friction-stop`: x(100) = 0.25 within 1e-8, few steps after the stop; tanh regularisation creeps to 0.25007."""
    result = acausal.simulate(FrictionStop())
    assert result.final("x") == pytest.approx(0.25, abs=1e-8)
    until = acausal.simulate(FrictionStop(), stop_time=0.49)
    after = float(result.stats["steps"]) - float(until.stats["steps"])  # type: ignore[arg-type]
    assert after < 64 + 36  # mesh points of the run end steps; the stop itself is located between 0.49 and 0.5
    assert min(abs(event.time - 0.5) for event in result.events) < 1e-9


def test_friction_stop_verdict() -> None:
    study = acausal.stability(FrictionStop())
    assert "events" in {f.kind for f in study.verdict.findings}
    assert study.verdict.solver in ("erk", "rosenbrock")
    assert "any method across switches" in {a.method for a in study.verdict.avoid}


def test_bang_bang() -> None:
    """`bang-bang`: (1, 0) within 1e-9 after ten periods; RK4 at 1e-3 is off by 9e-3, IDAS without events by 2.5e-3."""
    result = acausal.simulate(BangBang())
    assert result.final("x") == pytest.approx(1.0, abs=1e-9)
    assert result.final("v") == pytest.approx(0.0, abs=1e-9)
    assert len(result.events) == 20
    # outputs and, in interpreted runs, mesh points end steps
    alone = acausal.simulate(BangBang(), output_interval=BangBang.experiment.stop_time, native=True)
    allowed = 15 * 20 if alone.stats["native"] else 50 * 20
    assert float(alone.stats["steps"]) < allowed  # type: ignore[arg-type]


def test_bang_bang_verdict() -> None:
    """No eigenvalue tells of the switch, the branch does."""
    study = acausal.stability(BangBang())
    assert "events" in {f.kind for f in study.verdict.findings}
    assert "any method across switches" in {a.method for a in study.verdict.avoid}
    assert study.verdict.solver in ("erk", "rosenbrock")


@pytest.mark.parametrize("rows", [1, 40, 333])
def test_change_point(rows: int) -> None:
    """`change-point`: two turns on the right branch, p = 0 and q = th, at any output grid and with noise at the start.

    Newton's method from the last position folds the linkage over at th = pi, for every step.
    """
    for noise in (0.0, 1e-9, -1e-9):
        model = ChangePoint(p=acausal.guess(noise), q=acausal.guess(0.5 * math.pi - noise))
        result = acausal.simulate(model, output_interval=4.0 * math.pi / rows)
        assert np.max(np.abs(result["p"])) < 1e-8
        assert np.max(np.abs(result["q"] - result["th"])) < 1e-8


def test_change_point_verdict() -> None:
    """The Jacobian of the loop, -2*sin(th), changes its sign at th = pi, t = pi/2."""
    study = acausal.stability(ChangePoint(), points=40)
    finding = next(f for f in study.verdict.findings if f.kind == "singular")
    just_before = float(finding.fact.split("t = ")[1].split(" s")[0])
    assert math.pi / 2 < just_before < math.pi / 2 + 0.5
    assert "Newton's method started from the last point" in {a.method for a in study.verdict.avoid}
