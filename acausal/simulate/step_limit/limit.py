"""Refuses runs whose fixed step amplifies a mode; the error names the states of the mode, and a stable step.

The check is cheap: eigenvalues at the start before the run, and at a few points of the run after it. A mode is
amplified if |R(h*lambda)| > 1 (`amplification.py`). The accumulated growth decides, so that the harmless growth of an
undamped oscillation with small steps of Heun's method is accepted.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from acausal.arrays import Complex, Vector
from acausal.errors import IntegrationError
from acausal.lower.compiled import CompiledModel
from acausal.result.result import Result
from acausal.simulate.equations.problem import Problem
from acausal.simulate.options import Options
from acausal.simulate.record.record import Recorder
from acausal.simulate.step_limit.amplification import METHODS, MOST_GROWTH, Method
from acausal.simulate.step_limit.state_matrix import LARGEST_DENSE, StateMatrix

# The run is refused before it begins if modes of the start grow this much (as a logarithm) in its first part.
_LARGE_GROWTH = math.log(1e3)
_FIRST_PART = 0.05
_POINTS, _POINTS_IF_SMALL, _SMALL_SIZE = 12, 400, 50
_FIRST_STEPS = 3
_LEAST_PARTICIPATION = 0.1


@dataclass
class StepLimit:
    """The checks of one run with a fixed step; they do nothing unless the solver is explicit."""

    problem: Problem
    solver: str
    options: Options
    method: Method | None = field(init=False)

    def __post_init__(self) -> None:
        method = next((m for m in METHODS if m.solver == self.solver), None)
        guarded = method is not None and method.explicit and self.problem.n_dynamic > 0
        self.method = method if guarded else None

    def check_start(self, t: float, x: Vector, z: Vector, m: Vector) -> None:
        """Refuse (AC405) a step that amplifies the start's modes a thousandfold within a twentieth of the run.

        The points after the first steps are checked too: a tool next to the workpiece may be in stiff contact after one
        step.
        """
        matrix = self.matrix(self.problem.compiled)
        if self.method is None or matrix.inert:
            return
        span = self.options.stop_time - self.options.start_time
        n = self.problem.n_dynamic
        for _ in range(_FIRST_STEPS):
            rate = float(self._rates(matrix, np.array([t]), x[:, None], z[:, None], m[:, None])[0])
            if rate * max(_FIRST_PART * span, self.step) > _LARGE_GROWTH:
                raise self._refusal(matrix, t, x, z, m, rate * span)
            speed, second = matrix.rates(t, x, z, m)
            ahead = x[:n] + self.step * speed + 0.5 * self.step**2 * second
            if not np.isfinite(ahead).all():
                return
            t, x = t + self.step, np.concatenate([ahead, x[n:]])

    def check_run(self, recorder: Recorder, result: Result, equations: Callable[[float], CompiledModel]) -> None:
        """Refuse (AC405) a run, completed or failed, whose step amplified a mode somewhere.

        `equations` gives the model integrated just after a time: held relations add fast modes. The error carries
        `result`.
        """
        if self.method is None or not recorder.segments:
            return
        times, x, z, m = recorder.rows()
        finite = np.flatnonzero(np.isfinite(x).all(axis=0) & np.isfinite(z).all(axis=0))
        if not len(finite):
            return
        count = min(_POINTS_IF_SMALL if self.problem.n_dynamic <= _SMALL_SIZE else _POINTS, len(finite))
        chosen = np.unique(finite[np.linspace(0, len(finite) - 1, count).round().astype(int)])
        instants = times[chosen]
        models = [equations(float(t)) for t in instants]
        rates = np.zeros(len(chosen))
        for model in dict.fromkeys(models):
            same = np.array([other is model for other in models])
            k = chosen[same]
            if not self.matrix(model).inert:
                rates[same] = self._rates(self.matrix(model), times[k], x[:, k], z[:, k], m[:, k])
        durations = np.diff(np.concatenate([[instants[0]], 0.5 * (instants[1:] + instants[:-1]), [instants[-1]]]))
        amplified = np.where(rates > 0.0, rates * np.maximum(durations, self.step), 0.0)
        # rows after the one at which errors have outgrown the solution are meaningless
        worst = int(np.argmax(rates[: int(np.argmax(np.cumsum(amplified) > MOST_GROWTH)) + 1]))
        if amplified.sum() > MOST_GROWTH:
            at, matrix = chosen[worst], self.matrix(models[worst])
            error = self._refusal(matrix, float(times[at]), x[:, at], z[:, at], m[:, at], float(amplified.sum()))
            error.result = result
            raise error

    @property
    def step(self) -> float:
        """The step that is actually taken [s]: some methods divide every output interval into equal steps."""
        step, interval = self.options.step or math.inf, self.options.output_interval
        if self.solver == "erk":
            return min(step, self.options.stop_time - self.options.start_time)
        return interval / max(1, math.ceil(interval / step - 1e-9))

    def matrix(self, model: CompiledModel) -> StateMatrix:
        """The linearised state equations of this run while it integrates `model`."""
        return StateMatrix(model, self.problem.p, self.problem.u)

    def _rates(self, matrix: StateMatrix, times: Vector, x: Vector, z: Vector, m: Vector) -> Vector:
        """Largest rate of numerical growth [1/s] at each point; 0 where it cannot be computed."""
        assert self.method is not None
        if self.problem.n_dynamic <= _SMALL_SIZE and len(self.problem.compiled.algebraic) <= _SMALL_SIZE:
            spectra = list(matrix.spectra(times, x, z, m))
        else:
            several = (matrix.eigenvalues(float(t), x[:, k], z[:, k], m[:, k]) for k, t in enumerate(times))
            spectra = [np.full(1, np.nan, dtype=complex) if modes is None else modes for modes in several]
        rates = np.zeros(len(times))
        for k, modes in enumerate(spectra):
            if np.isfinite(modes).all() and len(modes):
                rates[k] = np.max(self.method.growth(modes, self.step))
        return rates

    def _refusal(
        self, matrix: StateMatrix, t: float, x: Vector, z: Vector, m: Vector, growth: float
    ) -> IntegrationError:
        assert self.method is not None
        modes = matrix.eigenvalues(t, x, z, m)
        assert modes is not None
        worst = modes[int(np.argmax(self.method.growth(modes, self.step)))]
        # for an undamped mode no step may be stable; then one that is harmless in this run
        largest = self.method.largest_step(modes)[0] or self.method.usable_step(modes, self.options.span)[0]
        size = float(np.abs(self.method.amplification(self.step * worst)))
        names = ", ".join(_participants(matrix, t, x, z, m, worst))
        factor = f"{math.exp(growth):.2g}" if growth < 500.0 else f"10^{growth / math.log(10.0):.0f}"
        return IntegrationError(
            "AC405",
            f"a step of {self.step:.4g} s is unstable with {self.method.title}: the largest stable step at "
            f"t = {t:.6g} s is {largest:.4g} s",
            evidence=[
                f"mode      {_text(worst)} 1/s at t = {t:.6g} s, in the states {names}",
                f"one step  multiplies it by {size:.4g}, the run by {factor}",
            ],
            cause="the explicit method with this step leaves its stability region",
            help=f"--step {0.9 * largest:.2g}, or an implicit solver (--solver rosenbrock); --force runs it anyway",
        )


def _participants(matrix: StateMatrix, t: float, x: Vector, z: Vector, m: Vector, mode: complex) -> list[str]:
    """Names of the states with the largest participation in a mode, in descending order."""
    state_matrix = matrix.at(t, x, z, m) if matrix.size <= LARGEST_DENSE else None
    if state_matrix is None:
        return ["(too many states to name them)"]
    factors = participation(state_matrix, mode)
    order = np.argsort(-factors, kind="stable")[:3]
    return [matrix.names[k] for k in order if factors[k] >= _LEAST_PARTICIPATION * factors[order[0]]]


def participation(matrix: Vector, mode: complex) -> Vector:
    """Participation factors of the states in the eigenvalue of a matrix, shape (n, n), that is nearest to `mode`.

    They are |left eigenvector entry * right eigenvector entry|, which does not depend on units, normalised to a sum of
    1; shape (n,). Source: I. J. Perez-Arriaga, G. C. Verghese, F. C. Schweppe, IEEE Trans. PAS-101 (1982) 3117.
    """
    right, left = eigenvectors(matrix, mode)
    factors = np.abs(left.conj() * right)
    total = float(factors.sum())
    return np.asarray(factors / total if total > 0.0 else np.full(len(factors), 1.0 / len(factors)))


def eigenvectors(matrix: Vector, mode: complex) -> tuple[Complex, Complex]:
    """Right and left eigenvector, shape (n,), of the eigenvalue nearest to `mode`."""
    from scipy.linalg import eig

    decomposition: Any = eig(matrix, left=True, right=True)
    values, left, right = decomposition
    k = int(np.argmin(np.abs(values - mode)))
    return right[:, k], left[:, k]


def _text(mode: complex) -> str:
    return f"{mode.real:.4g}" if mode.imag == 0.0 else f"{mode.real:.4g} +- {abs(mode.imag):.4g}i"
