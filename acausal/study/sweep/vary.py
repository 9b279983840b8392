"""Design of a sweep: grids and samples of the varied parameters, one row for each member."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from acausal.arrays import Vector
from acausal.errors import UsageError

SAMPLES = ("sobol", "halton", "lhs", "random")
# Largest number of members; a grid of five axes with 100 points each is surely a mistake.
_MOST_MEMBERS = 10**7


@dataclass(frozen=True)
class Range:
    """Values between `low` and `high` (SI units): `count` of them on a grid, or as many as a sample has points.

    With `log` their logarithms are evenly spaced.

    Raises
    ------
    UsageError
        AC060 if the ends are not finite, not ascending, or not positive with `log`, or for less than two values.
    """

    low: float
    high: float
    count: int | None = None
    log: bool = False

    def __post_init__(self) -> None:
        if not (math.isfinite(self.low) and math.isfinite(self.high) and self.low < self.high):
            raise UsageError("AC060", f"a range goes from a number to a larger one, not from {self.low} to {self.high}")
        if self.log and self.low <= 0.0:
            raise UsageError("AC060", f"a logarithmic range has positive ends, not {self.low}")
        if self.count is not None and self.count < 2:
            raise UsageError("AC060", f"a range has at least two values, not {self.count}")

    def levels(self) -> Vector:
        """Values of a grid including both ends, shape (count,).

        Raises UsageError: AC060 without `count`.
        """
        if self.count is None:
            raise UsageError(
                "AC060",
                f"a grid needs the number of values from {self.low:g} to {self.high:g}",
                help="give their number: Range(low, high, 7), or --vary NAME=LOW:HIGH:7; or draw a sample: sobol:256",
            )
        found = self.ppf(np.linspace(0.0, 1.0, self.count))
        found[[0, -1]] = self.low, self.high
        return found

    def ppf(self, q: Vector) -> Vector:
        """Quantiles at n probabilities `q`, shape (n,); named as in `scipy.stats`."""
        if self.log:
            return np.asarray(np.exp(np.log(self.low) + q * (np.log(self.high) - np.log(self.low))))
        return np.asarray(self.low + q * (self.high - self.low))


def design(
    vary: Mapping[str, Any] | Sequence[Mapping[str, float]], sample: str | None, seed: int
) -> tuple[tuple[str, ...], Vector]:
    """(Names of the varied parameters, their values, shape (members, names)).

    Raises UsageError: AC060 for an invalid design.

    `vary`: a range, a sequence of values or a distribution (any object with `ppf`) for each parameter; or a sequence of
    members, each with its values.
    `sample`: None for the grid of all combinations, in which the last name varies fastest; "sobol:256", "halton:100",
    "lhs:100" (Latin hypercube) or "random:1000" for this number of points.
    `seed`: seed of the sample.
    """
    if not vary:
        raise UsageError("AC060", "nothing is varied", help="vary={'mass.m': acausal.Range(1.0, 2.0, 5)}")
    if not isinstance(vary, Mapping):
        return _listed_design(vary, sample)
    names = tuple(vary)
    if sample is not None:
        draws = _sample_points(sample, len(names), seed)
        columns = [_quantiles(name, vary[name], draws[:, k]) for k, name in enumerate(names)]
        values = np.stack(columns, axis=1)
    else:
        axes = [_levels(name, vary[name]) for name in names]
        _check_size(math.prod(map(len, axes)))
        values = np.stack([a.ravel() for a in np.meshgrid(*axes, indexing="ij")], axis=1)
    not_finite = np.argwhere(~np.isfinite(values))
    if not_finite.size:
        raise UsageError("AC060", f"{names[not_finite[0][1]]} takes a value that is not finite")
    return names, values


def _listed_design(rows: Sequence[Mapping[str, float]], sample: str | None) -> tuple[tuple[str, ...], Vector]:
    """The design of members listed one by one."""
    if sample is not None:
        raise UsageError("AC060", "members that are listed one by one cannot be sampled")
    names = tuple(rows[0])
    for k, row in enumerate(rows):
        if set(row) != set(names):
            raise UsageError(
                "AC060", f"member {k} has other parameters than the first", evidence=[", ".join(row), ", ".join(names)]
            )
    return names, np.stack([_numbers(name, [row[name] for row in rows]) for name in names], axis=1)


def _levels(name: str, given: Any) -> Vector:
    """Grid values of one parameter, shape (n,); AC060."""
    if isinstance(given, Range):
        return given.levels()
    if hasattr(given, "ppf"):
        raise UsageError("AC060", f"{name} has a distribution, which has no grid", help="sample='sobol:256'")
    return _numbers(name, given)


def _numbers(name: str, given: Any) -> Vector:
    """Listed values of one parameter, shape (n,); AC060."""
    try:
        values = np.asarray(given, dtype=float)
    except (TypeError, ValueError) as error:
        raise UsageError(
            "AC060",
            f"the values of {name} are not numbers: {given!r}",
            help="give numbers in SI; on the command line with units: --vary T=20degC,40degC",
        ) from error
    if values.ndim != 1 or not values.size or not np.isfinite(values).all():
        raise UsageError("AC060", f"the values of {name} are not a sequence of finite numbers")
    return values


def _quantiles(name: str, given: Any, q: Vector) -> Vector:
    """Quantiles of one parameter at n probabilities, shape (n,); AC060."""
    if not hasattr(given, "ppf"):
        raise UsageError(
            "AC060",
            f"{name} has single values, from which no sample can be drawn",
            help="acausal.Range(low, high), or a distribution: scipy.stats.norm(mean, deviation)",
        )
    return np.asarray(given.ppf(q), dtype=float)


def _sample_points(sample: str, dimensions: int, seed: int) -> Vector:
    """Points of the open unit cube, shape (n, dimensions)."""
    kind, _, number = sample.partition(":")
    if kind not in SAMPLES or not number.isdecimal() or not int(number):
        raise UsageError("AC060", f"there is no sample '{sample}'", help=f"{', '.join(SAMPLES)}, as in sobol:256")
    _check_size(int(number))
    if kind == "random":
        found = np.random.default_rng(seed).random((int(number), dimensions))
    else:
        from scipy.stats import qmc

        engines = {"sobol": qmc.Sobol, "halton": qmc.Halton, "lhs": qmc.LatinHypercube}
        with warnings.catch_warnings():
            # SciPy warns of Sobol samples whose size is not a power of two; they are less uniform but valid
            warnings.simplefilter("ignore", UserWarning)
            found = engines[kind](d=dimensions, seed=seed).random(int(number))
    tiny = np.finfo(float).tiny
    return np.clip(found, tiny, 1.0 - 2.0**-53)  # the ends of a normal distribution are infinite


def _check_size(members: int) -> None:
    """AC060 for too many members."""
    if members > _MOST_MEMBERS:
        raise UsageError("AC060", f"a sweep of {members} members is larger than {_MOST_MEMBERS}")
