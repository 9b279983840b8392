"""Nonlinear programs (unknowns, constraints, objective), and their solution by the solvers of CasADi."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np

from acausal.arrays import Vector
from acausal.errors import UsageError
from acausal.optimal_control.program.derivatives import derivatives
from acausal.optimal_control.program.points import Points, insert_functions

# ipopt stops there if it no longer improves an iterate that does not meet the tolerance.
_ACCEPTABLE = "Solved_To_Acceptable_Level"
# The status of a stationary point beside which no solution is found.
STATIONARY = "Stationary"
# By this fraction of their scales unknowns are displaced to see whether a stationary point is a minimum.
_BESIDE = 1e-2
_NONE: Vector = np.zeros(0)
# Limits of an unknown with a smaller relative difference are equal.
_SAME = 1e-12


@dataclass(eq=False)
class Nlp:
    """Minimize the objective over the unknowns subject to lower <= constraints <= upper; built by `radau.py`."""

    # Symbols of the unknowns, and for each its initial guess, flattened by columns.
    unknowns: list[Any] = field(default_factory=list)
    begin: list[Vector] = field(default_factory=list)
    parameters: list[Any] = field(default_factory=list)  # symbols whose values are given for each solution
    points: list[Points] = field(default_factory=list)  # functions evaluated at many instants
    constraints: list[Any] = field(default_factory=list)
    lower: list[Vector] = field(default_factory=list)
    upper: list[Vector] = field(default_factory=list)
    objective: Any = None
    weight: float = 1.0  # by which the objective is multiplied for the solver; see `objective_weight`

    def unknown(self, begin: Vector | float, rows: int = 1, columns: int = 1) -> Any:
        """Add a matrix of unknowns, shape (rows, columns); `begin`, of that shape or scalar, is the initial guess."""
        symbol = ca.MX.sym(f"x{len(self.unknowns)}", rows, columns)
        if symbol.numel():
            self.unknowns.append(symbol)
            self.begin.append(np.broadcast_to(np.asarray(begin, dtype=float), (rows, columns)).ravel(order="F"))
        return symbol

    def parameter(self, rows: int) -> Any:
        """Add a column of parameters."""
        self.parameters.append(ca.MX.sym(f"p{len(self.parameters)}", rows))
        return self.parameters[-1]

    def constrain(self, value: Any, lower: float = 0.0, upper: float = 0.0) -> range:
        """Add lower <= value <= upper for every entry; returns its rows among all constraints."""
        column = ca.vec(value)
        first = sum(map(len, self.lower))
        if column.numel():
            self.constraints.append(column)
            self.lower.append(np.full(column.numel(), lower))
            self.upper.append(np.full(column.numel(), upper))
        return range(first, first + column.numel())

    def at(self, arguments: Sequence[Any], names: Sequence[Any], n: int) -> Points:
        """Add n instants at which a function of the SX symbols `names` is evaluated.

        `arguments` are the values of these symbols, expressions of shape (rows, n).
        """
        self.points.append(Points(list(names), list(arguments), n))
        return self.points[-1]

    @property
    def x(self) -> Any:
        """All unknowns, a column."""
        return ca.veccat(*self.unknowns)

    @property
    def p(self) -> Any:
        """All parameters, a column."""
        return ca.veccat(*self.parameters) if self.parameters else ca.MX.sym("p", 0)

    @property
    def g(self) -> Any:
        """All constraints, a column."""
        return ca.vertcat(ca.MX(0, 1), *self.constraints)

    @property
    def limits(self) -> tuple[Vector, Vector]:
        """Lower and upper limits of all m constraints, each of shape (m,)."""
        return np.concatenate([_NONE, *self.lower]), np.concatenate([_NONE, *self.upper])

    def casadi_program(self, weight: Any = None) -> dict[str, Any]:
        """The program for `nlpsol`, with the functions at points inserted.

        `weight` is a symbol by which the objective is multiplied; it becomes the last parameter.
        """
        f, g = insert_functions([self.objective, self.g], self.points)
        if weight is None:
            return {"x": self.x, "p": self.p, "f": f, "g": g}
        return {"x": self.x, "p": ca.vertcat(self.p, weight), "f": weight * f, "g": g}

    def objective_weight(self, p: Vector = _NONE) -> float:
        """The factor, at least 1, by which a small objective is multiplied; `p` are the parameters, shape (np,).

        Solvers stop when no step reduces the objective by more than an absolute tolerance, and scale down large
        objectives only: the minimisation of a time of a microsecond would stop at five times the minimum. Because
        unknowns are scaled to 1, the sum of slopes is the magnitude of changes of the objective. It is also evaluated
        at a displaced point, because an objective such as the square of an input may have no slope at the guess.
        """
        f = insert_functions([self.objective], self.points)[0]
        slope = ca.Function("slope", [self.x, self.p], [ca.gradient(f, self.x)])
        begin = np.concatenate(self.begin)
        sums = [float(np.abs(np.array(slope(at, p))).sum()) for at in (begin, begin + 1.0)]
        largest = max((s for s in sums if np.isfinite(s)), default=0.0)
        return 1.0 / largest if 0.0 < largest < 1.0 else 1.0

    def values(self, expressions: Sequence[Any], x: Vector, p: Vector = _NONE) -> list[Vector]:
        """Values of expressions at unknowns x, shape (n,), and parameters p; each has the shape of its expression."""
        function = ca.Function("values", [self.x, self.p], insert_functions(expressions, self.points))
        found = function(x, p)
        return [np.array(v, dtype=float) for v in (found if isinstance(found, tuple | list) else [found])]


@dataclass(frozen=True, eq=False)
class Solution:
    """Last iterate of a solver."""

    nlp: Nlp
    # Unknowns, values of the constraints and their multipliers, shapes (n,), (m,) and (m,).
    x: Vector
    g: Vector
    duals: Vector
    objective: float
    success: bool
    status: str
    iterations: int
    p: Vector = field(default_factory=lambda: _NONE)  # values of the parameters of the program, shape (np,)
    is_curved: bool = True  # whether the last step has found the curvature of a minimum

    def values(self, *expressions: Any) -> list[Vector]:
        """Values of expressions of the unknowns, each of the shape of the expression."""
        return self.nlp.values(expressions, self.x, self.p)


def stopped_note(status: str, tolerance: float) -> tuple[str, ...]:
    """A note on a solution that ipopt takes although it misses the tolerance, or that may be no minimum."""
    if status == STATIONARY:
        return (
            "the guess leads to a stationary point, beside which the solver finds no solution: it may not be a "
            "minimum; give another guess",
        )
    if status != _ACCEPTABLE:
        return ()
    return (
        f"ipopt stops before it reaches the tolerance of {tolerance:g}, at its acceptable_tol: the objective "
        "may not be the least; give magnitudes (nominal=) of variables, or a closer guess",
    )


def displaced(x: Vector) -> Vector:
    """Unknowns beside x, shape (n,), without its symmetries: by a hundredth of their scales."""
    return x + _BESIDE * np.random.default_rng(0).standard_normal(len(x))


def solve_nlp(nlp: Nlp, solver: str, inner: Mapping[str, Any]) -> Solution:
    """Solve the program with a solver of CasADi; `inner` are options of that solver."""
    common: dict[str, Any] = {
        solver: {"obj_scaling_factor": nlp.weight, **inner} if solver == "ipopt" else dict(inner),
        "print_time": False,
        "show_eval_warnings": False,
        "error_on_fail": False,
    }
    if solver != "ipopt":
        # do not detect a stage structure: that of fatrop does not admit free durations and decided parameters
        program = nlp.casadi_program(ca.MX.sym("weight"))
        function = solver_of(solver, program, {**common, "structure_detection": "none"})
        low, high = nlp.limits
        try:
            found = function(x0=np.concatenate(nlp.begin), lbg=low, ubg=high, p=nlp.weight)
        except RuntimeError as error:  # fatrop reads its options here
            raise _refused_options(solver, inner, error) from error
        found |= {"f": found["f"] / nlp.weight}
        duals = np.array(found["lam_g"]).ravel() / nlp.weight
        return _solution(nlp, function, found, np.array(found["g"]).ravel(), duals)
    g, bounds = nlp.g, _bounds(nlp)
    kept = np.setdiff1d(np.arange(g.numel()), bounds.rows)
    low, high = nlp.limits
    own = derivatives(nlp.x, nlp.objective, g[kept.tolist()], nlp.points)
    f, rows = insert_functions([nlp.objective, g[kept.tolist()]], nlp.points)
    more: dict[str, Any] = {"grad_f": own.gradient, "jac_g": own.jacobian, "hess_lag": own.hessian, "no_nlp_grad": True}
    more |= {"calc_lam_p": False}
    program = {"x": nlp.x, "f": f, "g": rows}
    function = solver_of("ipopt", program, {**common, **more})
    found = function(x0=np.concatenate(nlp.begin), lbx=bounds.low, ubx=bounds.high, lbg=low[kept], ubg=high[kept])
    x, inner_duals = np.array(found["x"]).ravel(), np.array(found["lam_g"]).ravel()
    values, duals = np.empty(g.numel()), np.zeros(g.numel())
    values[kept], duals[kept] = np.array(found["g"]).ravel(), inner_duals
    values[bounds.rows] = bounds.slopes * x[bounds.columns] + bounds.offsets
    across = np.array(found["lam_x"]).ravel()
    # ipopt eliminates fixed unknowns; their multipliers follow from stationarity
    fixed = np.flatnonzero(bounds.low == bounds.high)
    if len(fixed):
        slope = np.array(own.gradient(x, [])[1]).ravel() + np.array(own.jacobian(x, [])[1].T @ inner_duals).ravel()
        across[fixed] = -slope[fixed]
    duals[bounds.rows] = bounds.duals(across)
    return _solution(nlp, function, found, values, duals)


def solver_of(name: str, program: Mapping[str, Any], options: Mapping[str, Any]) -> Any:
    """A solver of CasADi; AC053 for options that it does not have."""
    try:
        return ca.nlpsol("program", name, dict(program), dict(options))
    except RuntimeError as error:
        raise _refused_options(name, options[name], error) from error


def _refused_options(name: str, options: Mapping[str, Any], error: RuntimeError) -> UsageError:
    return UsageError(
        "AC053",
        f"{name} does not accept these options: {dict(options)}",
        evidence=str(error).strip().splitlines()[-1:],
        help='options={"max_iter": 1000}, with the names and types in its manual',
    )


def _solution(nlp: Nlp, function: Any, found: Any, values: Vector, duals: Vector) -> Solution:
    stats = function.stats()
    status, iterations = stats.get("return_status", ""), int(stats.get("iter_count", 0))
    return Solution(
        nlp,
        np.array(found["x"]).ravel(),
        values,
        duals,
        float(found["f"]),
        bool(stats.get("success", False)),
        status if isinstance(status, str) else f"no solution after {iterations} iterations",  # fatrop has numbers
        iterations,
        is_curved=is_curved(stats),
    )


def is_curved(stats: Mapping[str, Any]) -> bool:
    """Whether a solver says that it has made a step for which it did not have to add curvature; fatrop does not say.

    A guess may be stationary without being a minimum, by symmetry, and a solver then stops there.
    """
    added = stats.get("iterations", {}).get("regularization_size", [1.0])
    return bool(stats.get("iter_count", 0)) and not added[-1] > 0.0


@dataclass(frozen=True, eq=False)
class _Bounds:
    """Constraints slope * x[column] + offset on one unknown each, and the simple bounds that they imply.

    `by_low` and `by_high` are, for each unknown, the index among `rows` of the constraint that bounds it, or -1.
    """

    rows: Any
    columns: Any
    slopes: Vector
    offsets: Vector
    low: Vector
    high: Vector
    by_low: Any
    by_high: Any

    def duals(self, across: Vector) -> Vector:
        """Multipliers of the constraints, shape (rows,), from those of the simple bounds, shape (n,)."""
        found = np.zeros(len(self.rows))
        for owner, side in ((self.by_high, across > 0.0), (self.by_low, across < 0.0)):
            held = np.flatnonzero(side & (owner >= 0))
            found[owner[held]] = across[held] / self.slopes[owner[held]]
        return found


def _bounds(nlp: Nlp) -> _Bounds:
    """The constraints on single unknowns as simple bounds, except contradictory ones, which the solver reports."""
    rows, columns, slopes, offsets = _bound_rows(nlp)
    n = nlp.x.numel()
    lower, upper = nlp.limits
    ends = np.sort([(lower[rows] - offsets) / slopes, (upper[rows] - offsets) / slopes], axis=0)
    low, high = np.full(n, -np.inf), np.full(n, np.inf)
    np.maximum.at(low, columns, ends[0])
    np.minimum.at(high, columns, ends[1])
    same = np.isfinite(low) & (np.abs(high - low) <= _SAME * np.maximum(np.abs(low), 1.0))
    high[same] = low[same]
    fits = (low <= high)[columns]
    rows, columns, slopes, offsets, ends = rows[fits], columns[fits], slopes[fits], offsets[fits], ends[:, fits]
    empty = low > high
    low[empty], high[empty] = -np.inf, np.inf
    owners = np.full((2, n), -1)
    for side, limits in enumerate((low, high)):
        with np.errstate(invalid="ignore"):  # inf - inf without a limit
            near = np.flatnonzero(np.abs(ends[side] - limits[columns]) <= _SAME * np.maximum(np.abs(ends[side]), 1.0))
        owners[side, columns[near]] = near
    return _Bounds(rows, columns, slopes, offsets, low, high, owners[0], owners[1])


def _bound_rows(nlp: Nlp) -> tuple[Any, Any, Vector, Vector]:
    """(Rows, columns, slopes, offsets) of the constraints slope * x[column] + offset on one unknown each."""
    x, y = nlp.x, ca.veccat(*(s for one in nlp.points for s in one.symbols))
    first = np.cumsum([0, *map(len, nlp.lower)])
    # constraints on results at points depend on more than one unknown
    own = [k for k, value in enumerate(nlp.constraints) if not (y.numel() and ca.depends_on(value, y))]
    g = ca.vertcat(*(nlp.constraints[k] for k in own)) if own else ca.MX(0, 1)
    among = np.concatenate([np.zeros(0, dtype=int), *(np.arange(first[k], first[k + 1]) for k in own)])
    alone = np.bincount(np.array(ca.jacobian_sparsity(g, x).row(), dtype=int), minlength=g.numel()) == 1
    rows = np.flatnonzero(alone)
    if len(rows):
        rows = rows[~np.array(ca.which_depends(g[rows.tolist()], x, 2, True), dtype=bool)]
    of_rows = ca.Function("simple", [x], [ca.jacobian(g[rows.tolist()], x), g[rows.tolist()]])
    slope, offset = of_rows(np.zeros(x.numel()))
    places, columns = (np.array(v, dtype=int) for v in slope.sparsity().get_triplet())
    values = np.array(slope.nonzeros(), dtype=float)
    places, columns, values = places[values != 0.0], columns[values != 0.0], values[values != 0.0]
    return among[rows[places]], columns, values, np.array(offset).ravel()[places]
