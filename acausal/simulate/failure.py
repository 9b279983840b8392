"""Explains why a run stopped early: at which time, where in the model, and for which reason.

One reason is an equation that determines a force on one side only, such as that of a string that becomes taut during a
run. `minimum(force, l - r) == 0` says force = 0 while the string is slack. From l = r on it is a condition on the
positions, which are states, and nothing determines the force: a constraint that comes and goes, but without a branch
from which the structure would show it (AC213). Solvers stop there with an infinite force or without convergence.

Such an equation is recognised by evaluation at large positive and large negative values of the unknown. On one side its
derivative with respect to the unknown vanishes, on the other it does not, and on the first side the rest of the
equation is a condition on the states that is satisfied at this point. Smooth forms are recognised too, such as that of
A. Fischer (A special Newton-type optimization method, Optimization 24 (1992) 269-284).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from acausal.arrays import Vector
from acausal.diagnose.words import component_of, line, lines, listed, made_at, places
from acausal.errors import IntegrationError, Span
from acausal.flatten.flat import span_of
from acausal.lower.build import Symbols
from acausal.lower.compiled import CompiledModel
from acausal.simulate.equations.problem import Problem
from acausal.simulate.record.project import constraints
from acausal.simulate.solvers.segment import Segment
from acausal.simulate.start.finite import UNDEFINED, Undefined, first_undefined

_ELSEWHERE = "look at these variables around that time; try another solver (--solver {other}) or tolerance"
# For a keyword in the solver's message: code, fact, cause and remedy.
_BY_KEYWORD: tuple[tuple[str, str, str, str, str], ...] = (
    (
        "TOO_MUCH_WORK",
        "AC401",
        "needs more steps than allowed, because it makes hardly any progress",
        "a fast motion that never ends, a switch that chatters, or a tolerance below the rounding errors of the model",
        "`acausal stability MODEL` shows which mode is fast and which solver suits it (mostly --solver {other}); "
        "or try a looser --tolerance",
    ),
    (
        "CONV_FAIL",
        "AC402",
        "Newton's method of the solver does not converge",
        "the equations have no solution just after this time, or jump to another one: a function outside its domain, a "
        "mechanism at full stretch, a jump that is not stated as a relation",
        "look at these variables around that time; state a jump by where(...) or when(...), which are located; try "
        "--solver {other}",
    ),
    (
        "ERR_FAIL",
        "AC403",
        "no step is small enough for the tolerance",
        "a value goes to infinity, or jumps without a relation that states it, as in a table or an external function",
        "look at these variables around that time; state a jump by where(...) or when(...), which are located; try a "
        "looser --tolerance",
    ),
    (
        "not finite",
        "AC404",
        "the solution is not finite",
        "a value overflows, or an equation gives nan",
        _ELSEWHERE,
    ),
)
_OTHER = (
    "AC400",
    "the solver gave up",
    "a jump or a singular position just after this time, or a tolerance too tight",
    _ELSEWHERE,
)
_AHEAD_FRACTIONS = 10.0 ** np.arange(-12.0, -1.0)  # fractions of the segment after the last point that are examined
_DOUBLING_TIME = 1e-4  # a state that doubles within this fraction of the elapsed time grows without bound
_SINGULAR = 1e-2  # equations are singular if their smallest singular value falls to this fraction of the usual one
_SAMPLES = 7  # random points around, at which the usual value is computed
_MOST_ALGEBRAIC = 300
_DEPENDENT = 1e-3  # constraints count as dependent if the smallest singular value of their unit gradients is below this
# For forces that are determined on one side only:
_MOST_UNKNOWNS = 500  # larger models are not examined
_LARGE = 1e6  # a large value of an unknown, relative to its nominal magnitude and its value
_FLAT = 1e-6  # a derivative below this fraction of that on the other side counts as zero
_SATISFIED = 1e-2  # residual of a condition on the states that counts as satisfied, relative to the terms in it


@dataclass(frozen=True)
class _Finding:
    """A recognised cause: code and fact, which replace those of the solver, with evidence, location and advice."""

    code: str
    fact: str
    where: tuple[Span, ...]
    evidence: tuple[str, ...]
    cause: str
    help: str


# where a run fails values overflow, and so do expressions of them here
@np.errstate(over="ignore", invalid="ignore")
def integration_error(problem: Problem, solver: str, reached: Segment, text: str) -> IntegrationError:
    """Build the error that says what went wrong, at which time, and which variables changed fastest.

    `reached` is the segment from the last point that was reached, `text` the message of the solver.
    """
    compiled = problem.compiled
    at = (reached.x, reached.z, problem.u, problem.p, reached.p)
    ode = np.array(compiled.rhs(reached.start, *at)[0]).ravel()
    code, fact, cause, remedy = next((rest for keyword, *rest in _BY_KEYWORD if keyword in text), _OTHER)
    finding = (
        _constraining(problem, reached)
        or _undefined(problem, reached, ode)
        or _stretched(problem, reached, ode)
        or _unbounded(compiled, reached, ode)
        or _singular(problem, reached)
        or _Finding(code, fact, (), (), cause, remedy)
    )
    fastest = np.argsort(-np.abs(np.nan_to_num(ode / compiled.nominal_x, nan=np.inf)))[:3].tolist()
    moving = [f"der({compiled.states[k]}) = {ode[k]:.4g}   {compiled.states[k]} = {reached.x[k]:.6g}" for k in fastest]
    where = finding.where or (_declared_at(compiled, compiled.states[fastest[0]]) if fastest else ())
    return IntegrationError(
        finding.code,
        f"{compiled.name}: {solver} stopped at t = {reached.start:.9g} s: {finding.fact}",
        where=where,
        evidence=[*finding.evidence, *(["fastest there:", *(f"  {row}" for row in moving)] if moving else [])],
        cause=finding.cause,
        help=finding.help.replace("{other}", "rosenbrock" if solver != "rosenbrock" else "idas"),
    )


def _declared_at(compiled: CompiledModel, variable: str) -> tuple[Span, ...]:
    return made_at(compiled.flat, component_of(compiled.flat, variable))


def is_constraining(problem: Problem, reached: Segment) -> bool:
    """Whether an equation for a force becomes a constraint on the states at the start of the segment."""
    return _constraining(problem, reached) is not None


def _constraining(problem: Problem, reached: Segment) -> _Finding | None:
    """An equation for a force that becomes a constraint on the states."""
    compiled = problem.compiled
    one_sided = _one_sided(compiled, reached.start, reached.x, reached.z, problem.u, problem.p, reached.p)
    if one_sided is None:
        return None
    equation = compiled.flat.equations[one_sided.equation]
    return _Finding(
        "AC402",
        f"nothing determines {one_sided.unknown} from there on: its equation holds {listed(one_sided.states, 4)} "
        "instead",
        span_of(equation),
        (line(compiled.flat, equation).strip(),),
        "a constraint that comes and goes, like that of a string that becomes taut: states would vanish, and "
        "velocities jump",
        "hold accelerations, where(taut, der(away), force) == 0, and let the `when` that sets `taut` make velocities "
        "jump, reset(away, 0, by=pull); or replace the constraint by a force, a stiff spring and damper",
    )


def _undefined(problem: Problem, reached: Segment, ode: Vector) -> _Finding | None:
    """An equation that has no finite value at that point, or just after it along the rates of the states."""
    span = reached.times[-1] - reached.start if len(reached.times) else 0.0
    for ahead in (0.0, *(span * _AHEAD_FRACTIONS).tolist()):
        x = reached.x + ahead * np.nan_to_num(ode, posinf=0.0, neginf=0.0)
        point = (reached.start + ahead, x, reached.z, problem.u, problem.p, reached.p)
        undefined = first_undefined(problem.compiled, *point)
        if undefined is not None:
            return _of_undefined(problem.compiled, undefined, ahead)
    return None


def _of_undefined(compiled: CompiledModel, undefined: Undefined, ahead: float) -> _Finding:
    return _Finding(
        "AC404",
        f"{undefined.variable} has no finite value {'just after it' if ahead else 'there'}",
        span_of(undefined.equation) or _declared_at(compiled, undefined.variable),
        (
            line(compiled.flat, undefined.equation).strip(),
            *([f"with {', '.join(undefined.inside[:6])}"] if undefined.inside else []),
        ),
        undefined.reason or UNDEFINED,
        "state the equation so that it is defined there too, or end the run earlier",
    )


def _stretched(problem: Problem, reached: Segment, ode: Vector) -> _Finding | None:
    """Stabilised constraints whose gradients become linearly dependent while a constrained state diverges."""
    compiled = problem.compiled
    structure = compiled.solution.structure
    diverging = (np.abs(reached.x) > 1e3 * compiled.nominal_x) & (reached.x * ode > 0.0)
    if not structure.invariants or not diverging.any():
        return None
    point = np.array([reached.start]), reached.x[:, None], reached.z[:, None]
    gradients = constraints(compiled, *point, problem.u, problem.p, reached.p)[1][0] * compiled.nominal_x
    norms = np.linalg.norm(gradients, axis=1)
    if not (np.isfinite(gradients).all() and norms.all() and gradients[:, diverging].any()):
        return None
    left, sizes, _ = np.linalg.svd(gradients / norms[:, None])
    if len(gradients) > gradients.shape[1] or sizes[-1] > _DEPENDENT:
        return None
    node = structure.invariants[int(np.argmax(np.abs(left[:, -1])))][1]
    condition = next(c for c in (*compiled.start.conditions, *compiled.start.surplus) if c.node == node)
    text = (
        condition.text.removeprefix("d/dt (").removesuffix(")") if condition.text.startswith("d/dt") else condition.text
    )
    equations = [e for e in compiled.flat.equations if compiled.flat.text(e) == text]
    names = [compiled.states[k] for k in np.flatnonzero(diverging).tolist()]
    return _Finding(
        "AC402",
        f"the constraint `{text}` can hardly be followed: {listed(names, 3)} would have to be infinite",
        tuple(places(compiled.flat, equations[:1])) or condition.where,
        (),
        "a mechanism is fully stretched out or folded up there, while its drive goes on",
        "limit the travel of the drive, or change the lengths of the mechanism",
    )


def _unbounded(compiled: CompiledModel, reached: Segment, ode: Vector) -> _Finding | None:
    """A state far above its nominal magnitude that doubles within a ten-thousandth of the elapsed time."""
    elapsed = abs(reached.start - compiled.flat.experiment.start_time) or 1.0
    large = np.abs(reached.x) > 1e3 * compiled.nominal_x
    for k in np.flatnonzero(large & (reached.x * ode > 0.0)).tolist():
        doubling = float(reached.x[k] / ode[k])
        if doubling < _DOUBLING_TIME * elapsed:
            name = compiled.states[k]
            return _Finding(
                "AC404",
                f"{name} grows without bound",
                _declared_at(compiled, name),
                (f"{name} = {reached.x[k]:.6g} would double within {doubling:.1g} s",),
                "its rate grows faster than the state itself: a wrong sign, or unlimited feedback",
                f"look at the equation for der({name})",
            )
    return None


def _singular(problem: Problem, reached: Segment) -> _Finding | None:
    """Algebraic equations that no longer determine their unknowns."""
    compiled = problem.compiled
    if not 0 < len(compiled.algebraic) <= _MOST_ALGEBRAIC:
        return None
    jacobian = compiled.rhs.factory("jacobian", compiled.rhs.name_in(), ["jac:alg:z"])

    def matrix(x: Vector, z: Vector) -> Vector:
        return np.array(jacobian(reached.start, x, z, problem.u, problem.p, reached.p)) * problem.scale_z[None, :]

    here = matrix(reached.x, reached.z)
    random = np.random.default_rng(7)
    around = [
        matrix(
            reached.x + compiled.nominal_x * random.standard_normal(len(reached.x)),
            reached.z + problem.scale_z * random.standard_normal(len(reached.z)),
        )
        for _ in range(_SAMPLES)
    ]
    if not all(np.isfinite(m).all() for m in (here, *around)):
        return None
    rows = np.maximum(np.max([np.abs(m).max(axis=1) for m in around], axis=0), 1e-300)[:, None]
    usual = float(np.median([np.linalg.svd(m / rows, compute_uv=False)[-1] for m in around]))
    _, sizes, right = np.linalg.svd(here / rows)
    if sizes[-1] > _SINGULAR * usual:
        return None
    names = [compiled.algebraic[k] for k in np.flatnonzero(np.abs(right[-1]) > 0.1).tolist()]
    equations = [compiled.flat.equations[e] for e in _equations_of(compiled, names)]
    return _Finding(
        "AC402",
        f"{', '.join(names[:4])} can no longer be solved for",
        span_of(equations[0]) if equations else _declared_at(compiled, names[0]),
        ("they follow from:" if len(names) > 1 else "it follows from:", *lines(compiled.flat, equations)),
        "at this point the equations lose their solution, or two solutions meet",
        "look at these variables there: a mechanism may be fully stretched out, or a characteristic may fold back",
    )


def _equations_of(compiled: CompiledModel, names: list[str]) -> list[int]:
    """Flat equations of the blocks in which the named algebraic variables are solved."""
    structure = compiled.solution.structure
    variables = {v for v, name in zip(compiled.solution.algebraic, compiled.algebraic, strict=True) if name in names}
    return [structure.flat_equation(r) for b in structure.blocks if variables & set(b.columns) for r in b.rows]


class _OneSided(NamedTuple):
    """An unknown that nothing determines from here on, its flat equation, and the states that this constrains."""

    unknown: str
    equation: int
    states: tuple[str, ...]


def _one_sided(
    compiled: CompiledModel, t: float, x: Vector, z: Vector, u: Vector, p: Vector, m: Vector
) -> _OneSided | None:
    """The first equation that ceases, or begins, to determine its unknown at this point; None if there is none."""
    structure = compiled.solution.structure
    reduced = structure.reduced
    rows = [e for block in structure.blocks for e in block.rows]
    unknowns = [v for block in structure.blocks for v in block.columns]
    if not 0 < len(unknowns) <= _MOST_UNKNOWNS:
        return None
    s, y = Symbols(compiled), ca.SX.sym("y", len(unknowns))
    builder = s.defined(compiled)
    values = builder.column(reduced.pool.vars(unknowns))
    unsolved = s.builder(compiled)
    unsolved.define([], compiled.rewritten)
    unsolved.assign(unknowns, y)
    residuals = unsolved.column(unsolved.replaced(structure.residuals[e] for e in rows))
    at = (t, x, z, u, p, m)
    here = np.nan_to_num(
        np.array(ca.Function("y", s.inputs, [ca.densify(values)])(*at)).ravel(), posinf=0.0, neginf=0.0
    )
    linearised = ca.Function("of", [*s.inputs, y], [residuals, ca.jacobian(residuals, y), ca.jacobian(residuals, s.x)])

    def evaluated(y_values: Vector) -> tuple[Vector, Any, Any]:
        r, by_y, by_x = linearised(*at, y_values)
        return np.array(r).ravel(), abs(by_y.sparse()).tocsr(), abs(by_x.sparse()).tocsr()

    size = _LARGE * (compiled.nominal(unknowns) + np.abs(here))
    n = compiled.n_dynamic
    state_sizes = np.abs(x[:n]) + compiled.nominal_x[:n]
    first = 0
    for block in structure.blocks:
        part = slice(first, first + len(block.columns))  # as many rows as columns
        first = part.stop
        for j in range(part.start, part.stop):
            ends = []
            for side in (1.0, -1.0):
                far = here.copy()
                far[j] = side * size[j]
                ends.append(evaluated(far))
            for (r, by_y, by_x), (_, opposite, _) in (ends, ends[::-1]):
                other_slopes = opposite[part, j].toarray().ravel()
                slopes = by_y[part, part].max(axis=1).toarray().ravel()
                by_states = by_x[part, :n]
                terms = by_states @ state_sizes
                flat = (other_slopes > 0.0) & (other_slopes < np.inf) & (slopes <= _FLAT * other_slopes) & (terms > 0.0)
                for k in np.flatnonzero(flat & (np.abs(r[part]) <= _SATISFIED * terms)).tolist():
                    names = tuple(
                        compiled.states[i] for i in sorted(by_states[k].indices.tolist()) if by_states[k, i] != 0.0
                    )
                    return _OneSided(reduced.name(unknowns[j]), structure.flat_equation(rows[part.start + k]), names)
    return None
