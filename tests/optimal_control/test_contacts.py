"""Programs on models with contacts."""

from __future__ import annotations

import numpy as np
import pytest

from acausal.models.contact_scenes import BoxStack
from acausal.optimal_control import Problem
from tests.contact.test_mpr_models import PressedBall


def test_the_force_that_presses_a_ball_to_a_depth() -> None:
    """F = k depth / (1 - exp(-k T / d)), as in test_mpr_models.py, with the depth of the contact's own algorithm."""
    problem = Problem(PressedBall())
    problem.decide("force")
    problem.phase(duration=0.3, intervals=5)
    problem.subject_to(problem.end("depth") == 4e-3)
    problem.minimize(problem.integral("depth"))
    best = problem.solve()
    assert best.parameters["force"] == pytest.approx(40.0 / (1 - np.exp(-3.0)), rel=1e-4)


def test_a_scene_has_all_its_pairs() -> None:
    """A box that falls from 51 mm for 10 ms touches nothing: z = z0 - g t**2 / 2."""
    problem = Problem(BoxStack(n=1))
    problem.phase(duration=0.01, intervals=2)
    problem.minimize(problem.integral("boxes[0].r_0[2]"))
    best = problem.solve()
    assert best.objective == pytest.approx(0.051 * 0.01 - 9.80665 * 0.01**3 / 6, rel=1e-6)
