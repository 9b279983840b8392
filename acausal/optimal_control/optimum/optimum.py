"""The answer: a result with the names of the model, its multipliers, its inputs, and its replay."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from acausal.arrays import Vector
from acausal.lower.casadi_model import Port, Ports
from acausal.lower.compiled import CompiledModel
from acausal.lower.symbols import Symbols
from acausal.optimal_control.optimum.trajectory import PhaseTrajectory, Trajectory
from acausal.optimal_control.problem import StatedProblem
from acausal.optimal_control.program.nlp import Solution
from acausal.optimal_control.program.radau import Demand, Program
from acausal.optimal_control.quantities import Quantities
from acausal.providers import provided
from acausal.result.result import Event, Result
from acausal.result.series import TimeSeries
from acausal.simulate.record.record import Described
from acausal.simulate.run import simulate

if TYPE_CHECKING:
    from matplotlib.figure import Figure


# A constraint is active where it is this near to its limit, by its magnitude, and its multiplier counts.
_NEAR = 1e-3
_NEWTON_STEPS = 4
# Points this near to an event are at it, and events this near to each other are one; by the length of all phases.
_AT_EVENT, _SAME_EVENT = 1e-6, 1e-3
# Share of its magnitude by which an input that is constant varies.
_ROUNDING = 1e-9


@dataclass(frozen=True, eq=False, repr=False)
class Multiplier:
    """What a constraint costs.

    Attributes
    ----------
    name
        The constraint.
    time
        Times [s] of the points where it is demanded, shape (n,); empty for a constraint on numbers.
    value
        Derivative of the objective by the limit at each point, shape (n,); negative where the lower limit holds. By the
        length of the interval it approximates a density over time.
    active
        Whether the constraint is at a limit at each point, shape (n,).
    phase
        Name of the phase of each point; "" for a constraint on numbers.
    variable
        Name of the scalar that is bounded, None for an expression.
    level
        Value of what is bounded at each point, shape (n,).
    lower, upper, scale
        Its limits, and the magnitude that nearness is measured with.
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
        """Which values of what is bounded are at a limit."""
        return _at_limit(values, self.lower, self.upper, self.scale)

    def __repr__(self) -> str:
        return f"Multiplier({self.name}: active at {self.active.sum()} of {len(self.level)} points)"


@dataclass(frozen=True, eq=False, repr=False)
class Optimum(Result):
    """An optimum: trajectories by name as in every result, and what only an optimum has.

    Attributes
    ----------
    objective
        The smallest value.
    multipliers
        By the name of the constraint.
    inputs
        The optimal inputs, for `simulate(inputs=...)`.
    start
        Start values of states that differ from those of the model.
    parameters
        Values of parameters that were decided or given, by name.
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
        """The model simulated with the optimal inputs, parameters and start values; options as for `simulate`."""
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
        """Largest distance of every state from a replay at the points of the mesh, by the state's largest magnitude."""
        assert self.compiled is not None, "made by Problem.solve"
        found = np.nanmax(np.abs(self.distances(replay)), axis=1, initial=0.0)
        return dict(zip(self.compiled.continuous, found.tolist(), strict=True))

    def distances(self, replay: Result) -> Vector:
        """Distances of the states of a replay at the points of the mesh, by their largest magnitudes; nan at events.

        Shape (states, points).
        """
        assert self.compiled is not None, "made by Problem.solve"
        found = np.full((len(self.compiled.continuous), len(self.time)), np.nan)
        keep = self.away_from_events(replay)
        for k, name in enumerate(self.compiled.continuous):
            own, other = self[name], np.asarray(replay.at(self.time, name))
            found[k, keep] = ((own - other) / (float(np.abs(own).max()) or 1.0))[keep]
        return found

    def away_from_events(self, replay: Result) -> NDArray[np.bool_]:
        """Which points of the mesh are not at an event: there values before and after stand side by side."""
        return _off_events(self.time, self.events, replay.events)

    def active(self, phase: str, share: float = 0.0) -> tuple[str, ...]:
        """Names of the constraints that are at a limit at more than `share` of a phase's points, the longest first."""
        shares = {}
        for m in self.held:
            own = np.array([name == phase for name in m.phase])
            if own.any():
                shares[m.name] = float(m.active[own].mean())
        return tuple(sorted((n for n, s in shares.items() if s > share), key=lambda n: -shares[n]))

    def plot(self, *names: str, **options: Any) -> Figure:
        """Draw signals with what is at a limit marked; by default the inputs and what holds them.

        Options are `file` and `title`; with any other of `plot`, signals are drawn as of every result.
        """
        if set(options) - {"file", "title"}:
            return super().plot(*names, **options)
        drawing: Figure = provided("drawn")(self, names, options.get("file"), options.get("title"))
        return drawing

    @property
    def held(self) -> tuple[Multiplier, ...]:
        """Multipliers of the constraints along phases."""
        return tuple(m for m in self.multipliers.values() if len(m.time))

    def __repr__(self) -> str:
        return f"Optimum({super().__repr__()[7:-1]}, objective {self.objective:.8g})"


def _off_events(times: Vector, own: tuple[Event, ...], others: tuple[Event, ...]) -> NDArray[np.bool_]:
    """Which times are not where states jump in the replay, nor between that and the end of a phase which it is."""
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
    problem: StatedProblem, program: Program, solution: Solution, trajectory: Trajectory, stats: Mapping[str, object]
) -> Optimum:
    """The answer made of the numbers that a solver found."""
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
    own = {n: float(v) for n, v, d in zip(names, trajectory.p, declared, strict=True) if v != d and n != rate}
    begin = q.first if not q.decided else np.array(q.start(ca.DM(trajectory.p))).ravel()
    first = trajectory.phases[0].x[:, 0]
    both = (q.coordinates.states(v[:, None]).ravel() for v in (first, begin))
    start = {n: float(a) for n, a, b in zip(q.states.names, *both, strict=True) if a != b}
    x = q.coordinates.states(x)
    return Optimum(
        model=compiled.name,
        time=times,
        trajectories=lambda: _observed(compiled, times, x, z, u, trajectory.p),
        signals=Described(compiled, trajectory.p),
        events=events,
        stats=dict(stats),
        dense=(lambda at: _dense(q, trajectory, at)) if program.steps is None else None,
        objective=solution.objective,
        multipliers=multipliers,
        inputs=_inputs(q.u, trajectory),
        start=start if problem.free_start else {},
        parameters=own,
        phases=spans,
        compiled=compiled,
    )


def _rows(trajectory: Trajectory) -> tuple[Vector, Vector, Vector, Vector]:
    """Times and values at the start and the points of every interval; borders stand twice."""
    times, columns = [], []
    for phase in trajectory.phases:
        at = np.concatenate([[0.0], phase.basis.points])
        for k in range(len(phase.mesh)):
            times.append(phase.time(k, at))
            columns.append(phase.interval(k, at))
    x, z, u = (np.hstack([c[k] for c in columns]) for k in range(3))
    # rounding must not make time run back where a phase is followed by the next
    return np.maximum.accumulate(np.concatenate(times)), x, z, u


def _observed(compiled: CompiledModel, times: Vector, x: Vector, z: Vector, u: Vector, p: Vector) -> Vector:
    """All trajectories of the model at points, shape (n, columns)."""
    n, z = len(times), z[: len(compiled.algebraic)]  # what programs have opened, the model searches itself
    args = [ca.DM(times[None, :]), *(ca.DM(v) if v.size else ca.DM(v.shape[0], n) for v in (x, z, u))]
    p = p.copy()
    if compiled.solution.structure.rate is not None:
        p[-1] = 0.0
    repeated = ca.repmat(ca.DM(p), 1, n)
    if len(z):
        # at collocation points they are solved already; between, their polynomials are near
        newton = _newton(compiled).map(n)
        for _ in range(_NEWTON_STEPS):
            args[2] = newton(*args, repeated)
    modes = compiled.all_modes.map(n)(*args, repeated)
    return np.array(compiled.observe.map(n)(*args, repeated, modes)).T


def _newton(compiled: CompiledModel) -> Any:
    """`(t, x, z, u, p) -> z`: one Newton step for the algebraic variables."""
    s = Symbols(compiled)
    arguments = s.inputs[:-1]
    alg = compiled.rhs(*arguments, compiled.all_modes(*arguments))[1]
    return ca.Function("newton", arguments, [s.z - ca.solve(ca.jacobian(alg, s.z), ca.densify(alg))])


def _dense(q: Quantities, trajectory: Trajectory, at: Vector) -> Vector:
    """All trajectories at any times, shape (n, columns): the polynomials of the collocation."""
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


def _inputs(ports: Ports, trajectory: Trajectory) -> dict[str, TimeSeries | float]:
    """The inputs as series that their splines reproduce: four values in every interval, borders twice."""
    places = np.linspace(0.0, 1.0, 4)
    times, columns = [], []
    for phase in trajectory.phases:
        for k in range(len(phase.mesh)):
            times.append(phase.time(k, places))
            columns.append(phase.interval(k, places)[2])
    time, u = np.maximum.accumulate(np.concatenate(times)), np.hstack(columns)
    return {port.name: _series(port, time, u[k]) for k, port in enumerate(ports)}


def _series(port: Port, time: Vector, values: Vector) -> TimeSeries | float:
    """One input; a number where only rounding makes it vary, which a run would follow otherwise."""
    size = max(float(np.abs(values).max()), port.nominal)
    if float(np.ptp(values)) <= _ROUNDING * size:
        return float(np.clip(values.mean(), port.min, port.max))
    return TimeSeries(time, np.clip(values, port.min, port.max), "smooth", name=f"optimal {port.name}")


def _multipliers(program: Program, solution: Solution, trajectory: Trajectory) -> dict[str, Multiplier]:
    """Multipliers by name, phases one behind the other; values are derivatives of the objective by the limits."""
    parts: dict[str, list[tuple[Demand, Vector, Vector, Vector]]] = {}
    for demand in program.demands:
        rows = slice(demand.rows.start, demand.rows.stop)
        level, dual = solution.g[rows] * demand.scale, solution.duals[rows] / demand.scale
        parts.setdefault(demand.constraint.name, []).append((demand, dual, level, _times(demand, trajectory.phases)))
    found = {}
    for name, group in parts.items():
        demands, duals, levels, times = zip(*group, strict=True)
        labels = [
            program.phases[d.phase].spec.name if d.phase is not None else ""
            for d, v in zip(demands, levels, strict=True)
            for _ in v
        ]
        first, level = demands[0], np.concatenate(levels)
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


def _times(demand: Demand, phases: list[PhaseTrajectory]) -> Vector:
    if demand.phase is None or demand.points is None:
        return np.zeros(0)
    phase = phases[demand.phase]
    return phase.begin + phase.duration * demand.points


def _at_limit(level: Vector, lower: float, upper: float, scale: float) -> NDArray[np.bool_]:
    near = _NEAR * scale
    return np.asarray((level <= lower + near) | (level >= upper - near))
