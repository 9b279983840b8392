"""Equations of every phase, and the state jumps of the events at their ends."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from acausal.analyse.delays import PADE, refuse_delays
from acausal.arrays import Vector
from acausal.errors import OptimizationError
from acausal.export.forms import Form, check
from acausal.lower.build import Symbols
from acausal.lower.compiled import CompiledModel
from acausal.lower.events.impulses import impulses
from acausal.optimal_control.branches import Widths, relax_branches, specialize_branches, switching_branches
from acausal.optimal_control.declare import Guard
from acausal.optimal_control.guess import PhaseGuess
from acausal.optimal_control.optimum.trajectory import PhaseTrajectory, Trajectory
from acausal.optimal_control.problem import StatedProblem
from acausal.optimal_control.program.radau import Dynamics
from acausal.optimal_control.quantities import Quantities

SMOOTH = Form(
    "a problem without phases",
    events=False,
    ends=False,
    instead="end a phase with each event, in their order: problem.phase(until='...') with the relation that "
    "compiled.events.texts lists",
)
# Fractions of a phase at which its branches are evaluated.
_INSIDE = np.linspace(0.02, 0.98, 33)
# Instants per interval at which smoothed rates are compared with exact ones.
_FINE = 200
# Instants per interval at which the condition that ends a phase is evaluated.
_DENSE = 12
# Allowed relative deviation of the states after an event in the guess from the values that its clauses set.
_SAME = 1e-4
# Allowed relative deviation of rates and residuals from those of the model.
_DEVIATION = 1e-6


def dynamics_of(
    problem: StatedProblem, guesses: Sequence[PhaseGuess], widths: Sequence[Widths] = (), free: bool = False
) -> list[Dynamics]:
    """Equations of all phases; `widths` are the smoothing widths of branches by their numbers, for each phase.

    With `free` these branches are not smoothed but relaxed: their selectors become unknowns, and the widths are the
    magnitudes of the quantities that decide them.

    Raises ExportError: AC608 for a model with events if no phase ends with one.
    Raises OptimizationError: AC704 if an event at the end of a phase does more than the clauses of its relation.
    """
    q = problem.quantities
    compiled, dae = q.compiled, q.dae()
    switches = [problem.guards[s.switch].relation if s.switch is not None else None for s in problem.specs]
    _refuse_clocks(compiled)
    if all(k is None for k in switches):
        check(compiled, SMOOTH, q.outputs)
    refuse_delays(compiled.flat, "optimal control", PADE)
    begins = q.begin.t + np.cumsum([0.0, *(guess.duration for guess in guesses)])
    inside = [_arguments(guess, _INSIDE, begin, q.p) for guess, begin in zip(guesses, begins[:-1], strict=True)]
    dynamics = []
    # only the run after the last phase shows which branches its final switch changes
    beyond = [_arguments(g, _INSIDE, begins[-1], q.p) for g in [guesses[-1].following] if g is not None]
    unsmoothed = [dict.fromkeys(own, 0.0) for own in widths]
    laws = specialize_branches(dae, inside, beyond, unsmoothed if free else widths)
    is_smoothed = any(widths) and not free
    exact_laws = specialize_branches(dae, inside, beyond, unsmoothed) if is_smoothed else [None] * len(laws)
    relaxed_laws = [
        relax_branches(dae, [*inside, *beyond], k, widths[k]) if free and k < len(widths) and widths[k] else None
        for k in range(len(laws))
    ]
    for k, (law, exact, relation) in enumerate(zip(laws, exact_laws, switches, strict=True)):
        if relation is None:
            dynamics.append(Dynamics(law, exact=exact, relaxed=relaxed_laws[k]))
            continue
        s = Symbols(compiled)
        arguments = s.inputs[:-1]
        modes = compiled.all_modes(*arguments)
        distance = compiled.events.distances(*arguments, modes)[relation]
        guard = q.coordinates.inside(ca.Function("guard", arguments, [distance]))
        following = guesses[k + 1] if k + 1 < len(guesses) else None
        ends = _arguments(guesses[k], np.array([1.0]), begins[k], q.p)
        jump = _jump(problem, relation, ends, following, problem.specs[k].name)
        dynamics.append(Dynamics(law, guard, jump, exact, relaxed_laws[k]))
    return dynamics


def kinks(problem: StatedProblem, guesses: Sequence[PhaseGuess], smooth: float, often: bool = False) -> list[Widths]:
    """Smoothing widths of the branches taken both ways within each phase; see `switching_branches`."""
    q, dae = problem.quantities, problem.quantities.dae()
    begins = q.begin.t + np.cumsum([0.0, *(guess.duration for guess in guesses)])
    pairs = zip(guesses, begins[:-1], strict=True)
    return [switching_branches(dae, _arguments(guess, _INSIDE, begin, q.p), smooth, often) for guess, begin in pairs]


def bias(laws: Sequence[Dynamics], trajectory: Trajectory) -> tuple[float, float]:
    """Bias of smoothing, of the states and of the variables in the problem, relative to their largest magnitudes.

    That of a state is the integral of the deviation of its rate, that of a variable its mean deviation.
    """
    size = np.max([np.abs(phase.x).max(axis=1, initial=0.0) for phase in trajectory.phases], axis=0)
    integral, of_outputs, whole = np.zeros(len(size)), 0.0, sum(phase.duration for phase in trajectory.phases)
    for phase, law in zip(trajectory.phases, laws, strict=True):
        if law.exact is not None:
            fractions = (np.arange(_FINE * len(phase.mesh)) + 0.5) / (_FINE * len(phase.mesh))
            columns = _arguments(PhaseGuess(phase.duration, phase.at), fractions, phase.begin, trajectory.p)
            (rates, _, y), (exact_rates, _, exact) = _evaluated(law.dae, columns), _evaluated(law.exact, columns)
            integral += phase.duration * np.abs(rates - exact_rates).mean(axis=1)
            largest = np.abs(exact).max(axis=1, initial=0.0)
            share = np.abs(y - exact).mean(axis=1) / np.where(largest > 0.0, largest, 1.0)
            of_outputs = max(of_outputs, phase.duration / whole * float(share.max(initial=0.0)))
    return float((integral / np.where(size > 0.0, size, 1.0)).max(initial=0.0)), of_outputs


def _arguments(guess: PhaseGuess, fractions: Vector, begin: float, p: Vector) -> list[Vector]:
    """Arguments t, x, z, u, p of the equations at n fractions of a phase of the guess, each of shape (rows, n)."""
    x, z, u = guess.at(fractions)
    times = (begin + guess.duration * fractions)[None, :]
    return [times, x, z, u, np.repeat(p[:, None], len(fractions), axis=1)]


def _refuse_clocks(compiled: CompiledModel) -> None:
    """AC704 for sampled models."""
    if compiled.state_events.samples:
        raise OptimizationError(
            "AC704",
            f"{compiled.name} has clocks: phases do not include the changes at samples",
            help="leave the sampled controller out, or make its output an input: acausal.free(model, name)",
        )


def _jump(problem: StatedProblem, relation: int, ends: list[Vector], following: PhaseGuess | None, name: str) -> Any:
    """The map `(t, x, z, u, p) -> x` that the clauses of a relation apply; None if they change nothing.

    `ends` are the arguments at the end of the phase in the guess, each of shape (rows, 1).

    Raises OptimizationError: AC704 if the guess continues from another state.
    """
    q = problem.quantities
    compiled, events = q.compiled, q.compiled.state_events
    s = Symbols(compiled)
    arguments = s.inputs[:-1]
    place = compiled.n_modes - len(events.relations) + relation
    before = compiled.all_modes(*arguments)
    before[place] = 0
    after = ca.SX(before)
    after[place] = 1
    at = [ends[0], q.coordinates.states(ends[1]), *ends[2:]]
    reactions = compiled.events.reactions
    truth = [
        np.array(ca.Function("c", arguments, [reactions(*arguments, m)[2]])(*at)).ravel() > 0.5 for m in (before, after)
    ]
    rising = dict(zip(events.conditions, (truth[1] & ~truth[0]).tolist(), strict=True))
    is_true = dict(zip(events.conditions, truth[1].tolist(), strict=True))
    _, assigned, _, values, _, _ = reactions(*arguments, after)
    new, k = ca.SX(s.x), 0
    with_impulse, acting = {a for a, _ in impulses(compiled)}, list[int]()
    for clause in events.clauses:
        acts = any(rising[c] for c in clause.conditions) and not any(is_true[c] for c in clause.earlier)
        for position, _ in clause.actions:
            if acts and k in with_impulse:
                acting.append(k)
            elif acts:
                new[position] = values[k]
            k += 1
    if acting:
        new += compiled.events.struck(acting)(*arguments, after)
    for j, assignment in enumerate(events.assignments):
        new[assignment.position] = assigned[j]
    jump = _in_coordinates(q, ca.Function("jump", arguments, [new]))
    found = np.array(jump(*ends)).ravel()
    if following is not None:
        _check_guess(q, found, following, ends, name)
    return jump if not ca.is_equal(new, s.x, 3) else None


def _in_coordinates(q: Quantities, jump: Any) -> Any:
    """A jump of the states as one of the coordinates; angles stay, because an event only changes their rates."""
    kept, n = len(q.coordinates.kept), q.coordinates.angles
    if not n:
        return jump
    inside = q.coordinates.inside(jump)
    arguments = [ca.SX.sym(inside.name_in(k), inside.numel_in(k)) for k in range(inside.n_in())]
    after = q.coordinates.reduce(inside(*arguments))
    angles = arguments[1][kept : kept + n]
    return ca.Function("jump", arguments, [ca.vertcat(after[:kept], angles, after[kept + n :])])


def _check_guess(q: Quantities, found: Vector, following: PhaseGuess, ends: list[Vector], name: str) -> None:
    """AC704 if the run of the guess continues from a state other than the clauses set."""
    x = following.at(np.array([0.0]))[0].ravel()
    size = np.maximum(np.abs(ends[1]).ravel(), q.x.nominal)
    deviation = np.abs(x - found) / size
    if deviation.max(initial=0.0) > _SAME:
        k = int(np.argmax(deviation))
        raise OptimizationError(
            "AC704",
            f"more happens at the end of phase '{name}' than its event states",
            evidence=[f"{q.x.names[k]} continues from {x[k]:.6g}; its clauses set {found[k]:.6g}"],
            cause="events that trigger others at the same instant",
            help="problems with such events are refused: combine them in one `when` of the model",
        )


def check_optimum(problem: StatedProblem, laws: Sequence[Dynamics], trajectory: Trajectory) -> None:
    """Check that an optimum takes the branches of the model, and that no event lies inside a phase.

    Raises OptimizationError: AC706 for branches, AC704 for events inside a phase.
    """
    dae = problem.quantities.dae()
    for spec, phase, law in zip(problem.specs, trajectory.phases, laws, strict=True):
        columns = _collocated(phase, trajectory.p)
        if spec.switch is not None:
            _check_end(problem, problem.guards[spec.switch], law, phase, trajectory.p)
        if law.dae is not dae:
            _check_branches(problem, dae, law, phase, columns)
        if problem.quantities.compiled.state_events.clauses:
            _check_events(problem, phase, columns)
        _check_instants(problem, dae, phase, trajectory.p)


def _check_end(problem: StatedProblem, guard: Guard, law: Dynamics, phase: PhaseTrajectory, p: Vector) -> None:
    """AC704 if the condition that ends a phase becomes true inside it, or turns false at its end."""
    # between collocation points as well, where a path constraint does not keep the condition false
    count = _DENSE * len(phase.mesh)
    columns = _arguments(PhaseGuess(phase.duration, phase.at), (np.arange(count) + 0.5) / count, phase.begin, p)
    (values,) = _evaluated(_guard_function(problem.quantities, guard, law), columns)
    holds = values[0] > _DEVIATION * float(np.abs(values).max(initial=0.0))
    rising = np.flatnonzero(holds[1:] & ~holds[:-1]) + 1
    if len(rising) or holds[-1:].any():
        first = int(rising[0]) if len(rising) else 0
        raise OptimizationError(
            "AC704",
            f"{phase.name} ends with {guard.text}, which holds inside it, at t = {columns[0][0, first]:.4g} s",
            cause="the end of a phase is the first instant at which its condition becomes true",
            help="keep it false inside, and rising at the end: phase.subject_to(...); or divide the phase there",
        )


def _guard_function(q: Quantities, guard: Guard, law: Dynamics) -> Any:
    """The function `(t, x, z, u, p) -> g` that is positive where the condition of a guard holds."""
    if guard.relation is not None:
        return law.guard
    point = [ca.SX.sym(law.dae.name_in(k), law.dae.numel_in(k)) for k in range(5)]
    outputs = ca.vertsplit(law.dae(*point)[2]) if q.symbols else []
    decided = [point[4][place] for place, *_ in q.decided]
    of_symbols = ca.Function("of", [q.time, *q.symbols, *(d[3] for d in q.decided)], [guard.expression]).expand()
    return ca.Function("guard", point, [ca.densify(of_symbols(point[0], *outputs, *decided))])


def _check_instants(problem: StatedProblem, dae: Any, phase: PhaseTrajectory, p: Vector) -> None:
    """AC704 if rates jump inside a phase at an instant of a source; kinks only need a finer mesh."""
    instants = np.unique(np.array(problem.quantities.compiled.instants(p)).ravel())
    fractions = (instants - phase.begin) / phase.duration
    for t, at in zip(instants, fractions, strict=True):
        if not 1e-6 < at < 1 - 1e-6:
            continue
        x, z, u = phase.at(np.array([at]))
        before, after = (np.array(dae(t + side * 1e-9 * phase.duration, x, z, u, p)[0]).ravel() for side in (-1, 1))
        size = np.maximum(np.abs(before), np.abs(after))
        jumps = np.flatnonzero(np.abs(after - before) > _DEVIATION * size)
        if len(jumps):
            k = int(jumps[0])
            raise OptimizationError(
                "AC704",
                f"the model switches inside {phase.name}, at t = {t:.6g} s",
                evidence=[f"the rate of {problem.quantities.x.names[k]} goes from {before[k]:.6g} to {after[k]:.6g}"],
                help=f"end a phase there: problem.phase(until=problem.time >= {t:.6g})",
            )


def _collocated(phase: PhaseTrajectory, p: Vector) -> list[Vector]:
    """Arguments of the equations at the collocation points, except the last, which lies on the guard of the phase."""
    points = phase.basis.points
    at = [phase.interval(k, points) for k in range(len(phase.mesh))]
    times = np.concatenate([phase.time(k, points) for k in range(len(phase.mesh))])[None, :-1]
    x, z, u = (np.hstack([a[k] for a in at])[:, :-1] for k in range(3))
    return [times, x, z, u, np.repeat(p[:, None], times.shape[1], axis=1)]


def _evaluated(function: Any, columns: Sequence[Vector]) -> list[Vector]:
    """Results of a function at n instants, each of shape (rows, n)."""
    n = columns[0].shape[1]
    given = [ca.DM(c) if c.size else ca.DM(c.shape[0], n) for c in columns]
    found = function.map(n)(*given)
    return [np.array(v) for v in (found if isinstance(found, tuple | list) else [found])]


def _check_branches(
    problem: StatedProblem, dae: Any, law: Dynamics, phase: PhaseTrajectory, columns: list[Vector]
) -> None:
    """AC706 if rates, residuals or outputs of the phase deviate from those of the model."""
    q = problem.quantities
    names = (q.x.names, q.z.names, tuple(o.name for o in q.outputs))
    words = ("the rate of {}", "the equation of {}", "{}")
    decided = law.dae if law.exact is None else law.exact
    for solved, model, group, text in zip(
        _evaluated(decided, columns), _evaluated(dae, columns), names, words, strict=True
    ):
        size = np.maximum(np.abs(model).max(axis=1, initial=0.0), np.abs(solved).max(axis=1, initial=0.0))[:, None]
        deviation = np.abs(solved - model) / np.where(size > 0.0, size, 1.0)
        if deviation.max(initial=0.0) > _DEVIATION or not np.isfinite(deviation).all():
            k, j = np.unravel_index(int(np.argmax(np.nan_to_num(deviation, nan=np.inf))), deviation.shape)
            t = float(columns[0][0, j])
            raise OptimizationError(
                "AC706",
                f"{phase.name} leaves the branch on which it was solved, at t = {t:.6g} s",
                evidence=[f"{text.format(group[k])} is {model[k, j]:.6g} there, but was assumed {solved[k, j]:.6g}"],
                cause="a switch inside the phase: the order of the switches differs from that in the guess",
                help="end a phase with the switch, or avoid it: phase.subject_to(...); if the order is free, round it: "
                "solve(smooth=1e-3)",
            )


def _check_events(problem: StatedProblem, phase: PhaseTrajectory, columns: list[Vector]) -> None:
    """AC704 if a clause with actions becomes active between two collocation points."""
    compiled = problem.quantities.compiled
    s = Symbols(compiled)
    arguments = s.inputs[:-1]
    conditions = compiled.events.reactions(*arguments, compiled.all_modes(*arguments))[2]
    inside = problem.quantities.coordinates.inside(ca.Function("conditions", arguments, [conditions]))
    (truth,) = _evaluated(inside, columns)
    rising = (truth[:, 1:] > 0.5) & (truth[:, :-1] < 0.5)
    for clause in compiled.state_events.clauses:
        places = [compiled.state_events.conditions.index(c) for c in clause.conditions]
        seen = np.flatnonzero(rising[places].any(axis=0))
        if len(seen) and clause.actions:
            raise OptimizationError(
                "AC704",
                f"an event happens inside {phase.name}, at about t = {columns[0][0, seen[0] + 1]:.4g} s: {clause.text}",
                where=(clause.where,),
                help="end a phase with it, or avoid it: phase.subject_to(...)",
            )
