"""A library is found by everything it is made of: who edits a number in a model does not get the old one's results."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import pytest

import acausal
from acausal import (
    Component,
    Equations,
    Real,
    der,
    discrete,
    fixed,
    pre,
    reset,
    sample,
    sin,
    structural,
    time,
    variable,
    when,
    where,
)
from acausal.simulate.native import cache
from tests.marks import slow_but

pytestmark = pytest.mark.skipif(cache.compiler() is None, reason="no C compiler on this machine")

WRITTEN: Mapping[str, float] = {
    "rate": 1.0,
    "relation": 0.3,
    "branch": 1.0,
    "condition": 0.4,
    "action": 2.0,
    "clock": 0.7,
    "sampled": 1.0,
    "switch": 1.5,
    "slide": 0.25,
    "pull": 0.5,
}
EDITS = [*WRITTEN]


class Written(Component):
    """A bit of everything that compiled code passes, with numbers in the places of the names."""

    numbers: Mapping[str, float] = structural(default=WRITTEN)
    x: Real = variable(default=fixed(0.0))
    v: Real = variable(default=fixed(1.0))
    y: Real = variable(default=fixed(0.0))
    w: Real = variable(default=fixed(1.0))
    n: Real = discrete(default=fixed(0.0))
    d: Real = discrete(default=fixed(0.0))

    def equations(self) -> Equations:
        k = self.numbers
        yield der(self.x) == k["rate"] * self.v
        yield der(self.v) == -self.x
        yield der(self.y) == where(self.x > k["relation"], k["branch"], 0.0) + where(time > k["switch"], 0.1, 0.0)
        # slides along its relation from where it has come down to it
        yield der(self.w) == k["pull"] * sin(self.x) - where(self.w > k["slide"], 1.0, -1.0)
        yield when(self.v > k["condition"], reset(self.n, pre(self.n) + k["action"]))
        yield when(sample(0.1, k["clock"]), reset(self.d, k["sampled"] * self.x))


def final(numbers: Mapping[str, float], native: bool) -> list[float]:
    compiled = acausal.compile(Written(numbers=numbers), cache=False)
    result = acausal.simulate(compiled, solver="rosenbrock", stop_time=8.0, native=native)
    return [float(result.final(name)) for name in ("x", "v", "y", "w", "n", "d")]


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A cache that holds the libraries of the model as it is written."""
    return tmp_path_factory.mktemp("cache")


@pytest.mark.parametrize("edited", slow_but([None, *EDITS], None, "rate"))
def test_an_edited_number_counts(edited: str | None, kept: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Compiled runs give what interpreted ones do, whatever libraries are there."""
    monkeypatch.setenv("ACAUSAL_CACHE", str(kept))
    numbers = {k: 0.8 * v if k == edited else v for k, v in WRITTEN.items()}
    interpreted = final(numbers, False)
    assert final(numbers, True) == pytest.approx(interpreted, abs=2e-5)
