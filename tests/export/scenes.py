"""Small models with an input, and the transcription of optimal-control problems that the tests share."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from acausal import (
    Component,
    Equations,
    Real,
    connect,
    fixed,
    guess,
    parameter,
    part,
    signal_input,
    signal_output,
    variable,
)
from acausal.library.translational import Flange, Force, Mass
from acausal.lower.casadi_model import CasadiModel


class Slider(Component):
    """Mass at rest at 0, pushed along a line by the input `u`."""

    u: Real = signal_input(unit="N", doc="Force on the mass")
    power: Real = signal_output(unit="W", nominal=10.0, doc="Power of the force")
    m: Real = parameter(default=1.0, unit="kg", min=0.0, doc="Mass")
    force: Force = Force()
    mass: Mass = part()

    def build(self) -> None:
        self.mass = Mass(m=self.m, s=fixed(0.0), v=fixed(0.0))

    def equations(self) -> Equations:
        yield connect(self.u, self.force.u)
        yield connect(self.force.flange, self.mass.flange_a)
        yield self.power == self.u * self.mass.v


class SaturatingDrive(Component):
    """Force proportional to a current, on a resistance that rises with it: voltage == R*i + S*i**3."""

    flange: Flange = Flange()
    u: Real = signal_input(unit="V", doc="Voltage")
    R: Real = parameter(default=1.0, unit="Ohm", doc="Resistance at small currents")
    S: Real = parameter(default=1.0, unit="V/A3", doc="Rise of the resistance")
    k: Real = parameter(default=1.0, unit="N/A", doc="Force of a current")
    i: Real = variable(default=guess(0.0), unit="A", min=-10.0, max=20.0, doc="Current")

    def equations(self) -> Equations:
        yield self.u == self.R * self.i + self.S * self.i * self.i * self.i
        yield self.flange.f == -self.k * self.i


class DrivenSlider(Component):
    """The slider behind a drive whose current is an algebraic variable: no formula gives it without a root."""

    u: Real = signal_input(unit="V", doc="Voltage of the drive")
    current: Real = variable(unit="A", doc="Current of the drive")
    drive: SaturatingDrive = SaturatingDrive()
    mass: Mass = Mass(m=1.0, s=fixed(0.0), v=fixed(0.0))

    def equations(self) -> Equations:
        yield connect(self.u, self.drive.u)
        yield connect(self.drive.flange, self.mass.flange_a)
        yield self.current == self.drive.i


@dataclass(frozen=True, eq=False)
class Transcription:
    """Variables of an optimal-control problem on Radau points; columns are instants.

    Attributes
    ----------
    x
        States at the start and at all collocation points.
    z, u, y
        Algebraic variables, inputs and outputs at the collocation points.
    times
        Of the collocation points, as fractions of the horizon.
    """

    opti: Any
    x: Any
    z: Any
    u: Any
    y: Any
    times: Any
    weights: Any
    horizon: Any

    def integral(self, row: Any) -> Any:
        """Integral over the horizon of what has the values `row` at the collocation points."""
        return self.horizon * row @ self.weights

    def solve(self) -> Any:
        """The solution that ipopt finds, to 1e-10."""
        quiet = {"ipopt": {"print_level": 0, "sb": "yes", "tol": 1e-10}, "print_time": False}
        self.opti.solver("ipopt", quiet)
        return self.opti.solve()


def radau(model: CasadiModel, horizon: Any, opti: Any, intervals: int, reduced: bool = False) -> Transcription:
    """Radau IIA with three points (order 5); inputs are free at every point. `reduced` uses ode instead of dae."""
    tau = ca.collocation_points(3, "radau")
    slopes, _, quadrature = ca.collocation_coeff(tau)
    count = 3 * intervals
    nz = 0 if reduced else len(model.z)
    x, z, u = (opti.variable(n, m) for n, m in ((len(model.x), count + 1), (nz, count), (len(model.u), count)))
    times = (np.arange(intervals)[:, None] + np.array(tau)).ravel() / intervals
    p = np.tile(np.array(model.p.start)[:, None], (1, count))
    function, arguments = (model.ode, [u, p]) if reduced else (model.dae, [z, u, p])
    # Evaluated column by column: a function with a rootfinder inside cannot be mapped into one expression of scalars.
    rate, *rest = function.map(count)(*timed(model, horizon * times[None, :]), x[:, 1:], *arguments)
    for k in range(intervals):
        columns = slice(3 * k, 3 * k + 3)
        opti.subject_to(x[:, 3 * k : 3 * k + 4] @ slopes == horizon / intervals * rate[:, columns])
    if not reduced and nz:
        opti.subject_to(ca.vec(rest[0]) == 0)
    weights = np.tile(np.array(quadrature).ravel(), intervals) / intervals
    opti.subject_to(x[:, 0] == ca.DM(model.x.start))
    return Transcription(opti, x, z, u, rest[-1], times, weights, horizon)


def timed(model: CasadiModel, t: Any) -> tuple[Any, ...]:
    """The argument t, where the functions have it."""
    return () if model.autonomous else (t,)


def numbers(matrix: Any) -> NDArray[np.float64]:
    """A CasADi matrix as a flat array; numpy's own functions warn on one."""
    return np.array(matrix).ravel()
