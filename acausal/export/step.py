"""One step of a fixed-step method as a function `step(x, u, p) -> (x, y)`, for loops in real time.

Every call does the same operations in the same order: no step control, no iteration until convergence, no memory but
the arguments. The C of it is straight-line code.

Methods: "rk2" (Heun), "rk4" (classical), for models that are not stiff at the step, and "rosenbrock": RODAS3, four
stages, order 3, L-stable (A. Sandu et al., Atmospheric Environment 31 (1997) 3459-3472, in the implementation form of
E. Hairer and G. Wanner, Solving Ordinary Differential Equations II, IV.7). Algebraic variables are solved for at each
stage by three steps of Newton's method from the stage before, so that they are part of x: enough where they change
smoothly from step to step, too few where a step meets a kink.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import casadi as ca

from acausal.errors import ExportError, UsageError
from acausal.export.casadi_model import CasadiModel, Port, Ports
from acausal.lower.compiled import CompiledModel

METHODS = ("rk2", "rk4", "rosenbrock")
_NEWTON_STEPS = 3
# Unrolled factorisations grow with the cube of this.
_MOST_UNKNOWNS = 60

# RODAS3; rows of the lower triangles.
_GAMMA = 0.5
_A = ((), (0.0,), (2.0, 0.0), (2.0, 0.0, 1.0))
_C = ((), (4.0,), (1.0, -1.0), (1.0, -1.0, -8.0 / 3.0))
_M = (2.0, 0.0, 1.0, 1.0)
_ALPHA = (0.0, 0.0, 1.0, 1.0)
_GAMMAS = (0.5, 1.5, 0.0, 0.0)

Rates = Callable[[Any, Any, Any], tuple[Any, Any]]


@dataclass(frozen=True, eq=False)
class StepFunction:
    """`function` is `step(x, u, p) -> (x, y)`; vectors are described by the attributes of the same names.

    x holds the states, then the algebraic variables, then the time where the equations depend on it. y belongs to the
    new x. u is constant during the step of `step` seconds.
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
        "rk2", "rk4" or "rosenbrock".
    outputs
        What y holds, as in `CompiledModel.casadi`.

    Raises
    ------
    UsageError
        AC034 for an unknown method, AC030 for a step that is none.
    ExportError
        AC605 for a model with `when` clauses, AC606 for more than 60 unknowns that must be solved for.
    """
    if method not in METHODS:
        raise UsageError("AC034", f"there is no method '{method}'", help=f"methods: {', '.join(METHODS)}")
    if not 0 < step < float("inf"):
        raise UsageError("AC030", f"step {step:g} s is not positive")
    if compiled.state_events.clauses:
        raise ExportError(
            "AC605",
            f"{compiled.name} has when clauses: what happens at them is no part of a step of fixed length",
            help="export a model without events",
        )
    model = compiled.casadi(outputs)
    size = max(len(model.z), len(model.x) if method == "rosenbrock" else 0)
    if size > _MOST_UNKNOWNS:
        raise ExportError(
            "AC606",
            f"a step of {compiled.name} solves for {size} unknowns at once, which is written out in full up to "
            f"{_MOST_UNKNOWNS}",
            help="reduce the model, or take an explicit method" if method == "rosenbrock" else "reduce the model",
        )
    return _Made(model, step, method).result()


class _Made:
    """The symbols of one step function."""

    def __init__(self, model: CasadiModel, step: float, method: str) -> None:
        self.model, self.h, self.method = model, step, method
        dae = model.dae
        self.nx, self.nz = len(model.x), len(model.z)
        self.timed = any(dae.jac_sparsity(k, dae.index_in("t")).nnz() for k in range(dae.n_out()))
        self.x = ca.SX.sym("x", self.nx + self.nz + self.timed)
        self.u, self.p = ca.SX.sym("u", len(model.u)), ca.SX.sym("p", len(model.p))

    def result(self) -> StepFunction:
        parts = ca.vertsplit(self.x, [0, self.nx, self.nx + self.nz, self.x.numel()])
        t = parts[2] if self.timed else ca.SX(self.model.start_time)
        if self.method == "rosenbrock":
            x, z = self._rosenbrock(t, parts[0], parts[1])
        else:
            x, z = self._explicit(t, parts[0], parts[1])
        y = self.model.dae(t + self.h, x, z, self.u, self.p)[2]
        new = [x, z, t + self.h] if self.timed else [x, z]
        outputs: Any = ca.cse([ca.densify(ca.vertcat(*new)), ca.densify(y)])
        function = ca.Function("step", [self.x, self.u, self.p], outputs, ["x", "u", "p"], ["x_next", "y"])
        clock = [Port("time", "s", "Time", self.model.start_time)] if self.timed else []
        return StepFunction(
            name=self.model.name,
            method=self.method,
            step=self.h,
            function=function,
            x=Ports([*self.model.x, *self.model.z, *clock]),
            u=self.model.u,
            p=self.model.p,
            y=Ports(replace(port, start=0.0) for port in self.model.y),
            notes=self.model.notes,
        )

    def _rates(self, t: Any, x: Any, z: Any) -> tuple[Any, Any]:
        ode, alg, _ = self.model.dae(t, x, z, self.u, self.p)
        return ode, alg

    def _explicit(self, t: Any, x: Any, z: Any) -> tuple[Any, Any]:
        h, solved, rate = self.h, self._algebraic, self._rates
        z1 = solved(t, x, z)
        k1 = rate(t, x, z1)[0]
        if self.method == "rk2":
            z2 = solved(t + h, x + h * k1, z1)
            new = x + h / 2 * (k1 + rate(t + h, x + h * k1, z2)[0])
            return new, solved(t + h, new, z2)
        z2 = solved(t + h / 2, x + h / 2 * k1, z1)
        k2 = rate(t + h / 2, x + h / 2 * k1, z2)[0]
        z3 = solved(t + h / 2, x + h / 2 * k2, z2)
        k3 = rate(t + h / 2, x + h / 2 * k2, z3)[0]
        z4 = solved(t + h, x + h * k3, z3)
        k4 = rate(t + h, x + h * k3, z4)[0]
        new = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        return new, solved(t + h, new, z4)

    def _algebraic(self, t: Any, x: Any, z: Any) -> Any:
        """Algebraic variables at a point, by a fixed number of Newton's steps from `z`."""
        if not self.nz:
            return z
        if self._newton is None:
            here = [ca.SX.sym("t"), ca.SX.sym("x", self.nx), ca.SX.sym("z", self.nz)]
            alg = self._rates(*here)[1]
            step = here[2] - ca.solve(ca.jacobian(alg, here[2]), alg)
            self._newton = ca.Function("newton", [*here, self.u, self.p], [step])
        for _ in range(_NEWTON_STEPS):
            z = self._newton(t, x, z, self.u, self.p)
        return z

    _newton: Any = None

    def _rosenbrock(self, t: Any, x: Any, z: Any) -> tuple[Any, Any]:
        """RODAS3 on the states; algebraic variables are solved for at each stage, as a step across a kink needs."""
        h, solved, rates = self.h, self._algebraic, self._rates
        z = solved(t, x, z)
        slope, drift = self._total(t, x, z)
        matrix = ca.sparsify(ca.SX.eye(self.nx) / (h * _GAMMA) - slope)
        stages: list[Any] = []
        for a, c, alpha, gamma in zip(_A, _C, _ALPHA, _GAMMAS, strict=True):
            point, right = x, gamma * h * drift
            for k, weight, coupling in zip(stages, a, c, strict=True):
                point, right = point + weight * k, right + (coupling / h) * k
            z = solved(t + alpha * h, point, z)
            right = right + rates(t + alpha * h, point, z)[0]
            stages.append(ca.solve(matrix, ca.densify(right)))
        new = x
        for weight, k in zip(_M, stages, strict=True):
            new = new + weight * k
        return new, solved(t + h, new, z)

    def _total(self, t: Any, x: Any, z: Any) -> tuple[Any, Any]:
        """Derivatives of the rates by the states and by time, algebraic variables moving along."""
        here = [ca.SX.sym("t"), ca.SX.sym("x", self.nx), ca.SX.sym("z", self.nz)]
        ode, alg = self._rates(*here)
        independent = ca.vertcat(here[1], here[0])
        slope = ca.jacobian(ode, independent)
        if self.nz:
            follow = ca.solve(ca.jacobian(alg, here[2]), ca.densify(ca.jacobian(alg, independent)))
            slope = slope - ca.jacobian(ode, here[2]) @ follow
        found = ca.Function("total", [*here, self.u, self.p], [slope[:, :-1], slope[:, -1]])(t, x, z, self.u, self.p)
        return found[0], found[1]
