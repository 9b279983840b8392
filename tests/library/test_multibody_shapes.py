"""Bodies whose mass and inertia follow from a shape, and what is no inertia, no rotation and no joint."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import acausal
from acausal import Component, Equations, Real, connect, fixed, parameter, part
from acausal.errors import DeclarationError
from acausal.flatten.flat import FlatSystem
from acausal.library.multibody import (
    Body,
    BodyBox,
    BodyCylinder,
    BodyShape,
    FixedRotation,
    Revolute,
    Universal,
    World,
    axis_rotation,
)
from tests.expected import fails_with

Array = np.ndarray[Any, np.dtype[np.float64]]
G = 9.80665


class Arm(Component):
    """A body that hangs from the world, on a revolute joint about z."""

    world: World = World(n=(0.0, -1.0, 0.0))
    revolute: Revolute = Revolute(n=(0.0, 0.0, 1.0), phi=fixed(0.0), w=fixed(0.0))
    body: BodyBox | BodyCylinder | BodyShape | Body = part()

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.revolute.frame_a)
        yield connect(self.revolute.frame_b, self.body.frame_a)


def values(flat: FlatSystem, path: str) -> Array:
    found = next(p for p in flat.parameters if p.path == path)
    return np.array([flat.pool.parameter_value(n, flat.parameter_values) for n in found.nodes])


def frame(along: Array, beside: Array) -> Array:
    """Columns: along, the direction nearest to `beside` that is perpendicular, and the third."""
    x = along / np.linalg.norm(along)
    z = np.cross(x, beside)
    z = z / np.linalg.norm(z)
    return np.column_stack([x, np.cross(z, x), z])


def msl_cylinder(length: float, d: float, inner: float, density: float, along: Array) -> tuple[float, Array]:
    """Mass and tensor of Modelica.Mechanics.MultiBody.Parts.BodyCylinder (MSL 4.0.0), outer less inner cylinder."""
    r, ri = d / 2, inner / 2
    mo, mi = density * math.pi * length * r**2, density * math.pi * length * ri**2
    across = (mo * (length**2 + 3 * r**2) - mi * (length**2 + 3 * ri**2)) / 12
    R = frame(along, np.array([0.3, -0.7, 0.2]))
    return mo - mi, R @ np.diag([(mo * r**2 - mi * ri**2) / 2, across, across]) @ R.T


def msl_box(
    length: float, w: float, h: float, iw: float, ih: float, density: float, along: Array, beside: Array
) -> tuple[float, Array]:
    """The same of BodyBox."""
    mo, mi = density * length * w * h, density * length * iw * ih
    moments = [
        mo * (w**2 + h**2) - mi * (iw**2 + ih**2),
        mo * (length**2 + h**2) - mi * (length**2 + ih**2),
        mo * (length**2 + w**2) - mi * (length**2 + iw**2),
    ]
    R = frame(along, beside)
    return mo - mi, R @ np.diag(moments) @ R.T / 12


def check(body: BodyBox | BodyCylinder, mass: float, tensor: Array, centre: Array) -> None:
    """Mass and tensor, and the centre by the first acceleration of a pendulum: Steiner about the axis z."""
    arm = Arm(body=body)
    flat = acausal.flatten(arm)
    found = values(flat, "body.tensor").reshape(3, 3)
    assert values(flat, "body.m")[0] == pytest.approx(mass, rel=1e-12)
    assert np.abs(found - tensor).max() <= 1e-12 * np.abs(tensor).max()
    assert np.linalg.eigvalsh(found)[0] > 0.0
    about_axis = tensor[2, 2] + mass * (centre[0] ** 2 + centre[1] ** 2)
    result = acausal.simulate(arm, stop_time=1e-3)
    assert result.at(0.0, "revolute.a") == pytest.approx(-mass * G * centre[0] / about_axis, rel=1e-9)


@pytest.mark.parametrize("seed", range(4))
def test_cylinder_of_any_length_and_place(seed: int) -> None:
    random = np.random.default_rng(seed)
    r, start, along = random.normal(size=(3, 3))
    length, d = random.uniform(0.1, 2.0, 2)
    inner = d * random.uniform(0.0, 0.95)
    body = BodyCylinder(
        r=r.tolist(),
        r_shape=start.tolist(),
        length_direction=along.tolist(),
        length=length,
        diameter=d,
        inner_diameter=inner,
    )
    mass, tensor = msl_cylinder(length, d, inner, 7700.0, along)
    check(body, mass, tensor, start + along / np.linalg.norm(along) * length / 2)


@pytest.mark.parametrize("seed", range(4))
def test_box_of_any_length_and_place(seed: int) -> None:
    random = np.random.default_rng(seed + 100)
    r, start, along, beside = random.normal(size=(4, 3))
    length, w, h = random.uniform(0.1, 2.0, 3)
    iw, ih = w * random.uniform(0.0, 0.95), h * random.uniform(0.0, 0.95)
    body = BodyBox(
        r=r.tolist(),
        r_shape=start.tolist(),
        length_direction=along.tolist(),
        length=length,
        width=w,
        height=h,
        inner_width=iw,
        inner_height=ih,
        width_direction=tuple(beside),
        density=2700.0,
    )
    mass, tensor = msl_box(length, w, h, iw, ih, 2700.0, along, beside)
    check(body, mass, tensor, start + along / np.linalg.norm(along) * length / 2)


def test_length_other_than_the_way_between_the_frames() -> None:
    """A rod of 0.3 m with frames 1 m apart: its direction is the way between them, its tensor that of 0.3 m."""
    r = np.array([0.6, 0.8, 0.0])
    mass, tensor = msl_cylinder(0.3, 0.1, 0.0, 7700.0, r)
    check(BodyCylinder(r=r.tolist(), length=0.3, diameter=0.1), mass, tensor, r * 0.15)
    mass, tensor = msl_box(0.3, 0.1, 0.2, 0.0, 0.0, 7700.0, r, np.array([0.0, 0.0, 1.0]))
    body = BodyBox(r=r.tolist(), length=0.3, width=0.1, height=0.2, width_direction=(0.0, 0.0, 1.0))
    check(body, mass, tensor, r * 0.15)


def test_line_from_the_shape_to_frame_b() -> None:
    """Without a length the shape runs from r_shape to r, as in Modelica."""
    r, start = np.array([0.5, 0.2, -0.1]), np.array([0.1, -0.3, 0.2])
    mass, tensor = msl_cylinder(float(np.linalg.norm(r - start)), 0.1, 0.06, 7700.0, r - start)
    check(
        BodyCylinder(r=r.tolist(), r_shape=start.tolist(), diameter=0.1, inner_diameter=0.06),
        mass,
        tensor,
        (r + start) / 2,
    )


def test_thin_tube_of_a_given_mass() -> None:
    """A wall without thickness, m = 2 kg, R = 0.1 m, l = 0.6 m: m R^2 along, m (6 R^2 + l^2) / 12 across."""
    flat = acausal.flatten(Arm(body=BodyCylinder(r=(0.6, 0.0, 0.0), diameter=0.2, inner_diameter=0.2, m=2.0)))
    across = 2.0 * (6 * 0.1**2 + 0.6**2) / 12
    assert values(flat, "body.tensor") == pytest.approx(np.diag([0.02, across, across]).ravel(), rel=1e-12)


def test_flat_disc_of_a_given_mass() -> None:
    """A cylinder of length 0, m = 2 kg, R = 0.1 m: m R^2 / 2 along, m R^2 / 4 across."""
    flat = acausal.flatten(Arm(body=BodyCylinder(r=(0.6, 0.0, 0.0), length=0.0, diameter=0.2, m=2.0)))
    assert values(flat, "body.tensor") == pytest.approx(np.diag([0.01, 0.005, 0.005]).ravel(), rel=1e-12)


BOX: dict[str, Any] = {"width": 0.1, "width_direction": (0.0, 1.0, 0.0)}


@pytest.mark.parametrize(
    ("body", "words"),
    [
        (BodyCylinder(r=(0.0, 0.0, 0.0), diameter=0.1, length=0.2), "no direction"),
        (BodyCylinder(r=(1.0, 0.0, 0.0), diameter=0.1, length=0.0), "length is 0"),
        (BodyCylinder(r=(0.0, 0.0, 0.0), length_direction=(1.0, 0.0, 0.0), diameter=0.1), "length is 0"),
        (BodyBox(r=(1.0, 0.0, 0.0), length=0.0, **BOX), "length is 0"),
        (BodyCylinder(r=(1.0, 0.0, 0.0), diameter=0.1, inner_diameter=0.2, m=1.0), "wider than the cylinder"),
        (BodyBox(r=(0.0, 1.0, 0.0), **BOX), "parallel to the length"),
        (BodyBox(r=(1.0, 0.0, 0.0), inner_width=0.1, m=1.0, **BOX), "hollow"),
        (BodyBox(r=(1.0, 0.0, 0.0), inner_width=0.05, inner_height=0.3, m=1.0, **BOX), "hollow"),
        (BodyBox(r=(1.0, 0.0, 0.0), tensor=np.diag([1.0, -1.0, 1.0]).tolist(), **BOX), "semidefinite"),
        (Body(m=1.0, I_11=1.0, I_22=1.0, I_33=1.0, I_21=1.1), "semidefinite"),
        (Body(m=1.0, I_11=1.0, I_22=1.0, I_33=1.0, I_21=-0.8, I_31=-0.8, I_32=-0.8), "semidefinite"),
        (BodyShape(m=1.0, r=(1.0, 0.0, 0.0), I_11=0.0, I_31=0.1), "semidefinite"),
        (BodyCylinder(r=(1.0, 0.0, 0.0), diameter=0.1, tensor=((1, 0.1, 0), (0, 1, 0), (0, 0, 1))), "symmetric"),
    ],
)
def test_what_is_no_body(body: BodyBox | BodyCylinder | BodyShape | Body, words: str) -> None:
    with fails_with(DeclarationError, "AC139") as caught:
        acausal.flatten(Arm(body=body))
    assert words in str(caught.value)
    assert "body" in str(caught.value)


def test_a_value_given_later_is_asked_too() -> None:
    compiled = acausal.compile(Arm(body=Body(m=1.0, r_CM=(0.1, 0.0, 0.0), I_11=1.0, I_22=1.0, I_33=1.0)))
    with fails_with(DeclarationError, "AC139"):
        acausal.simulate(compiled, parameters={"body.I_21": 1.5}, stop_time=1e-3)


class Thrown(Component):
    """A body that nobody holds."""

    world: World = World()
    body: Body = part()
    I_33: Real = parameter(default=0.03, unit="kg.m2")

    def build(self) -> None:
        start: dict[str, Any] = {name: fixed((0.0, 0.0, 0.0)) for name in ("r_0", "v_0", "w_a")}
        self.body = Body(m=1.0, I_11=0.01, I_22=0.01, I_33=self.I_33, Q=(0.0, 0.0, 0.0, 1.0), **start)


def test_a_free_body_whose_inertia_no_masses_have_notes_it() -> None:
    """I_33 = sum of m (x^2 + y^2) is at most I_11 + I_22, and equal to it for a flat body."""

    def notes(value: float) -> Any:
        return acausal.simulate(Thrown(), stop_time=0.01, parameters={"I_33": value}).stats["notes"]

    assert any(note.startswith("body (Body): no masses have this inertia") for note in notes(0.03))
    assert notes(0.02) == ()


@pytest.mark.parametrize("seed", range(3))
def test_rotated_inertia_is_one(seed: int) -> None:
    """A slender rod, I = (0, 1, 1), turned by any rotation: singular up to rounding, and accepted."""
    random = np.random.default_rng(seed)
    R: Array = np.array(axis_rotation(random.normal(size=3).tolist(), random.uniform(0.0, 6.0)))
    i = R @ np.diag([0.0, 1.0, 1.0]) @ R.T
    body = Body(m=1.0, I_11=i[0, 0], I_22=i[1, 1], I_33=i[2, 2], I_21=i[1, 0], I_31=i[2, 0], I_32=i[2, 1])
    flat = acausal.flatten(Arm(body=body))
    # the trace is that of the rod, whatever the rotation
    assert sum(float(values(flat, f"body.I_{k}{k}")[0]) for k in (1, 2, 3)) == pytest.approx(2.0, abs=1e-14)


@pytest.mark.parametrize(
    ("R_rel", "words"),
    [
        (((0.0, 0.0, 0.0),) * 3, "unit vectors"),
        (((2.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)), "unit vectors"),
        (((1.0, 0.1, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)), "unit vectors"),
        (((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, -1.0)), "reflection"),
        (((math.nan, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)), "unit vectors"),
        (((1.0, 0.0), (0.0, 1.0)), "three rows"),
    ],
)
def test_what_is_no_rotation(R_rel: Any, words: str) -> None:
    with fails_with(DeclarationError, "AC130") as caught:
        FixedRotation(R_rel=R_rel)
    assert words in str(caught.value)


def test_no_axis_is_no_rotation() -> None:
    with pytest.raises(DeclarationError, match="AC130"):
        axis_rotation((0.0, 0.0, 0.0), 1.0)


@pytest.mark.parametrize("n_b", [(1.0, 0.0, 0.0), (1.0, 1.0, 0.0), (1e-6, 1.0, 0.0), (0.0, 0.0, 0.0)])
def test_universal_needs_perpendicular_axes(n_b: tuple[float, float, float]) -> None:
    with fails_with(DeclarationError, "AC130") as caught:
        Universal(n_a=(1.0, 0.0, 0.0), n_b=n_b)
    assert "n_b" in str(caught.value)


def test_perpendicular_axes_of_any_length() -> None:
    assert Universal(n_a=(3.0, 3.0, 0.0), n_b=(-0.2, 0.2, 0.0)).n_b == (-0.2, 0.2, 0.0)
