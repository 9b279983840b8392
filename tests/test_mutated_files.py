"""Corrupted files are read correctly or rejected with an error code; nothing in them is executed."""

from __future__ import annotations

import json
import subprocess
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest

import acausal
from acausal.errors import AcausalError
from acausal.export.casadi.casadi_file import _checksum
from acausal.models.oscillator import Oscillator
from acausal.result.matfile import _CHECKSUM
from acausal.result.result import load
from acausal.simulate.native.cache import compiler

COUNTS = pytest.mark.parametrize("count", [100, pytest.param(1000, marks=pytest.mark.slow)])


@pytest.fixture(scope="module")
def saved(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("saved")
    result = acausal.simulate(Oscillator(), stop_time=1.0, output_interval=0.1)
    for suffix in ("mat", "csv", "parquet", "npz"):
        result.save(folder / f"r.{suffix}")
    acausal.compile(Oscillator()).casadi().save(folder / "m.casadi")
    return folder


def mutated(content: bytes, rng: np.random.Generator) -> bytes:
    """Bytes changed, cut off, doubled or left out somewhere."""
    k, n = int(rng.integers(len(content))), int(rng.integers(1, 40))
    kind = rng.integers(5)
    if kind == 0:
        changed = bytearray(content)
        for place in rng.integers(len(content), size=rng.integers(1, 4)):
            changed[place] ^= int(rng.integers(1, 256))
        return bytes(changed)
    if kind == 1:
        return content[:k]
    if kind == 4:  # a block replaced by another
        j = int(rng.integers(len(content)))
        return content[:k] + content[j : j + n] + content[k + len(content[j : j + n]) :]
    return content[:k] + (content[k : k + n] * 2 if kind == 2 else b"") + content[k + n :]


def same(one: Any, other: Any) -> bool:
    """Whether two results have the same values."""
    if one.names != other.names or not np.array_equal(one.time, other.time):
        return False
    return all(np.array_equal(one[name], other[name]) for name in one.names)


def attempt(read: Callable[[Path], Any], path: Path) -> tuple[Any, str | None]:
    """The result of reading, or the code of the error."""
    try:
        return read(path), None
    except AcausalError as error:
        return None, error.code


@COUNTS
@pytest.mark.parametrize("suffix", ["mat", "csv", "parquet", "npz"])
def test_a_mutated_result(saved: Path, tmp_path: Path, suffix: str, count: int) -> None:
    """Checksums ensure that our `.mat` or `.npz` never has other values. A `.csv` may be edited on purpose.

    A `.parquet` has checksums of its pages, not of what says their names and types.
    """
    rng = np.random.default_rng(1)
    whole, content, path = load(saved / f"r.{suffix}"), (saved / f"r.{suffix}").read_bytes(), tmp_path / f"r.{suffix}"
    refused = 0
    for _ in range(count):
        path.write_bytes(mutated(content, rng))
        read, code = attempt(load, path)
        assert code in (None, "AC014")
        refused += code is not None
        assert read is None or suffix in ("csv", "parquet") or same(read, whole)
    assert refused > count / 4


@COUNTS
def test_a_mutated_result_of_others(saved: Path, tmp_path: Path, count: int) -> None:
    """Without a checksum numbers may differ; positions outside the file are rejected."""
    rng = np.random.default_rng(2)
    content, path = (
        _CHECKSUM.sub(b"Time, a clock    0123456789abcdef", (saved / "r.mat").read_bytes()),
        tmp_path / "r.mat",
    )
    for _ in range(count):
        path.write_bytes(mutated(content, rng))
        read, code = attempt(load, path)
        assert code in (None, "AC014")
        if read is not None:
            assert all(read[name].shape == read.time.shape for name in read.names)


@COUNTS
def test_a_mutated_model(saved: Path, tmp_path: Path, count: int) -> None:
    """CasADi does not check its input, so damaged data must never reach it."""
    rng = np.random.default_rng(3)
    content, path = (saved / "m.casadi").read_bytes(), tmp_path / "m.casadi"
    whole = repr(acausal.load_casadi(saved / "m.casadi").x)
    for _ in range(count):
        path.write_bytes(mutated(content, rng))
        read, code = attempt(acausal.load_casadi, path)
        assert code in (None, "AC601", "AC602", "AC014")
        assert read is None or repr(read.x) == whole
    with zipfile.ZipFile(saved / "m.casadi") as archive:
        described, functions = archive.read("metadata.json").decode(), archive.read("functions.casadi").decode()
    for _ in range(count // 4):  # inside the archive, whose checksums are made consistent again
        changed = mutated(functions.encode(), rng).decode("latin-1")
        if changed == functions:  # a block was replaced by an equal one
            continue
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("metadata.json", described)
            archive.writestr("functions.casadi", changed)
        with pytest.raises(AcausalError, match="AC601"):
            acausal.load_casadi(path)


@pytest.mark.skipif(compiler() is None, reason="no C compiler")
def test_a_model_that_names_a_library_is_refused_before_it_is_opened(saved: Path, tmp_path: Path) -> None:
    """The constructor of a shared library runs when it is opened; so do the commands of CasADi's compilers."""
    source, library, mark = tmp_path / "evil.c", tmp_path / "evil.so", tmp_path / "ran"
    x = ca.MX.sym("x")
    function = ca.Function("dae", [x], [ca.sin(x)])
    code = ca.CodeGenerator("evil")
    code.add(function)
    source.write_text(
        code.dump() + "#include <stdio.h>\n__attribute__((constructor)) static void run(void) {"
        f'FILE* f = fopen("{mark}", "w"); if (f) fclose(f); }}\n'
    )
    subprocess.run([str(compiler()), "-shared", "-fPIC", "-o", str(library), str(source), "-lm"], check=True)
    outside = ca.external("dae", str(library))
    wrapped = ca.Function("wrapped", [x], [outside(x)])
    jitted = ca.Function(
        "jitted", [x], [ca.sin(x)], {"jit": True, "compiler": "shell", "jit_options": {"flags": ["-O2"]}}
    )
    mark.unlink()
    for evil in (outside, wrapped, jitted):
        serializer = ca.StringSerializer()
        for _ in range(4):
            serializer.pack(evil)
        functions = serializer.encode()
        with zipfile.ZipFile(saved / "m.casadi") as archive:
            described = json.loads(archive.read("metadata.json"))
        described["checksum"] = _checksum(described, functions)
        path = tmp_path / "m.casadi"
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("metadata.json", json.dumps(described))
            archive.writestr("functions.casadi", functions)
        with pytest.raises(AcausalError, match="AC609"):
            acausal.load_casadi(path)
        assert not mark.exists()
