"""A cone tip in a 100 x 100 x 10 mm plate: the table of cases on which published MPR fails (DRILLING.md 3)."""

from __future__ import annotations

import math
from itertools import product

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from acausal.library.contact.collide.shapes import Box, Cone, PointedDrill
from tests.contact.poses import contact, pose

PLATE = Box((0.1, 0.1, 0.01))
THICKNESS, RADIUS = 0.01, 0.008
LENGTH = RADIUS / math.tan(math.radians(59))
CONE = Cone(RADIUS, LENGTH)
DRILL = PointedDrill(2 * RADIUS, math.radians(118), 0.1)
DOWN = (0.0, 0.0, -1.0)


@pytest.mark.parametrize("offset", [0.0, 0.005, 0.015, 0.025, 0.035, 0.045])
def test_the_depth_of_the_tip_is_exact_everywhere(offset: float) -> None:
    """Below the entry face, along its normal, for tilts of 0 to 20 degrees in any direction, up to half way through."""
    for tilt, around, place, depth in product(
        (0.0, 5.0, 10.0, 15.0, 20.0), (0.0, 2.0), (0.0, 0.8), (1e-5, 1e-3, 4.5e-3)
    ):
        turn = Rotation.from_euler("zy", [around, math.radians(tilt)]).as_matrix()
        tip = np.array([offset * math.cos(place), offset * math.sin(place), THICKNESS / 2 - depth])
        for tool in (CONE, DRILL):
            d, n, p, _ = contact(tool, (tip, turn), PLATE, pose((0.0, 0.0, 0.0)))
            assert d == pytest.approx(depth, abs=1e-12)
            assert n == pytest.approx(DOWN, abs=1e-9)
            assert p == pytest.approx(tip, abs=1e-9)


@pytest.mark.parametrize("tool", [CONE, DRILL], ids=["cone", "drill"])
@pytest.mark.parametrize("tilt", [0.0, 0.2])
def test_through_drilling_stays_right(tool: Cone | PointedDrill, tilt: float) -> None:
    """Past (t + l)/2 the shortest way out is on through the plate; a tool goes back where it came from.

    A cone without a shank does so until back is four times as far as through.
    """
    turn = Rotation.from_euler("y", tilt).as_matrix()
    most = 0.79 if isinstance(tool, Cone) and not tilt else 0.7
    for depth in np.linspace(0.001, most * (THICKNESS + LENGTH * math.cos(tilt)), 20):
        tip = np.array([0.02, 0.01, THICKNESS / 2 - depth])
        d, n, _, _ = contact(tool, (tip, turn), PLATE, pose((0.0, 0.0, 0.0)))
        assert d == pytest.approx(depth, abs=1e-12)
        assert n == pytest.approx(DOWN, abs=1e-9)


def test_a_drill_far_through() -> None:
    """Ten plate thicknesses further on nothing has changed."""
    for depth in (0.02, 0.05, 0.07):
        d, n, _, _ = contact(DRILL, pose((0.02, 0.01, THICKNESS / 2 - depth)), PLATE, pose((0.0, 0.0, 0.0)))
        assert d == pytest.approx(depth, abs=1e-12)
        assert n == pytest.approx(DOWN, abs=1e-9)


def test_a_cone_standing_on_its_base_is_not_drawn_back() -> None:
    """It rests on the plate with its flat side: the nearest way out is up."""
    upside = pose((0.0, 0.0, THICKNESS / 2 + LENGTH - 1e-5), (math.pi, 0.0, 0.0))
    base_down = pose((0.01, 0.02, THICKNESS / 2 + LENGTH - 1e-5), (math.pi, 0.0, 0.0))
    assert contact(CONE, upside, PLATE, pose((0.0, 0.0, 0.0)))[0] == pytest.approx(1e-5, abs=1e-12)
    d, n, _, _ = contact(CONE, base_down, PLATE, pose((0.0, 0.0, 0.0)))
    assert d == pytest.approx(1e-5, abs=1e-12)
    assert n == pytest.approx(DOWN, abs=1e-9)
