"""One member of a sweep: a run, and what is kept of it. This is all that a worker does."""

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

# Times of output that are nearer than this share of the largest are the same.
_SAME = 1e-13


@dataclass(frozen=True, eq=False)
class Task:
    """What all members share."""

    model: CompiledModel
    # `component`, `parameters`: what the model was compiled from, for members for which that does not hold (AC029);
    # None where a compiled model was given.
    component: Component | None
    parameters: Mapping[str, Any]
    names: tuple[str, ...]  # parameters that are varied
    grid: Vector  # times of the rows that are kept, shape (r,). [s]
    signals: tuple[str, ...]  # names of the s scalar signals that are kept
    options: Mapping[str, Any]  # options of `simulate`
    expected: float = 0.0  # evaluations of the right-hand side in all members together, as far as that is known


@dataclass(frozen=True, eq=False)
class Outcome:
    """What is kept of a member.

    `code` is empty for a run that came to its end, at `stop`; then `final`, shape (s,), holds the values there, and
    `rows`, shape (r, s), those on the grid, nan behind a run that ended itself. Of a failed run both are nan.
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
    """Run one member; whatever the run fails of is its outcome, but for a wrong request that nobody has `checked`."""
    began = time.perf_counter()
    try:
        result = result_of(task, values)
        final, rows = kept(task, result)
    except Exception as error:
        shown = as_error(error)
        if not checked and isinstance(error, UsageError) and error.code != "AC029":
            raise
        reached = getattr(getattr(error, "result", None), "time", np.array([np.nan]))[-1]
        return failed(task, member, shown.code, shown.fact, float(reached), time.perf_counter() - began)
    notes: Any = result.stats.get("notes", ())
    seconds = time.perf_counter() - began
    evaluations = float(result.stats.get("rhs_evaluations", 0.0))  # type: ignore[arg-type]
    stop, events = float(result.time[-1]), len(result.events)
    return Outcome(member, "", "", tuple(notes), stop, seconds, events, final, rows, evaluations)


def failed(
    task: Task, member: int, code: str, message: str, reached: float = np.nan, seconds: float = np.nan
) -> Outcome:
    """The outcome of a member that has no values."""
    nothing = np.full((len(task.grid), len(task.signals)), np.nan)
    return Outcome(member, code, message, (), reached, seconds, 0, nothing[0], nothing)


def as_error(error: Exception) -> AcausalError:
    """Any exception with a code."""
    if isinstance(error, AcausalError):
        return error
    return InternalError("AC999", f"{type(error).__name__}: {error}")


def result_of(task: Task, values: Sequence[float]) -> Result:
    """The run of a member, the same as `simulate` of the component with these parameters."""
    own = dict(zip(task.names, values, strict=True))
    try:
        return simulate(task.model, parameters=own, **task.options)
    except UsageError as error:
        if error.code != "AC029" or task.component is None:
            raise
    return simulate(task.component, parameters={**task.parameters, **own}, **task.options)


def kept(task: Task, result: Result) -> tuple[Vector, Vector]:
    """Values at the end of a run, shape (s,), and on the grid, shape (r, s)."""
    slack = _SAME * max(abs(task.grid[0]), abs(task.grid[-1]))
    place = np.searchsorted(result.time, task.grid + slack, side="right") - 1
    there = np.abs(result.time[place] - task.grid) <= slack
    values = np.stack([result[name] for name in task.signals], axis=1)
    return values[-1].copy(), np.where(there[:, None], values[place], np.nan)


# The tasks of this process: compiled models hold memory that no two threads may share.
_TASKS: dict[tuple[str, int], Task] = {}
_MOST_TASKS = 32


def remember(key: str, task: Task) -> None:
    """Keep a task for chunks that this thread will run."""
    while len(_TASKS) >= _MOST_TASKS:
        del _TASKS[next(iter(_TASKS))]
    expect(task.model, task.expected)
    _TASKS[key, threading.get_ident()] = task


def forget(key: str) -> None:
    """Release a task that this thread remembers."""
    _TASKS.pop((key, threading.get_ident()), None)


def unpacked(packed: bytes) -> Task:
    """A task as `acausal.study.sweep.crew.packed` has sent it, with the model files that it needs.

    Raises pickle.UnpicklingError: With the words of whatever has failed.
    """
    try:
        files, content = pickle.loads(packed)
        for name, file, source in files:
            if name not in sys.modules:
                module = sys.modules[name] = ModuleType(name)
                module.__file__ = file
                sys.path.append(str(Path(file).parent))  # of files beside it, where there is that folder here
                exec(compile(source, file, "exec"), module.__dict__)
        return cast(Task, pickle.loads(content))
    except Exception as error:
        raise pickle.UnpicklingError(f"{type(error).__name__}: {error}") from error


def run_chunk(key: str, packed: bytes | None, members: Sequence[tuple[int, tuple[float, ...]]]) -> list[Outcome]:
    """Run some members in a worker, of a task that it knows or unpacks."""
    task = _TASKS.get((key, threading.get_ident()))
    if task is None:
        assert packed is not None, "a worker that was not sent a task has inherited it"
        task = unpacked(packed)
        remember(key, task)
    return [run_member(task, member, values) for member, values in members]
