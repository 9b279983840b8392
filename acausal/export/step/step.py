"""One step of a fixed-step method as a function `step(x, u, p) -> (x, y)`, for real-time loops.

The work of a call is bounded: no step control, no iteration until convergence, no memory except the arguments. Its C
code is straight-line, except for the passes of an event iteration. The methods are those of `methods.py`; models with
events use `hybrid_step.py`, with their modes as part of x. Relations of time change at the first multiple of the step
that is not before their instant, which is exact for instants on this grid.

Conditions that a step of bounded work cannot guarantee are reported by flags after the outputs in y (0 if satisfied),
and an estimate of the accuracy follows them (`defect.py`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from acausal.diagnose.words import listed
from acausal.errors import ExportError, UsageError
from acausal.export.casadi.parts import spoilt
from acausal.export.forms import STEP, check
from acausal.export.observed import observed_function
from acausal.export.ports import Output, named_outputs, output_ports, parameter_ports, variable_ports
from acausal.export.start_point import StartPoint, start_point
from acausal.export.step.hybrid_step import HybridStep
from acausal.export.step.methods import IMPLICIT, METHODS, Method
from acausal.export.step.source import StepFunction
from acausal.export.step.timely import at_end, inside, note, timely
from acausal.lower.build import Symbols
from acausal.lower.cache.divisors import refusal
from acausal.lower.casadi_model import Port, Ports
from acausal.lower.compiled import CompiledModel
from acausal.simulate.equations.problem import Problem
from acausal.simulate.record.meeting.kinked import meeting_relations

# Limit on simultaneous unknowns: unrolled factorisations grow with the cube of their number.
_MOST_UNKNOWNS = 60


def step_function(
    compiled: CompiledModel,
    step: float,
    method: str = "rk4",
    outputs: Sequence[str] | None = None,
    *,
    error: bool = True,
) -> StepFunction:
    """Create a function for one step of length `step` [s] of the model, events included.

    Parameters
    ----------
    method
        "rk2", "rk4", "rosenbrock" or "sdirk".
    outputs
        Names of the variables in y, as in `CompiledModel.casadi`.
    error
        Whether y ends with `step.error`, see `StepFunction`; without it a step evaluates the rates less often.

    Raises
    ------
    UsageError
        AC034 for an unknown method, AC030 for a step that is not positive.
    ExportError
        AC605 for a clock that ticks more than once in a step, AC606 for more than 60 simultaneous unknowns.
    """
    if method not in METHODS:
        raise UsageError("AC034", f"there is no method '{method}'", help=f"methods: {', '.join(METHODS)}")
    if not 0 < step < float("inf"):
        raise UsageError("AC030", f"step {step:g} s is not positive")
    wanted = named_outputs(compiled, outputs)
    left_out = check(compiled, STEP, wanted)
    dynamic = compiled.n_dynamic if method in IMPLICIT else 0
    size = dynamic + len(compiled.algebraic) if method == "sdirk" else max(dynamic, len(compiled.algebraic))
    if size > _MOST_UNKNOWNS:
        raise ExportError(
            "AC606",
            f"a step of {compiled.name} solves for {size} unknowns at once: the limit of unrolled code is "
            f"{_MOST_UNKNOWNS}",
            help="reduce the model, or use an explicit method" if method in IMPLICIT else "reduce the model",
        )
    return _Builder(compiled, step, method, wanted, left_out, error).result()


class _Builder:
    """Builder of one step function."""

    def __init__(
        self,
        compiled: CompiledModel,
        step: float,
        method: str,
        wanted: Sequence[Output],
        left_out: tuple[str, ...],
        estimates: bool,
    ) -> None:
        self.compiled, self.h, self.wanted, self.left_out = compiled, step, wanted, left_out
        self.estimates = estimates
        events = bool(compiled.state_events)
        # the event iteration is a loop, which only MX supports
        self.kind: Any = ca.MX if events else ca.SX
        self.u: Any = self.kind.sym("u", len(compiled.inputs))
        self.p: Any = self.kind.sym("p", len(compiled.parameters))
        s = Symbols(compiled)
        observed = observed_function(compiled, self.wanted)(*s.inputs)
        rates = compiled.rhs(*s.inputs)
        self.y = ca.Function("y", s.inputs, [ca.densify(observed)])
        rates_function = ca.Function("rates", s.inputs, [ca.densify(v) for v in rates])
        nominal = ca.vertcat(ca.DM(compiled.nominal_x), ca.DM(compiled.nominal_z))
        self.method = Method(method, rates_function, nominal, compiled.discretes)
        if self.method.is_explicit:
            too_large = self.method.too_large(s.t, step, s.x, s.z, [s.u, s.p, s.m])
            self.too_large = ca.Function("too_large", s.inputs, [ca.densify(too_large)])
        self.rough = ca.Function("rough", s.inputs, [self.method.rough(s.t, s.x, s.z, [s.u, s.p, s.m])])
        self.hybrid = HybridStep(compiled, self.method, self.u, self.p, step, estimates) if events else None

    def result(self) -> StepFunction:
        compiled, hybrid = self.compiled, self.hybrid
        begin = hybrid.begin() if hybrid else start_point(compiled)
        modes = hybrid.ports(begin.m) if hybrid else []
        x = self.kind.sym("x", len(compiled.states) + len(compiled.algebraic) + len(modes))
        clock = self.kind.sym("time")
        x_next, y, end = self._next(x, clock, begin.t)
        # the event iteration needs the time even if the equations do not
        timed = hybrid.is_timed or self._shows_time if hybrid else ca.depends_on(ca.vertcat(x_next, y), clock)
        step = ca.Function("step", [x, clock, self.u, self.p], [ca.vertcat(x_next, end) if timed else x_next, y])
        whole = self.kind.sym("x", x.numel() + timed)
        new: Any = step(whole[: x.numel()], whole[-1] if timed else begin.t, self.u, self.p)
        new = ca.cse([ca.densify(v) for v in new])
        if (refused := refusal(compiled, None)) is not None:
            new = spoilt(new, refused(self.p))
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
            y=Ports([*output_ports(self.wanted, np.zeros(len(self.wanted))), *self.flags]),
            notes=(
                *(*compiled.flat.notes, *begin.notes, *self.left_out, *self.notes, *_meeting(compiled, begin)),
                *_other_start(compiled),
            ),
        )

    def _next(self, stored: Any, clock: Any, start: float) -> tuple[Any, Any, Any]:
        """(x without its time, y, time) at the end of a step from `stored`, which is x without its time."""
        compiled, hybrid, h = self.compiled, self.hybrid, self.h
        nx, nz = len(compiled.states), len(compiled.algebraic)
        x, z, kept = ca.vertsplit(stored, [0, nx, nx + nz, stored.numel()])
        # compute time as a multiple of the step: a sum of steps would drift off the samples within a day
        k = ca.floor((clock - start) / h + 0.5)
        on_grid = ca.fabs(start + k * h - clock) < at_end(clock, h)
        t, end = ca.if_else(on_grid, start + k * h, clock), ca.if_else(on_grid, start + (k + 1) * h, clock + h)
        before = hybrid.modes(t, kept) if hybrid else self._timely(t)
        large = self.too_large(t, x, z, self.u, self.p, before) if self.method.is_explicit else 0
        if hybrid:
            x, z, m, settled, located, rough, later, error = hybrid.step(t, x, z, before)
            large = ca.logic_or(large, later)
            kept = m[hybrid.kept] if hybrid.kept else ca.MX(0, 1)
            flags = [ca.logic_not(settled), ca.logic_or(ca.logic_not(located), inside(compiled, t, h, self.p))]
        else:
            flags = [inside(compiled, t, h, self.p)] if compiled.n_timely else []
            held = [self.u, self.p, before]
            x1, z1, rough = self.method.step(t, h, x, z, held)
            error = self.method.error(t, h, x, z, x1, z1, held) if self.estimates else 0
            x, z = x1, z1
            m = self._timely(end)
            if compiled.n_timely:
                z = self.method.algebraic(end, x, z, [self.u, self.p, m])
        if self.method.is_explicit:
            flags.append(large)
        if self.method.iterates:
            flags.append(ca.logic_or(rough, self.rough(end, x, z, self.u, self.p, m)))
        if self.estimates:
            flags.append(error)
        return ca.vertcat(x, z, kept), ca.vertcat(self.y(end, x, z, self.u, self.p, m), *flags), end

    @property
    def _shows_time(self) -> bool:
        return bool(self.y.jac_sparsity(0, 0).nnz())

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on the limits of steps of this length."""
        return (*(self.hybrid.notes if self.hybrid else ()), *note(self.compiled, self.h))

    @property
    def flags(self) -> list[Port]:
        """Ports of the flags after the outputs, and of the estimated error."""
        unsettled = Port(
            "step.unsettled", "", "1 if the event iteration of the step did not end, or contradicts itself", 0.0
        )
        missed = Port("step.unlocated", "", "1 if the step missed an event in addition to the one it located", 0.0)
        large = Port("step.too_large", "", "1 if the explicit method is unstable at this step", 0.0)
        events = [unsettled, missed] if self.hybrid else [missed] * bool(self.compiled.n_timely)
        rough = Port("step.unconverged", "", "1 if Newton's method did not converge, or solutions may meet", 0.0)
        error = Port(
            "step.error", "", "Estimated error that the step adds to a state, relative to its nominal value", 0.0
        )
        flags = events + [large] * self.method.is_explicit + [rough] * self.method.iterates
        return flags + [error] * self.estimates

    def _timely(self, t: Any) -> Any:
        """Modes just after an instant, in a model without events; modes of relations of variables, unused, are 0."""
        compiled = self.compiled
        return ca.vertcat(timely(compiled, t, self.h, self.p), ca.SX.zeros(compiled.n_modes - compiled.n_timely, 1))


def _other_start(compiled: CompiledModel) -> tuple[str, ...]:
    """A note if the start of states or modes depends on parameters, which are arguments of a step."""
    slopes = compiled.guess.jac_sparsity(0, 0)
    if not slopes.nnz() and not compiled.start.conditions and not (compiled.parameters and compiled.state_events):
        return ()
    return (
        "x.start is the start for p.start: compile(model, parameters={...}) gives that of other parameters, with which "
        "a run begins elsewhere",
    )


def _meeting(compiled: CompiledModel, begin: StartPoint) -> tuple[str, ...]:
    """A note on events at which solutions of algebraic equations meet, as far as they are recognised at the start."""
    problem = Problem(compiled, begin.p, begin.u)
    found = meeting_relations(problem, begin.t, begin.x, begin.z, begin.m)
    if not found:
        return ()
    return (
        f"solutions of algebraic equations meet where {listed(found, 3)} changes: no flag tells which of them a step "
        "continues with; state which one is meant, by where(...) or another form of the equation",
    )
