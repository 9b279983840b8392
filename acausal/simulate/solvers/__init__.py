"""The solvers by name; one file each, all through the interface of `base.py`."""

from __future__ import annotations

from typing import Any, Protocol

import casadi as ca

from acausal.errors import UsageError
from acausal.lower.compiled import CompiledModel
from acausal.simulate.equations.arguments import arguments
from acausal.simulate.equations.problem import Problem
from acausal.simulate.solvers.base import SMOOTH_SHARE, TOLERANCE_SHARE
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
        """Solve one segment; RuntimeError when it cannot go on."""
        ...


_ALL: tuple[Any, ...] = (Idas, Rosenbrock, Cvodes, Erk, Collocation, Rk, Rk2)
SOLVERS: dict[str, type[Solver]] = {s.name: s for s in _ALL}


# States up to which a method that needs no start-up goes through the stretches of a delay faster than BDF.
_FEW = 200
# Breaks of inputs over time from which they decide.
_MANY = 50
# Unknowns up to which a method of order 5 with a factorisation a step is affordable everywhere; BDF ends a hundred
# times farther off where errors are not damped (docs/accuracy.md).
_SMALL = 100
# The smallest tolerance that a solver gets; below it steps are ruled by rounding.
_FINEST = 1e-13


def solver_named(name: str) -> Solver:
    """The solver of this name; UsageError AC032 lists the known ones."""
    if name not in SOLVERS:
        raise UsageError("AC032", f"there is no solver '{name}'", help=f"solvers: auto, {', '.join(SOLVERS)}")
    return SOLVERS[name]()


def choose(compiled: CompiledModel, wanted: str, step: float | None, breaks: int = 0) -> tuple[Solver, str]:
    """The solver for `wanted`, and why; "auto" decides by structure, and by the number of breaks of its inputs."""
    if wanted != "auto":
        return solver_named(wanted), "as asked for"
    if step is not None:
        return solver_named("rk2"), "a fixed step was given"
    events = compiled.state_events
    states = len(compiled.continuous)
    kind = f"{'a DAE' if compiled.algebraic else 'an ODE'} of {states} state{'s' if states != 1 else ''}"
    # a one-step method starts again after an event at no cost (docs/devdocs/events.md)
    if (events.relations or events.samples) and not compiled.algebraic and compiled.n_dynamic:
        if compiled.n_dynamic > _SMALL and is_never_stiff(compiled):
            return solver_named(
                "erk"
            ), f"{kind} with events of its variables, no state acts back on itself: never stiff"
        return solver_named("rosenbrock"), f"{kind} with events of its variables"
    if compiled.delays and not compiled.algebraic and len(compiled.states) <= _FEW:
        return solver_named("rosenbrock"), f"{kind} with delays: many fresh starts"
    if breaks > _MANY and not compiled.algebraic and 0 < compiled.n_dynamic <= _FEW:
        return solver_named("rosenbrock"), f"an ODE with inputs that break {breaks} times: many fresh starts"
    size = compiled.n_dynamic + len(compiled.algebraic)
    # its error test includes iterated variables, and those of closed loops are noise where a loop comes to an end of
    # its way: it stops there (EngineV6, Fourbar1), IDAS does not, and holds the tolerance
    is_loop = bool(compiled.algebraic) and bool(compiled.solution.structure.invariants)
    if is_smooth(compiled) and compiled.n_dynamic and size <= _SMALL and not is_loop:
        return solver_named(
            "rosenbrock"
        ), f"{kind} without events of its variables, small enough for a method of order 5"
    return solver_named("idas"), f"{kind}, stiffness unknown"


def is_never_stiff(compiled: CompiledModel) -> bool:
    """Whether the structure shows that no Newton matrix is needed: an ODE in which no state acts back on itself.

    The slopes of the rates can be sorted into a strict triangle, so their eigenvalues are zero wherever the run goes
    and in all modes, as for shafts whose friction does not depend on the speed. Not so where functions are steep
    (`suits_event_loop`), and not with delays, through which a state acts on itself later.
    """
    n = compiled.n_dynamic
    if compiled.algebraic or compiled.delays or arguments(compiled) is not None:
        return False
    slopes = ca.DM(compiled.rhs.jac_sparsity(0, 1))[:n, :n].sparsity()
    count, _, _ = slopes.scc()
    return bool(count == n and not any(slopes.has_nz(k, k) for k in range(n)))


def is_smooth(compiled: CompiledModel) -> bool:
    """Whether nothing but time interrupts a run: no events of variables, no delays."""
    return compiled.state_events.are_silent and not compiled.delays


def share_of(compiled: CompiledModel, solver: Solver, tolerance: float, bends: bool = False) -> float:
    """The share of a tolerance that a solver gets for its local errors.

    BDF with stabilised constraints gets the small one in any case: on closed loops it ends 30 to 100 times farther off
    than its local errors, one-step methods do not (measured). Along undamped motions these end ten times as far off as
    without the constraint (a body after 1600 turns 20 tolerances, an oscillator after 1000 periods 2): they get a
    quarter, but for closed loops of joints, whose rounding is as large: runs crawl there. Where a solver `bends` with
    the rows of a table of time all along, what it loses at each of them adds up as well; so does what it loses where it
    starts again at the stretches of a delay, which the delay brings back besides.
    """
    is_stabilised = bool(compiled.solution.structure.invariants)
    is_long = is_smooth(compiled) or bends or (solver.multistep and (is_stabilised or bool(compiled.delays)))
    share = SMOOTH_SHARE if is_long else TOLERANCE_SHARE
    if is_stabilised and is_smooth(compiled) and not solver.multistep and not compiled.flat.loops:
        share /= 4.0
    return min(TOLERANCE_SHARE, max(share, _FINEST / tolerance))
