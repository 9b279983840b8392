"""`--input NAME=VALUE`: with a unit where the model declares one."""

from __future__ import annotations

from pathlib import Path

import pytest

import acausal.result.result
from tests.cli.running import run

CART = '''
from acausal import *
from acausal.library.translational import Force, Mass


class Cart(Component):
    """Two kilograms, pushed."""

    f: Real = signal_input(unit="N")
    share: Real = signal_input()
    force: Force = part()
    mass: Mass = part()

    def build(self) -> None:
        self.force = Force()
        self.mass = Mass(m=2.0, s=fixed(0.0), v=fixed(0.0))

    def equations(self) -> Equations:
        yield connect(self.f, self.force.u)
        yield connect(self.force.flange, self.mass.flange_a)
'''


@pytest.fixture(autouse=True)
def cart(folder: Path) -> None:
    (folder / "cart.py").write_text(CART)


@pytest.mark.parametrize("force", ["3000", "3kN", "3e6 mN"])
def test_a_force_in_any_unit(force: str) -> None:
    """v = f/m t."""
    outcome = run(
        "simulate", "cart.py", "--input", f"f={force}", "--input", "share=100%", "--stop-time", "1", "-o", "c.mat"
    )
    assert outcome.code == 0, outcome.err
    assert acausal.result.result.load("c.mat").final("mass.v") == pytest.approx(1500.0, rel=1e-6)


@pytest.mark.parametrize(
    ("given", "code", "words"),
    [
        ("f=3kg", "AC151", "--input f=3kg"),
        ("f=much", "AC152", "--input f=much"),
        ("f", "AC009", "write NAME=VALUE"),
        ("share=1N", "AC151", 'does not fit a quantity in "1"'),
        ("g=1", "AC033", "inputs of Cart: f, share"),
        ("g=1kN", "AC010", "declares no 'g'"),
    ],
)
def test_wrong_inputs(given: str, code: str, words: str) -> None:
    outcome = run("simulate", "cart.py", "--input", given, "--no-output")
    assert outcome.code == 2
    assert code in outcome.err
    assert words in outcome.err


def test_a_force_from_a_file_and_a_start(folder: Path) -> None:
    """From 1 m/s: v = 1 + 1/2 kg * (250 + 500) N s."""
    (folder / "f.csv").write_text("time [ms],force [kN]\n0,0\n500,1\n1000,1\n")
    words = "simulate cart.py --input f=f.csv:force --input share=1 --start mass.v=100cm/s --stop-time 1 -o c.mat"
    outcome = run(*words.split())
    assert outcome.code == 0, outcome.err
    assert acausal.result.result.load("c.mat").final("mass.v") == pytest.approx(376.0, rel=1e-6)
    again = run(
        *["simulate", "cart.py", "--input", "f=c.mat:f", "--input", "share=1", "--stop-time", "1", "-o", "d.mat"]
    )
    assert again.code == 0, again.err
    assert acausal.result.result.load("d.mat").final("mass.v") == pytest.approx(375.0, rel=1e-5)


def test_a_source_is_freed() -> None:
    words = "simulate cart.py --free force.u --input f=0 --input share=0 --input force.u=3kN --stop-time 1 -o c.mat"
    outcome = run(*words.split())
    assert outcome.code == 0, outcome.err
    assert acausal.result.result.load("c.mat").final("mass.v") == pytest.approx(1500.0, rel=1e-6)


@pytest.mark.parametrize(
    ("words", "code"),
    [
        ("--input f=1 --input f=2", "AC009"),
        ("--start mass.v=1kg", "AC151"),
        ("--start mass.w=1", "AC046"),
        ("--start mass.w=1mm", "AC010"),
        ("--free force.f", "AC047"),
        ("--interpolation cubic", "AC009"),
        ("--input f=none.csv", "AC014"),
    ],
)
def test_wrong_words(words: str, code: str) -> None:
    outcome = run(*["simulate", "cart.py", "--input", "share=1", "--no-output"], *words.split())
    assert (outcome.code, code in outcome.err) == (2, True), outcome.err
