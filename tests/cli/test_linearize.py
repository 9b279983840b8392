"""`acausal linearize`: matrices and eigenvalues against closed forms."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from tests.cli.running import run

CART = '''
from acausal import *


class Cart(Component):
    """A mass on a spring, pushed, with a cubic term: x'' = (f - c x - k x^3)/m."""

    m: Real = parameter(default=2.0)
    c: Real = parameter(default=8.0)
    k: Real = parameter(default=1.0)
    f: Real = signal_input()
    x: Real = variable(default=fixed(0.5))
    v: Real = variable(default=fixed(0.0))
    power: Real = signal_output()

    def equations(self) -> Equations:
        yield der(self.x) == self.v
        yield self.m * der(self.v) == self.f - self.c * self.x - self.k * self.x * self.x * self.x
        yield self.power == self.f * self.v
'''


@pytest.fixture(autouse=True)
def cart(folder: Path) -> None:
    (folder / "cart.py").write_text(CART)


def test_matrices_at_the_start() -> None:
    """d(v')/dx = -(c + 3 k x^2)/m, d(v')/df = 1/m; the power is f v, so C = (0, f) and D = v."""
    found = run("linearize", "cart.py", "--input", "f=3", "--outputs", "power", "--json").json
    assert (found["states"], found["inputs"], found["outputs"]) == (["x", "v"], ["f"], ["power"])
    assert found["A"] == [[0.0, 1.0], [pytest.approx(-(8.0 + 0.75) / 2.0), 0.0]]
    assert found["B"] == [[0.0], [0.5]]
    assert (found["C"], found["D"]) == ([[0.0, 3.0]], [[0.0]])
    assert (found["x"], found["u"]) == ([0.5, 0.0], [3.0])
    assert found["rates"] == [0.0, pytest.approx((3.0 - 4.0 - 0.125) / 2.0)]
    assert [abs(e["imag"]) for e in found["eigenvalues"]] == [pytest.approx(math.sqrt(4.375))] * 2
    assert found["eigenvalues"][0]["frequency"] == pytest.approx(math.sqrt(4.375) / (2.0 * math.pi))


def test_states_and_parameters_can_be_given() -> None:
    found = run("linearize", "cart.py", "--set", "k=0", "--state", "v=2", "--input", "f=0", "--json").json
    assert found["A"][1] == [-4.0, 0.0]
    assert found["x"] == [0.5, 2.0]
    assert found["D"][found["outputs"].index("power")] == [2.0]


def test_a_time_of_a_run() -> None:
    """Without the cubic term the cart is at 0.5 cos(2 t), with -sin(2 t) as speed."""
    found = run("linearize", "cart.py", "--set", "k=0", "--input", "f=0", "--at", "700ms", "--json").json
    assert found["time"] == 0.7
    assert found["x"] == [pytest.approx(0.5 * math.cos(1.4), abs=1e-4), pytest.approx(-math.sin(1.4), abs=1e-4)]


def test_what_is_shown() -> None:
    outcome = run("linearize", "Oscillator")
    assert outcome.code == 0, outcome.err
    assert "Oscillator: 2 states, 0 inputs" in outcome.out
    # m = 1 kg, c = 100 N/m, d = 1 N.s/m: roots of s^2 + s + 100
    assert "-0.5 +- 9.98749i" in outcome.out


def test_states_take_units_and_are_printed_with_theirs() -> None:
    """At rest at 90 degrees, a pendulum is in its upper position here: eigenvalues +-sqrt(m g l/(I + m l^2))."""
    outcome = run("linearize", "Pendulum", "--state", "revolute.phi=90deg")
    assert outcome.code == 0, outcome.err
    assert "1.5708 rad  0 rad/s" in outcome.out
    assert f"{math.sqrt(9.80665 * 0.5 / (0.001 + 0.25)):.6g}" in outcome.out


def test_an_undamped_mode_has_no_negative_zero() -> None:
    outcome = run("linearize", "UndampedOscillator", "--json")
    assert [math.copysign(1.0, e["damping"]) for e in outcome.json["eigenvalues"]] == [1.0, 1.0]


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (["--state", "x"], "AC009"),
        (["--state", "y=1"], "AC010"),
        (["--state", "x=1kg"], "AC151"),
        (["--outputs", "y"], "AC010"),
        (["--input", "g=1"], "AC033"),
        (["--at", "-1"], "AC011"),
        (["--at", "1kg"], "AC15"),
    ],
)
def test_wrong_requests(arguments: list[str], code: str) -> None:
    outcome = run("linearize", "cart.py", *arguments)
    assert outcome.code == 2
    assert code in outcome.err
