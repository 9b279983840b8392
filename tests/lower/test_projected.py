"""The formulation that keeps every constraint, its variables being states: other equations, the same motion."""

from __future__ import annotations

import numpy as np
import pytest

import acausal
from acausal.errors import UsageError
from acausal.models.double_pendulum import DoublePendulum
from acausal.models.drilling_dynamic import ThickBlock
from acausal.models.rc_ladder import RCLadder


@pytest.mark.parametrize("solver", ["idas", "rosenbrock", "erk"])
def test_the_motion_is_that_of_chosen_states(solver: str) -> None:
    torn = acausal.compile(DoublePendulum())
    projected = acausal.compile(DoublePendulum(), formulation="projected")
    assert len(torn.states) == 4
    assert len(projected.states) > 4
    a, b = (acausal.simulate(m, solver=solver, stop_time=1.0, tolerance=1e-9) for m in (torn, projected))
    for name in torn.states:
        np.testing.assert_allclose(b[name], a[name], atol=1e-6, err_msg=name)


def test_the_distance_to_the_constraints_is_known() -> None:
    run = acausal.simulate(acausal.compile(DoublePendulum(), formulation="projected"), stop_time=1.0, tolerance=1e-6)
    drift = run.stats["drift"]
    assert isinstance(drift, float)
    # stabilised, not solved: near the tolerance, above rounding
    assert 1e-12 < drift < 1e-3
    assert "drift" not in acausal.simulate(DoublePendulum(), stop_time=0.1).stats


def test_a_model_without_constraints_is_the_same() -> None:
    torn, projected = (acausal.compile(RCLadder(), formulation=f) for f in ("torn", "projected"))
    assert projected.states == torn.states


def test_the_drill_keeps_its_guides() -> None:
    projected = acausal.compile(ThickBlock(), formulation="projected")
    torn = acausal.simulate(ThickBlock(), stop_time=5.0)
    run = acausal.simulate(projected, stop_time=5.0)
    assert run.final("drill.s") == pytest.approx(torn.final("drill.s"), abs=1e-9)


def test_formulations_are_listed() -> None:
    with pytest.raises(UsageError, match="AC024") as caught:
        acausal.compile(RCLadder(), formulation="index2")
    assert caught.value.help == "formulations: torn, dae, projected"
