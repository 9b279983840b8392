"""The equations of the compiled event loop: an ODE that CasADi's one-step methods stop at a crossing of its guards.

CasADi evaluates the guards after each step and locates zero crossings on its dense output. It does not iterate after a
jump, executes only one of two crossings within a step, and its dense output is less accurate than the steps. Therefore
the transition only stops the clock: a state `flag` becomes 1, which makes all rates zero, and another state, `watch`,
holds the time that has passed. The loop (`native/event_loop.c`) integrates once more to where it has stopped, locates
the crossing among ends of steps, and executes the event by the functions that are compiled with the equations.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca

from acausal.lower.variants.implicit import Differentiable, differentiable
from acausal.simulate.equations.arguments import arguments as steep_arguments
from acausal.simulate.events.location.phases import turning_rate
from acausal.simulate.events.regime import Regime
from acausal.simulate.native.equations import HELD, parametric
from acausal.simulate.native.event_loop import EventLoopProgram
from acausal.simulate.native.jacobian import jacobian
from acausal.simulate.native.policy import Library, StoppingEquations
from acausal.simulate.solvers.base import bounded
from acausal.simulate.solvers.segment import Segment

# Added to guards that must not stop the integration.
_NEVER = 1e300
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
        problem.n_dynamic + 2,
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
    """The ODE with a stop watch and a stop flag, and the transition that sets the flag.

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
    stopping = _Stopping(t, x, z, ca.vertcat(kept, shift, band), none)
    dae, transition = stopping.dae(ode, guards + band), stopping.transition()
    whole = ca.vertcat(states, ca.SX.sym("unused", compiled.discretes))
    events = ca.Function("judged", [at, whole, kept, errors], judged, {"cse": True}), compiled.events.round
    events = *events, regime.active_set.relaxed, *_steep_search(regime)
    slopes_of_dae = stopping.jacobian(slopes, *for_slopes) if for_slopes else None
    return StoppingEquations(dae, transition, constants, events, held, slopes_of_dae)


class _Stopping:
    """An ODE of `(t, x, z, p, u)` with a stop watch and a stop flag as last states."""

    def __init__(self, t: Any, x: Any, z: Any, p: Any, u: Any) -> None:
        self._x, self._watch, self._flag = x, ca.SX.sym("watch"), ca.SX.sym("flag")
        self._state = ca.vertcat(x, self._watch, self._flag)
        self._inputs = [t, self._state, z, p, u]

    def dae(self, ode: Any, zero: Any) -> Any:
        """The DAE of the rates `ode` of x, which stop while the guards `zero` are."""
        none = ca.SX(0, 1)
        # no guard fires once it has stopped: several that are reached at one instant would, one after the other
        results = [self._rates(ode), none, none, ca.densify(zero + _NEVER * self._flag)]
        return ca.Function("dae", self._inputs, results, *_NAMES, {"cse": True})

    def transition(self) -> Any:
        """The transition of the DAE, which sets the flag."""
        given = {"index": ca.SX.sym("index"), **dict(zip(_NAMES[0], self._inputs, strict=True))}
        post = {"post_x": ca.vertcat(self._x, self._watch, 1), "post_z": self._inputs[2]}
        return ca.Function(
            "stop", [given[n] for n in ca.event_in()], [post[n] for n in ca.event_out()], ca.event_in(), ca.event_out()
        )

    def jacobian(self, slopes: Differentiable, ode: Any, values: Any) -> Any:
        """The Jacobian of the DAE, see `native/jacobian.py`."""
        return jacobian(slopes, self._inputs, self._rates(ode), values)

    def _rates(self, ode: Any) -> Any:
        return ca.vertcat((1 - self._flag) * ode, 1 - self._flag, 0)
