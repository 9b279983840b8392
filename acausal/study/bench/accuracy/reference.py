"""Reference of a bench: a run that converges under refinement and is confirmed by another solver, or a file."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from acausal.arrays import Vector
from acausal.errors import IntegrationError, UsageError
from acausal.result.result import load
from acausal.simulate.solvers import solver_named, tolerance_fraction
from acausal.study.bench.accuracy.distance import floors, mixed
from acausal.study.bench.accuracy.trajectory import POINTS, Trajectory
from acausal.study.bench.case import IMPLICIT, Case
from acausal.study.bench.isolated import Outcome, isolated
from acausal.study.bench.measure import FINE, Task, fine
from acausal.study.growth import Growth, growth

SOLVERS = ("rosenbrock", "idas", "erk", "cvodes")
"""Candidates, the most accurate first.

For a model with algebraic variables, solvers that eliminate them by the same rootfinder come last: they agree to more
digits than are correct (Andrews' mechanism: 11 and 9, measured).
"""
EASY = 1e-7
TIGHT = (1e-12, 1e-11, 1e-10, 1e-9)
_PATIENCE = 30.0
ENOUGH = 10.0
"""Number of trusted digits that suffices: no further solver is run."""
_MOST_DIGITS = 15.0
_DECADE = 10.0
"""Factor between the tolerances of the runs that show whether a solver converges."""
_SAFETY = 1.5
_LOCATED = 1e-11
"""Smallest error of a run with located events: the resolution of their instants does not improve with the tolerance."""
_WITNESS = 100.0
"""Largest ratio of the error of a confirming run to that of the confirmed one."""


@dataclass(frozen=True, eq=False)
class Reference:
    """A trajectory on the fine grid, its origin, and the number of its trusted digits.

    `only_end` marks a reference that has end values only; `growth` is the growth of errors along the run, if known.
    """

    trajectory: Trajectory
    floor: Vector
    trusted_digits: float
    source: str
    solvers: tuple[str, ...] = ()
    only_end: bool = False
    notes: tuple[str, ...] = ()
    growth: Growth | None = None

    @property
    def trusted_error(self) -> float:
        """Smallest error that can be distinguished from that of the reference."""
        return float(10.0**-self.trusted_digits)


@dataclass(frozen=True, eq=False)
class _Refined:
    """The tightest run of a solver, and its error estimated from coarser runs."""

    name: str
    trajectory: Trajectory
    error: float


def converged_reference(
    task: Task, nominal: Vector, limit: float, say: Callable[[str], None], enough: float = ENOUGH
) -> Reference:
    """Compute a reference that converges under refinement and is confirmed by another solver.

    `nominal`: magnitudes of the variables, shape (k,); `limit`: time limit of a run [s].

    Each solver runs at the tightest tolerance at which it succeeds, and at ten and a hundred times this tolerance. The
    differences within this sequence give an estimate of its error. Agreement of two solvers at one tolerance is no
    proof, because methods of the same order and error control can share an error that falls with the tolerance.
    Another solver has to agree within both estimates; if it does not, the difference counts as the error.

    Raises IntegrationError: AC410 if fewer than two solvers succeed.
    """
    found: list[_Refined] = []
    notes: list[str] = []
    # two decades tighter than requested, within the tightest possible
    first = max(TIGHT[0], 10.0 ** -(enough + 2.0))
    tight = (first, _DECADE * first) if enough < ENOUGH else TIGHT
    solvers = IMPLICIT if task.compiled.algebraic else SOLVERS
    for solver in dict.fromkeys((*solvers, *SOLVERS)):
        if solver not in solvers and len(found) >= 2:
            break
        refined = _tightest(task, solver, tight, limit, say, notes, nominal)
        if refined is not None:
            found.append(refined)
        if len(found) >= 2 and _suffices(found, nominal, enough):
            break
    if len(found) < 2:
        raise IntegrationError(
            "AC410",
            f"no reference for {task.compiled.name}: two different solvers have to agree, {len(found)} succeeded",
            evidence=list({note.partition(" at ")[0]: note for note in notes}.values()),
            help=_remedy(notes),
        )
    error, best, other = _judged(found, nominal)
    if task.compiled.state_events.relations:
        error = max(error, _LOCATED)
    trajectory = best.trajectory
    source = f"{best.name} converges, {other.name} agrees"
    if error > _SAFETY * max(best.error, 10.0**-_MOST_DIGITS, _LOCATED):
        source = f"{best.name}, from which {other.name} differs"
    say("reference: growth of errors")
    grown = isolated(lambda: iter([growth(task.compiled, _parameters(task), task.options, task.span)]), limit).value
    names = (best.name, other.name)
    return Reference(
        trajectory, floors(trajectory, nominal), _digits(error), source, names, notes=tuple(notes), growth=grown
    )


def _parameters(task: Task) -> dict[str, float]:
    """Parameters of the runs of a task, by path."""
    return dict(task.options.get("parameters") or {})


def _digits(error: float) -> float:
    return min(_MOST_DIGITS, -math.log10(error)) if error > 0 else _MOST_DIGITS


def _suffices(found: Sequence[_Refined], nominal: Vector, enough: float) -> bool:
    """Whether no further solver is needed: there are enough digits, or a run of similar precision agrees."""
    error, best, other = _judged(found, nominal)
    agreed = error <= _SAFETY * best.error and other.error <= _WITNESS * best.error
    return agreed or _digits(error) >= enough


def _judged(found: Sequence[_Refined], nominal: Vector) -> tuple[float, _Refined, _Refined]:
    """(Error of the best run, that run, the run that it was compared with).

    If two runs differ by no more than the sum of their estimated errors, the better one is confirmed; otherwise their
    difference is its error.
    """
    best = min(found, key=lambda run: run.error)
    floor = floors(best.trajectory, nominal)
    comparisons = []
    for other in (run for run in found if run is not best):
        gap = float(mixed(other.trajectory.values, best.trajectory.values, floor).max())
        comparisons.append((best.error if gap <= _SAFETY * (best.error + other.error) else gap, other))
    # the run closest in precision is the strictest test
    error, other = min(comparisons, key=lambda pair: (pair[1].error, pair[0]))
    return _SAFETY * max(error, 10.0**-_MOST_DIGITS), best, other


def _remedy(notes: Sequence[str]) -> str:
    """Remedy for runs that failed; if the solution ends, most notes contain the time at which they stopped."""
    ends = [float(t) for note in notes for t in re.findall(r"stopped at t = (\S+) s", note)]
    if len(ends) > len(notes) / 2:
        return f"the solution seems to end near t = {min(ends):.4g} s: stop the bench before it (--stop-time)"
    return "allow more time (--time-limit), or give a reference (--reference FILE)"


def _tightest(
    task: Task,
    solver: str,
    tight: Sequence[float],
    limit: float,
    say: Callable[[str], None],
    notes: list[str],
    nominal: Vector,
) -> _Refined | None:
    """Run of a solver at the tightest tolerance at which it succeeds, with coarser ones.

    A run at the tolerance `EASY` comes first: its duration limits that of the tight runs, so that one that makes no
    progress is ended. Methods of order five take six times as many steps for four decades.
    """
    patience = limit
    for tolerance in (EASY, *tight):
        outcome = _run(task, solver, tolerance, patience, say, notes)
        if outcome.value is None and tolerance == EASY and "no end after" in outcome.failure:
            return None
        if outcome.value is None:
            continue
        if tolerance == EASY:
            patience = min(limit, 2.0 + _PATIENCE * outcome.seconds)
            continue
        coarser = []
        for coarse in _coarser(task, solver, tolerance):
            run = _run(task, solver, coarse, patience, say, notes).value
            if run is None:
                break
            coarser.append(run)
        if len(coarser) == 2:
            error = _refinement(outcome.value, coarser[0], coarser[1], nominal)
            return _Refined(f"{solver} at {tolerance:g}", outcome.value, error)
    return None


def _run(
    task: Task, solver: str, tolerance: float, patience: float, say: Callable[[str], None], notes: list[str]
) -> Outcome[Trajectory]:
    """One run; its failure is noted."""
    name = f"{solver} at {tolerance:g}"
    say(f"reference: {name}")
    outcome = fine(task, Case(solver, "torn", tolerance=tolerance), patience)
    if outcome.value is not None and np.isfinite(outcome.value.values).all():
        return outcome
    notes.append(f"{name}: {outcome.failure or 'not finite'}")
    return Outcome(None, outcome.failure)


def _coarser(task: Task, solver: str, tolerance: float) -> tuple[float, float]:
    """The tolerances for which the solver's internal one is ten and a hundred times that for this tolerance.

    Multiples of this tolerance would not do, because the smallest tolerances all lead to the same internal one.
    """
    method = solver_named(solver)
    internal = tolerance_fraction(task.compiled, method, tolerance) * tolerance
    ratio = tolerance_fraction(task.compiled, method, 1.0)
    return _DECADE * internal / ratio, _DECADE**2 * internal / ratio


def _refinement(tight: Trajectory, coarse: Trajectory, coarsest: Trajectory, nominal: Vector) -> float:
    """Error of the tightest of three runs, each with a tenth of the tolerance of the next coarser one.

    It is not larger than the last difference, if errors fall at least by half. Because they need not fall steadily (on
    a chaotic run by factors of 4, 15 and 1.1 in three decades), nothing is extrapolated. If two runs agree by chance, a
    tenth of the other difference is the larger estimate.
    """
    floor = floors(tight, nominal)
    last, before = (float(mixed(a.values, b.values, floor).max()) for a, b in ((coarse, tight), (coarsest, coarse)))
    return max(last, before / _DECADE)


def reference_from_file(file: Path, names: Sequence[str], nominal: Vector, span: tuple[float, float]) -> Reference:
    """Reference from a result file (.mat, .csv, .npz, .parquet), or end values from JSON.

    `nominal`: magnitudes of the variables, shape (k,).

    JSON contains, at the top or under "reference", `values`: numbers (or decimal strings) by the paths of variables, at
    the end of the run, and optionally `trusted_digits`.

    Raises UsageError: AC010 for missing variables, AC011 if it is shorter than the run, AC013, AC014 if it cannot be
    read.
    """
    start, stop = span
    times = start + (stop - start) * np.arange(POINTS * FINE + 1) / (POINTS * FINE)
    if file.suffix.lower() == ".json":
        values, digits = _from_json(file, names)
        trajectory = Trajectory(times, tuple(names), np.tile(values, (len(times), 1)))
        return Reference(trajectory, floors(trajectory, nominal), digits, str(file), only_end=True)
    result = load(file)
    values = np.stack([np.asarray(result.at(times, name)) for name in names], axis=1)
    trajectory = Trajectory(times, tuple(names), values)
    return Reference(trajectory, floors(trajectory, nominal), _MOST_DIGITS, str(file))


def _from_json(file: Path, names: Sequence[str]) -> tuple[Vector, float]:
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
        content = content.get("reference", content)
        values = {str(k): float(v) for k, v in dict(content["values"]).items()}
        digits = float(content.get("trusted_digits", _MOST_DIGITS))
    except (OSError, ValueError, TypeError, KeyError, AttributeError) as error:
        raise UsageError(
            "AC014",
            f"cannot read {file} as a reference",
            evidence=[f"{type(error).__name__}: {error}"],
            help='write {"values": {"path.of.variable": 1.0}, "trusted_digits": 10}',
        ) from error
    missing = [name for name in names if name not in values]
    if missing:
        raise UsageError("AC010", f"{file} has no value of {missing[0]}", evidence=[f"it has {', '.join(values)}"])
    return np.array([values[name] for name in names]), digits
