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
from weakref import WeakKeyDictionary

import numpy as np

from acausal.arrays import Vector
from acausal.errors import AcausalError, InternalError, UsageError
from acausal.language.component import Component
from acausal.lower.compile import compile as compile_model
from acausal.lower.compiled import CompiledModel
from acausal.result.result import Result
from acausal.simulate.native.policy import expect
from acausal.simulate.run import simulate
from acausal.study.sweep.identity import fingerprint, referenced

# A row is that of an output time if they differ by less than this fraction of the run, since an event takes the place
# of a row beside it, or of the largest time, by rounding.
_ONE_INSTANT, _ROUNDING = 2e-12, 1e-13
# Codes of values for which a model has to be compiled again: other states or pivots, other delays, and equations that
# are solved for something that has no value with them.
OTHER_STRUCTURE = ("AC029", "AC037", "AC303")


@dataclass(frozen=True, eq=False)
class Task:
    """The part of a sweep that all members share."""

    model: CompiledModel
    # Component (None for a compiled model) and parameters from which the model was compiled, to compile it again for
    # members with another structure.
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
        if not checked and isinstance(error, UsageError) and error.code not in OTHER_STRUCTURE:
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
    if task.model.recipe is not None:  # compiled from its classes again wherever its structure changes
        _compare(task)
    try:
        return simulate(task.model, parameters=own, **task.options)
    except AcausalError as error:
        if error.code not in OTHER_STRUCTURE or task.component is None:
            raise
    _compare(task)
    return simulate(task.component, parameters={**task.parameters, **own}, **task.options)


def stored_values(task: Task, result: Result) -> tuple[Vector, Vector]:
    """(Values at the end of a run, shape (s,); values on the grid, shape (r, s))."""
    first, last = float(task.grid[0]), float(task.grid[-1])
    slack = max(_ONE_INSTANT * (last - first), _ROUNDING * max(abs(first), abs(last)))
    row = np.searchsorted(result.time, task.grid + slack, side="right") - 1
    on_grid = np.abs(result.time[row] - task.grid) <= slack
    values = np.stack([result[name] for name in task.signals], axis=1)
    return values[-1].copy(), np.where(on_grid[:, None], values[row], np.nan)


def _compare(task: Task) -> None:
    """Refuse classes that do not make the model which another process has sent: AC064."""
    sent, recipe = _SENT.get(task), task.model.recipe
    if sent is None:
        return
    model, parameters = (task.component, task.parameters) if recipe is None else (recipe.model, recipe.parameters)
    assert model is not None, "a model without its component is compiled once"
    if fingerprint(compile_model(model, parameters=parameters)) != sent:
        raise UsageError("AC064", _OTHER_VERSION.format(task.model.name), help="restart the workers")
    del _SENT[task]


_OTHER_VERSION = "a worker has imported classes of another version of {}"
# The models of tasks from other processes, by their fingerprints there, until they are compared.
_SENT: WeakKeyDictionary[Task, str] = WeakKeyDictionary()
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
    """The task pickled by `acausal.study.sweep.workers.pickled`; a source file in it is executed as a module.

    Raises pickle.UnpicklingError: for any error, with its message.
    """
    try:
        files, classes, model, content = pickle.loads(pickled)
        # a worker may outlive a model: another folder may have a file of its name, or the file has been edited
        if files and getattr(sys.modules.get(files[0][0]), SENT, None) != files:
            _execute(files)
        task = cast(Task, pickle.loads(content))
        if referenced(task.model) != classes:
            raise ImportError(_OTHER_VERSION.format(task.model.name))
        _SENT[task] = model
        return task
    except Exception as error:
        raise pickle.UnpicklingError(f"{type(error).__name__}: {error}") from error


SENT = "_acausal_sent"
"""Attribute of the module of a model: the (name, path, source) of its file, and of those beside it that it imports."""


def _execute(files: Sequence[tuple[str, str, str]]) -> None:
    """Make the module of a model from the first of the files; it imports the others, where their folder exists."""
    name, file, source = files[0]
    folder, former = Path(file).parent, getattr(sys.modules.get(name), "__file__", None)
    folders = {folder, Path(former).parent} if former else {folder}
    for other, loaded in list(sys.modules.items()):
        if (path := getattr(loaded, "__file__", None)) and Path(path).parent in folders:
            del sys.modules[other]
    sys.path.insert(0, str(folder))
    module = sys.modules[name] = ModuleType(name)
    module.__file__ = file
    exec(compile(source, file, "exec"), module.__dict__)
    setattr(module, SENT, files)


def run_chunk(key: str, pickled: bytes | None, members: Sequence[tuple[int, tuple[float, ...]]]) -> list[Outcome]:
    """Run members in a worker; `pickled` is the task, needed if the worker has not received it yet."""
    task = _TASKS.get((key, threading.get_ident()))
    if task is None:
        assert pickled is not None, "a worker that was not sent a task has inherited it"
        task = unpickled(pickled)
        remember(key, task)
    return [run_member(task, member, values) for member, values in members]
