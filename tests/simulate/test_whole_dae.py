"""The whole DAE against the torn one: two ways to the same solution."""

from __future__ import annotations

import numpy as np
import pytest

import acausal
from acausal import Component
from acausal.models.double_pendulum import DoublePendulum
from acausal.models.ivp import AndrewsSqueezer, ChargePump
from acausal.models.mass_chain import MassSpringDamperChain
from acausal.models.pendulum_chain import PendulumChain
from acausal.models.rc_circuit import RCCircuit
from acausal.models.rectifier import BridgeRectifier


@pytest.mark.parametrize("model", [DoublePendulum, MassSpringDamperChain, PendulumChain, RCCircuit, BridgeRectifier])
def test_both_forms_agree(model: type[Component]) -> None:
    """Final states within 1e-6 of their size at a tolerance of 1e-9; the runs are too short for chaos to show."""
    stop = min(1.0, model.experiment.stop_time)  # type: ignore[attr-defined]
    torn, whole = (
        acausal.simulate(acausal.compile(model(), formulation=form), stop_time=stop, tolerance=1e-9)
        for form in ("torn", "dae")
    )
    for name in acausal.compile(model()).states:
        size = max(1e-3, float(np.max(np.abs(torn[name]))))
        assert whole.final(name) == pytest.approx(torn.final(name), abs=1e-6 * size), name


def test_accelerations_have_the_magnitude_of_their_velocities() -> None:
    """Nominal velocities are 1000 rad/s, angles 1 rad: an acceleration that only the compiler knows is 1e6 rad/s2."""
    compiled = acausal.compile(AndrewsSqueezer(), formulation="dae")
    sizes = dict(zip(compiled.algebraic, compiled.nominal_z, strict=True))
    assert {size for name, size in sizes.items() if name.startswith("der(v[")} == {1e6}


def test_a_model_without_states_is_torn_all_the_same() -> None:
    assert acausal.compile(ChargePump(), formulation="dae").algebraic == acausal.compile(ChargePump()).algebraic
