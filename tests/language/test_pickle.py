"""Components, flat and compiled models and results go to worker processes and come back."""

from __future__ import annotations

import multiprocessing
import pickle
from concurrent.futures import ProcessPoolExecutor
from typing import Any

import numpy as np
import pytest

import acausal
from acausal import Component, Equations, Real, connect, der, fixed, outer, parameter, part, signal_input, variable
from acausal.errors import DeclarationError, UsageError
from acausal.models.bouncing_ball import BouncingBall
from acausal.models.contact_scenes import HolesSideBySide
from acausal.models.oscillator import Oscillator
from acausal.models.pendulum import Pendulum
from acausal.models.turning import RegenerativeTurning
from tests.language.test_outer import House


class Law(Component):
    """How a room loses heat; which one is for whoever has it to say."""

    u: Real = signal_input()
    k: Real = parameter(default=1.0)
    T: Real = variable(default=fixed(1.0))

    def equations(self) -> Equations:
        yield der(self.T) == self.k * (self.u - self.T)


class Surroundings(Component):
    """Known to all that is in it."""

    level: Real = parameter(default=0.7)


class Room(Component):
    """What it is in, and a part that was given."""

    law: Law = Law()
    around: Surroundings = outer(Surroundings)
    s: Real = variable()
    u: Real = signal_input()

    def equations(self) -> Equations:
        yield connect(self.u, self.law.u)
        yield self.s == self.law.T * self.around.level


class Rooms(Component):
    """Two rooms with laws of their own."""

    around: Surroundings = Surroundings(level=0.5)
    first: Room = Room(law=Law(k=2.0))
    second: Room = part()

    def build(self) -> None:
        self.second = Room(law=Law(k=3.0))

    def equations(self) -> Equations:
        yield self.first.u == self.second.s
        yield self.second.u == 0.2


MODELS: dict[str, Any] = {
    "plain": Oscillator,
    "frames": Pendulum,
    "events": BouncingBall,
    "delays": RegenerativeTurning,
    "contacts": lambda: HolesSideBySide(n=2),
    "outer": House,
    "outer, with given parts": Rooms,
}


def copy_of(thing: Any) -> Any:
    return pickle.loads(pickle.dumps(thing))


@pytest.mark.parametrize("name", MODELS)
def test_a_copy_runs_as_the_original(name: str) -> None:
    """The recipe, its compiled model before and after a run, and the result."""
    model: Component = MODELS[name]()
    compiled = acausal.compile(model)
    fresh = copy_of(compiled)
    result = acausal.simulate(compiled, stop_time=0.2)
    for other in (fresh, copy_of(compiled), copy_of(model)):
        copied = acausal.simulate(other, stop_time=0.2)
        assert copied.names == result.names
        np.testing.assert_allclose(copied.matrix, result.matrix, rtol=1e-9, atol=1e-12)
    kept = copy_of(result)
    np.testing.assert_array_equal(kept.matrix, result.matrix)
    assert [kept[n].shape for n in kept.names] == [result[n].shape for n in result.names]
    assert len(copy_of(acausal.flatten(model)).equations) == len(acausal.flatten(model).equations)


def test_messages_of_a_copy_name_the_same_lines() -> None:
    model = Oscillator()
    found = [m.__dict__["_origin"].span() for m in (model, copy_of(model))]
    assert found[0] == found[1]


def test_errors_pickle() -> None:
    """A worker's error is told where the work was ordered."""
    error = DeclarationError("AC101", "what is wrong", help="what to do")
    assert str(copy_of(error)) == str(error)
    assert copy_of(UsageError("AC020", "no parameter")).code == "AC020"


@pytest.mark.slow
def test_a_compiled_model_works_in_worker_processes() -> None:
    """Compiled here, run there, its result back here."""
    compiled = acausal.compile(BouncingBall())
    gravities = (9.81, 1.62)
    with ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("spawn")) as pool:
        jobs = [pool.submit(acausal.simulate, compiled, stop_time=1.0, parameters={"g": g}) for g in gravities]
        found = [job.result().final("h") for job in jobs]
    for g, height in zip(gravities, found, strict=True):
        own = acausal.simulate(compiled, stop_time=1.0, parameters={"g": g}).final("h")
        assert height == pytest.approx(own, rel=1e-9)
