"""Compiled models on disk give the model that was written: what is planted, cut or foreign is not read."""

from __future__ import annotations

import os
import pickle
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import acausal
from acausal import Component, private
from acausal.language.expressions.external import Call, External
from acausal.lower.cache import cache, stored
from acausal.models.drilling_dynamic import ThickBlock


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder of its own, in which every model is kept, however small."""
    monkeypatch.setenv("ACAUSAL_CACHE", str(tmp_path))
    for name in ("_WORTH", "_LEAST_NODES", "_LONG"):
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
    monkeypatch.setattr(stored, "_made_by", lambda: "a compiler of tomorrow")
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
    # a word like others, but what it calls may be another function tomorrow
    assert stored._key((Call(External("f", lambda: None, inputs=[()], outputs=[()]), 0),)) is None
