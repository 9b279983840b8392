"""`acausal list library`, `list --search`, `info` of components, completion, `new`: how things are found."""

from __future__ import annotations

import importlib
from pathlib import Path

import pytest
from typer.testing import CliRunner

from acausal.cli.arguments.catalogue import families, find_part, library_parts, used_in
from acausal.cli.main import app
from acausal.language.component import Component, Connector
from acausal.result.result import load
from tests.cli.running import run


def test_the_catalogue_is_what_python_finds() -> None:
    """It is read from the source text; the classes are what it says, and none is missing."""
    listed = {(p.family, p.name): p for p in library_parts()}
    assert {"blocks", "contact", "drilling", "electrical", "multibody", "rotational", "thermal"} <= set(families())
    for part in library_parts():
        cls = getattr(importlib.import_module(f"acausal.library.{part.family}"), part.name)
        assert issubclass(cls, Connector if part.kind == "connector" else Component)
        assert (cls.__module__, cls.__name__) == (part.module, part.name)
    for family in families():
        module = importlib.import_module(f"acausal.library.{family}")
        classes = {n: v for n, v in vars(module).items() if isinstance(v, type) and issubclass(v, Component)}
        own = {name for name, cls in classes.items() if name == cls.__name__}  # not a second name of one
        assert own == {name for where, name in listed if where == family}


def test_list_of_a_library_has_its_components_only() -> None:
    outcome = run("list", "library", "electrical")
    assert outcome.code == 0
    assert "Linear resistor" in next(line for line in outcome.out.splitlines() if line.split()[:1] == ["Resistor"])
    assert "rotational" not in outcome.out
    assert {p["family"] for p in run("list", "library", "thermal", "--json").json["library"]} == {"thermal"}


def test_search_finds_models_and_components_by_name_and_text() -> None:
    found = run("list", "--search", "clutch", "--json").json
    assert "ClutchChain" in {m["name"] for m in found["models"]}
    assert {("rotational", "Clutch"), ("rotational", "OneWayClutch")} <= {
        (p["family"], p["name"]) for p in found["library"]
    }
    assert run("list", "--search", "xyzzy").code == 2


@pytest.mark.parametrize(
    ("arguments", "code", "hint"),
    [
        (("list", "library", "electricall"), "AC081", "electrical"),
        (("list", "electrical"), "AC081", "acausal list library electrical"),
        (("list", "models", "electrical"), "AC081", "acausal list library electrical"),
        (("info", "Spring"), "AC004", "translational.Spring"),
        (("simulate", "Resistr"), "AC001", "electrical.Resistor"),
        (("info", "Modelica.Electrical.Analog.Basic.Resistr"), "AC001", "electrical.Resistor"),
    ],
)
def test_what_is_not_found_names_the_nearest(arguments: tuple[str, ...], code: str, hint: str) -> None:
    outcome = run(*arguments)
    assert outcome.code == 2
    assert f"error[{code}]" in outcome.err
    assert hint in outcome.err


def test_info_of_a_component_has_connectors_parameters_equations_and_uses() -> None:
    content = run("info", "Resistor", "--json").json
    assert content["import"] == "from acausal.library.electrical import Resistor"
    assert [(c["path"], c["type"], c["carries"]) for c in content["connectors"]] == [
        ("p", "Pin", "v [V], flow i [A]"),
        ("n", "Pin", "v [V], flow i [A]"),
    ]
    (parameter,) = content["parameters"]
    assert (parameter["path"], parameter["unit"], parameter["default"]) == ("R", "Ohm", None)
    # Ohm's law, after what all elements with two pins have in common.
    texts = [e["text"] for e in content["equations"]]
    assert "v == R * i" in texts
    assert texts.index("v == p.v - n.v") < texts.index("v == R * i")
    assert "RCCircuit" in content["used_in"]["models"]
    assert "required" in run("info", "Resistor").out


@pytest.mark.parametrize(
    ("modelica", "reference"),
    [
        ("Modelica.Electrical.Analog.Basic.Resistor", "electrical.Resistor"),
        ("Modelica.Mechanics.Translational.Components.Spring", "translational.Spring"),
        ("Modelica.Mechanics.Rotational.Components.Spring", "rotational.Spring"),
        ("Modelica.Mechanics.MultiBody.Joints.Revolute", "multibody.Revolute"),
        ("Modelica.Thermal.HeatTransfer.Components.HeatCapacitor", "thermal.HeatCapacitor"),
        ("Modelica.Blocks.Continuous.FirstOrder", "blocks.FirstOrder"),
    ],
)
def test_modelica_names_lead_to_our_components(modelica: str, reference: str) -> None:
    part = find_part(modelica)
    assert part is not None
    assert part.reference == reference


def test_a_joint_is_seen_from_its_first_frame() -> None:
    """Equations ask which of two frames is nearer to the world: alone, it is frame_a; the Euler angle is about n."""
    texts = [e["text"] for e in run("info", "multibody.Revolute", "--json").json["equations"]]
    assert "w == der(phi)" in texts
    assert sum(t.startswith("frame_b.R == ") for t in texts) == 1
    assert not any(t.startswith("frame_a.R == ") for t in texts)


def test_every_component_has_a_page() -> None:
    """Also those whose arguments have no default, and those whose equations ask for their place among the frames."""
    from acausal.cli.models.component import _connectors, _declared, _equations

    for part in library_parts():
        if part.kind == "component" and part.family in ("multibody", "drilling", "rotational"):
            cls = getattr(importlib.import_module(part.module), part.name)
            try:
                example = cls()
            except Exception:
                example = None
            assert _connectors(cls) or any(_declared(cls).values()) or cls._prototypes
            _equations(cls, example)


def test_where_a_component_is_used_follows_imports() -> None:
    """`Spring` is three classes; each model uses one."""
    mechanical = find_part("translational.Spring")
    torsion = find_part("rotational.Spring")
    assert mechanical is not None
    assert torsion is not None
    assert "Oscillator" in used_in(mechanical)[0]
    assert "Oscillator" not in used_in(torsion)[0]


def _completed(words: str, count: int) -> list[str]:
    environment = {"_ACAUSAL_COMPLETE": "complete_bash", "COMP_WORDS": f"acausal {words}", "COMP_CWORD": str(count)}
    return CliRunner().invoke(app, [], prog_name="acausal", env=environment).stdout.split()


def test_the_shell_completes_models_parameters_signals_and_solvers() -> None:
    assert _completed("simulate Thick", 2) == ["ThickBlock"]
    assert "electrical.Resistor" in _completed("info electrical.R", 2)
    assert set(_completed("simulate Oscillator --set spring.", 4)) == {"spring.c=", "spring.s_rel0="}
    assert _completed("simulate Oscillator --solver ros", 4) == ["rosenbrock"]
    run("simulate", "Oscillator", "-o", "r.mat", "-q")
    assert {"mass.s", "mass.v"} <= set(_completed("plot r.mat mass.", 3))
    assert _completed("plot r.", 2) == ["r.mat"]
    assert _completed("simulate NoSuchModel --set a", 4) == []


def test_new_writes_a_model_that_runs() -> None:
    assert run("new", "my_model.py").code == 0
    outcome = run("simulate", "my_model.py", "-o", "r.mat")
    assert outcome.code == 0, outcome.err
    result = load("r.mat")
    # energy = work of the force less that of the damper, both from the recorded forces and speeds
    import numpy as np

    power = (result["force.u"] - result["damper.f"]) * result["mass.v"]
    work = np.concatenate([[0.0], np.cumsum(0.5 * (power[1:] + power[:-1]) * np.diff(result.time))])
    assert np.max(np.abs(result["energy"] - work)) < 0.02 * np.max(result["energy"])
    again = run("new", "my_model.py")
    assert again.code == 2
    assert "AC080" in again.err
    assert run("new", "2nd.txt").code == 2


def test_a_name_that_is_not_imported_says_where_it_is() -> None:
    text = (
        "from __future__ import annotations\nfrom acausal import *\n\n\nclass M(Component):\n    r: {0} = {0}(R=1.0)\n"
    )
    Path("m.py").write_text(text.format("Resistor"))
    assert "from acausal.library.electrical import Resistor" in run("check", "m.py").err
    Path("n.py").write_text("from acausal.library.blocks import Resistor\n")
    assert "from acausal.library.electrical import Resistor" in run("check", "n.py").err


def test_completion_without_a_model_offers_nothing() -> None:
    assert _completed("simulate --set a", 3) == []


@pytest.mark.parametrize("option", [("--set", "R=3"), ("--stats",), ("--spy", "x.png")])
def test_what_a_component_alone_cannot_show_is_refused(option: tuple[str, ...]) -> None:
    outcome = run("info", "Resistor", *option)
    assert (outcome.code, f"{option[0]} needs a model" in outcome.err) == (2, True)
