"""Long Jacobians serve several steps of a multistep method; runs depend on nothing that was computed before them."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import casadi as ca
import numpy as np
import pytest

import acausal
from acausal import Result
from acausal.models.contact_scenes import BoxStack
from acausal.simulate.equations.calls.reused import Reused


def test_a_jacobian_is_computed_anew_after_some_steps_and_for_a_step_that_fails_again() -> None:
    """The slope 2 x of x^2, asked for at later points, and at earlier ones where steps are tried again."""
    t, x = ca.SX.sym("t"), ca.SX.sym("x")
    slope = Reused(ca.Function("slope", [t, x], [2 * x], ["t", "x"], ["slope"]))

    def asked(*times: float) -> list[float]:
        return [float(slope(time, time)) / 2 for time in times]

    assert asked(1, 2, 3, 4, 5, 6, 7, 8) == [1, 1, 1, 1, 1, 1, 7, 7]
    assert asked(7.5, 7.2, 8) == [7, 7.2, 7.2]  # tried again, tried once more, and on
    assert slope.evaluations == 3
    slope.begin()
    assert asked(9) == [9]


@pytest.mark.slow
@pytest.mark.parametrize("solver", ["idas", "cvodes"])
def test_runs_of_boxes_share_nothing(solver: str) -> None:
    """Second runs, and runs in threads, are the first one to the last bit, and account for their energy."""
    model = BoxStack(n=3)

    def run(_: int = 0) -> Result:
        return acausal.simulate(model, stop_time=0.03, solver=solver)

    first = run()
    stats = first.stats
    assert float(str(stats["jacobians"])) < 0.5 * float(str(stats["factorisations"]))
    with ThreadPoolExecutor(2) as threads:
        others = [run(), *threads.map(run, range(2))]
    for other in others:
        assert np.array_equal(first["boxes[2].w_a"], other["boxes[2].w_a"])
        assert np.array_equal(first["scene.contacts[box1,box2].F_N"], other["scene.contacts[box1,box2].F_N"])
    assert np.abs(first["balance.residual"]).max() < 1e-6 * first["balance.W_source"].max()
