"""Margin friction, friction of the tip and indentation of the chisel edge against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest

import acausal
from acausal.library.drilling import DrillingForce
from acausal.models.drilling_dynamic import ThickBlock
from acausal.result.result import Result
from tests.accuracy.drilling_beyond_scenes import DrivenDrill, SlidingDrill
from tests.accuracy.drilling_reference import PlainDrilling


class Indenting(ThickBlock):
    """The paper's dynamic scene with an indenting chisel edge."""

    def build(self) -> None:
        super().build()
        self.drill = DrillingForce(
            t=self.workpiece.t,
            chisel=True,
            p_indent=2e9,
            d_indent=0.5e-3,
            k=1e8,
            d_c=2e4,
        )


H_C = 0.016 / (2 * math.tan(math.radians(59.0)))
MU_Q = 0.2 * 1e4  # friction per length of margin [N/m]


def engaged(s: float, length: float = 1.0) -> float:
    """Length of the margins in the plate of 20 mm when the tip is at depth `s` [m]."""
    below, above = min(max(s - H_C, 0.0), 0.02), min(max(s - H_C - length, 0.0), 0.02)
    return below - above


@pytest.mark.slow
def test_margins_of_a_turning_drill_brake_its_rotation() -> None:
    r = acausal.simulate(DrivenDrill(), stop_time=35.0, solver="idas", output_interval=1.0)
    expected = [engaged(s) for s in r["drill.s"]]
    np.testing.assert_allclose(r["drill.margin.engaged"], expected, atol=1e-12)
    # The helix of 1 mm/s against 466 mm/s around: nearly all of the friction is torque.
    around, along = 2 * math.pi * 9.28 * 0.008, 1e-3
    share = 1.0 / math.hypot(around, along, 1e-3)
    np.testing.assert_allclose(r["drill.margin.torque"], MU_Q * np.array(expected) * 0.008 * around * share, rtol=1e-6)
    np.testing.assert_allclose(r["drill.margin.F"], MU_Q * np.array(expected) * along * share, rtol=1e-6)
    assert r["drill.total_torque"].max() > r["drill.torque"].max()


def test_a_drill_that_is_pulled_out_without_turning_has_all_of_the_friction_along_its_axis() -> None:
    values = {"v": -0.05, "n": 0.0, "s_start": 0.02, "hole": 0.02}
    r = acausal.simulate(DrivenDrill(), parameters=values, stop_time=0.3, solver="idas")
    expected = [-MU_Q * engaged(s) * 0.05 / math.hypot(0.05, 1e-3) for s in r["drill.s"]]
    np.testing.assert_allclose(r["drill.margin.F"], expected, atol=1e-6)
    np.testing.assert_allclose(r["drill.total_thrust"][1:], expected[1:], atol=1e-6)
    assert r["drill.margin.torque"].max() == 0.0


@pytest.mark.slow
def test_short_margins_leave_the_hole_open_behind_them() -> None:
    values = {"drill.margin_length": 5e-3}
    r = acausal.simulate(DrivenDrill(), parameters=values, stop_time=35.0, solver="idas", output_interval=1.0)
    np.testing.assert_allclose(r["drill.margin.engaged"], [engaged(s, 5e-3) for s in r["drill.s"]], atol=1e-12)
    assert r["drill.margin.engaged"].max() == pytest.approx(5e-3)


def test_friction_stops_a_tip_that_slides_across_the_plate() -> None:
    scene = SlidingDrill()
    r = acausal.simulate(scene, stop_time=0.004, tolerance=1e-9, output_interval=1e-3)
    # v' = -a v / sqrt(v**2 + v_0**2): sqrt(v**2 + v_0**2) - v_0 asinh(v_0 / v) falls with the rate a = mu F / m.
    v, v_0, a = r["across.v"], 1e-3, 0.2 * 500.0 / 5.0
    left = np.sqrt(v**2 + v_0**2) - v_0 * np.arcsinh(v_0 / v)
    np.testing.assert_allclose(left, left[0] - a * r.time, atol=1e-6)
    assert v[-1] == pytest.approx(0.1 - a * 0.004, rel=0.02)


@pytest.mark.slow
def test_a_turning_tip_gives_way_to_a_push_that_a_standing_one_resists() -> None:
    # 50 N against mu F = 100 N. The standing tip creeps as the regularisation lets it; the turning one slides so fast
    # that the share of its sideways velocity in all of its sliding is one half: v = tan(30 deg) hypot(omega r, v_0).
    values = {"push": 50.0, "v_start": 0.0}
    standing = acausal.simulate(SlidingDrill(), parameters=values, stop_time=1.0)
    turning = acausal.simulate(SlidingDrill(n=9.28), parameters=values, stop_time=1.0)
    creep = math.tan(math.radians(30.0)) * 1e-3
    assert standing.final("across.v") == pytest.approx(creep, rel=1e-6)
    radius = (turning["drill.d_O"] + turning["drill.d_I"]) / 4
    expected = math.tan(math.radians(30.0)) * np.hypot(2 * math.pi * 9.28 * radius, 1e-3)
    late = turning.time > 0.1
    np.testing.assert_allclose(turning["across.v"][late], expected[late], rtol=0.02)
    assert turning.final("across.v") > 20 * creep


TURNING = ((0.0, 9.28), (9.0, 9.28))


def full_diameter(F: float) -> Result:
    """A drill under a constant force in a hole of full diameter, for two seconds."""
    scene = Indenting(force_profile=((0.0, F), (9.0, F)), speed_profile=TURNING)
    return acausal.simulate(scene, parameters={"gap": -0.01, "drill.s_start": 0.01}, stop_time=2.0, tolerance=1e-8)


F_INDENT = 2e9 * math.pi / 4 * (0.5e-3) ** 2  # pressure times area of the indented circle: 393 N


@pytest.mark.parametrize("F", [500.0, 3000.0])
def test_indentation_adds_to_the_thrust_of_the_edges(F: float) -> None:
    plain = PlainDrilling(((0.0, F), (1.0, F)), TURNING)
    r = full_diameter(F)
    # f_z of the edges under what the indentation leaves of the force; its own regularisation is a feed of 0.1 um.
    f_z = float(r.final("drill.f_z"))
    left = F - F_INDENT * f_z / (f_z + 1e-7)
    assert f_z == pytest.approx(plain.inverse(0.016, left), rel=1e-6)
    assert r.final("drill.force.F_i") == pytest.approx(F - left, rel=1e-6)
    assert r.final("drill.thrust") == pytest.approx(F, rel=1e-6)


def test_thrust_does_not_vanish_with_the_feed_but_the_torque_does() -> None:
    # A tenth less than the indentation force: the drill rubs, whereas it would cut by Kienzle's law alone.
    F = 0.9 * F_INDENT
    r = full_diameter(F)
    by_kienzle = PlainDrilling(((0.0, F), (1.0, F)), TURNING).inverse(0.016, F)
    assert float(r.final("drill.f_z")) < 0.15 * by_kienzle
    assert r.final("drill.thrust") == pytest.approx(F, rel=1e-6)
    assert float(r.final("drill.force.F_i")) > 0.7 * F


def test_the_indented_circle_engages_and_leaves_like_the_edges() -> None:
    # Pressed in at n = 0, k s = force; the circle under the tip is 2 s tan(59 deg) wide until it is 0.5 mm.
    scene = Indenting(force_profile=((0.0, 0.0), (1.0, 4000.0), (2.0, 4000.0)), speed_profile=((0.0, 0.0), (2.0, 0.0)))
    r = acausal.simulate(scene, parameters={"gap": 0.0}, stop_time=2.0, tolerance=1e-8)
    assert r.final("drill.s") == pytest.approx(4000.0 / 1e8, rel=1e-6)
    assert r.final("drill.thrust") == pytest.approx(4000.0, rel=1e-6)
    area = math.pi / 4 * (2 * math.tan(math.radians(59.0)) * 4e-5) ** 2
    assert r.final("drill.force.F_i") == pytest.approx(2e9 * area, rel=1e-2)
