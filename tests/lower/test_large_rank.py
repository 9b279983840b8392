"""Nonlinear blocks of more than two hundred unknowns are tested for rank before a run."""

from __future__ import annotations

import pytest

import acausal
from acausal import Component, Equations, Real, der, fixed, parameter, structural, variable
from acausal.errors import StructureError


class Ring(Component):
    """Exchanges around a ring that depend on differences only: the level is free, unless one place leaks."""

    n: int = structural(default=220)
    leaks: bool = structural(default=False)
    rate: Real = parameter(default=1.0)
    x: Real = variable(default=fixed(1.0))
    v: Real = variable(shape=220)

    def equations(self) -> Equations:
        yield der(self.x) == -self.x
        for k in range(self.n):
            before, here, after = self.v[k - 1], self.v[k], self.v[(k + 1) % self.n]
            given = (here - before) ** 3 + here - before + (here - after) ** 3 + here - after
            lost = self.rate * here if self.leaks and k == 0 else 0.0
            yield given + self.v[(k + 7) % self.n] - here + lost == self.x * (k - (self.n - 1) / 2)


def test_a_free_level_is_found() -> None:
    """The sum of all equations holds no unknown."""
    with pytest.raises(StructureError, match="AC204"):
        acausal.compile(Ring())


def test_a_leak_fixes_the_level() -> None:
    assert acausal.compile(Ring(leaks=True)).states == ("x",)
