"""Delays of signals, exact and as Pade approximations. Names as in Modelica.Blocks.Nonlinear."""

from __future__ import annotations

from math import factorial

from acausal import Component, Equations, Expr, Real, delay, der, parameter, part, signal_input, structural, variable
from acausal.library.blocks.interfaces import PartialSISO


class FixedDelay(PartialSISO):
    """The input delayed by `delay_time`; until then, its initial value."""

    delay_time: Real = parameter(unit="s", min=0.0, doc="Delay of the output behind the input")

    def equations(self) -> Equations:
        yield self.y == delay(self.u, self.delay_time)


class VariableDelay(PartialSISO):
    """The input delayed by the value of another input, at most `delay_max`."""

    delay_max: Real = parameter(unit="s", min=0.0, doc="Longest delay")
    delay_time: Real = signal_input(unit="s", doc="Delay of the output behind the input")

    def equations(self) -> Equations:
        yield self.y == delay(self.u, self.delay_time, self.delay_max)


class PadeStage(Component):
    """One state of a Pade approximation."""

    x: Real = variable(doc="Derivative of a filtered input, times a power of the delay")


class PadeDelay(PartialSISO):
    """Rational approximation of a delay: a transfer function, for uses that do not support a true delay.

    With order n of the denominator and m of the numerator it is exact to the order n + m in frequency times delay. It
    starts at rest. With m = n it has a direct feedthrough.

    Source: H. Pade; as in G. H. Golub, C. F. Van Loan, Matrix Computations (1996), theorem 11.3.1.
    """

    delay_time: Real = parameter(unit="s", min=1e-60, doc="Delay of the output behind the input")
    n: int = structural(default=3, doc="Order of the denominator")
    m: int = structural(default=-1, doc="Order of the numerator, at most n; -1 means n")
    stages: list[PadeStage] = part(doc="States, from the filtered input on")

    def build(self) -> None:
        self.stages = [PadeStage() for _ in range(self.n)]

    @property
    def order(self) -> int:
        """Order of the numerator."""
        return self.n if self.m < 0 else self.m

    def equations(self) -> Equations:
        n, m = self.n, self.order
        below = [_coefficient(k, n, m) for k in range(n + 1)]
        above = [(-1.0) ** k * _coefficient(k, m, n) for k in range(m + 1)]
        x = [s.x for s in self.stages]
        last = (self.u - _sum(below[:n], x)) / below[n]
        for k in range(n):
            yield self.delay_time * der(x[k]) == (x[k + 1] if k + 1 < n else last)
        through = above[n] * last if m == n else 0.0
        yield self.y == _sum(above[:n], x) + through

    def initial_equations(self) -> Equations:
        for k, stage in enumerate(self.stages):
            yield stage.x == (self.u if k == 0 else 0.0 * self.u)


def _coefficient(k: int, own: int, other: int) -> float:
    """Coefficient of (s T)^k in the polynomial of order `own`, where the other polynomial has the order `other`."""
    return factorial(own + other - k) * factorial(own) / (factorial(own + other) * factorial(k) * factorial(own - k))


def _sum(factors: list[float], terms: list[Expr]) -> Expr:
    total: Expr = factors[0] * terms[0]
    for f, x in zip(factors[1:], terms[1:], strict=False):
        total = total + f * x
    return total
