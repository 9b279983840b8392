"""The interface of a solver, and the base class of the solvers that CasADi ships.

A solver is a class with

1. `name`, as the user writes it, and `plugin`, CasADi's name;
2. `algebraic`: whether it takes algebraic variables; otherwise they are eliminated before it sees the problem;
3. properties that decide how it is called:
   `fixed_step`, whether it needs a step size;
   `native`, which part of it can run as compiled C;
   `multistep`, whether it restarts with tiny steps;
   `explicit`, whether it needs no Jacobian of the rates;
   `interpolates`, whether it must be stopped at its output times, because its interpolant between steps is less
   accurate than the steps;
   `merges_outputs`, whether it treats an output time less than a nanosecond away as reached;
   `accepts_nan`, whether it does not notice equations without a finite value;
4. `settings(problem, segment)`: CasADi's options for one segment;
5. `integrate(problem, segment) -> Piece`, which raises RuntimeError if the integration cannot continue.

A segment is an interval of time without events: the right-hand side is smooth in it, and its start is consistent.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from acausal.arrays import Vector
from acausal.simulate.clock import seconds
from acausal.simulate.equations.function_cache import functions_of
from acausal.simulate.equations.kinks import time_ends
from acausal.simulate.equations.problem import Problem
from acausal.simulate.equations.scaled import UNIT, controls, stretched
from acausal.simulate.interrupt import Interrupted
from acausal.simulate.native.event_loop import EventLoopProgram
from acausal.simulate.native.policy import Library
from acausal.simulate.record.algebraic import corrected
from acausal.simulate.record.quadratures import integrals
from acausal.simulate.solvers.segment import Piece, Segment
from acausal.simulate.solvers.step_by_step import step_by_step

TOLERANCE_FRACTION = 0.1
"""Fraction of the tolerance that solvers get for their local errors: end errors are about ten times as large.

On `ThickBlock` at 1e-8 IDAS pays 40 % more steps and gains a factor of 40 in the depth at 40 s; methods of order 5 pay
1.6 times the steps, and every published initial value problem ends below ten times the tolerance (docs/ivp-table.md).
"""

SMOOTH_FRACTION = 0.01
"""The fraction in runs without events, in which errors add up from the first instant to the last.

End errors are proportional to the fraction, and the number of steps to its inverse fifth root: 1.5 times as many,
measured both with BDF and with methods of order 5 (docs/accuracy.md).
"""

MOST_STEPS = 10**6
"""Largest number of steps of a one-step method between two output times, as large as a long run may need."""

SEARCHED_STEPS = 26
"""The same from a mesh point to the next one: ten, and sixteen where the first step is estimated."""


class CasadiSolver:
    """Base of the plugins: builds the integrator for the grid of one segment and calls it."""

    name: ClassVar[str]
    plugin: ClassVar[str]
    algebraic: ClassVar[bool] = False
    fixed_step: ClassVar[bool] = False
    merges_outputs: ClassVar[bool] = False
    multistep: ClassVar[bool] = False
    interpolates: ClassVar[bool] = False
    accepts_nan: ClassVar[bool] = False
    explicit: ClassVar[bool] = False
    native: ClassVar[Literal["nothing", "equations", "integrator"]] = "nothing"

    def settings(self, problem: Problem, segment: Segment) -> dict[str, Any]:
        """CasADi's options for this segment."""
        raise NotImplementedError

    def units(self, problem: Problem, segment: Segment) -> Vector | None:
        """Return divisors of the scaled algebraic variables in this segment, shape (nz,), or None to leave them."""
        return None

    def integrate(self, problem: Problem, segment: Segment) -> Piece:
        """Solve one segment."""
        if segment.step is None or not (self.algebraic and problem.n_dynamic and problem.compiled.algebraic):
            return self._integrated(problem, segment)
        return step_by_step(partial(self._integrated, problem), problem, segment, segment.step)

    def _integrated(self, problem: Problem, segment: Segment) -> Piece:
        if problem.n_dynamic == 0:
            return stateless(problem, segment)
        try:
            return self._piece(problem, segment, *self._solved(problem, segment))
        except Interrupted as stop:
            done = len(stop.rows[0]) if stop.rows else 0
            if done and stop.piece is None:
                x, z = stop.rows
                stop.piece = self._piece(problem, replace(segment, times=segment.times[:done]), x, z, {})
            raise

    def _piece(self, problem: Problem, segment: Segment, scaled_x: Vector, scaled_z: Vector, stats: Any) -> Piece:
        """Convert a solution to the units of the model, and add the variables that were not integrated."""
        # Without scaling there is no copy: with 10 000 states and 500 outputs it takes as long as the integration.
        x = scaled_x.T if (problem.scale_x == 1.0).all() else scaled_x.T * problem.scale_x[:, None]
        stopped = str(stats.get("stopped", ""))
        if not (np.isfinite(x).all() and np.isfinite(scaled_z).all()):
            stopped = stopped or "the solution is not finite"
            count = int(np.argmin(np.isfinite(x).all(axis=0) & np.isfinite(scaled_z).all(axis=1)))
            if not segment.partial or not count:
                raise RuntimeError(stopped)
            x, scaled_z = x[:, :count], scaled_z[:count]
            segment = replace(segment, times=segment.times[:count])
        x = _all_states(problem, segment, x)
        z = scaled_z.T * problem.scale_z[:, None] if self.algebraic else problem.solve_algebraic(segment, x)
        return Piece(x, on_equations(problem, segment, x, z), counted(stats), stopped)

    def _solved(self, problem: Problem, segment: Segment) -> tuple[Vector, Vector, dict[str, Any]]:
        """Return scaled states, shape (n, nx), algebraic variables, (n, nz), at the output times, and statistics."""
        settings = self.settings(problem, segment)
        grid = segment.times - segment.start
        x0, z0 = segment.x[: problem.n_dynamic] / problem.scale_x, segment.z / problem.scale_z
        native, point = problem.native, (segment.p, segment.x, segment.start)
        dae: Any = None
        p: Vector | None = None
        library: Library[Any] | None = None
        # a right-hand side that contains a rootfinder stays interpreted
        kind = self.native if self.algebraic or not problem.compiled.algebraic else "nothing"
        units = self.units(problem, segment)
        unit = unit_of_time(segment.start, segment.times) if self.merges_outputs and segment.fractions is None else 1.0
        if unit != 1.0:
            dae = problem.scaled.in_unit_of_time(problem.scaled.dae if self.algebraic else problem.scaled.ode, unit)
            settings, grid = in_unit(unit, settings), grid / unit
        elif kind == "integrator" and (code := self._compiled(problem, segment, settings)) is not None:
            units = np.ones(len(z0)) if units is None else units
            p = np.concatenate([code.vector(problem.p, problem.u, problem.numbers(*point)), units])
            sizes = settings["reltol"], settings["abstol"], settings.get("step_size", 0.0)
            first = 0.0 if segment.step else segment.first
            most = segment.most_steps if segment.partial or segment.step_budget else 0
            x, z, stats = code.run(x0, z0 / units, p, grid, *sizes, first, partial=segment.partial, most=most)
            return x, z * units, stats
        elif kind == "equations":
            library = native.oracle(self.plugin, settings, None if segment.fractions is None else stretched)
            if library is not None:
                dae, p = library.run, library.vector(problem.p, problem.u, problem.numbers(*point))
        equations, extra, p = problem.scaled, {}, problem.vector(*point) if p is None else p
        if self.interpolates:
            dae, extra = equations.halting_dae if self.algebraic else equations.halting_ode, {"u": controls(len(grid))}
        elif self.accepts_nan:
            dae = equations.limited_dae
        elif dae is None:  # not taken from a compiled library
            dae = equations.dae if self.algebraic else equations.ode
        if kind == "integrator":
            settings = {**settings, **beginning(segment)}
        if units is not None:
            dae, z0, p = equations.in_units(dae), z0 / units, np.concatenate([p, units])
        if segment.fractions is not None:
            dae = equations.stretched(dae) if library is None else dae
            settings, grid = in_relative_time(segment, settings), UNIT * segment.fractions
        order, began = None, seconds()
        if self.multistep:
            settings = {**settings, "linear_solver": "qr"}
            # Compiled models are small, and a wrapped library has no derivatives; those of a rootfinder are not sparse.
            if library is None and (self.algebraic or not problem.compiled.algebraic):
                order = equations.factorisation
        if order is not None:
            dae, settings, (x0, z0) = equations.reordered(dae, order), order.settings(settings), order.there(x0, z0)
        may_compile = library is None and native.wanted is not False
        options = {"native": may_compile, "by_columns": may_compile and native.by_columns(self.plugin)}
        integrator = equations.integrator(self.plugin, dae, grid, settings, **options)
        seconds_to_make = seconds() - began
        arguments = {"x0": x0, "z0": z0, "p": p} if self.algebraic else {"x0": x0, "p": np.concatenate([p, z0])}
        if segment.fractions is not None:
            arguments["p"] = np.append(arguments["p"], segment.length)
        try:
            (x, z), stats = integrator({**arguments, **extra}, ("xf", "zf"), partial=segment.partial)
        except Interrupted as stop:
            stop.rows = order.back(*stop.rows) if stop.rows and order is not None else stop.rows
            if stop.rows and units is not None:
                stop.rows = stop.rows[0], stop.rows[1] * units
            raise
        x, z = (x, z) if order is None else order.back(x, z)
        z = z if units is None else z * units
        reused = equations.reused(self.plugin, dae, may_compile)
        if reused is not None:
            stats["n_jac"] = reused.evaluations
        native.interpreted(self.plugin, float(next((stats[k] for k in _EVALUATIONS if k in stats), 0.0)))
        return x, z, {**stats, "making": seconds_to_make}

    def _compiled(
        self, problem: Problem, segment: Segment, settings: Mapping[str, Any]
    ) -> Library[EventLoopProgram] | None:
        """Return the integrator as compiled C, if it is to be used for this segment."""
        # of searches for events only those of held relations, which no compiled loop passes
        is_search = segment.partial or segment.step_budget is not None
        if is_search and (problem.compiled.algebraic or not problem.compiled.varied):
            return None
        return problem.native.integrator(self.plugin, settings)


def on_equations(problem: Problem, segment: Segment, x: Vector, z: Vector) -> Vector:
    """Correct algebraic variables at the output times by their equations; RuntimeError if these are far from met."""
    if not z.size:
        return z
    numbers = problem.u, problem.p, segment.p
    return corrected(problem.compiled, segment.times, x, z, *numbers, segment.tolerances)


def program(problem: Problem, solver: object, segment: Segment) -> Library[EventLoopProgram] | None:
    """Return the solver as compiled C, or None: for ODEs only, and if the code exists or is worth compiling."""
    if not isinstance(solver, CasadiSolver) or solver.native != "integrator" or problem.compiled.algebraic:
        return None
    return problem.native.integrator(solver.plugin, solver.settings(problem, segment))


def quadratures_at(problem: Problem, segment: Segment) -> Vector:
    """Quadratures (integrals of functions of time that act on nothing) at the output times; shape (nq, n)."""
    indices = slice(problem.n_dynamic, problem.n_dynamic + problem.compiled.quadratures)
    if segment.bare or not problem.compiled.quadratures:
        return np.tile(segment.x[indices, None], (1, len(segment.times)))
    only = np.zeros(len(segment.times), dtype=np.int64)
    modes, discrete = segment.p[None, :], segment.x[None, len(segment.x) - problem.compiled.discretes :]
    grown = growth(problem, np.array([segment.start]), segment.times, only, modes, discrete, segment)
    return np.asarray(segment.x[indices, None] + grown)


def growth(
    problem: Problem,
    starts: Vector,
    times: Vector,
    stretches: NDArray[np.int64],
    modes: Vector,
    discrete: Vector,
    accuracy: Segment,
) -> Vector:
    """Increments of the quadratures from the start of k stretches to n instants; shape (nq, n).

    `starts`, `times` and `stretches` are those of `integrals`; `modes` and `discrete` are the values in each stretch,
    shapes (k, nm) and (k, nd).
    """
    compiled = problem.compiled

    def rates(instants: Vector, stretch: NDArray[np.int64]) -> Vector:
        m, d = (values[0] if len(values) == 1 else values[stretch] for values in (modes, discrete))
        return functions_of(compiled).quadrature_rates(instants, problem.u, problem.p, m, d)

    scale = compiled.nominal_x[problem.n_dynamic : problem.n_dynamic + compiled.quadratures, None]
    ends = time_ends(compiled, problem.p, accuracy.tolerances.relative)
    breaks = np.unique(np.concatenate(ends)) if ends else None
    return np.asarray(scale * integrals(rates, starts, times, stretches, accuracy.tolerances, breaks))


def _all_states(problem: Problem, segment: Segment, x: Vector) -> Vector:
    """Return all states at the output times: those of the coupled system, quadratures, and discrete variables."""
    n, nq = problem.n_dynamic, problem.compiled.quadratures
    if len(segment.x) == n:
        return x
    all_x = np.empty((len(segment.x), x.shape[1]))
    all_x[:n], all_x[n:] = x, segment.x[n:, None]
    if nq and not segment.bare:
        all_x[n : n + nq] = quadratures_at(problem, segment)
    return all_x


def unmoved(problem: Problem, segment: Segment) -> Vector:
    """Discrete variables, which stay constant, at the output times; shape (nd, n)."""
    return np.tile(segment.x[len(segment.x) - problem.compiled.discretes :, None], (1, len(segment.times)))


def stateless(problem: Problem, segment: Segment) -> Piece:
    """The solution of a problem without states, which no plugin takes: its algebraic variables depend on time alone."""
    x = unmoved(problem, segment)
    if not problem.compiled.algebraic:
        return Piece(x, problem.solve_algebraic(segment, x), {})
    z = problem.follow_algebraic(segment.start, segment.times, segment.x, segment.z, segment.p)
    return Piece(x, on_equations(problem, segment, x, z), {})


def bounded(segment: Segment) -> dict[str, float]:
    """The option that bounds the step, if the segment has a bound."""
    return {} if segment.max_step is None else {"max_step_size": segment.max_step}


def stepping(segment: Segment, most: int = MOST_STEPS) -> dict[str, Any]:
    """The options of a one-step method for the size and the number of its steps, by default `most`."""
    if segment.step:
        return {"max_num_steps": MOST_STEPS, **bounded(segment), "step_size": segment.step}
    has_budget = segment.partial or segment.step_budget
    return {"max_num_steps": segment.most_steps if has_budget else most, **bounded(segment)}


def beginning(segment: Segment) -> dict[str, float]:
    """The option for the first step of a one-step method.

    CasADi's own estimate is 1e-6 if the states or their rates are near zero, from which the step takes ten steps to
    grow after every event. The mean step of the previous stretch is tried instead; if it is too long, it is rejected.
    """
    return {"step0": segment.first} if segment.first > 0.0 and not segment.step else {}


def in_relative_time(segment: Segment, settings: Mapping[str, Any]) -> dict[str, Any]:
    """Convert the settings to a time from 0 to `UNIT`, rounded to few values: each needs its own integrator."""
    relative = {name: value for name, value in settings.items() if name not in ("step0", "max_step_size")}
    if segment.max_step is not None:
        relative["max_step_size"] = UNIT / max(1, math.ceil(segment.length / segment.max_step - 1e-9))
    if segment.first > 0.0 and math.isfinite(segment.first):
        relative["step0"] = UNIT * min(4.0 ** math.floor(math.log(segment.first / segment.length, 4.0) + 1e-6), 0.25)
    return relative


def pace(start: float, end: float, counters: Mapping[str, float]) -> float:
    """The mean step between two instants, 0 if the number of steps is not known."""
    steps = counters.get("steps", 0.0)
    return (end - start) / steps if steps > 0.0 else 0.0


# The solvers' names for the number of evaluations of the right-hand side.
_EVALUATIONS = "nfevals", "n_rhs", "n_call_daeF"


def counted(stats: Mapping[str, Any]) -> dict[str, float]:
    """Translate a solver's counters to common names."""
    return {name: float(stats[key]) for key, name in _COUNTER_NAMES.items() if key in stats}


# The common name of each solver's counters; if a solver reports several of the same, the last one listed counts.
_COUNTER_NAMES = {
    "n_steps": "steps",
    "nsteps": "steps",
    **dict.fromkeys(reversed(_EVALUATIONS), "rhs_evaluations"),
    "n_call_jacF": "jacobians",
    "n_jac": "jacobians",
    "nlinsetups": "factorisations",
    "n_reject": "rejected",
    "netfails": "rejected",
    "nncfails": "newton_failures",
    # in seconds; an integrator of CasADi has fixed output times, so each segment builds its own
    "making": "making",
}


# CasADi's interfaces to IDAS and CVODES do not integrate if the next output is less than this time [s] after the last
# one (`ttol` in `casadi/interfaces/sundials/{idas,cvodes}_interface.cpp`, 3.8.2): a circuit simulated over 5 ns would
# never leave its start. Such segments are integrated with time in a smaller unit.
_MERGED = 1e-9
# The shortest distance between outputs in that unit: far above `_MERGED`, and still short.
_SHORTEST_SCALED = 1e-6
# Outputs closer than this many units of rounding of the time count as one.
_ROUNDING_UNITS = 8


def unit_of_time(start: float, times: Vector) -> float:
    """The unit [s] in which all outputs are far enough apart, 1 if they are so in seconds."""
    gaps = np.diff(times, prepend=start)
    distinct = gaps[gaps > _ROUNDING_UNITS * np.spacing(max(abs(start), abs(float(times[-1]))))]
    if not len(distinct) or distinct.min() > 2.0 * _MERGED:
        return 1.0
    # a power of ten, so that few units occur and the equations in each are built once
    return float(10.0 ** np.floor(np.log10(distinct.min() / _SHORTEST_SCALED)))


def in_unit(unit: float, settings: dict[str, Any]) -> dict[str, Any]:
    """Convert the settings of an integrator to another unit of time [s]."""
    changed = dict(settings)
    if "init_xdot" in settings:
        changed["init_xdot"] = [unit * rate for rate in settings["init_xdot"]]
    for name in ("max_step_size", "step0"):
        if name in settings:
            changed[name] = settings[name] / unit
    return changed
