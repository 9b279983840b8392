"""What a solver must do, and what the solvers that CasADi ships share.

A solver is a class with

1. `name`, as the user writes it, and `plugin`, CasADi's;
2. `algebraic`: whether it takes algebraic variables; otherwise they are eliminated before it sees the problem;
3. `fixed_step`: whether it needs a step, and `native`: what of it can run as compiled C; `impatient`: whether it takes
   what is nearer than a nanosecond as reached;
4. `settings(problem, segment)`: CasADi's options for one segment;
5. `integrate(problem, segment) -> Piece`, which raises RuntimeError when it cannot go on.

A segment is a stretch of time without events: the right-hand side is smooth in it, its start is consistent.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from acausal.simulate.direct import called
from acausal.simulate.islands import integrals
from acausal.simulate.kept import kept
from acausal.simulate.native.flight import FlightProgram
from acausal.simulate.native.policy import Library
from acausal.simulate.polish import polished
from acausal.simulate.problem import Problem
from acausal.simulate.solvers.unit_of_time import in_unit, unit_of_time

Vector = NDArray[np.float64]

TOLERANCE_SHARE = 0.1
"""Share of the tolerance that solvers get for their local errors: end errors are about ten times as large.

On S32 at 1e-8 IDAS pays 40 % more steps and gains a factor of 40 in the depth at 40 s; methods of order 5 pay 1.6 times
the steps, and every published initial value problem ends below ten times the tolerance (docs/ivp-table.md).
"""


@dataclass(frozen=True, eq=False)
class Segment:
    """One stretch: from `start` to the last of `times` (ascending, all after `start`).

    `x` (all states), `z` are consistent at the start; `p` are the modes of the time events. `patience` is the number of
    steps between two output times after which IDAS and CVODES give up; None: as many as a long run may need. `first` is
    the first step of a one-step method, 0 to have it estimated.
    """

    start: float
    times: Vector
    x: Vector
    z: Vector
    p: Vector
    tolerance: float
    absolute: float
    step: float | None
    max_step: float | None = None
    patience: int | None = None
    first: float = 0.0

    @property
    def most_steps(self) -> int:
        """Steps between two output times; with few of these, as many as a run with many would be allowed."""
        return self.patience or max(20_000, 400_000 // len(self.times))


@dataclass(frozen=True, eq=False)
class Piece:
    """Values at `segment.times`: `x` of shape (nx, n), `z` of shape (nz, n), and the solver's counters."""

    x: Vector
    z: Vector
    counters: dict[str, float]


class CasadiSolver:
    """Base of the plugins: builds the integrator for the grid of one segment and calls it."""

    name: ClassVar[str]
    plugin: ClassVar[str]
    algebraic: ClassVar[bool] = False
    fixed_step: ClassVar[bool] = False
    impatient: ClassVar[bool] = False
    native: ClassVar[Literal["nothing", "equations", "integrator"]] = "nothing"

    def settings(self, problem: Problem, segment: Segment) -> dict[str, Any]:
        """CasADi's options for this segment."""
        raise NotImplementedError

    def integrate(self, problem: Problem, segment: Segment) -> Piece:
        """Solve one segment."""
        if problem.n_dynamic == 0:
            # no plugin takes a problem without states: its algebraic variables are a function of time
            x = unmoved(problem, segment)
            if not problem.compiled.algebraic:
                return Piece(x, problem.solve_algebraic(segment.times, x, segment.z, segment.p), {})
            z = problem.follow_algebraic(segment.start, segment.times, segment.x, segment.z, segment.p)
            return Piece(x, polished(problem.compiled, segment.times, x, z, problem.u, problem.p, segment.p), {})
        scaled_x, scaled_z, stats = self._solved(problem, segment)
        x = scaled_x.T * problem.scale_x[:, None]
        if not np.isfinite(x).all():
            raise RuntimeError("the solution is not finite")
        x = np.vstack([x, islands(problem, segment), unmoved(problem, segment)])
        if self.algebraic:
            z = scaled_z.T * problem.scale_z[:, None]
            z = polished(problem.compiled, segment.times, x, z, problem.u, problem.p, segment.p)
        else:
            z = problem.solve_algebraic(segment.times, x, segment.z, segment.p)
        return Piece(x, z, counted(stats))

    def _solved(self, problem: Problem, segment: Segment) -> tuple[Vector, Vector, dict[str, Any]]:
        """Scaled states, shape (n, nx), and algebraic variables at the output times, and the solver's statistics."""
        settings = self.settings(problem, segment)
        grid = segment.times - segment.start
        x0, z0 = segment.x[: problem.n_dynamic] / problem.scale_x, segment.z / problem.scale_z
        native, p = problem.native, problem.numbers(segment.p, segment.x, segment.start)
        dae: Any = None
        # a rootfinder inside the right-hand side stays interpreted
        kind = self.native if self.algebraic or not problem.compiled.algebraic else "nothing"
        unit = unit_of_time(segment.start, segment.times) if self.impatient else 1.0
        if unit != 1.0:
            dae = problem.numbered.dae if self.algebraic else problem.numbered.ode
            dae, settings = in_unit(dae, unit, settings)
            grid = grid / unit
        elif kind == "integrator":
            whole = native.integrator(self.plugin, settings)
            if whole is not None:
                p = whole.vector(problem.p, problem.u, p)
                sizes = settings["reltol"], settings["abstol"], settings.get("step_size", 0.0)
                return whole.run(x0, z0, p, grid, *sizes, 0.0 if segment.step else segment.first)
        elif kind == "equations":
            library = native.oracle(self.plugin, settings)
            if library is not None:
                dae, p = library.run, library.vector(problem.p, problem.u, p)
        if dae is None:  # a compiled integrator does without
            dae = problem.numbered.dae if self.algebraic else problem.numbered.ode
        if kind == "integrator":
            settings = {**settings, **beginning(segment)}
        began = time.perf_counter()
        integrator = problem.numbered.integrator(self.plugin, dae, grid, settings)
        making = time.perf_counter() - began
        arguments = {"x0": x0, "z0": z0, "p": p} if self.algebraic else {"x0": x0, "p": np.concatenate([p, z0])}
        (x, z), stats = called(integrator, arguments, ("xf", "zf"))
        native.interpreted(self.plugin, counted(stats).get("rhs_evaluations", 0.0))
        return x, z, {**stats, "making": making}


def program(problem: Problem, solver: object, segment: Segment) -> Library[FlightProgram] | None:
    """The solver as compiled C for problems without algebraic variables, where there is one or it pays to make one."""
    if not isinstance(solver, CasadiSolver) or solver.native != "integrator" or problem.compiled.algebraic:
        return None
    return problem.native.integrator(solver.plugin, solver.settings(problem, segment))


def islands(problem: Problem, segment: Segment) -> Vector:
    """Integrals of time that act on nothing, at the output times; shape (nq, n)."""
    if not problem.compiled.quadratures:
        return np.zeros((0, len(segment.times)))
    own = slice(problem.n_dynamic, problem.n_dynamic + problem.compiled.quadratures)
    only = np.zeros(len(segment.times), dtype=np.int64)
    modes, discrete = segment.p[None, :], segment.x[None, len(segment.x) - problem.compiled.discretes :]
    grown = growth(problem, np.array([segment.start]), segment.times, only, modes, discrete, segment)
    return np.asarray(segment.x[own, None] + grown)


def growth(
    problem: Problem,
    starts: Vector,
    times: Vector,
    stretches: NDArray[np.int64],
    modes: Vector,
    discrete: Vector,
    accuracy: Segment,
) -> Vector:
    """What these integrals grow by from the start of k stretches to n instants; shape (nq, n).

    `starts`, `times` and `stretches` are those of `integrals`; `modes` and `discrete` are the values in each stretch,
    shapes (k, nm) and (k, nd).
    """
    compiled = problem.compiled

    def rates(instants: Vector, stretch: NDArray[np.int64]) -> Vector:
        return kept(compiled).island_rates(instants, problem.u, problem.p, modes[stretch], discrete[stretch])

    scale = compiled.nominal_x[problem.n_dynamic : problem.n_dynamic + compiled.quadratures, None]
    return np.asarray(scale * integrals(rates, starts, times, stretches, accuracy.tolerance, accuracy.absolute))


def unmoved(problem: Problem, segment: Segment) -> Vector:
    """Discrete variables at the output times; shape (nd, n)."""
    return np.tile(segment.x[len(segment.x) - problem.compiled.discretes :, None], (1, len(segment.times)))


def bounded(segment: Segment) -> dict[str, float]:
    """The option that bounds the step, where a bound is wanted."""
    return {} if segment.max_step is None else {"max_step_size": segment.max_step}


def beginning(segment: Segment) -> dict[str, float]:
    """The option for the first step of a one-step method.

    CasADi's own estimate is 1e-6 where the states or their rates are near zero: ten steps to grow from that at every
    event. The mean step of the stretch before is tried instead; where it is too long it is rejected.
    """
    return {"step0": segment.first} if segment.first > 0.0 and not segment.step else {}


def pace(start: float, end: float, counters: Mapping[str, float]) -> float:
    """The mean step between two instants, 0 when it is not known."""
    steps = counters.get("steps", 0.0)
    return (end - start) / steps if steps > 0.0 else 0.0


def counted(stats: dict[str, Any]) -> dict[str, float]:
    """The solver's own counters under common names."""
    names = {
        "steps": ("nsteps", "n_steps"),
        "rhs_evaluations": ("nfevals", "n_rhs", "n_call_daeF"),
        "jacobians": ("n_call_jacF", "n_jac"),
        "factorisations": ("nlinsetups",),
        "rejected": ("netfails", "n_reject"),
        "newton_failures": ("nncfails",),
        # seconds; CasADi freezes the output times in an integrator, so each segment makes its own
        "making": ("making",),
    }
    return {
        name: next(float(stats[k]) for k in keys if k in stats)
        for name, keys in names.items()
        if any(k in stats for k in keys)
    }
