"""Models with events against balances and closed forms."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import acausal
from acausal.models.bouncing_ball import BouncingBall
from acausal.models.clutches import ClutchChain, ThreeClutchDrive
from acausal.models.rectifier import BridgeRectifier, SCRBridge
from acausal.models.sampled_control import SampledSpeedControl
from acausal.models.switched_converter import BuckConverter

MODELS = [BouncingBall, ThreeClutchDrive, ClutchChain, BridgeRectifier, SCRBridge, BuckConverter, SampledSpeedControl]


@pytest.fixture(scope="module")
def runs() -> dict[Any, acausal.Result]:
    return {model: acausal.simulate(model()) for model in MODELS}


@pytest.mark.parametrize("model", MODELS)
def test_the_experiment_runs_and_the_figure_moves(runs: dict[Any, acausal.Result], model: Any) -> None:
    r = runs[model]
    assert r.time[-1] == model.experiment.stop_time
    for panel in model.figure:
        assert any(np.ptp(r[name]) > 0.0 for name in panel.signals), panel


def test_clutches_keep_the_angular_momentum(runs: dict[Any, acausal.Result]) -> None:
    """Their torques are internal: sum(J*w) grows with the integral of the driving torque alone."""
    r = runs[ThreeClutchDrive]
    total = sum(r[f"J{k}.w"] for k in range(1, 5))
    np.testing.assert_allclose(total, 10.0 + (1.0 - np.cos(10.0 * np.pi * r.time)) / np.pi, rtol=0, atol=1e-6)
    chain = runs[ClutchChain]
    momentum = 0.1 * sum(chain[f"inertias[{k}].w"] for k in range(11))
    expected = 5.0 * (1.0 - np.cos(2.0 * np.pi * chain.time)) / (2.0 * np.pi)
    np.testing.assert_allclose(momentum, expected, rtol=0, atol=1e-6)


@pytest.mark.slow
def test_fifty_clutches_in_a_row_keep_the_angular_momentum() -> None:
    """The driving torque alone changes sum(J*w), and each clutch passes on what it can hold at most."""
    r = acausal.simulate(ClutchChain(n=50), stop_time=1.0)
    momentum = 0.1 * sum(r[f"inertias[{k}].w"] for k in range(51))
    np.testing.assert_allclose(momentum, 5.0 * (1.0 - np.cos(2.0 * np.pi * r.time)) / (2.0 * np.pi), rtol=0, atol=1e-6)
    assert len(r.events) > 50
    for k in range(0, 50, 7):
        assert np.abs(r[f"clutches[{k}].tau"]).max() < (1.0 - k / 50) ** 2 * 1.0 + 1e-6, k


@pytest.mark.parametrize("k", [1, 2, 3])
def test_a_stuck_clutch_turns_as_one_and_never_exceeds_its_torque(runs: dict[Any, acausal.Result], k: int) -> None:
    r = runs[ThreeClutchDrive]
    stuck = (r[f"clutch{k}.locked"] > 0.5) & (r[f"clutch{k}.mode"] == 0.0)
    assert np.abs(r[f"clutch{k}.w_rel"][stuck]).max(initial=0.0) < 1e-6
    excess = np.abs(r[f"clutch{k}.tau"]) - r[f"clutch{k}.tau0_max"]
    assert excess[stuck].max(initial=-1.0) < 1e-6
    assert (r[f"clutch{k}.loss_power"] > -1e-6).all()


def test_clutches_break_loose_from_the_far_end_on(runs: dict[Any, acausal.Result]) -> None:
    """Stuck, clutch k passes the share (10 - k)/11 of 5*sin(2*pi*t) on; it holds (1 - k/10)^2 N.m.

    The last one lets go at 5*sin(2*pi*t)/11 = 0.01; each that has let go relieves the one before by what it no longer
    passes on.
    """
    r = runs[ClutchChain]
    loose = [float(r.time[np.flatnonzero(r[f"clutches[{k}].locked"] < 0.5)[0]]) for k in range(10)]
    assert loose == sorted(loose, reverse=True)
    assert loose[9] == pytest.approx(math.asin(11.0 * 0.01 / 5.0) / (2.0 * math.pi), abs=1e-7)


def test_the_rectifier_charges_twice_a_period(runs: dict[Any, acausal.Result]) -> None:
    """Diodes in pairs, none backward; the mean current through the capacitor is zero once the output is periodic."""
    r = runs[BridgeRectifier]
    np.testing.assert_allclose(r["diode_p1.i"], r["diode_n2.i"], rtol=0, atol=5e-3)  # up to the leakage of the others
    assert min(r[f"diode_{d}.i"].min() for d in ("p1", "p2", "n1", "n2")) > -5e-3
    last, before = (np.asarray(r.at(np.linspace(t, t + 0.01, 41), "load.v")) for t in (0.09, 0.08))
    np.testing.assert_allclose(last, before, rtol=1e-3)
    assert 100.0 < last.min() < last.max() < math.sqrt(2.0) * 110.0


def test_thyristors_conduct_from_their_firing_on(runs: dict[Any, acausal.Result]) -> None:
    """The current never ends, so a pair conducts for half a period, from 1.5 ms after each zero crossing."""
    r = runs[SCRBridge]
    off = r["thyristor_p1.off"]
    at = [float(t) for t in r.time[1:][np.abs(np.diff(off)) > 0.5]]
    np.testing.assert_allclose(at, 1.5e-3 + 0.01 * np.arange(len(at)), rtol=0, atol=1e-9)
    assert r.at(0.09, "load.v") > 0.0


@pytest.mark.slow
def test_the_converter_halves_its_supply_with_the_ripple_of_the_book(runs: dict[Any, acausal.Result]) -> None:
    """V*duty = 12 V; the current swings by V*duty*(1 - duty)/(L*f) = 0.6 A."""
    r = acausal.simulate(BuckConverter(), stop_time=10e-3, tolerance=1e-8, output_interval=1e-6)
    period = r.time > 9.9e-3
    t = r.time[period]
    mean = np.trapezoid(r["load.v"][period], t) / (t[-1] - t[0])
    assert mean == pytest.approx(12.0, rel=2e-2)
    assert np.ptp(r["inductor.i"][period]) == pytest.approx(0.6, rel=2e-2)
    assert (
        len(runs[BuckConverter].events) == 100
    )  # both edges of 50 periods, less the one at the start, and one at the end


def test_the_clock_acts_every_millisecond_and_the_speed_is_reached(runs: dict[Any, acausal.Result]) -> None:
    r = runs[SampledSpeedControl]
    ticks = [e.time for e in r.events if "sample" in e.condition]
    np.testing.assert_allclose(ticks, 1e-3 * np.round(np.array(ticks) / 1e-3), rtol=0, atol=1e-12)
    assert len(ticks) >= 299
    assert r.final("load.w") == pytest.approx(100.0, rel=1e-2)
    assert np.abs(r["controller.y"]).max() <= 20.0
