"""Members of a sweep against closed forms, and against single runs; failures, workers, and files that go on."""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
import sqlite3
import subprocess
import sys
import time
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import closing
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest

import acausal
from acausal import Component, Equations, Range, Real, delay, der, fixed, integer, parameter, reset, variable, when
from acausal import time as time_of_run
from acausal.cli.arguments.reference import find_model
from acausal.errors import InitializationError, RunError, UsageError
from acausal.lower.cache import cache
from acausal.simulate.native import cache as cache_of_c
from acausal.simulate.native import policy
from acausal.study.sweep import member as members
from acausal.study.sweep import workers
from acausal.study.sweep.family import Progress
from tests.lower.test_cache import Choice
from tests.simulate.test_native_foreign import Decaying
from tests.study.sweep.decays import Decay


class Late(Component):
    """y(t) = x(t - T), x = t."""

    T: Real = parameter(default=0.5)
    x: Real = variable(default=fixed(0.0))
    y: Real = variable()

    def equations(self) -> Equations:
        yield der(self.x) == 1.0
        yield self.y == delay(self.x, self.T)


class Switched(Component):
    """n = 0 before `T`, 1 from then on."""

    T: Real = parameter(default=0.5)
    x: Real = variable(default=fixed(0.0))
    n: Real = integer()

    def equations(self) -> Equations:
        yield der(self.x) == self.n
        yield when(time_of_run >= self.T, reset(self.n, 1))


ROOT = Path(__file__).resolve().parents[3]
GRID = {"k": Range(0.5, 2.0, 4), "a": [1.0, 3.0]}


def decays(vary: Any = None, **options: Any) -> acausal.Sweep:
    options = {"signals": ["x", "y"], "stop_time": 1.0, "tolerance": 1e-8, "workers": 1, **options}
    return acausal.sweep(Decay(), GRID if vary is None else vary, **options)


def test_members_are_exponentials() -> None:
    """x = a exp(-k t)."""
    found = decays()
    k, a = found["k"], found["a"]
    exact = a[:, None] * np.exp(-k[:, None] * found.time)
    assert found["x"].shape == (8, 501)
    np.testing.assert_allclose(found["x"], exact, atol=1e-7)
    np.testing.assert_allclose(found["y"], 2.0 * exact, atol=2e-7)
    np.testing.assert_allclose(found.final("x"), a * np.exp(-k), atol=1e-7)
    assert found.status == ("ok",) * 8
    assert (found.unit("x"), found.unit("k")) == ("m", "1/s")
    assert {"k", "a", "x", "y"} <= set(found)
    assert all(name in found for name in found)


@pytest.fixture(scope="module")
def alone() -> list[acausal.Result]:
    """The members of `decays()`, run one by one."""
    compiled = acausal.compile(Decay())
    options: Any = {"stop_time": 1.0, "tolerance": 1e-8, "native": False}
    return [
        acausal.simulate(compiled, parameters={"k": k, "a": a}, **options)
        for k in (0.5, 1.0, 1.5, 2.0)
        for a in (1.0, 3.0)
    ]


@pytest.mark.parametrize("how", ["processes", "threads", "executor"])
def test_all_workers_give_the_numbers_of_single_runs(how: str, alone: list[acausal.Result]) -> None:
    if how == "executor":
        with ThreadPoolExecutor(2) as pool:
            found = decays(executor=pool, workers=None, native=False)
    else:
        found = decays(executor=how, workers=2, native=False)
    for row, own in zip(found["y"], alone, strict=True):
        place = np.searchsorted(own.time, found.time, side="right") - 1
        assert np.array_equal(row, own["y"][place])


def test_what_fails_is_recorded_and_the_others_go_on() -> None:
    found = decays({"a": [1.0, 9.0, 2.0]})
    assert found.status == ("ok", "failed", "ok")
    assert found.failed == (1,)
    assert found.codes[1].startswith("AC5")
    assert "it is too long" in found.messages[1]
    assert np.isnan(found["x"][1]).all()
    assert np.isnan(found.final("x")[1])
    assert found.final("x")[2] == pytest.approx(2.0 * np.exp(-1.0), abs=1e-7)


def test_a_run_that_ends_itself_has_no_rows_behind_its_end() -> None:
    """x = exp(-t) is below 1/2 from t = log 2 on."""
    found = decays({"floor": [0.5, 0.1]})
    assert found.stop_times == pytest.approx([np.log(2.0), 1.0], abs=1e-7)
    assert found.final("x") == pytest.approx([0.5, np.exp(-1.0)], abs=1e-7)
    behind = found.time > np.log(2.0)
    assert np.isnan(found["x"][0, behind]).all()
    assert np.isfinite(found["x"][0, ~behind]).all()


def test_a_value_out_of_its_limits_fails_alone() -> None:
    class Limited(Decay):
        c: acausal.Real = acausal.parameter(default=1.0, min=0.0)

    found = acausal.sweep(Limited(), {"c": [-1.0, 1.0]}, signals=["x"], stop_time=1.0, workers=1)
    assert found.codes == ("AC136", "")


def test_bound_parameters_are_replaced() -> None:
    class Bound(acausal.Component):
        rate: acausal.Real = acausal.parameter(default=4.0, unit="1/s")
        inner: Decay = acausal.part()

        def build(self) -> None:
            self.inner = Decay(k=self.rate / 2.0)

    found = acausal.sweep(Bound(), {"inner.k": [1.0, 3.0]}, signals=["inner.x"], stop_time=1.0, workers=1)
    assert found.final("inner.x") == pytest.approx(np.exp([-1.0, -3.0]), abs=1e-5)


def test_a_member_with_other_states_is_compiled_for_itself() -> None:
    """With k = 2 the model needs other states than with k = 1/2 (AC029); its start contradicts both (AC302)."""
    vary: Any = {"k": [0.5, 2.0]}
    cache.forget()
    found = acausal.sweep(acausal.compile(Choice(k=0.5)), vary, signals=["x"], stop_time=0.1, workers=1)
    assert found.codes == ("AC302", "AC029")
    found = acausal.sweep(Choice(k=0.5), vary, signals=["x"], stop_time=0.1, workers=1)
    assert found.codes == ("AC302", "AC302")
    with pytest.raises(InitializationError, match="AC302"):
        acausal.simulate(Choice(k=2.0), stop_time=0.1)


def test_a_delay_of_zero_is_compiled_for_itself() -> None:
    """x = t, so y = t - T; with T = 0 there is no delay in the equations, whichever member is the first."""
    for values in ([0.0, 0.25], [0.25, 0.0]):
        found = acausal.sweep(Late(), {"T": values}, signals=["y"], stop_time=1.0, workers=1)
        assert found.final("y") == pytest.approx(1.0 - found["T"])


@pytest.mark.parametrize("off", [1e-13, -1e-13, 0.0])
def test_an_event_beside_a_row_takes_its_place(off: float) -> None:
    """n = 1 from `T` on; a row within 1e-12 of an event is that of the event, and was nan in a sweep."""
    found = acausal.sweep(Switched(), {"T": [0.6 + off]}, signals=["n"], output_interval=0.1, workers=1)
    np.testing.assert_array_equal(found["n"][0], [0.0] * 6 + [1.0] * 5)


def test_a_process_that_dies_costs_its_member_only(monkeypatch: pytest.MonkeyPatch) -> None:
    """Workers are forks of this process, and take what stands for `simulate` here with them."""
    if not sys.platform.startswith("linux"):
        pytest.skip("workers are no forks here")
    whole, own = acausal.simulate, os.getpid()

    def deadly(model: Any, **options: Any) -> Any:
        if options["parameters"]["k"] == 1.25 and os.getpid() != own:
            os._exit(9)
        return whole(model, **options)

    monkeypatch.setattr(members, "simulate", deadly)
    rates = [1.0, 1.125, 1.25, 1.5, 1.75, 2.0]
    found = decays({"k": rates}, workers=2)
    assert found.codes == ("", "", "AC412", "", "", "")
    assert found.final("x")[3:] == pytest.approx(np.exp(-np.array(rates[3:])), abs=1e-7)


@pytest.mark.parametrize(
    ("vary", "options", "code"),
    [
        ({"b": [1.0]}, {}, "AC020"),
        ({"n": [1.0, 2.0]}, {}, "AC061"),
        (None, {"signals": ["z"]}, "AC010"),
        (None, {"signals": []}, "AC060"),
        (None, {"solver": "magic"}, "AC032"),
        (None, {"executor": "crowd"}, "AC060"),
        (None, {"workers": 0}, "AC060"),
        (None, {"resume": True}, "AC062"),
        (None, {"inputs": {"u": 1.0}}, "AC033"),
    ],
)
def test_wrong_requests_are_refused_before_the_work(vary: Any, options: Any, code: str) -> None:
    with pytest.raises(UsageError, match=code):
        decays(vary, **options)


def test_many_runs_make_c_worth_it_before_there_are_workers(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """One or two runs of 60 000 evaluations do not pay for a compiler here, two hundred do: the second has it."""
    if cache_of_c.compiler() is None:
        pytest.skip("no C compiler")
    monkeypatch.setenv("ACAUSAL_CACHE", str(tmp_path))
    monkeypatch.setattr(policy, "_START", 0.3)
    used: list[bool] = []

    def watched(model: Any, **options: Any) -> Any:
        if len(used) == 2:
            raise RuntimeError("enough was seen")
        result = acausal.simulate(model, **options)
        used.append(bool(result.stats["native"]))
        return result

    monkeypatch.setattr(members, "simulate", watched)
    vary = {"k": np.linspace(0.5, 2.0, 200)}
    model = acausal.compile(Decay(), cache=False)
    acausal.sweep(model, vary, signals=["x"], stop_time=1.0, solver="erk", step=1e-4, workers=1)
    assert used == [False, True]


def test_a_compiled_model_is_not_compiled_again() -> None:
    compiled = acausal.compile(Decay())
    found = acausal.sweep(compiled, {"k": [1.0, 2.0]}, signals=["x"], stop_time=1.0, workers=1)
    assert found.final("x") == pytest.approx(np.exp([-1.0, -2.0]), abs=1e-5)
    with pytest.raises(UsageError, match="AC060"):
        acausal.sweep(compiled, {"k": [1.0]}, parameters={"a": 2.0})


def test_an_interrupted_sweep_goes_on_where_it_was(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("acausal.study.sweep.workers._CHUNK", 1e-9)  # one member in each
    file = tmp_path / "x.sweep"

    def stop(progress: Progress) -> None:
        if progress.done == 3:
            raise KeyboardInterrupt

    vary, options = {"k": np.linspace(0.5, 2.0, 8)}, {"stop_time": 0.5, "tolerance": 1e-4}
    with pytest.raises(KeyboardInterrupt):
        decays(vary, file=file, progress=stop, **options)  # the first two run before there are chunks
    partial = acausal.load_sweep(file)
    assert partial.status.count("ok") >= 3
    assert "missing" in partial.status
    with pytest.raises(UsageError, match="AC062"):
        decays(vary, file=file, **options)
    seen: list[Progress] = []
    whole = decays(vary, file=file, resume=True, progress=seen.append, **options)
    assert seen[0].done == partial.status.count("ok") + 1
    assert whole.status == ("ok",) * 8
    there = np.array([s == "ok" for s in partial.status])
    assert np.array_equal(whole.seconds[there], partial.seconds[there])  # not run again
    assert whole.final("x") == pytest.approx(np.exp(-0.5 * whole["k"]), abs=1e-3)


@pytest.mark.parametrize(
    ("vary", "options"),
    [
        ({"k": [1.0, 2.5]}, {}),
        ({"a": [1.0, 2.0]}, {}),
        ({"k": [1.0, 2.0]}, {"signals": ["y"]}),
        ({"k": [1.0, 2.0]}, {"stop_time": 2.0}),
        ({"k": [1.0, 2.0]}, {"tolerance": 1e-6}),
        ({"k": [1.0, 2.0]}, {"parameters": {"a": 2.0}}),
    ],
)
def test_another_sweep_does_not_go_on_in_the_file(tmp_path: Path, vary: Any, options: Any) -> None:
    file = tmp_path / "x.sweep"
    decays({"k": [1.0, 2.0]}, file=file)
    with pytest.raises(UsageError, match="AC062"):
        decays(vary, file=file, resume=True, **options)
    assert len(acausal.load_sweep(file)) == 2


def test_a_finished_sweep_is_not_overwritten(tmp_path: Path) -> None:
    """It may have taken hours; repeated without `resume`, it used to be deleted without a word."""
    file = tmp_path / "x.sweep"
    decays({"k": [1.0, 2.0]}, file=file)
    before = file.read_bytes()
    with pytest.raises(
        UsageError, match=r"(?s)AC062.*x\.sweep contains a finished sweep of Decay, 2 of 2 members.*--resume"
    ):
        decays({"k": [3.0]}, file=file)
    assert file.read_bytes() == before


@pytest.mark.parametrize("change", ["stop = 0.5", "final = substr(final, 1, 8)", "grid_rows = substr(grid_rows, 1, 8)"])
def test_damaged_members_are_refused_and_run_again(tmp_path: Path, change: str) -> None:
    """x(1) = exp(-k). SQLite notices neither other bytes in a value nor a value without its end."""
    file = tmp_path / "x.sweep"
    decays({"k": [1.0, 2.0]}, file=file)
    with closing(sqlite3.connect(file)) as database, database:
        database.execute(f"UPDATE members SET {change} WHERE member = 1")
    with pytest.raises(UsageError, match=r"(?s)AC062.*member 1 .*resume=True"):
        acausal.load_sweep(file)
    again = decays({"k": [1.0, 2.0]}, file=file, resume=True)
    assert again.final("x") == pytest.approx(np.exp([-1.0, -2.0]), abs=1e-7)
    assert again.stop_times.tolist() == [1.0, 1.0]


def test_a_changed_model_does_not_go_on_in_the_file(tmp_path: Path) -> None:
    file = tmp_path / "x.sweep"
    acausal.sweep(_written()(), {"k": [1.0]}, file=file, workers=1)
    numbers = "power", "level", "interval", "exponent", "delay", "longest", "limit", "nominal", "simplified", "max_step"
    for number in numbers:
        with pytest.raises(UsageError, match="other model"):
            acausal.sweep(_written(**{number: 3.0})(), {"k": [1.0]}, file=file, workers=1, resume=True)


def _written(
    power: float = 2.0,
    level: float = 0.5,
    interval: float = 0.5,
    exponent: float = 1.0,  # of a parameter that is 1: only other members differ
    delay: float = 0.1,
    longest: float = 9.0,
    limit: float = 9.0,
    nominal: float = 1.0,
    simplified: float = 2.0,
    max_step: float | None = None,
) -> Any:
    class Model(acausal.Component):
        k: acausal.Real = acausal.parameter(default=1.0)
        x: acausal.Real = acausal.variable(default=acausal.fixed(1.0), nominal=nominal)
        y: acausal.Real = acausal.variable(default=acausal.fixed(0.0))
        w: acausal.Real = acausal.variable(default=acausal.guess(1.0))
        d: acausal.Real = acausal.discrete(default=acausal.fixed(0.0))
        experiment: ClassVar[acausal.Experiment] = acausal.Experiment(max_step=max_step)

        def equations(self) -> acausal.Equations:
            yield acausal.der(self.x) == -self.k * self.x * power
            yield acausal.der(self.y) == acausal.where(self.x > level, acausal.delay(self.x, delay, longest), 0.0)
            yield acausal.homotopy(self.w**2, simplified * self.w) == 4.0
            yield acausal.when(acausal.sample(0.0, interval * self.k**exponent), acausal.reset(self.d, self.x))
            yield demand(self.k < limit, "k is too large")

    return Model


demand = acausal.assert_  # which ruff takes for one of unittest


class _Driven(acausal.Component):
    """The integral of an input."""

    k: acausal.Real = acausal.parameter(default=1.0)
    u: acausal.Real = acausal.signal_input()
    x: acausal.Real = acausal.variable(default=acausal.fixed(0.0))

    def equations(self) -> acausal.Equations:
        yield acausal.der(self.x) == self.k * self.u


def test_another_input_does_not_go_on_in_the_file(tmp_path: Path) -> None:
    """Functions, series and the content of files are compared by what a run has of them, not by their kind."""
    file, data = tmp_path / "x.sweep", tmp_path / "u.csv"

    def swept(u: Any, **options: Any) -> Any:
        return acausal.sweep(_Driven(), {"k": [1.0]}, inputs={"u": u}, file=file, workers=1, stop_time=1.0, **options)

    def written(last: float) -> str:
        data.write_text(f"time,u\n0,0\n1,{last}\n")
        return str(data)

    series = acausal.TimeSeries([0.0, 1.0], [0.0, 1.0])
    for one, other in (
        (np.sin, lambda: np.cos),
        (series, lambda: acausal.TimeSeries([0.0, 1.0], [0.0, 2.0])),
        (series, lambda: acausal.TimeSeries([0.0, 1.0], [0.0, 1.0], "hold")),
        (written(1.0), lambda: written(2.0)),
        (1.0, lambda: 2.0),
    ):
        swept(one)
        assert swept(one, resume=True).status == ("ok",)
        with pytest.raises(UsageError, match="other inputs"):
            swept(other(), resume=True)
        file.unlink()


def test_a_variable_is_no_parameter() -> None:
    with pytest.raises(UsageError, match=r"AC061.*x of _Driven is no parameter"):
        acausal.sweep(_Driven(), {"x": [1.0]}, inputs={"u": 0.0})


def test_a_file_that_is_no_sweep_is_left_alone(tmp_path: Path) -> None:
    file = tmp_path / "x.sweep"
    file.write_text("a letter\n" * 100)
    with pytest.raises(UsageError, match="AC062"):
        acausal.load_sweep(file)
    for resume in (False, True):
        with pytest.raises(UsageError, match="AC062"):
            decays(file=file, resume=resume)
    assert file.read_text().startswith("a letter")


_LONG = """
import sys
import acausal
from acausal import Component, Equations, Range, Real, delay, der, fixed, integer, parameter, reset, variable, when
from acausal import time as time_of_run
from tests.simulate.test_native_foreign import Decaying
from tests.study.sweep.decays import Decay

def say(progress):
    print(progress.done, flush=True)

acausal.sweep(
    Decay(), {"k": Range(0.5, 2.0, 400)}, signals=["x"], stop_time=1.0, output_interval=1e-5, workers=2,
    file=sys.argv[1], progress=say,
)
"""


@pytest.mark.slow
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")
def test_what_was_counted_survives_a_kill_and_no_worker_stays(tmp_path: Path) -> None:
    file = tmp_path / "x.sweep"
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    with subprocess.Popen(
        [sys.executable, "-c", _LONG, str(file)], stdout=subprocess.PIPE, text=True, env=environment
    ) as process:
        assert process.stdout is not None
        counted = 0
        while counted < 20:
            counted = int(process.stdout.readline())
        children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
        process.send_signal(signal.SIGKILL)
    kept = acausal.load_sweep(file)
    assert counted <= kept.status.count("ok") < 400
    assert len(children) == 2
    for _ in range(100):
        if not any(Path(f"/proc/{child}").exists() for child in children):
            break
        time.sleep(0.1)
    else:
        raise AssertionError("workers have outlived their sweep")


_SCRIPT = """
import sys
import acausal, numpy as np
from acausal.models.drilling_kinematic import ThinPlate

class Script(ThinPlate):
    e: acausal.Real = acausal.variable(unit="m")

    def equations(self):
        yield self.e == 2.0 * self.drill.s

if __name__ == "__main__":
    options = dict(signals=["drill.s", "drill.F_f", "e"], native=False)
    vary = {"v": acausal.Range(1e-3, 2e-3, 6), "workpiece.t": [1e-3, -1.0]}
    there = acausal.sweep(Script(), vary, executor="dask://", workers=2, **options)
    here = acausal.sweep(Script(), vary, workers=1, **options)
    assert there.codes == here.codes and there.codes.count("AC136") == 6, there.codes
    assert np.array_equal(there.rows, here.rows, equal_nan=True)
"""


@pytest.mark.slow
def test_a_dask_cluster_of_two_workers(tmp_path: Path) -> None:
    """The same numbers as here, of a class of the script; a member that fails is recorded there, too."""
    pytest.importorskip("distributed")
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    (tmp_path / "script.py").write_text(_SCRIPT)
    called = [sys.executable, str(tmp_path / "script.py")]
    done = subprocess.run(called, env=environment, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
def test_processes_that_know_nothing_get_the_file_of_the_model(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """x = exp(-k), in processes that were not made by a fork."""
    file = tmp_path / "alone.py"
    file.write_text((Path(__file__).parent / "decays.py").read_text())
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    monkeypatch.setattr(sys, "path", list(sys.path))
    model = find_model(f"{file}:Decay")
    monkeypatch.setattr(sys, "path", [p for p in sys.path if p != str(tmp_path)])
    with ProcessPoolExecutor(2, multiprocessing.get_context("spawn")) as pool:
        found = acausal.sweep(model(), {"k": [1.0, 2.0, 3.0, 4.0]}, signals=["x"], stop_time=1.0, executor=pool)
    assert found.final("x") == pytest.approx(np.exp(-found["k"]), abs=1e-5)


def test_a_worker_that_outlives_a_model_takes_the_next_of_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """x' = 1 from the start that a neighbour of the file holds: in another folder, and after the neighbour was edited.

    Member 1 has other states (a delay of zero), so the worker compiles the component itself.
    """
    monkeypatch.setattr(sys, "path", list(sys.path))
    source = """from acausal import Component, Real, delay, der, fixed, parameter, variable
from the_start import START
class Late(Component):
    T: Real = parameter(default=0.5)
    x: Real = variable(default=fixed(START))
    y: Real = variable()
    def equations(self):
        yield der(self.x) == 1.0
        yield self.y == delay(self.x, self.T)
"""
    sent: list[bytes] = []
    for folder, start in (("a", 1.0), ("b", 2.0), ("b", 3.0)):
        (tmp_path / folder).mkdir(exist_ok=True)
        (tmp_path / folder / "late.py").write_text(source)
        # the size tells Python that its bytecode is old, within the resolution of the time of the file
        (tmp_path / folder / "the_start.py").write_text(f"START = {start}" + "\n" * len(sent))
        sys.modules.pop("the_start", None)
        sys.path[:] = [str(tmp_path / folder), *sys.path]
        model = find_model(f"{tmp_path}/{folder}/late.py:Late")()
        options = {"stop_time": 1.0}
        task = members.Task(acausal.compile(model), model, {}, ("T",), np.array([0.0, 1.0]), ("y",), options)
        sent.append(workers.pickled(task))
        if folder == "a":
            continue
        del sys.modules[type(model).__module__], sys.modules["the_start"]  # a worker has neither
        first, last = (members.unpickled(pickled) for pickled in (sent[0], sent[-1]))
        assert float(members.run_task(first, [0.0]).final("y")) == pytest.approx(2.0)
        assert float(members.run_task(last, [0.0]).final("y")) == pytest.approx(start + 1.0)


def test_a_worker_with_another_version_of_the_classes_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """Classes are imported by the worker: with the former limits of a parameter, other members would fail."""
    task = members.Task(acausal.compile(Decay()), Decay(), {}, ("k",), np.array([0.0, 1.0]), ("x",), {})
    sent = workers.pickled(task)
    assert members.unpickled(sent).model.states == task.model.states
    monkeypatch.setitem(Decay._declarations, "k", acausal.parameter(default=1.0, unit="1/s", max=0.1))
    with pytest.raises(pickle.UnpicklingError, match="another version of Decay"):
        members.unpickled(sent)


def test_a_worker_compiles_from_no_other_version_of_the_equations(monkeypatch: pytest.MonkeyPatch) -> None:
    """A delay of zero needs another structure: y(1) is x(1) = 1, and with the worker's equations it would be 2."""
    late = Late()
    task = members.Task(acausal.compile(late), late, {}, ("T",), np.array([0.0, 1.0]), ("y",), {"stop_time": 1.0})
    sent = workers.pickled(task)
    assert members.run_member(members.unpickled(sent), 0, [0.0]).final[0] == pytest.approx(1.0)

    def others(self: Late) -> Equations:
        yield der(self.x) == 1.0
        yield self.y == 2.0 * delay(self.x, self.T)

    monkeypatch.setattr(Late, "equations", others)
    assert members.run_member(members.unpickled(sent), 0, [0.0]).code == "AC064"
    assert members.run_member(members.unpickled(sent), 0, [0.25]).final[0] == pytest.approx(0.75)  # as it was sent


def test_a_worker_that_cannot_load_the_model_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(workers, "pickled", lambda task: b"no pickle")
    with ThreadPoolExecutor(1) as pool, pytest.raises(UsageError, match="AC064"):
        decays(executor=pool)


@pytest.mark.parametrize("executor", ["", "Threads", "dask:/x", "foo://", 3])
def test_an_executor_that_nobody_knows_is_refused_though_two_members_would_not_need_it(executor: Any) -> None:
    with pytest.raises(UsageError, match=f"AC060.*'{executor}'"):
        decays({"k": [1.0, 2.0]}, executor=executor, workers=None)


def test_a_scheduler_that_does_not_answer_is_named_and_no_file_is_touched(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Nobody listens at port 1; a finished sweep, which a new one would replace, stays."""
    pytest.importorskip("distributed")
    monkeypatch.setattr("acausal.study.sweep.cluster._TIMEOUT", "0.5s")
    file = tmp_path / "kept.sweep"
    decays({"k": [1.0, 2.0]}, file=file)
    before = file.read_bytes()
    with pytest.raises(UsageError, match=r"AC063.*127\.0\.0\.1:1") as refused:
        decays({"k": [3.0, 4.0]}, file=file, executor="dask://127.0.0.1:1", workers=None)
    assert "dask scheduler" in (refused.value.help or "")
    assert file.read_bytes() == before


def test_all_members_but_those_that_tell_the_pace_go_to_the_executor() -> None:
    sent: list[int] = []

    class Counting(ThreadPoolExecutor):
        def submit(self, run: Any, key: Any, model: Any, members: Any) -> Any:  # type: ignore[override]
            sent.extend(k for k, _ in members)
            return super().submit(run, key, model, members)

    with Counting(1) as pool:
        decays({"k": [1.0, 2.0, 3.0, 4.0, 5.0]}, executor=pool, workers=None, native=False)
    assert sorted(sent) in ([2, 3, 4], [1, 2, 3, 4])  # the second runs here where the first was quick


def test_without_dask_its_executor_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(UsageError, match="AC015"):
        decays(executor="dask://localhost:1")


def test_an_executor_whose_workers_are_gone_is_named() -> None:
    class Broken(ThreadPoolExecutor):
        def submit(self, *arguments: Any, **options: Any) -> Any:
            from concurrent.futures import BrokenExecutor

            raise BrokenExecutor("they left")

    with Broken(1) as pool, pytest.raises(RunError, match="AC413"):
        decays(executor=pool)


def test_a_model_that_calls_python_is_not_resumed(tmp_path: Path) -> None:
    """Its members may come from another function of the same name, of which the file knows nothing."""
    file = tmp_path / "x.sweep"
    acausal.sweep(Decaying(), {"k": [0.5, 1.0]}, signals=["x"], stop_time=1.0, workers=1, file=file)
    with pytest.raises(UsageError, match=r"(?s)AC062.*doubled"):
        acausal.sweep(Decaying(), {"k": [0.5, 1.0]}, signals=["x"], stop_time=1.0, workers=1, file=file, resume=True)
