"""The two scenes of the founding paper against numbers computed apart from this project, to their last digit.

Tables: docs/drilling.md. They were computed from the paper's equations with a bare CasADi integration.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

import acausal
from acausal.models.drilling_dynamic import FORCE, SPEED, ThickBlock
from acausal.models.drilling_kinematic import ThinPlate
from acausal.result.result import Result
from tests.accuracy.drilling_reference import PlainDrilling

SIN_SIGMA = math.sin(math.radians(118.0))
SIN_KAPPA = math.sin(math.radians(59.0))
H_C = 0.016 / (2 * math.tan(math.radians(59.0)))

# Columns: time in s; s, d_O, d_I in mm; F_c, F_f in N; M in N.m.
THIN_PLATE = [
    (0.5, 0.8360, 2.7827, 0.0, 961.495, 848.949, 0.6689),
    (1.0, 1.6720, 5.5654, 2.2368, 1150.113, 1015.490, 2.2433),
    (2.5, 4.1800, 13.9134, 10.5848, 1150.113, 1015.490, 7.0439),
    (3.0, 5.0160, 16.0, 13.3675, 909.607, 803.135, 6.6782),
    (3.5, 5.8520, 16.0, 16.0, 0.0, 0.0, 0.0),
]

# Columns: time in s; s, s_tar in mm; F_f, F_c in N; d_O in mm; k_c in N/mm2; M in N.m.
THICK_BLOCK = [
    (1.5, 0.009996, 0.0, 1000.000, 1132.570, 0.03327, math.nan, 0.0094),
    (6.0, 1.935942, 1.915942, 2000.001, 2265.141, 6.44390, 3818.056, 3.6491),
    (10.0, 5.117238, 5.097238, 2000.000, 2265.140, 16.0, 4862.222, 9.0606),
    (20.0, 10.521275, 10.501275, 2000.000, 2265.140, 16.0, 4862.222, 9.0606),
    (30.0, 21.779535, 21.739535, 4000.000, 4530.280, 16.0, 4044.028, 18.1211),
    (40.0, 24.738360, 24.733360, 500.000, 566.285, 16.0, 7028.717, 2.2651),
]


@pytest.fixture(scope="module")
def thin_plate() -> Result:
    return acausal.simulate(ThinPlate())


@pytest.fixture(scope="module")
def thick_block() -> Result:
    return acausal.simulate(ThickBlock(), tolerance=1e-8)


@pytest.mark.parametrize("row", THIN_PLATE, ids=lambda row: f"{row[0]}s")
def test_thin_plate_follows_the_table(thin_plate: Result, row: tuple[float, ...]) -> None:
    t, *expected = row
    names = ["drill.s", "drill.d_O", "drill.d_I", "drill.F_c", "drill.F_f", "drill.torque"]
    found = [thin_plate.at(t, name) for name in names]
    # half a unit of the last printed digit
    digits = [5e-8, 5e-8, 5e-8, 5e-4, 5e-4, 5e-5]
    for name, value, given, digit in zip(names, found, expected, digits, strict=True):
        scale = 1e-3 if digit == 5e-8 else 1.0
        assert value == pytest.approx(given * scale, abs=1.01 * digit), name


def test_thin_plate_agrees_with_the_closed_form(thin_plate: Result) -> None:
    # Equations (1) to (10) with the exact diameters, in numpy.
    t = thin_plate.time
    s = 1.672e-3 * t
    slope = 2 * math.tan(math.radians(59.0))
    d_O = slope * np.clip(s, 0, H_C)
    d_I = slope * np.clip(s - 1e-3, 0, H_C)
    f_z = 1.672e-3 / 9.28 / 2
    k_c = 2240e6 * (f_z * SIN_KAPPA / 1e-3) ** -0.21
    F_c = (d_O - d_I) * f_z * k_c
    np.testing.assert_allclose(thin_plate["drill.s"], s, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(thin_plate["drill.F_c"], F_c, rtol=1e-9, atol=1e-8)
    np.testing.assert_allclose(thin_plate["drill.F_f"], SIN_SIGMA * F_c, rtol=1e-9, atol=1e-8)
    np.testing.assert_allclose(thin_plate["drill.torque"], F_c * (d_O + d_I) / 4, rtol=1e-9, atol=1e-10)
    np.testing.assert_allclose(thin_plate["drill.k_c"], k_c, rtol=1e-12)


def test_full_diameter_of_the_kinematic_example() -> None:
    r = acausal.simulate(ThinPlate(), parameters={"workpiece.t": 0.1}, stop_time=5.0)
    assert r.final("drill.f_z") == pytest.approx(0.0900862069e-3, rel=1e-9)
    assert r.final("drill.k_c") == pytest.approx(3835.5354e6, rel=2e-8)
    assert r.final("drill.F_c") == pytest.approx(5528.461, rel=1e-7)
    assert r.final("drill.F_f") == pytest.approx(4881.342, rel=1e-7)
    assert r.final("drill.torque") == pytest.approx(22.1138, rel=3e-6)


def test_the_one_force_of_the_paper_that_its_equations_give(thin_plate: Result) -> None:
    # "986 N" for a plate of 1 mm is F_c sin(sigma / 2); the paper prints sin(sigma) in equation (8).
    factor = {"drill.feed_force_factor": SIN_KAPPA}
    r = acausal.simulate(ThinPlate(), parameters=factor, stop_time=2.0)
    assert r.final("drill.F_f") == pytest.approx(985.84, abs=5e-3)


@pytest.mark.parametrize("row", THICK_BLOCK, ids=lambda row: f"{row[0]}s")
def test_thick_block_follows_the_table(thick_block: Result, row: tuple[float, ...]) -> None:
    t, s, s_tar, F_f, F_c, d_O, k_c, torque = row
    assert thick_block.at(t, "drill.s") == pytest.approx(s * 1e-3, abs=1e-9)
    assert thick_block.at(t, "drill.s_tar") == pytest.approx(s_tar * 1e-3, abs=1e-9)
    assert thick_block.at(t, "drill.F_f") == pytest.approx(F_f, abs=2e-3)
    assert thick_block.at(t, "drill.F_c") == pytest.approx(F_c, abs=2e-3)
    assert thick_block.at(t, "drill.d_O") == pytest.approx(d_O * 1e-3, abs=1e-8)
    assert thick_block.at(t, "drill.torque") == pytest.approx(torque, abs=1e-4)
    if not math.isnan(k_c):
        assert thick_block.at(t, "drill.k_c") == pytest.approx(k_c * 1e6, rel=1e-6)


def test_thick_block_is_the_hand_written_drill_at_every_second(thick_block: Result) -> None:
    times = [float(t) for t in range(1, 41)]
    reference = PlainDrilling(FORCE, SPEED).depths(times)
    np.testing.assert_allclose(thick_block.at(times, "drill.s"), reference[:, 0], rtol=0, atol=2e-9)
    np.testing.assert_allclose(thick_block.at(times, "drill.s_tar"), reference[:, 2], rtol=0, atol=2e-9)


def test_feed_force_is_the_factor_times_the_cutting_force(thick_block: Result) -> None:
    np.testing.assert_allclose(thick_block["drill.F_f"], SIN_SIGMA * thick_block["drill.F_c"], rtol=1e-12, atol=1e-12)


# F in N, f_z in mm, v in mm/s, k_c in N/mm2, at n = 9.28 1/s.
@pytest.mark.parametrize(
    ("F", "f_z", "v", "k_c"),
    [(1000.0, 0.012108, 0.224733, 5845.95), (3000.0, 0.048645, 0.902856, 4365.42), (100.0, None, 0.013749, 9555.38)],
)
def test_steady_feed_under_a_constant_force(F: float, f_z: float | None, v: float, k_c: float) -> None:
    scene = ThickBlock(force_profile=((0.0, F), (10.0, F)), speed_profile=((0.0, 9.28), (10.0, 9.28)))
    # The drill stands in a hole 10 mm deep: full diameter from the start.
    r = acausal.simulate(scene, parameters={"gap": -0.01, "drill.s_start": 0.01}, stop_time=2.0, tolerance=1e-8)
    plain = PlainDrilling(FORCE, SPEED)
    exact = plain.inverse(0.016, F)
    assert r.final("drill.f_z") == pytest.approx(exact, rel=1e-6)
    assert r.final("drill.geometry.v") == pytest.approx(2 * 9.28 * exact, rel=1e-6)
    assert r.final("drill.geometry.v") * 1e3 == pytest.approx(v, abs=1e-6)
    assert r.final("drill.k_c") == pytest.approx(k_c * 1e6, rel=2e-6)
    if f_z is not None:
        assert r.final("drill.f_z") * 1e3 == pytest.approx(f_z, abs=1e-6)


@pytest.mark.parametrize("t", [0.006, 0.012])
def test_time_to_drill_through_a_plate(t: float) -> None:
    # Quasi-static feed v(w) = v(d) (d/w)**p, p = 1/(1-z), integrated over the depth; a light drill has little inertia.
    F = 2000.0
    scene = ThickBlock(force_profile=((0.0, F), (99.0, F)), speed_profile=((0.0, 9.28), (99.0, 9.28)))
    v = 2 * 9.28 * PlainDrilling(FORCE, SPEED).inverse(0.016, F)
    expected = (t - H_C) / v + 2 * H_C / ((1 + 1 / 0.79) * v)
    values = {"gap": 0.0, "workpiece.t": t, "m": 0.1}
    r = acausal.simulate(scene, parameters=values, stop_time=expected + 0.01, tolerance=1e-8, output_interval=1e-3)
    through = np.interp(t + H_C, r["drill.s"], r.time)
    assert through == pytest.approx(expected, abs=1e-3)


@pytest.mark.parametrize("D", [6.0, 10.0, 20.0])
@pytest.mark.parametrize("f", [0.1, 0.2, 0.3])
def test_drilling_forces_of_a_tool_catalogue(D: float, f: float) -> None:
    # Tungaloy General Catalogue 2020-2021, p. L068: thrust 570 K D f**0.85 N, torque K D**2 (0.63 + 16.84 f)/100 N.m,
    # D in mm, f in mm per revolution; K is 2.10 for SCM430 and 2.41 for SCM440, and 34CrMo4 lies between them.
    n = 10.0
    values = {
        "drill.d": D * 1e-3,
        "n": n,
        "v": f * 1e-3 * n,
        "workpiece.t": 1.0,
        "drill.feed_force_factor": SIN_KAPPA,
    }
    r = acausal.simulate(ThinPlate(), parameters=values, stop_time=math.ceil(H_C * D / 16 / (f * 1e-3 * n)) + 4.0)
    for K in (2.10, 2.41):
        thrust = 570 * K * D * f**0.85
        torque = K * D**2 * (0.630 + 16.84 * f) / 100
        assert 0.895 < r.final("drill.F_f") / thrust < 1.12
        assert 0.895 < r.final("drill.torque") / torque < 1.12
