"""Components, flat and compiled models and results go to worker processes and come back."""

from __future__ import annotations

import multiprocessing
import pickle
from concurrent.futures import ProcessPoolExecutor
from typing import Any

import numpy as np
import pytest

import acausal
from acausal import (
    Component,
    Equations,
    Real,
    connect,
    der,
    discrete,
    fixed,
    maximum,
    outer,
    parameter,
    part,
    pre,
    reset,
    signal_input,
    variable,
    when,
    where,
)
from acausal.errors import DeclarationError, UsageError
from acausal.models.bouncing_ball import BouncingBall
from acausal.models.contact_scenes import HolesSideBySide
from acausal.models.oscillator import Oscillator
from acausal.models.pendulum import Pendulum
from acausal.models.turning import RegenerativeTurning
from tests.language.test_outer import House
from tests.marks import slow_but


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


@pytest.mark.parametrize("name", slow_but(MODELS, *(name for name in MODELS if name not in ("contacts", "frames"))))
def test_a_copy_runs_as_the_original(name: str) -> None:
    """The recipe, its compiled model before and after a run, and the result."""
    model: Component = MODELS[name]()
    compiled = acausal.compile(model)
    fresh = copy_of(compiled)
    result = acausal.simulate(compiled, stop_time=0.05)
    for other in (fresh, copy_of(compiled), copy_of(model)):
        copied = acausal.simulate(other, stop_time=0.05)
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


class Switching(Component):
    """A state with an event and a discrete equation, and a kink at which a rate sleeps."""

    x: Real = variable(default=fixed(1.0))
    y: Real = variable(default=fixed(0.0))
    n: Real = discrete()
    above: Real = discrete()

    def equations(self) -> Equations:
        yield der(self.x) == -2.0
        yield der(self.y) == maximum(-self.x - 0.5, 0.0)
        yield self.above == where(self.x > 0.25, 1.0, 0.0)
        yield when(self.x < 0.0, reset(self.n, pre(self.n) + 1.0))


class Switchings(Component):
    """Two of them, one in a list that `build` makes."""

    first: Switching = Switching()
    others: list[Any] = part()

    def build(self) -> None:
        self.others = [Switching(x=fixed(2.0))]


def test_words_of_a_copy_are_those_of_the_model() -> None:
    """Names of parts were lost in equations of a copy: `parts[0].v` was told as `v`, in events and in errors."""
    model = acausal.compile(Switchings())
    copy = pickle.loads(pickle.dumps(pickle.loads(pickle.dumps(model))))
    for kind in ("equations", "whens", "assignments"):
        told, again = ([str(s.source) for s in getattr(m.flat, kind)] for m in (model, copy))
        assert any("others[0]." in text for text in told)
        assert again == told
        if kind != "whens":
            assert [copy.flat.text(e) for e in getattr(copy.flat, kind)] == [
                model.flat.text(e) for e in getattr(model.flat, kind)
            ]
    listed = [[(e.condition, e.component) for e in acausal.simulate(m, stop_time=1.5).events] for m in (model, copy)]
    assert listed[1] == listed[0]
    assert any("when(others[0].x" in condition for condition, _ in listed[0])
