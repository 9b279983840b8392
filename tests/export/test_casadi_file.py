"""Saved CasADi models: read back in a process that knows nothing of the model, refused when they are something else."""

from __future__ import annotations

import json
import math
import subprocess
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

import acausal
from acausal.errors import AcausalError, UsageError
from acausal.export.casadi.casadi_file import VERSION
from acausal.lower.casadi_model import CasadiModel
from acausal.models.drilling_dynamic import ThickBlock
from tests.export.scenes import DrivenSlider, Slider, numbers

READER = """
import json, sys
import acausal
model = acausal.load_casadi(sys.argv[1])
p = model.p.start
x, z = model.init(p)
x[0] = 2e-3
rate, alg, y = model.dae(3.0, x, z, [], p)
xdot, seen = model.ode(3.0, x, [], p)
print(json.dumps({
    "loaded": sorted(m for m in sys.modules if m.startswith(("acausal.models", "acausal.library", "tests"))),
    "vectors": {v: [list(vars(q).values()) for q in getattr(model, v)] for v in "xzupy"},
    "values": [m.full().ravel().tolist() for m in (x, z, rate, alg, y, xdot, seen, model.instants(p))],
}))
"""


def test_round_trip_into_a_process_without_the_model(tmp_path: Path) -> None:
    """Values and descriptions come back bit for bit, rootfinders included, where no model was ever imported."""
    file = tmp_path / "block.casadi"
    model = acausal.compile(ThickBlock()).casadi(["drill.F_f", "drill.s"])
    model.save(file)
    command = [sys.executable, "-c", READER, str(file)]
    run = subprocess.run(command, capture_output=True, text=True, check=False, cwd=Path(__file__).parents[2])
    assert run.returncode == 0, run.stderr
    answer = json.loads(run.stdout)
    assert answer["loaded"] == []
    for v in "xzupy":
        assert answer["vectors"][v] == [list(vars(q).values()) for q in getattr(model, v)]
    p = model.p.start
    x, z = model.init(p)
    x[0] = 2e-3
    expected = [x, z, *model.dae(3.0, x, z, [], p), *model.ode(3.0, x, [], p), model.instants(p)]
    for there, here in zip(answer["values"], expected, strict=True):
        np.testing.assert_array_equal(there, numbers(here))


def test_infinite_limits_and_derivatives_survive(tmp_path: Path) -> None:
    acausal.compile(DrivenSlider()).casadi().save(tmp_path / "m.casadi")
    model = CasadiModel.load(tmp_path / "m.casadi")
    assert (model.x[0].min, model.x[0].max) == (-math.inf, math.inf)
    assert "Infinity" not in zipfile.ZipFile(tmp_path / "m.casadi").read("metadata.json").decode()
    u = ca.MX.sym("u")
    current = model.ode([0.0, 0.0], u, model.p.start)[1]
    # u = i + i**3: di/du = 1/4 at u = 2.
    assert float(ca.Function("f", [u], [ca.jacobian(current, u)])(2.0)) == pytest.approx(0.25, rel=1e-9)
    assert repr(model) == "CasadiModel(DrivenSlider: 2 x, 1 z, 1 u, 5 p, 1 y)"


def test_the_same_model_gives_the_same_bytes(tmp_path: Path) -> None:
    """Files can be compared and kept under version control."""
    for name in ("a.casadi", "b.casadi"):
        acausal.compile(Slider()).casadi().save(tmp_path / name)
    assert (tmp_path / "a.casadi").read_bytes() == (tmp_path / "b.casadi").read_bytes()


def test_another_suffix_is_refused_and_the_file_there_is_kept(tmp_path: Path) -> None:
    """An archive written over `model.py` would destroy the source of the model."""
    source = tmp_path / "slider.py"
    source.write_text("# a model\n")
    with pytest.raises(UsageError, match="AC013"):
        acausal.compile(Slider()).casadi().save(source)
    assert source.read_text() == "# a model\n"


def test_unwritable_place_leaves_nothing(tmp_path: Path) -> None:
    model = acausal.compile(Slider()).casadi()
    with pytest.raises(AcausalError) as caught:
        model.save(tmp_path / "missing" / "m.casadi")
    assert caught.value.code == "AC012"
    assert list(tmp_path.iterdir()) == []


def _text(path: Path) -> None:
    path.write_text("time,drill.s\n0,0\n")


def _foreign_archive(path: Path) -> None:
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("metadata.json", "{}")


def _foreign_json(path: Path) -> None:
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("metadata.json", "[]")
        archive.writestr("functions.casadi", "")


def _cut_functions(path: Path) -> None:
    _rewritten(path, functions=lambda text: text[: len(text) // 2])


def _newer_format(path: Path) -> None:
    _rewritten(path, metadata=lambda text: text.replace(f'"version": {VERSION}', f'"version": {VERSION + 1}'))


def _newer_casadi(path: Path) -> None:
    _rewritten(
        path,
        metadata=lambda text: text.replace(f'"casadi": "{ca.CasadiMeta.version()}"', '"casadi": "99.0"'),
        functions=lambda _: "unheard of",
    )


def _rewritten(path: Path, metadata: Callable[[str], str] = str, functions: Callable[[str], str] = str) -> None:
    acausal.compile(Slider()).casadi().save(path)
    with zipfile.ZipFile(path) as archive:
        old = {name: archive.read(name).decode() for name in archive.namelist()}
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("metadata.json", metadata(old["metadata.json"]))
        archive.writestr("functions.casadi", functions(old["functions.casadi"]))


@pytest.mark.parametrize(
    ("spoil", "code"),
    [
        (lambda path: None, "AC014"),
        (lambda path: path.mkdir(), "AC014"),
        (_text, "AC601"),
        (_foreign_archive, "AC601"),
        (_foreign_json, "AC601"),
        (_cut_functions, "AC601"),
        (_newer_format, "AC602"),
        (_newer_casadi, "AC602"),
    ],
    ids=["missing", "folder", "text", "archive", "json", "cut", "newer format", "newer casadi"],
)
def test_what_is_no_saved_model_is_refused(tmp_path: Path, spoil: Callable[[Path], None], code: str) -> None:
    path = tmp_path / "m.casadi"
    spoil(path)
    with pytest.raises(AcausalError) as caught:
        acausal.load_casadi(path)
    assert caught.value.code == code
    assert "m.casadi" in str(caught.value)
