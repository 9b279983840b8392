"""Transcription of a problem into a nonlinear program: Radau collocation, or multiple shooting, in all phases.

Unknowns are scaled by declared nominal values, by limits of inputs, or by the largest values in the guess; states that
stay at zero in the guess, by the values required at starts and ends of phases.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from acausal.arrays import Vector
from acausal.errors import UsageError
from acausal.optimal_control.declare import Constraint, Mesh, PhaseSpec
from acausal.optimal_control.free_start import start_residual
from acausal.optimal_control.guess import PhaseGuess
from acausal.optimal_control.problem import StatedProblem
from acausal.optimal_control.program.law import Law, law_of
from acausal.optimal_control.program.nlp import Nlp
from acausal.optimal_control.program.points import key, symbols_in
from acausal.optimal_control.program.polynomials import Basis
from acausal.optimal_control.program.shooting import Steps, integrate_interval
from acausal.optimal_control.program.sites import Site, site_of
from acausal.optimal_control.quantities import Quantities, magnitude


@dataclass(frozen=True, eq=False)
class Dynamics:
    """Equations of a phase, and the state jump at its end."""

    dae: Any  # `(t, x, z, u, p) -> (ode, alg, y)`
    guard: Any = (
        None  # `(t, x, z, u, p) -> g`, zero at the end of the phase; None unless a relation of the model ends it
    )
    jump: Any = None  # `(t, x, z, u, p) -> x` after the end; None without a jump
    exact: Any = None  # `dae` without smoothing; None if nothing is smoothed
    # `(t, x, z, u, p, selectors) -> (ode, alg, y, deciding)` with relaxed branches; None without.
    relaxed: Any = None


@dataclass(frozen=True, eq=False)
class PhaseProgram:
    """Unknowns of one phase in SI units, one column for each instant."""

    spec: PhaseSpec
    mesh: Mesh
    dynamics: Dynamics
    law: Law
    x: Any  # states at the start and at the collocation points, shape (nx, n + 1)
    z: Any  # algebraic variables at the collocation points, shape (nz, n)
    u: Any  # bernstein coefficients of the inputs, shape (nu, intervals * (control + 1))
    # Functions at the collocation points, at the start, and at the end.
    inside: Site
    first: Site
    last: Site
    # Start time and duration [s].
    begin: Any
    duration: Any
    shares: Vector  # collocation points as fractions of the phase, and their quadrature weights, shapes (n,)
    weights: Vector
    # With shooting, the integrals over the phase by the keys of their symbols.
    integrals: dict[int, Any] = field(default_factory=dict)
    selectors: Any = None  # selectors of relaxed branches at the collocation points, shape (branches, n)


@dataclass(frozen=True, eq=False)
class ConstraintRows:
    """Rows of a constraint in the program; `points` are its instants as fractions of the phase, shape (n,).

    `phase` and `points` are None for a single constraint.
    """

    constraint: Constraint
    phase: int | None
    rows: range
    scale: float
    points: Vector | None


@dataclass(frozen=True, eq=False)
class Program:
    """The nonlinear program of a problem, with its parts.

    `p` and `w` are all parameters and the open ones, `ports` those of states and inputs. `first` are the start values
    of the states if they are parameters of the program. `complementarity` are indices among `nlp.constraints` of the
    first of two relaxed conditions each. `known` are the boundary values and integrals by the keys of their symbols.
    """

    problem: StatedProblem
    nlp: Nlp
    basis: Basis
    p: Any
    phases: list[PhaseProgram]
    w: Any
    constraints: list[ConstraintRows] = field(default_factory=list)
    ports: tuple[Any, Any] = ((), ())
    first: Any = None
    steps: Steps | None = None
    past: bool = False
    input_sizes: Vector = field(default_factory=lambda: np.zeros(0))  # magnitudes by which u is scaled, shape (nu,)
    complementarity: list[int] = field(default_factory=list)
    known: dict[int, Any] = field(default_factory=dict)


def transcribe(
    problem: StatedProblem,
    dynamics: Sequence[Dynamics],
    guesses: Sequence[PhaseGuess],
    meshes: Sequence[Mesh],
    basis: Basis,
    expected: Vector,
    varying: Sequence[int] | None = None,
    steps: Steps | None = None,
    past: bool = False,
) -> Program:
    """Create the nonlinear program of a problem on the given meshes, with its initial guess.

    `expected`: values of the parameters in the guess, shape (np,).
    `varying`: indices of model parameters that become, with the start values of the states, parameters of the program.
    `steps`: integration steps of multiple shooting, which then replaces collocation.
    `past`: whether inputs are parameters of the program, and all start values unknowns, as for estimation.

    Raises UsageError: AC051 for constraints that no unknown can influence; AC052 for algebraic variables at a start
    with shooting or complementarity.
    """
    nlp, q = Nlp(), problem.quantities
    places = [d[0] for d in q.decided] if varying is None else list(varying)
    w = _decisions(nlp, q, expected) if varying is None else nlp.parameter(len(places))
    p = ca.MX(ca.DM(expected))
    for k, place in enumerate(places):
        p[place] = w[k]
    first = nlp.parameter(len(q.x)) if varying is not None else None
    sizes = _sizes(problem, guesses)
    program = Program(problem, nlp, basis, p, [], w, [], (q.x, q.u), first, steps, past, sizes[2])
    wanted = [k for k, output in enumerate(q.outputs) if q.place(output.name) is None]
    begin: Any = q.begin.t
    for spec, guess, mesh, law in zip(problem.specs, guesses, meshes, dynamics, strict=True):
        specialised = law_of(law.dae if law.relaxed is None else law.relaxed, expected, places, wanted)
        phase = _phase(program, problem, spec, mesh, law, specialised, guess, sizes, begin)
        program.phases.append(phase)
        begin = begin + phase.duration
    _link(program, problem, sizes[0])
    _values(program, problem)
    _ends(program, problem)
    for constraint in (*(() if past else _limits(problem)), *problem.constraints):
        _add_constraint(program, problem, constraint, sizes[2])
    nlp.objective = _in_unknowns(program, problem, ca.MX(0.0) if problem.objective is None else problem.objective)
    return program


def _decisions(nlp: Nlp, q: Quantities, expected: Vector) -> Any:
    """Unknowns of the decided parameters, a column."""
    found = []
    for place, lower, upper, _ in q.decided:
        scale = abs(q.p[place]) or 1.0
        free = nlp.unknown(expected[place] / scale)
        nlp.constrain(free, lower / scale, upper / scale)
        found.append(free * scale)
    return ca.vertcat(*found) if found else ca.MX(0, 1)


def _required(problem: StatedProblem) -> Vector:
    """Largest values that states have to take at the starts and ends of phases, shape (nx,); 0 if none is stated."""
    q, found = problem.quantities, np.zeros(len(problem.quantities.x))
    names = {key(symbol): output.name for symbol, output in zip(q.symbols, q.outputs, strict=True)}
    at_ends = {key(v.symbol): v.expression for v in problem.values if v.kind != "integral"}
    for constraint in problem.constraints:
        variable = names.get(key(at_ends.get(key(constraint.expression), q.time)))
        place = q.place(variable) if variable is not None else None
        if place is not None and place[0] == "x":
            limits = [abs(v) for v in (constraint.lower, constraint.upper) if np.isfinite(v)]
            found[place[1]] = max(found[place[1]], *limits)
    return found


def _sizes(problem: StatedProblem, guesses: Sequence[PhaseGuess]) -> tuple[Vector, Vector, Vector]:
    """Magnitudes of x, z and u, shapes (nx,), (nz,), (nu,)."""
    q = problem.quantities
    seen = [g.at(np.linspace(0.0, 1.0, 51)) for g in guesses]
    found = []
    for k, ports in enumerate((q.x, q.z, q.u)):
        largest = np.max([np.abs(s[k]).max(axis=1, initial=0.0) for s in seen], axis=0)
        if ports is q.x:
            largest = np.where(largest == 0.0, _required(problem), largest)
        found.append(magnitude(np.array(ports.nominal), largest))
    for constraint in (*_limits(problem), *problem.constraints):
        place = q.place(constraint.variable) if constraint.variable is not None else None
        if place is not None and place[0] == "u":
            limits = [abs(v) for v in (constraint.lower, constraint.upper) if np.isfinite(v) and v != 0.0]
            found[2][place[1]] = max(limits, default=found[2][place[1]])
    return found[0], found[1], found[2]


def _phase(
    program: Program,
    problem: StatedProblem,
    spec: PhaseSpec,
    mesh: Mesh,
    dynamics: Dynamics,
    law: Law,
    guess: PhaseGuess,
    sizes: tuple[Vector, Vector, Vector],
    begin: Any,
) -> PhaseProgram:
    """Add the unknowns and the collocation or shooting constraints of one phase."""
    nlp, basis, count, q = program.nlp, program.basis, len(mesh), problem.quantities
    n = count * basis.degree
    lengths = np.array(mesh.fractions)
    starts = np.concatenate([[0.0], np.cumsum(lengths)[:-1]])
    shares = (starts[:, None] + lengths[:, None] * basis.points).ravel()
    values = _scaled_guess(guess, basis, sizes, (starts, lengths, shares), q)
    if law.algebraic is not None:
        values[1] = np.zeros((0, n))
    else:
        # from a start far above the solution, Newton's method can fall below the lower bound of a monotone search
        values[1] = np.minimum(values[1], np.where(np.isfinite(q.low), q.low / sizes[1] + 1.0, np.inf)[:, None])
    nz = len(values[1])
    if law.selectors:
        values[1] = np.vstack([values[1], _initial_selectors(dynamics, guess, shares, q)])
        sizes = (sizes[0], np.concatenate([sizes[1], np.ones(law.selectors)]), sizes[2])
    unknowns = [nlp.unknown(v, *v.shape) for v in values[: 2 if program.past else 3]]
    x, z, *free = (ca.DM(s) * v if v.numel() else v for s, v in zip(sizes, unknowns, strict=False))
    u = free[0] if free else ca.reshape(nlp.parameter(values[2].size), *values[2].shape)
    duration = _duration(nlp, spec, guess)
    at = u @ basis.blocks(basis.bernstein(basis.points), count, 0)
    times = begin + duration * ca.DM(shares).T
    arguments = [times, x[:, 1:], z, at]
    inside = site_of(nlp, q, law, program.w, arguments, n)
    # algebraic variables at the start are unknowns only if needed; otherwise those of the first point replace them
    start_values = [v.expression for v in problem.values if v.kind == "start" and problem.specs[v.phase] is spec]
    known = program.steps is None and not law.selectors and any(_by_z(problem, e, dynamics, law) for e in start_values)
    at_start = ca.DM(sizes[1]) * nlp.unknown(values[1][:, :1], nz, 1) if known else z[:, 0]
    first = site_of(nlp, q, law, program.w, [begin, x[:, 0], at_start, u[:, 0]], 1)
    last = site_of(nlp, q, law, program.w, [begin + duration, x[:, -1], z[:, -1], at[:, -1]], 1)
    ode, alg, _ = inside.equations
    integrals: dict[int, Any] = {}
    if program.steps is None:
        rate = unknowns[0] @ basis.blocks(basis.slopes, count, 1)
        lengthened = np.tile(np.repeat(lengths, basis.degree), (len(q.x), 1))
        nlp.constrain(rate - duration * (inside.points.add(ode / ca.DM(sizes[0])) * ca.DM(lengthened)))
    else:
        borders = (begin + duration * ca.DM(starts).T, duration * ca.DM(lengths).T)
        integrals = _shooting(program, problem, spec, law, (borders, x, z, at), sizes[0])
    if z.numel():
        at_guess = [q.begin.t + guess.duration * shares[None, :], *guess.at(shares)]
        at_guess[2] = values[1][:nz] * sizes[1][:nz, None]
        slopes = law.algebraic_jacobian(at_guess, sizes[1][:nz])
        nlp.constrain(inside.points.add(alg / ca.DM(_equation_sizes(slopes))))
        if known:
            nlp.constrain(first.points.add(first.equations[1] / ca.DM(_equation_sizes(slopes))))
        for k in np.flatnonzero(_needs_lower_bound(law, at_guess, sizes[1][:nz], q.low[:nz], slopes)).tolist():
            nlp.constrain(unknowns[1][k, :], q.low[k] / sizes[1][k], np.inf)
            if known:
                nlp.constrain(at_start[k] / sizes[1][k], q.low[k] / sizes[1][k], np.inf)
    weights = (lengths[:, None] * basis.weights).ravel()
    selectors = z[nz:, :]
    z = z[:nz, :] if law.selectors else z
    if law.selectors:
        _add_complementarity(program, inside, selectors, nz)
    if law.algebraic is not None:
        z = law.algebraic.map(n)(times, x[:, 1:], at, ca.repmat(program.w, 1, n))
    places = (inside, first, last)
    numbers = (begin, duration, shares, weights)
    return PhaseProgram(spec, mesh, dynamics, law, x, z, u, *places, *numbers, integrals, selectors)


def _equation_sizes(slopes: Vector) -> Vector:
    """Magnitude of each algebraic equation, shape (nz,): the largest row sum of its Jacobians, shape (nz, nz, n)."""
    found = np.nanmax(np.abs(slopes).sum(axis=1), axis=1, initial=0.0)
    return np.where((found > 0.0) & np.isfinite(found), found, 1.0)


def _needs_lower_bound(law: Law, at: Sequence[Vector], sizes: Vector, low: Vector, slopes: Vector) -> NDArray[np.bool_]:
    """Mask of the algebraic variables that need their lower bound as a constraint, shape (nz,).

    An equation whose slope has the same sign below the bound as above it has no solution below, and needs no
    constraint. If its solution is the bound itself (a drill in air does not cut), a constraint would leave ipopt no
    interior.

    `at`: t, x, z, u at n instants, each of shape (rows, n).
    `sizes`, `low`: magnitudes and lower bounds of z, shape (nz,).
    `slopes`: Jacobians of the equations by scaled z at these instants, shape (nz, nz, n).
    """
    found = np.isfinite(low)
    for k in np.flatnonzero(found).tolist():
        n = at[0].shape[1]
        below = [np.tile(v, 2) for v in at]
        below[2][k] = low[k] - np.repeat([1e-3, 1.0], n) * sizes[k]
        there = law.algebraic_jacobian(below, sizes)[k, k]
        found[k] = not (np.sign(there) == np.sign(np.tile(slopes[k, k], 2))).all()
    return found


def _initial_selectors(dynamics: Dynamics, guess: PhaseGuess, shares: Vector, q: Quantities) -> Vector:
    """Initial selectors of relaxed branches, shape (branches, n), away from 0 and 1."""
    x, z, u = (ca.DM(v) if v.size else ca.DM(v.shape[0], len(shares)) for v in guess.at(shares))
    n, count = len(shares), dynamics.relaxed.numel_in(5)
    times = ca.DM(q.begin.t + guess.duration * shares).T
    deciding = dynamics.relaxed.map(n)(times, x, z, u, ca.repmat(ca.DM(q.p), 1, n), 0.5 * ca.DM.ones(count, n))[3]
    return np.asarray(np.clip(0.5 + 5.0 * np.array(deciding), 0.02, 0.98))


def _add_complementarity(program: Program, inside: Site, selectors: Any, nz: int) -> None:
    """Complementarity of selectors y with the deciding quantities d: y d >= 0 and (1 - y) d <= 0.

    Hence y is 1 where d > 0, 0 where d < 0, and free in [0, 1] where d stays at 0, as in a Filippov solution (step
    reformulation: A. Nurkanovic, M. Diehl, IEEE Control Systems Letters 6 (2022) 3110-3115). Both conditions are
    relaxed, and tightened from one solution to the next (S. Scholtes, SIAM J. Optimization 11 (2001) 918-936).
    """
    nlp = program.nlp
    nlp.constrain(selectors, 0.0, 1.0)
    y, d = inside.point[2][nz:], inside.equations[2][-inside.law.selectors :]
    program.complementarity.append(len(nlp.lower))
    nlp.constrain(inside.points.add(y * d), -1.0, np.inf)
    nlp.constrain(inside.points.add((1 - y) * d), -np.inf, 1.0)


def _shooting(
    program: Program, problem: StatedProblem, spec: PhaseSpec, law: Law, unknowns: Any, size: Vector
) -> dict[int, Any]:
    """Add the continuity constraints of multiple shooting; returns the integrals by the keys of their symbols."""
    assert program.steps is not None
    (begins, lengths), x, z, at = unknowns
    n, q = lengths.shape[1], problem.quantities
    site = site_of(program.nlp, q, law, program.w, [begins, x[:, :-1], z, at], n)
    h = site.points.with_input(lengths)
    own = [v for v in problem.values if v.kind == "integral" and problem.specs[v.phase] is spec]
    ends, parts = integrate_interval(law, program.steps, site.point, h, [site.integrand(q, v.expression) for v in own])
    after = site.points.add(ends / ca.DM(size))
    program.nlp.constrain(x[:, 1:] / ca.DM(size) - after)
    over = site.points.add(parts)
    return {key(v.symbol): ca.sum2(over[k, :]) for k, v in enumerate(own)}


def _duration(nlp: Nlp, spec: PhaseSpec, guess: PhaseGuess) -> Any:
    """Duration of a phase [s], an unknown unless it is fixed."""
    if spec.shortest == spec.longest:
        return ca.MX(spec.shortest)
    scale = guess.duration
    lower, upper = max(spec.shortest / scale, 1e-6), spec.longest / scale
    free = nlp.unknown(min(max(1.0, spec.shortest / scale), upper))
    nlp.constrain(free, lower, upper)
    return free * scale


def _scaled_guess(
    guess: PhaseGuess, basis: Basis, sizes: Sequence[Vector], places: tuple[Vector, Vector, Vector], q: Quantities
) -> list[Vector]:
    """Scaled guess: states at the start and the points, z at the points, Bernstein coefficients of u."""
    starts, lengths, shares = places
    x, _, _ = guess.at(np.concatenate([[0.0], shares]))
    _, z, _ = guess.at(shares)
    nodes = (starts[:, None] + lengths[:, None] * basis.nodes).ravel()
    _, _, u = guess.at(nodes)
    inverse = np.linalg.inv(basis.bernstein(basis.nodes))
    u = u @ np.kron(np.eye(len(lengths)), inverse)
    u = np.clip(u, np.array(q.u.min)[:, None], np.array(q.u.max)[:, None])
    return [values / size[:, None] for values, size in zip((x, z, u), sizes, strict=True)]


def _link(program: Program, problem: StatedProblem, size: Vector) -> None:
    """Add the constraints on the start values, and the links between consecutive phases."""
    nlp, q = program.nlp, problem.quantities
    first = program.phases[0].x[:, 0]
    held = [k for k in range(len(q.x)) if k not in problem.free_start and not program.past]
    begin = q.start(program.p) if q.decided else ca.DM(q.first)
    begin = begin if program.first is None else program.first
    if held:
        nlp.constrain((first[held] - begin[held]) / ca.DM(size[held]))
    residual = start_residual(q, [k for k in range(len(q.x)) if k not in held])
    if residual is not None:
        at = program.phases[0].first
        nlp.constrain(at.points.add(residual(*at.model)))
    for before, after in zip(program.phases[:-1], program.phases[1:], strict=True):
        last = before.x[:, -1]
        if before.dynamics.jump is not None:
            last = before.last.points.add(before.dynamics.jump(*before.last.model))
        nlp.constrain((after.x[:, 0] - last) / ca.DM(size))


def _values(program: Program, problem: StatedProblem) -> None:
    """Express boundary values and integrals, in order of their declaration, because later ones may use earlier ones."""
    for value in problem.values:
        phase = program.phases[value.phase]
        if key(value.symbol) in phase.integrals:
            found = phase.integrals[key(value.symbol)]
        elif value.kind == "integral":
            row = along(program, problem, value.expression, phase.inside)
            found = phase.duration * (row @ ca.DM(phase.weights))
        elif value.kind == "end":
            found = along(program, problem, value.expression, phase.last)
        else:
            _check_start(program, problem, value.expression, phase)
            found = along(program, problem, value.expression, phase.first)
        program.known[key(value.symbol)] = found


def _by_z(problem: StatedProblem, expression: Any, dynamics: Dynamics, law: Law) -> str | None:
    """Name of a variable in an expression that depends on algebraic variables of the program, or None."""
    q = problem.quantities
    if not len(q.z) or not q.outputs or law.algebraic is not None:
        return None
    by_z = np.array(ca.DM(dynamics.dae.jac_sparsity(2, 2), 1).sparsity().row())
    for k, (output, symbol) in enumerate(zip(q.outputs, q.symbols, strict=True)):
        if k in by_z and q.place(output.name) is None and ca.depends_on(expression, symbol):
            return output.name
    return None


def _check_start(program: Program, problem: StatedProblem, expression: Any, phase: PhaseProgram) -> None:
    """AC052 if an expression needs algebraic variables at the start that are not unknowns there."""
    name = _by_z(problem, expression, phase.dynamics, phase.law)
    if name is not None and (program.steps is not None or phase.law.selectors):
        raise UsageError(
            "AC052",
            f"{name} follows from algebraic equations, which are not solved at the start of a phase",
            help="use a state there, or constrain it along the phase: phase.subject_to(...); collocation without "
            "complementarity does solve them",
        )


def _ends(program: Program, problem: StatedProblem) -> None:
    """Add the constraints that guards are zero at the ends of their phases."""
    for phase in program.phases:
        if phase.spec.switch is None:
            continue
        guard = problem.guards[phase.spec.switch]
        if guard.relation is not None:
            value = phase.last.points.add(phase.dynamics.guard(*phase.last.model))
        else:
            value = along(program, problem, guard.expression, phase.last)
        constraint = Constraint(f"{phase.spec.name} ends: {guard.text}", None, 0.0, 0.0, (), None, 1.0)
        _add_rows(program, constraint, None, value, 1.0, None)


def _limits(problem: StatedProblem) -> list[Constraint]:
    """Constraints of the declared limits of inputs."""
    everywhere = tuple(range(len(problem.specs)))
    found = []
    for port in problem.quantities.u:
        if np.isfinite(port.min) or np.isfinite(port.max):
            scale = max(abs(v) for v in (port.min, port.max) if np.isfinite(v)) or 1.0
            found.append(
                Constraint(f"limits of {port.name}", None, port.min, port.max, everywhere, port.name, float(scale))
            )
    return found


def _add_constraint(program: Program, problem: StatedProblem, constraint: Constraint, size_u: Vector) -> None:
    """Add a constraint in each of its phases; limits of inputs bound their Bernstein coefficients."""
    q, basis = problem.quantities, program.basis
    if not constraint.phases:
        value = _in_unknowns(program, problem, constraint.expression)
        _add_rows(program, constraint, None, value, constraint.scale, None)
        return
    place = q.place(constraint.variable) if constraint.variable is not None else None
    for number in constraint.phases:
        phase = program.phases[number]
        if place is not None and place[0] == "u":
            lengths = np.array(phase.mesh.fractions)
            starts = np.concatenate([[0.0], np.cumsum(lengths)[:-1]])
            points = (starts[:, None] + lengths[:, None] * basis.nodes).ravel()
            _add_rows(program, constraint, number, place[2] * phase.u[place[1], :], float(size_u[place[1]]), points)
            continue
        row = along(program, problem, constraint.expression, phase.inside)
        _refuse_constant(constraint, phase, row)
        _add_rows(program, constraint, number, row, constraint.scale, phase.shares)


def _refuse_constant(constraint: Constraint, phase: PhaseProgram, row: Any) -> None:
    """AC051 if a path constraint is constant over the phase, and violated."""
    points = phase.inside.points
    constant = next((a for a, s in zip(points.rows, points.symbols, strict=True) if key(s) == key(row)), None)
    if constant is None or ca.depends_on(constant, points.local):
        return
    value = float(ca.evalf(constant)[0])
    least = 1e-9 * constraint.scale
    if constraint.lower - least <= value <= constraint.upper + least:
        return
    raise UsageError(
        "AC051",
        f"no unknown can influence the constraint {constraint.name} in phase {phase.spec.name}: it is {value:g} there",
        where=constraint.where,
        help="impose it on the phases in which it varies: phase = problem.phase(...), phase.subject_to(...)",
    )


def _add_rows(
    program: Program, constraint: Constraint, phase: int | None, value: Any, scale: float, points: Vector | None
) -> None:
    """Add the rows of a constraint; AC051 if a single one depends on no unknown."""
    nlp, value = program.nlp, ca.vec(ca.MX(value))
    chosen = [*nlp.unknowns, *(s for one in nlp.points for s in one.symbols)]
    if phase is None and not ca.depends_on(value, ca.veccat(*chosen)):
        raise UsageError(
            "AC051",
            f"no unknown can influence the constraint {constraint.name}",
            where=constraint.where,
            help="leave it out; parameters are numbers until they are decided: problem.decide(name)",
        )
    rows = nlp.constrain(value / scale, constraint.lower / scale, constraint.upper / scale)
    program.constraints.append(ConstraintRows(constraint, phase, rows, scale, points))


def along(program: Program, problem: StatedProblem, expression: Any, site: Site) -> Any:
    """An expression of variables at the n instants of a site, shape (m, n)."""
    q, n = problem.quantities, site.points.n
    own = symbols_in(expression)
    used = [k for k, s in enumerate(q.symbols) if key(s) in own]
    if len(used) == 1 and key(q.symbols[used[0]]) == key(expression) and site.places[used[0]] is not None:
        return site.in_unknowns(used[0])
    names = [q.symbols[k] for k in used]
    signals = [site.signal(k) for k in used]
    if key(q.time) in own:
        names, signals = [q.time, *names], [site.point[0], *signals]
    numbers = [(s, v) for s, v in zip(*scalar_values(program, problem), strict=True) if key(s) in own]
    path = ca.Function("path", [*names, *(s for s, _ in numbers)], [expression]).expand()
    rows = [ca.repmat(value, 1, n) for _, value in numbers]
    if all(_linear(program.nlp, row) for row in rows):
        return site.points.add(path(*signals, *(site.points.with_input(row) for row in rows)))
    # boundary values that depend on results at points cannot be arguments of points
    return path.map(n)(*(site.points.add(signal) for signal in signals), *rows)


def _linear(nlp: Nlp, row: Any) -> bool:
    """Whether an expression is linear in the unknowns and contains no results at points."""
    own = ca.symvar(row)
    known = {key(s) for s in (*nlp.unknowns, *nlp.parameters)}
    if not all(key(s) in known for s in own):
        return False
    return not own or not any(ca.which_depends(row, ca.veccat(*own), 2, True))


def scalar_values(program: Program, problem: StatedProblem) -> tuple[list[Any], list[Any]]:
    """(Symbols, expressions in the program) of decided parameters, durations, and values expressed so far."""
    symbols = [d[3] for d in problem.quantities.decided]
    values = [program.p[d[0]] for d in problem.quantities.decided]
    symbols += problem.durations
    values += [phase.duration for phase in program.phases]
    for value in problem.values:
        if key(value.symbol) in program.known:
            symbols.append(value.symbol)
            values.append(program.known[key(value.symbol)])
    return symbols, values


def _in_unknowns(program: Program, problem: StatedProblem, expression: Any) -> Any:
    """A scalar expression in terms of the unknowns."""
    symbols, values = scalar_values(program, problem)
    return ca.substitute([expression], symbols, values)[0] if symbols else expression
