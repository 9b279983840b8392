"""Work of the sources = cutting + friction + damping + stored, to 1e-6 relative, in every drilling scene."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import acausal
from acausal.library.drilling import EnergyBalance
from acausal.models.drilling_breakthrough import BreakthroughSurge
from acausal.models.drilling_control import ForceControlledDrilling
from acausal.models.drilling_spindle import SpindleStall
from acausal.result.result import Result
from tests.accuracy.drilling_beyond_scenes import BalancedThickBlock, BalancedThinPlate, SlidingDrill, SoftMachine


def largest_residual(r: Result, balance: str = "balance") -> float:
    """What has no place at any time, relative to the energy that has been there at most."""
    there = np.maximum(np.abs(r[f"{balance}.W_source"]).max(), np.abs(r[f"{balance}.E_start"]).max())
    return float(np.abs(r[f"{balance}.residual"]).max() / there)


@pytest.mark.parametrize(
    ("scene", "settings"),
    [
        pytest.param(BalancedThickBlock(), {}, id="thick block"),
        pytest.param(BalancedThinPlate(), {}, id="thin plate"),
        pytest.param(BalancedThinPlate(), {"solver": "idas"}, id="thin plate, idas"),
        pytest.param(SpindleStall(), {}, id="stall"),
        pytest.param(ForceControlledDrilling(), {}, id="force control"),
        pytest.param(SlidingDrill(), {}, id="sliding"),
        pytest.param(SlidingDrill(n=9.28), {"stop_time": 0.05}, id="sliding and turning"),
    ],
)
def test_energy_of_a_scene_is_accounted_for(scene: Any, settings: dict[str, Any]) -> None:
    r = acausal.simulate(scene, **settings)
    assert r.final("balance.W_source") != 0.0 or r.final("balance.E_start") != 0.0
    assert largest_residual(r) < 1e-6


@pytest.mark.slow
def test_energy_of_the_breakthrough() -> None:
    r = acausal.simulate(BreakthroughSurge())
    for drill in ("free", "capped"):
        assert largest_residual(r, f"{drill}.balance") < 1e-6, drill
    # The brake takes what the force does on the capped drill beyond the cut.
    assert float(r.final("capped.balance.W_damping")) > float(r.final("free.balance.W_damping")) + 1.0


def test_cutting_power_is_force_times_feed_plus_torque_times_speed() -> None:
    # Full diameter under 2000 N at rest of everything else: F v + M 2 pi n.
    r = acausal.simulate(BalancedThickBlock(), stop_time=15.0)
    power = 2000.0 * r.at(15.0, "drill.v_tar") + r.at(15.0, "drill.torque") * 2 * math.pi * 9.28
    assert r.at(15.0, "drill.power_cutting") == pytest.approx(power, rel=1e-6)
    # All of the sources' work goes into the cut; the contact keeps F**2 / (2 k) = 0.02 J.
    assert r.at(15.0, "drill.energy") == pytest.approx(2000.0**2 / (2 * 1e8), rel=1e-5)


@pytest.mark.slow
def test_the_soft_machine_yields_in_every_direction_and_drills() -> None:
    r = acausal.simulate(SoftMachine())
    assert largest_residual(r) < 1e-6
    # The balance would say little about joints that do not move.
    for name in ("sideways.s", "tilting.phi", "table.s"):
        assert np.ptp(r[name]) > 1e-5, name
    assert r.final("table.s") == pytest.approx(1500.0 * math.cos(math.radians(5.0)) / 5e6, rel=1e-3)
    assert r.final("drill.s") > 4e-3
    for name in ("W_cutting", "W_friction", "W_damping"):
        assert float(r.final(f"balance.{name}")) > 0.0, name


@pytest.mark.parametrize("solver", ["idas", "rosenbrock", "erk", "cvodes"])
def test_a_drill_that_slips_off_an_edge_loses_the_energy_of_its_spring_at_once(solver: str) -> None:
    """It does not turn and slides at rest along its axis, so that its spring holds F**2 / (2 k) at the edge."""
    edge = {"drill.width": 2e-4}
    r = acausal.simulate(SlidingDrill(), parameters=edge, stop_time=2e-3, solver=solver, tolerance=1e-9)
    assert "AC191" in str(r.stats["notes"])
    assert r["drill.thrust"][0] == pytest.approx(500.0)
    assert r.final("drill.thrust") == 0.0
    assert r.final("balance.W_damping") == pytest.approx(500.0**2 / (2 * 1e8), rel=1e-6)
    assert largest_residual(r) < 1e-8


def test_a_force_without_its_reaction_shows_in_the_balance() -> None:
    class Leaking(BalancedThickBlock):
        """The same scene, with a source that is not in the balance."""

        def build(self) -> None:
            super().build()
            self.balance = EnergyBalance(
                P_source=self.force.u * self.slide.v,
                P_cutting=self.drill.power_cutting,
                P_damping=self.drill.power_damping,
                E=self.drill.energy,
            )

    lost = float(acausal.simulate(Leaking(), stop_time=10.0).final("balance.residual"))
    assert abs(lost) > 1.0
