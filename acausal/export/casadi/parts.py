"""Functions of a `CasadiModel` derived from its dae, and functions with some arguments fixed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from acausal.arrays import Vector
from acausal.export.step.defect import bends, defect
from acausal.export.step.stable import differences, unstable

# Options for variables divided by their nominal magnitude, and residuals divided by `sizes` (see `newton`).
NEWTON = {"abstol": 1e-14, "abstolStep": 1e-11, "max_iter": 200, "error_on_fail": True}


def ode_of(dae: Any, z0: Vector, nominal: Vector, start: Sequence[Any]) -> Any:
    """Function `(t, x, u, p) -> (xdot, y)`, which solves for z by Newton's method.

    `z0`, shape (nz,), is the solution at `start = (t, x, u, p)`, and `nominal`, shape (nz,), the magnitudes of z.
    """
    nz = dae.numel_in("z")
    names, results = ["t", "x", "u", "p"], ["xdot", "y"]
    kind: Any = ca.MX if nz else ca.SX
    t, x, u, p = (kind.sym(n, dae.size1_in(n)) for n in names)
    if not nz:
        ode, _, y = dae(t, x, ca.SX(0, 1), u, p)
        return ca.Function("ode", [t, x, u, p], [ode, y], names, results)
    scale = ca.DM(nominal)
    z, q = ca.SX.sym("z", nz), ca.SX.sym("q", 1 + x.numel() + u.numel() + p.numel())
    parts = ca.vertsplit(q, np.cumsum([0, 1, x.numel(), u.numel(), p.numel()]).tolist())
    residual = ca.Function("residual", [z, q], [dae(parts[0], parts[1], z * scale, *parts[2:])[1]], ["z", "q"], ["r"])
    root = newton("algebraic", residual, ca.DM(z0) / scale, ca.vertcat(*map(ca.DM, start)))
    solved = root(ca.DM(z0) / scale, ca.vertcat(t, x, u, p)) * scale
    ode, _, y = dae(t, x, solved, u, p)
    return ca.Function("ode", [t, x, u, p], [ode, y], names, results)


def newton(name: str, residual: Any, at: Any, known: Any) -> Any:
    """Rootfinder of `(z, q) -> r` that stops on a small step, or on a residual that is small relative to its terms.

    Residuals have different units, and one in picocoulombs is small everywhere. Therefore a residual whose terms are
    small at z = `at` and q = `known` is divided by a power of two (exactly representable).
    """
    slope = residual.factory("slope", ["z", "q"], ["jac:r:z"])(at, known)
    magnitude = np.array(ca.fabs(slope) @ (1 + ca.fabs(at))).ravel()
    is_small = np.isfinite(magnitude) & (magnitude > 0.0) & (magnitude < 1.0)
    sizes = np.where(is_small, 2.0 ** np.floor(np.log2(np.where(is_small, magnitude, 1.0))), 1.0)
    z, q = residual.sx_in()
    sized = ca.Function("residual", [z, q], [residual(z, q) / ca.DM(sizes)], ["z", "q"], ["r"])
    return ca.rootfinder(name, "newton", sized, NEWTON)


def implicit_of(dae: Any) -> Any:
    """Function `(t, xdot, x, z, u, p) -> r`: the fully implicit DAE."""
    t, x, z, u, p = dae.sx_in()
    xdot = ca.SX.sym("xdot", x.numel())
    ode, alg, _ = dae(t, x, z, u, p)
    names = ["t", "xdot", "x", "z", "u", "p"]
    return ca.Function("implicit", [t, xdot, x, z, u, p], [ca.vertcat(xdot - ode, alg)], names, ["r"])


def outputs_of(dae: Any) -> Any:
    """Function `(t, x, z, u, p) -> y`."""
    arguments = dae.sx_in()
    return ca.Function("outputs", arguments, [dae(*arguments)[2]], dae.name_in(), ["y"])


_OF_STEP = ["t", "x", "u", "p", "h"]


def step_of(ode: Any) -> Any:
    """Function `(t, x, u, p, h) -> (x_next, y)`: one step of the classical Runge-Kutta method."""
    t, _, u, p, h = given = _arguments_of_step(ode)
    after, _ = _classical(ode, *given)
    return ca.Function("step", given, [after, ode(t + h, after, u, p)[1]], _OF_STEP, ["x_next", "y"])


def _classical(ode: Any, t: Any, x: Any, u: Any, p: Any, h: Any) -> tuple[Any, Any]:
    """(x at the end, rates at the start) of a step of the classical Runge-Kutta method."""
    k1 = ode(t, x, u, p)[0]
    k2 = ode(t + h / 2, x + h / 2 * k1, u, p)[0]
    k3 = ode(t + h / 2, x + h / 2 * k2, u, p)[0]
    k4 = ode(t + h, x + h * k3, u, p)[0]
    return x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4), k1


def step_error_of(ode: Any, nominal: Sequence[float]) -> Any:
    """Function `(t, x, u, p, h) -> error`: error estimate of `step_of`, see `acausal.export.step.defect`.

    `nominal`: nominal magnitudes of the states, shape (nx,).
    """
    t, x, u, p, h = given = _arguments_of_step(ode)
    after, first = _classical(ode, *given)
    bend = bends(h, x, first, after, ode(t + h, after, u, p)[0])

    def defect_at(s: Any, point: Any, slope: Any) -> Any:
        return slope - h * ode(t + s * h, point, u, p)[0]

    error = defect(x, after, bend, defect_at, ca.DM(nominal))
    return ca.Function("step_error", given, [error], _OF_STEP, ["error"])


def too_large_of(ode: Any, nominal: Sequence[float]) -> Any:
    """Function `(t, x, u, p, h) -> too_large`: 1 where `step_of` is unstable at this h; `nominal` has shape (nx,)."""
    t, x, u, p, h = given = _arguments_of_step(ode)

    def halfway(x: Any) -> Any:
        return ode(t + h / 2, x, u, p)[0]

    first = x + h / 2 * ode(t, x, u, p)[0]
    rates = halfway(first)
    found = differences(halfway, h / 2, first, rates, x + h / 2 * rates)
    return ca.Function("too_large", given, [unstable(4, h, x, ca.DM(nominal), found)], _OF_STEP, ["too_large"])


def _arguments_of_step(ode: Any) -> list[Any]:
    return [*(ca.MX.sym(n, ode.size1_in(n)) for n in _OF_STEP[:-1]), ca.MX.sym("h")]


def depends_on_time(functions: Sequence[Any]) -> bool:
    """Whether an output of any of the functions depends on its argument t."""
    timed = [f for f in functions if "t" in f.name_in()]
    return any(f.jac_sparsity(k, f.index_in("t")).nnz() for f in timed for k in range(f.n_out()))


def with_fixed_arguments(
    function: Any, time: float | None, chosen: Sequence[int] | None, values: Vector, refusal: Any = None
) -> Any:
    """The function with t fixed to `time` [s] and all but the `chosen` parameters fixed to `values`, shape (np,).

    `time` or `chosen` of None keeps t or all of p as arguments. `refusal(p)`, 0 or nan, is added to all results.
    """
    names = [function.name_in(k) for k in range(function.n_in())]
    refuses = refusal is not None and "p" in names
    if not (refuses or (time is not None and "t" in names) or (chosen is not None and "p" in names)):
        return function
    kind: Any = ca.SX if function.is_a("SXFunction") else ca.MX
    outer, inner, remaining_names = [], [], []
    for k, name in enumerate(names):
        if name == "t" and time is not None:
            inner.append(kind(time))
            continue
        size = len(chosen) if name == "p" and chosen is not None else function.sparsity_in(k)
        symbol = kind.sym(name, size)
        outer.append(symbol)
        remaining_names.append(name)
        if name == "p" and chosen is not None:
            symbol = kind(ca.DM(values))
            if chosen:
                symbol[list(chosen)] = outer[-1]
        inner.append(symbol)
    found = function.call(inner, True, False)
    if refusal is not None and refuses:
        found = spoilt(found, refusal(inner[names.index("p")]))
    results = [function.name_out(k) for k in range(function.n_out())]
    return ca.Function(function.name(), outer, found, remaining_names, results)


def spoilt(results: Sequence[Any], refused: Any) -> list[Any]:
    """The results with `refused`, 0 or nan, added to every entry that is not always zero."""
    return [type(v)(v.sparsity(), v.nz[:] + refused) if v.nnz() else v for v in results]
