"""`acausal list, info, check, equations`: what a model is."""

from __future__ import annotations

from pathlib import Path

import pytest

from acausal.cli.arguments.shipped import shipped_models
from tests.cli.running import run


def test_list_names_every_shipped_model_with_its_first_sentence() -> None:
    outcome = run("list")
    assert outcome.code == 0
    lines = {line.split()[0]: line for line in outcome.out.splitlines()}
    assert "Mass on a spring and a damper" in lines["Oscillator"]
    assert "acausal.models.drilling_dynamic" in lines["ThickBlock"]
    models = run("list", "--json").json["models"]
    assert {m["name"] for m in models} == set(lines)
    assert all(m["summary"] for m in models)


def test_what_is_listed_is_what_python_finds() -> None:
    """The list is read from the source text; the classes are what it says."""
    from importlib import import_module

    for model in shipped_models():
        cls = getattr(import_module(model.module), model.name)
        assert (cls.__doc__ or "").strip().startswith(model.summary)


def test_info_shows_values_bindings_limits_and_states() -> None:
    outcome = run("info", "Oscillator", "--stats")
    assert outcome.code == 0, outcome.err
    row = next(line for line in outcome.out.splitlines() if line.strip().startswith("spring.c "))
    assert row.split() == ["spring.c", "100", "=", "c", "N/m", ">=", "0", "Stiffness"]
    assert "States (2)" in outcome.out
    assert "largest block" in outcome.out


def test_info_as_json() -> None:
    content = run("info", "ThickBlock", "--json", "--stats").json
    parameters = {p["path"]: p for p in content["parameters"]}
    assert parameters["drill.k"]["unit"] == "N/m"
    assert parameters["drill.t"]["bound_to"] == "workpiece.t"
    assert {s["path"] for s in content["states"]} == {"slide.s", "slide.v", "spindle.phi", "drill.s_tar"}
    assert content["stats"]["flatten"]["equations"] == content["stats"]["flatten"]["unknowns"]


def test_info_of_a_model_that_misses_a_value_still_lists_it() -> None:
    Path("m.py").write_text(
        "from __future__ import annotations\nfrom acausal import *\n\n\nclass M(Component):\n"
        '    k: Real = parameter(unit="N/m", doc="Stiffness")\n    x: Real = variable()\n\n'
        "    def equations(self) -> Equations:\n        yield self.x == 1.0\n"
    )
    outcome = run("info", "m.py")
    assert outcome.code == 1  # it does not compile
    assert "missing" in outcome.out
    assert "AC133" in outcome.err
    failed = run("info", "m.py", "--json")
    assert (failed.code, failed.json["error"]["code"]) == (1, "AC133")
    assert run("info", "m.py", "--set", "k=3", "--json").json["parameters"][0]["value"] == 3.0


def test_check_counts_and_says_where_the_start_comes_from() -> None:
    outcome = run("check", "Oscillator")
    assert outcome.code == 0, outcome.err
    assert "19 equations, 19 unknowns, 2 states" in outcome.out
    assert "given at" in outcome.out
    assert "models/oscillator.py" in outcome.out
    start = {s["path"]: s["value"] for s in run("check", "Oscillator", "--set", "s0=30mm", "--json").json["start"]}
    assert start == {"mass.s": 0.03, "mass.v": 0.0}


def test_check_writes_nothing(folder: Path) -> None:
    run("check", "Pendulum")
    assert not list(folder.iterdir())


def test_flat_equations_carry_component_and_place() -> None:
    outcome = run("equations", "Oscillator")
    assert outcome.code == 0, outcome.err
    row = next(line for line in outcome.out.splitlines() if line.strip().startswith("mass.a == der(mass.v)"))
    assert "# mass" in row
    assert "translational/components.py:" in row


def test_reduced_equations_aliases_and_states() -> None:
    content = run("equations", "Oscillator", "--stage", "reduced", "--json").json
    assert {s["text"] for s in content["states"]} == {"mass.s", "mass.v"}
    assert any("damper.flange_b.f" in a["text"] for a in content["aliases"])
    assert len(content["remaining equations"]) < 19


@pytest.mark.parametrize(
    "model", ["Oscillator", "Pendulum", "DoublePendulum", "ThickBlock", "RCLadder", "PlanarPendulum"]
)
@pytest.mark.parametrize("stage", ["flat", "reduced", "blt"])
def test_every_stage_of_every_kind_of_model_is_printed(model: str, stage: str) -> None:
    outcome = run("equations", model, "--stage", stage)
    assert outcome.code == 0, outcome.err
    assert outcome.out.strip()


def test_blocks_define_every_unknown_once() -> None:
    """The rates of both states stand on the left of exactly one line each."""
    content = run("equations", "Oscillator", "--stage", "blt", "--json").json
    lines = [line for block in content["blocks"] for line in block["lines"]]
    left = [line.split(" = ")[0] for line in lines]
    assert len(left) == len(set(left))
    assert "mass.a = mass.flange_a.f/m" in lines


@pytest.mark.parametrize("stage", ["reduced", "blt"])
def test_constraints_that_equations_hide_are_shown(tmp_path: Path, stage: str) -> None:
    """Two charges that move together: the sum of the equations holds no rate, so one voltage follows."""
    model = tmp_path / "pair.py"
    model.write_text(
        "from acausal import Component, Equations, Real, der, fixed, variable\n\n\n"
        "class Pair(Component):\n"
        "    a: Real = variable(default=fixed(1.0))\n"
        "    b: Real = variable()\n\n"
        "    def equations(self) -> Equations:\n"
        "        yield der(self.a) - der(self.b) == -self.a\n"
        "        yield der(self.b) - der(self.a) == -self.b\n"
    )
    outcome = run("equations", f"{model}:Pair", "--stage", stage, "--json")
    assert outcome.code == 0, outcome.err
    assert len(outcome.json["states"]) == 1
    if stage == "reduced":
        [hidden] = outcome.json["constraints that equations hide"]
        assert hidden["why"].startswith("in place of")
        assert "der" not in hidden["text"]
