"""Wrong arguments of `simulate` and its relatives: named, with what would be right, before anything runs."""

from __future__ import annotations

from typing import Any

import pytest

import acausal
from acausal import Component, Equations, Real, boolean_input, der, fixed, part, signal_input, variable, where
from acausal.errors import AcausalError
from acausal.library.blocks import Pulse
from tests.expected import fails_with


class Lag(Component):
    """x' = u - x."""

    u: Real = signal_input()
    x: Real = variable(default=fixed(0.5))

    def equations(self) -> Equations:
        yield der(self.x) == self.u - self.x


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        ({"inputs": {"u": "abc"}}, "AC044", ("input u = 'abc'", "file.csv:column")),
        ({"inputs": {"u": [1.0, 2.0]}}, "AC044", ("input u = [1.0, 2.0]",)),
        ({"inputs": {"u": float("nan")}}, "AC033", ("input u = nan",)),
        ({"inputs": {"v": 1.0}}, "AC033", ("no input 'v'", "inputs of")),  # not: u has no value
        ({"inputs": [1.0]}, "AC033", ("inputs is a list", "dictionary")),
        ({"stop_time": "long"}, "AC030", ("stop_time = 'long'",)),
        ({"tolerance": "fine"}, "AC030", ("tolerance = 'fine'",)),
        ({"solver": "idas", "step": 1e-3}, "AC038", ("idas", "0.001 s", "rk2")),
        ({"solver": "cvodes", "step": 1e-3}, "AC038", ("cvodes",)),
        ({"solver": "rk", "step": 1e-3, "max_step": 1e-2}, "AC038", ("0.001 s", "0.01 s")),
        ({"max_step": -1.0}, "AC030", ("max_step -1",)),
        ({"max_step": "short"}, "AC030", ("max_step = 'short'",)),
        ({"max_step": 1e-3, "accuracy": 1e-3}, "AC043", ("max_step",)),
        # no step is ever accepted: such a run did not end
        ({"tolerance": 1e-20}, "AC030", ("tolerance 1e-20", "1e-14")),
    ],
)
def test_a_wrong_argument_is_named(arguments: dict[str, Any], code: str, words: tuple[str, ...]) -> None:
    with fails_with(AcausalError, code) as error:
        acausal.simulate(Lag(), **{"stop_time": 1.0, "inputs": {"u": 1.0}, **arguments})
    for word in words:
        assert word in str(error.value)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("on", "on is not an input, but a variable to which the model gives a value"),
        ("w", "w is a vector, and each of its elements an input"),
        ("x", "x is not an input, but a variable"),
    ],
)
def test_what_is_no_input_is_told_from_what_does_not_exist(name: str, words: str) -> None:
    """It was said of all three that there is no such input, and that it should be bound in the model."""

    class Switched(Lag):
        on: Real = boolean_input(default=False)
        w: Real = signal_input(shape=2)
        y: Real = variable()

        def equations(self) -> Equations:
            yield self.y == where(self.on, self.w[0], self.w[1])

    given = {"u": 1.0, "w[0]": 1.0, "w[1]": 2.0, name: 1.0}
    with fails_with(AcausalError, "AC033", match=words):
        acausal.simulate(Switched(), inputs=given, stop_time=1.0)


@pytest.mark.parametrize("verb", ["compile", "simulate", "linearize", "stability", "reduce", "free", "animate"])
def test_what_is_no_model_is_refused(verb: str) -> None:
    arguments: dict[str, Any] = {"outputs": ["x"]} if verb == "reduce" else {}
    for model, words in ((Lag, "make one: Lag()"), ("Lag", "'Lag' is not a model"), (None, "None")):
        with fails_with(AcausalError, "AC028") as error:
            getattr(acausal, verb)(model, **arguments)
        assert words in str(error.value)


@pytest.mark.parametrize("given", [Lag(), acausal.compile(Lag()), None])
def test_what_is_no_result_is_not_explored(given: Any) -> None:
    with fails_with(AcausalError, "AC085", match="is not a result"):
        acausal.explore(given)


class Pulsed(Component):
    """A pulse and its area."""

    pulse: Pulse = part()
    area: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.area) == self.pulse.y


def pulsed(**arguments: Any) -> Pulsed:
    class Made(Pulsed):
        def build(self) -> None:
            self.pulse = Pulse(**arguments)

    return Made()


def test_numbers_without_unit_are_said_without_one() -> None:
    with pytest.raises(AcausalError) as error:
        acausal.compile(pulsed(period=1.0, width=30.0))
    assert "pulse.width = 30 is outside its limits 0 ... 1" in str(error.value)


@pytest.mark.parametrize("solver", ["idas", "rosenbrock"])
def test_a_row_of_pulses_without_end(solver: str) -> None:
    """100 pulses of 0.1 s in 30 s, all edges exact: the area is 10 s; 0.3 is no binary number."""
    result = acausal.simulate(pulsed(period=0.3, width=1.0 / 3.0), stop_time=30.0, solver=solver, tolerance=1e-8)
    assert result.final("area") == pytest.approx(10.0, abs=1e-10)
