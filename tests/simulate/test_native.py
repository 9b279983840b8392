"""Compiled C gives the interpreter's numbers, is found again on disk, and is never needed."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest

import acausal
from acausal import Component, Equations, Real, der, fixed, guess, parameter, private, quantity, time, variable, where
from acausal.errors import IntegrationError
from acausal.simulate.native import cache, policy
from acausal.simulate.native.cache import native

COMPILER = pytest.mark.skipif(cache.compiler() is None, reason="no C compiler on this machine")


class Oscillator(Component):
    """A cubic spring that is pulled from t = 1 on: two segments."""

    k: Real = parameter(default=4.0, unit="")
    x: Real = variable(default=fixed(1.0), unit="")
    v: Real = variable(default=fixed(0.0), unit="")

    def equations(self) -> Equations:
        yield der(self.x) == self.v
        yield der(self.v) == where(time < 1.0, 0.0, 0.5) - self.k * self.x - self.x * self.x * self.x


class Loop(Component):
    """dx/dt = -y with y + y**3 = x: an algebraic variable that only Newton's method finds."""

    x: Real = variable(default=fixed(2.0), unit="")
    y: Real = variable(default=guess(1.0), unit="")

    def equations(self) -> Equations:
        yield der(self.x) == -self.y
        yield self.y + self.y * self.y * self.y == self.x


class Explosion(Component):
    """dx/dt = x**2 from 1 is 1/(1 - t)."""

    x: Real = variable(default=fixed(1.0), unit="")

    def equations(self) -> Equations:
        yield der(self.x) == self.x * self.x


@pytest.fixture
def empty(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A cache of its own."""
    monkeypatch.setenv("ACAUSAL_CACHE", str(tmp_path))
    return tmp_path / "native"


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """One cache for the tests that do not look into it."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ACAUSAL_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture
def compilations(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Sources that were given to the compiler."""
    given: list[str] = []
    build = subprocess.Popen

    def counted(command: list[str], **options: Any) -> Any:
        given.append(command[0])
        return build(command, **options)

    monkeypatch.setattr(subprocess, "Popen", counted)
    return given


def libraries(folder: Path) -> list[Path]:
    return sorted(p for p in folder.iterdir() if p.is_file() and p.name != "secret")


def run(solver: str, native: bool | None, **options: Any) -> acausal.Result:
    """A run of a newly compiled model, as in a new process."""
    return acausal.simulate(Oscillator(), solver=solver, stop_time=3.0, native=native, **options)


@COMPILER
@pytest.mark.usefixtures("shared")
@pytest.mark.parametrize(
    ("solver", "step"),
    [
        ("rosenbrock", None),
        *(pytest.param(solver, 1e-3, marks=pytest.mark.slow) for solver in ("rosenbrock", "erk")),
        ("erk", None),
        ("rk2", 1e-3),
    ],
)
def test_same_numbers(solver: str, step: float | None) -> None:
    """With one row at the end, or fixed steps: rows inside of steps are not of compiled code only."""
    options: dict[str, Any] = {"step": step, "tolerance": 1e-8, **({"output_interval": 3.0} if step is None else {})}
    there, here = (run(solver, native, **options) for native in (True, False))
    assert (there.stats["native"], here.stats["native"]) == (True, False)
    assert there.stats["steps"] == here.stats["steps"]
    assert there.stats["rhs_evaluations"] == here.stats["rhs_evaluations"]
    np.testing.assert_allclose(there.matrix, here.matrix, rtol=1e-12, atol=1e-12)


@COMPILER
@pytest.mark.usefixtures("shared")
@pytest.mark.parametrize("solver", ["rosenbrock", "erk"])
def test_rows_make_no_steps(solver: str) -> None:
    """A smooth run takes as many steps for a thousand rows as for one, and each row has the accuracy of its steps."""
    compiled = acausal.compile(Swing())
    few, many = (
        acausal.simulate(compiled, stop_time=10.0, output_interval=dt, solver=solver, native=True, tolerance=1e-6)
        for dt in (10.0, 0.01)
    )
    assert float(str(many.stats["steps"])) <= 1.25 * float(str(few.stats["steps"]))
    assert np.abs(many["x"] - np.cos(2.0 * many.time)).max() <= 0.05 * 1e-6  # solvers get a hundredth of the tolerance


class Swing(Component):
    """x = cos(2 t)."""

    x: Real = variable(default=fixed(1.0), unit="1")
    v: Real = variable(default=fixed(0.0), unit="1/s")

    def equations(self) -> Equations:
        yield der(self.x) == self.v
        yield der(self.v) == -quantity(4.0, "1/s2") * self.x


@COMPILER
@pytest.mark.usefixtures("shared")
@pytest.mark.parametrize("solver", ["rosenbrock", "idas"])
def test_same_numbers_with_an_algebraic_variable(solver: str) -> None:
    options: dict[str, Any] = {"solver": solver, "stop_time": 2.0, "tolerance": 1e-8}
    there, here = (acausal.simulate(Loop(), native=native, **options) for native in (True, False))
    assert there.stats["native"]
    # interpreted, one-step methods end a step at each output: other steps, a tenth of the tolerance apart at most
    np.testing.assert_allclose(there.matrix, here.matrix, rtol=1e-12 if solver == "idas" else 1e-9)
    # dt = -dx/y with dx = (1 + 3 y^2) dy gives t = F(1) - F(y), F = ln y + 3 y^2 / 2, from y = 1 at x = 2
    y = there.final("y")
    assert 1.5 - (np.log(y) + 1.5 * y**2) == pytest.approx(2.0, abs=1e-7)


@COMPILER
@pytest.mark.usefixtures("shared")
def test_equations_of_a_multistep_method() -> None:
    there, here = (run("cvodes", native, tolerance=1e-8) for native in (True, False))
    assert there.stats["native"]
    np.testing.assert_allclose(there.matrix, here.matrix, rtol=1e-6, atol=1e-7)


@COMPILER
def test_one_library_for_all_runs(empty: Path, compilations: list[str]) -> None:
    """Parameters, tolerance, length and outputs are arguments of a library, and another process finds it."""
    first = run("rosenbrock", True)
    assert len(compilations) == 1
    # rows lie inside of steps in C, and end them where it is interpreted
    for options in ({"tolerance": 1e-9}, {"parameters": {"k": 9.0}}, {"output_interval": 0.01}, {"start_time": 0.5}):
        again = run("rosenbrock", True, **options)
        assert again.stats["native"]
        np.testing.assert_allclose(again.matrix, run("rosenbrock", False, **options).matrix, rtol=1e-6, atol=1e-6)
    assert np.array_equal(run("rosenbrock", None).matrix, first.matrix)
    assert len(compilations) == 1
    assert len(libraries(empty)) == 1


@COMPILER
def test_steps_are_arguments_too(empty: Path, compilations: list[str]) -> None:
    for step in (1e-2, 3e-3):
        np.testing.assert_allclose(
            run("rk2", True, step=step).matrix, run("rk2", False, step=step).matrix, rtol=1e-12, atol=1e-12
        )
    assert len(compilations) == 1


def test_no_compiler(empty: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "which", lambda name: None)
    result = run("rosenbrock", True)
    assert not result.stats["native"]
    assert np.array_equal(result.matrix, run("rosenbrock", False).matrix)
    x = ca.SX.sym("x")
    assert native(ca.Function("f", [x], [x])) is None


@pytest.mark.skipif(os.name == "nt", reason="a compiler made of a shell script")
def test_failing_compiler(empty: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    script = tmp_path / "cc"
    script.write_text("#!/bin/sh\nexit 1\n")
    script.chmod(0o755)
    monkeypatch.setenv("CC", str(script))
    assert not run("erk", True).stats["native"]
    assert libraries(empty) == []


@COMPILER
def test_folder_that_cannot_be_made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("ACAUSAL_CACHE", str(tmp_path / "file"))
    assert run("erk", True).stats["native"]  # in a temporary one


# The library is loaded in this process: a file is replaced, never written into.


def _torn(path: Path) -> None:
    """Half of the file: what is left after a full disk."""
    half = path.read_bytes()[:5000]
    path.unlink()
    path.write_bytes(half)


def _not_a_library(path: Path) -> None:
    """Whole, but nothing that can be loaded."""
    path.unlink()
    path.write_bytes(b"text")
    path.rename(
        path.with_name(f"{path.stem.rpartition('-')[0]}-{private.digest(path.read_bytes(), path.parent)}{path.suffix}")
    )


@COMPILER
@pytest.mark.parametrize("damage", [_torn, pytest.param(_not_a_library, marks=pytest.mark.slow)])
def test_damaged_library_is_made_again(empty: Path, damage: Callable[[Path], None], compilations: list[str]) -> None:
    good = run("erk", True)
    damage(libraries(empty)[0])
    assert np.array_equal(run("erk", True).matrix, good.matrix)
    assert len(compilations) == 2
    assert len(libraries(empty)) == 1


@COMPILER
def test_two_at_once(empty: Path) -> None:
    """The same key from several threads: every one of them gets a whole library."""
    source = "double twice(double x) { return 2 * x; }"
    with ThreadPoolExecutor(4) as pool:
        made = list(pool.map(lambda _: cache.build("key", source), range(4)))
    assert set(made) == {cache.find("key")} != {None}


def test_a_short_first_run_is_interpreted(empty: Path, compilations: list[str]) -> None:
    assert not run("rosenbrock", None).stats["native"]
    assert compilations == []


@COMPILER
def test_repeated_runs_become_compiled(empty: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By default from the run on before which interpreting has cost as much as compiling does."""
    monkeypatch.setattr(policy, "_START", 1e-3)
    monkeypatch.setattr(policy, "_COMPILED_INSTRUCTION", 0.0)
    compiled = acausal.compile(Oscillator())
    used = [acausal.simulate(compiled, solver="erk", stop_time=30.0).stats["native"] for _ in range(3)]
    assert used == [False, True, True]


def test_when_it_pays() -> None:
    """Break-even of docs/devdocs/native.md: 0.57 s for 227 instructions at 2.4 us an evaluation."""
    assert not policy.pays(200_000, 227)
    assert policy.pays(260_000, 227)
    assert policy.pays(90_000, 6803)
    assert not policy.pays(1_000, 100_000)


@COMPILER
@pytest.mark.usefixtures("shared")
def test_any_function(compilations: list[str]) -> None:
    x = ca.SX.sym("x", 2)
    f = ca.Function("f", [x], [ca.sin(x[0]) * x[1]], ["x"], ["y"])
    for _ in range(2):
        compiled = native(f, f.jacobian())
        assert compiled is not None
        assert compiled.name() == "f"
        assert float(compiled([0.5, 2.0])) == 2.0 * np.sin(0.5)
        slope = compiled.jacobian()([0.5, 2.0], 0.0)
        np.testing.assert_allclose(np.array(slope), [[2.0 * np.cos(0.5), np.sin(0.5)]], rtol=1e-15)
    assert len(compilations) == 1


@COMPILER
@pytest.mark.usefixtures("shared")
@pytest.mark.parametrize("solver", ["rosenbrock", "erk"])
def test_failure_keeps_what_was_computed(solver: str) -> None:
    """x = 1/(1 - t) has no value at t = 1."""
    with pytest.raises(IntegrationError) as caught:
        acausal.simulate(Explosion(), solver=solver, stop_time=2.0, output_interval=0.1, native=True)
    result = caught.value.result
    assert isinstance(result, acausal.Result)
    assert result.stats["native"]
    assert result.at(0.5, "x") == pytest.approx(2.0, rel=1e-5)


@COMPILER
@pytest.mark.usefixtures("shared")
@pytest.mark.skipif(os.name == "nt", reason="signals to oneself")
def test_ctrl_c() -> None:
    """A step too small to come to an end with; Python would not see the signal before."""
    run("rk2", True, step=1e-2)
    # a shell starts what it runs in the background without that handler
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        threading.Timer(0.2, lambda: os.kill(os.getpid(), signal.SIGINT)).start()
        with pytest.raises(KeyboardInterrupt):
            run("rk2", True, step=1e-10)
    finally:
        signal.signal(signal.SIGINT, before)


def test_compiled_code_that_is_not_to_be_had_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    """`native=True` never fails; the command line prints the note."""
    monkeypatch.setattr(cache, "compiler", lambda: None)
    notes = run("idas", True).stats["notes"]
    assert isinstance(notes, tuple)
    assert any("no C compiler was found" in note for note in notes)
