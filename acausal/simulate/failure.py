"""Explains why a run stopped early: when, where in the model, and what happens there.

One cause are equations that determine a force on one side only: a string that becomes taut while a run goes on.
`minimum(force, l - r) == 0` says force = 0 while the string is slack. From l = r on it holds positions, which are
states, and nothing determines the force: a constraint that comes and goes, without a branch that the structure could
show (AC213). Solvers end there, with an infinite force or without convergence. It is recognised by numbers: the
equation has no slope by the unknown where that is large on one side, and one where it is large on the other, and what
is left of it on the one side is a condition on the states that holds just then. Smooth forms of the same, as that of
A. Fischer (A special Newton-type optimization method, Optimization 24 (1992) 269-284), are alike.
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

_ELSEWHERE = "look at these variables around that time; try another solver (--solver rosenbrock) or tolerance"
# The solver's word, code, fact, cause and remedy.
_KNOWN: tuple[tuple[str, str, str, str, str], ...] = (
    (
        "TOO_MUCH_WORK",
        "AC401",
        "needs more steps than allowed, as it hardly comes on",
        "something fast that goes on and on, a switch that flutters, or a tolerance below the rounding errors of the "
        "model",
        "see in `acausal stability MODEL` which mode is fast and which solver suits it (mostly --solver rosenbrock); "
        "try a looser --tolerance",
    ),
    (
        "CONV_FAIL",
        "AC402",
        "Newton's method of the solver does not converge",
        "the equations have no solution just after this time, or jump to another one: a function outside its domain, a "
        "mechanism that is stretched out, a jump that no relation tells of",
        "look at these variables around that time; state a jump by where(...) or when(...), which are located; try "
        "--solver rosenbrock",
    ),
    (
        "ERR_FAIL",
        "AC403",
        "no step is small enough for the tolerance",
        "a value jumps that no relation tells of, in a table or an external function, or goes to infinity",
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
_UNKNOWN = (
    "AC400",
    "the solver gave up",
    "a jump or a singular position just after this time, or a tolerance too tight",
    _ELSEWHERE,
)
_AHEAD = 10.0 ** np.arange(-12.0, -1.0)  # shares of the segment that are looked at behind the last point
_SHORT = 1e-4  # share of the run within which something doubles that grows without bound
_SINGULAR = 1e-2  # smallest singular value of the algebraic equations, by what it is around that point
_AROUND = 7  # points around it
_MOST_ALGEBRAIC = 300
_DEPENDENT = 1e-3  # smallest singular value of unit slopes at which constraints are taken to depend on each other
# Of forces that are determined on one side:
_MOST = 500  # unknowns of the models that are looked at
_LARGE = 1e6  # of an unknown, by its nominal magnitude and its value
_FLAT = 1e-6  # no slope on the one side, by that on the other
_REACHED = 1e-2  # how far the condition on the states is off, by what moves it


@dataclass(frozen=True)
class _Finding:
    """A cause that was recognised: code and fact instead of the solver's, with evidence, place and advice."""

    code: str
    fact: str
    where: tuple[Span, ...]
    evidence: tuple[str, ...]
    cause: str
    help: str


# where a run ends values overflow, also what is made of them here
@np.errstate(over="ignore", invalid="ignore")
def integration_error(problem: Problem, solver: str, reached: Segment, text: str) -> IntegrationError:
    """What went wrong, when, and which variables were moving fastest.

    `reached`: The segment from the last point that was reached.
    `text`: The solver's own words.
    """
    compiled = problem.compiled
    at = (reached.x, reached.z, problem.u, problem.p, reached.p)
    ode = np.array(compiled.rhs(reached.start, *at)[0]).ravel()
    code, fact, cause, remedy = next((said for key, *said in _KNOWN if key in text), _UNKNOWN)
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
    where = finding.where or (_made(compiled, compiled.states[fastest[0]]) if fastest else ())
    return IntegrationError(
        finding.code,
        f"{compiled.name}: {solver} stopped at t = {reached.start:.9g} s: {finding.fact}",
        where=where,
        evidence=[*finding.evidence, *(["fastest there:", *(f"  {row}" for row in moving)] if moving else [])],
        cause=finding.cause,
        help=finding.help,
    )


def _made(compiled: CompiledModel, variable: str) -> tuple[Span, ...]:
    return made_at(compiled.flat, component_of(compiled.flat, variable))


def is_constraining(problem: Problem, reached: Segment) -> bool:
    """Whether an equation for a force becomes a constraint on the states there."""
    return _constraining(problem, reached) is not None


def _constraining(problem: Problem, reached: Segment) -> _Finding | None:
    """An equation for a force that becomes a constraint on the states."""
    compiled = problem.compiled
    found = _one_sided(compiled, reached.start, reached.x, reached.z, problem.u, problem.p, reached.p)
    if found is None:
        return None
    equation = compiled.flat.equations[found.equation]
    return _Finding(
        "AC402",
        f"nothing determines {found.unknown} from there on: its equation holds {listed(found.states, 4)} instead",
        span_of(equation),
        (line(compiled.flat, equation).strip(),),
        "a constraint that comes and goes, as of a string that becomes taut: states would go, and velocities jump",
        "hold accelerations, where(taut, der(away), force) == 0, and let the `when` that sets `taut` make velocities "
        "jump, reset(away, 0, by=pull); or give it a force, a stiff spring and damper",
    )


def _undefined(problem: Problem, reached: Segment, ode: Vector) -> _Finding | None:
    """An equation that has no finite value there, or just behind that point as the states are moving."""
    span = reached.times[-1] - reached.start if len(reached.times) else 0.0
    for ahead in (0.0, *(span * _AHEAD).tolist()):
        x = reached.x + ahead * np.nan_to_num(ode, posinf=0.0, neginf=0.0)
        point = (reached.start + ahead, x, reached.z, problem.u, problem.p, reached.p)
        found = first_undefined(problem.compiled, *point)
        if found is not None:
            return _of_undefined(problem.compiled, found, ahead)
    return None


def _of_undefined(compiled: CompiledModel, found: Undefined, ahead: float) -> _Finding:
    return _Finding(
        "AC404",
        f"{found.variable} has no finite value {'just after it' if ahead else 'there'}",
        span_of(found.equation) or _made(compiled, found.variable),
        (
            line(compiled.flat, found.equation).strip(),
            *([f"with {', '.join(found.inside[:6])}"] if found.inside else []),
        ),
        found.reason or UNDEFINED,
        "state the equation so that it holds there too, or end the run before",
    )


def _stretched(problem: Problem, reached: Segment, ode: Vector) -> _Finding | None:
    """Stabilised constraints whose slopes depend on each other while a state that they hold runs away."""
    compiled = problem.compiled
    structure = compiled.solution.structure
    running = (np.abs(reached.x) > 1e3 * compiled.nominal_x) & (reached.x * ode > 0.0)
    if not structure.invariants or not running.any():
        return None
    point = np.array([reached.start]), reached.x[:, None], reached.z[:, None]
    slope = constraints(compiled, *point, problem.u, problem.p, reached.p)[1][0] * compiled.nominal_x
    size = np.linalg.norm(slope, axis=1)
    if not (np.isfinite(slope).all() and size.all() and slope[:, running].any()):
        return None
    left, sizes, _ = np.linalg.svd(slope / size[:, None])
    if len(slope) > slope.shape[1] or sizes[-1] > _DEPENDENT:
        return None
    node = structure.invariants[int(np.argmax(np.abs(left[:, -1])))][1]
    condition = next(c for c in (*compiled.start.conditions, *compiled.start.surplus) if c.node == node)
    text = (
        condition.text.removeprefix("d/dt (").removesuffix(")") if condition.text.startswith("d/dt") else condition.text
    )
    stated = [e for e in compiled.flat.equations if compiled.flat.text(e) == text]
    names = [compiled.states[k] for k in np.flatnonzero(running).tolist()]
    return _Finding(
        "AC402",
        f"the constraint `{text}` can hardly be followed: {listed(names, 3)} would have to be infinite",
        tuple(places(compiled.flat, stated[:1])) or condition.where,
        (),
        "a mechanism is stretched out or folded up there, and what drives it goes on",
        "drive it less far, or change its lengths",
    )


def _unbounded(compiled: CompiledModel, reached: Segment, ode: Vector) -> _Finding | None:
    """A state far from its usual size that doubles within a ten-thousandth of the time that has passed."""
    since = abs(reached.start - compiled.flat.experiment.start_time) or 1.0
    large = np.abs(reached.x) > 1e3 * compiled.nominal_x
    for k in np.flatnonzero(large & (reached.x * ode > 0.0)).tolist():
        doubling = float(reached.x[k] / ode[k])
        if doubling < _SHORT * since:
            name = compiled.states[k]
            return _Finding(
                "AC404",
                f"{name} grows without bound",
                _made(compiled, name),
                (f"{name} = {reached.x[k]:.6g} would double within {doubling:.1g} s",),
                "its rate grows faster than itself: a wrong sign, or feedback that nothing limits",
                f"look at the equation for der({name})",
            )
    return None


def _singular(problem: Problem, reached: Segment) -> _Finding | None:
    """Algebraic equations that cease to determine their unknowns."""
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
        for _ in range(_AROUND)
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
        span_of(equations[0]) if equations else _made(compiled, names[0]),
        ("they follow from:" if len(names) > 1 else "it follows from:", *lines(compiled.flat, equations)),
        "at this point the equations lose their solution, or two solutions meet",
        "look at what these variables do there; a mechanism may be stretched out, a characteristic may fold back",
    )


def _equations_of(compiled: CompiledModel, names: list[str]) -> list[int]:
    """Flat equations of the blocks that algebraic variables are solved in."""
    structure = compiled.solution.structure
    wanted = {v for v, name in zip(compiled.solution.algebraic, compiled.algebraic, strict=True) if name in names}
    return [structure.flat_equation(r) for b in structure.blocks if wanted & set(b.columns) for r in b.rows]


class _OneSided(NamedTuple):
    """An unknown that nothing determines from here on, the flat equation, and the states that this would hold."""

    unknown: str
    equation: int
    states: tuple[str, ...]


def _one_sided(
    compiled: CompiledModel, t: float, x: Vector, z: Vector, u: Vector, p: Vector, m: Vector
) -> _OneSided | None:
    """The first equation that stops, or begins, to determine its unknown at this point; None where none does."""
    structure = compiled.solution.structure
    reduced = structure.reduced
    rows = [e for block in structure.blocks for e in block.rows]
    unknowns = [v for block in structure.blocks for v in block.columns]
    if not 0 < len(unknowns) <= _MOST:
        return None
    s, y = Symbols(compiled), ca.SX.sym("y", len(unknowns))
    builder = s.defined(compiled)
    values = builder.column(reduced.pool.vars(unknowns))
    open_ = s.builder(compiled)
    open_.define([], compiled.rewritten)
    open_.know(unknowns, y)
    residuals = open_.column(open_.replaced(structure.residuals[e] for e in rows))
    at = (t, x, z, u, p, m)
    here = np.nan_to_num(
        np.array(ca.Function("y", s.inputs, [ca.densify(values)])(*at)).ravel(), posinf=0.0, neginf=0.0
    )
    of = ca.Function("of", [*s.inputs, y], [residuals, ca.jacobian(residuals, y), ca.jacobian(residuals, s.x)])

    def looked(at_y: Vector) -> tuple[Vector, Any, Any]:
        r, by_y, by_x = of(*at, at_y)
        return np.array(r).ravel(), abs(by_y.sparse()).tocsr(), abs(by_x.sparse()).tocsr()

    size = _LARGE * (compiled.nominal(unknowns) + np.abs(here))
    n = compiled.n_dynamic
    could = np.abs(x[:n]) + compiled.nominal_x[:n]
    first = 0
    for block in structure.blocks:
        own = slice(first, first + len(block.columns))  # as many rows as columns
        first = own.stop
        for j in range(own.start, own.stop):
            ends = []
            for side in (1.0, -1.0):
                far = here.copy()
                far[j] = side * size[j]
                ends.append(looked(far))
            for (r, by_y, by_x), (_, opposite, _) in (ends, ends[::-1]):
                usual = opposite[own, j].toarray().ravel()
                slopes = by_y[own, own].max(axis=1).toarray().ravel()
                held = by_x[own, :n]
                moves = held @ could
                flat = (usual > 0.0) & (usual < np.inf) & (slopes <= _FLAT * usual) & (moves > 0.0)
                for k in np.flatnonzero(flat & (np.abs(r[own]) <= _REACHED * moves)).tolist():
                    names = tuple(compiled.states[i] for i in sorted(held[k].indices.tolist()) if held[k, i] != 0.0)
                    return _OneSided(reduced.name(unknowns[j]), structure.flat_equation(rows[own.start + k]), names)
    return None
