"""`auto` is a choice and no solver of its own: what holds for the solvers that it names holds for it."""

from __future__ import annotations

import sys
from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest

import acausal
from acausal import Component
from acausal.models.bouncing_ball import BouncingBall
from acausal.models.clutches import ClutchChain
from acausal.models.ivp.transistor_amplifier import TransistorAmplifier
from acausal.models.rc_ladder import RCLadder
from acausal.simulate.solvers import choose, is_never_stiff
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


@pytest.mark.parametrize(("make", "never"), [(lambda: ClutchChain(n=3), True), (lambda: RCLadder(n=3), False)])
def test_what_is_never_stiff_has_slopes_without_eigenvalues(make: Callable[[], Component], never: bool) -> None:
    """By numbers: a matrix is nilpotent if its n-th power is zero (Cayley and Hamilton), in any modes."""
    compiled = acausal.compile(make())
    n, numbers = compiled.n_dynamic, np.random.default_rng(5)
    slopes = compiled.rhs.jacobian()
    for _ in range(5):
        at = [numbers.uniform(0.5, 2.0, compiled.rhs.numel_in(k)) for k in range(compiled.rhs.n_in() - 1)]
        m = numbers.integers(0, 2, compiled.n_modes).astype(float)
        found = np.array(ca.densify(slopes(*at, m, *(0.0 for _ in range(compiled.rhs.n_out())))[1]))[:n, :n]
        assert bool((np.linalg.matrix_power(found, n) == 0.0).all()) is never
    assert is_never_stiff(compiled) is never


def test_auto_takes_no_matrix_where_none_is_needed(monkeypatch: pytest.MonkeyPatch) -> None:
    """From as many states on as make a factorisation a step expensive; 51 clutches would take seconds to compile."""
    monkeypatch.setattr(sys.modules[choose.__module__], "_SMALL_SIZE", 5)
    compiled = acausal.compile(ClutchChain(n=3))
    solver, why = choose(compiled, "auto", None)
    assert (solver.name, "never stiff" in why) == ("erk", True)
