"""`acausal.sweep`: the same model with many values of its parameters."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, TypedDict, Unpack

import numpy as np

from acausal.arrays import Vector
from acausal.errors import DeclarationError, UsageError
from acausal.language.component import Component
from acausal.language.declarations.declaration import Kind
from acausal.lower.compile import compile
from acausal.lower.compiled import CompiledModel
from acausal.reduce.outputs import fitting
from acausal.result.result import Result
from acausal.result.signals import Signal
from acausal.simulate.arguments import parameter_vector
from acausal.simulate.native.policy import expect
from acausal.simulate.record.record import Described
from acausal.study.sweep.cluster import cluster
from acausal.study.sweep.crew import Crew, Foreign, Here, Processes, carried_out
from acausal.study.sweep.family import Progress, Report, Sweep, gathered
from acausal.study.sweep.identity import as_text, driven, fingerprint, run_times
from acausal.study.sweep.member import Outcome, Task, run_member
from acausal.study.sweep.store import Definition, Store
from acausal.study.sweep.vary import design

# An executor and how many of its workers there are.
Pool = tuple[Executor, int]

# Signals that are kept without being named.
_MOST_SIGNALS = 24
# Seconds that a first run may take so that a second one tells how long the others will.
_QUICK = 1.0


class RunOptions(TypedDict, total=False):
    """Options of `acausal.simulate` that hold for all members."""

    start_time: float | None
    stop_time: float | None
    output_interval: float | None
    tolerance: float | None
    solver: str | None
    step: float | None
    inputs: Mapping[str, Any] | None
    start: Mapping[str, float] | None
    native: bool | None
    force: bool


def sweep(
    model: Component | CompiledModel,
    vary: Mapping[str, Any] | Sequence[Mapping[str, float]],
    *,
    sample: str | None = None,
    seed: int = 0,
    signals: Sequence[str] | None = None,
    parameters: Mapping[str, Any] | None = None,
    workers: int | None = None,
    executor: Executor | str | None = None,
    file: str | Path | None = None,
    resume: bool = False,
    progress: Report | None = None,
    **options: Unpack[RunOptions],
) -> Sweep:
    """Run a model with many values of its parameters; each member is `simulate(model, parameters=...)`.

    Parameters
    ----------
    model
        A component, or a compiled model. It is compiled once.
    vary
        By path, in SI: a `Range`, a sequence of values, or for samples a distribution of `scipy.stats`; the grid has
        all combinations, the last name fastest. Or a sequence of mappings, one for each member.
    sample, seed
        "sobol:256", "halton:100", "lhs:100" or "random:1000" instead of the grid.
    signals
        What is kept, on the output grid and at the end of each run; by default the states, up to 24.
    parameters
        Values of other parameters, the same for all members.
    workers
        Processes; by default one for each core that this process may use. With 1 everything runs in this thread.
    executor
        Any `concurrent.futures.Executor`, or "processes" (default), "threads", "dask://host:port", or "dask://" for a
        cluster of `workers` processes on this machine. It is opened before the first run. The first member, and the
        second where that is quick, run in this process: they check the request and tell how long the others take.
    file
        A `.sweep` file, into which each finished chunk is written at once; None keeps all in memory.
    resume
        Run only what `file` does not hold yet, of the same sweep; failed members are not tried again.
    progress
        Called with a `Progress` after each chunk.
    options
        Those of `simulate`: times, output_interval, tolerance, solver, step, inputs, start, native, force.

    Returns
    -------
    Sweep
        What failed has a code and a message there; nothing is raised for it.

    Raises
    ------
    UsageError
        AC060 for a variation that makes no sense, AC061 for what cannot be varied, AC062 for a file of another sweep,
        AC063 for a Dask scheduler that does not answer, AC064 for a model that cannot be sent, AC015 for a missing
        package; and what `compile` and the first run say of a wrong request.
    RunError
        AC413 when the workers of a given executor are gone.
    """
    names, values = design(vary, sample, seed)
    if workers is not None and workers < 1:
        raise UsageError("AC060", f"{workers} workers do nothing", help="workers=2")
    compiled, component = _compiled(model, dict(parameters or {}), names, values)
    task, kept = _task(compiled, component, dict(parameters or {}), names, signals, dict(options), values)
    setting = {"parameters": as_text(parameters or {})}
    if file is not None:
        setting["options"] = as_text({k: v for k, v in options.items() if k != "inputs"})
        setting["inputs"] = driven(compiled, dict(options))
        setting["model"] = fingerprint(compiled)
    definition = Definition(compiled.name, _varied(compiled, names), values, kept, task.grid, setting)
    # Before anything runs or is written: a sweep of few members would never ask who runs the others.
    with _pool(executor, workers, len(values)) as pool:
        store = _opened(None if file is None else Path(file), definition, resume)
        try:
            _run(task, definition, store, workers, pool, progress)
            return gathered(store)
        finally:
            store.close()


def _run(
    task: Task,
    definition: Definition,
    store: Store,
    workers: int | None,
    pool: Pool | None,
    progress: Report | None,
) -> None:
    """Run what is missing."""
    done = store.done()
    table = definition.values.tolist()
    waiting = [(k, tuple(row)) for k, row in enumerate(table) if k not in done]
    count = _Count(len(table), len(done), progress)

    def keep(outcomes: Sequence[Outcome]) -> None:
        store.add(outcomes)
        count.add(outcomes)

    if not waiting:
        return
    first = run_member(task, *waiting[0], checked=False)
    keep([first])
    task = replace(task, expected=len(waiting) * first.evaluations)
    expect(task.model, task.expected)
    pace = first.seconds
    if not first.code and pace < _QUICK and len(waiting) > 1:
        again = run_member(task, *waiting[1])  # functions are made in a first run
        keep([again])
        pace = again.seconds
        del waiting[1]
    del waiting[0]
    if waiting:
        carried_out(_crew(task, workers, pool, len(waiting)), task, waiting, pace, keep)


class _Count:
    """Members done, and the time to come, from those of this call."""

    def __init__(self, total: int, done: int, report: Report | None) -> None:
        self.total, self.done, self.report = total, done, report
        self.failed, self.before, self.began = 0, done, time.perf_counter()

    def add(self, outcomes: Sequence[Outcome]) -> None:
        self.done += len(outcomes)
        self.failed += sum(1 for o in outcomes if o.code)
        if self.report is not None:
            elapsed = time.perf_counter() - self.began
            each = elapsed / max(1, self.done - self.before)
            self.report(Progress(self.done, self.total, self.failed, elapsed, each * (self.total - self.done)))


def _compiled(
    model: Component | CompiledModel, parameters: dict[str, Any], names: tuple[str, ...], values: Vector
) -> tuple[CompiledModel, Component | None]:
    """The model, with what is varied free, and the component that it was compiled from."""
    if isinstance(model, CompiledModel):
        if parameters:
            raise UsageError(
                "AC060", "a compiled model has its parameters already", help="give them to compile, or vary them"
            )
        _check_names(model, names, values)
        return model, None
    compiled = compile(model, parameters=parameters)
    declared = {f.path: f for f in compiled.flat.parameters}
    own = dict(zip(names, values[0].tolist(), strict=True))
    # what the model binds to others is replaced, as simulate(component, parameters=...) does
    bound = {name: own[name] for name in names if name in declared and not declared[name].free}
    if bound:
        compiled = compile(model, parameters={**parameters, **bound})
    for name in names:
        declaration = type(model)._declarations.get(name)
        if declaration is not None and name not in declared and name not in compiled.parameters:
            structural = declaration.kind is Kind.STRUCTURAL
            raise UsageError(
                "AC061",
                f"{name} of {compiled.name} "
                + ("decides its structure" if structural else "is no parameter")
                + " and cannot be varied",
                help="make a sweep for each of its values"
                if structural
                else "to vary a start value declare a parameter, and give the variable fixed() of it in build",
            )
    _check_names(compiled, names, values)
    return compiled, model


def _check_names(compiled: CompiledModel, names: tuple[str, ...], values: Vector) -> None:
    """Refuse wrong names; a value outside of its limits is the failure of a member."""
    with suppress(DeclarationError):
        parameter_vector(compiled, dict(zip(names, values[0].tolist(), strict=True)))


def _task(
    compiled: CompiledModel,
    component: Component | None,
    parameters: dict[str, Any],
    names: tuple[str, ...],
    signals: Sequence[str] | None,
    options: dict[str, Any],
    values: Vector,
) -> tuple[Task, tuple[Signal, ...]]:
    """What all members share, and the signals that are kept."""
    grid = run_times(compiled, options).grid()
    if signals is None:
        if len(compiled.continuous) > _MOST_SIGNALS:
            raise UsageError(
                "AC060",
                f"{compiled.name} has {len(compiled.continuous)} states",
                help="say what to keep: signals=['mass.s'], or --signals mass.s",
            )
        signals = compiled.continuous
    known = _without_rows(compiled)
    wanted = [fit for name in signals for fit in fitting(name, known.names) or [name]]
    found = [s for name in wanted for s in known.elements(name)[1] if s.name not in names]
    kept = tuple({s.name: s for s in found}.values())
    if not kept:
        raise UsageError("AC060", f"nothing of {compiled.name} would be kept", help="signals=['mass.s']")
    return Task(compiled, component, parameters, names, grid, tuple(s.name for s in kept), options), kept


def _without_rows(compiled: CompiledModel) -> Result:
    """A result that knows the names of all signals, and no values."""
    p = np.array(compiled.parameter_values, dtype=float)
    return Result(compiled.name, np.zeros(0), np.zeros((0, 0)), Described(compiled, p))


def _varied(compiled: CompiledModel, names: tuple[str, ...]) -> tuple[Signal, ...]:
    known = _without_rows(compiled).signals
    return tuple(known[name] if name in known else Signal(name) for name in names)


def _opened(file: Path | None, definition: Definition, resume: bool) -> Store:
    """The store of a sweep: a new one, or that in the file.

    Raises UsageError: AC062 when the file holds another sweep, or an unfinished one that is not to be resumed.
    """
    if file is None:
        if resume:
            raise UsageError("AC062", "there is nothing to resume without a file", help="file='x.sweep'")
    elif file.exists():
        store = Store(file)
        known, done = store.definition(), len(store.done())
        if resume:
            different = known.difference(definition)
            if not different and known.model == definition.model:
                return store
            store.close()
            raise UsageError(
                "AC062",
                f"{file} holds another sweep, of {known.model}",
                evidence=[f"other {text}" for text in different],
                help="give another file, or delete this one",
            )
        store.close()
        if done < len(known.values):
            raise UsageError(
                "AC062",
                f"{file} holds {done} of {len(known.values)} members of a sweep that was not finished",
                help="--resume (resume=True) goes on with it; else give another file, or delete this one",
            )
        file.unlink()
    store = Store(file)
    store.begin(definition)
    return store


@contextmanager
def _pool(executor: Executor | str | None, workers: int | None, members: int) -> Iterator[Pool | None]:
    """The executor that is asked for, open; None for processes of our own.

    Raises UsageError: AC060 for an executor that nobody knows, AC015 where Dask is not installed, AC063 where its
    scheduler is away.
    """
    width = min(members, workers or _cores())
    if isinstance(executor, Executor):
        yield executor, workers or getattr(executor, "_max_workers", None) or _cores()
    elif executor in (None, "processes"):
        yield None
    elif executor == "threads":
        with ThreadPoolExecutor(width) as threads:
            yield threads, width
    elif isinstance(executor, str) and executor.startswith("dask://"):
        with cluster(executor.removeprefix("dask://"), width) as opened:
            yield opened
    else:
        raise UsageError(
            "AC060", f"there is no executor '{executor}'", help="processes, threads, dask://host:port, dask://"
        )


def _crew(task: Task, workers: int | None, pool: Pool | None, members: int) -> Crew:
    """Who runs the members after the first."""
    if pool is not None:
        return Foreign(task, *pool)
    width = min(members, workers or _cores())
    return Here(task) if width == 1 else Processes(task, width)


def _cores() -> int:
    """Cores that this process may use."""
    if sys.platform.startswith("linux"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
