"""What the drilling library promises apart from numbers: records, defaults, dimensions, structure."""

from __future__ import annotations

import math

import pytest

import acausal
from acausal.library import drilling
from acausal.library.drilling import (
    STEEL_34CRMO4,
    TWIST_DRILL_16MM,
    DrillContactForce,
    DrillDepthCalculation,
    DrillGeometry,
    DrillingForce,
    Material,
    Tool,
)
from acausal.models.drilling_dynamic import ThickBlock
from acausal.models.drilling_kinematic import ThinPlate


def test_every_material_and_tool_names_its_source() -> None:
    records = [value for value in vars(drilling).values() if isinstance(value, Material | Tool)]
    assert STEEL_34CRMO4 in records
    assert TWIST_DRILL_16MM in records
    assert all(len(record.source) > 20 for record in records)


def test_material_of_the_paper() -> None:
    # Section 3.1: k_c1.1 = 2240 N/mm2, z = 0.21.
    assert (STEEL_34CRMO4.k_c11, STEEL_34CRMO4.z) == (2240e6, 0.21)


def test_drilling_force_is_composed_of_the_three_blocks_of_figure_3() -> None:
    parts = {type(part) for part in DrillingForce(t=0.05, k=1e8, d_c=2e4)._parts.values()}
    assert {DrillGeometry, DrillDepthCalculation, DrillContactForce} <= parts
    assert {part.__name__ for part in parts} == {"Frame", "DrillGeometry", "DrillDepthCalculation", "DrillContactForce"}


def test_tool_and_material_give_the_defaults_and_single_numbers_override_them() -> None:
    softer = Material(name="test", k_c11=1000e6, z=0.3, source="a made-up material of this test")
    values = {"drill.k_c11": 1500e6}
    scene = ThinPlate()
    assert acausal.simulate(scene, stop_time=0.1).final("drill.k_c") > 2240e6
    assert acausal.simulate(scene, stop_time=0.1, parameters=values).final("drill.k_c") == pytest.approx(
        1500e6 * (1.672e-3 / 9.28 / 2 * math.sin(math.radians(59.0)) / 1e-3) ** -0.21
    )
    part = DrillingForce(t=0.05, k=1e8, d_c=2e4, material=softer)
    assert part.material is softer


def test_feed_force_factor_follows_the_point_angle_unless_it_is_given() -> None:
    def ratio(**values: float) -> float:
        names = {f"drill.{name}": value for name, value in values.items()}
        r = acausal.simulate(ThinPlate(), parameters=names, stop_time=1.0)
        return float(r.final("drill.F_f") / r.final("drill.F_c"))

    assert ratio() == pytest.approx(math.sin(math.radians(118.0)))
    assert ratio(sigma=math.radians(130.0)) == pytest.approx(math.sin(math.radians(130.0)))
    assert ratio(feed_force_factor=0.5) == pytest.approx(0.5)


def test_specific_cutting_force_stays_finite_at_vanishing_feed() -> None:
    # k_c11 (h_min / 1 mm)**-z = 9555.38 N/mm2 at 1 um.
    r = acausal.simulate(ThinPlate(), parameters={"v": 1e-9}, stop_time=0.1)
    assert r.final("drill.k_c") == pytest.approx(9555.38e6, rel=1e-6)


def test_withdrawn_drill_has_no_cutting_force() -> None:
    r = acausal.simulate(ThinPlate(), parameters={"v": -1e-3}, stop_time=0.5)
    assert r["drill.F_c"].max() == 0.0


@pytest.mark.parametrize("model", [ThinPlate, ThickBlock])
def test_columns_that_other_programs_rely_on(model: type[ThinPlate | ThickBlock]) -> None:
    r = acausal.simulate(model(), stop_time=0.1)
    units = {"s": "m", "d_O": "m", "d_I": "m", "F_c": "N", "F_f": "N", "k_c": "Pa", "torque": "N.m"}
    if model is ThickBlock:
        units |= {"s_tar": "m", "f_z": "m", "v_tar": "m/s"}
    for name, unit in units.items():
        assert r.unit(f"drill.{name}") == unit
