"""`auto` is a choice and no solver of its own: what holds for the solvers that it names holds for it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

import acausal
from acausal import Component
from acausal.models.bouncing_ball import BouncingBall
from acausal.models.clutches import ClutchChain
from acausal.models.ivp.transistor_amplifier import TransistorAmplifier
from acausal.models.rc_ladder import RCLadder
from tests.simulate.test_event_edges import HalfWave

MODELS: dict[Callable[[], Component], str] = {
    lambda: RCLadder(n=120): "idas",
    BouncingBall: "rosenbrock",
    TransistorAmplifier: "rosenbrock",
    HalfWave: "idas",
    lambda: ClutchChain(n=2): "rosenbrock",
}


@pytest.mark.parametrize(("make", "solver"), MODELS.items(), ids=map(str, range(len(MODELS))))
def test_a_run_is_that_of_the_solver_it_names(make: Callable[[], Component], solver: str) -> None:
    """To the last digit, events and steps included; so tests of both solvers need no case of `auto`."""
    compiled = acausal.compile(make())
    stop = compiled.flat.experiment.stop_time / 20
    chosen, named = (acausal.simulate(compiled, stop_time=stop, solver=s, native=False) for s in ("auto", solver))
    assert chosen.stats["solver"] == solver
    assert np.array_equal(chosen.matrix, named.matrix)
    assert [e.time for e in chosen.events] == [e.time for e in named.events]
    assert chosen.stats.get("steps") == named.stats.get("steps")
