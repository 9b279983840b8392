"""A controller on a plant: the model once more, with other parameters, between samples integrated by IDAS."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from acausal.arrays import Vector
from acausal.lower.compiled import CompiledModel
from acausal.optimal_control.quantities import Quantities
from acausal.optimal_control.receding.controller import Controller
from acausal.result.result import Result
from acausal.result.series import TimeSeries
from acausal.simulate.run import simulate

Estimate = Callable[[float, Mapping[str, float]], Mapping[str, float]]


@dataclass(frozen=True, eq=False)
class ClosedLoop:
    """What a controlled plant did.

    Attributes
    ----------
    result
        The plant simulated with the inputs that the controller gave, each held for its sample.
    cost
        Processor time of each sample [s], shape (n,); `iterations` those of ipopt.
    """

    result: Result
    cost: Vector
    iterations: Vector


def closed_loop(
    controller: Controller,
    plant: CompiledModel,
    *,
    samples: int,
    parameters: Mapping[str, float] | None = None,
    measure: Sequence[str] = (),
    estimate: Estimate | None = None,
    tolerance: float = 1e-8,
) -> ClosedLoop:
    """Run a controller on a plant from the plant's start.

    Parameters
    ----------
    plant
        A model with the states and inputs of the controller's.
    parameters
        The plant's own values, which the controller does not know.
    measure, estimate
        At each sample `estimate(time, measured)` gets the named variables of the plant, inputs as they were held up to
        now, and returns parameters for the controller, those that it does not return as in its problem, and states that
        the controller takes instead of the plant's.

    Raises
    ------
    OptimizationError
        AC703 where the controller finds no inputs.
    UsageError
        AC010 for an unknown variable.
    """
    q = Quantities(plant, dict(parameters or {}))
    for name in measure:
        q[name]
    dae = q.dae()
    step = _sample(q, dae, controller.step)
    x, z, u = q.first, q.begin.z, q.begin.u
    names, order = [o.name for o in q.outputs], [q.states.names.index(n) for n in controller.states]
    given, cost, iterations = [], np.zeros(samples), np.zeros(samples, dtype=int)
    for k in range(samples):
        t = q.begin.t + k * controller.step
        measured = dict(zip(names, np.array(dae(t, x, z, u, q.p)[2]).ravel().tolist(), strict=True))
        began = clock.process_time()
        known = estimate(t, measured) if estimate is not None else None
        states = dict(zip(controller.states, q.coordinates.states(x[:, None]).ravel()[order].tolist(), strict=True))
        found = {} if known is None else dict(known)
        states |= {name: found.pop(name) for name in controller.states if name in found}
        inputs = controller(states, found)
        cost[k], iterations[k] = clock.process_time() - began, controller.iterations
        u = np.array([inputs[n] for n in q.u.names])
        given.append(u)
        ended = step(x0=x / q.x.nominal, z0=z, p=ca.vertcat(t, *u))
        x, z = np.array(ended["xf"]).ravel() * q.x.nominal, np.array(ended["zf"]).ravel()
    times = q.begin.t + controller.step * np.arange(samples + 1)
    held = np.vstack([*given, given[-1]])
    result = simulate(
        plant,
        inputs={n: TimeSeries(times, held[:, k], "hold") for k, n in enumerate(q.u.names)},
        parameters=dict(parameters or {}),
        start_time=float(times[0]),
        stop_time=float(times[-1]),
        output_interval=controller.step / 10,
        tolerance=tolerance,
        solver="idas",
    )
    return ClosedLoop(result, cost, iterations)


def _sample(q: Quantities, dae: Any, length: float) -> Any:
    """One sample as an integrator; its parameters are the time of its start and the inputs."""
    nx, nz, nu = (dae.numel_in(k) for k in (1, 2, 3))
    s, x, z, p = ca.SX.sym("s"), ca.SX.sym("x", nx), ca.SX.sym("z", nz), ca.SX.sym("p", 1 + nu)
    size = ca.DM(q.x.nominal)
    ode, alg, _ = dae(p[0] + length * s, x * size, z, p[1:], q.p)
    system = {"x": x, "t": s, "p": p, "ode": length * ode / size}
    options: dict[str, Any] = {"reltol": 1e-9, "abstol": 1e-12, "max_num_steps": 20000, "first_time": 1e-6}
    if nz:
        system |= {"z": z, "alg": alg}
        options["suppress_algebraic"] = True
    return ca.integrator("sample", "idas", system, 0.0, 1.0, options)
