"""First touch, pressing without rotation, release, breakthrough: the contact force against a hand-written drill."""

from __future__ import annotations

import numpy as np
import pytest

import acausal
from acausal.models.drilling_dynamic import FORCE, SPEED, ThickBlock
from tests.accuracy.drilling_reference import PlainDrilling, Profile
from tests.accuracy.drilling_scenes import SeriesOfFigure2, TwoBodies
from tests.marks import slow_but

TURNING = ((0.0, 9.28), (99.0, 9.28))
STANDING = ((0.0, 0.0), (99.0, 0.0))


def compare(force: Profile, speed: Profile, times: list[float], *, atol: float = 2e-9, **values: float) -> None:
    """Depths of ThickBlock with these profiles against PlainDrilling."""
    names = {"gap": "gap", "t": "workpiece.t", "m": "m"}
    scene = ThickBlock(force_profile=tuple(force), speed_profile=tuple(speed))
    parameters = {names[name]: value for name, value in values.items()}
    r = acausal.simulate(scene, parameters=parameters, stop_time=times[-1], tolerance=1e-8)
    expected = PlainDrilling(force, speed, **values).depths(times)
    # Relative where the drill flies through the air: 1e-7 of the metres it has come.
    np.testing.assert_allclose(r.at(times, "drill.s"), expected[:, 0], rtol=1e-7, atol=atol)
    np.testing.assert_allclose(r.at(times, "drill.s_tar"), expected[:, 2], rtol=1e-7, atol=atol)


@pytest.mark.parametrize("gap", slow_but([0.0, 1e-3, 5e-3], 0.0, 5e-3))
def test_touch_without_rotation_then_drilling(gap: float) -> None:
    compare(FORCE, SPEED, [1.5, 2.5, 4.0, 6.0, 8.0, 10.0], gap=gap)


@pytest.mark.parametrize("gap", slow_but([0.0, 1e-3, 5e-3], 0.0, 5e-3))
def test_touch_of_a_rotating_drill(gap: float) -> None:
    force = ((0.0, 0.0), (1.0, 1000.0), (99.0, 1000.0))
    compare(force, TURNING, [0.5, 1.0, 2.0, 5.0], gap=gap)


def test_pressing_without_rotation_only_compresses_the_contact() -> None:
    force = ((0.0, 0.0), (1.0, 3000.0), (99.0, 3000.0))
    scene = ThickBlock(force_profile=force, speed_profile=STANDING)
    r = acausal.simulate(scene, parameters={"gap": 0.0}, stop_time=3.0, tolerance=1e-8)
    # At rest the spring alone carries the force: s = F / k.
    assert r.final("drill.s") == pytest.approx(3000.0 / 1e8, abs=1e-9)
    assert r.final("drill.F_f") == pytest.approx(3000.0, abs=1e-2)
    np.testing.assert_allclose(r["drill.s_tar"], 0.0, atol=1e-15)


def test_release_keeps_the_hole_and_pressing_again_finds_its_ground() -> None:
    force = (
        (0.0, 1000.0),
        (3.0, 1000.0),
        (3.0, -50.0),
        (3.1, -50.0),
        (3.1, 20.0),
        (3.6, 20.0),
        (3.6, 1000.0),
        (9.0, 1000.0),
    )
    compare(force, TURNING, [2.0, 3.0, 3.1, 3.3, 3.6, 4.0, 6.0], gap=0.0, atol=1e-8)


def test_released_drill_feels_no_force() -> None:
    force = ((0.0, 1000.0), (3.0, 1000.0), (3.0, -50.0), (9.0, -50.0))
    scene = ThickBlock(force_profile=force, speed_profile=TURNING)
    r = acausal.simulate(scene, parameters={"gap": 0.0}, stop_time=3.2, tolerance=1e-8)
    away = (r.time > 3.01) & (r["drill.s"] < r["drill.s_tar"])
    assert away.sum() > 5
    np.testing.assert_array_equal(r["drill.F_f"][away], 0.0)
    # The ground never rises again, but for the last digit of 3 mm.
    assert np.all(np.diff(r["drill.s_tar"]) >= -1e-17)


def test_breakthrough_of_a_plate() -> None:
    # The drill surges when the last of the cut gives way, limited by its inertia alone.
    force = ((0.0, 2000.0), (99.0, 2000.0))
    compare(force, TURNING, [0.2, 0.5, 1.0, 1.5], gap=0.0, t=0.001)


def test_workpiece_that_slides_away() -> None:
    # Relative motion of two free bodies: one body of the reduced mass under the share of the force that reaches it.
    m_drill, m_work = 5.0, 20.0
    reduced = m_drill * m_work / (m_drill + m_work)
    force = ((0.0, 0.0), (1.0, 1000.0), (99.0, 1000.0))
    times = [0.5, 1.0, 2.0, 3.0]
    r = acausal.simulate(TwoBodies(force_profile=force), stop_time=3.0, tolerance=1e-8)
    share = [(t, F * reduced / m_drill) for t, F in force]
    expected = PlainDrilling(share, TURNING, m=reduced).depths(times)
    np.testing.assert_allclose(r.at(times, "drill.s"), expected[:, 0], rtol=0, atol=1e-8)
    # Newton's third law: together the bodies move as the outer force alone drives them.
    outer = 1000.0 * 0.5 + 1000.0 * 2.0
    momentum = m_drill * r.final("slide.v") + m_work * r.final("table.v")
    assert momentum == pytest.approx(outer, rel=1e-8)


def test_figure_2_of_the_paper_moves_like_the_drill_at_full_diameter() -> None:
    # The paper's Figure 2: spring and damper in series with the damper of the cut, F == K v_tar**(1-z).
    force = ((0.0, 500.0), (1.0, 500.0), (2.0, 2500.0), (4.0, 2500.0), (5.0, 800.0), (99.0, 800.0))
    values = {"gap": -0.01 - 500.0 / 1e8, "drill.s_start": 0.01, "drill.h_min": 1e-15}
    drill = acausal.simulate(
        ThickBlock(force_profile=force, speed_profile=TURNING), parameters=values, stop_time=6.0, tolerance=1e-9
    )
    plain = PlainDrilling(force, TURNING, h_min=1e-15)
    series = SeriesOfFigure2(
        force_profile=force, f_1=plain.law(0.016, 1e-3 / (2 * 9.28)), exponent=1 - 0.21, preload=500.0
    )
    figure = acausal.simulate(series, stop_time=6.0, tolerance=1e-9)
    times = np.linspace(0.0, 6.0, 61)
    np.testing.assert_allclose(drill.at(times, "drill.s") - 0.01, figure.at(times, "mass.s"), rtol=0, atol=2e-9)
    np.testing.assert_allclose(drill.at(times, "drill.F_f"), figure.at(times, "cut.f"), rtol=0, atol=1e-3)


@pytest.mark.parametrize(("as_printed", "damped"), [(False, 0.0), (True, 1.0)])
def test_offset_of_the_two_forms_of_the_contact_force(as_printed: bool, damped: float) -> None:
    # At a steady feed v: k (s - s_tar) == F by equation (20), == F - d_c v by equation (21) as printed.
    F = 3000.0
    force = ((0.0, F), (99.0, F))
    scene = ThickBlock(force_profile=force, speed_profile=TURNING, as_printed=as_printed)
    values = {"gap": -0.01 - F / 1e8, "drill.s_start": 0.01}
    r = acausal.simulate(scene, parameters=values, stop_time=1.0, tolerance=1e-8)
    v = 2 * 9.28 * PlainDrilling(force, TURNING).inverse(0.016, F)
    expected = (F - damped * 2e4 * v) / 1e8
    assert r.final("drill.s") - r.final("drill.s_tar") == pytest.approx(expected, abs=1e-10)
    assert r.final("drill.geometry.v") == pytest.approx(v, rel=1e-6)


@pytest.mark.parametrize("solver", ["rosenbrock", "cvodes"])
def test_other_solvers_drill_the_same_hole(solver: str) -> None:
    r = acausal.simulate(ThickBlock(), tolerance=1e-8, solver=solver)
    times = [1.5, 6.0, 10.0, 20.0, 30.0, 40.0]
    expected = PlainDrilling(FORCE, SPEED).depths(times)
    np.testing.assert_allclose(r.at(times, "drill.s"), expected[:, 0], rtol=0, atol=2e-9)
