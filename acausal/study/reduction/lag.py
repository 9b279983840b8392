"""Lag of states that a reduction replaces by their quasi-static limit, estimated from the reduced run alone.

With x' = f(x, y) and J = df/dx, the state lags behind its limit x0(y) by J^-1 dx0/dt, to first order in the slowest
time constant of its modes, -1 / max Re eig(J).

Source: P. Kokotovic, H. Khalil, J. O'Reilly, Singular Perturbation Methods in Control (1986), chapter 1.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from acausal.arrays import Vector
from acausal.lower.build import Symbols
from acausal.lower.compiled import CompiledModel
from acausal.result.result import Result

_MOST_POINTS = 400


def lag(full: CompiledModel, reduced: CompiledModel, result: Result) -> dict[str, Any] | None:
    """Largest lag of every fast state by name, and the slowest of their time constants [s]; None without fast states.

    Lags are None if the reduced run lacks a variable needed to compute them. The time constant is -1 if a mode grows.
    Modes are evaluated at up to 400 points of the run. The lag after an event, as large as the jump of the limit, is
    not included.
    """
    selection = reduced.selection
    fast = [item.name for item in selection.dropped if item.kind == "quasi-static"] if selection is not None else []
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
    # variables on which no output depends are not in the reduced result
    present = np.array([name in result for name in names[: len(full.states)]])
    needed = np.array(ca.DM(jacobian.jac_sparsity(0, 1), 1.0)).any(axis=0)
    is_computable = bool(present[rows].all() and not (needed & ~present).any())
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
    lags = {full.states[r]: float(w) if is_computable else None for r, w in zip(rows, worst, strict=True)}
    return {"states": lags, "slowest": slowest}


def _value(result: Result, name: str) -> Vector:
    """A trajectory, shape (n,); zero for variables that were left out because no output depends on them."""
    return np.asarray(result[name]) if name in result else np.zeros(len(result.time))


def _rates(time: Vector, values: Vector) -> Vector:
    """Forward difference quotients of trajectories, shape (rows, n); 0 across events."""
    steps = np.diff(time)
    slopes = np.zeros_like(values)
    inside = steps > 0.0
    between = np.zeros((len(values), len(steps)))
    between[:, inside] = np.diff(values)[:, inside] / steps[inside]
    slopes[:, :-1] = between
    slopes[:, -1] = between[:, -1] if len(steps) else 0.0
    return slopes


def _jacobian(full: CompiledModel, rows: list[int]) -> Any:
    """`(t, x, z, u, p, m) -> d(rates of fast states)/d(fast states)`, with algebraic variables eliminated."""
    s = Symbols(full)
    ode, alg = full.rhs(*s.inputs)
    f = ode[rows]
    J = ca.jacobian(f, s.x)[:, rows]
    if len(full.algebraic):
        gx = ca.jacobian(alg, s.x)[:, rows]
        J = J - ca.mtimes(ca.jacobian(f, s.z), ca.solve(ca.densify(ca.jacobian(alg, s.z)), ca.densify(gx)))
    return ca.Function("fast", s.inputs, [ca.densify(J)])
