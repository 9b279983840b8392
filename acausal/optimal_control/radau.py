"""The nonlinear program of a problem: Radau collocation in all phases, on CasADi's Opti.

Unknowns are divided by their magnitudes: declared nominals, limits of inputs, else the largest value in the guess.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from acausal.errors import UsageError
from acausal.optimal_control.declare import Constraint, Mesh, PhaseSpec
from acausal.optimal_control.guess import PhaseGuess
from acausal.optimal_control.law import Law, law_of
from acausal.optimal_control.polynomials import Basis
from acausal.optimal_control.problem import Problem
from acausal.optimal_control.quantities import Quantities, magnitude
from acausal.optimal_control.shooting import Steps, bridge

Vector = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Dynamics:
    """What holds within a phase, and what happens at its end.

    Attributes
    ----------
    dae
        `(t, x, z, u, p) -> (ode, alg, y)`.
    guard
        `(t, x, z, u, p) -> g`, zero at the end of the phase; None without a switch of the model.
    jump
        `(t, x, z, u, p) -> x` after the end; None where nothing jumps.
    """

    dae: Any
    guard: Any = None
    jump: Any = None


@dataclass(frozen=True, eq=False)
class PhaseProgram:
    """Unknowns of one phase in SI units; columns are instants.

    Attributes
    ----------
    x
        States at the start and at the collocation points, shape (nx, n + 1).
    z
        Algebraic variables at the collocation points, shape (nz, n).
    u
        Bernstein coefficients of the inputs, shape (nu, intervals * (control + 1)).
    at
        Inputs at the collocation points, shape (nu, n).
    y
        What was asked for at the collocation points, shape (ny, n); `y_start`, (ny,), at the start.
    begin, duration
        Time of the start and duration [s].
    shares
        The collocation points as shares of the phase, shape (n,); `weights` those of the quadrature.
    integrals
        With shooting, the integrals over the phase by the symbols that stand for them.
    """

    spec: PhaseSpec
    mesh: Mesh
    dynamics: Dynamics
    law: Law
    x: Any
    z: Any
    u: Any
    at: Any
    y: Any
    y_start: Any
    begin: Any
    duration: Any
    shares: Vector
    weights: Vector
    integrals: dict[int, Any] = field(default_factory=dict)

    @property
    def times(self) -> Any:
        """Times of the collocation points [s], a row."""
        return self.begin + self.duration * ca.DM(self.shares).T


@dataclass(frozen=True, eq=False)
class Demand:
    """A constraint as it stands in the program; `points` are its places as shares of the phase, None for a number."""

    constraint: Constraint
    phase: int | None
    relation: Any
    value: Any
    scale: float
    points: Vector | None


@dataclass(frozen=True, eq=False)
class Program:
    """The whole program, and where everything is in it."""

    opti: Any
    basis: Basis
    p: Any
    phases: list[PhaseProgram]
    w: Any
    demands: list[Demand] = field(default_factory=list)
    ports: tuple[Any, Any] = ((), ())
    first: Any = None
    initial: list[Vector] = field(default_factory=list)
    steps: Steps | None = None
    known: dict[int, Any] = field(default_factory=dict)


def transcribed(
    problem: Problem,
    dynamics: Sequence[Dynamics],
    guesses: Sequence[PhaseGuess],
    meshes: Sequence[Mesh],
    basis: Basis,
    expected: Vector,
    varying: Sequence[int] | None = None,
    steps: Steps | None = None,
) -> Program:
    """The program of a problem on meshes, with its guess; `expected` are the parameters in it, shape (np,).

    `varying` leaves the first states and the parameters at these places open, as parameters of the program.
    With `steps` intervals are bridged by them instead, from border to border.

    Raises
    ------
    UsageError
        AC052 for values at a start that are not known there.
    """
    opti, q = ca.Opti(), problem.quantities
    places = [d[0] for d in q.decided] if varying is None else list(varying)
    w = _decisions(opti, q, expected) if varying is None else opti.parameter(len(places))
    p = ca.MX(ca.DM(expected))
    for k, place in enumerate(places):
        p[place] = w[k]
    first = opti.parameter(len(q.x)) if varying is not None else None
    sizes = _sizes(problem, guesses)
    program = Program(opti, basis, p, [], w, ports=(q.x, q.u), first=first, steps=steps)
    wanted = [k for k, output in enumerate(q.outputs) if q.place(output.name) is None]
    begin: Any = q.begin.t
    for spec, guess, mesh, law in zip(problem.specs, guesses, meshes, dynamics, strict=True):
        special = law_of(law.dae, expected, places, wanted)
        phase = _phase(program, problem, spec, mesh, law, special, guess, sizes, begin)
        program.phases.append(phase)
        begin = begin + phase.duration
    _link(program, problem, sizes[0])
    _values(program, problem)
    _ends(program, problem)
    for constraint in (*_limits(problem), *problem.constraints):
        _demand(program, problem, constraint, sizes[2])
    opti.minimize(_inserted(program, problem, problem.objective))
    return program


def _decisions(opti: Any, q: Quantities, expected: Vector) -> Any:
    """The decided parameters, a column."""
    found = []
    for place, lower, upper, _ in q.decided:
        scale = abs(q.p[place]) or 1.0
        free = opti.variable()
        opti.subject_to(opti.bounded(lower / scale, free, upper / scale))
        opti.set_initial(free, expected[place] / scale)
        found.append(free * scale)
    return ca.vertcat(*found) if found else ca.MX(0, 1)


def _sizes(problem: Problem, guesses: Sequence[PhaseGuess]) -> tuple[Vector, Vector, Vector]:
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
    problem: Problem,
    spec: PhaseSpec,
    mesh: Mesh,
    dynamics: Dynamics,
    law: Law,
    guess: PhaseGuess,
    sizes: tuple[Vector, Vector, Vector],
    begin: Any,
) -> PhaseProgram:
    opti, basis, count, q = program.opti, program.basis, len(mesh), problem.quantities
    n = count * basis.degree
    lengths = np.array(mesh.fractions)
    starts = np.concatenate([[0.0], np.cumsum(lengths)[:-1]])
    shares = (starts[:, None] + lengths[:, None] * basis.points).ravel()
    scaled_x = opti.variable(len(q.x), n + 1)
    scaled_z = opti.variable(0 if law.algebraic is not None else len(q.z), n)
    scaled_u = opti.variable(len(q.u), count * (basis.control + 1))
    x, z, u = (ca.DM(s) * v if v.numel() else v for s, v in zip(sizes, (scaled_x, scaled_z, scaled_u), strict=True))
    duration = _duration(opti, spec, guess)
    at = u @ basis.blocks(basis.bernstein(basis.points), count, 0)
    times = begin + duration * ca.DM(shares).T
    w = ca.repmat(program.w, 1, n)
    ode, alg, y = law.equations.map(n)(times, x[:, 1:], z, at, w)
    integrals: dict[int, Any] = {}
    if program.steps is None:
        lengthened = ca.diag(ca.DM(np.repeat(lengths, basis.degree)))
        rate = scaled_x @ basis.blocks(basis.slopes, count, 1)
        opti.subject_to(ca.vec(rate - duration * ((ode / ca.DM(sizes[0])) @ lengthened)) == 0)
    else:
        own = [v for v in problem.values if v.kind == "integral" and problem.specs[v.phase] is spec]
        across = bridge(q, law, program.steps, [v.expression for v in own]).map(n)
        begins = begin + duration * ca.DM(starts).T
        ends, parts = across(begins, duration * ca.DM(lengths).T, x[:, :-1], z, at, w)
        opti.subject_to(ca.vec((x[:, 1:] - ends) / ca.DM(sizes[0])) == 0)
        integrals = {_key(v.symbol): ca.sum2(parts[k, :]) for k, v in enumerate(own)}
    if z.numel():
        opti.subject_to(ca.vec(alg) == 0)
    places = (starts, lengths, shares)
    program.initial.extend(_initial(opti, guess, basis, (scaled_x, scaled_z, scaled_u), sizes, places, q))
    y, y_start = _asked(q, law, (x, z, u, at, y), begin, program.w)
    if law.algebraic is not None:
        z = law.algebraic.map(n)(times, x[:, 1:], at, w)
    weights = (lengths[:, None] * basis.weights).ravel()
    return PhaseProgram(spec, mesh, dynamics, law, x, z, u, at, y, y_start, begin, duration, shares, weights, integrals)


def _duration(opti: Any, spec: PhaseSpec, guess: PhaseGuess) -> Any:
    if spec.shortest == spec.longest:
        return ca.MX(spec.shortest)
    scale = guess.duration
    free = opti.variable()
    opti.subject_to(opti.bounded(max(spec.shortest / scale, 1e-6), free, spec.longest / scale))
    opti.set_initial(free, min(max(1.0, spec.shortest / scale), spec.longest / scale))
    return free * scale


def _initial(
    opti: Any, guess: PhaseGuess, basis: Basis, unknowns: Any, sizes: Any, places: tuple[Vector, Vector, Vector], q: Any
) -> list[Vector]:
    """Set the guess of x, z and u; it is returned scaled, in the order of the unknowns."""
    starts, lengths, shares = places
    x, _, _ = guess.at(np.concatenate([[0.0], shares]))
    _, z, _ = guess.at(shares)
    nodes = (starts[:, None] + lengths[:, None] * basis.nodes).ravel()
    _, _, u = guess.at(nodes)
    inverse = np.linalg.inv(basis.bernstein(basis.nodes))
    u = u @ np.kron(np.eye(len(lengths)), inverse)
    u = np.clip(u, np.array(q.u.min)[:, None], np.array(q.u.max)[:, None])
    scaled = []
    for unknown, values, size in zip(unknowns, (x, z, u), sizes, strict=True):
        if unknown.numel():
            scaled.append(values / size[:, None])
            opti.set_initial(unknown, scaled[-1])
    return [values.ravel(order="F") for values in scaled]


def _asked(q: Quantities, law: Law, unknowns: Any, begin: Any, w: Any) -> tuple[Any, Any]:
    """What was asked for at the points and at the start; states and inputs directly, for they are linear then."""
    x, z, u, at, y = unknowns
    if not q.outputs:
        return ca.MX(0, at.shape[1]), ca.MX(0, 1)
    # at the start there are no collocated algebraic variables: those of the first point, for what does not need them
    first = law.equations(begin, x[:, 0], z[:, 0] if z.numel() else ca.MX(0, 1), u[:, 0], w)[2]
    rows, column = [], []
    for k, output in enumerate(q.outputs):
        place = q.place(output.name)
        if place is None:
            rows.append(y[law.wanted.index(k), :])
            column.append(first[law.wanted.index(k)])
        else:
            vector, number, sign = place
            rows.append(sign * (x[number, 1:] if vector == "x" else at[number, :]))
            column.append(sign * (x[number, 0] if vector == "x" else u[number, 0]))
    return ca.vertcat(*rows), ca.vertcat(*column)


def _link(program: Program, problem: Problem, size: Vector) -> None:
    """The start of the first phase, and each end with the start that follows."""
    opti, q = program.opti, problem.quantities
    first = program.phases[0].x[:, 0]
    held = [k for k in range(len(q.x)) if k not in problem.free_start]
    begin = q.start(program.p) if q.decided else ca.DM(q.first)
    begin = begin if program.first is None else program.first
    if held:
        opti.subject_to((first[held] - begin[held]) / ca.DM(size[held]) == 0)
    for before, after in zip(program.phases[:-1], program.phases[1:], strict=True):
        last = before.x[:, -1]
        if before.dynamics.jump is not None:
            last = before.dynamics.jump(*_last(program, before))
        opti.subject_to((after.x[:, 0] - last) / ca.DM(size) == 0)


def _last(program: Program, phase: PhaseProgram) -> list[Any]:
    """Arguments of the equations at the end of a phase."""
    time = phase.begin + phase.duration
    return [time, phase.x[:, -1], phase.z[:, -1], phase.at[:, -1], program.p]


def _values(program: Program, problem: Problem) -> None:
    """Values at ends and integrals, in the order in which they were asked for."""
    for value in problem.values:
        phase = program.phases[value.phase]
        if _key(value.symbol) in phase.integrals:
            found = phase.integrals[_key(value.symbol)]
        elif value.kind == "integral":
            row = along(program, problem, value.expression, phase.times, phase.y)
            found = phase.duration * (row @ ca.DM(phase.weights))
        elif value.kind == "end":
            time = phase.begin + phase.duration
            found = along(program, problem, value.expression, time, phase.y[:, -1])
        else:
            _check_start(problem, value.expression, phase)
            found = along(program, problem, value.expression, phase.begin, phase.y_start)
        program.known[_key(value.symbol)] = found


def _check_start(problem: Problem, expression: Any, phase: PhaseProgram) -> None:
    q = problem.quantities
    if not len(q.z) or not q.outputs or phase.law.algebraic is not None:
        return
    by_z = np.array(ca.DM(phase.dynamics.dae.jac_sparsity(2, 2), 1).sparsity().row())
    for k, (output, symbol) in enumerate(zip(q.outputs, q.symbols, strict=True)):
        if k in by_z and q.place(output.name) is None and ca.depends_on(expression, symbol):
            raise UsageError(
                "AC052",
                f"{output.name} follows from algebraic equations, which are not solved at the start of a phase",
                help="ask for a state there, or demand it along the phase: phase.subject_to(...)",
            )


def _ends(program: Program, problem: Problem) -> None:
    """Guards that are zero where their phases end."""
    for phase in program.phases:
        if phase.spec.switch is None:
            continue
        guard = problem.guards[phase.spec.switch]
        if guard.relation is not None:
            value = phase.dynamics.guard(*_last(program, phase))
        else:
            time = phase.begin + phase.duration
            value = along(program, problem, guard.expression, time, phase.y[:, -1])
        constraint = Constraint(f"{phase.spec.name} ends: {guard.text}", None, 0.0, 0.0, (), None, 1.0)
        _add(program, constraint, None, value, 1.0, None)


def _limits(problem: Problem) -> list[Constraint]:
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


def _demand(program: Program, problem: Problem, constraint: Constraint, size_u: Vector) -> None:
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
        if place is not None:
            row = place[2] * phase.x[place[1], 1:]
        else:
            row = along(program, problem, constraint.expression, phase.times, phase.y)
        _add(program, constraint, number, row, constraint.scale, phase.shares)


def _add(
    program: Program, constraint: Constraint, phase: int | None, value: Any, scale: float, points: Vector | None
) -> None:
    opti = program.opti
    value = ca.vec(ca.MX(value))
    if phase is None and not ca.depends_on(value, opti.x):
        raise UsageError(
            "AC051",
            f"nothing that can be chosen changes what {constraint.name} demands",
            where=constraint.where,
            help="leave it out; parameters are numbers until they are decided: problem.decide(name)",
        )
    scaled, lower, upper = value / scale, constraint.lower / scale, constraint.upper / scale
    relation = scaled == lower if lower == upper else opti.bounded(lower, scaled, upper)
    opti.subject_to(relation)
    program.demands.append(Demand(constraint, phase, relation, value, scale, points))


def along(program: Program, problem: Problem, expression: Any, times: Any, y: Any) -> Any:
    """An expression of variables at instants: `times` (1, n) and `y` (ny, n) give (m, n)."""
    q = problem.quantities
    numbers, values = _numbers(program, problem)
    n = times.numel() if hasattr(times, "numel") else 1
    own = ca.symvar(expression)
    rows = [(q.time, times), *((symbol, y[k, :]) for k, symbol in enumerate(q.symbols))]
    rows += [(symbol, ca.repmat(value, 1, n)) for symbol, value in zip(numbers, values, strict=True)]
    used = [(s, row) for s, row in rows if any(ca.is_equal(s, v) for v in own)]
    if len(used) == 1 and ca.is_equal(used[0][0], expression):
        return used[0][1]
    # of scalars and of what it needs alone, for derivatives of long lists of arguments cost more than its operations
    path = ca.Function("path", [s for s, _ in used], [expression]).expand()
    return path.map(n)(*(row for _, row in used)) if n > 1 else path(*(row for _, row in used))


def _numbers(program: Program, problem: Problem) -> tuple[list[Any], list[Any]]:
    """Symbols of numbers that are known so far, and what they are in the program."""
    symbols = [d[3] for d in problem.quantities.decided]
    values = [program.p[d[0]] for d in problem.quantities.decided]
    symbols += problem.durations
    values += [phase.duration for phase in program.phases]
    for value in problem.values:
        if _key(value.symbol) in program.known:
            symbols.append(value.symbol)
            values.append(program.known[_key(value.symbol)])
    return symbols, values


def _inserted(program: Program, problem: Problem, expression: Any) -> Any:
    """An expression of numbers in terms of the unknowns."""
    symbols, values = _numbers(program, problem)
    return ca.substitute([expression], symbols, values)[0] if symbols else expression


def _key(symbol: Any) -> int:
    return int(symbol.__hash__())
