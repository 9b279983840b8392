"""The solvers by name; one file each, all through the interface of `base.py`."""

from __future__ import annotations

from typing import Any, Protocol

from acausal.errors import UsageError
from acausal.lower.compiled import CompiledModel
from acausal.simulate.problem import Problem
from acausal.simulate.solvers.base import Piece, Segment
from acausal.simulate.solvers.cvodes import Cvodes
from acausal.simulate.solvers.erk import Erk
from acausal.simulate.solvers.fixed import Collocation, Rk, Rk2
from acausal.simulate.solvers.idas import Idas
from acausal.simulate.solvers.rosenbrock import Rosenbrock


class Solver(Protocol):
    """See `base.py` for the contract."""

    name: str
    algebraic: bool
    fixed_step: bool

    def integrate(self, problem: Problem, segment: Segment) -> Piece:
        """Solve one segment; RuntimeError when it cannot go on."""
        ...


_ALL: tuple[Any, ...] = (Idas, Rosenbrock, Cvodes, Erk, Collocation, Rk, Rk2)
SOLVERS: dict[str, type[Solver]] = {s.name: s for s in _ALL}


# States up to which a method that needs no start-up goes through the stretches of a delay faster than BDF.
_FEW = 200


def solver_named(name: str) -> Solver:
    """The solver of this name; UsageError AC032 lists the known ones."""
    if name not in SOLVERS:
        raise UsageError("AC032", f"there is no solver '{name}'", help=f"solvers: auto, {', '.join(SOLVERS)}")
    return SOLVERS[name]()


def choose(compiled: CompiledModel, wanted: str, step: float | None) -> tuple[Solver, str]:
    """The solver for `wanted`, and why; "auto" decides by structure."""
    if wanted != "auto":
        return solver_named(wanted), "as asked for"
    if step is not None:
        return solver_named("rk2"), "a fixed step was given"
    events = compiled.state_events
    # a one-step method starts again after an event at no cost (docs/devdocs/events.md)
    if (events.relations or events.samples) and not compiled.algebraic and compiled.n_dynamic:
        return solver_named("rosenbrock"), f"an ODE of {len(compiled.states)} states with events of its variables"
    if compiled.delays and not compiled.algebraic and len(compiled.states) <= _FEW:
        return solver_named("rosenbrock"), f"an ODE of {len(compiled.states)} states with delays: many fresh starts"
    kind = "a DAE" if compiled.algebraic else "an ODE"
    return solver_named("idas"), f"{kind} of {len(compiled.states)} states, stiffness unknown"
