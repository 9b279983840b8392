"""A signal that is read costs what it needs, and is what it is among all."""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest

import acausal
from acausal import Component
from acausal.models.bouncing_ball import BouncingBall
from acausal.models.drilling_dynamic import ThickBlock
from acausal.models.drilling_kinematic import ThinPlate
from acausal.models.pendulum import Pendulum
from acausal.models.rc_ladder import RCLadder
from acausal.simulate.equations.calls.buffered import NarrowFunction
from acausal.simulate.record import record

MODELS: dict[str, Callable[[], Component]] = {
    "ladder": lambda: RCLadder(n=40),
    "plate": ThinPlate,
    "ball": BouncingBall,
    "pendulum": Pendulum,
    "drill": ThickBlock,
}


@pytest.mark.parametrize("name", MODELS)
def test_each_signal_read_alone_is_what_it_is_among_all(name: str) -> None:
    """The same operations on the same numbers, states, signals, negated aliases, constants and vectors alike."""
    result = acausal.simulate(MODELS[name](), stop_time=0.5, tolerance=1e-5)
    whole = acausal.simulate(MODELS[name](), stop_time=0.5, tolerance=1e-5)
    _ = whole.matrix
    some = whole.names[:: max(1, len(whole.names) // 40)]
    for signal in some:
        np.testing.assert_array_equal(result[signal], whole[signal])
    assert "matrix" not in result.__dict__


def test_one_signal_does_not_compute_all(monkeypatch: pytest.MonkeyPatch) -> None:
    def all_of_them(*arguments: object) -> None:
        raise AssertionError("the rows of all signals are computed")

    monkeypatch.setattr(record, "rows", all_of_them)
    result = acausal.simulate(RCLadder(n=30), stop_time=0.5)
    for name in ("capacitors[3].v", "resistors[7].i", "resistors[7].v", "ground.p.i"):
        assert result[name].shape == result.time.shape
    assert result.final("resistors[7].i") == pytest.approx(result["resistors[7].v"][-1], rel=1e-12)  # 1 Ohm
    with pytest.raises(AssertionError):
        _ = result.matrix


def test_one_constant_does_not_describe_all(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a scene reads at each look at its contacts: parameters, and what follows from these alone."""

    def all_of_them(*arguments: object) -> None:
        raise AssertionError("all signals are described")

    whole = acausal.simulate(ThickBlock(), stop_time=0.5)
    constants = [name for name in whole.names if whole.signals[name].column is None]
    monkeypatch.setattr(record, "signals", all_of_them)
    result = acausal.simulate(ThickBlock(), parameters={"m": 4.0}, stop_time=0.5)
    assert result.final("m") == 4.0
    assert whole.final("m") != 4.0
    found = {name: result.signals[name] for name in constants}
    assert sum(s.parameter for s in found.values()) not in (0, len(constants))
    changed = {n for n, s in found.items() if not np.array_equal(s.value, whole.signals[n].value, equal_nan=True)}
    assert all(np.isclose(found[n].value / whole.signals[n].value, 4.0 / whole.final("m")) for n in changed)
    with pytest.raises(AssertionError):
        len(result.signals)


def test_many_signals_one_by_one_become_all_at_once() -> None:
    """Some dozens of single functions, then the one of all: never one for each of ten thousand."""
    result = acausal.simulate(RCLadder(n=60), stop_time=0.5)
    for name in result.names:
        result[name]
    assert "matrix" in result.__dict__


def test_a_result_that_was_pickled_has_all_of_it() -> None:
    import pickle

    result = acausal.simulate(Pendulum(), stop_time=0.2)
    again = pickle.loads(pickle.dumps(result))
    for name in result.names:
        np.testing.assert_array_equal(again[name], result[name])


def test_a_signal_is_handed_the_states_it_needs_only() -> None:
    """The current through one resistor of 40 depends on two voltages; 3000 rows are evaluated in blocks."""
    result = acausal.simulate(RCLadder(n=40), stop_time=3.0, output_interval=1e-3)
    left, right, current = (result[name] for name in ("capacitors[6].v", "capacitors[7].v", "resistors[7].i"))
    assert len(current) == 3001
    np.testing.assert_allclose(current, left - right, rtol=1e-12, atol=1e-15)  # 1 Ohm
    x = ca.SX.sym("x", 5000)
    read = NarrowFunction("read", [ca.SX.sym("t"), x], x[17] * x[4000])
    rows = np.arange(12.0)[:, None] * np.ones(5000)
    np.testing.assert_array_equal(read.many(np.zeros((12, 1)), rows)[:, 0], np.arange(12.0) ** 2)
    assert read._buffered.function.nnz_in() == 2
