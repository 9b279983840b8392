"""The nonlinear program of a problem: Radau collocation in all phases, for `nlp.py`.

Unknowns are divided by their magnitudes: declared nominals, limits of inputs, else the largest value in the guess.
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
from acausal.optimal_control.guess import PhaseGuess
from acausal.optimal_control.problem import StatedProblem
from acausal.optimal_control.program.law import Law, law_of
from acausal.optimal_control.program.nlp import Nlp
from acausal.optimal_control.program.points import key, symbols_in
from acausal.optimal_control.program.polynomials import Basis
from acausal.optimal_control.program.shooting import Steps, bridge
from acausal.optimal_control.program.sites import Site, site_of
from acausal.optimal_control.quantities import Quantities, magnitude


@dataclass(frozen=True, eq=False)
class Dynamics:
    """What holds within a phase, and what happens at its end."""

    dae: Any  # `(t, x, z, u, p) -> (ode, alg, y)`
    guard: Any = None  # `(t, x, z, u, p) -> g`, zero at the end of the phase; None without a switch of the model
    jump: Any = None  # `(t, x, z, u, p) -> x` after the end; None where nothing jumps
    sharp: Any = None  # `dae` without what is rounded in it; None where nothing is
    # `(t, x, z, u, p, y) -> (ode, alg, y, deciding)` with answers of branches that the program chooses; None without.
    freed: Any = None


@dataclass(frozen=True, eq=False)
class PhaseProgram:
    """Unknowns of one phase in SI units; columns are instants."""

    spec: PhaseSpec
    mesh: Mesh
    dynamics: Dynamics
    law: Law
    x: Any  # states at the start and at the collocation points, shape (nx, n + 1)
    z: Any  # algebraic variables at the collocation points, shape (nz, n)
    u: Any  # bernstein coefficients of the inputs, shape (nu, intervals * (control + 1))
    # `inside`, `first`, `last`: what is evaluated at the collocation points, at the start, and at the end.
    inside: Site
    first: Site
    last: Site
    # `begin`, `duration`: time of the start and duration [s].
    begin: Any
    duration: Any
    shares: Vector  # the collocation points as shares of the phase, shape (n,); `weights` those of the quadrature
    weights: Vector
    # With shooting, the integrals over the phase by the symbols that stand for them.
    integrals: dict[int, Any] = field(default_factory=dict)
    answers: Any = None  # answers of branches that the program chooses at the collocation points, shape (branches, n)


@dataclass(frozen=True, eq=False)
class Demand:
    """A constraint as it stands in the program, at these rows; `points` are its places as shares of the phase.

    `points` is None for a constraint on numbers.
    """

    constraint: Constraint
    phase: int | None
    rows: range
    scale: float
    points: Vector | None


@dataclass(frozen=True, eq=False)
class Program:
    """The whole program, and where everything is in it.

    `relaxed` are numbers of demands on answers of branches, two each, which a solution tightens.
    """

    problem: StatedProblem
    nlp: Nlp
    basis: Basis
    p: Any
    phases: list[PhaseProgram]
    w: Any
    demands: list[Demand] = field(default_factory=list)
    ports: tuple[Any, Any] = ((), ())
    first: Any = None
    steps: Steps | None = None
    past: bool = False
    relaxed: list[int] = field(default_factory=list)
    known: dict[int, Any] = field(default_factory=dict)


def transcribed(
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
    """The program of a problem on meshes, with its guess; `expected` are the parameters in it, shape (np,).

    `varying` leaves the first states and the parameters at these places open, as parameters of the program.
    With `steps` intervals are bridged by them instead, from border to border. With `past` inputs are what was given, as
    parameters of the program, and all first states are unknown.

    Raises UsageError: AC052 for values at a start that are not known there, with shooting or complementarity.
    """
    nlp, q = Nlp(), problem.quantities
    places = [d[0] for d in q.decided] if varying is None else list(varying)
    w = _decisions(nlp, q, expected) if varying is None else nlp.parameter(len(places))
    p = ca.MX(ca.DM(expected))
    for k, place in enumerate(places):
        p[place] = w[k]
    first = nlp.parameter(len(q.x)) if varying is not None else None
    sizes = _sizes(problem, guesses)
    program = Program(problem, nlp, basis, p, [], w, ports=(q.x, q.u), first=first, steps=steps, past=past)
    wanted = [k for k, output in enumerate(q.outputs) if q.place(output.name) is None]
    begin: Any = q.begin.t
    for spec, guess, mesh, law in zip(problem.specs, guesses, meshes, dynamics, strict=True):
        special = law_of(law.dae if law.freed is None else law.freed, expected, places, wanted)
        phase = _phase(program, problem, spec, mesh, law, special, guess, sizes, begin)
        program.phases.append(phase)
        begin = begin + phase.duration
    _link(program, problem, sizes[0])
    _values(program, problem)
    _ends(program, problem)
    for constraint in (*(() if past else _limits(problem)), *problem.constraints):
        _demand(program, problem, constraint, sizes[2])
    nlp.objective = _inserted(program, problem, ca.MX(0.0) if problem.objective is None else problem.objective)
    return program


def _decisions(nlp: Nlp, q: Quantities, expected: Vector) -> Any:
    """The decided parameters, a column."""
    found = []
    for place, lower, upper, _ in q.decided:
        scale = abs(q.p[place]) or 1.0
        free = nlp.unknown(expected[place] / scale)
        nlp.demand(free, lower / scale, upper / scale)
        found.append(free * scale)
    return ca.vertcat(*found) if found else ca.MX(0, 1)


def _sizes(problem: StatedProblem, guesses: Sequence[PhaseGuess]) -> tuple[Vector, Vector, Vector]:
    """Magnitudes of x, z and u."""
    q = problem.quantities
    seen = [g.at(np.linspace(0.0, 1.0, 51)) for g in guesses]
    found = []
    for k, ports in enumerate((q.x, q.z, q.u)):
        largest = np.max([np.abs(s[k]).max(axis=1, initial=0.0) for s in seen], axis=0)
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
    nlp, basis, count, q = program.nlp, program.basis, len(mesh), problem.quantities
    n = count * basis.degree
    lengths = np.array(mesh.fractions)
    starts = np.concatenate([[0.0], np.cumsum(lengths)[:-1]])
    shares = (starts[:, None] + lengths[:, None] * basis.points).ravel()
    values = _guessed(guess, basis, sizes, (starts, lengths, shares), q)
    if law.algebraic is not None:
        values[1] = np.zeros((0, n))
    else:
        # from far above its solution Newton's method falls below the lowest value of what a block searches
        values[1] = np.minimum(values[1], np.where(np.isfinite(q.low), q.low / sizes[1] + 1.0, np.inf)[:, None])
    nz = len(values[1])
    if law.answers:
        values[1] = np.vstack([values[1], _answered(dynamics, guess, shares, q)])
        sizes = (sizes[0], np.concatenate([sizes[1], np.ones(law.answers)]), sizes[2])
    unknowns = [nlp.unknown(v, *v.shape) for v in values[: 2 if program.past else 3]]
    x, z, *free = (ca.DM(s) * v if v.numel() else v for s, v in zip(sizes, unknowns, strict=False))
    u = free[0] if free else ca.reshape(nlp.parameter(values[2].size), *values[2].shape)
    duration = _duration(nlp, spec, guess)
    at = u @ basis.blocks(basis.bernstein(basis.points), count, 0)
    times = begin + duration * ca.DM(shares).T
    arguments = [times, x[:, 1:], z, at]
    inside = site_of(nlp, q, law, program.w, arguments, n)
    # at the start there are no collocated algebraic variables: those of the first point, for what does not need them
    asked = [v.expression for v in problem.values if v.kind == "start" and problem.specs[v.phase] is spec]
    known = program.steps is None and not law.answers and any(_by_z(problem, e, dynamics, law) for e in asked)
    at_start = ca.DM(sizes[1]) * nlp.unknown(values[1][:, :1], nz, 1) if known else z[:, 0]
    first = site_of(nlp, q, law, program.w, [begin, x[:, 0], at_start, u[:, 0]], 1)
    last = site_of(nlp, q, law, program.w, [begin + duration, x[:, -1], z[:, -1], at[:, -1]], 1)
    ode, alg, _ = inside.equations
    integrals: dict[int, Any] = {}
    if program.steps is None:
        rate = unknowns[0] @ basis.blocks(basis.slopes, count, 1)
        lengthened = np.tile(np.repeat(lengths, basis.degree), (len(q.x), 1))
        nlp.demand(rate - duration * (inside.points.ask(ode / ca.DM(sizes[0])) * ca.DM(lengthened)))
    else:
        borders = (begin + duration * ca.DM(starts).T, duration * ca.DM(lengths).T)
        integrals = _shot(program, problem, spec, law, (borders, x, z, at), sizes[0])
    if z.numel():
        at_guess = [q.begin.t + guess.duration * shares[None, :], *guess.at(shares)]
        at_guess[2] = values[1][:nz] * sizes[1][:nz, None]
        slopes = law.slopes(at_guess, sizes[1][:nz])
        nlp.demand(inside.points.ask(alg / ca.DM(_largest(slopes))))
        if known:
            nlp.demand(first.points.ask(first.equations[1] / ca.DM(_largest(slopes))))
        for k in np.flatnonzero(_ends_below(law, at_guess, sizes[1][:nz], q.low[:nz], slopes)).tolist():
            nlp.demand(unknowns[1][k, :], q.low[k] / sizes[1][k], np.inf)
            if known:
                nlp.demand(at_start[k] / sizes[1][k], q.low[k] / sizes[1][k], np.inf)
    weights = (lengths[:, None] * basis.weights).ravel()
    answers = z[nz:, :]
    z = z[:nz, :] if law.answers else z
    if law.answers:
        _complementary(program, inside, answers, nz)
    if law.algebraic is not None:
        z = law.algebraic.map(n)(times, x[:, 1:], at, ca.repmat(program.w, 1, n))
    places = (inside, first, last)
    numbers = (begin, duration, shares, weights)
    return PhaseProgram(spec, mesh, dynamics, law, x, z, u, *places, *numbers, integrals, answers)


def _largest(slopes: Vector) -> Vector:
    """By how much each algebraic equation changes with z, the magnitude that it is divided by."""
    found = np.nanmax(np.abs(slopes).sum(axis=1), axis=1, initial=0.0)
    return np.where((found > 0.0) & np.isfinite(found), found, 1.0)


def _ends_below(law: Law, at: Sequence[Vector], sizes: Vector, low: Vector, slopes: Vector) -> NDArray[np.bool_]:
    """Which algebraic variables must be kept at or above the lowest value that they have.

    Not those whose equation goes on below as it rises above: its solution is no lower, and where it lies there (a drill
    in air does not cut) a limit beside the equation would leave ipopt no inside.
    """
    found = np.isfinite(low)
    for k in np.flatnonzero(found).tolist():
        n = at[0].shape[1]
        below = [np.tile(v, 2) for v in at]
        below[2][k] = low[k] - np.repeat([1e-3, 1.0], n) * sizes[k]
        there = law.slopes(below, sizes)[k, k]
        found[k] = not (np.sign(there) == np.sign(np.tile(slopes[k, k], 2))).all()
    return found


def _answered(dynamics: Dynamics, guess: PhaseGuess, shares: Vector, q: Quantities) -> Vector:
    """Answers of freed branches in the guess, away from their ends."""
    x, z, u = (ca.DM(v) if v.size else ca.DM(v.shape[0], len(shares)) for v in guess.at(shares))
    n, count = len(shares), dynamics.freed.numel_in(5)
    times = ca.DM(q.begin.t + guess.duration * shares).T
    deciding = dynamics.freed.map(n)(times, x, z, u, ca.repmat(ca.DM(q.p), 1, n), 0.5 * ca.DM.ones(count, n))[3]
    return np.asarray(np.clip(0.5 + 5.0 * np.array(deciding), 0.02, 0.98))


def _complementary(program: Program, inside: Site, answers: Any, nz: int) -> None:
    """An answer y is 1 where what decides it, d, is positive, and 0 where it is negative: y d >= 0 and (1 - y) d <= 0.

    Between, where d rests at 0, the program chooses it, as Filippov's solutions do (the reformulation of steps of
    A. Nurkanovic, M. Diehl, IEEE Control Systems Letters 6 (2022) 3110-3115). Both are relaxed, and tightened from one
    solution to the next (S. Scholtes, SIAM J. Optimization 11 (2001) 918-936).
    """
    nlp = program.nlp
    nlp.demand(answers, 0.0, 1.0)
    y, d = inside.point[2][nz:], inside.equations[2][-inside.law.answers :]
    program.relaxed.append(len(nlp.lower))
    nlp.demand(inside.points.ask(y * d), -1.0, np.inf)
    nlp.demand(inside.points.ask((1 - y) * d), -np.inf, 1.0)


def _shot(
    program: Program, problem: StatedProblem, spec: PhaseSpec, law: Law, unknowns: Any, size: Vector
) -> dict[int, Any]:
    """Demand that intervals end where the next ones begin; the integrals over them."""
    assert program.steps is not None
    (begins, lengths), x, z, at = unknowns
    n, q = lengths.shape[1], problem.quantities
    site = site_of(program.nlp, q, law, program.w, [begins, x[:, :-1], z, at], n)
    h = site.points.with_input(lengths)
    own = [v for v in problem.values if v.kind == "integral" and problem.specs[v.phase] is spec]
    ends, parts = bridge(law, program.steps, site.point, h, [site.integrand(q, v.expression) for v in own])
    after = site.points.ask(ends / ca.DM(size))
    program.nlp.demand(x[:, 1:] / ca.DM(size) - after)
    over = site.points.ask(parts)
    return {key(v.symbol): ca.sum2(over[k, :]) for k, v in enumerate(own)}


def _duration(nlp: Nlp, spec: PhaseSpec, guess: PhaseGuess) -> Any:
    if spec.shortest == spec.longest:
        return ca.MX(spec.shortest)
    scale = guess.duration
    lower, upper = max(spec.shortest / scale, 1e-6), spec.longest / scale
    free = nlp.unknown(min(max(1.0, spec.shortest / scale), upper))
    nlp.demand(free, lower, upper)
    return free * scale


def _guessed(
    guess: PhaseGuess, basis: Basis, sizes: Sequence[Vector], places: tuple[Vector, Vector, Vector], q: Quantities
) -> list[Vector]:
    """The guess of x, z and u, scaled."""
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
    """The start of the first phase, and each end with the start that follows."""
    nlp, q = program.nlp, problem.quantities
    first = program.phases[0].x[:, 0]
    held = [k for k in range(len(q.x)) if k not in problem.free_start and not program.past]
    begin = q.start(program.p) if q.decided else ca.DM(q.first)
    begin = begin if program.first is None else program.first
    if held:
        nlp.demand((first[held] - begin[held]) / ca.DM(size[held]))
    for before, after in zip(program.phases[:-1], program.phases[1:], strict=True):
        last = before.x[:, -1]
        if before.dynamics.jump is not None:
            last = before.last.points.ask(before.dynamics.jump(*before.last.model))
        nlp.demand((after.x[:, 0] - last) / ca.DM(size))


def _values(program: Program, problem: StatedProblem) -> None:
    """Values at ends and integrals, in the order in which they were asked for."""
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
    """The name of a variable in an expression that follows from algebraic variables of the program."""
    q = problem.quantities
    if not len(q.z) or not q.outputs or law.algebraic is not None:
        return None
    by_z = np.array(ca.DM(dynamics.dae.jac_sparsity(2, 2), 1).sparsity().row())
    for k, (output, symbol) in enumerate(zip(q.outputs, q.symbols, strict=True)):
        if k in by_z and q.place(output.name) is None and ca.depends_on(expression, symbol):
            return output.name
    return None


def _check_start(program: Program, problem: StatedProblem, expression: Any, phase: PhaseProgram) -> None:
    name = _by_z(problem, expression, phase.dynamics, phase.law)
    if name is not None and (program.steps is not None or phase.law.answers):
        raise UsageError(
            "AC052",
            f"{name} follows from algebraic equations, which are not solved at the start of a phase",
            help="ask for a state there, or demand it along the phase: phase.subject_to(...); by collocation without "
            "complementarity it is known",
        )


def _ends(program: Program, problem: StatedProblem) -> None:
    """Guards that are zero where their phases end."""
    for phase in program.phases:
        if phase.spec.switch is None:
            continue
        guard = problem.guards[phase.spec.switch]
        if guard.relation is not None:
            value = phase.last.points.ask(phase.dynamics.guard(*phase.last.model))
        else:
            value = along(program, problem, guard.expression, phase.last)
        constraint = Constraint(f"{phase.spec.name} ends: {guard.text}", None, 0.0, 0.0, (), None, 1.0)
        _add(program, constraint, None, value, 1.0, None)


def _limits(problem: StatedProblem) -> list[Constraint]:
    """The declared limits of inputs."""
    everywhere = tuple(range(len(problem.specs)))
    found = []
    for port in problem.quantities.u:
        if np.isfinite(port.min) or np.isfinite(port.max):
            scale = max(abs(v) for v in (port.min, port.max) if np.isfinite(v)) or 1.0
            found.append(
                Constraint(f"limits of {port.name}", None, port.min, port.max, everywhere, port.name, float(scale))
            )
    return found


def _demand(program: Program, problem: StatedProblem, constraint: Constraint, size_u: Vector) -> None:
    q, basis = problem.quantities, program.basis
    if not constraint.phases:
        value = _inserted(program, problem, constraint.expression)
        _add(program, constraint, None, value, constraint.scale, None)
        return
    place = q.place(constraint.variable) if constraint.variable is not None else None
    for number in constraint.phases:
        phase = program.phases[number]
        if place is not None and place[0] == "u":
            lengths = np.array(phase.mesh.fractions)
            starts = np.concatenate([[0.0], np.cumsum(lengths)[:-1]])
            points = (starts[:, None] + lengths[:, None] * basis.nodes).ravel()
            _add(program, constraint, number, place[2] * phase.u[place[1], :], float(size_u[place[1]]), points)
            continue
        row = along(program, problem, constraint.expression, phase.inside)
        _refuse_constant(constraint, phase, row)
        _add(program, constraint, number, row, constraint.scale, phase.shares)


def _refuse_constant(constraint: Constraint, phase: PhaseProgram, row: Any) -> None:
    """Refuse a row of values that is one number all over the phase, and outside of the limits."""
    points = phase.inside.points
    asked = next((a for a, s in zip(points.rows, points.symbols, strict=True) if key(s) == key(row)), None)
    if asked is None or ca.depends_on(asked, points.local):
        return
    value = float(ca.evalf(asked)[0])
    least = 1e-9 * constraint.scale
    if constraint.lower - least <= value <= constraint.upper + least:
        return
    raise UsageError(
        "AC051",
        f"nothing that can be chosen changes what {constraint.name} demands in phase {phase.spec.name}: "
        f"it is {value:g} there",
        where=constraint.where,
        help="demand it of the phases in which it varies: phase = problem.phase(...), phase.subject_to(...)",
    )


def _add(
    program: Program, constraint: Constraint, phase: int | None, value: Any, scale: float, points: Vector | None
) -> None:
    nlp, value = program.nlp, ca.vec(ca.MX(value))
    chosen = [*nlp.unknowns, *(s for one in nlp.points for s in one.symbols)]
    if phase is None and not ca.depends_on(value, ca.veccat(*chosen)):
        raise UsageError(
            "AC051",
            f"nothing that can be chosen changes what {constraint.name} demands",
            where=constraint.where,
            help="leave it out; parameters are numbers until they are decided: problem.decide(name)",
        )
    rows = nlp.demand(value / scale, constraint.lower / scale, constraint.upper / scale)
    program.demands.append(Demand(constraint, phase, rows, scale, points))


def along(program: Program, problem: StatedProblem, expression: Any, site: Site) -> Any:
    """An expression of variables at the instants of a site, shape (m, n)."""
    q, n = problem.quantities, site.points.n
    own = symbols_in(expression)
    used = [k for k, s in enumerate(q.symbols) if key(s) in own]
    if len(used) == 1 and key(q.symbols[used[0]]) == key(expression) and site.places[used[0]] is not None:
        return site.direct(used[0])
    names = [q.symbols[k] for k in used]
    signals = [site.signal(k) for k in used]
    if key(q.time) in own:
        names, signals = [q.time, *names], [site.point[0], *signals]
    numbers = [(s, v) for s, v in zip(*_numbers(program, problem), strict=True) if key(s) in own]
    path = ca.Function("path", [*names, *(s for s, _ in numbers)], [expression]).expand()
    rows = [ca.repmat(value, 1, n) for _, value in numbers]
    if all(_linear(program.nlp, row) for row in rows):
        return site.points.ask(path(*signals, *(site.points.with_input(row) for row in rows)))
    # of numbers that themselves follow from the points
    return path.map(n)(*(site.points.ask(signal) for signal in signals), *rows)


def _linear(nlp: Nlp, row: Any) -> bool:
    """Whether an expression is a linear one of the unknowns alone."""
    own = ca.symvar(row)
    known = {key(s) for s in (*nlp.unknowns, *nlp.parameters)}
    if not all(key(s) in known for s in own):
        return False
    return not own or not any(ca.which_depends(row, ca.veccat(*own), 2, True))


def _numbers(program: Program, problem: StatedProblem) -> tuple[list[Any], list[Any]]:
    """Symbols of numbers that are known so far, and what they are in the program."""
    symbols = [d[3] for d in problem.quantities.decided]
    values = [program.p[d[0]] for d in problem.quantities.decided]
    symbols += problem.durations
    values += [phase.duration for phase in program.phases]
    for value in problem.values:
        if key(value.symbol) in program.known:
            symbols.append(value.symbol)
            values.append(program.known[key(value.symbol)])
    return symbols, values


def _inserted(program: Program, problem: StatedProblem, expression: Any) -> Any:
    """An expression of numbers in terms of the unknowns."""
    symbols, values = _numbers(program, problem)
    return ca.substitute([expression], symbols, values)[0] if symbols else expression
