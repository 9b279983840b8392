"""How far states in their quasi-static limit are ahead of themselves: an estimate from the reduced run alone.

With x' = f(x, y) and J = df/dx the state is behind its limit x0(y) by J^-1 dx0/dt, to first order in the time that its
own modes need to decay, -1 / max Re eig(J).

Source: P. Kokotovic, H. Khalil, J. O'Reilly, Singular Perturbation Methods in Control (1986), chapter 1.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from acausal.arrays import Vector
from acausal.lower.compiled import CompiledModel
from acausal.lower.symbols import Symbols
from acausal.result.result import Result

_MOST_POINTS = 400


def lag(full: CompiledModel, reduced: CompiledModel, result: Result) -> dict[str, Any] | None:
    """Largest lag of every fast state, and the slowest of their time constants [s].

    Lags are None where the reduced run does not hold what they follow from; all is None without fast states. The time
    constant is -1 when some mode grows. Relations are taken as they hold at each point of the run; an event, at which a
    state may be ahead by as much as it jumps, is no point of it.
    """
    selection = reduced.selection
    fast = [item.name for item in selection.left if item.kind == "quasi-static"] if selection is not None else []
    rows = [k for k, name in enumerate(full.states) if name in fast]
    if not rows:
        return None
    names = [*full.states, *full.algebraic]
    count = len(result.time)
    points = np.unique(np.linspace(0, count - 1, min(count, _MOST_POINTS)).astype(int))
    values = np.array([_value(result, name) for name in names])
    x, z = values[: len(full.states)], values[len(full.states) :]
    rates = _rates(result.time, x[rows])
    jacobian = _jacobian(full, rows)
    p = np.array(full.parameter_values)
    u = np.array([_value(result, name) for name in full.inputs]).reshape(len(full.inputs), count)
    # what no output depends on is not in the result: no estimate for it, nor where its value is needed
    known = np.array([name in result for name in names[: len(full.states)]])
    asked = np.array(ca.DM(jacobian.jac_sparsity(0, 1), 1.0)).any(axis=0)
    told = bool(known[rows].all() and not (asked & ~known).any())
    worst = np.zeros(len(rows))
    slowest = 0.0
    for k in points:
        t = float(result.time[k])
        m = np.array(full.all_modes(t, x[:, k], z[:, k], u[:, k], p)).ravel()
        J = np.array(jacobian(t, x[:, k], z[:, k], u[:, k], p, m))
        if not np.isfinite(J).all() or np.linalg.cond(J) > 1e14:
            continue
        worst = np.maximum(worst, np.abs(np.linalg.solve(J, rates[:, k])))
        decay = -float(np.max(np.linalg.eigvals(J).real))
        slowest = -1.0 if decay <= 0.0 or slowest < 0.0 else max(slowest, 1.0 / decay)
    ahead = {full.states[r]: float(w) if told else None for r, w in zip(rows, worst, strict=True)}
    return {"states": ahead, "slowest": slowest}


def _value(result: Result, name: str) -> Vector:
    """A trajectory; what was left out is 0, as nothing of interest depends on it."""
    return np.asarray(result[name]) if name in result else np.zeros(len(result.time))


def _rates(time: Vector, values: Vector) -> Vector:
    """Slopes of trajectories, 0 across events."""
    steps = np.diff(time)
    slopes = np.zeros_like(values)
    inside = steps > 0.0
    between = np.zeros((len(values), len(steps)))
    between[:, inside] = np.diff(values)[:, inside] / steps[inside]
    slopes[:, :-1] = between
    slopes[:, -1] = between[:, -1] if len(steps) else 0.0
    return slopes


def _jacobian(full: CompiledModel, rows: list[int]) -> Any:
    """`(t, x, z, u, p, m) -> d(rates of the fast states)/d(fast states)`, the algebraic unknowns following."""
    s = Symbols(full)
    ode, alg = full.rhs(*s.inputs)
    f = ode[rows]
    J = ca.jacobian(f, s.x)[:, rows]
    if len(full.algebraic):
        gx = ca.jacobian(alg, s.x)[:, rows]
        J = J - ca.mtimes(ca.jacobian(f, s.z), ca.solve(ca.densify(ca.jacobian(alg, s.z)), ca.densify(gx)))
    return ca.Function("fast", s.inputs, [ca.densify(J)])
