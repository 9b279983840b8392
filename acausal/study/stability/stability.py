"""Stability study of a model: run, linearise, find the limits of methods, give a verdict."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from acausal.analyse.delays import PADE, refuse_delays
from acausal.errors import UsageError
from acausal.language.component import Component
from acausal.lower.compile import compile
from acausal.lower.compiled import CompiledModel
from acausal.simulate.solvers import solver_named, tolerance_fraction
from acausal.study.bench.isolated import isolated
from acausal.study.growth import Growth, growth
from acausal.study.stability.character import Character, character
from acausal.study.stability.findings import findings
from acausal.study.stability.modes.bdf import BdfEffect, bdf_effects
from acausal.study.stability.modes.limits import Limit, limits
from acausal.study.stability.modes.modes import Local, Mode, along, mode
from acausal.study.stability.report import Stability
from acausal.study.stability.structure import facts
from acausal.study.stability.trajectory import Trajectory, trajectory
from acausal.study.stability.verdict import verdict

_OSCILLATES = 0.1
_MOST_MODES = 8
# Time limit [s] of the variational equation.
_LONGEST = 20.0


def stability(
    model: Component | CompiledModel,
    *,
    points: int = 20,
    solver: str | None = None,
    step: float | None = None,
    start_time: float | None = None,
    stop_time: float | None = None,
    tolerance: float | None = None,
    parameters: Mapping[str, float] | None = None,
    inputs: Mapping[str, float] | None = None,
    check: bool = True,
) -> Stability:
    """Study which solvers are stable on a model: eigenvalues along a run, largest stable steps, a recommended solver.

    Parameters
    ----------
    points
        Number of points of the run at which to linearise.
    solver
        Solver of that run; None: that of the model unless it has fixed steps, else `rosenbrock` or `idas`.
    step
        Step [s] by which the plot scales the stability regions; None: that of the model, or one just stable.
    start_time, stop_time, tolerance, parameters, inputs
        As for `simulate`.
    check
        Whether to verify the largest stable steps by runs.

    Raises
    ------
    UsageError
        AC034 for fewer than two points.
    AcausalError
        If no solver gets beyond the start.
    """
    if points < 2:
        raise UsageError("AC034", f"{points} points are too few", help="points=20, or --points 20")
    if solver is not None and solver_named(solver).fixed_step:
        raise UsageError(
            "AC034",
            f"'{solver}' has fixed steps: its run does not show their limits",
            help="use idas, rosenbrock, cvodes or erk",
        )
    compiled = model if isinstance(model, CompiledModel) else compile(model, parameters=parameters)
    compiled = compiled.unchanging("stability")
    refuse_delays(compiled.flat, "stability", PADE)
    given = parameters if isinstance(model, CompiledModel) else None
    options = {"start_time": start_time, "stop_time": stop_time, "tolerance": tolerance, "inputs": inputs}
    run = trajectory(compiled, points, solver, given, options)
    locals, undetermined = along(run)
    ch = character(run, locals)
    error_growth = None if run.failure else _growth(run, given, options)
    structure = facts(compiled, run)
    bounds = limits(run, locals, check)
    wanted = float(run.result.stats["tolerance"])  # type: ignore[arg-type]
    bdf = _oscillations(run, locals, ch, wanted * tolerance_fraction(compiled, solver_named("idas"), wanted))
    found = findings(run, structure, error_growth, locals, undetermined)
    run_solver = str(run.result.stats["solver"])
    n, main = len(compiled.states), _main(bdf, ch)
    judged = verdict(ch, structure, bounds, main, found, n, run.span, run_solver, run.failed)
    declared_step = step or compiled.flat.experiment.step
    return Stability(
        model=compiled.name,
        solver=run_solver,
        tolerance=wanted,
        span=run.span,
        states=compiled.states[: len(compiled.states) - compiled.discretes],
        locals=locals,
        character=ch,
        growth=error_growth,
        limits=bounds,
        bdf=bdf,
        facts=structure,
        verdict=judged,
        step=declared_step or _plot_step(bounds, ch),
    )


def _growth(run: Trajectory, parameters: Mapping[str, float] | None, options: Mapping[str, Any]) -> Growth | None:
    """Growth of errors; None if computing it takes too long, as for many stiff and oscillating states."""
    return isolated(lambda: iter([growth(run.compiled, parameters, options, run.span)]), _LONGEST).value


def _oscillations(
    run: Trajectory, locals: Sequence[Local], ch: Character, tolerance: float
) -> tuple[tuple[Mode, tuple[BdfEffect, ...]], ...]:
    """Effects of BDF on the oscillating modes at the middle of the run; the mode of the verdict comes first."""
    chosen = [m for m in (ch.oscillation, ch.ringing) if m is not None]
    if locals:
        middle = locals[len(locals) // 2]
        for v in middle.eigenvalues:
            if v.imag > 0.0 and abs(v.real) < _OSCILLATES * abs(v) and len(chosen) < _MOST_MODES:
                chosen.append(mode(run, middle, complex(v)))
    distinct = {complex(m.eigenvalue): m for m in reversed(chosen)}
    kept = [m for m in chosen if distinct.get(complex(m.eigenvalue)) is m]
    return tuple((m, bdf_effects(m.eigenvalue, run.span, tolerance)) for m in kept)


def _main(bdf: Sequence[tuple[Mode, tuple[BdfEffect, ...]]], ch: Character) -> tuple[BdfEffect, ...]:
    return next((effects for m, effects in bdf if m is ch.oscillation), ())


def _plot_step(bounds: Sequence[Limit], ch: Character) -> float:
    """Step [s] for the plot: nine tenths of the stability limit of RK4."""
    rk4 = next(limit.largest_step for limit in bounds if limit.method.name == "rk4")
    if 0.0 < rk4 < math.inf:
        return 0.9 * rk4
    return 1.0 / abs(ch.fastest.eigenvalue) if ch.fastest is not None and ch.fastest.eigenvalue else 1.0
