"""Further numerical difficulties of a run, found in the equations and along the run."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from acausal.errors import counted
from acausal.study.growth import Growth
from acausal.study.stability.modes.modes import Local
from acausal.study.stability.structure import Facts
from acausal.study.stability.trajectory import Trajectory

_LONGEST = 90
# A larger growth of errors is reported.
_MUCH = 100.0
# For a state of smaller magnitude, an absolute tolerance chosen for 1 is too loose.
_SMALL = 0.05


@dataclass(frozen=True)
class Finding:
    """One finding: its kind, the fact, the remedy, and `avoid`, the (method, reason) pairs that it rules out."""

    kind: str
    fact: str
    remedy: str
    avoid: tuple[tuple[str, str], ...] = ()

    def content(self) -> dict[str, object]:
        """The finding as a dictionary, for JSON."""
        return {"kind": self.kind, "fact": self.fact, "remedy": self.remedy}


def findings(
    run: Trajectory, facts: Facts, grown: Growth | None, locals: Sequence[Local], undetermined: Sequence[float]
) -> tuple[Finding, ...]:
    """All findings, the most important first."""
    found = [
        _failed(run),
        _constraints(run, facts),
        _invariants(facts),
        _events(run, facts),
        _accumulation(run),
        _instants(run, facts),
        _slopes(run, locals, undetermined),
        _singular(locals),
        _growing(grown),
        _scales(run),
    ]
    return tuple(f for f in found if f is not None)


def _failed(run: Trajectory) -> Finding | None:
    if run.failure is None and run.failed:
        shown = ", ".join(f"{solver} at t = {t:.6g} s" for solver, t in run.failed)
        return Finding("failed", f"other solvers failed: {shown}", "the equations are singular or have a kink there")
    if run.failure is None:
        return None
    return Finding(
        "failed",
        f"the run ended at t = {run.result.time[-1]:.6g} s: {run.failure.code}, {run.failure.fact}",
        "these results are valid up to that time; see the error",
    )


def _constraints(run: Trajectory, facts: Facts) -> Finding | None:
    if not facts.constraints:
        return None
    shown = "; ".join(_short(text) for text in facts.constraints[:3])
    more = f" and {len(facts.constraints) - 3} more" if len(facts.constraints) > 3 else ""
    if facts.stabilised:
        remedy = (
            f"no fixed choice of states is safe: {facts.stabilised} constraints of all levels are stabilised, their "
            f"residuals decay at about {run.p[-1]:.3g} 1/s, and recorded points are projected onto them"
        )
    else:
        remedy = "differentiated and solved for dummy derivatives: the constraint holds up to rounding errors"
    avoid = (
        ("BDF for the constraint as stated", f"of index {facts.index}, which no solver here integrates"),
        ("its second derivative alone", "the constraint drifts away, quadratically in time"),
    )
    return Finding(
        "constraint",
        f"DAE of index {facts.index}: `{shown}`{more} had to be differentiated",
        remedy,
        avoid[: max(0, facts.index - 1)],
    )


def _short(text: str) -> str:
    return text if len(text) <= _LONGEST else text[:_LONGEST] + " ..."


def _invariants(facts: Facts) -> Finding | None:
    if not facts.by_invariants:
        return None
    return Finding(
        "invariant",
        f"{', '.join(facts.by_invariants)} follows from a linear invariant; integrated, it could be lost in rounding",
        "it is computed from the invariant instead",
        (("all balances integrated as written", "their difference is below rounding"),),
    )


def _events(run: Trajectory, facts: Facts) -> Finding | None:
    """One finding on relations that are located and those that are not, because a model can have both."""
    if not facts.relations and not facts.clauses:
        return _kinks(facts)
    located = "located on the solver's dense output" if facts.relations else "the run is divided exactly there"
    avoid = [("any method across switches", "order 1 only, and short pulses are missed, unless it locates them")]
    rest, remedy = "", located + "; every branch is integrated smoothly"
    kinks = _kinks(facts)
    if kinks is not None:
        rest = f"; {facts.kinks} other branches, signs, minima or maxima are not events"
        remedy = f"events: {located}; the others: {kinks.remedy}"
        avoid += kinks.avoid
    return Finding(
        "events",
        f"{counted(facts.relations, 'relation')} of variables and {counted(facts.clauses, 'when clause')} are events, "
        f"{len(run.result.events)} in this run{rest}",
        remedy,
        tuple(avoid),
    )


def _accumulation(run: Trajectory) -> Finding | None:
    times = np.unique([event.time for event in run.result.events])
    if len(times) < 8:
        return None
    gaps = np.diff(times)
    shrinking = int(np.sum(gaps[1:] < 0.98 * gaps[:-1]))
    if shrinking < 0.7 * (len(gaps) - 1) or gaps.min() > 1e-3 * run.span:
        return None
    k = int(np.argmin(gaps))
    return Finding(
        "accumulation",
        f"events follow each other ever sooner, down to {gaps[k]:.2g} s apart at t = {times[k]:.6g} s",
        "infinitely many bounces end at rest",
        (("restarting at every event", "never passes the accumulation point"),),
    )


def _instants(run: Trajectory, facts: Facts) -> Finding | None:
    if not facts.instants:
        return None
    edges = [float(run.result.time[0]), *facts.instants, float(run.result.time[-1])]
    shortest = min(b - a for a, b in pairwise(edges))
    pulse = shortest < 0.02 * run.span
    return Finding(
        "time-events",
        f"sources switch at {len(facts.instants)} known times, the shortest stretch is {shortest:.3g} s"
        + (": shorter than a step of most solvers, which would miss it" if pulse else ""),
        "the run is divided exactly there",
        (("a solver that has to discover the switch", "every step is longer than the pulse"),) if pulse else (),
    )


def _kinks(facts: Facts) -> Finding | None:
    if not facts.kinks:
        return None
    return Finding(
        "kinks",
        f"{facts.kinks} branches, signs, minima or maxima of variables are evaluated in every call, not located",
        "error control finds them by rejected steps; fixed steps have order 1 there",
        (("fixed steps across kinks", "order 1 only: no step ends where a branch changes"),),
    )


def _slopes(run: Trajectory, locals: Sequence[Local], undetermined: Sequence[float]) -> Finding | None:
    if undetermined:
        return Finding(
            "singular",
            f"no finite linearisation at t = {undetermined[0]:.6g} s and {len(undetermined) - 1} more points: "
            "an infinite slope, or algebraic variables that are not determined",
            "examine the equations there: a power below 1 at zero, a square root, or a change point",
            (("Newton's method through that point", "its Jacobian is singular or infinite there"),),
        )
    sizes = np.array([abs(local.eigenvalues[0]) for local in locals if len(local.eigenvalues)])
    typical = float(np.median(sizes)) if len(sizes) else 0.0
    if not len(sizes) or sizes.max() < 1e4 * max(typical, 1.0 / run.span):
        return None
    k = int(np.argmax(sizes))
    return Finding(
        "slope",
        f"the fastest eigenvalue is {sizes.max():.3g} 1/s at t = {locals[k].point.t:.6g} s and {typical:.3g} elsewhere",
        "a slope grows without bound near a point: use an adaptive solver",
        (("fixed steps", "none is small enough there"),),
    )


def _singular(locals: Sequence[Local]) -> Finding | None:
    worst = min(locals, key=lambda local: local.regularity, default=None)
    if worst is None:
        return None
    turned = next((b for a, b in pairwise(locals) if a.orientation * b.orientation < 0.0), None)
    if turned is None and worst.regularity > 1e-6:
        return None
    fact = f"nearly undetermined at t = {worst.point.t:.6g} s (reciprocal condition {worst.regularity:.1e})"
    if turned is not None:
        fact = f"not determined at an instant just before t = {turned.point.t:.6g} s: their Jacobian changes its sign"
    return Finding(
        "singular",
        f"the algebraic variables are {fact}",
        "a change point or a dead centre: Newton's method may take another branch there",
        (("Newton's method started from the last point", "it may converge to the other branch"),),
    )


def _growing(grown: Growth | None) -> Finding | None:
    if grown is None or grown.factor < _MUCH:
        return None
    digits = math.log10(grown.factor)
    if grown.keeps_digits:
        remedy = "the solution grows with it, and keeps its digits"
    else:
        remedy = (
            f"use a tolerance {digits:.0f} digits tighter than the accuracy required at the end, or shorten the run"
        )
    return Finding(
        "growing",
        f"an error made at t = {grown.since:.4g} s grows {grown.factor:.2g} times until the end, in "
        f"{', '.join(grown.names)}: computed from the variational equation of this run",
        remedy,
    )


def _scales(run: Trajectory) -> Finding | None:
    """The state for which one absolute tolerance for all units would be worst."""
    sizes = [float(np.max(np.abs(run.result[name]))) for name in run.compiled.states]
    small = [
        (size, name, float(nominal))
        for name, size, nominal in zip(run.compiled.states, sizes, run.compiled.nominal_x, strict=True)
        if 0.0 < size < _SMALL
    ]
    if not small:
        return None
    size, name, nominal = min(small)
    scaled = "absolute tolerances are scaled by nominal values, variable by variable: "
    known = f"that of {name} is {nominal:g}" if nominal < size / _SMALL else f"declare nominal={size:.1g} for {name}"
    return Finding(
        "scale",
        f"{name} stays below {size:.2g}" + (f", and {len(small) - 1} more states below {_SMALL}" if small[1:] else ""),
        scaled + known,
        (("one absolute tolerance for all units", f"1e-6 would leave {max(math.log10(size / 1e-6), 0.0):.1g} digits"),),
    )
