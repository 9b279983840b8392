"""The solvers by name, and the choice between them; one file per solver, each with the interface of `base.py`."""

from __future__ import annotations

from typing import Any, Protocol

import casadi as ca

from acausal.errors import UsageError
from acausal.lower.compiled import CompiledModel
from acausal.simulate.equations.arguments import arguments
from acausal.simulate.equations.problem import Problem
from acausal.simulate.solvers.base import SMOOTH_FRACTION, TOLERANCE_FRACTION
from acausal.simulate.solvers.cvodes import Cvodes
from acausal.simulate.solvers.erk import Erk
from acausal.simulate.solvers.fixed import Collocation, Rk, Rk2
from acausal.simulate.solvers.idas import Idas
from acausal.simulate.solvers.rosenbrock import Rosenbrock
from acausal.simulate.solvers.segment import Piece, Segment


class Solver(Protocol):
    """See `base.py` for the contract."""

    name: str
    algebraic: bool
    fixed_step: bool
    multistep: bool
    explicit: bool
    native: str

    def integrate(self, problem: Problem, segment: Segment) -> Piece:
        """Solve one segment; raises RuntimeError if the integration cannot continue."""
        ...


_ALL: tuple[Any, ...] = (Idas, Rosenbrock, Cvodes, Erk, Collocation, Rk, Rk2)
SOLVERS: dict[str, type[Solver]] = {s.name: s for s in _ALL}


# Up to this many states a one-step method, which restarts at no cost, integrates models with delays faster than BDF.
_FEW_STATES = 200
# From this many breaks in the inputs on, the cost of restarting decides the choice of the solver.
_MANY_BREAKS = 50
# Up to this many unknowns a method of order 5 with one factorisation per step is affordable for any model. Where errors
# are not damped, the end error of BDF is a hundred times as large (docs/accuracy.md).
_SMALL_SIZE = 100
# The smallest tolerance passed to a solver; below it rounding errors determine the step size.
_FINEST_TOLERANCE = 1e-13


def solver_named(name: str) -> Solver:
    """Return the solver of this name; raises UsageError AC032, which lists the available ones."""
    if name not in SOLVERS:
        raise UsageError("AC032", f"there is no solver '{name}'", help=f"solvers: auto, {', '.join(SOLVERS)}")
    return SOLVERS[name]()


def choose(compiled: CompiledModel, wanted: str, step: float | None, breaks: int = 0) -> tuple[Solver, str]:
    """Return the solver for `wanted`, and the reason; "auto" decides by structure and by the number of input breaks."""
    if wanted != "auto":
        return solver_named(wanted), "as asked for"
    if step is not None:
        return solver_named("rk2"), "a fixed step was given"
    events = compiled.state_events
    states = len(compiled.continuous)
    kind = f"{'a DAE' if compiled.algebraic else 'an ODE'} of {states} state{'s' if states != 1 else ''}"
    # a one-step method restarts after an event at no cost (docs/devdocs/events.md)
    if (events.relations or events.samples) and not compiled.algebraic and compiled.n_dynamic:
        if compiled.n_dynamic > _SMALL_SIZE and is_never_stiff(compiled):
            return solver_named(
                "erk"
            ), f"{kind} with events of its variables in which no state acts back on itself: never stiff"
        return solver_named("rosenbrock"), f"{kind} with events of its variables"
    if compiled.delays and not compiled.algebraic and len(compiled.states) <= _FEW_STATES:
        return solver_named("rosenbrock"), f"{kind} with delays: many restarts"
    if breaks > _MANY_BREAKS and not compiled.algebraic and 0 < compiled.n_dynamic <= _FEW_STATES:
        return solver_named("rosenbrock"), f"an ODE whose inputs have {breaks} breaks: many restarts"
    size = compiled.n_dynamic + len(compiled.algebraic)
    # Rosenbrock's error test includes the algebraic variables. Those of a closed loop are noise where the loop reaches
    # a dead centre, and the solver stops there (EngineV6, Fourbar1); IDAS continues and keeps the tolerance.
    is_loop = bool(compiled.algebraic) and bool(compiled.solution.structure.invariants)
    if is_smooth(compiled) and compiled.n_dynamic and size <= _SMALL_SIZE and not is_loop:
        return solver_named(
            "rosenbrock"
        ), f"{kind} without events of its variables, small enough for a method of order 5"
    return solver_named("idas"), f"{kind}, stiffness unknown"


def is_never_stiff(compiled: CompiledModel) -> bool:
    """Whether the structure shows that no Newton matrix is needed: an ODE in which no state acts back on itself.

    The Jacobian of the rates can be permuted to a strictly triangular matrix. Its eigenvalues are then zero at every
    point and in every mode, as for shafts whose friction does not depend on the speed. This excludes models with steep
    functions (`arguments`), and those with delays, through which a state acts on itself later.
    """
    n = compiled.n_dynamic
    if compiled.algebraic or compiled.delays or arguments(compiled) is not None:
        return False
    slopes = ca.DM(compiled.rhs.jac_sparsity(0, 1))[:n, :n].sparsity()
    count, _, _ = slopes.scc()
    return bool(count == n and not any(slopes.has_nz(k, k) for k in range(n)))


def is_smooth(compiled: CompiledModel) -> bool:
    """Whether only events of time can interrupt a run: the model has no state events and no delays."""
    return compiled.state_events.are_silent and not compiled.delays


def tolerance_fraction(compiled: CompiledModel, solver: Solver, tolerance: float, bends: bool = False) -> float:
    """Return the fraction of a tolerance that a solver gets for its local errors.

    Runs without interruptions get `SMOOTH_FRACTION`, because their errors accumulate from start to end. Three other
    cases get it too:

    - BDF with stabilised constraints: on closed loops its end error is 30 to 100 times its local error, which is not
      so for one-step methods (measured).
    - Runs with `bends`: a table over time bends the solution at row after row, and the errors at the rows add up.
    - BDF with delays: the errors of its restarts add up, and the delay feeds them back.

    With stabilised constraints, one-step methods along undamped motions have ten times the end error that they have
    without (a body after 1600 turns 20 tolerances, an oscillator after 1000 periods 2), so they get a quarter of the
    fraction. Closed loops of joints are exempt: rounding errors there are as large as that quarter, and steps collapse.
    """
    is_stabilised = bool(compiled.solution.structure.invariants)
    is_long = is_smooth(compiled) or bends or (solver.multistep and (is_stabilised or bool(compiled.delays)))
    fraction = SMOOTH_FRACTION if is_long else TOLERANCE_FRACTION
    if is_stabilised and is_smooth(compiled) and not solver.multistep and not compiled.flat.loops:
        fraction /= 4.0
    return min(TOLERANCE_FRACTION, max(fraction, _FINEST_TOLERANCE / tolerance))
