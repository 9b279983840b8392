"""Stability functions of one-step methods: the amplification of a mode by a fixed step, and the largest stable step.

A one-step method turns y' = lambda*y into y(t + h) = R(h*lambda)*y(t) with a rational function R; the step is stable
for a mode when |R| <= 1 (E. Hairer, G. Wanner, Solving Ordinary Differential Equations II, section IV.2).
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from acausal.arrays import Vector

MOST_GROWTH = math.log(2.0)
"""Growth of a mode that makes a run worthless."""
# Eigenvalues have rounding errors: a mode whose damping ratio is below this counts as undamped.
_UNDAMPED = 1e-10


@dataclass(frozen=True)
class Method:
    """A one-step method with fixed steps."""

    # `name`, `title`: key in reports, and the usual name.
    name: str
    title: str
    solver: str | None  # the solver of acausal that uses it; None for methods listed for comparison only
    order: int  # classical order of accuracy
    # `numerator`, `denominator`: coefficients of R(z), ascending powers.
    numerator: tuple[float, ...]
    denominator: tuple[float, ...] = (1.0,)
    # Whether the last stage is the new value: the order does not drop on stiff components.
    stiffly_accurate: bool = False

    @property
    def explicit(self) -> bool:
        """Whether no system of equations is solved in a step."""
        return len(self.denominator) == 1

    @property
    def at_infinity(self) -> float:
        """|R| for infinitely fast modes: 0 for L-stable methods, 1 for those that let such modes ring."""
        top, bottom = len(self.numerator), len(self.denominator)
        if top != bottom:
            return math.inf if top > bottom else 0.0
        return abs(self.numerator[-1] / self.denominator[-1])

    def amplification(self, z: complex | NDArray[np.complex128]) -> NDArray[np.complex128]:
        """R(z), elementwise."""
        value = np.asarray(z, dtype=complex)
        top, bottom = (np.polyval(np.array(c[::-1], dtype=complex), value) for c in (self.numerator, self.denominator))
        return np.asarray(top / bottom, dtype=complex)

    def radius(self, angle: float) -> float:
        """Largest r with |R(s*exp(i*angle))| <= 1 for all 0 < s <= r; 0 if there is none, inf if there is no bound.

        `angle` in rad, pi/2 for undamped modes and pi for a decay without oscillation.
        """
        direction = cmath.exp(1j * angle)
        if abs(direction.real) < _UNDAMPED:
            direction = complex(0.0, math.copysign(1.0, direction.imag))
        # |N|^2 - |D|^2 along the ray is a real polynomial in s; it is 0 at s = 0
        excess: Vector = np.zeros(1)
        size: Vector = np.zeros(1)
        for sign, coefficients in ((1.0, self.numerator), (-1.0, self.denominator)):
            # powers by multiplication, which is exact for those of i
            terms = np.array(coefficients) * np.cumprod([1.0, *[direction] * (len(coefficients) - 1)])
            square = np.asarray(np.convolve(terms, terms.conj()).real, dtype=float)
            bound = np.asarray(np.convolve(np.abs(terms), np.abs(terms)), dtype=float)
            excess = _sum(excess, sign * square)
            size = _sum(size, bound)
        excess[np.abs(excess) < 1e-13 * size] = 0.0
        nonzero = np.flatnonzero(excess)
        if not len(nonzero):
            return math.inf
        if excess[nonzero[0]] > 0.0:
            return 0.0
        roots = np.roots(excess[nonzero[0] : nonzero[-1] + 1][::-1])
        real = np.sort(roots.real[(np.abs(roots.imag) < 1e-7 * np.abs(roots)) & (roots.real > 0.0)])
        for r in real:
            if np.polyval(excess[::-1], r * (1.0 + 1e-6)) > 0.0:
                return float(r)
        return math.inf

    @cached_property
    def _coarse(self) -> tuple[Vector, Vector]:
        angles = np.linspace(0.5 * math.pi, math.pi, 181)
        return angles, np.array([self.radius(a) for a in angles])

    def largest_step(self, modes: NDArray[np.complex128]) -> tuple[float, complex]:
        """Largest stable step [s] for eigenvalues `modes` [1/s], and the mode that limits it.

        Growing modes (positive real part) limit nothing; (inf, 0) when no mode does.
        """
        decaying = modes[(modes != 0.0) & (modes.real <= _UNDAMPED * np.abs(modes))]
        if not len(decaying):
            return math.inf, 0j
        angles = np.minimum(np.maximum(np.abs(np.angle(decaying)), 0.5 * math.pi), math.pi)
        grid, radii = self._coarse
        # between two angles of the table the radius is hardly below the smaller one, so the smallest few are examined
        after = np.minimum(np.searchsorted(grid, angles), len(grid) - 1)
        rough = np.minimum(radii[after], radii[np.maximum(after - 1, 0)]) / np.abs(decaying)
        worst, limiting = math.inf, 0j
        for k in np.argsort(rough, kind="stable")[:4]:
            step = self.radius(float(angles[k])) / float(abs(decaying[k]))
            if step < worst or not limiting:
                worst, limiting = step, complex(decaying[k])
        return (worst, limiting) if math.isfinite(worst) else (math.inf, 0j)

    def usable_step(self, modes: NDArray[np.complex128], span: float) -> tuple[float, complex]:
        """Largest step [s] with which no mode grows more than twofold in `span` seconds, and the mode that limits it.

        This is the largest stable step, except for weakly damped modes, whose growth with small steps is harmless.
        """
        decaying = modes[(modes != 0.0) & (modes.real <= _UNDAMPED * np.abs(modes))]
        strict = np.array([self.radius(max(abs(float(np.angle(v))), 0.5 * math.pi)) for v in decaying])
        usable = strict / np.abs(decaying)
        for k in np.argsort(usable, kind="stable")[:4]:
            trial = np.geomspace(1e-6, 30.0, 400) / abs(decaying[k])
            size = np.log(np.abs(self.amplification(trial * decaying[k]))) / trial - max(decaying[k].real, 0.0)
            bad = np.flatnonzero(size * np.maximum(span, trial) > MOST_GROWTH)
            usable[k] = math.inf if not len(bad) else max(usable[k], float(trial[max(bad[0] - 1, 0)]))
        if not len(usable) or not np.isfinite(usable.min()):
            return math.inf, 0j
        worst = int(np.argmin(usable))
        return float(usable[worst]), complex(decaying[worst])

    def growth(self, modes: NDArray[np.complex128], step: float) -> Vector:
        """Rates [1/s] at which steps of this size amplify modes more than the equations do; negative if they damp."""
        with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
            size = np.log(np.abs(self.amplification(step * modes)))
        size = np.nan_to_num(size, nan=np.inf, neginf=-50.0)
        return np.asarray(size / step - np.maximum(modes.real, 0.0))


def _sum(a: Vector, b: Vector) -> Vector:
    total = np.zeros(max(len(a), len(b)))
    total[: len(a)] += a
    total[: len(b)] += b
    return total


def _truncated_exponential(order: int) -> tuple[float, ...]:
    return tuple(1.0 / math.factorial(k) for k in range(order + 1))


# CasADi does not document the coefficients of its `rosenbrock`. The denominator (1 - gamma*z)**8 and the two numerator
# coefficients that order 5 leaves open were fitted to single steps on y' = lambda*y; the others follow. R agrees with
# the solver to 3e-15.
_GAMMA = 0.33233400604635016
_ROSENBROCK_LAST = (0.003699401677644423, -0.0009461712969719745)


def _rosenbrock() -> tuple[tuple[float, ...], tuple[float, ...]]:
    denominator = tuple(math.comb(8, k) * (-_GAMMA) ** k for k in range(9))
    exponential = _truncated_exponential(5)
    leading = (sum(denominator[j] * exponential[k - j] for j in range(k + 1)) for k in range(6))
    return (*leading, *_ROSENBROCK_LAST), denominator


METHODS: tuple[Method, ...] = (
    Method("euler", "explicit Euler", None, 1, (1.0, 1.0)),
    Method("rk2", "Heun (RK2)", "rk2", 2, _truncated_exponential(2)),
    Method("rk4", "classical RK4", "rk", 4, _truncated_exponential(4)),
    # the last coefficient was fitted like those of `rosenbrock`
    Method("erk", "explicit pair 5(4)", "erk", 5, (*_truncated_exponential(5), 77.0 / 51200.0)),
    Method("implicit_euler", "implicit Euler", None, 1, (1.0,), (1.0, -1.0), True),
    Method("trapezoid", "trapezoidal rule", None, 2, (1.0, 0.5), (1.0, -0.5), True),
    Method("implicit_midpoint", "implicit midpoint", None, 2, (1.0, 0.5), (1.0, -0.5)),
    Method("gauss2", "Gauss, 2 stages", None, 4, (1.0, 1 / 2, 1 / 12), (1.0, -1 / 2, 1 / 12)),
    Method("lobatto3", "Lobatto IIIA, 3 stages", None, 4, (1.0, 1 / 2, 1 / 12), (1.0, -1 / 2, 1 / 12), True),
    Method(
        "collocation", "Radau IIA, 3 stages", "collocation", 5, (1, 2 / 5, 1 / 20), (1, -3 / 5, 3 / 20, -1 / 60), True
    ),
    Method("rosenbrock", "Rosenbrock 5(4)", "rosenbrock", 5, *_rosenbrock(), True),
)
"""All methods, explicit ones first."""
