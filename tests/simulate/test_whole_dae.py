"""The whole DAE against the torn one: two ways to the same solution."""

from __future__ import annotations

import numpy as np
import pytest

import acausal
from acausal import Component
from acausal.models.double_pendulum import DoublePendulum
from acausal.models.drilling_dynamic import ThickBlock
from acausal.models.ivp import AndrewsSqueezer, ChargePump
from acausal.models.mass_chain import MassSpringDamperChain
from acausal.models.pendulum_chain import PendulumChain
from acausal.models.rc_circuit import RCCircuit
from acausal.models.rectifier import BridgeRectifier


@pytest.mark.parametrize("model", [DoublePendulum, MassSpringDamperChain, PendulumChain, RCCircuit, BridgeRectifier])
def test_both_forms_agree(model: type[Component]) -> None:
    """Final states within 1e-6 of their size at a tolerance of 1e-9; the runs are too short for chaos to show."""
    stop = min(1.0, model.experiment.stop_time)
    torn, whole = (
        acausal.simulate(acausal.compile(model(), formulation=form), stop_time=stop, tolerance=1e-9)
        for form in ("torn", "dae")
    )
    for name in acausal.compile(model()).states:
        size = max(1e-3, float(np.max(np.abs(torn[name]))))
        assert whole.final(name) == pytest.approx(torn.final(name), abs=1e-6 * size), name


@pytest.mark.parametrize("tolerance", [1e-7, 1e-8, 1e-11])
def test_currents_through_micro_ohms(tolerance: float) -> None:
    """The whole DAE has the currents of conducting diodes as unknowns: 150 V over 1e-5 Ohm, rounded, are 3e-9 A.

    Final state and events are those of the torn form at 1e-10, where the voltage alone is integrated.
    """
    reference = acausal.simulate(BridgeRectifier(), stop_time=0.1, tolerance=1e-10, solver="idas")
    whole = acausal.compile(BridgeRectifier(), formulation="dae")
    found = acausal.simulate(whole, stop_time=0.1, tolerance=tolerance, solver="idas")
    assert found.final("capacitor.v") == pytest.approx(reference.final("capacitor.v"), rel=100 * tolerance + 1e-9)
    times = [e.time for e in reference.events]
    assert [e.time for e in found.events] == pytest.approx(times, abs=0.01 * tolerance + 1e-9)


def test_accelerations_have_the_magnitude_of_their_velocities() -> None:
    """Nominal velocities are 1000 rad/s, angles 1 rad: an acceleration that only the compiler knows is 1e6 rad/s2."""
    compiled = acausal.compile(AndrewsSqueezer(), formulation="dae")
    sizes = dict(zip(compiled.algebraic, compiled.nominal_z, strict=True))
    assert {size for name, size in sizes.items() if name.startswith("der(v[")} == {1e6}


def test_a_model_without_states_is_torn_all_the_same() -> None:
    assert acausal.compile(ChargePump(), formulation="dae").algebraic == acausal.compile(ChargePump()).algebraic


@pytest.mark.parametrize("solver", ["rosenbrock", "idas"])
def test_what_is_declared_monotone_is_solved_in_both_forms(solver: str) -> None:
    """The thrust of a drill has a safeguarded search of its own: left to a solver, it ends at the first touch."""
    whole = acausal.compile(ThickBlock(), formulation="dae")
    found = acausal.simulate(whole, stop_time=2.0, tolerance=1e-6, solver=solver)
    torn = acausal.simulate(ThickBlock(), stop_time=2.0, tolerance=1e-6, solver=solver)
    assert found.final("slide.s") == pytest.approx(torn.final("slide.s"), abs=1e-8)
    assert found.final("drill.s_tar") == pytest.approx(torn.final("drill.s_tar"), abs=1e-8)
