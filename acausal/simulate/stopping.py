"""Integration up to the first event, by CasADi's one-step methods.

They locate zero crossings on their dense output, but nothing iterates after a jump and of two crossings within a
tolerance only one fires. So the transition only stops the clock: a state `stopped` becomes 1, all rates are zero from
then on, a second state holds the time that has passed. What happens at the event is decided outside, where the modes
are iterated to a fixed point.
"""

from __future__ import annotations

import contextlib
import io
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from acausal.simulate.native.equations import parametric
from acausal.simulate.native.flight import FlightProgram
from acausal.simulate.native.policy import Library, StoppingEquations
from acausal.simulate.regime import Regime
from acausal.simulate.solvers.base import Piece, Segment, beginning, bounded, counted, islands

Vector = NDArray[np.float64]
# To make an interpreted integrator for one stretch takes as long as so many evaluations (2 to 15 ms).
_MAKING = 3000.0
_NAMES = ["t", "x", "z", "p", "u"], ["ode", "alg", "quad", "zero"]


@dataclass(frozen=True, eq=False)
class Stop:
    """Rows before the event (or all), and where it stopped; `time` is None when nothing fired."""

    piece: Piece
    times: Vector
    time: float | None
    x: Vector
    z: Vector


def integrate_to_event(regime: Regime, segment: Segment, band: Vector, plugin: str) -> Stop:
    """Integrate one segment of an ODE until a guard is reached.

    Parameters
    ----------
    band
        How far beyond its guard each one may go: the noise for those that rest there, else 0.
    plugin
        "rosenbrock" or "erk".

    Raises
    ------
    RuntimeError
        When the solver cannot go on.
    """
    problem = regime.problem
    n = problem.n_dynamic
    grid = segment.times - segment.start
    x0 = np.concatenate([segment.x[:n] / problem.scale_x, [0.0, 0.0]])
    numbers = np.concatenate([problem.numbers(segment.p, segment.x, segment.start), band])
    library = compiled_program(regime, segment, plugin)
    if library is not None:
        p = np.concatenate([regime.constants(library), numbers])
        rows, _, stats = library.run(
            x0,
            np.zeros(0),
            p,
            grid,
            segment.tolerance,
            segment.absolute,
            segment.step or 0.0,
            0.0 if segment.step else segment.first,
        )
        xf = rows.T
    else:
        settings = {**_settings(segment), **beginning(segment), "max_num_steps": segment.most_steps}
        xf, stats = _interpreted(regime, plugin, settings, grid, x0, numbers)
        problem.native.interpreted(f"{plugin}, events", stats.get("n_rhs", 0.0) + _MAKING)
    if not np.isfinite(xf).all():
        raise RuntimeError("the solution is not finite")
    stopped = xf[n + 1] > 0.5
    count = int(np.argmax(stopped)) if stopped.any() else len(grid)
    counters = counted(stats)
    times = segment.times[:count]
    x = xf[:n] * problem.scale_x[:, None]
    time = segment.start + float(xf[n, -1]) if stopped.any() else None
    if time is not None and count:  # an event on an output time, to rounding
        time = max(time, float(times[-1]))
    ends = times if time is None else np.append(times, time)
    apart = islands(problem, Segment(**{**segment.__dict__, "times": ends})) if len(ends) else np.zeros((0, 0))
    discrete = segment.x[len(segment.x) - problem.compiled.discretes :]
    rows = np.vstack([x[:, :count], apart[:, :count], np.tile(discrete[:, None], (1, count))])
    piece = Piece(rows, np.zeros((0, count)), counters)
    return Stop(piece, times, time, np.concatenate([x[:, -1], apart[:, -1], discrete]), np.zeros(0))


def compiled_program(regime: Regime, segment: Segment, plugin: str) -> Library[FlightProgram] | None:
    """The integrator of a regime as compiled C, where there is one or it pays to make one."""
    problem = regime.problem

    def instructions() -> int:
        functions = regime.watch, regime.rates.function, problem.compiled.events.reactions
        return sum(int(f.n_instructions()) for f in functions)

    return problem.native.stopping(
        plugin, _settings(segment), lambda: stopping_equations(regime), problem.n_dynamic + 2, instructions
    )


def _settings(segment: Segment) -> dict[str, Any]:
    settings: dict[str, Any] = {
        "reltol": segment.tolerance,
        "abstol": segment.absolute,
        "max_num_steps": 10**6,
        "event_tol": 1e-13,
        "max_events": 3,
        **bounded(segment),
    }
    return {**settings, "step_size": segment.step} if segment.step else settings


def _interpreted(
    regime: Regime, plugin: str, settings: dict[str, Any], grid: Vector, x0: Vector, numbers: Vector
) -> tuple[Vector, dict[str, Any]]:
    """States on the grid, shape (n + 2, len(grid)), and statistics, by an integrator made for this grid."""
    dae, transition = _stopping(regime)
    with contextlib.redirect_stderr(io.StringIO()):  # CasADi says at every construction that events are experimental
        integrator = ca.integrator("stopping", plugin, dae, 0.0, grid.tolist(), {**settings, "transition": transition})
        found = integrator(x0=x0, z0=[], p=numbers)
    return np.array(found["xf"]).reshape(len(x0), len(grid), order="F"), integrator.stats()


@lru_cache(maxsize=16)
def _stopping(regime: Regime) -> tuple[Any, Any]:
    """The ODE with a stop watch and a stop flag, and the transition that sets the flag; parameters are numbers."""
    problem = regime.problem
    t, x, z, p, ode, _ = problem.numbered.scaled
    nq, nm, nd = problem.compiled.quadratures, problem.compiled.n_modes, problem.compiled.discretes
    m, d, shift = ca.vertsplit(p, [0, nm, nm + nd, nm + nd + 1])
    full_x = ca.vertcat(x * ca.DM(problem.scale_x), ca.SX(nq, 1), d)
    guards = regime.watch(t + shift, full_x, z, problem.u, problem.p, m)
    return _stopped(t, x, z, ca.SX(0, 1), p, ode, guards)


def stopping_equations(regime: Regime) -> StoppingEquations:
    """The same with free parameters, as compiled code needs it.

    The parameters of the DAE are `[c, m, d, shift, band]`; see `native/equations.py`.
    """
    compiled = regime.compiled
    n, nq, nm = compiled.n_dynamic, compiled.quadratures, compiled.n_modes
    scale = ca.DM(regime.problem.scale_x)
    t, x, z = ca.SX.sym("t"), ca.SX.sym("x", n), ca.SX.sym("z", 0)
    p, u = ca.SX.sym("p", len(compiled.parameters)), ca.SX.sym("u", len(compiled.inputs))
    numbers = ca.SX.sym("numbers", nm + compiled.discretes + 1)
    m, d, shift = ca.vertsplit(numbers, [0, nm, nm + compiled.discretes, nm + compiled.discretes + 1])
    arguments = (t + shift, ca.vertcat(x * scale, ca.SX(nq, 1), d), z, u, p, m)
    ode, guards = ca.densify(compiled.rhs(*arguments)[0])[:n] / scale, ca.densify(regime.watch(*arguments))
    (ode, guards), symbols, constants = parametric([ode, guards], p, u)
    dae, transition = _stopped(t, x, z, symbols, numbers, ode, guards)
    events = regime.watch, regime.rates.function, compiled.events.reactions
    return StoppingEquations(dae, transition, constants, events)


def _stopped(t: Any, x: Any, z: Any, constants: Any, numbers: Any, ode: Any, guards: Any) -> tuple[Any, Any]:
    watch, flag, band = ca.SX.sym("watch"), ca.SX.sym("flag"), ca.SX.sym("band", guards.numel())
    state = ca.vertcat(x, watch, flag)
    rates = ca.vertcat((1 - flag) * ode, 1 - flag, 0)
    none, u = ca.SX(0, 1), ca.SX.sym("u", 0)
    p = ca.vertcat(constants, numbers, band)
    dae = ca.Function("dae", [t, state, z, p, u], [rates, none, none, ca.densify(guards + band)], *_NAMES)
    index = ca.SX.sym("index")
    inputs = {"index": index, "t": t, "x": state, "z": z, "p": p, "u": u}
    outputs = {"post_x": ca.vertcat(x, watch, 1), "post_z": z}
    transition = ca.Function(
        "stop", [inputs[n] for n in ca.event_in()], [outputs[n] for n in ca.event_out()], ca.event_in(), ca.event_out()
    )
    return dae, transition
