"""The DAE as the integrators get it: scaled variables, time counted from the segment's start, one parameter vector."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from acausal.lower.compiled import CompiledModel
from acausal.simulate.marching import followed
from acausal.simulate.native.policy import Native
from acausal.simulate.quick import Quick

Vector = NDArray[np.float64]
_DAE_IN = ["t", "x", "z", "p", "u"]
_DAE_OUT = ["ode", "alg", "quad", "zero"]


@dataclass(frozen=True, eq=False)
class Problem:
    """A compiled model seen by an integrator, for one run.

    States and algebraic variables are divided by their nominal magnitudes, so that one absolute tolerance fits all.
    The model's parameters `p` and inputs `u` are numbers here: what they alone determine is computed once, which halves
    the operations of a drill on its guide. The integrator's parameter vector is `[m, d, shift]`: modes of events,
    discrete variables, and the time at which the segment starts (a CasADi integrator has its time frozen at
    construction).

    `wanted_native` is the run's option `native`: whether to use the equations as compiled C.
    """

    compiled: CompiledModel
    p: Vector
    u: Vector
    wanted_native: bool | None = None

    @property
    def n_dynamic(self) -> int:
        """Number of states of the coupled system; the others are integrated apart."""
        return self.compiled.n_dynamic

    def numbers(self, m: Vector, x: Vector, start: float) -> Vector:
        """The integrator's parameter vector: modes, discrete variables out of all states, start of the segment."""
        return np.concatenate([m, x[len(x) - self.compiled.discretes :], [start]])

    @cached_property
    def scale_x(self) -> Vector:
        """Nominal magnitudes of the dynamic states."""
        return self.compiled.nominal_x[: self.n_dynamic]

    @property
    def scale_z(self) -> Vector:
        """Nominal magnitudes of the algebraic variables."""
        return self.compiled.nominal_z

    @cached_property
    def native(self) -> Native:
        """The model's compiled C, as far as there is any."""
        return Native(self.compiled, self.wanted_native, self.p)

    @cached_property
    def dae(self) -> Any:
        """`(t, x, z, p, u) -> (ode, alg, quad, zero)`, SX, for integrators that take algebraic variables."""
        t, x, z, p, ode, alg, _ = self.scaled
        none = ca.SX(0, 1)
        return ca.Function("dae", [t, x, z, p, ca.SX.sym("u", 0)], [ode, alg, none, none], _DAE_IN, _DAE_OUT)

    @cached_property
    def islands(self) -> Any:
        """`(t, [p, shift]) -> rate`, scaled, of the integrals of time that are solved apart."""
        t, _, _, p, _, _, rate = self.scaled
        n, nq = self.n_dynamic, self.compiled.quadratures
        return ca.Function("islands", [t, p], [ca.densify(rate / ca.DM(self.compiled.nominal_x[n : n + nq]))])

    @cached_property
    def ode(self) -> Any:
        """The same without algebraic variables: a rootfinder solves for them; its start is appended to `p`."""
        nz = len(self.compiled.algebraic)
        t, x, z, p, ode, alg, _ = self.scaled
        if nz == 0:
            empty = ca.SX(0, 1)
            return ca.Function("ode", [t, x, z, p, ca.SX.sym("u", 0)], [ode, empty, empty, empty], _DAE_IN, _DAE_OUT)
        full = ca.Function("full", [t, x, z, p], [ode])
        time, state, par, z0 = ca.MX.sym("t"), ca.MX.sym("x", x.numel()), ca.MX.sym("p", p.numel()), ca.MX.sym("z0", nz)
        root = self._root(t, x, z, p, alg)
        solved: Any = root(z0, ca.vertcat(time, state, par))
        none = ca.MX(0, 1)
        arguments: list[Any] = [time, state, ca.MX.sym("z", 0), ca.vertcat(par, z0), ca.MX.sym("u", 0)]
        return ca.Function("ode", arguments, [full(time, state, solved, par), none, none, none], _DAE_IN, _DAE_OUT)

    def _root(self, t: Any, x: Any, z: Any, p: Any, alg: Any) -> Any:
        """Rootfinder `(z0, [t, x, p]) -> z` for the scaled algebraic equations."""
        residual = ca.Function("residual", [z, ca.vertcat(t, x, p)], [alg], ["z", "q"], ["r"])
        return ca.rootfinder(
            "algebraic", "newton", residual, {"abstol": 1e-13, "abstolStep": 1e-10, "error_on_fail": False}
        )

    @cached_property
    def scaled(self) -> tuple[Any, ...]:
        """Symbols t, x, z, [m, d, shift], and the scaled expressions ode, alg and rates of the islands."""
        compiled = self.compiled
        n, nq = self.n_dynamic, compiled.quadratures
        t = ca.SX.sym("t")
        x, z = ca.SX.sym("x", n), ca.SX.sym("z", len(compiled.algebraic))
        nm, nd = compiled.n_modes, compiled.discretes
        p = ca.SX.sym("p", nm + nd + 1)
        m, d, shift = ca.vertsplit(p, [0, nm, nm + nd, nm + nd + 1])  # p[0:0] would be p[0]
        full_x = ca.vertcat(x * ca.DM(self.scale_x), ca.SX(nq, 1), d)
        ode, alg = compiled.rhs(t + shift, full_x, z * ca.DM(self.scale_z), self.u, self.p, m)
        ode = ca.densify(ode)
        return t, x, z, p, ode[:n] / ca.DM(self.scale_x), ca.densify(alg), ode[n : n + nq]

    def solve_algebraic(self, times: Vector, x: Vector, z: Vector, p: Vector) -> Vector:
        """Algebraic variables along a trajectory, each point started from the one before; shape (nz, n)."""
        nz = len(self.compiled.algebraic)
        if nz == 0:
            return np.zeros((0, len(times)))
        found = np.empty((nz, len(times)))
        here = z / self.scale_z
        for k, time in enumerate(times):
            states = x[: self.n_dynamic, k] / self.scale_x
            numbers = self.numbers(p, x[:, k], 0.0)
            here = np.array(self.algebraic_root(here, np.concatenate([[time], states, numbers]))).ravel()
            found[:, k] = here * self.scale_z
        return found

    def follow_algebraic(self, start: float, times: Vector, x: Vector, z: Vector, p: Vector) -> Vector:
        """The same where nothing is integrated: from the values `z` at `start` along their branch; shape (nz, n)."""
        numbers = self.numbers(p, x, 0.0)

        def solve(t: float, guess: Vector) -> tuple[Vector, float]:
            found = np.array(self.algebraic_root(guess, np.concatenate([[t], numbers]))).ravel()
            return found, float(np.max(np.abs(self.algebraic_slope(t, [], found, numbers)[0])))

        return followed(solve, start, times, z / self.scale_z) * self.scale_z[:, None]

    def restarted(self, time: float, x: Vector, z: Vector, p: Vector) -> Vector | None:
        """Algebraic variables after a change of modes, by Newton's method from those before it.

        None when it does not converge at once, which happens after a jump. Asked at every time event: the start
        problem, which copes with more, builds its functions anew each time (1 ms).
        """
        here, states, unshifted = z / self.scale_z, x[: self.n_dynamic] / self.scale_x, self.numbers(p, x, 0.0)
        for _ in range(8):
            alg, slope = self.algebraic_slope(time, states, here, unshifted)
            try:
                step = np.linalg.solve(slope.reshape(len(z), len(z)), alg)
            except np.linalg.LinAlgError:
                return None
            here = here - step
            if not np.isfinite(here).all():
                return None
            if (np.abs(step) <= 1e-11 * (1.0 + np.abs(here))).all():
                return np.asarray(here * self.scale_z)
        return None

    @cached_property
    def algebraic_slope(self) -> Quick:
        """`(t, x, z, [p, shift]) -> (alg, d alg / d z)`, scaled."""
        t, x, z, p, _, alg, _ = self.scaled
        return Quick(ca.Function("algebraic_slope", [t, x, z, p], [alg, ca.densify(ca.jacobian(alg, z))]))

    @cached_property
    def algebraic_root(self) -> Any:
        """Rootfinder for consistent algebraic variables: `(z, [t, x, p, shift]) -> z`, all scaled."""
        t, x, z, p, _, alg, _ = self.scaled
        return self._root(t, x, z, p, alg)
