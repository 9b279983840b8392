"""What residuals and their derivatives say about the parameters: spread, correlation, and doubts."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from acausal.arrays import Vector

_CONFIDENCE = 0.95
# Derivatives are differences of runs, good to about 1e-4: columns that much smaller than others may be that error, and
# columns that agree to ten times that are the same one.
_NOTHING = 1e-4
_ALIKE = 1e-3
# Share of a parameter in a direction that the data do not see from which it is named.
_SHARE = 0.05
# Correlation beyond which two parameters are said to be hardly told apart.
_CLOSE = 0.99
# Correlation of residuals that follow one another beyond which they are no noise: by chance it is 1/sqrt(rows).
_COLOURED = 0.5


@dataclass(frozen=True, eq=False)
class Unknowns:
    """Parameters to find: paths, units, guesses, limits and magnitudes, each of shape (n,)."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    guess: Vector
    low: Vector
    high: Vector

    @property
    def guess_by_name(self) -> dict[str, float]:
        """Where the search begins."""
        return dict(zip(self.names, self.guess.tolist(), strict=True))

    @property
    def scale(self) -> Vector:
        """What each is measured in: its guess, or the width of its limits where that is zero."""
        width = np.where(np.isfinite(self.high - self.low), self.high - self.low, 1.0)
        return np.where(self.guess != 0.0, np.abs(self.guess), width)


@dataclass(frozen=True, eq=False)
class Judgement:
    """See `Fit` for the attributes."""

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
    is_known: bool,
    by_signal: Mapping[str, Vector],
) -> Judgement:
    """Judge a fit by its weighted residuals, shape (rows,), and their derivatives by scaled parameters, (rows, n).

    The linearised model has the covariance s^2 (J'J)^-1, with s^2 from the residuals, or 1 where the noise `is_known`
    (Bates and Watts 1988, section 2.2). Directions in which the data say nothing get an infinite spread.
    """
    from scipy.stats import t as student

    rows, n = jacobian.shape
    square = 1.0 if is_known else float(residuals @ residuals) / (rows - n)
    norms = np.linalg.norm(jacobian, axis=0)
    # what moves the signals by no more than the error of a difference, and by less than the noise at twice its value
    mute = (norms <= _NOTHING * norms.max()) & (norms <= np.sqrt(square))
    heard: NDArray[np.intp] = np.flatnonzero(~mute)
    _, size, right = np.linalg.svd(jacobian[:, heard] / norms[heard], full_matrices=False)
    told = size > _ALIKE
    part = right[told].T / size[told] / norms[heard, None]
    covariance = np.zeros((n, n))
    covariance[heard[:, None], heard] = square * part @ part.T
    blind = mute.copy()
    blind[heard] = (np.abs(right[~told]) > _SHARE).any(axis=0)
    std = np.sqrt(np.diag(covariance))
    both = np.outer(std, std)
    correlation = np.where(both > 0.0, covariance / np.where(both > 0.0, both, 1.0), np.eye(n))
    std[blind] = np.inf
    correlation[blind, :] = correlation[:, blind] = np.nan
    covariance[blind, :] = covariance[:, blind] = np.nan
    covariance[blind, blind] = np.inf
    reach = (1.96 if is_known else float(student.ppf(0.5 + 0.5 * _CONFIDENCE, rows - n))) * std * unknown.scale
    value = q * unknown.scale
    names = np.array(unknown.names)
    notes = [
        *(f"{name} does not change the measured signals: what was found is arbitrary" for name in names[mute]),
        *(_together(names[heard][np.abs(direction) > _SHARE]) for direction in right[~told]),
        *_close(correlation, unknown.names),
        *_at_limit(value, unknown),
        *_coloured(by_signal),
    ]
    scales = np.outer(unknown.scale, unknown.scale)
    interval = np.column_stack([value - reach, value + reach])
    return Judgement(std * unknown.scale, interval, covariance * scales, correlation, tuple(notes))


def _together(names: Iterable[str]) -> str:
    return f"only a combination of {', '.join(names)} shows in the measured signals: give one of them its value"


def _close(correlation: Vector, names: tuple[str, ...]) -> list[str]:
    return [
        f"{names[i]} and {names[k]} are hardly told apart by the data: their correlation is {correlation[i, k]:.4f}"
        for i in range(len(names))
        for k in range(i)
        if abs(correlation[i, k]) > _CLOSE
    ]


def _at_limit(value: Vector, unknown: Unknowns) -> list[str]:
    near = 1e-6 * unknown.scale
    rows = zip(unknown.names, value - unknown.low <= near, unknown.high - value <= near, strict=True)
    return [
        f"{n} is at its {'lower' if low else 'upper'} limit: no interval holds there"
        for n, low, up in rows
        if low or up
    ]


def _coloured(by_signal: Mapping[str, Vector]) -> list[str]:
    found = []
    for name, r in by_signal.items():
        power = float(r @ r)
        if len(r) > 20 and power > 0.0 and float(r[1:] @ r[:-1]) / power > _COLOURED:
            found.append(
                f"the residuals of {name} are no noise but follow one another: the model lacks something, and the "
                "intervals are too narrow"
            )
    return found
