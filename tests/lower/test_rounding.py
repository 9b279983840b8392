"""Values that are nothing but rounding errors are told from small ones."""

from __future__ import annotations

import pytest

import acausal
from acausal import AcausalError, Component, Equations, Real, der, fixed, parameter, structural, variable
from acausal.flatten.pool import Pool
from acausal.numeric.evaluate import values
from acausal.numeric.samples import is_significant

THIRD = 1.0 / 3.0


def certain(pool: Pool, node: int, parameters: list[float]) -> bool:
    found = values(pool, [node], {"par": parameters.__getitem__, "time": lambda _: 0.0})
    return bool(is_significant(pool, node, found, {}))


@pytest.mark.parametrize(
    ("a", "b", "expected"),
    [
        (2.0 * THIRD, 0.5, True),  # the sum of two thirds and a half: a number
        (2.0 * THIRD, 2.0 * THIRD, False),  # 5.6e-17
        (2.0 * THIRD, 2.0 * THIRD * (1.0 - 1e-14), False),  # as inexact as the parameters themselves
        (2.0 * THIRD, 2.0 * THIRD * (1.0 - 1e-6), True),  # small, and right to ten digits
        (1e-30, 0.0, True),  # small numbers are numbers
    ],
)
def test_sums(a: float, b: float, expected: bool) -> None:
    pool = Pool()
    assert certain(pool, pool.sub(pool.par(0), pool.par(1)), [a, b]) is expected


def test_cancelled_terms_stay_uncertain_in_what_is_made_of_them() -> None:
    """1/3 + 1/3 - 2/3 divided by 1e-17 is of size 1, and as wrong."""
    pool = Pool()
    third = pool.div(pool.one, pool.par(0))
    noise = pool.sub(pool.add(third, third), pool.div(pool.par(1), pool.par(0)))
    assert not certain(pool, pool.div(noise, pool.par(2)), [3.0, 2.0, 1e-17])
    assert not certain(pool, pool.make("sin", noise), [3.0, 2.0])
    assert certain(pool, pool.make("cos", noise), [3.0, 2.0])


class Cancelling(Component):
    """(a/c + a/c - b/c) y + x == 1 and the same in z: with 2a = b it says x == 1, and y stays open."""

    a: Real = parameter(default=1.0)
    b: Real = parameter(default=2.0)
    c: Real = parameter(default=3.0)
    is_open: bool = structural(default=True)
    x: Real = variable(default=fixed(1.0))
    y: Real = variable()
    z: Real = variable()

    def equations(self) -> Equations:
        factor = self.a / self.c + self.a / self.c - self.b / self.c
        yield der(self.x) == -self.x
        yield factor * self.y + self.z == 1.0
        yield self.z - self.x == (0.0 if self.is_open else self.y - 1.0)


def test_no_division_by_rounding_errors() -> None:
    """y = (1 - x)/6e-17 would be a solution to the computer."""
    with pytest.raises(AcausalError, match="AC2"):
        acausal.compile(Cancelling())
    result = acausal.simulate(Cancelling(is_open=False), stop_time=1.0)
    assert result.final("z") == pytest.approx(1.0)
