"""`Optimum`: the trajectories of a solution by name, its multipliers and inputs, and its replay by simulation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from acausal.arrays import Vector
from acausal.lower.build import Symbols
from acausal.lower.casadi_model import Port, Ports
from acausal.lower.compiled import CompiledModel
from acausal.optimal_control.optimum.trajectory import PhaseTrajectory, Trajectory
from acausal.optimal_control.problem import StatedProblem
from acausal.optimal_control.program.nlp import Solution
from acausal.optimal_control.program.radau import ConstraintRows, Program
from acausal.optimal_control.quantities import Quantities
from acausal.providers import provided
from acausal.result.result import Event, Result
from acausal.result.series import TimeSeries
from acausal.simulate.record.record import Described
from acausal.simulate.run import simulate

if TYPE_CHECKING:
    from matplotlib.figure import Figure


# A constraint is active within this distance of its limit, relative to its magnitude.
_NEAR = 1e-3
_NEWTON_STEPS = 4
# Points within the first distance of an event are at it; events within the second distance of each other coincide. Both
# are relative to the duration of all phases.
_AT_EVENT, _SAME_EVENT = 1e-6, 1e-3
# An input that varies by less than this fraction of its magnitude is constant.
_ROUNDING = 1e-9


@dataclass(frozen=True, eq=False, repr=False)
class Multiplier:
    """Lagrange multiplier of a constraint.

    Attributes
    ----------
    name
        Name of the constraint.
    time
        Times [s] of its points, shape (n,); empty for a single constraint.
    value
        Derivative of the objective by the limit at each point, shape (n,); negative if the lower limit is active.
        Divided by the length of the interval it approximates a density over time.
    active
        Whether the constraint is at a limit at each point, shape (n,).
    phase
        Name of the phase of each point; "" for a single constraint.
    variable
        Name of the bounded scalar, None for an expression.
    level
        Value of the bounded quantity at each point, shape (n,).
    lower, upper, scale
        Its limits, and the magnitude relative to which they count as active.
    """

    name: str
    time: Vector
    value: Vector
    active: NDArray[np.bool_]
    phase: tuple[str, ...]
    variable: str | None
    level: Vector
    lower: float
    upper: float
    scale: float

    def holds(self, values: Vector) -> NDArray[np.bool_]:
        """Mask of the values of the bounded quantity at which a limit is active, of the same shape."""
        return _at_limit(values, self.lower, self.upper, self.scale)

    def __repr__(self) -> str:
        return f"Multiplier({self.name}: active at {self.active.sum()} of {len(self.level)} points)"


@dataclass(frozen=True, eq=False, repr=False)
class Optimum(Result):
    """Solution of an optimal-control problem: a result with objective, multipliers, inputs and phases.

    Attributes
    ----------
    objective
        Minimal value of the objective.
    multipliers
        Multipliers by the names of the constraints.
    inputs
        The optimal inputs, for `simulate(inputs=...)`.
    start
        Optimal start values of states that differ from those of the model.
    parameters
        Values of decided and given parameters, by name.
    phases
        `(name, begin, end)` of every phase [s].
    compiled
        The model.
    """

    objective: float = np.nan
    multipliers: Mapping[str, Multiplier] = field(default_factory=dict)
    inputs: Mapping[str, TimeSeries | float] = field(default_factory=dict)
    start: Mapping[str, float] = field(default_factory=dict)
    parameters: Mapping[str, float] = field(default_factory=dict)
    phases: tuple[tuple[str, float, float], ...] = ()
    compiled: CompiledModel | None = None

    def replay(self, *, tolerance: float = 1e-8, solver: str = "idas", **options: Any) -> Result:
        """Simulate the model with the optimal inputs, parameters and start values; options as for `simulate`."""
        assert self.compiled is not None, "made by Problem.solve"
        return simulate(
            self.compiled,
            inputs=self.inputs,
            start=self.start,
            parameters=self.parameters,
            start_time=float(self.time[0]),
            stop_time=float(self.time[-1]),
            tolerance=tolerance,
            solver=solver,
            **options,
        )

    def error(self, replay: Result) -> dict[str, float]:
        """Largest deviation of every state from a replay at the mesh points, relative to its largest magnitude."""
        assert self.compiled is not None, "made by Problem.solve"
        found = np.nanmax(np.abs(self.distances(replay)), axis=1, initial=0.0)
        return dict(zip(self.compiled.continuous, found.tolist(), strict=True))

    def distances(self, replay: Result) -> Vector:
        """Deviations of the states from a replay at the mesh points, shape (states, points); nan at events.

        They are relative to the largest magnitudes of the states.
        """
        assert self.compiled is not None, "made by Problem.solve"
        found = np.full((len(self.compiled.continuous), len(self.time)), np.nan)
        keep = self.away_from_events(replay)
        for k, name in enumerate(self.compiled.continuous):
            optimal, replayed = self[name], np.asarray(replay.at(self.time, name))
            found[k, keep] = ((optimal - replayed) / (float(np.abs(optimal).max()) or 1.0))[keep]
        return found

    def away_from_events(self, replay: Result, times: Vector | None = None) -> NDArray[np.bool_]:
        """Mask of n times, by default the mesh points, away from events, at which states have two values."""
        return _off_events(self.time if times is None else times, self.events, replay.events)

    def active(self, phase: str, share: float = 0.0) -> tuple[str, ...]:
        """Names of the constraints active at more than `share` of the points of a phase, the most active first."""
        shares = {}
        for m in self.held:
            own = np.array([name == phase for name in m.phase])
            if own.any():
                shares[m.name] = float(m.active[own].mean())
        return tuple(sorted((n for n, s in shares.items() if s > share), key=lambda n: -shares[n]))

    def plot(self, *names: str, **options: Any) -> Figure:
        """Plot signals with active limits marked; by default the inputs and the variables with active limits.

        Options are `file` and `title`; with any other option of `plot`, limits are not marked.
        """
        if set(options) - {"file", "title"}:
            return super().plot(*names, **options)
        drawing: Figure = provided("draw_optimum")(self, names, options.get("file"), options.get("title"))
        return drawing

    @property
    def held(self) -> tuple[Multiplier, ...]:
        """Multipliers of path constraints."""
        return tuple(m for m in self.multipliers.values() if len(m.time))

    def __repr__(self) -> str:
        return f"Optimum({super().__repr__()[7:-1]}, objective {self.objective:.8g})"


def _off_events(times: Vector, own: tuple[Event, ...], others: tuple[Event, ...]) -> NDArray[np.bool_]:
    """Mask of the times away from the jumps in the replay, and not between such a jump and its end of phase."""
    span = float(np.ptp(times))
    ends = np.array([e.time for e in own])
    keep = np.ones(len(times), dtype=bool)
    for t in [e.time for e in others if e.changed]:
        low = high = t
        if len(ends) and np.abs(ends - t).min() < _SAME_EVENT * span:
            low, high = sorted((t, float(ends[np.abs(ends - t).argmin()])))
        keep &= (times < low - _AT_EVENT * span) | (times > high + _AT_EVENT * span)
    return keep


def optimum_of(
    problem: StatedProblem, program: Program, solution: Solution, trajectory: Trajectory, input_sizes: Vector
) -> Optimum:
    """The optimum of a problem from the solution of its program; `input_sizes` are magnitudes of u, shape (nu,)."""
    q, compiled = problem.quantities, problem.quantities.model
    times, x, z, u = _rows(trajectory)
    multipliers = _multipliers(program, solution, trajectory)
    spans = tuple((phase.name, phase.begin, phase.begin + phase.duration) for phase in trajectory.phases)
    events = tuple(
        Event(end, problem.guards[spec.switch].text if spec.switch is not None else f"end of {name}")
        for (name, _, end), spec in zip(spans[:-1], problem.specs[:-1], strict=True)
    )
    declared = np.array(compiled.parameter_values)
    names = q.parameters.names
    rate = "stabilisation.rate"
    changed = {n: float(v) for n, v, d in zip(names, trajectory.p, declared, strict=True) if v != d and n != rate}
    begin = q.first if not q.decided else np.array(q.start(ca.DM(trajectory.p))).ravel()
    free = list(problem.free_start)
    first = np.array(begin)
    first[free] = trajectory.phases[0].x[free, 0]  # the others are those of the model up to rounding errors
    pair = (q.coordinates.states(v[:, None]).ravel() for v in (first, begin))
    start = {n: float(a) for n, a, b in zip(q.states.names, *pair, strict=True) if a != b}
    x = q.coordinates.states(x)
    return Optimum(
        model=compiled.name,
        time=times,
        trajectories=lambda: _observed(compiled, times, x, z, u, trajectory.p),
        signals=Described(compiled, trajectory.p),
        events=events,
        dense=(lambda at: _dense(q, trajectory, at)) if program.steps is None else None,
        objective=solution.objective,
        multipliers=multipliers,
        inputs=_inputs(q.u, trajectory, input_sizes),
        start=start,
        parameters=changed,
        phases=spans,
        compiled=compiled,
    )


def _rows(trajectory: Trajectory) -> tuple[Vector, Vector, Vector, Vector]:
    """t, shape (n,), and x, z, u, shapes (rows, n), at the start and the points of every interval."""
    times, columns = [], []
    for phase in trajectory.phases:
        at = np.concatenate([[0.0], phase.basis.points])
        for k in range(len(phase.mesh)):
            times.append(phase.time(k, at))
            columns.append(phase.interval(k, at))
    x, z, u = (np.hstack([c[k] for c in columns]) for k in range(3))
    # time must not decrease between phases by rounding errors
    return np.maximum.accumulate(np.concatenate(times)), x, z, u


def _observed(compiled: CompiledModel, times: Vector, x: Vector, z: Vector, u: Vector, p: Vector) -> Vector:
    """All trajectories of the model at n instants, shape (n, columns); x, z, u have shapes (rows, n)."""
    n = len(times)
    z = z[: len(compiled.algebraic)]  # the unknowns of monotone searches are not algebraic variables of the model
    args = [ca.DM(times[None, :]), *(ca.DM(v) if v.size else ca.DM(v.shape[0], n) for v in (x, z, u))]
    p = p.copy()
    if compiled.solution.structure.rate is not None:
        p[-1] = 0.0
    repeated = ca.repmat(ca.DM(p), 1, n)
    if len(z):
        # between collocation points the polynomials of z satisfy the equations only approximately
        newton = _newton(compiled).map(n)
        for _ in range(_NEWTON_STEPS):
            args[2] = newton(*args, repeated)
    modes = compiled.all_modes.map(n)(*args, repeated)
    return np.array(compiled.observe.map(n)(*args, repeated, modes)).T


def _newton(compiled: CompiledModel) -> Any:
    """Newton step `(t, x, z, u, p) -> z` for the algebraic variables."""
    s = Symbols(compiled)
    arguments = s.inputs[:-1]
    alg = compiled.rhs(*arguments, compiled.all_modes(*arguments))[1]
    return ca.Function("newton", arguments, [s.z - ca.solve(ca.jacobian(alg, s.z), ca.densify(alg))])


def _dense(q: Quantities, trajectory: Trajectory, at: Vector) -> Vector:
    """All trajectories at n times [s] from the collocation polynomials, shape (n, columns)."""
    ends = np.array([phase.begin + phase.duration for phase in trajectory.phases])
    number = np.clip(np.searchsorted(ends, at, side="left"), 0, len(ends) - 1)
    compiled = q.model
    rows = np.empty((len(at), len(compiled.columns)))
    for k in np.unique(number).tolist():
        phase, own = trajectory.phases[k], number == k
        shares = np.clip((at[own] - phase.begin) / phase.duration, 0.0, 1.0)
        x, z, u = phase.at(shares)
        rows[own] = _observed(compiled, at[own], q.coordinates.states(x), z, u, trajectory.p)
    return rows


def _inputs(ports: Ports, trajectory: Trajectory, sizes: Vector) -> dict[str, TimeSeries | float]:
    """Inputs as time series with four values per interval, from which cubic splines reproduce their polynomials."""
    positions = np.linspace(0.0, 1.0, 4)
    times, columns = [], []
    for phase in trajectory.phases:
        for k in range(len(phase.mesh)):
            times.append(phase.time(k, positions))
            columns.append(phase.interval(k, positions)[2])
    time, u = np.maximum.accumulate(np.concatenate(times)), np.hstack(columns)
    return {port.name: _series(port, time, u[k], float(sizes[k])) for k, port in enumerate(ports)}


def _series(port: Port, time: Vector, values: Vector, size: float) -> TimeSeries | float:
    """One input as a series, or as a number if it varies only by rounding errors, which would slow down simulations.

    `size`: magnitude by which the program scaled it. The default nominal value of 1 would make currents of a
    nanoampere constant.
    """
    if float(np.ptp(values)) <= _ROUNDING * max(float(np.abs(values).max()), size):
        return float(np.clip(values.mean(), port.min, port.max))
    return TimeSeries(time, np.clip(values, port.min, port.max), "smooth", name=f"optimal {port.name}")


def _multipliers(program: Program, solution: Solution, trajectory: Trajectory) -> dict[str, Multiplier]:
    """Multipliers by name, with the phases concatenated; values are derivatives of the objective by the limits."""
    parts: dict[str, list[tuple[ConstraintRows, Vector, Vector, Vector]]] = {}
    for own in program.constraints:
        rows = slice(own.rows.start, own.rows.stop)
        level, dual = solution.g[rows] * own.scale, solution.duals[rows] / own.scale
        parts.setdefault(own.constraint.name, []).append((own, dual, level, _times(own, trajectory.phases)))
    found = {}
    for name, group in parts.items():
        own_rows, duals, levels, times = zip(*group, strict=True)
        labels = [
            program.phases[d.phase].spec.name if d.phase is not None else ""
            for d, v in zip(own_rows, levels, strict=True)
            for _ in v
        ]
        first, level = own_rows[0], np.concatenate(levels)
        limits = (first.constraint.lower, first.constraint.upper, first.scale)
        active = _at_limit(level, *limits)
        found[name] = Multiplier(
            name,
            np.concatenate(times),
            -np.concatenate(duals),
            active,
            tuple(labels),
            first.constraint.variable,
            level,
            *limits,
        )
    return found


def _times(rows: ConstraintRows, phases: list[PhaseTrajectory]) -> Vector:
    """Times [s] of the points of a constraint, shape (n,)."""
    if rows.phase is None or rows.points is None:
        return np.zeros(0)
    phase = phases[rows.phase]
    return phase.begin + phase.duration * rows.points


def _at_limit(level: Vector, lower: float, upper: float, scale: float) -> NDArray[np.bool_]:
    """Mask of the values at a limit, of the shape of `level`."""
    near = _NEAR * scale
    return np.asarray((level <= lower + near) | (level >= upper - near))
