"""The scene written by hand for one axis against the one of bodies, whole and reduced."""

from __future__ import annotations

import numpy as np

import acausal
from acausal.models.drilling_dynamic import ThickBlock
from acausal.models.drilling_one_axis import OneAxisDrilling


def test_one_axis_agrees_with_the_scene_of_bodies() -> None:
    """Same equations in two forms; the depth at 6 s is the number of docs/drilling.md's oracle, 1.935942 mm."""
    times = np.array([1.5, 4.0, 6.0, 7.9])
    hand = acausal.simulate(OneAxisDrilling(), stop_time=8.0, output_interval=0.1)
    bodies = acausal.simulate(ThickBlock(), outputs=["drill.s", "drill.F_f"], stop_time=8.0, output_interval=0.1)
    assert hand.stats["states"] == bodies.stats["states"] == 3
    np.testing.assert_allclose(hand.at(times, "s"), bodies.at(times, "drill.s"), atol=1e-9)
    np.testing.assert_allclose(hand.at(times, "F_f"), bodies.at(times, "drill.F_f"), atol=1e-4)
    assert abs(float(np.asarray(hand.at(6.0, "s"))) - 1.935942e-3) < 1e-9
