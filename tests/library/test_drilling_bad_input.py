"""Scenes that cannot be meant end with a code and the name of the part."""

from __future__ import annotations

import math

import pytest

import acausal
from acausal.errors import AcausalError
from acausal.library.drilling import DrillBody, FullDrillingForce, Workpiece
from acausal.models.drilling_control import ForceControlledDrilling
from acausal.models.drilling_dynamic import ThickBlock
from tests.expected import fails_with


@pytest.mark.parametrize("t", [0.0, -0.01])
def test_a_plate_without_thickness_is_refused_with_its_name(t: float) -> None:
    with fails_with(AcausalError, "AC136", "workpiece.t"):
        acausal.simulate(ThickBlock(), parameters={"workpiece.t": t})
    with fails_with(AcausalError, "AC136"):
        acausal.simulate(ForceControlledDrilling(), parameters={"t_2": t})


@pytest.mark.parametrize(("name", "value"), [("d", math.inf), ("d", 0.0), ("sigma", 0.0), ("h_min", math.inf)])
def test_a_drill_that_is_none_is_refused_with_its_name(name: str, value: float) -> None:
    """Each of them drilled without any force, or with that of a flat face as wide as the world."""
    with fails_with(AcausalError, "AC136", f"drill.{name} = {value:g}"):
        acausal.simulate(ThickBlock(), parameters={f"drill.{name}": value})


@pytest.mark.parametrize(
    ("name", "value", "remedy"), [("d", 8e-3, "tool"), ("k", 1e7, "k=..."), ("t", 0.01, "WorkpieceBody")]
)
def test_settings_of_a_drill_cannot_contradict_the_bodies_of_its_scene(name: str, value: float, remedy: str) -> None:
    """A `d` of 8 mm cut the force in half, while shape and holes of the scene were those of a drill of 16 mm."""
    with fails_with(AcausalError, "AC173", name) as caught:
        DrillBody(name="drill", settings=((name, value),))
    assert remedy in (caught.value.help or "")


def test_an_exponent_without_a_solution_is_refused_with_its_name() -> None:
    """Instead of a run that ends at its touch, after minutes."""
    for model, values in ((ThickBlock(), {"drill.z": 0.61}), (ForceControlledDrilling(), {"z": 0.7})):
        with pytest.raises(AcausalError) as caught:
            acausal.simulate(model, parameters=values)
        assert "the exponent z of the cutting force is above 0.6" in str(caught.value)


def test_a_plate_without_thickness_in_a_constructor() -> None:
    class Flat(ThickBlock):
        """The scene with a plate of a thickness of its own."""

        def build(self) -> None:
            super().build()
            self.workpiece = Workpiece(t=0.0)
            self.drill = FullDrillingForce(t=self.workpiece.t, k=1e8, d_c=2e4)

    with fails_with(AcausalError, "AC136", "workpiece.t = 0 m is outside its limits"):
        acausal.simulate(Flat())


@pytest.mark.parametrize("values", [{"gap": -5e-3}, {"gap": -0.01, "drill.s_start": 5e-3}])
def test_a_drill_that_starts_inside_of_the_material_is_refused_with_its_name(values: dict[str, float]) -> None:
    with pytest.raises(AcausalError) as caught:
        acausal.simulate(ThickBlock(), parameters=values)
    error = caught.value
    assert error.code == "AC503"
    assert "the drill starts inside workpiece" in error.fact
    assert "an assertion of the model in drill does not hold" in error.evidence


def test_it_is_the_second_plate_that_the_drill_is_in() -> None:
    values = {"gap": -14e-3, "drills[0].s_start": 14e-3}
    with pytest.raises(AcausalError) as caught:
        acausal.simulate(ForceControlledDrilling(), parameters=values)
    assert "drills[1]" in caught.value.evidence[0]


@pytest.mark.parametrize("values", [{"gap": -1e-5}, {"gap": -0.01, "drill.s_start": 0.01}, {"gap": 0.0}])
def test_a_drill_that_starts_in_contact_or_in_its_hole_is_fine(values: dict[str, float]) -> None:
    r = acausal.simulate(ThickBlock(), parameters=values, stop_time=0.1)
    assert r.time[-1] == 0.1
    assert r["drill.F_f"].min() >= 0.0  # the work pushes, it never pulls


def test_a_soft_contact_may_be_pressed_in_far() -> None:
    # 1e5 N/m under 500 N: 5 mm, and no mistake.
    r = acausal.simulate(ThickBlock(), parameters={"gap": -5e-3, "drill.k": 1e5}, stop_time=0.1)
    assert r["drill.F_f"][0] == pytest.approx(500.0, rel=1e-6)


@pytest.mark.parametrize("name", ["drill.h_min", "drill.force.w_min", "drill.force.omega_1"])
def test_what_is_divided_by_is_refused_by_name_where_it_is_zero(name: str) -> None:
    with fails_with(AcausalError, "AC136", f"{name} = 0 "):
        acausal.simulate(ThickBlock(), parameters={name: 0.0}, stop_time=2.0)


@pytest.mark.parametrize(("values", "is_told"), [({}, True), ({"drill.feed_force_factor": 1.0}, False)])
def test_a_flat_drill_that_the_printed_factor_lets_fall_is_told(values: dict[str, float], is_told: bool) -> None:
    """Equation (8) of the paper, F_f = F_c sin(sigma), is zero at 180 degrees."""
    r = acausal.simulate(ThickBlock(), parameters={"drill.sigma": math.pi, **values}, stop_time=2.0)
    assert any("AC196" in note for note in r.stats["notes"]) == is_told  # type: ignore[attr-defined]
