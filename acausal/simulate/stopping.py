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

from acausal.simulate.regime import Regime
from acausal.simulate.solvers.base import Piece, Segment, bounded, counted, islands

Vector = NDArray[np.float64]
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
    grid = (segment.times - segment.start).tolist()
    dae, transition = _stopping(regime)
    settings: dict[str, Any] = {
        "reltol": segment.tolerance,
        "abstol": segment.absolute,
        "max_num_steps": 10**6,
        "transition": transition,
        "event_tol": 1e-13,
        "max_events": 3,
        **bounded(segment),
    }
    if segment.step:
        settings["step_size"] = segment.step
    x0 = np.concatenate([segment.x[:n] / problem.scale_x, [0.0, 0.0]])
    with contextlib.redirect_stderr(io.StringIO()):  # CasADi says at every construction that events are experimental
        integrator = ca.integrator("stopping", plugin, dae, 0.0, grid, settings)
        found = integrator(x0=x0, z0=[], p=np.concatenate([segment.p, [segment.start], band]))
    xf = np.array(found["xf"]).reshape(n + 2, len(grid), order="F")
    if not np.isfinite(xf).all():
        raise RuntimeError("the solution is not finite")
    stopped = xf[n + 1] > 0.5
    count = int(np.argmax(stopped)) if stopped.any() else len(grid)
    counters = counted(integrator.stats())
    times = segment.times[:count]
    x = xf[:n] * problem.scale_x[:, None]
    time = segment.start + float(xf[n, -1]) if stopped.any() else None
    if time is not None and count:  # an event on an output time, to rounding
        time = max(time, float(times[-1]))
    ends = times if time is None else np.append(times, time)
    apart = islands(problem, Segment(**{**segment.__dict__, "times": ends})) if len(ends) else np.zeros((0, 0))
    rows = np.vstack([x[:, :count], apart[:, :count]])
    piece = Piece(rows, np.zeros((0, count)), counters)
    return Stop(piece, times, time, np.concatenate([x[:, -1], apart[:, -1]]), np.zeros(0))


@lru_cache(maxsize=16)
def _stopping(regime: Regime) -> tuple[Any, Any]:
    """The ODE with a stop watch and a stop flag, and the transition that sets the flag."""
    problem = regime.problem
    t, x, z, p, ode, alg, _ = problem.scaled
    compiled = problem.compiled
    watch, flag = ca.SX.sym("watch"), ca.SX.sym("flag")
    band = ca.SX.sym("band", len(regime.owners))
    full_x = ca.vertcat(x * ca.DM(problem.scale_x), ca.SX(compiled.quadratures, 1))
    guards = regime.watch(t + p[-1], full_x, z, problem.u, problem.p, p[:-1])
    state = ca.vertcat(x, watch, flag)
    rates = ca.vertcat((1 - flag) * ode, 1 - flag, 0)
    u = ca.SX.sym("u", 0)
    arguments = [t, state, z, ca.vertcat(p, band), u]
    dae = ca.Function("stopping", arguments, [rates, alg, ca.SX(0, 1), ca.densify(guards + band)], *_NAMES)
    index = ca.SX.sym("index")
    inputs = {"index": index, "t": t, "x": state, "z": z, "p": arguments[3], "u": u}
    outputs = {"post_x": ca.vertcat(x, watch, 1), "post_z": z}
    transition = ca.Function(
        "stop", [inputs[n] for n in ca.event_in()], [outputs[n] for n in ca.event_out()], ca.event_in(), ca.event_out()
    )
    return dae, transition
