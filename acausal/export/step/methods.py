"""Fixed-step methods as expressions with a fixed number of operations, whatever the values are.

"rk2" (Heun) and "rk4" (classical) are for models that are not stiff at the step. "rosenbrock": RODAS3, four stages,
order 3, L-stable (A. Sandu et al., Atmospheric Environment 31 (1997) 3459-3472, in the implementation form of E. Hairer
and G. Wanner, Solving Ordinary Differential Equations II, IV.7). "sdirk": two stages, order 2, L-stable (R. Alexander,
SIAM J. Numer. Anal. 14 (1977) 1006-1021). A Rosenbrock method linearises at the start of the step, and so misses a
stiff contact that closes within the step: with 1 ms, a drill is thrown out of its block. Stages of "sdirk" are solved
at their own points, and so include the contact.

Algebraic variables and stages of "sdirk" are solved for by a fixed number of full Newton steps. For ThickBlock at 1 ms
two suffice for a stage, and damping made no difference. They fail for a kink in an algebraic equation whose slopes
differ by orders of magnitude, as in the drill's implicit contact (`explicit=False`), which needs smaller steps or an
explicit form.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import sqrt
from typing import Any

import casadi as ca

from acausal.export.step.crossing import along_solution, meets
from acausal.export.step.defect import bends, defect, even, largest, unsolved
from acausal.export.step.stable import differences, unstable

METHODS = ("rk2", "rk4", "rosenbrock", "sdirk")
IMPLICIT = ("rosenbrock", "sdirk")
_NEWTON_STEPS = 3
_STAGE_STEPS = 4
# Newton's method counts as converged if its last step is at most this fraction of an unknown plus its nominal
# magnitude: the remaining error is of the order of the square.
_CONVERGED = 1e-5
# The same for rates that serve an error estimate only.
_CONVERGED_FOR_ESTIMATE = 3e-2

# RODAS3; rows of the lower triangles.
_GAMMA = 0.5
_A = ((), (0.0,), (2.0, 0.0), (2.0, 0.0, 1.0))
_C = ((), (4.0,), (1.0, -1.0), (1.0, -1.0, -8.0 / 3.0))
_M = (2.0, 0.0, 1.0, 1.0)
_ALPHA = (0.0, 0.0, 1.0, 1.0)
_GAMMAS = (0.5, 1.5, 0.0, 0.0)
_KINKS = frozenset((ca.OP_FABS, ca.OP_FMIN, ca.OP_FMAX, ca.OP_IF_ELSE_ZERO, ca.OP_SIGN, ca.OP_LT, ca.OP_LE))
# Alexander's method of order 2.
_DIAGONAL = 1.0 - sqrt(0.5)


@dataclass(frozen=True, eq=False)
class Method:
    """A method for `rates`: `(t, x[nx], z[nz], *held) -> (ode, alg)`, an SX function.

    `held` are the arguments that are constant in a step: inputs, parameters, modes. The last `constant` entries of x,
    the discrete variables, are constant, too: as unknowns of an implicit method they would change by rounding errors,
    and `change(d)` compares values exactly.
    """

    name: str
    rates: Any
    nominal: Any
    """Magnitudes of x and z, shape (nx + nz,)."""
    constant: int = 0

    @property
    def is_explicit(self) -> bool:
        """Whether the method is explicit, so that steps can be too large for its stability."""
        return self.name not in IMPLICIT

    def too_large(self, t: Any, h: Any, x: Any, z: Any, held: Sequence[Any]) -> Any:
        """1 if a step from this point amplifies a decaying mode, from differences of two stages at one instant."""
        if not self.is_explicit:
            return ca.SX(0)
        z1 = self.algebraic(t, x, z, held)
        k1 = self.rates(t, x, z1, *held)[0]
        reach = h if self.name == "rk2" else h / 2
        a = x + reach * k1

        def rates(x: Any) -> Any:
            return self.rates(t + reach, x, self.algebraic(t + reach, x, z1, held), *held)[0]

        ka = rates(a)
        b = x + h / 2 * (k1 + ka) if self.name == "rk2" else x + reach * ka
        nominal = ca.vertsplit(ca.DM(self.nominal), [0, self._nx, self._nx + self._nz])[0]
        return unstable(2 if self.name == "rk2" else 4, h, x, nominal, differences(rates, reach, a, ka, b))

    def error(self, t: Any, h: Any, x: Any, z: Any, x1: Any, z1: Any, held: Sequence[Any], share: Any = 1) -> Any:
        """Estimated error of a step to (x1, z1), or of its first fraction `share`, relative to nominal magnitudes.

        Defects of stiff components decay within the step. Therefore those of an implicit method are damped by one
        implicit Euler step of the variational equation, with the Jacobian at the same point. Up to an event, the states
        of an implicit method follow the chord (`HybridStep`), and so does the interpolant. The rates of transients,
        which are left out of its bend at the start, are counted at the start: a transient that is over before the first
        inner point appears nowhere else.
        """
        nx = self._nx
        if self.constant:
            (a, still), (b, _) = (ca.vertsplit(v, [0, nx - self.constant, nx]) for v in (x, x1))
            return self._moving.error(t, h, a, z, b, z1, [still, *held], share)
        if not nx:
            return ca.SX(0)
        z0 = self.algebraic(t, x, z, held)
        nominal = ca.vertsplit(ca.DM(self.nominal), [0, nx, nx + self._nz])[0]
        bend = bends(h, x, self.rates(t, x, z0, *held)[0], x1, self.rates(t + h, x1, z1, *held)[0])
        left_out: Any = ca.SX(0)

        def damped(t: Any, point: Any, w: Any, value: Any) -> Any:
            reach = h * (_GAMMA if self.name == "rosenbrock" else _DIAGONAL)
            matrix = ca.SX.eye(nx) - reach * self._total(t, point, w, *held)[0]
            return ca.solve(ca.sparsify(matrix), ca.densify(value))

        if not self.is_explicit:
            first, last = even(*bend)
            left_out = share * largest(nx)(damped(t, x, z0, bend[0] - first) / nominal)
            bend = ca.if_else(share >= 1, first, 0), ca.if_else(share >= 1, last, 0)

        def defect_at(s: Any, point: Any, slope: Any) -> Any:
            w, failed = self._solved(t + s * h, point, z0 + s * (z1 - z0), held, _CONVERGED_FOR_ESTIMATE)
            value = slope - h * self.rates(t + s * h, point, w, *held)[0]
            value = value if self.is_explicit else damped(t + s * h, point, w, value)
            return value + unsolved(failed)

        return ca.fmax(left_out, defect(x, x1, bend, defect_at, nominal, share))

    def displaced(self, t: Any, h: Any, x: Any, z: Any, onto: Any, held: Sequence[Any]) -> Any:
        """Error in all other states of a step that ends at `x`, although some states should have stayed at `onto`.

        The rates at both points differ; their effect is that of a third of the step, because a body that should be at
        rest departs with the square of time. The result is relative to the nominal magnitudes of the states.
        """
        nominal = ca.vertsplit(ca.DM(self.nominal), [0, self._nx, self._nx + self._nz])[0]
        there = self.rates(t, onto, self.algebraic(t, onto, z, held), *held)[0]
        difference = ca.if_else(x == onto, (self.rates(t, x, z, *held)[0] - there) / nominal, 0)
        return h / 3 * largest(self._nx)(difference)

    @property
    def _nx(self) -> int:
        return int(self.rates.numel_in(1))

    @property
    def _nz(self) -> int:
        return int(self.rates.numel_in(2))

    @property
    def iterates(self) -> bool:
        """Whether its steps use Newton's method."""
        return self.name == "sdirk" or self._nz > 0

    def step(self, t: Any, h: Any, x: Any, z: Any, held: Sequence[Any]) -> tuple[Any, Any, Any]:
        """(x, z, rough) after a step of length `h`, which may be an expression.

        `rough` is 1 if Newton's method has not converged in one of the iterations, or may have switched to another
        solution.
        """
        if self.constant:
            moving = ca.vertsplit(x, [0, self._nx - self.constant, self._nx])
            new, z, rough = self._moving.step(t, h, moving[0], z, [moving[1], *held])
            return ca.vertcat(new, moving[1]), z, rough
        implicit = {"rosenbrock": self._rosenbrock, "sdirk": self._sdirk}
        new, end, rough = implicit.get(self.name, self._explicit)(t, h, x, z, held)
        if self._along.numel_out(0):
            start = self.algebraic(t, x, z, held)
            first, last = self._along(t, x, start, *held), self._along(t + h, new, end, *held)
            rough = ca.logic_or(rough, meets(h, first, last))
            if self._has_kinks:
                rough = ca.logic_or(rough, self._leads_elsewhere(t + h, new, start + h * first[2], end, held))
                rough = ca.logic_or(rough, self._leads_elsewhere(t, x, end - h * last[2], start, held))
        return new, end, rough

    def _leads_elsewhere(self, t: Any, x: Any, ahead: Any, z: Any, held: Sequence[Any]) -> Any:
        """1 if Newton's method leads from `ahead` to a solution other than `z`, as beyond a kink where two meet."""
        nominal = ca.vertsplit(ca.DM(self.nominal), [0, self._nx, self._nx + self._nz])[1]
        found = self.algebraic(t, x, ahead, held)
        return ca.logic_and(self._far(found, z, nominal), ca.logic_not(self.rough(t, x, found, held)))

    def algebraic(self, t: Any, x: Any, z: Any, held: Sequence[Any]) -> Any:
        """Algebraic variables at a point, by a fixed number of Newton steps from `z`."""
        return self._solved(t, x, z, held)[0]

    def _solved(self, t: Any, x: Any, z: Any, held: Sequence[Any], most: float = _CONVERGED) -> tuple[Any, Any]:
        """As `algebraic`, and 1 if the last Newton step was larger than `most`."""
        before = z
        for _ in range(_NEWTON_STEPS if self._nz else 0):
            before, z = z, self._newton(t, x, z, *held)
        return z, self._far(before, z, ca.vertsplit(ca.DM(self.nominal), [0, self._nx, self._nx + self._nz])[1], most)

    def rough(self, t: Any, x: Any, z: Any, held: Sequence[Any]) -> Any:
        """1 if `z` does not solve the algebraic equations at a point, 0 if a further Newton step hardly changes it."""
        if not self._nz:
            return ca.SX(0)
        nominal = ca.vertsplit(ca.DM(self.nominal), [0, self._nx, self._nx + self._nz])[1]
        return self._far(z, self._newton(t, x, z, *held), nominal)

    def _far(self, before: Any, after: Any, nominal: Any, most: float = _CONVERGED) -> Any:
        """1 if two iterates differ by more than `most`, relative to the last one plus its nominal magnitude."""
        if not after.numel():
            return ca.SX(0)
        difference = ca.fabs(after - before) / (ca.fabs(after) + nominal)
        return ca.sum1(difference <= most) < difference.numel()  # also if one is nan, which a maximum ignores

    @cached_property
    def _moving(self) -> Method:
        """The method for the states that change between events; the others become the first of the `held` arguments."""
        here = self._symbols()
        moving, still = ca.vertsplit(here[1], [0, self._nx - self.constant, self._nx])
        inner = [here[0], ca.SX.sym("x", moving.numel()), here[2], ca.SX.sym("d", still.numel()), *here[3:]]
        ode, alg = self.rates(here[0], ca.vertcat(inner[1], inner[3]), *here[2:])
        ode = ca.vertsplit(ode, [0, moving.numel(), self._nx])[0]
        sizes = ca.vertsplit(ca.DM(self.nominal), [0, moving.numel(), self._nx, self._nx + self._nz])
        return Method(self.name, ca.Function("rates", inner, [ode, alg]), ca.vertcat(sizes[0], sizes[2]))

    def _symbols(self) -> list[Any]:
        """Arguments of `rates`."""
        names = [self.rates.name_in(k) for k in range(self.rates.n_in())]
        return [ca.SX.sym(name, self.rates.numel_in(k)) for k, name in enumerate(names)]

    @cached_property
    def _newton(self) -> Any:
        """One Newton step for the algebraic variables: `(t, x, z, *held) -> z`."""
        here = self._symbols()
        alg = self.rates(*here)[1]
        return ca.Function("newton", here, [here[2] - ca.solve(ca.jacobian(alg, here[2]), alg)])

    @cached_property
    def _along(self) -> Any:
        return along_solution(self.rates)

    @property
    def _has_kinks(self) -> bool:
        """Whether the slope of the algebraic equations may jump: only there a step turns off without a zero of it."""
        here = self._symbols()
        alg = ca.Function("alg", here, self.rates(*here)[1:2])
        return not _KINKS.isdisjoint(alg.instruction_id(k) for k in range(alg.n_instructions()))

    def _explicit(self, t: Any, h: Any, x: Any, z: Any, held: Sequence[Any]) -> tuple[Any, Any, Any]:
        rough: Any = ca.SX(0)

        def solved(t: Any, x: Any, z: Any) -> Any:
            nonlocal rough
            z, far = self._solved(t, x, z, held)
            rough = ca.logic_or(rough, far)
            return z

        def rate(t: Any, x: Any, z: Any) -> Any:
            return self.rates(t, x, z, *held)[0]

        z1 = solved(t, x, z)
        k1 = rate(t, x, z1)
        if self.name == "rk2":
            z2 = solved(t + h, x + h * k1, z1)
            new = x + h / 2 * (k1 + rate(t + h, x + h * k1, z2))
            return new, solved(t + h, new, z2), rough
        z2 = solved(t + h / 2, x + h / 2 * k1, z1)
        k2 = rate(t + h / 2, x + h / 2 * k1, z2)
        z3 = solved(t + h / 2, x + h / 2 * k2, z2)
        k3 = rate(t + h / 2, x + h / 2 * k2, z3)
        z4 = solved(t + h, x + h * k3, z3)
        k4 = rate(t + h, x + h * k3, z4)
        new = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        return new, solved(t + h, new, z4), rough

    def _rosenbrock(self, t: Any, h: Any, x: Any, z: Any, held: Sequence[Any]) -> tuple[Any, Any, Any]:
        """RODAS3 for the states; algebraic variables are solved for at each stage, so that steps may cross kinks."""
        z, rough = self._solved(t, x, z, held)
        slope, drift = self._total(t, x, z, *held)
        matrix = ca.sparsify(ca.SX.eye(self._nx) / (h * _GAMMA) - slope)
        stages: list[Any] = []
        for a, c, alpha, gamma in zip(_A, _C, _ALPHA, _GAMMAS, strict=True):
            point, right = x, gamma * h * drift
            for k, weight, coupling in zip(stages, a, c, strict=True):
                point, right = point + weight * k, right + (coupling / h) * k
            z, far = self._solved(t + alpha * h, point, z, held)
            rough = ca.logic_or(rough, far)
            right = right + self.rates(t + alpha * h, point, z, *held)[0]
            stages.append(ca.solve(matrix, ca.densify(right)))
        new = x
        for weight, k in zip(_M, stages, strict=True):
            new = new + weight * k
        z, far = self._solved(t + h, new, z, held)
        return new, z, ca.logic_or(rough, far)

    @cached_property
    def _total(self) -> Any:
        """Total derivatives of the rates by states and time, with algebraic variables eliminated."""
        here = self._symbols()
        ode, alg = self.rates(*here)
        independent = ca.vertcat(here[1], here[0])
        slope = ca.jacobian(ode, independent)
        if self._nz:
            dz = ca.solve(ca.jacobian(alg, here[2]), ca.densify(ca.jacobian(alg, independent)))
            slope = slope - ca.jacobian(ode, here[2]) @ dz
        return ca.Function("total", here, [slope[:, :-1], slope[:, -1]])

    def _sdirk(self, t: Any, h: Any, x: Any, z: Any, held: Sequence[Any]) -> tuple[Any, Any, Any]:
        first, z, rough = self._stage(t + _DIAGONAL * h, _DIAGONAL * h, x, x, z, held)
        slope = (first - x) / (_DIAGONAL * h)
        base = x + (1 - _DIAGONAL) * h * slope
        # start at the previous stage: the base of this stage may lie beyond a contact that has closed
        last, z, far = self._stage(t + h, _DIAGONAL * h, base, first, z, held)
        return last, z, ca.logic_or(rough, far)

    def _stage(self, t: Any, reach: Any, base: Any, x: Any, z: Any, held: Sequence[Any]) -> tuple[Any, Any, Any]:
        """(x, z, failed) of the stage x == base + reach * rates(x, z), with the algebraic equations, from a guess."""
        w = before = ca.vertcat(x, z)
        for _ in range(_STAGE_STEPS):
            before, w = w, self._stage_step(t, reach, base, w, *held)
        found = ca.vertsplit(w, [0, self._nx, self._nx + self._nz])
        return found[0], found[1], self._far(before, w, ca.DM(self.nominal))

    @cached_property
    def _stage_step(self) -> Any:
        """One Newton step for a stage: `(t, reach, base, [x, z], *held) -> [x, z]`."""
        here = self._symbols()
        reach, base = ca.SX.sym("reach"), ca.SX.sym("base", self._nx)
        ode, alg = self.rates(*here)
        w, residual = ca.vertcat(here[1], here[2]), ca.vertcat(here[1] - base - reach * ode, alg)
        new = w - ca.solve(ca.jacobian(residual, w), ca.densify(residual))
        return ca.Function("stage_step", [here[0], reach, base, w, *here[3:]], [new])
