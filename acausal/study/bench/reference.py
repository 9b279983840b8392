"""What errors are measured against: two solvers that agree, or a file."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from acausal.errors import IntegrationError, UsageError
from acausal.result import load
from acausal.study.bench.case import IMPLICIT, Case
from acausal.study.bench.distance import floors, mixed
from acausal.study.bench.measure import FINE, Task, fine
from acausal.study.bench.trajectory import POINTS, Trajectory

Vector = NDArray[np.float64]

SOLVERS = ("rosenbrock", "idas", "erk", "cvodes")
"""Candidates, the most exact first; BDF of two makes (idas, cvodes) counts as two, but only as the last pair.

Where there are algebraic variables, those that eliminate them by one and the same rootfinder come last: they agree to
more digits than they are right (Andrews' mechanism: 11 and 9, measured).
"""
EASY = 1e-7
TIGHT = (1e-12, 1e-11, 1e-10, 1e-9)
_PATIENCE = 30.0
ENOUGH = 11.0
"""Common digits after which no further solver is asked."""
_MOST_DIGITS = 15.0


@dataclass(frozen=True, eq=False)
class Reference:
    """A trajectory on the fine grid, where from, and how many of its digits are to be trusted.

    `only_end` marks a reference that knows the end values alone.
    """

    trajectory: Trajectory
    floor: Vector
    trusted_digits: float
    source: str
    solvers: tuple[str, ...] = ()
    only_end: bool = False
    notes: tuple[str, ...] = ()

    @property
    def trusted_error(self) -> float:
        """The smallest error that can be told from that of the reference."""
        return float(10.0**-self.trusted_digits)


def made(task: Task, nominal: Vector, limit: float, say: Callable[[str], None], enough: float = ENOUGH) -> Reference:
    """The reference two different solvers agree on.

    Each solver runs at the tightest tolerance at which it gets through. All have to agree on the whole fine grid; the
    closest pair decides, the trusted digits are what they have in common.

    Raises
    ------
    IntegrationError
        AC410 when fewer than two solvers arrive.
    """
    found: dict[str, Trajectory] = {}
    notes: list[str] = []
    # two decades more than what is asked for, where that is less than everything
    tight = [t for t in TIGHT if t >= 10.0 ** -(enough + 2.0)] if enough < ENOUGH else TIGHT
    solvers = IMPLICIT if task.compiled.algebraic else SOLVERS
    for solver in dict.fromkeys((*solvers, *SOLVERS)):
        if solver not in solvers and len(found) >= 2:
            break
        arrived = _tightest(task, solver, tight, limit, say, notes)
        if arrived is not None:
            found[arrived[0]] = arrived[1]
        if len(found) >= 2 and _closest(found, nominal)[0] >= enough:
            break
    if len(found) < 2:
        raise IntegrationError(
            "AC410",
            f"no reference for {task.compiled.name}: two different solvers have to agree, {len(found)} arrived",
            evidence=list({note.partition(" at ")[0]: note for note in notes}.values()),
            help=_remedy(notes),
        )
    digits, (first, second) = _closest(found, nominal)
    trajectory = found[first]
    source = f"{first} and {second} agree"
    return Reference(trajectory, floors(trajectory, nominal), digits, source, (first, second), notes=tuple(notes))


def _remedy(notes: Sequence[str]) -> str:
    """What to do about runs that did not arrive; most of them say where they stopped, if the solution ends."""
    ends = [float(t) for note in notes for t in re.findall(r"stopped at t = (\S+) s", note)]
    if len(ends) > len(notes) / 2:
        return f"the solution seems to end near t = {min(ends):.4g} s: stop the bench before it (--stop-time)"
    return "allow more time (--time-limit), or give a reference (--reference FILE)"


def _tightest(
    task: Task, solver: str, tight: Sequence[float], limit: float, say: Callable[[str], None], notes: list[str]
) -> tuple[str, Trajectory] | None:
    """A solver's run at the tightest tolerance at which it arrives.

    An easy run comes first: how long it takes tells how long a tight one may take before it is stuck. Methods of order
    five pay six times as many steps for four decades.
    """
    best, patience = None, limit
    for tolerance in (EASY, *tight):
        name = f"{solver} at {tolerance:g}"
        say(f"reference: {name}")
        outcome = fine(task, Case(solver, "torn", tolerance=tolerance), patience)
        if outcome.value is not None and np.isfinite(outcome.value.values).all():
            best = name, outcome.value
            if tolerance != EASY:
                return best
            patience = min(limit, 2.0 + _PATIENCE * outcome.seconds)
        else:
            notes.append(f"{name}: {outcome.failure or 'not finite'}")
            if tolerance == EASY and "no end after" in outcome.failure:
                return None
    return best


def _closest(found: dict[str, Trajectory], nominal: Vector) -> tuple[float, tuple[str, str]]:
    """Digits that the best pair has in common, and that pair."""
    best = (-math.inf, ("", ""))
    for a, b in combinations(found, 2):
        x = found[a]
        gap = float(mixed(found[b].values, x.values, floors(x, nominal)).max())
        digits = min(_MOST_DIGITS, -math.log10(gap)) if gap > 0 else _MOST_DIGITS
        best = max(best, (digits, (a, b)), key=lambda pair: pair[0])
    return best


def given(file: Path, names: Sequence[str], nominal: Vector, span: tuple[float, float]) -> Reference:
    """The reference of a result file (.mat, .csv, .npz), or end values from JSON.

    JSON holds, at the top or under "reference", `values`: numbers (or decimal strings) by the paths of variables, at
    the end of the run, and if known `trusted_digits`.

    Raises
    ------
    UsageError
        AC010 for variables it lacks, AC011 when it is shorter than the run, AC013, AC014 when it cannot be read.
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
