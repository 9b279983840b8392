"""`acausal.sweep`: runs of one model with many values of its parameters."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, TypedDict, Unpack

import numpy as np

from acausal.arrays import Vector
from acausal.errors import DeclarationError, UsageError, listed_names
from acausal.flatten.parameters import given_values
from acausal.language.component import Component
from acausal.language.declarations.declaration import Kind
from acausal.lower.compile import compile
from acausal.lower.compiled import CompiledModel
from acausal.reduce.outputs import fitting
from acausal.result.result import Result
from acausal.result.signals import Signal
from acausal.simulate.native.policy import expect
from acausal.simulate.options import parameter_vector
from acausal.simulate.record.record import Described
from acausal.study.sweep.cluster import cluster
from acausal.study.sweep.family import Progress, Report, Sweep, sweep_from
from acausal.study.sweep.identity import as_text, driven, fingerprint, run_times, unknown_functions
from acausal.study.sweep.member import OTHER_STRUCTURE, Outcome, Task, run_member
from acausal.study.sweep.store import Definition, Store
from acausal.study.sweep.vary import design
from acausal.study.sweep.workers import CallingThread, GivenExecutor, Processes, Workers, run_all

# An executor and the number of its workers.
Pool = tuple[Executor, int]

# Largest number of states stored by default.
_MOST_SIGNALS = 24
# If the first run takes less [s], the second one is timed instead: the first includes the generation of functions.
_FAST = 1.0


class RunOptions(TypedDict, total=False):
    """Options of `acausal.simulate`, the same for all members."""

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
    """Run a model with many values of its parameters; each member is one `simulate(model, parameters=...)`.

    Parameters
    ----------
    model
        A component, or a compiled model. It is compiled once.
    vary
        Parameters by path, in SI: a `Range`, values, or, with `sample`, a distribution of `scipy.stats`. The grid has
        all combinations, the last name varies fastest. Or a sequence of mappings, one for each member.
    sample, seed
        "sobol:256", "halton:100", "lhs:100" or "random:1000" instead of the grid.
    signals
        Signals to store, on the output grid and at the end of each run; by default the states, up to 24.
    parameters
        Values of other parameters, the same for all members.
    workers
        Number of processes, by default one for each available core; with 1, everything runs in this thread.
    executor
        Any `concurrent.futures.Executor`, or "processes" (default), "threads", "dask://host:port", or "dask://" for a
        cluster of `workers` processes on this machine, opened before the first run. The first member, and the second if
        the first is fast, run in this process, to check the request and to estimate the time of the others.
    file
        A `.sweep` file to which finished chunks go, and which must not contain a sweep yet; None: all is in memory.
    resume
        Run only the members missing in `file`, which must belong to the same sweep; failed members are not repeated.
    progress
        Called with a `Progress` after each chunk.
    options
        Options of `simulate`: times, output_interval, tolerance, solver, step, inputs, start, native, force.

    Returns
    -------
    Sweep
        Failed members have a code and a message; they raise no error.

    Raises
    ------
    UsageError
        AC060 for an invalid variation, AC061 for a parameter that cannot be varied, AC062 for a file of another sweep,
        AC063 for a silent Dask scheduler, AC064 for a model that cannot be sent to workers, AC015 for a missing
        package; and the errors of `compile` and of the first run.
    RunError
        AC413 if the workers of a given executor are lost.
    """
    names, values = design(vary, sample, seed)
    parameters = given_values(parameters)
    _check(names, parameters, workers)
    compiled, component, whole = _compiled(model, parameters, names, values)
    task, kept = _task(compiled, component, whole, names, signals, dict(options), values)
    setting = {"parameters": as_text(parameters)}
    if file is not None:
        setting["options"] = as_text({k: v for k, v in options.items() if k != "inputs"})
        setting["inputs"] = driven(compiled, dict(options))
        setting["model"] = fingerprint(compiled)
        if resume and Path(file).exists():
            _refuse_unknown(file, compiled)
    definition = Definition(compiled.name, _varied(compiled, names), values, kept, task.grid, setting)
    # open it before anything runs, because a sweep of one or two members would never report a wrong executor
    with _pool(executor, workers, len(values)) as pool:
        store = _open_store(None if file is None else Path(file), definition, resume)
        try:
            _run(task, definition, store, workers, pool, progress)
            return sweep_from(store)
        finally:
            store.close()


def _check(names: Sequence[str], parameters: Mapping[str, object], workers: int | None) -> None:
    """Raise UsageError (AC060) for parameters that are varied and given, and for no workers."""
    if both := [name for name in names if name in parameters]:
        fact = f"{', '.join(both)}: varied, and given a value for all members, too"
        raise UsageError("AC060", fact, help="leave out one of the two: vary and parameters, or --vary and --set")
    if workers is not None and workers < 1:
        raise UsageError("AC060", f"{workers} workers do nothing", help="workers=2")


def _run(
    task: Task,
    definition: Definition,
    store: Store,
    workers: int | None,
    pool: Pool | None,
    progress: Report | None,
) -> None:
    """Run the missing members."""
    done = store.done()
    table = definition.values.tolist()
    missing = [(k, tuple(row)) for k, row in enumerate(table) if k not in done]
    count = _Count(len(table), len(done), progress)

    def keep(outcomes: Sequence[Outcome]) -> None:
        store.add(outcomes)
        count.add(outcomes)

    if not missing:
        return
    first = run_member(task, *missing[0], checked=False)
    keep([first])
    task = replace(task, expected=len(missing) * first.evaluations)
    expect(task.model, task.expected)
    pace = first.seconds
    if not first.code and pace < _FAST and len(missing) > 1:
        second = run_member(task, *missing[1])  # the first run includes the generation of functions
        keep([second])
        pace = second.seconds
        del missing[1]
    del missing[0]
    if missing:
        run_all(_workers_for(task, workers, pool, len(missing)), task, missing, pace, keep)


class _Count:
    """Progress: counts of members, and the remaining time estimated from those of this call."""

    def __init__(self, total: int, done: int, report: Report | None) -> None:
        self.total, self.done, self.report = total, done, report
        self.failed, self.before, self.start = 0, done, time.perf_counter()

    def add(self, outcomes: Sequence[Outcome]) -> None:
        """Count outcomes, and report the progress."""
        self.done += len(outcomes)
        self.failed += sum(1 for o in outcomes if o.code)
        if self.report is not None:
            elapsed = time.perf_counter() - self.start
            each = elapsed / max(1, self.done - self.before)
            self.report(Progress(self.done, self.total, self.failed, elapsed, each * (self.total - self.done)))


def _compiled(
    model: Component | CompiledModel, parameters: dict[str, Any], names: tuple[str, ...], values: Vector
) -> tuple[CompiledModel, Component | None, dict[str, Any]]:
    """(Model with free varied parameters, the component from which it was compiled or None, with what parameters)."""
    if isinstance(model, CompiledModel):
        if parameters:
            raise UsageError(
                "AC060", "a compiled model already has its parameters", help="pass them to compile, or vary them"
            )
        _check_names(model, names, values)
        return model, None, parameters
    compiled = compile(model, parameters=parameters)
    declared = {f.path: f for f in compiled.flat.parameters}
    first = dict(zip(names, values[0].tolist(), strict=True))
    # a varied value replaces a binding to other parameters, as simulate(component, parameters=...) does
    bound = {name: first[name] for name in names if name in declared and not declared[name].free}
    if bound:
        parameters = {**parameters, **bound}
        compiled = compile(model, parameters=parameters)
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
                else "to vary a start value, declare a parameter, and set the variable to fixed() of it in build",
            )
    _check_names(compiled, names, values)
    return compiled, model, parameters


def _check_names(compiled: CompiledModel, names: tuple[str, ...], values: Vector) -> None:
    """Raise UsageError for wrong names; values outside of limits, or for other states, only fail their member."""
    try:
        parameter_vector(compiled, dict(zip(names, values[0].tolist(), strict=True)))
    except (DeclarationError, UsageError) as error:
        if isinstance(error, UsageError) and error.code not in OTHER_STRUCTURE:
            raise


def _task(
    compiled: CompiledModel,
    component: Component | None,
    parameters: dict[str, Any],
    names: tuple[str, ...],
    signals: Sequence[str] | None,
    options: dict[str, Any],
    values: Vector,
) -> tuple[Task, tuple[Signal, ...]]:
    """(Task shared by all members, stored signals)."""
    grid = run_times(compiled, options).grid()
    if signals is None:
        if len(compiled.continuous) > _MOST_SIGNALS:
            raise UsageError(
                "AC060",
                f"{compiled.name} has {len(compiled.continuous)} states",
                help="choose what to store: signals=['mass.s'], or --signals mass.s",
            )
        signals = compiled.continuous
    known = _without_rows(compiled)
    wanted = [fit for name in listed_names("signals", signals) for fit in fitting(name, known.names) or [name]]
    found = [s for name in wanted for s in known.elements(name)[1] if s.name not in names]
    kept = tuple({s.name: s for s in found}.values())
    if not kept:
        raise UsageError("AC060", f"nothing of {compiled.name} would be stored", help="signals=['mass.s']")
    return Task(compiled, component, parameters, names, grid, tuple(s.name for s in kept), options), kept


def _without_rows(compiled: CompiledModel) -> Result:
    """A result with the names of all signals and no values."""
    p = np.array(compiled.parameter_values, dtype=float)
    return Result(compiled.name, np.zeros(0), np.zeros((0, 0)), Described(compiled, p))


def _varied(compiled: CompiledModel, names: tuple[str, ...]) -> tuple[Signal, ...]:
    """Names, units and descriptions of the varied parameters."""
    known = _without_rows(compiled).signals
    return tuple(known[name] if name in known else Signal(name) for name in names)


def _refuse_unknown(file: Path | str, compiled: CompiledModel) -> None:
    """Raise UsageError AC062 if the members of the file may come from other functions of the same name."""
    unknown = unknown_functions(compiled)
    if unknown:
        raise UsageError(
            "AC062",
            f"{file} cannot be resumed: {compiled.name} calls Python or a library, which may have changed since",
            evidence=[f"external functions: {', '.join(unknown)}"],
            help="acausal.load_sweep reads the members that are done; run the others with another file",
        )


def _open_store(file: Path | None, definition: Definition, resume: bool) -> Store:
    """The store of a sweep: a new one, or, with `resume`, that of the file.

    Raises UsageError: AC062 if the file contains another sweep, or, without `resume`, any.
    """
    if file is None:
        if resume:
            raise UsageError("AC062", "there is nothing to resume without a file", help="file='x.sweep'")
    elif file.exists() and file.stat().st_size > 0:  # a kill before the first transaction leaves an empty file
        store = Store(file)
        known, done = store.definition(), len(store.done())
        if resume:
            different = known.difference(definition)
            if not different and known.model == definition.model:
                return store
            store.close()
            raise UsageError(
                "AC062",
                f"{file} contains another sweep, of {known.model}",
                evidence=[f"other {text}" for text in different],
                help="give another file, or delete this one",
            )
        store.close()
        state = "a finished sweep" if done == len(known.values) else "an unfinished sweep"
        raise UsageError(
            "AC062",
            f"{file} contains {state} of {known.model}, {done} of {len(known.values)} members",
            help="--resume (resume=True) keeps these; otherwise give another file (-o, file=), or delete this one",
        )
    store = Store(file)
    store.begin(definition)
    return store


@contextmanager
def _pool(executor: Executor | str | None, workers: int | None, members: int) -> Iterator[Pool | None]:
    """The open executor with its number of workers; None for own processes.

    Raises UsageError: AC060 for an unknown executor, AC015 if Dask is not installed, AC063 if its scheduler does not
    answer.
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


def _workers_for(task: Task, workers: int | None, pool: Pool | None, members: int) -> Workers:
    """The workers that run the members after the first."""
    if pool is not None:
        return GivenExecutor(task, *pool)
    width = min(members, workers or _cores())
    return CallingThread(task) if width == 1 else Processes(task, width)


def _cores() -> int:
    """Number of cores available to this process."""
    if sys.platform.startswith("linux"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
