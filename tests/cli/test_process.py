"""The command as a process: start-up, streams, signals."""

from __future__ import annotations

import importlib.metadata
import signal
import subprocess
import sys
import time
import weakref
from pathlib import Path
from typing import Any

import pytest

from acausal.cli.doctor import _native
from acausal.cli.output.failure import report_unraisable
from acausal.result.result import load
from tests.cli.running import ROOT, run, spawn, start

ENDLESS = '''from __future__ import annotations

from pathlib import Path

from acausal import *


class Endless(Component):
    """Van der Pol's oscillator, much longer than anybody waits."""

    x: Real = variable(default=2.0)
    v: Real = variable(default=0.0)
    experiment = Experiment(stop_time=2e5, output_interval=10.0)

    def equations(self) -> Equations:
        Path("begun").touch()
        yield der(self.x) == self.v
        yield der(self.v) == 5.0 * (1.0 - self.x * self.x) * self.v - self.x
'''


def test_help_loads_nothing_heavy(folder: Path) -> None:
    """The measure of a fast start that does not depend on the machine: what is imported."""
    program = (
        "import sys\nfrom acausal.cli.main import app\n"
        "try:\n    app(['--help'], prog_name='acausal')\nexcept SystemExit:\n    pass\n"
        "print([m for m in ('numpy', 'casadi', 'scipy', 'matplotlib', 'pandas', 'xarray', 'pint') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, cwd=ROOT, check=True)
    assert done.stdout.splitlines()[-1] == "[]"
    assert "simulate" in done.stdout


def test_version(folder: Path) -> None:
    outcome = run("--version")
    assert outcome.code == 0
    assert outcome.out.startswith("acausal")
    try:
        assert importlib.metadata.version("acausal") in outcome.out
    except importlib.metadata.PackageNotFoundError:
        assert "not installed" in outcome.out


def test_the_script_of_the_package_is_the_app() -> None:
    assert 'acausal = "acausal_command:run"' in (ROOT / "pyproject.toml").read_text()


def test_simulate_separates_the_streams(folder: Path) -> None:
    outcome = spawn("simulate", "Oscillator", folder=folder)
    assert outcome.code == 0, outcome.err
    assert "final values" in outcome.out
    assert outcome.err.strip() == "wrote Oscillator.mat (34 signals, 501 rows)"


@pytest.mark.parametrize(
    ("number", "code", "word"),
    [(signal.SIGINT, 130, "interrupted"), pytest.param(signal.SIGTERM, 143, "terminated", marks=pytest.mark.slow)],
)
def test_who_ends_a_run_keeps_what_was_computed(folder: Path, number: int, code: int, word: str) -> None:
    (folder / "endless.py").write_text(ENDLESS)
    with start("simulate", "endless.py", folder=folder) as process:
        while not (folder / "begun").exists() and process.poll() is None:  # on a loaded machine imports take a minute
            time.sleep(0.05)
        time.sleep(0.7)
        process.send_signal(number)
        out, err = process.communicate(timeout=60)
    assert process.returncode == code, err
    assert "Traceback" not in err
    assert word in err
    assert not list(folder.glob(".*part"))
    if "saved the run" in err:
        result = load(folder / "Endless.mat")
        assert 0.0 < result.time[-1] < 2e5
        assert abs(result["x"]).max() == pytest.approx(2.0, abs=0.1)
    else:
        # A slow machine: the first hundredth was not done.
        assert not (folder / "Endless.mat").exists()
    assert out == ""


@pytest.mark.parametrize("delay", [0.15, 0.4, 0.8])
def test_ctrl_c_while_it_begins_prints_no_traceback(folder: Path, delay: float) -> None:
    """During imports, while the model is compiled, and while Python ends."""
    with start("simulate", "ThickBlock", "--no-output", folder=folder) as process:
        time.sleep(delay)
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=60)
    if "wrote nothing" in err:  # a fast machine: it was done
        assert process.returncode == 0
        return
    assert "acausal" not in err or "Traceback" not in err  # before its first line Python itself prints one
    assert process.returncode in (130, 1)


def test_ctrl_c_inside_a_callback_prints_no_traceback(capsys: pytest.CaptureFixture[str]) -> None:
    """Python only prints what is raised in a callback of a weak reference, as modules have while they are imported."""

    class Told:
        pass

    def dropped(error: BaseException) -> str:
        def tell(_: object) -> None:
            raise error

        told = Told()
        kept = weakref.ref(told, tell)
        before, sys.unraisablehook = sys.unraisablehook, report_unraisable
        try:
            del told
        finally:
            sys.unraisablehook = before
        assert kept() is None
        return capsys.readouterr().err

    assert dropped(KeyboardInterrupt()) == ""
    assert "ValueError: 7" in dropped(ValueError(7))


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full")
@pytest.mark.parametrize("verb", [("list",), ("--help",), ("list", "--json")])
def test_a_full_disk_behind_standard_output(folder: Path, verb: tuple[str, ...]) -> None:
    with open("/dev/full", "w") as full, start(*verb, folder=folder, stdout=full) as process:
        _, err = process.communicate(timeout=60)
    assert process.returncode == 2
    assert err.startswith("error[AC012]: cannot write")
    assert len(err.splitlines()) == 1


def test_a_closed_pipe_is_no_error(folder: Path) -> None:
    with start("equations", "ThickBlock", folder=folder) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.readline()
        process.stdout.close()
        assert "Traceback" not in process.stderr.read()


def test_doctor_finds_this_installation_healthy(folder: Path) -> None:
    outcome = run("doctor")
    assert outcome.code == 0, outcome.out
    assert "broken" not in outcome.out
    for name in ("casadi", "solver idas", "solver rosenbrock", "compiling a model"):
        assert name in outcome.out


def test_doctor_names_a_compiler_that_does_not_work(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is there and fails: runs would be interpreted for ever."""
    command = folder / "cc"
    command.write_text("#!/bin/sh\necho no licence >&2\nexit 1\n")
    command.chmod(0o755)
    monkeypatch.setenv("CC", str(command))
    found = next(f for f in _native() if f.name == "C compiler")
    assert (found.status, "no licence" in found.detail) == ("broken", True)


def test_verbs_share_their_words() -> None:
    """What several verbs take is spelled, abbreviated and valued alike; each verb has an example."""
    import typer.main

    from acausal.cli.main import app

    group: Any = typer.main.get_command(app)
    verbs = dict(group.commands)
    verbs |= {f"export {name}": inner for name, inner in verbs.pop("export").commands.items()}
    spelled: dict[str, set[tuple[str, ...]]] = {}
    for name, verb in verbs.items():
        assert "Example" in verb.help, name
        for p in verb.params:
            if p.param_type_name == "option":
                spelled.setdefault(p.opts[0], set()).add((*p.opts[1:], *p.secondary_opts))
        writes = {p.opts[0] for p in verb.params} & {"--output-file", "--plot-file"}
        assert not writes or "-o" in {o for p in verb.params for o in p.opts} or "--plot-file" in writes, name
    assert {name: ways for name, ways in spelled.items() if len(ways) > 1} == {}
    # "--signal", "--output", "--file" and their like were spellings of the same things.
    assert not {"--signal", "--output", "--file", "--out", "--var", "--param", "--parameter"} & set(spelled)
