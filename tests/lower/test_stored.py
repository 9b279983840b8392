"""Compiled models on disk give the model that was written: what is planted, cut or foreign is not read."""

from __future__ import annotations

import math
import os
import pickle
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest

import acausal
from acausal import Component, Equations, Real, der, fixed, lookup, private, variable
from acausal.language.expressions.external import Call, External
from acausal.lower.cache import cache, stored
from acausal.models.drilling_dynamic import ThickBlock


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder of its own, in which every model is kept, however small."""
    monkeypatch.setenv("ACAUSAL_CACHE", str(tmp_path))
    for name in ("_LEAST_SECONDS", "_LEAST_NODES", "_LEAST_NODES_PER_EQUATION"):
        monkeypatch.setattr(stored, name, 0)
    cache.forget()
    yield tmp_path / "models"
    cache.forget()


def models(folder: Path) -> list[Path]:
    return sorted(folder.glob("*.model"))


def another_process(model: Component | None = None) -> acausal.CompiledModel:
    """What a process compiles that has compiled nothing so far."""
    cache.forget()
    return acausal.compile(model or ThickBlock())


def was_read(compiled: acausal.CompiledModel) -> bool:
    return "recall" in compiled.timings and "solve" not in compiled.timings


def test_another_process_reads_what_the_first_has_compiled(folder: Path) -> None:
    first = acausal.compile(ThickBlock())
    assert not was_read(first)
    (path,) = models(folder)
    assert path.stat().st_mode & 0o777 == 0o600 or os.name == "nt"
    second = another_process()
    assert was_read(second)
    ours, theirs = (acausal.simulate(c, stop_time=3.0, native=False) for c in (second, first))
    assert ours.names == theirs.names
    np.testing.assert_array_equal(ours.matrix, theirs.matrix)
    assert [e.condition for e in ours.events] == [e.condition for e in theirs.events]


def test_other_values_are_those_of_the_model_that_reads() -> None:
    acausal.compile(ThickBlock())
    read = another_process(ThickBlock(m=7.0))
    assert was_read(read)
    anew = acausal.compile(ThickBlock(m=7.0), cache=False)
    # it is still in the air
    ours, theirs, lighter = (
        acausal.simulate(c, stop_time=1.02, native=False).final("drill.s")
        for c in (read, anew, acausal.compile(ThickBlock()))
    )
    assert ours == pytest.approx(theirs, rel=1e-12)
    assert ours != pytest.approx(lighter, rel=1e-3)


def test_the_key_covers_every_package_of_the_compiler() -> None:
    """Otherwise a model stored by another version of the compiler would be read."""
    hashed = {path.relative_to(Path(acausal.__file__).parent).parts[0] for path in stored._compiler_sources()}
    assert hashed == set(stored._SOURCES)


def test_other_sources_or_versions_have_other_keys(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    acausal.compile(ThickBlock())
    monkeypatch.setattr(stored, "_compiler_version", lambda: "a compiler of tomorrow")
    assert not was_read(another_process())
    assert len(models(folder)) == 2


def _cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-100])


def _copied(path: Path) -> None:
    """Whole, but signed elsewhere: a cache that came as a copy."""
    (path.parent / "secret").unlink()


class _Harmful:
    """What a file would do if it could name what it likes."""

    def __init__(self, mark: Path) -> None:
        self.mark = mark

    def __reduce__(self) -> tuple[Any, ...]:
        return Path.touch, (self.mark,)


def _harmful(path: Path) -> None:
    """Signed with the secret of the folder, and yet no model."""
    content = pickle.dumps(_Harmful(path.parent / "mark"))
    path.unlink()
    name = f"{path.stem.rpartition('-')[0]}-{private.digest(content, path.parent)}.model"
    path.with_name(name).write_bytes(content)
    path.with_name(name).chmod(0o600)


@pytest.mark.parametrize("change", [_cut, _copied, _harmful])
def test_what_is_no_model_of_this_folder_is_not_read(folder: Path, change: Callable[[Path], None]) -> None:
    acausal.compile(ThickBlock())
    (path,) = models(folder)
    change(path)
    assert not was_read(another_process())
    assert not (folder / "mark").exists()
    assert was_read(another_process())  # made again


def test_what_only_this_process_knows_has_no_key() -> None:
    value = 3.0
    assert stored._key((1, "a", 2.5, (None, True))) is not None
    assert stored._key((1, lambda: value)) is None
    assert stored._key((object(),)) is None


class _Asked(ca.Callback):
    """A function of Python, of which nobody else knows what it computes."""

    def __init__(self) -> None:
        super().__init__()
        self.construct("asked", {})

    def eval(self, arg: Any) -> Any:
        return [arg[0]]


def test_external_functions_are_known_by_what_they_compute() -> None:
    """A word like others, but what it calls may be another function tomorrow."""

    def key(make: Callable[[], Any]) -> str | None:
        return stored._key((Call(External("f", make, inputs=[()], outputs=[()]), 0),))

    def power(k: int) -> Any:
        x = ca.SX.sym("x")
        return ca.Function("f", [x], [x**k])

    asked = _Asked()
    assert key(lambda: power(2)) == key(lambda: power(2)) != key(lambda: power(3))
    assert key(lambda: asked) is None
    assert key(lambda: None) is None


def _square() -> Any:
    x = ca.SX.sym("x")
    return ca.Function("square", [x], [x**2])


SQUARE = External("square", _square, inputs=[()], outputs=[()])
TABLE = lookup([-1.0, 0.0, 2.0], [(-1.0, 1.0), (0.0, 1.0)])


class Falling(Component):
    """x' = -(x^2 + x) from 1, with the square by a function, of which a derivative is taken, and x by a table."""

    x: Real = variable(default=fixed(1.0))
    y: Real = variable()
    rate: Real = variable()

    def equations(self) -> Equations:
        yield self.y == SQUARE(self.x)
        yield self.rate == der(self.y)
        yield der(self.x) == -self.y - TABLE(self.x)


@pytest.mark.parametrize("solver", ["idas", "rosenbrock"])
def test_models_with_external_functions_are_read(solver: str) -> None:
    """x / (1 + x) = exp(-t) / 2, and y' = 2 x x'."""
    first = acausal.compile(Falling())
    read = another_process(Falling())
    assert was_read(read)
    found, again = (acausal.simulate(m, stop_time=1.0, tolerance=1e-9, solver=solver) for m in (first, read))
    assert np.array_equal(found.matrix, again.matrix)
    share = math.exp(-1.0) / 2.0
    x = share / (1.0 - share)
    assert again.final("x") == pytest.approx(x, abs=1e-7)
    assert again.final("rate") == pytest.approx(-2.0 * x * (x**2 + x), abs=1e-6)
