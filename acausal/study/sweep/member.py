"""One member of a sweep: a run, and the values stored of it; this is executed by the workers."""

from __future__ import annotations

import pickle
import sys
import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any, cast

import numpy as np

from acausal.arrays import Vector
from acausal.errors import AcausalError, InternalError, UsageError
from acausal.language.component import Component
from acausal.lower.compiled import CompiledModel
from acausal.result.result import Result
from acausal.simulate.native.policy import expect
from acausal.simulate.run import simulate

# Output times that differ by less than this fraction of the largest one are equal.
_SAME = 1e-13


@dataclass(frozen=True, eq=False)
class Task:
    """The part of a sweep that all members share."""

    model: CompiledModel
    # Component (None for a compiled model) and parameters from which the model was compiled, to compile it again for
    # members with another structure (AC029).
    component: Component | None
    parameters: Mapping[str, Any]
    names: tuple[str, ...]  # varied parameters
    grid: Vector  # times of the stored rows, shape (r,) [s]
    signals: tuple[str, ...]  # names of the s stored scalar signals
    options: Mapping[str, Any]  # options of `simulate`
    expected: float = 0.0  # estimated evaluations of the right-hand side in all members


@dataclass(frozen=True, eq=False)
class Outcome:
    """Stored values of a member.

    `code` is empty for a successful run, which ended at `stop` [s] after `seconds` of wall time. `final`, shape (s,),
    are the values at its end, and `rows`, shape (r, s), those on the grid, nan after a termination by the model. Both
    are nan for a failed run.
    """

    member: int
    code: str
    message: str
    notes: tuple[str, ...]
    stop: float
    seconds: float
    events: int
    final: Vector
    rows: Vector
    evaluations: float = 0.0


def run_member(task: Task, member: int, values: Sequence[float], *, checked: bool = True) -> Outcome:
    """Run one member; any error becomes its outcome, except that of an invalid request if `checked` is false.

    `values`: values of the varied parameters, shape (k,).
    """
    start = time.perf_counter()
    try:
        result = run_task(task, values)
        final, rows = stored_values(task, result)
    except Exception as error:
        shown = as_acausal_error(error)
        if not checked and isinstance(error, UsageError) and error.code != "AC029":
            raise
        reached = getattr(getattr(error, "result", None), "time", np.array([np.nan]))[-1]
        return failed(task, member, shown.code, shown.fact, float(reached), time.perf_counter() - start)
    notes: Any = result.stats.get("notes", ())
    seconds = time.perf_counter() - start
    evaluations = float(result.stats.get("rhs_evaluations", 0.0))  # type: ignore[arg-type]
    stop, events = float(result.time[-1]), len(result.events)
    return Outcome(member, "", "", tuple(notes), stop, seconds, events, final, rows, evaluations)


def failed(
    task: Task, member: int, code: str, message: str, reached: float = np.nan, seconds: float = np.nan
) -> Outcome:
    """The outcome of a failed member."""
    nothing = np.full((len(task.grid), len(task.signals)), np.nan)
    return Outcome(member, code, message, (), reached, seconds, 0, nothing[0], nothing)


def as_acausal_error(error: Exception) -> AcausalError:
    """The exception, or an `InternalError` AC999 with its message."""
    if isinstance(error, AcausalError):
        return error
    return InternalError("AC999", f"{type(error).__name__}: {error}")


def run_task(task: Task, values: Sequence[float]) -> Result:
    """Result of a member, equal to `simulate` of the component with these parameters."""
    own = dict(zip(task.names, values, strict=True))
    try:
        return simulate(task.model, parameters=own, **task.options)
    except UsageError as error:
        if error.code != "AC029" or task.component is None:
            raise
    return simulate(task.component, parameters={**task.parameters, **own}, **task.options)


def stored_values(task: Task, result: Result) -> tuple[Vector, Vector]:
    """(Values at the end of a run, shape (s,); values on the grid, shape (r, s))."""
    slack = _SAME * max(abs(task.grid[0]), abs(task.grid[-1]))
    row = np.searchsorted(result.time, task.grid + slack, side="right") - 1
    on_grid = np.abs(result.time[row] - task.grid) <= slack
    values = np.stack([result[name] for name in task.signals], axis=1)
    return values[-1].copy(), np.where(on_grid[:, None], values[row], np.nan)


# Tasks by key and thread: compiled models have work memory that threads must not share.
_TASKS: dict[tuple[str, int], Task] = {}
_MOST_TASKS = 32


def remember(key: str, task: Task) -> None:
    """Store a task for the chunks of this thread."""
    while len(_TASKS) >= _MOST_TASKS:
        del _TASKS[next(iter(_TASKS))]
    expect(task.model, task.expected)
    _TASKS[key, threading.get_ident()] = task


def forget(key: str) -> None:
    """Release a task of this thread."""
    _TASKS.pop((key, threading.get_ident()), None)


def unpickled(pickled: bytes) -> Task:
    """The task pickled by `acausal.study.sweep.workers.pickled`; source files in it are executed as modules.

    Raises pickle.UnpicklingError: for any error, with its message.
    """
    try:
        files, content = pickle.loads(pickled)
        for name, file, source in files:
            if name not in sys.modules:
                module = sys.modules[name] = ModuleType(name)
                module.__file__ = file
                sys.path.append(
                    str(Path(file).parent)
                )  # for imports of neighbouring files, if the folder exists on this machine
                exec(compile(source, file, "exec"), module.__dict__)
        return cast(Task, pickle.loads(content))
    except Exception as error:
        raise pickle.UnpicklingError(f"{type(error).__name__}: {error}") from error


def run_chunk(key: str, pickled: bytes | None, members: Sequence[tuple[int, tuple[float, ...]]]) -> list[Outcome]:
    """Run members in a worker; `pickled` is the task, needed if the worker has not received it yet."""
    task = _TASKS.get((key, threading.get_ident()))
    if task is None:
        assert pickled is not None, "a worker that was not sent a task has inherited it"
        task = unpickled(pickled)
        remember(key, task)
    return [run_member(task, member, values) for member, values in members]
