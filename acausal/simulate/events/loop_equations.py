"""The equations of the compiled event loop: an ODE that CasADi's one-step methods stop at a crossing of its guards.

CasADi evaluates the guards after each step and locates zero crossings on its dense output. It does not iterate after a
jump, executes only one of two crossings within a step, and its dense output is less accurate than the steps. Therefore
there is no transition, and a crossing ends the integration (`native/rows.c`). The loop (`native/event_loop.c`)
integrates once more to where it has stopped, locates the crossing among ends of steps, and executes the event by the
functions that are compiled with the equations.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca

from acausal.lower.variants.implicit import differentiable
from acausal.simulate.equations.arguments import arguments as steep_arguments
from acausal.simulate.events.regime import Regime
from acausal.simulate.events.resolution.phases import turning_rate
from acausal.simulate.native.equations import HELD, parametric
from acausal.simulate.native.event_loop import EventLoopProgram
from acausal.simulate.native.jacobian import jacobian
from acausal.simulate.native.policy import Library, StoppingEquations
from acausal.simulate.solvers.base import bounded
from acausal.simulate.solvers.segment import Segment

_NAMES = ["t", "x", "z", "p", "u"], ["ode", "alg", "quad", "zero"]


def compiled_program(regime: Regime, segment: Segment, plugin: str) -> Library[EventLoopProgram] | None:
    """The integrator of a regime as compiled C, if it is compiled already or compilation pays; otherwise None."""
    problem = regime.problem

    def instructions() -> int:
        functions = (
            regime.active_set.watch,
            regime.active_set.rates.function,
            problem.compiled.events.round,
            regime.active_set.relaxed,
        )
        return sum(int(f.n_instructions()) for f in functions)

    return problem.native.stopping(
        plugin,
        _settings(segment),
        lambda: stopping_equations(regime, problem.native.zeros),
        lambda: (regime.active_set.watch, *_steep_search(regime)),
        instructions,
    )


def _steep_search(regime: Regime) -> tuple[Any, ...]:
    """The function by which the compiled event loop searches steps for steep functions, if there are any."""
    known = steep_arguments(regime.compiled)
    return () if known is None else (known.along(),)


def _settings(segment: Segment) -> dict[str, Any]:
    settings: dict[str, Any] = {
        "reltol": segment.tolerances.relative,
        "abstol": segment.tolerances.absolute,
        "max_num_steps": 10**6,
        "event_tol": 1e-13,
        "max_events": 3,
        **bounded(segment),
    }
    return {**settings, "step_size": segment.step} if segment.step else settings


def stopping_equations(regime: Regime, zeros: Sequence[int]) -> StoppingEquations:
    """The ODE and the guards at which it stops.

    The parameters of the DAE are `[h, shift, band]`, where h depends on `[c, m, d]` alone, with c as in
    `native/equations.py`. Parameters at `zeros` are zero regardless of p. "judged" is
    `(t, x, h, errors of x) -> (g, dg/dt, noise, rate)`: of all guards, and the largest rate of a phase in them.
    """
    compiled = regime.compiled
    n, nq, nm = compiled.n_dynamic, compiled.quadratures, compiled.n_modes
    scale = ca.DM(regime.problem.scale_x)
    t, x, z = ca.SX.sym("t"), ca.SX.sym("x", n), ca.SX.sym("z", 0)
    p, u = ca.SX.sym("p", len(compiled.parameters)), ca.SX.sym("u", len(compiled.inputs))
    numbers = ca.SX.sym("numbers", nm + compiled.discretes + 1)
    m, d, shift = ca.vertsplit(numbers, [0, nm, nm + compiled.discretes, nm + compiled.discretes + 1])
    with_zeros = ca.SX(p)
    for k in zeros:
        with_zeros[k] = 0
    arguments = (t + shift, ca.vertcat(x * scale, ca.SX(nq, 1), d), z, u, with_zeros, m)
    ode, guards = ca.densify(compiled.rhs(*arguments)[0])[:n] / scale, ca.densify(regime.active_set.watch(*arguments))
    band = ca.SX.sym("band", guards.numel())
    at, states, errors = ca.SX.sym("at"), ca.SX.sym("states", n + nq), ca.SX.sym("errors", n + nq + compiled.discretes)
    here = at, ca.vertcat(states, d), z, u, with_zeros, m
    rates = regime.active_set.rates.function(*here, errors, z)[:2]
    turning = turning_rate(compiled, at, here[1], here[2:])
    judged = [ca.densify(e) for e in (regime.active_set.watch(*here), *rates, turning)]
    slopes = differentiable(compiled, arguments)
    for_slopes = [slopes.rates[:n] / scale, slopes.values] if slopes.is_shorter else []
    shared: Any = ca.cse([ode, guards, *judged, *for_slopes])
    shared, symbols, constants = parametric(shared, p, u)
    # once more with modes as parameters: most equations of clutches depend on nothing else
    parameters, none = ca.vertcat(symbols, m, d), ca.SX(0, 1)
    (ode, guards, *shared), kept, held = parametric(ca.cse(shared), parameters, none, HELD)
    judged, for_slopes = shared[: len(judged)], shared[len(judged) :]
    inputs = [t, x, z, ca.vertcat(kept, shift, band), none]
    dae = ca.Function("dae", inputs, [ode, none, none, ca.densify(guards + band)], *_NAMES, {"cse": True})
    whole = ca.vertcat(states, ca.SX.sym("unused", compiled.discretes))
    events = ca.Function("judged", [at, whole, kept, errors], judged, {"cse": True}), compiled.events.round
    events = *events, regime.active_set.relaxed, *_steep_search(regime)
    slopes_of_dae = jacobian(slopes, inputs, *for_slopes) if for_slopes else None
    return StoppingEquations(dae, constants, events, held, slopes_of_dae)
