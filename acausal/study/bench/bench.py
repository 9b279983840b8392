"""The bench: all cases of a model, each in its own process, compared with one reference."""

from __future__ import annotations

import math
import os
import platform
import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from acausal.arrays import Vector
from acausal.errors import UsageError
from acausal.flatten.flat import suffixes
from acausal.language.component import Component
from acausal.lower.compile import compile
from acausal.lower.compiled import CompiledModel
from acausal.simulate.options import input_vector
from acausal.simulate.options import options as run_options
from acausal.simulate.solvers import solver_named
from acausal.study.bench import case as defaults
from acausal.study.bench.accuracy import reference as references
from acausal.study.bench.accuracy.distance import distance
from acausal.study.bench.accuracy.reference import Reference
from acausal.study.bench.accuracy.trajectory import components
from acausal.study.bench.case import Case, cases
from acausal.study.bench.isolated import isolated
from acausal.study.bench.measure import Measured, Task, measured
from acausal.study.bench.report import Bench
from acausal.study.bench.run import Run

Say = Callable[[str], None]

_COMPILE_LIMIT = 120.0
# A run with a larger mixed error counts as failed.
_ASTRAY = 10.0


def bench(
    model: Component | type[Component],
    *,
    solvers: Sequence[str] | None = None,
    tolerances: Sequence[float] | None = None,
    formulations: Sequence[str] | None = None,
    steps: Sequence[float] | None = None,
    reference: str | Path | None = None,
    variables: Sequence[str] | None = None,
    parameters: Mapping[str, object] | None = None,
    repeat: int = 5,
    time_limit: float = 20.0,
    native: bool | None = True,
    start_time: float | None = None,
    stop_time: float | None = None,
    inputs: Mapping[str, float] | None = None,
    progress: Say | None = None,
) -> Bench:
    """Measure work and precision of every solver at every tolerance and fixed step, on every formulation.

    Parameters
    ----------
    model
        A component, or its class.
    solvers
        Names; by default idas, rosenbrock, cvodes and erk, and rk2, erk and rosenbrock with fixed steps.
    tolerances, steps
        Tolerances, by default the decades from 1e-3 to 1e-10, and step sizes [s], by default those of 100, 1000 and
        10 000 steps per run.
    formulations
        "torn", "dae", "projected"; by default those that differ.
    reference
        A result file, or JSON with end values; by default runs that converge under refinement.
    variables
        Variables whose errors are measured; by default all states.
    repeat, time_limit
        Number of runs, of which the fastest counts, after a warm-up run; time limit of a single run [s].
    native
        As in `simulate`.
    progress
        Called with a line before each run.

    Raises
    ------
    UsageError
        AC024, AC032 for unknown names, AC041 for an invalid number, and errors of `simulate`.
    IntegrationError
        AC410 if no two solvers agree on a reference.
    """
    _check(solvers, tolerances, formulations, steps, repeat, time_limit)
    say = progress or (lambda text: None)
    began = time.perf_counter()
    component = model() if isinstance(model, type) else model
    times = {"build": time.perf_counter() - began}
    first, times["compile torn"] = _compiled(component, parameters, "torn")
    forms = _Forms({"torn": first}, {}, [], times)
    for formulation in formulations or defaults.FORMULATIONS:
        if formulation != "torn":
            say(f"compile {formulation}")
            forms.compile(component, parameters, formulation, asked=formulations is not None)
    if formulations is not None and "torn" not in formulations:
        del forms.models["torn"]
    options = {"native": native, "start_time": start_time, "stop_time": stop_time, "inputs": inputs}
    given = None if reference is None else Path(reference)
    cases = solvers, tolerances, steps
    return _benched(first, forms, cases, _Effort(repeat, time_limit), options, say, reference=given, names=variables)


@dataclass(frozen=True)
class _Effort:
    """Effort of a bench."""

    repeat: int
    limit: float  # of a single run [s]
    enough: float = references.ENOUGH  # digits of the reference that suffice
    patience: float | None = None  # time limit of a run as a multiple of the best so far


@dataclass(frozen=True)
class _Forms:
    """Compiled formulations of one model, reasons for the failure of others, notes, and times [s]."""

    models: dict[str, CompiledModel]
    failures: dict[str, str]
    notes: list[str]
    times: dict[str, float]

    def compile(
        self, component: Component, parameters: Mapping[str, object] | None, formulation: str, asked: bool
    ) -> None:
        """Add a formulation, or the reason for its failure; one equal to "torn" only if it was requested (`asked`)."""
        outcome = isolated(lambda: iter([bool(_compiled(component, parameters, formulation))]), _COMPILE_LIMIT)
        if outcome.value is None:
            self.failures[formulation] = outcome.failure
            return
        first = self.models["torn"]
        found, self.times[f"compile {formulation}"] = _compiled(component, parameters, formulation)
        if not asked and (found.states, found.algebraic) == (first.states, first.algebraic):
            self.notes.append(f"{formulation}: the same equations as torn")
        else:
            self.models[formulation] = found


def bench_compiled(
    compiled: CompiledModel,
    *,
    solvers: Sequence[str] | None,
    tolerances: Sequence[float],
    steps: Sequence[float],
    repeat: int,
    time_limit: float,
    options: Mapping[str, Any],
    enough: float,
    patience: float,
    say: Say,
) -> Bench:
    """As `bench`, for one compiled model; `options` are those of `simulate` that are common to all runs.

    The reference needs no more than `enough` digits; `patience` limits the time of a run to a multiple of the best.
    """
    compiled = compiled.unchanging("a bench")
    forms, effort = _Forms({"torn": compiled}, {}, [], {}), _Effort(repeat, time_limit, enough, patience)
    return _benched(compiled, forms, (solvers, tolerances, steps), effort, options, say)


def _benched(
    first: CompiledModel,
    forms: _Forms,
    asked: tuple[Sequence[str] | None, Sequence[float] | None, Sequence[float] | None],
    effort: _Effort,
    options: Mapping[str, Any],
    say: Say,
    *,
    reference: Path | None = None,
    names: Sequence[str] | None = None,
) -> Bench:
    """Run all cases; `asked` are solvers, tolerances and steps, None for the defaults."""
    chosen = run_options(
        first.flat.experiment, start_time=options.get("start_time"), stop_time=options.get("stop_time")
    )
    span = chosen.stop_time - chosen.start_time
    input_vector(first, options.get("inputs") or {})  # refuse a missing input here, not as a failure of every case
    task = Task(first, components(first, names), span, options)
    nominal = _nominal(first, task.names)
    if reference is None:
        against = references.converged_reference(task, nominal, 2.0 * effort.limit, say, effort.enough)
    else:
        against = references.reference_from_file(reference, task.names, nominal, (chosen.start_time, chosen.stop_time))
    if against.trusted_digits < 3.0:
        forms.notes.append(f"the reference is trusted to {against.trusted_digits:.1f} digits only")
    lab = _Lab(task, forms, against, effort, say)
    wanted = _wanted(*asked, span, chosen.step, first.flat.experiment.max_step)
    runs = tuple(lab.run(case) for case in _cases([*forms.models, *forms.failures], asked[0] is None, *wanted))
    started = [run.startup_time for run in runs if run.distance is not None]
    forms.times["start"] = statistics.median(started) if started else math.nan
    return Bench(
        model=first.name,
        runs=runs,
        reference=against,
        components=task.names,
        start_time=chosen.start_time,
        stop_time=chosen.stop_time,
        repeat=effort.repeat,
        times=forms.times,
        machine=machine(),
        notes=tuple(forms.notes),
    )


class _Lab:
    """Runs cases one by one; a series is abandoned when a case exceeds the time limit."""

    def __init__(self, task: Task, forms: _Forms, against: Reference, effort: _Effort, say: Say) -> None:
        self.task, self.forms, self.against, self.effort, self.say = task, forms, against, effort, say
        self.abandoned: dict[str, str] = {}
        self.fastest = math.inf

    def run(self, case: Case) -> Run:
        """Measure one case; a failure is part of the run."""
        forms, effort = self.forms, self.effort
        if case.formulation in forms.failures:
            return Run(case, failure=forms.failures[case.formulation])
        if case.series in self.abandoned:
            return Run(case, failure=f"not tried: {self.abandoned[case.series]}")
        task = replace(self.task, compiled=forms.models[case.formulation])
        if f"native {case.series}" not in forms.times and task.options.get("native"):
            forms.times[f"native {case.series}"] = self._library(task, case)
        self.say(f"{case.series}, {case.knob}")
        limit = effort.limit
        if effort.patience is not None:
            limit = min(limit, max(1.0, effort.patience * self.fastest))
        outcome = measured(task, case, effort.repeat, limit)
        if outcome.value is None:
            if "no end after" in outcome.failure:
                self.abandoned[case.series] = f"{outcome.failure} at {case.knob}"
            return Run(case, failure=outcome.failure)
        return self._judged(case, outcome.value)

    def _library(self, task: Task, case: Case) -> float:
        """Compile the C library in a child process, so that the runs find it on disk; returns the time [s]."""
        short = {**task.options, "stop_time": self._soon()}
        task = replace(task, options=short, span=self._soon() - float(self.against.trajectory.times[0]))

        def work() -> Any:
            began = time.perf_counter()
            task.run(case, 1)
            yield time.perf_counter() - began

        self.say(f"{case.series}: compile to C")
        return isolated(work, _COMPILE_LIMIT).value or math.nan

    def _soon(self) -> float:
        times = self.against.trajectory.times
        return float(times[0] + 1e-6 * (times[-1] - times[0]))

    def _judged(self, case: Case, found: Measured) -> Run:
        if not found.finite:
            return Run(case, failure="the solution is not finite")
        against = self.against
        self.fastest = min(self.fastest, found.first_time)
        far = distance(found.trajectory, against.trajectory, against.floor, against.trusted_digits)
        if against.only_end:
            far = replace(far, series=far.end, phase=None, shape=None)
        if far.series > _ASTRAY:
            return Run(case, failure=f"the solution has diverged from the reference: error {far.series:.1e}")
        return Run(
            case,
            distance=far,
            solve_time=found.solve_time,
            startup_time=found.startup_time,
            counters=found.counters,
            constraint_drift=found.drift,
            native=found.native,
            events=found.events,
        )


def _wanted(
    solvers: Sequence[str] | None,
    tolerances: Sequence[float] | None,
    steps: Sequence[float] | None,
    span: float,
    declared_step: float | None,
    max_step: float | None,
) -> tuple[Sequence[str], Sequence[float], Sequence[float]]:
    """Solvers, tolerances and steps with their defaults."""
    if steps is None:
        steps = [span / n for n in defaults.FIXED_STEPS]
        if declared_step is not None and all(abs(declared_step - s) > 1e-6 * s for s in steps):
            steps = [*steps, declared_step]
    if solvers is None:
        solvers = list(dict.fromkeys([*defaults.ADAPTIVE, *defaults.FIXED])) if steps else defaults.ADAPTIVE
    return solvers, defaults.TOLERANCES if tolerances is None else tolerances, steps


def _cases(
    formulations: Sequence[str],
    default: bool,
    solvers: Sequence[str],
    tolerances: Sequence[float],
    steps: Sequence[float],
) -> list[Case]:
    """All cases; by default formulations other than torn run with solvers for algebraic variables only."""
    restricts = default and "torn" in formulations
    return [
        c
        for c in cases(formulations, solvers, tolerances, steps)
        if not restricts or c.formulation == "torn" or (c.solver in defaults.IMPLICIT and c.step is None)
    ]


def _nominal(compiled: CompiledModel, names: Sequence[str]) -> Vector:
    """Nominal magnitudes of variables, shape (len(names),), 1 if unknown."""
    known = dict(zip(compiled.states, compiled.nominal_x, strict=True))
    for variable in compiled.flat.variables:
        for suffix in suffixes(variable.declaration.shape):
            known.setdefault(variable.path + suffix, abs(variable.declaration.nominal) or 1.0)
    return np.array([known.get(name, 1.0) for name in names], dtype=float)


def _compiled(
    component: Component, parameters: Mapping[str, object] | None, formulation: str
) -> tuple[CompiledModel, float]:
    began = time.perf_counter()
    found = compile(component, parameters=parameters, formulation=formulation, cache=False).unchanging("a bench")
    return found, time.perf_counter() - began


def _check(
    solvers: Sequence[str] | None,
    tolerances: Sequence[float] | None,
    formulations: Sequence[str] | None,
    steps: Sequence[float] | None,
    repeat: int,
    time_limit: float,
) -> None:
    for name in solvers or ():
        solver_named(name)
    for name in formulations or ():
        if name not in defaults.FORMULATIONS:
            raise UsageError(
                "AC024", f"there is no formulation '{name}'", help=f"formulations: {', '.join(defaults.FORMULATIONS)}"
            )
    checks = (
        (all(0 < t < 1 for t in tolerances or ()), "a tolerance lies between 0 and 1"),
        (all(s > 0 and math.isfinite(s) for s in steps or ()), "a step is a positive time"),
        (repeat >= 1, "repeat is at least 1"),
        (time_limit > 0, "the time limit is positive"),
        (
            steps is None or bool(steps) or solvers is None or any(s not in defaults.ONLY_FIXED for s in solvers),
            f"{', '.join(solvers or ())} needs a step",
        ),
    )
    for holds, fact in checks:
        if not holds:
            raise UsageError("AC041", fact)


def machine() -> dict[str, Any]:
    """Description of the machine of the measurements."""
    import casadi

    return {
        "python": platform.python_version(),
        "casadi": casadi.CasadiMeta.version(),
        "system": platform.system(),
        "processor": platform.machine(),
        "cores": os.cpu_count(),
        "load": round(os.getloadavg()[0], 2) if hasattr(os, "getloadavg") else None,
    }
