"""Characteristics of a run: stiffness, oscillations, and their time scales."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from acausal.arrays import Complex
from acausal.simulate.step_limit.amplification import METHODS, Method
from acausal.study.stability.modes.modes import Local, Mode, mode
from acausal.study.stability.trajectory import Trajectory

FAST = 30.0
"""A mode is fast if it is this many times faster than the solution changes."""
# Damping ratios below which an oscillation counts as weakly damped, and as undamped.
_WEAK = 0.1
_UNDAMPED = 0.02


@dataclass(frozen=True)
class Character:
    """Numbers on which the verdict is based."""

    fastest: Mode | None  # the mode of largest |eigenvalue|; None without dynamic states
    stiffness_ratio: float  # largest max|Re|/min|Re| of decaying modes over all points; 1 for fewer than two modes
    stiffness: float  # median over the run of the fastest decaying |eigenvalue| / rate of the solution
    explicit_steps: float  # steps that stability alone requires of the explicit pair 5(4) over the run
    steps: float  # steps that the run took
    ringing: Mode | None  # fastest weakly damped oscillation that the solution does not follow, or None
    oscillation: Mode | None  # weakly damped oscillation that the solution follows for many periods, or None
    periods: float  # its number of periods


def character(run: Trajectory, locals: Sequence[Local]) -> Character:
    """Compute the characteristics of a run."""
    erk = next(m for m in METHODS if m.name == "erk")
    fastest = max(
        ((local, v) for local in locals for v in local.eigenvalues[:1]), key=lambda q: abs(q[1]), default=None
    )
    ratios = [_ratio(local.eigenvalues) for local in locals]
    quiet = 1.0 / run.span
    stiff = [
        float(np.max(np.abs(decaying))) / max(_activity(local, quiet), quiet)
        for local in locals
        if len(decaying := _decaying(local.eigenvalues))
    ]
    followed = [(local, FAST * max(_activity(local, quiet), quiet)) for local in locals]
    ringing, _ = _dominant(run, [(q, v) for q, f in followed for v in _weak(q, _WEAK) if abs(v) > f])
    oscillation, periods = _dominant(run, [(q, v) for q, f in followed for v in _weak(q, _UNDAMPED) if abs(v) <= f])
    return Character(
        fastest=None if fastest is None else mode(run, *fastest),
        stiffness_ratio=max(ratios, default=1.0),
        stiffness=float(np.median(stiff)) if stiff else 0.0,
        explicit_steps=sum(_steps(erk, local, run.span) for local in locals),
        steps=float(run.result.stats.get("steps", 0.0)),  # type: ignore[arg-type]
        ringing=ringing,
        oscillation=oscillation,
        periods=periods,
    )


def _activity(local: Local, quiet: float) -> float:
    return local.activity if math.isfinite(local.activity) else quiet


def _decaying(modes: Complex) -> Complex:
    return modes[(modes.real < 0.0) & (np.abs(modes.real) > 1e-9 * np.abs(modes))]


def _ratio(modes: Complex) -> float:
    sizes = np.abs(_decaying(modes).real)
    # eigenvalues that are zero up to rounding are not slow modes
    sizes = sizes[sizes > 1e-14 * np.max(np.abs(modes), initial=0.0)]
    return float(sizes.max() / sizes.min()) if len(sizes) > 1 else 1.0


def _weak(local: Local, damping: float) -> list[complex]:
    """Oscillations with less than this damping ratio."""
    v = local.eigenvalues
    size = np.abs(v)
    return [complex(q) for q in v[(v.imag > 0.0) & (np.abs(v.real) < damping * size)]]


def _dominant(run: Trajectory, found: Sequence[tuple[Local, complex]]) -> tuple[Mode | None, float]:
    """(Fastest of the modes, number of periods), if they exist for a twentieth of the run or ten periods; else None.

    The frequency changes along a run; therefore each point counts for the time that it represents.
    """
    best: dict[float, tuple[Local, complex]] = {}
    for local, v in found:
        if local.point.t not in best or abs(v) > abs(best[local.point.t][1]):
            best[local.point.t] = (local, v)
    duration = sum(local.point.reach for local, _ in best.values())
    periods_total = sum(local.point.reach * abs(v) / (2.0 * math.pi) for local, v in best.values())
    if not best or (duration < 0.05 * run.span and periods_total < 10.0) or periods_total < 3.0:
        return None, 0.0
    return mode(run, *max(best.values(), key=lambda q: abs(q[1]))), periods_total


def _steps(method: Method, local: Local, span: float) -> float:
    step, _ = method.usable_step(local.eigenvalues[:20], span)
    return local.point.reach / step if step > 0.0 else math.inf
