"""Mistakes on the command line: code, exit code, place in the user's file, nothing half-written."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from acausal.result.result import load
from tests.cli.running import Outcome, run

HEAD = """from __future__ import annotations

import math

from acausal import *
from acausal.library.rotational import Inertia
from acausal.library.translational import Force, Mass


class M(Component):
"""
FIRST = HEAD.count("\n") + 1
"""Line of what stands first in the class."""

# Body of the class, code, words of the message, and the line that must be shown, counted from the first of the body;
# None where several lines are as guilty as each other.
MODELS: dict[str, tuple[str, str, int | None, tuple[str, ...]]] = {
    "missing parameter": (
        '    k: Real = parameter(unit="N/m", doc="Stiffness")\n    x: Real = variable(default=1.0)\n'
        "    def equations(self) -> Equations:\n        yield der(self.x) == -self.k * self.x\n",
        "AC133",
        0,
        ("k", "N/m"),
    ),
    "missing parameter of a part": (
        "    mass: Mass = part()\n    def build(self) -> None:\n        self.mass = Mass(s=0.0, v=0.0)\n",
        "AC133",
        2,
        ("mass.m", "kg"),
    ),
    "unconnected input": (
        "    mass: Mass = part()\n    force: Force = part()\n    def build(self) -> None:\n"
        "        self.mass = Mass(m=1.0, s=0.0, v=0.0)\n        self.force = Force()\n"
        "    def equations(self) -> Equations:\n        yield connect(self.force.flange, self.mass.flange_a)\n",
        "AC209",
        4,
        ("force.u",),
    ),
    "too many equations": (
        '    x: Real = variable(unit="m")\n    def equations(self) -> Equations:\n'
        "        yield self.x == 1.0\n        yield self.x == 2.0\n",
        "AC202",
        None,
        ("x",),
    ),
    "too few equations": (
        '    x: Real = variable(unit="m")\n    y: Real = variable(unit="m")\n    def equations(self) -> Equations:\n'
        "        yield self.x + self.y == 1.0\n",
        "AC201",
        None,
        ("x", "y"),
    ),
    "connecting different connectors": (
        "    mass: Mass = part()\n    inertia: Inertia = part()\n    def build(self) -> None:\n"
        "        self.mass = Mass(m=1.0, s=0.0, v=0.0)\n        self.inertia = Inertia(J=1.0)\n"
        "    def equations(self) -> Equations:\n        yield connect(self.mass.flange_a, self.inertia.flange_a)\n",
        "AC120",
        6,
        ("translational.Flange", "rotational.Flange"),
    ),
    "if on a symbol": (
        "    x: Real = variable(default=1.0)\n    def equations(self) -> Equations:\n"
        "        if self.x > 0.0:\n            yield der(self.x) == -1.0\n",
        "AC101",
        2,
        ("where(",),
    ),
    "math.sin on a symbol": (
        "    x: Real = variable(default=1.0)\n    def equations(self) -> Equations:\n"
        "        yield der(self.x) == math.sin(self.x)\n",
        "AC104",
        2,
        ("acausal.sin",),
    ),
    "division by zero at the start": (
        "    x: Real = variable(default=0.0)\n    def equations(self) -> Equations:\n"
        "        yield der(self.x) == 1.0 / self.x\n",
        "AC303",
        2,
        ("x = 0",),
    ),
    "value outside its limits": (
        "    mass: Mass = part()\n    def build(self) -> None:\n        self.mass = Mass(m=-1.0, s=0.0, v=0.0)\n",
        "AC136",
        2,
        ("mass.m", "-1 kg"),
    ),
    "wrong dimension in an equation": (
        '    s: Real = variable(unit="m", default=0.0)\n    def equations(self) -> Equations:\n'
        "        yield der(self.s) == self.s\n",
        "AC155",
        2,
        ("m/s",),
    ),
    "no yield": (
        "    x: Real = variable()\n    def equations(self) -> Equations:\n        self.x == 1.0\n",
        "AC129",
        1,
        ("yield",),
    ),
    "Python's own error": (
        "    x: Real = variable()\n    def equations(self) -> Equations:\n        yield self.x == lenght\n",
        "AC002",
        2,
        ("NameError", "lenght"),
    ),
    "field without annotation": ("    x = variable()\n", "AC112", 0, ("M.x",)),
    "no Python": ("    x: Real = variable(\n", "AC002", 0, ("Python",)),
    "a package that is not there": ("    import nowhere_to_be_found\n", "AC002", 0, ("nowhere_to_be_found",)),
}


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty current folder."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    return tmp_path


def assert_clean(outcome: Outcome, code: str, exit_code: int, folder: Path, *left: str) -> None:
    """A coded message on stderr, no traceback, nothing on stdout, no file but `left`."""
    assert outcome.err.startswith(f"error[{code}"), outcome.err
    assert outcome.code == exit_code
    assert "Traceback" not in outcome.err
    assert outcome.out == ""
    assert {p.name for p in folder.iterdir()} - {"__pycache__"} == set(left)


@pytest.mark.parametrize("verb", ["simulate", "check"])
@pytest.mark.parametrize("case", MODELS)
def test_mistake_in_a_model(case: str, verb: str, folder: Path) -> None:
    body, code, line, words = MODELS[case]
    Path("m.py").write_text(HEAD + body)
    outcome = run(verb, "m.py:M")
    assert_clean(outcome, code, 1, folder, "m.py")
    assert f"{folder / 'm.py'}:" + ("" if line is None else str(FIRST + line)) in outcome.err
    for word in words:
        assert word in outcome.err


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (("Oscilator",), "AC001", ("Oscillator",)),
        (("nothing.py",), "AC001", ("nothing.py",)),
        (("Oscillator", "--set", "spring.k=3"), "AC020", ("did you mean",)),
        (("ThinPlate", "--set", "workpiece.t=1kg"), "AC151", ("workpiece.t", '"1 kg"', "mm")),
        (("ThinPlate", "--set", "workpiece.t=-1mm"), "AC136", ("workpiece.t = -0.001 m", "1e-06 ... inf")),
        (("Oscillator", "--set", "m"), "AC003", ("path=value",)),
        (("Oscillator", "--set", "m=2kg", "--set", " m = 3kg"), "AC003", ("m twice: 2kg and 3kg",)),
        (("Oscillator", "-o", "no/such/folder/o.mat"), "AC012", ("no/such/folder/o.mat", "No such file")),
        (("Oscillator", "-o", "o.xls"), "AC013", (".mat, .csv, .npz",)),
        (("Oscillator", "--plot-file", "o.bmp"), "AC013", (".png, .svg, .pdf",)),
        (("Oscillator", "-o", "o.mat", "--no-output"), "AC009", ("--no-output",)),
        (("Oscillator", "--solver", "dassl"), "AC032", ("idas",)),
        (("Oscillator", "--stop-time", "-1"), "AC030", ("stop_time",)),
        (("Oscillator", "--stop-time", "1kg"), "AC151", ("--stop-time", "ms")),
        (("Oscillator", "--tolerance", "0"), "AC030", ("tolerance",)),
    ],
)
def test_mistake_in_the_command(arguments: tuple[str, ...], code: str, words: tuple[str, ...], folder: Path) -> None:
    outcome = run("simulate", *arguments)
    assert_clean(outcome, code, 2, folder)
    for word in words:
        assert word in outcome.err


def test_an_unwritable_file_is_found_before_the_run(folder: Path) -> None:
    """The file is a folder; the model would fail too, but that is not reached."""
    Path("m.py").write_text(HEAD + MODELS["division by zero at the start"][0])
    Path("o.mat").mkdir()
    outcome = run("simulate", "m.py", "-o", "o.mat")
    assert_clean(outcome, "AC012", 2, folder, "m.py", "o.mat")


def test_unknown_options_and_verbs_are_usage_errors() -> None:
    for arguments in (("simulate", "Oscillator", "--bar"), ("bar",), ("simulate",), ("simulate", "O", "--step")):
        outcome = run(*arguments)
        assert outcome.code == 2
        assert "Traceback" not in outcome.err


def test_a_failed_run_keeps_what_it_had(folder: Path) -> None:
    """x' = x^2 from 1 is 1/(1 - t): it ends at t = 1, whatever the solver does."""
    body = (
        "    x: Real = variable(default=1.0)\n    experiment = Experiment(stop_time=2.0)\n"
        "    def equations(self) -> Equations:\n        yield der(self.x) == self.x * self.x\n"
    )
    Path("m.py").write_text(HEAD + body)
    outcome = run("simulate", "m.py")
    assert outcome.code == 1
    assert "saved the run up to" in outcome.err
    assert "error[AC4" in outcome.err
    assert "der(x)" in outcome.err
    assert "Traceback" not in outcome.err
    result = load("M.mat")
    assert 0.9 < result.time[-1] <= 1.001
    assert result.at(0.5, "x") == pytest.approx(2.0, rel=1e-3)


def test_an_interrupted_run_keeps_what_it_had(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ctrl-C while the first part is reported as done."""
    from acausal.cli.run.progress import ProgressBar

    calls: list[float] = []

    def pressed(self: ProgressBar, fraction: float, reached: float) -> None:
        calls.append(reached)
        raise KeyboardInterrupt

    monkeypatch.setattr(ProgressBar, "__call__", pressed)
    outcome = run("simulate", "Oscillator")
    assert outcome.code == 130
    assert "error[AC490]: interrupted at t = " in outcome.err
    assert load("Oscillator.mat").time[-1] == pytest.approx(calls[-1])


def test_a_defect_of_acausal_is_one_line_unless_wanted(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object, **__: object) -> None:
        raise ZeroDivisionError("division by zero")

    # The code object must seem to be the compiler's: the place decides who is to blame.
    broken.__code__ = broken.__code__.replace(co_filename=sys.modules["acausal.errors"].__file__ or "")
    monkeypatch.setattr("acausal.lower.compile.compile", broken)
    outcome = run("check", "Oscillator")
    assert outcome.code == 1
    assert outcome.err.startswith("error[AC999]: defect in acausal: ZeroDivisionError")
    assert "Traceback" not in outcome.err
    assert "Traceback" in run("check", "Oscillator", "--debug").err
    assert "Traceback" in run("--debug", "check", "Oscillator").err
    monkeypatch.setenv("ACAUSAL_DEBUG", "1")
    assert "Traceback" in run("check", "Oscillator").err


def test_brackets_in_messages_are_no_markup() -> None:
    outcome = run("simulate", "RCLadder", "--set", "resistors[0].X=3")
    assert "resistors[0].X" in outcome.err


def test_a_file_with_nul_bytes_is_named(tmp_path: Path) -> None:
    """What an interrupted download leaves."""
    (tmp_path / "holes.py").write_bytes(b"from acausal import *\n\0\0\nclass A(Component): pass\n")
    outcome = run("check", tmp_path / "holes.py")
    assert outcome.code == 1
    assert "error[AC002]: holes.py is not Python" in outcome.err


@pytest.mark.parametrize(
    ("rows", "fact"),
    [
        ("0,1\n1,2\n0.5,3\n", "row 3 goes back in time, from 1 s to 0.5 s: sort the rows by time"),
        ("2,1\n1,2\n", "row 2 goes back in time, from 2 s to 1 s"),
        ("0,1\nnan,2\n2,3\n", "the time of row 2 is nan"),
    ],
)
def test_rows_out_of_order_are_named(folder: Path, rows: str, fact: str) -> None:
    """The first was called a defect of ours, the last compared as equal."""
    Path("a.csv").write_text("time,x\n" + rows)
    Path("b.csv").write_text("time,x\n0,1\n1,2\n2,3\n")
    outcome = run("compare", "a.csv", "b.csv")
    assert_clean(outcome, "AC014", 2, folder, "a.csv", "b.csv")
    assert fact in outcome.err


def test_discrete_variables_are_no_states(folder: Path) -> None:
    """One der(...), two booleans and a counter."""
    body = (
        "    x: Real = variable(default=fixed(1.0))\n    a: Real = boolean()\n    b: Real = boolean()\n"
        "    n: Real = discrete(default=0.0)\n"
        "    def equations(self) -> Equations:\n        yield der(self.x) == -self.x\n"
        "        yield self.a == (self.x > 0.5)\n        yield self.b == (self.x > 0.7)\n"
        "        yield when(self.x < 0.6, reset(self.n, 1.0))\n"
    )
    Path("m.py").write_text("from acausal import *\nclass M(Component):\n" + body)
    assert run("check", "m.py").out.startswith("M: 4 equations, 4 unknowns, 1 state, 3 discrete variables")
    out = run("simulate", "m.py").out
    assert "an ODE of 1 state with events" in out
    assert "4 equations, 1 state," in out
