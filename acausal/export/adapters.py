"""Conversion of a `CasadiModel` for other packages of optimal control: do-mpc, rockit, acados.

None of them is needed to import this module. Features that a package does not support are refused (AC614), not dropped.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np

from acausal.errors import ExportError
from acausal.lower.casadi_model import CasadiModel, Ports


@dataclass(frozen=True, eq=False)
class AcadosModel:
    """The fields of acados' `AcadosModel`, as SX; copy each item of `vars()` of this object to it by `setattr`.

    `f_expl_expr` is None for a model with algebraic variables, which acados integrates by IRK only. Limits and
    parameter values are not included: use `model.u.min`, ... for the constraints of an `AcadosOcp`, and `model.p.start`
    for its `parameter_values`.
    """

    name: str
    x: Any
    xdot: Any
    u: Any
    z: Any
    p: Any
    f_impl_expr: Any
    f_expl_expr: Any
    x_labels: list[str] = field(default_factory=list)
    u_labels: list[str] = field(default_factory=list)


def acados_model(model: CasadiModel) -> AcadosModel:
    """The model as the fields of an `AcadosModel`.

    Raises ExportError: AC614 for a model that depends on the time, or has events.
    """
    _refuse(model, "acados")
    x, z, u, p = (ca.SX.sym(v, len(getattr(model, v))) for v in "xzup")
    xdot = ca.SX.sym("xdot", x.numel())
    explicit = None if z.numel() else model.dae(x, z, u, p)[0]
    return AcadosModel(
        name=re.sub(r"\W", "_", model.name),
        x=x,
        xdot=xdot,
        u=u,
        z=z,
        p=p,
        f_impl_expr=model.implicit(xdot, x, z, u, p),
        f_expl_expr=explicit,
        x_labels=list(model.x.names),
        u_labels=list(model.u.names),
    )


def do_mpc_model(model: CasadiModel, variables: Any) -> Any:
    """Fill an empty `do_mpc.model.Model("continuous", "SX")` and set it up.

    `.` and brackets of names become `_`: `mass.s` is `mass_s`. Outputs are expressions under their names. Parameters
    are do-mpc's `_p`: give it `model.p.start`.

    Raises ExportError: AC614 for a model that depends on the time or has events, or for names that coincide.
    """
    _refuse(model, "do-mpc")
    columns = []
    taken: set[str] = set()
    for kind, ports in (("_x", model.x), ("_z", model.z), ("_u", model.u), ("_p", model.p)):
        names = identifiers(ports)
        if taken.intersection(names):
            clashes = ", ".join(sorted(taken.intersection(names)))
            raise ExportError("AC614", f"{model.name}: {clashes} would stand for two variables in do-mpc")
        taken.update(names)
        columns.append(ca.vertcat(ca.SX(0, 1), *(variables.set_variable(kind, name) for name in names)))
    ode, alg, y = model.dae(*columns)
    for k, name in enumerate(identifiers(model.x)):
        variables.set_rhs(name, ode[k])
    for k in range(alg.numel()):
        variables.set_alg(f"alg_{k}", alg[k])
    for k, name in enumerate(identifiers(model.y)):
        if name not in taken:
            variables.set_expression(name, y[k])
    variables.setup()
    return variables


def do_mpc_limits(model: CasadiModel, controller: Any) -> None:
    """Set limits and scaling of x, z and u of an `MPC` or `MHE` of do-mpc, before its setup."""
    for kind, ports in (("_x", model.x), ("_z", model.z), ("_u", model.u)):
        for name, port in zip(identifiers(ports), ports, strict=True):
            controller.scaling[kind, name] = port.nominal
            if np.isfinite(port.min):
                controller.bounds["lower", kind, name] = port.min
            if np.isfinite(port.max):
                controller.bounds["upper", kind, name] = port.max


@dataclass(frozen=True, eq=False)
class Stage:
    """Variables declared by `rockit_stage`: vectors in the order of the model, and single ones as `stage["mass.s"]`."""

    x: Any
    z: Any
    u: Any
    p: Any
    y: Any
    places: dict[str, tuple[str, int]]

    def __getitem__(self, name: str) -> Any:
        """One variable by its name in the model; KeyError for an unknown name."""
        vector, k = self.places[name]
        return getattr(self, vector)[k]


def rockit_stage(model: CasadiModel, ocp: Any) -> Stage:
    """Declare a model in an `Ocp` of rockit: its variables with their magnitudes, equations, and limits.

    The initial states are left free; fix them by `ocp.subject_to(ocp.at_t0(stage.x) == model.x.start)`.

    Raises ExportError: AC614 for a model with events.
    """
    _refuse(model, "rockit", timed=True)
    constructors = {"x": ocp.state, "z": ocp.algebraic, "u": ocp.control}
    columns: dict[str, Any] = {}
    for v, construct in constructors.items():
        ports: Ports = getattr(model, v)
        columns[v] = construct(len(ports), scale=ca.DM(ports.nominal)) if ports else ca.MX(0, 1)
    columns["p"] = ocp.parameter(len(model.p)) if len(model.p) else ca.MX(0, 1)
    if len(model.p):
        ocp.set_value(columns["p"], model.p.start)
    ode, alg, y = model.dae(*(() if model.autonomous else (ocp.t,)), *(columns[v] for v in "xzup"))
    ocp.set_der(columns["x"], ode)
    if len(model.z):
        ocp.add_alg(alg)
    for v in "xzu":
        for k, port in enumerate(getattr(model, v)):
            if np.isfinite(port.min):
                ocp.subject_to(columns[v][k] >= port.min)
            if np.isfinite(port.max):
                ocp.subject_to(columns[v][k] <= port.max)
    places = {port.name: (v, k) for v in "ypzux" for k, port in enumerate(getattr(model, v))}
    return Stage(**columns, y=y, places=places)


def identifiers(ports: Ports) -> list[str]:
    """Names as Python identifiers: `arm_q_0` for `arm.q[0]`."""
    return [re.sub(r"\W+", "_", name).strip("_") for name in ports.names]


def _refuse(model: CasadiModel, package: str, timed: bool = False) -> None:
    unsupported: Sequence[tuple[bool, str]] = (
        (model.events is not None, "what happens at its events"),
        (not model.autonomous and not timed, "the time, on which it depends"),
    )
    for is_present, what in unsupported:
        if is_present:
            raise ExportError(
                "AC614",
                f"{package} has no place for {what}: {model.name}",
                help="free the source that drives it: acausal.free(model, name)" if "time" in what else None,
            )
