"""The contact force solved inside the equations against the table of the paper's scene; a catalogue too."""

from __future__ import annotations

import math

import numpy as np
import pytest

import acausal
from acausal.library.drilling import DrillingForce
from acausal.models.drilling_dynamic import ThickBlock
from acausal.models.drilling_spindle import SpindleStall
from tests.accuracy.drilling_reference import PlainDrilling
from tests.accuracy.test_drilling_oracle import THICK_BLOCK
from tests.marks import slow_but

H_C_PER_D = 1 / (2 * math.tan(math.radians(59.0)))


@pytest.mark.parametrize("solver", ["idas", "cvodes", "rosenbrock"])
def test_thick_block_follows_the_table(solver: str) -> None:
    r = acausal.simulate(ThickBlock(), solver=solver, tolerance=1e-9)
    assert r.stats["algebraic"] == 0
    for t, s, s_tar, F_f, F_c, *_ in THICK_BLOCK:
        assert r.at(t, "drill.s") == pytest.approx(s * 1e-3, abs=2e-9)
        assert r.at(t, "drill.s_tar") == pytest.approx(s_tar * 1e-3, abs=2e-9)
        assert r.at(t, "drill.F_f") == pytest.approx(F_f, abs=5e-3)
        assert r.at(t, "drill.F_c") == pytest.approx(F_c, abs=5e-3)


@pytest.mark.parametrize("chisel", [False, True])
def test_the_compiler_solves_the_contact_equation(chisel: bool) -> None:
    """The feed that comes out satisfies (20) to rounding, from a breath to a blow, at standstill and at speed."""

    class Scene(ThickBlock):
        """The paper's scene, with a chisel edge or without."""

        def build(self) -> None:
            super().build()
            self.drill = DrillingForce(t=self.workpiece.t, chisel=chisel, p_indent=2e9, d_indent=5e-4, k=1e8, d_c=2e4)

    compiled = acausal.compile(Scene(force_profile=((0.0, 0.0), (1.0, 0.0)), speed_profile=((0.0, 9.28), (1.0, 9.28))))
    worst = 0.0
    for pressed in np.geomspace(1e-9, 3e-4, 7):
        for deep in (1e-6, 1e-4, 2e-3, 6e-3):
            values = {"gap": -(deep + pressed), "drill.s_start": deep}
            r = acausal.simulate(compiled, parameters=values, stop_time=1e-9, solver="rk2", step=1e-9)
            f_z, thrust, v_tar = (float(r[f"drill.{n}"][0]) for n in ("f_z", "thrust", "v_tar"))
            contact = 1e8 * float(r["drill.s"][0] - r["drill.s_tar"][0]) - 2e4 * v_tar
            assert f_z > 0.0
            worst = max(worst, abs(contact - thrust) / (1e8 * pressed))
    assert worst < 1e-9


@pytest.mark.parametrize("D", slow_but([6.0, 20.0], 6.0))
@pytest.mark.parametrize("f", [0.1, 0.3])
def test_thrust_and_motor_torque_against_a_tool_catalogue(D: float, f: float) -> None:
    # Tungaloy General Catalogue 2020-2021, p. L068: thrust 570 K D f**0.85 N, torque K D**2 (0.63 + 16.84 f)/100 N.m,
    # D in mm, f in mm per revolution; K is 2.10 for SCM430 and 2.41 for SCM440, and 34CrMo4 lies between them.
    n = 9.28
    rate = f * 1e-3 * n
    values = {
        "drill.d": D * 1e-3,
        "feed_rate": rate,
        "drill.line_load": 0.0,
        "spindle.tau_max": 200.0,
        "feed.f_max": 50e3,
    }
    # The cone has entered, and the loops of the drives have settled.
    stop = 2.0 + 1.3 * H_C_PER_D * D * 1e-3 / rate
    r = acausal.simulate(SpindleStall(), parameters=values, stop_time=stop)
    assert r.final("drill.depth.f") == pytest.approx(f * 1e-3, rel=1e-3)
    for K in (2.10, 2.41):
        assert r.final("feed.f") / (570 * K * D * f**0.85) == pytest.approx(1.0, abs=0.15)
        assert r.final("spindle.tau") / (K * D**2 * (0.630 + 16.84 * f) / 100) == pytest.approx(1.0, abs=0.15)


def test_the_contact_presses_at_standstill_as_the_spring_alone() -> None:
    force = ((0.0, 0.0), (1.0, 3000.0), (99.0, 3000.0))
    scene = ThickBlock(force_profile=force, speed_profile=((0.0, 0.0), (99.0, 0.0)))
    r = acausal.simulate(scene, parameters={"gap": 0.0}, stop_time=3.0, tolerance=1e-8)
    assert r.final("drill.s") == pytest.approx(3000.0 / 1e8, abs=1e-9)
    np.testing.assert_allclose(r["drill.s_tar"], 0.0, atol=1e-15)


def test_the_contact_agrees_with_a_bracketing_solution_from_the_touch_on() -> None:
    force = ((0.0, 0.0), (1.0, 1000.0), (99.0, 1000.0))
    turning = ((0.0, 9.28), (99.0, 9.28))
    times = [0.5, 1.0, 2.0, 5.0]
    scene = ThickBlock(force_profile=force, speed_profile=turning)
    r = acausal.simulate(scene, stop_time=5.0, tolerance=1e-8)
    expected = PlainDrilling(force, turning).depths(times)
    np.testing.assert_allclose(r.at(times, "drill.s"), expected[:, 0], rtol=1e-7, atol=2e-9)
