"""Model references and `--set`, without running anything."""

from __future__ import annotations

from pathlib import Path

import pytest

from acausal import Component, Real, parameter, structural
from acausal.cli.arguments.reference import find_model
from acausal.cli.arguments.settings import prepare
from acausal.cli.study.sweep import variations_of
from acausal.errors import AcausalError, UsageError
from acausal.library.blocks import Extrapolation
from acausal.models.drilling_dynamic import ThickBlock
from acausal.models.oscillator import Oscillator
from acausal.models.rc_ladder import RCLadder

HEAD = "from __future__ import annotations\nfrom acausal import *\n\n\n"
COMPONENT = 'class {0}(Component):\n    """One."""\n    x: Real = variable()\n\n\n'


def _code(error: pytest.ExceptionInfo[AcausalError]) -> str:
    return error.value.code


def test_three_ways_to_the_same_class() -> None:
    assert find_model("Oscillator") is Oscillator
    assert find_model("acausal.models.oscillator:Oscillator") is Oscillator


def test_a_file_in_another_folder_with_its_neighbours(tmp_path: Path) -> None:
    folder = tmp_path / "my models"
    folder.mkdir()
    (folder / "neighbour.py").write_text(HEAD + "GRAVITY = 9.81\n")
    (folder / "a-b.py").write_text("from neighbour import GRAVITY\n" + HEAD.split("\n", 1)[1] + COMPONENT.format("M"))
    assert find_model(f"{folder}/a-b.py:M").__name__ == "M"
    assert find_model(f"{folder}/a-b.py").__name__ == "M"


def test_a_module_of_the_current_folder() -> None:
    Path("mine.py").write_text(HEAD + COMPONENT.format("M"))
    assert find_model("mine:M").__name__ == "M"


def test_of_several_components_the_one_with_an_experiment() -> None:
    text = HEAD + COMPONENT.format("Part") + COMPONENT.format("Whole").rstrip() + "\n    experiment = Experiment()\n"
    Path("m.py").write_text(text)
    assert find_model("m.py").__name__ == "Whole"
    Path("n.py").write_text(HEAD + COMPONENT.format("A") + COMPONENT.format("B"))
    with pytest.raises(UsageError) as error:
        find_model("n.py")
    assert _code(error) == "AC004"
    assert "n.py:A" in str(error.value)


@pytest.mark.parametrize(
    ("reference", "hint"),
    [
        ("oscilator", "Oscillator"),
        ("thickblock", "ThickBlock"),
        ("Pend", "Pendulum"),
        ("acausal.models.oscillator:Osc", "Oscillator"),
        ("acausal.models.oscilator:Oscillator", "acausal.models.oscillator"),
        ("osc.py", ""),
        ("", "acausal list"),
    ],
)
def test_unknown_models_get_the_nearest(reference: str, hint: str) -> None:
    with pytest.raises(UsageError) as error:
        find_model(reference)
    assert _code(error) == "AC001"
    assert hint in str(error.value)


def test_what_is_no_model() -> None:
    with pytest.raises(UsageError) as error:
        find_model("acausal.errors:Span")
    assert _code(error) == "AC005"


def test_values_by_path_in_si() -> None:
    prepared = prepare(ThickBlock, ["drill.d=20mm", "body.r_CM=[1mm, 2mm, 3m]", "drill.force.k_c11=2100 N/mm2"])
    assert prepared.parameters["drill.d"] == 0.02
    assert prepared.parameters["body.r_CM"] == (0.001, 0.002, 3.0)
    assert prepared.parameters["drill.force.k_c11"] == pytest.approx(2.1e9)


def test_entries_of_an_array_keep_the_others() -> None:
    prepared = prepare(ThickBlock, ["body.r_CM[1]=5cm", "body.r_CM[2]=1"])
    assert prepared.parameters == {"body.r_CM": (0.0, 0.05, 1.0)}


def test_an_entry_replaces_that_of_the_whole() -> None:
    for texts in (["p=1,2", "p[0]=3"], ["p[0]=3", "p=1,2"]):
        assert prepare(Arrays, texts).parameters == {"p": (3.0, 2.0)}


def test_numbers_without_a_unit_beside_others_are_refused() -> None:
    """1,2,3mm was 1 m, 2 m and 3 mm; zeros are the same in both units, except of temperatures."""
    for text in ("body.r_CM=[1,2,3mm]", "body.r_CM=[1mm,2mm,3]"):
        with pytest.raises(UsageError, match="no unit") as error:
            prepare(ThickBlock, [text])
        assert _code(error) == "AC151"
    assert prepare(ThickBlock, ["body.r_CM=[0,2 m,3mm]"]).parameters["body.r_CM"] == (0.0, 2.0, 0.003)
    for text in ("m=1:2g:5", "m=1,2,3g", "m=log:1:2g:5", "m=normal:1:2g"):
        with pytest.raises(UsageError, match="no unit"):
            variations_of(Oscillator(), [text])
    assert variations_of(Oscillator(), ["m=0:2g:5"])["m"].high == 0.002


def test_members_of_enumerations_are_given_by_name() -> None:
    for text in ("HOLD_LAST_POINT", "Extrapolation.HOLD_LAST_POINT"):
        assert prepare(Tabulated, [f"beyond={text}"]).structural["beyond"] is Extrapolation.HOLD_LAST_POINT
    for text in ("1", '"HOLD_LAST_POINT"', "HOLD"):
        with pytest.raises(UsageError, match="beyond") as error:
            prepare(Tabulated, [f"beyond={text}"])
        assert _code(error) == "AC003"
        assert "HOLD_LAST_POINT, LAST_TWO_POINTS" in str(error.value)


def test_structural_values_become_constructor_arguments() -> None:
    model = prepare(RCLadder, ["n=7"]).model
    assert isinstance(model, RCLadder)
    assert len(model.resistors) == 7
    assert prepare(ThickBlock, ["as_printed=True"]).structural == {"as_printed": True}
    assert prepare(ThickBlock, ["force_profile=[(0, 0), (1, 2)]"]).structural["force_profile"] == ((0, 0), (1, 2))


class Arrays(Component):
    """A matrix whose shape is not that of its transpose, and a vector of pressures."""

    M: Real = parameter(default=((1.0, 2.0, 3.0), (4.0, 5.0, 6.0)), shape=(2, 3))
    p: Real = parameter(default=(1.0, 2.0), shape=2, unit="Pa")


class Tabulated(Component):
    """An enumeration."""

    beyond: Extrapolation = structural(default=Extrapolation.LAST_TWO_POINTS)


@pytest.mark.parametrize("text", ["[[1, 2, 3], [4, 5, 6]]", "((1,2,3),(4,5,6))", "[1,2,3],[4,5,6]", "1,2,3,4,5,6"])
def test_rows_of_a_matrix(text: str) -> None:
    values = prepare(Arrays, [f"M={text}"]).parameters["M"]
    assert values == ((1.0, 2.0, 3.0), (4.0, 5.0, 6.0))


def test_a_transposed_matrix_is_not_read_row_by_row() -> None:
    """Three rows of two have as many entries as two rows of three; their values were taken in another order."""
    with pytest.raises(UsageError, match=r"2 x 3 entries, not rows of 2, 2, 2") as error:
        prepare(Arrays, ["M=[[1, 2], [3, 4], [5, 6]]"])
    assert "M[0,0]" in str(error.value)


def test_brackets_of_units_are_not_those_of_lists() -> None:
    """1 kg/(m.s2) is one pascal."""
    assert prepare(Arrays, ["p=[5 kg/(m.s2), 1 bar]"]).parameters["p"] == (5.0, 1e5)


@pytest.mark.parametrize(
    ("cls", "assignment", "code", "hint"),
    [
        (Oscillator, "m", "AC003", "path=value"),
        (Oscillator, "m=", "AC003", "path=value"),
        (Oscillator, "spring.d=3", "AC020", "damper.d"),
        (Oscillator, "spring=3", "AC021", "part"),
        (Oscillator, "mass.s=3", "AC021", "--start mass.s"),
        (Oscillator, "m=-1", "AC136", "limits"),
        (Oscillator, "m=nan", "AC152", "number"),
        (Oscillator, "m=3m", "AC151", "kg"),
        (Oscillator, "m=3quux", "AC150", "quux"),
        (RCLadder, "n=2.5", "AC003", "10"),
        (RCLadder, "n=True", "AC003", "10"),
        (RCLadder, "n=import os", "AC003", "literal"),
        (ThickBlock, "body.r_CM=3", "AC006", "3 entries"),
        (ThickBlock, "body.r_CM[3]=3", "AC006", "(3,)"),
        (ThickBlock, "body.g_0[1]=3", "AC006", "bound"),
    ],
)
def test_wrong_settings_are_usage_errors(cls: type, assignment: str, code: str, hint: str) -> None:
    with pytest.raises(UsageError) as error:
        prepare(cls, [assignment])
    assert _code(error) == code
    assert hint in str(error.value)
    assert not error.value.where
