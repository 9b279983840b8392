"""Steady states against statics."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import acausal
from acausal import (
    Component,
    Equations,
    Real,
    der,
    fixed,
    operating_point,
    parameter,
    signal_input,
    signal_output,
    variable,
)
from acausal.errors import AcausalError
from acausal.models.oscillator import Oscillator
from acausal.models.pendulum import Pendulum
from tests.expected import fails_with


class Tanks(Component):
    """Two tanks in a row, filled by a pump: A h' = q_in - c sqrt(h)."""

    q: Real = signal_input(unit="m3/s", min=0.0, max=1.0, default=0.0)
    c: Real = parameter(default=0.02, unit="1")
    h1: Real = variable(default=fixed(0.5), unit="1")
    h2: Real = variable(default=fixed(0.7), unit="1")
    out: Real = signal_output(unit="1")

    def equations(self) -> Equations:
        rate = acausal.unitless(self.q)
        second = acausal.quantity(1.0, "s")
        yield second * der(self.h1) == rate - self.c * acausal.sqrt(self.h1)
        yield second * der(self.h2) == self.c * acausal.sqrt(self.h1) - 2.0 * self.c * acausal.sqrt(self.h2)
        yield self.out == self.c * acausal.sqrt(self.h2)


def test_levels_follow_from_the_flow() -> None:
    """c sqrt(h1) = q, 2 c sqrt(h2) = q."""
    found = operating_point(Tanks(), inputs={"q": 0.01})
    assert found.states["h1"] == pytest.approx(0.25, rel=1e-7)
    assert found.states["h2"] == pytest.approx(0.0625, rel=1e-7)
    assert not found.notes
    rates = acausal.linearize(Tanks(), 0.0, found.states, inputs=found.inputs).rates
    assert np.abs(rates).max() < 1e-9


def test_the_input_is_found_for_a_wanted_output() -> None:
    found = operating_point(Tanks(), outputs={"out": 0.012}, free=["q"], guess={"q": 0.02})
    assert found.inputs["q"] == pytest.approx(0.024, rel=1e-7)
    assert found.outputs["out"] == pytest.approx(0.012, rel=1e-7)


def test_the_inputs_are_found_for_a_wanted_vector() -> None:
    """0 = u - 2 x."""

    class Lags(Component):
        u: Real = signal_input(shape=2, default=0.0)
        x: Real = variable(shape=2, default=fixed(0.0))

        def equations(self) -> Equations:
            yield der(self.x) == self.u - 2.0 * self.x

    wanted: Any = {"x": [3.0, 4.0]}
    found = acausal.operating_point(Lags(), outputs=wanted, free=["u[0]", "u[1]"])
    assert found.inputs == pytest.approx({"u[0]": 6.0, "u[1]": 8.0})
    with pytest.raises(AcausalError, match="takes 2 numbers, 3 were given"):
        acausal.operating_point(Lags(), outputs={"x": [1.0, 2.0, 3.0]}, free=["u[0]", "u[1]"])  # type: ignore[dict-item]


def test_a_spring_hangs_where_statics_say() -> None:
    found = operating_point(Oscillator())
    assert found.states["mass.s"] == pytest.approx(0.0, abs=1e-9)
    assert found.states["mass.v"] == pytest.approx(0.0, abs=1e-9)


def test_a_pendulum_hangs_down_or_stands() -> None:
    """Rates vanish at every multiple of half a turn from the vertical, and nowhere else."""
    found = operating_point(Pendulum())
    angle = next(v for k, v in found.states.items() if k.endswith("phi"))
    assert math.cos(angle) == pytest.approx(0.0, abs=1e-7)  # its angle counts from the horizontal


class Drift(Component):
    """A mass without a spring: it may rest anywhere."""

    s: Real = variable(default=fixed(3.0), unit="m")
    v: Real = variable(default=fixed(1.0), unit="m/s")
    push: Real = parameter(default=0.0, unit="m/s2")

    def equations(self) -> Equations:
        yield der(self.s) == self.v
        yield der(self.v) == self.push - self.v / acausal.quantity(1.0, "s")


def test_what_may_be_anywhere_is_said() -> None:
    found = operating_point(Drift())
    assert found.states == {"s": pytest.approx(3.0, abs=1e-6), "v": pytest.approx(0.0, abs=1e-9)}
    assert "s are arbitrary" in found.notes[-1]


@pytest.mark.parametrize(
    ("call", "code", "word"),
    [
        (lambda: operating_point(Drift(), parameters={"push": 1.0}), "AC611", "der(s)"),
        (lambda: operating_point(Tanks(), outputs={"out": 5.0}, free=["q"]), "AC611", "out"),
        (lambda: operating_point(Tanks(), free=["w"]), "AC010", "'w'"),
        (lambda: operating_point(Tanks(), guess={"h3": 1.0}), "AC010", "'h3'"),
        (lambda: operating_point(Tanks(), inputs={"qq": 1.0}), "AC033", "qq"),
    ],
    ids=["moves for ever", "limits", "no input", "no state", "inputs"],
)
def test_what_is_not_steady_is_refused(call: object, code: str, word: str) -> None:
    assert callable(call)
    with fails_with(AcausalError, code) as caught:
        call()
    assert word in str(caught.value)


def test_python_control_knows_the_names() -> None:
    """Static gain of the second level's outflow: half the flow, whatever the point."""
    pytest.importorskip("control", reason="python-control is not installed")
    found = operating_point(Tanks(), inputs={"q": 0.01})
    system = acausal.linearize(Tanks(), 0.0, found.states, inputs=found.inputs, outputs=["out"]).to_control()
    assert system.input_labels == ["q"]
    assert system.output_labels == ["out"]
    assert system.state_labels == ["h1", "h2"]
    assert float(np.squeeze(system.dcgain())) == pytest.approx(0.5, rel=1e-6)
