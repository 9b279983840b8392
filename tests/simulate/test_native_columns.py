"""C of repeated components, each pattern once: shorter, and the interpreter's numbers."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import acausal
from acausal.models.mass_chain import MassSpringDamperChain
from acausal.simulate.native import cache, source
from acausal.simulate.native.equations import by_patterns, equations

COMPILER = pytest.mark.skipif(cache.compiler() is None, reason="no C compiler on this machine")


@pytest.fixture
def columns(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Columns in C of models of any size, and a cache of their own."""
    monkeypatch.setattr(import_module("acausal.simulate.native.equations"), "_LARGEST_FLAT", 0)
    monkeypatch.setenv("ACAUSAL_CACHE", str(tmp_path))


@COMPILER
@pytest.mark.parametrize("solver", [pytest.param("erk", marks=pytest.mark.slow), "rosenbrock"])
@pytest.mark.usefixtures("columns")
def test_compiled_and_interpreted_runs_agree(solver: str) -> None:
    compiled = acausal.compile(MassSpringDamperChain(n=250), cache=False)
    assert compiled.mapped() is not None
    options: dict[str, Any] = {
        "solver": solver,
        "stop_time": 0.5,
        "output_interval": 0.5,
    }  # without rows inside of steps
    runs = [acausal.simulate(compiled, native=n, **options) for n in (False, True)]
    assert runs[1].stats["native"]
    assert runs[0].stats["steps"] == runs[1].stats["steps"]
    for name in ("masses[0].s", "masses[3].v", "springs[1].f"):
        np.testing.assert_allclose(runs[1][name], runs[0][name], rtol=1e-9, atol=1e-12)


@pytest.mark.slow
@pytest.mark.usefixtures("columns")
def test_length_of_the_code_does_not_grow_with_the_model() -> None:
    """But for tables of indices: the loops of 500 masses are those of 250."""
    loops = []
    for n in (250, 500):
        dae, constants = equations(acausal.compile(MassSpringDamperChain(n=n), cache=False))
        loops.append(source.functions(dae, constants).count("for ("))
    assert loops[0] == loops[1]


def test_small_models_are_compiled_with_every_instance() -> None:
    assert not by_patterns(acausal.compile(MassSpringDamperChain(n=100)))
