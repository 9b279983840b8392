"""Heat ports left open, temperatures fixed twice, tables that are none, and what the command line says to slips."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from acausal.cli.main import app
from tests.messages.cases import Case, Corpus

corpus = Corpus()


corpus.table(
    """
HeatWithoutEnd AC205 heater and conductor
# A heat flow into a conductor that leads nowhere; alpha = 0 is no reason, being the default.
heater: thermal.FixedHeatFlow = <<thermal.FixedHeatFlow(Q_flow=1.0)>>
conductor: thermal.ThermalConductor = <<thermal.ThermalConductor(G=1.0)>>
yield connect(self.heater.port, self.conductor.port_a)

CoilThatCannotGiveHeat AC212 coil.heatPort
# A heat port that is left open.
source: electrical.ConstantVoltage = electrical.ConstantVoltage(V=1.0)
coil: electrical.HeatingResistor = <<electrical.HeatingResistor(R_ref=1.0)>>
ground: electrical.Ground = electrical.Ground()
yield connect(self.source.p, self.coil.p)
yield connect(self.source.n, self.coil.n, self.ground.p)

BodyOfAnotherTemperature AC302 body.T
body: thermal.HeatCapacitor = <<thermal.HeatCapacitor(C=1.0, T=fixed(400.0))>>
outside: thermal.FixedTemperature = thermal.FixedTemperature(T=300.0)
yield connect(self.body.port, self.outside.port)

TableThatGoesBack AC130 table (TimeTable)
# The library refuses the table; it is named by the component that has it.
table: blocks.TimeTable = <<blocks.TimeTable(table=((0.0, 1.0), (2.0, 1.0), (1.0, 0.0)))>>
""",
    globals(),
)


@pytest.mark.parametrize("case", corpus.cases, ids=str)
def test_message(case: Case) -> None:
    case.check()


HEAD = """from acausal import Component, Real, connect, der, part, sqrt, variable, fixed
from acausal.library import translational
"""
MODEL = """class M(Component):
    x: Real = variable(default=fixed(0.5))
    y: Real = variable()
    masses: list[translational.Mass] = part()
    def build(self):
        self.masses = [translational.Mass(m=1.0)]
    def equations(self):
        yield der(self.x) == -1.0
        yield self.y == {}
"""


def said(folder: Path, source: str) -> list[str]:
    """Lines that `acausal simulate` prints for a file."""
    file = folder / "model.py"
    file.write_text(HEAD + source)
    arguments = ["simulate", f"{file}:M", "--stop-time", "1", "-o", str(folder / "r.mat")]
    return CliRunner().invoke(app, arguments).output.splitlines()


@pytest.mark.parametrize(
    ("source", "fact", "advice"),
    [
        (MODEL.format("x"), "M.equations raised NameError: name 'x' is not defined", "write self.x"),
        (MODEL.format("sqr(self.x)"), "M.equations raised NameError: name 'sqr' is not defined", "did you mean sqrt?"),
        (
            MODEL.format("translational.Mas(m=1.0).m"),
            "M.equations raised AttributeError: module 'acausal.library.translational' has no attribute 'Mas'",
            "did you mean Mass",
        ),
        (MODEL.format("2.0 * time"), "M.equations raised NameError: name 'time'", "from acausal import time"),
        (
            MODEL.format("self.x.der()"),
            "M.equations raised AttributeError: 'Symbol' object has no attribute 'der'",
            "write der(self.x)",
        ),
        (
            "from acausal import time\n" + MODEL.format("time()"),
            "M.equations raised TypeError: 'Operation' object is not callable",
            "an expression is not a function: write time",
        ),
        ("import acausal.library.electric\n", "model.py raised ModuleNotFoundError", "did you mean electrical?"),
        (
            "from acausal.library.electrical import Resistr\n",
            "model.py raised ImportError: cannot import name 'Resistr'",
            "did you mean Resistor",
        ),
    ],
)
def test_slips_of_python_are_named_with_class_and_method(tmp_path: Path, source: str, fact: str, advice: str) -> None:
    lines = said(tmp_path, source)
    assert lines[0].startswith(f"error[AC002]: {fact}")
    assert lines[1].startswith("  at      ")
    assert any(line.startswith(f"  help    {advice}") for line in lines)


def test_a_signal_that_loses_its_value_is_named(tmp_path: Path) -> None:
    """Nothing depends on y, so the run goes on; x passes zero at 0.5 s."""
    lines = said(tmp_path, MODEL.format("sqrt(self.x)"))
    assert any(
        line.startswith("note: y has no finite value at t = 0.5") and line.endswith("and after") for line in lines
    )


@pytest.mark.parametrize(
    ("source", "fact", "advice"),
    [
        (
            "class M(Component):\n    x: Real = variable(start=1.0)\n",
            "variable has no argument 'start'",
            "write default=fixed(...) or default=guess(...)",
        ),
        (
            "from acausal import parameter\nclass M(Component):\n    k: Real = parameter(value=1.0)\n",
            "parameter has no argument 'value'",
            "write default=...",
        ),
        (
            "from acausal import parameter\nclass M(Component):\n    k: Real = parameter(2.0)\n",
            "parameter takes its arguments by name",
            "default, unit",
        ),
        ("class M(Component):\n    k: Real = 2.0\n", "M.k is the plain number 2.0", "k: Real = parameter(default=2.0)"),
        (
            "class M(Component):\n    m: translational.Mass = translational.Mass\n",
            "M.m is the class Mass, not a component",
            "m: Mass = Mass(...)",
        ),
    ],
)
def test_slips_of_declarations_are_refused_in_python_too(tmp_path: Path, source: str, fact: str, advice: str) -> None:
    """They were a TypeError, and `m: Mass = Mass` and `k: Real = 2.0` were no fields without a word."""
    lines = said(tmp_path, source)
    assert lines[0].partition("]: ")[2].startswith(fact)
    assert source.splitlines()[-1].strip() in "\n".join(lines)
    assert advice in lines[-1]
