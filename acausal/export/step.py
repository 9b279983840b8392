"""One step of a fixed-step method as a function `step(x, u, p) -> (x, y)`, for loops in real time.

Every call does the same operations in the same order: no step control, no iteration until convergence, no memory but
the arguments. The C of it is straight-line code. The methods are those of `acausal.export.methods`; models with `when`
clauses, samples or discrete variables go by `acausal.export.hybrid_step`, their modes being part of x. Relations of
time hold from the first multiple of the step that is not before them: on the grid that is exact.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from acausal.errors import ExportError, UsageError
from acausal.export.casadi_model import Port, Ports
from acausal.export.functions import begin_of, observed_function
from acausal.export.hybrid_step import HybridStep, has_memory, timely
from acausal.export.methods import IMPLICIT, METHODS, Method
from acausal.export.ports import named_outputs, output_ports, parameter_ports, variable_ports
from acausal.lower.compiled import CompiledModel, Symbols
from acausal.lower.delays import PADE, refuse_delays

# Unrolled factorisations grow with the cube of this.
_MOST_UNKNOWNS = 60


@dataclass(frozen=True, eq=False)
class StepFunction:
    """`function` is `step(x, u, p) -> (x, y)`; vectors are described by the attributes of the same names.

    x holds the states, discrete ones among them, then the algebraic variables, then the modes of a model with events,
    then the time where the equations depend on it. y belongs to the new x. u is constant during the `step` [s].
    """

    name: str
    method: str
    step: float
    function: Any
    x: Ports
    u: Ports
    p: Ports
    y: Ports
    notes: tuple[str, ...] = ()

    def __repr__(self) -> str:
        sizes = ", ".join(f"{len(getattr(self, v))} {v}" for v in "xupy")
        return f"StepFunction({self.name}: {self.method}, {self.step:g} s, {sizes})"

    def source(self) -> str:
        """C: the function in CasADi's calling convention, and `NAME_step` with plain arrays."""
        from acausal.export.step_source import source

        return source(self)

    def save(self, path: str | Path) -> None:
        """Write the C source, completely or not at all; UsageError AC012 when it cannot be written."""
        from acausal.files import atomic

        with atomic(Path(path)) as file:
            file.write(self.source().encode())


def step_function(
    compiled: CompiledModel, step: float, method: str = "rk4", outputs: Sequence[str] | None = None
) -> StepFunction:
    """One step of `step` seconds.

    Parameters
    ----------
    method
        "rk2", "rk4", "rosenbrock" or "sdirk".
    outputs
        What y holds, as in `CompiledModel.casadi`.

    Raises
    ------
    UsageError
        AC034 for an unknown method, AC030 for a step that is none.
    ExportError
        AC605 for a clock that ticks more than once in a step, AC606 for more than 60 unknowns that must be solved for.
    """
    if method not in METHODS:
        raise UsageError("AC034", f"there is no method '{method}'", help=f"methods: {', '.join(METHODS)}")
    if not 0 < step < float("inf"):
        raise UsageError("AC030", f"step {step:g} s is not positive")
    refuse_delays(compiled.flat, "a step as a function of states", PADE)
    dynamic = compiled.n_dynamic if method in IMPLICIT else 0
    size = dynamic + len(compiled.algebraic) if method == "sdirk" else max(dynamic, len(compiled.algebraic))
    if size > _MOST_UNKNOWNS:
        raise ExportError(
            "AC606",
            f"a step of {compiled.name} solves for {size} unknowns at once, which is written out in full up to "
            f"{_MOST_UNKNOWNS}",
            help="reduce the model, or take an explicit method" if method in IMPLICIT else "reduce the model",
        )
    return _Made(compiled, step, method, outputs).result()


class _Made:
    """The symbols of one step function."""

    def __init__(self, compiled: CompiledModel, step: float, method: str, outputs: Sequence[str] | None) -> None:
        self.compiled, self.h = compiled, step
        self.wanted = named_outputs(compiled, outputs)
        self.u, self.p = ca.SX.sym("u", len(compiled.inputs)), ca.SX.sym("p", len(compiled.parameters))
        s, remembers = Symbols(compiled), has_memory(compiled)
        # without memory relations are whatever holds at a point; those of time are known for the whole step
        ends = [0, compiled.n_timely, compiled.n_modes]  # a slice of a scalar that leaves nothing would be a row
        here = ca.vertsplit(compiled.all_modes(s.t, s.x, s.z, s.u, s.p), ends)[1]
        m = s.m if remembers else ca.vertcat(ca.vertsplit(s.m, ends)[0], here)
        observed = observed_function(compiled, self.wanted)(s.t, s.x, s.z, s.u, s.p, m)
        rates = compiled.rhs(s.t, s.x, s.z, s.u, s.p, m)
        self.y = ca.Function("y", s.inputs, [ca.densify(observed)])
        self.method = Method(method, ca.Function("rates", s.inputs, [ca.densify(v) for v in rates]))
        self.hybrid = HybridStep(compiled, self.method, self.u, self.p, step) if remembers else None

    def result(self) -> StepFunction:
        compiled, hybrid = self.compiled, self.hybrid
        begin = hybrid.begin() if hybrid else begin_of(compiled)
        modes = hybrid.ports(begin.m) if hybrid else []
        x = ca.SX.sym("x", len(compiled.states) + len(compiled.algebraic) + len(modes))
        clock = ca.SX.sym("time")
        x_next, y, end = self._next(x, clock, begin.t)
        timed = ca.depends_on(ca.vertcat(x_next, y), clock)
        step = ca.Function("step", [x, clock, self.u, self.p], [ca.vertcat(x_next, end) if timed else x_next, y])
        whole = ca.SX.sym("x", x.numel() + timed)
        new: Any = step(whole[: x.numel()], whole[-1] if timed else begin.t, self.u, self.p)
        new = ca.cse([ca.densify(v) for v in new])
        ports = [
            *variable_ports(compiled, compiled.state_variables, begin.x),
            *variable_ports(compiled, compiled.solution.algebraic, begin.z),
            *modes,
            *([Port("time", "s", "Time", begin.t)] if timed else []),
        ]
        return StepFunction(
            name=compiled.name,
            method=self.method.name,
            step=self.h,
            function=ca.Function("step", [whole, self.u, self.p], new, ["x", "u", "p"], ["x_next", "y"]),
            x=Ports(ports),
            u=variable_ports(compiled, compiled.solution.structure.reduced.inputs, begin.u),
            p=parameter_ports(compiled),
            y=output_ports(self.wanted, np.zeros(len(self.wanted))),
            notes=(*compiled.flat.notes, *begin.notes, *_notes(compiled)),
        )

    def _next(self, stored: Any, clock: Any, start: float) -> tuple[Any, Any, Any]:
        """All of x but its time, y, and the time, at the end of a step from `stored`."""
        compiled, hybrid, h = self.compiled, self.hybrid, self.h
        nx, nz = len(compiled.states), len(compiled.algebraic)
        x, z, kept = ca.vertsplit(stored, [0, nx, nx + nz, stored.numel()])
        # the time is a multiple of the step: a sum of steps would have drifted off the samples after a day
        turn = ca.floor((clock - start) / h + 0.5)
        on_grid = ca.fabs(start + turn * h - clock) < 1e-6 * h
        t, end = ca.if_else(on_grid, start + turn * h, clock), ca.if_else(on_grid, start + (turn + 1) * h, clock + h)
        if hybrid:
            x, z, m = hybrid.step(t, x, z, hybrid.modes(t, kept))
            kept = ca.vertcat(ca.SX(0, 1), *(m[k] for k in hybrid.kept))
        else:
            x, z = self.method.step(t, h, x, z, [self.u, self.p, self._timely(t)])
            m = self._timely(end)
            if compiled.n_timely:
                z = self.method.algebraic(end, x, z, [self.u, self.p, m])
        return ca.vertcat(x, z, kept), self.y(end, x, z, self.u, self.p, m), end

    def _timely(self, t: Any) -> Any:
        """Modes just after an instant; those of variables are not looked at."""
        compiled = self.compiled
        return ca.vertcat(timely(compiled, t, self.h, self.p), ca.SX.zeros(compiled.n_modes - compiled.n_timely, 1))


def _notes(compiled: CompiledModel) -> tuple[str, ...]:
    """What a step does not do."""
    events = compiled.state_events
    ends = [f"a step does not end the run: {c.text} ({c.where})" for c in events.clauses if c.terminate is not None]
    return (*ends, *(f"a step does not look at the assertion: {a.message} ({a.where})" for a in events.asserts))
