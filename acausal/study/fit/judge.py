"""Statistics of a fit: standard deviations, correlations, and notes on parameters that the data do not determine."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from acausal.arrays import Vector

_CONFIDENCE = 0.95
# Derivatives by differences of runs are accurate to about 1e-4: columns smaller than this fraction of the largest one
# may be errors, and singular values below ten times this fraction count as zero.
_NOTHING = 1e-4
_ALIKE = 1e-3
# A parameter is named in a note if its component in an undetermined direction exceeds this.
_COMPONENT = 0.05
# Two parameters with a larger correlation count as hardly distinguishable.
_CLOSE = 0.99
# Fewer degrees of freedom do not determine the noise of a signal.
_FEW = 0.5
# Residuals below this fraction of the data are errors of the runs, and do not test the model.
_EXACT = 1e-8
# Residuals with a larger autocorrelation are not white noise, whose autocorrelation is about 1/sqrt(rows).
_AUTOCORRELATION = 0.5


@dataclass(frozen=True, eq=False)
class Unknowns:
    """Parameters to estimate: paths, units, guesses and limits, each of shape (n,)."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    guess: Vector
    low: Vector
    high: Vector

    @property
    def guess_by_name(self) -> dict[str, float]:
        """Start values by path."""
        return dict(zip(self.names, self.guess.tolist(), strict=True))

    @property
    def scale(self) -> Vector:
        """Scale of each parameter, shape (n,): its guess, or the width of its limits if that is zero."""
        width = np.where(np.isfinite(self.high - self.low), self.high - self.low, 1.0)
        return np.where(self.guess != 0.0, np.abs(self.guess), width)


@dataclass(frozen=True, eq=False)
class Judgement:
    """Statistics of a fit, with the attributes of `Fit`."""

    std: Vector
    interval: Vector
    covariance: Vector
    correlation: Vector
    notes: tuple[str, ...]


def judge(
    residuals: Vector,
    jacobian: Vector,
    q: Vector,
    unknown: Unknowns,
    noisy: Mapping[str, NDArray[np.intp]],
    by_signal: Mapping[str, tuple[Vector, float]],
) -> Judgement:
    """Statistics from weighted residuals, shape (rows,), and their derivatives by scaled parameters, shape (rows, n).

    `noisy`: rows of each signal whose noise is unknown; the weighted noise of other rows has the variance 1.
    `by_signal`: residuals and largest magnitude of the data of each signal, in its unit.

    The linearised model has the covariance C (sum s_i^2 J_i'J_i) C with C = (J'J)^-1, where s_i^2 is the variance of
    the weighted noise of signal i; for a single signal this is s^2 (J'J)^-1 (Bates and Watts 1988, section 2.2).
    Undetermined directions have an infinite standard deviation. The quantiles are Student's, with the degrees of
    freedom of a sum of variances (Satterthwaite, Biometrics Bulletin 2, 1946), because many rows of one signal do not
    determine the noise of another.
    """
    from scipy.stats import t as student

    rows, n = jacobian.shape
    norms = np.linalg.norm(jacobian, axis=0)
    # parameters whose effect is within the error of differences, and below the noise even at twice their value
    level = np.sqrt(float(residuals @ residuals) / (rows - n)) if noisy else 1.0
    has_no_effect = (norms <= _NOTHING * norms.max()) & (norms <= level)
    effective: NDArray[np.intp] = np.flatnonzero(~has_no_effect)
    left, size, right = np.linalg.svd(jacobian[:, effective] / norms[effective], full_matrices=False)
    is_determined = size > _ALIKE
    part = right[is_determined].T / size[is_determined] / norms[effective, None]
    covariance = np.zeros((n, n))
    variance, freedom, unclear = _variance(residuals, left[:, is_determined], part, noisy)
    covariance[effective[:, None], effective] = variance
    is_undetermined = has_no_effect.copy()
    is_undetermined[effective] = (np.abs(right[~is_determined]) > _COMPONENT).any(axis=0)
    std = np.sqrt(np.diag(covariance))
    products = np.outer(std, std)
    correlation = np.where(products > 0.0, covariance / np.where(products > 0.0, products, 1.0), np.eye(n))
    std[is_undetermined] = np.inf
    correlation[is_undetermined, :] = correlation[:, is_undetermined] = np.nan
    covariance[is_undetermined, :] = covariance[:, is_undetermined] = np.nan
    covariance[is_undetermined, is_undetermined] = np.inf
    quantile = np.full(n, np.inf)
    quantile[effective] = np.where(freedom < _FEW, np.inf, student.ppf(0.5 + 0.5 * _CONFIDENCE, freedom))
    half_width = quantile * np.where(quantile < np.inf, std, 1.0) * unknown.scale
    value = q * unknown.scale
    names = np.array(unknown.names)
    notes = (
        *(f"{name} does not change the measured signals: its estimate is arbitrary" for name in names[has_no_effect]),
        *(_only_combined(names[effective][np.abs(direction) > _COMPONENT]) for direction in right[~is_determined]),
        *_close(correlation, unknown.names),
        *_at_limit(value, unknown),
        *unclear,
        *_autocorrelated(by_signal),
    )
    scales = np.outer(unknown.scale, unknown.scale)
    interval = np.column_stack([value - half_width, value + half_width])
    return Judgement(std * unknown.scale, interval, covariance * scales, correlation, notes)


def _variance(
    residuals: Vector, left: Vector, part: Vector, noisy: Mapping[str, NDArray[np.intp]]
) -> tuple[Vector, Vector, list[str]]:
    """(Covariance, shape (n, n), degrees of freedom of each variance, shape (n,), notes).

    `left`, `part`: the weighted derivatives are `left @ pinv(part)`, shapes (rows, k) and (n, k), `left` orthonormal.
    """
    n = len(part)
    is_known = np.ones(len(residuals), dtype=bool)
    covariance, spread, notes = np.zeros((n, n)), np.zeros(n), []
    for name, rows in noisy.items():
        is_known[rows] = False
        # number of rows less the number of parameters that they determine: the trace of their block of I - left left'
        freedom = len(rows) - float(np.sum(left[rows] ** 2))
        if freedom < _FEW:
            notes.append(f"{name} has too few values to determine its noise: give its sigma")
        freedom = max(freedom, _FEW / 10.0)
        term = part @ (left[rows].T @ left[rows]) @ part.T * float(residuals[rows] @ residuals[rows]) / freedom
        covariance += term
        spread += np.diag(term) ** 2 / freedom
    covariance += part @ (left[is_known].T @ left[is_known]) @ part.T
    with np.errstate(divide="ignore", invalid="ignore"):
        return covariance, np.where(spread > 0.0, np.diag(covariance) ** 2 / spread, np.inf), notes


def _only_combined(names: Iterable[str]) -> str:
    return f"only a combination of {', '.join(names)} affects the measured signals: fix the value of one of them"


def _close(correlation: Vector, names: tuple[str, ...]) -> list[str]:
    return [
        f"the data hardly distinguish {names[i]} and {names[k]}: their correlation is {correlation[i, k]:.4f}"
        for i in range(len(names))
        for k in range(i)
        if abs(correlation[i, k]) > _CLOSE
    ]


def _at_limit(value: Vector, unknown: Unknowns) -> list[str]:
    near = 1e-6 * unknown.scale
    rows = zip(unknown.names, value - unknown.low <= near, unknown.high - value <= near, strict=True)
    return [
        f"{n} is at its {'lower' if low else 'upper'} limit: its interval is not valid there"
        for n, low, up in rows
        if low or up
    ]


def _autocorrelated(by_signal: Mapping[str, tuple[Vector, float]]) -> list[str]:
    found = []
    for name, (r, size) in by_signal.items():
        power = float(r @ r)
        is_exact = power <= len(r) * (_EXACT * size) ** 2
        if len(r) > 20 and not is_exact and float(r[1:] @ r[:-1]) / power > _AUTOCORRELATION:
            found.append(
                f"the residuals of {name} are not noise but correlated in time: the model lacks an effect, and the "
                "intervals are too narrow"
            )
    return found
