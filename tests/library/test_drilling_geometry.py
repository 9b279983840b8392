"""Depth, diameters and rotation of a drill against a plate, in poses where the answer is elementary geometry."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

import acausal
from acausal.models.drilling_kinematic import ThinPlate
from acausal.result.result import Result
from tests.accuracy.drilling_scenes import TiltedDrill

SLOPE = 2 * math.tan(math.radians(59.0))
H_C = 0.016 / SLOPE
PLACE = np.array([0.003, -0.004, -0.001])
TILT = math.radians(20.0)


def tip_and_axis(t: NDArray[np.float64], v: float = 1.672e-3) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """World position of the tip (n, 3) and drill axis: z turned about x by TILT."""
    axis = np.array([0.0, -math.sin(TILT), math.cos(TILT)])
    return PLACE + np.outer(v * t, axis), axis


@pytest.mark.parametrize("t", [1e-3, 4e-3, 9e-3])
def test_diameters_follow_the_cone_through_the_plate(t: float) -> None:
    # Where the cone, radius (s - x) tan(kappa) at depth x behind the face, cuts the two faces; at most d.
    r = acausal.simulate(ThinPlate(), parameters={"workpiece.t": t})
    s = r["drill.s"]
    np.testing.assert_allclose(r["drill.d_O"], np.minimum(SLOPE * np.maximum(s, 0), 0.016), atol=1e-12)
    np.testing.assert_allclose(r["drill.d_I"], np.minimum(SLOPE * np.maximum(s - t, 0), 0.016), atol=1e-12)
    assert r.final("drill.d_I") == pytest.approx(min(SLOPE * (1.672e-2 - t), 0.016))


def test_tip_stands_ahead_of_the_frame_by_the_length_of_the_drill() -> None:
    r = acausal.simulate(ThinPlate(), parameters={"drill.length": 0.1}, stop_time=1.0)
    np.testing.assert_allclose(r["drill.s"], 0.1 + 1.672e-3 * r.time, rtol=1e-12)


def test_depth_of_a_tilted_drill_is_measured_along_its_axis() -> None:
    r = acausal.simulate(TiltedDrill(tilt=TILT), stop_time=6.0)
    tip, axis = tip_and_axis(r.time)
    # From the tip back along the axis to the face z = 0.
    depth = tip[:, 2] / axis[2]
    np.testing.assert_allclose(r["drill.s"], depth, atol=1e-9)
    np.testing.assert_allclose(r["drill.geometry.v"], 1.672e-3, rtol=1e-9)
    # The plate is thicker along a tilted axis.
    expected = np.clip(SLOPE * (depth - 1e-3 / axis[2]), 0.0, 0.016)
    np.testing.assert_allclose(r["drill.d_I"], expected, atol=1e-8)


def test_plate_that_comes_towards_the_drill() -> None:
    r = acausal.simulate(TiltedDrill(tilt=TILT), parameters={"v_plate": -1e-3}, stop_time=3.0)
    tip, axis = tip_and_axis(r.time)
    np.testing.assert_allclose(r["drill.s"], (tip[:, 2] + 1e-3 * r.time) / axis[2], atol=1e-9)
    np.testing.assert_allclose(r["drill.geometry.v"], 1.672e-3 + 1e-3 / axis[2], rtol=1e-8)


def test_rotation_is_that_of_the_drill_against_the_plate_about_the_drill_axis() -> None:
    r = acausal.simulate(TiltedDrill(tilt=TILT), parameters={"n_plate": 2.0}, stop_time=1.0)
    # The table turns about z; its share along the drill axis is the cosine of the tilt.
    np.testing.assert_allclose(r["drill.n"], 9.28 - 2.0 * math.cos(TILT), rtol=1e-9)


def test_plate_that_turns_about_its_normal_changes_no_depth() -> None:
    r = acausal.simulate(TiltedDrill(tilt=TILT), parameters={"n_plate": 0.2}, stop_time=3.0, tolerance=1e-9)
    tip, axis = tip_and_axis(r.time)
    np.testing.assert_allclose(r["drill.s"], tip[:, 2] / axis[2], atol=1e-8)


@pytest.mark.parametrize(("x", "beside"), [(0.049, False), (0.051, True), (-0.051, True)])
def test_drill_beside_the_plate_cuts_nothing(x: float, beside: bool) -> None:
    # The plate is 100 mm wide.
    r = acausal.simulate(TiltedDrill(tilt=0.0, place=(x, 0.0, -0.001)), stop_time=3.0)
    # rows between mesh points are interpolated: zero to rounding of forces of some kN and of depths of some mm
    assert bool(r["drill.F_c"].max() < 1e-9) is beside
    assert bool(r["drill.d_O"].max() < 1e-15) is beside
    assert bool(r["drill.s"].max() < 1e-15) is beside


def test_drill_tilted_beyond_the_limit_does_not_cut() -> None:
    r = acausal.simulate(TiltedDrill(tilt=math.radians(70.0)), stop_time=6.0)
    assert r["drill.F_c"].max() == 0.0


def resultants(r: Result, part: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """World force and moment about the world's origin that the drilling force takes from the bodies of a frame."""
    R, r_0 = r[f"{part}.R"], r[f"{part}.r_0"]
    f = np.einsum("tij,tj->ti", R, r[f"{part}.f"])
    t = np.einsum("tij,tj->ti", R, r[f"{part}.t"])
    return f, t + np.cross(r_0, f)


def test_forces_on_drill_and_workpiece_are_opposite_and_their_moments_too() -> None:
    values = {"v_plate": -1e-3, "n_plate": 0.3}
    r = acausal.simulate(TiltedDrill(tilt=TILT), parameters=values, stop_time=3.0)
    f_a, t_a = resultants(r, "drill.frame_a")
    f_w, t_w = resultants(r, "drill.frame_w")
    assert np.abs(f_a).max() > 500.0
    np.testing.assert_allclose(f_a + f_w, 0.0, atol=1e-7)
    np.testing.assert_allclose(t_a + t_w, 0.0, atol=1e-8)


def test_feed_force_is_along_the_drill_axis_and_the_torque_brakes_the_drill() -> None:
    r = acausal.simulate(TiltedDrill(tilt=TILT), stop_time=3.0)
    _, axis = tip_and_axis(r.time)
    f_a, _ = resultants(r, "drill.frame_a")
    # What flows into the drilling force at the drill is what the drill gives: forward along its axis.
    np.testing.assert_allclose(f_a, np.outer(r["drill.F_f"], axis), atol=1e-7)
    # Turned by the spindle against the torque of the cut.
    np.testing.assert_allclose(r["spindle.tau"], r["drill.torque"], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(r["slide.f"], r["drill.F_f"], rtol=1e-9, atol=1e-7)
