"""Reproducible random signals: a number is drawn at each tick of a clock and held until the next.

Names as in Modelica.Blocks.Noise, with another generator: S. K. Park, K. W. Miller, Random number generators: good ones
are hard to find, Comm. ACM 31 (1988), x -> 16807*x modulo 2^31 - 1. All its products are integers below 2^53, so that
double arithmetic is exact on every machine and in generated C.
"""

from __future__ import annotations

import random

from acausal import (
    Equations,
    Expr,
    Real,
    assert_,
    cos,
    discrete,
    floor,
    log,
    parameter,
    pre,
    reset,
    signal_output,
    sqrt,
    structural,
    when,
)
from acausal.library.blocks.sampled import PartialDiscrete

_MULTIPLIER = 16807.0
_MODULUS = 2147483647.0


class PartialNoise(PartialDiscrete):
    """A new random number at each tick; equal seeds give equal signals."""

    seed: int = structural(default=1, doc="Whole number that selects the signal")
    y: Real = signal_output(doc="The number drawn last")
    state: Real = discrete(default=lambda self: _first_state(self.seed), doc="State of the generator")
    held: Real = discrete(doc="The number drawn last")

    def equations(self) -> Equations:
        yield self.y == self.held


class UniformNoise(PartialNoise):
    """Noise with a uniform distribution between `y_min` and `y_max`."""

    y_min: Real = parameter(default=0.0, doc="Smallest number")
    y_max: Real = parameter(default=1.0, doc="Largest number")

    def equations(self) -> Equations:
        yield assert_(self.y_min <= self.y_max, "y_min is above y_max")
        new = _next_state(pre(self.state))
        drawn = self.y_min + (self.y_max - self.y_min) * (new / _MODULUS)
        yield when(self.tick(), reset(self.state, new), reset(self.held, drawn))


class NormalNoise(PartialNoise):
    """Noise with a normal distribution of mean `mu` and standard deviation `sigma`.

    Source: G. E. P. Box, M. E. Muller, Ann. Math. Statist. 29 (1958).
    """

    mu: Real = parameter(default=0.0, doc="Mean")
    sigma: Real = parameter(default=1.0, min=0.0, doc="Standard deviation")

    def equations(self) -> Equations:
        first = _next_state(pre(self.state))
        second = _next_state(first)
        length = sqrt(-2.0 * log(first / _MODULUS))
        drawn = self.mu + self.sigma * (length * cos(6.283185307179586 * (second / _MODULUS)))
        yield when(self.tick(), reset(self.state, second), reset(self.held, drawn))


def _next_state(state: Expr) -> Expr:
    """Next state of the generator."""
    product = _MULTIPLIER * state
    return product - _MODULUS * floor(product / _MODULUS)


def _first_state(seed: int) -> float:
    """Initial state for a seed, scrambled because small states give small first numbers."""
    return float(random.Random(seed).randrange(1, int(_MODULUS)))
