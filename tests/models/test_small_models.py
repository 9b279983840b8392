"""The models for newcomers and for size: they run as they are, and their figures show what exists."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import acausal
from acausal.models.mass_chain import MassSpringDamperChain
from acausal.models.oscillator import Oscillator
from acausal.models.rc_circuit import RCCircuit
from acausal.models.rc_ladder import RCLadder

MODELS = [Oscillator, RCCircuit, RCLadder, MassSpringDamperChain]


@pytest.mark.parametrize("model", MODELS)
def test_the_experiment_runs_and_the_figure_moves(model: Any) -> None:
    r = acausal.simulate(model())
    assert r.time[-1] == model.experiment.stop_time
    for panel in model.figure:
        for name in panel.signals:
            assert np.ptp(r[name]) > 0.0, name


@pytest.mark.parametrize(("model", "states"), [(RCLadder(n=30), 30), (MassSpringDamperChain(n=30), 60)])
def test_reduced_to_the_states_of_the_hand_written_system(model: Any, states: int) -> None:
    compiled = acausal.compile(model)
    assert (len(compiled.states), len(compiled.algebraic)) == (states, 0)


def test_parameters_change_without_compiling_again() -> None:
    compiled = acausal.compile(Oscillator())
    soft = acausal.simulate(compiled, stop_time=0.5, tolerance=1e-9, parameters={"c": 25.0, "d": 0.0})
    assert soft["mass.s"] == pytest.approx(0.1 * np.cos(5.0 * soft.time), abs=1e-7)
    stiff = acausal.simulate(compiled, stop_time=0.5, tolerance=1e-9, parameters={"c": 400.0, "d": 0.0, "s0": 0.2})
    assert stiff["mass.s"] == pytest.approx(0.2 * np.cos(20.0 * stiff.time), abs=1e-7)
