"""Materials: sources, correction factors, and tables of the user's own, with what is wrong in them named by place."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

import acausal
from acausal.errors import AcausalError, DeclarationError
from acausal.library.drilling import (
    SPEED_HSS,
    STEEL_34CRMO4,
    STEEL_C45,
    WORN,
    DrillingForce,
    load_materials,
    rake_correction,
)
from acausal.models.drilling_kinematic import ThinPlate
from tests.expected import fails_with

SOURCE = "a made-up material of this test"


def written(folder: Path, text: str, name: str = "table.csv") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("unit of the column.csv", f"name,k_c11 [N/mm2],z,source\n34CrMo4,2240,0.21,{SOURCE}\n"),
        ("unit of the cell.csv", f"# steels\nname, k_c11, z, source\n34CrMo4, 2240 N/mm2, 0.21, {SOURCE}\n"),
        ("kilonewtons.csv", f'z,source,k_c1.1 (kN/mm2),name\n0.21,"{SOURCE}",2.24,34CrMo4\n'),
        ("decimal commas.csv", f"name;k_c11 [GPa];m_c;source\n34CrMo4;2,24;0,21;{SOURCE}\n"),
        ("one table.toml", f'[34CrMo4]\nk_c11 = "2240 MPa"\nz = 0.21\nsource = "{SOURCE}"\n'),
        ("a list.toml", f'[[material]]\nname = "34CrMo4"\nk_c11 = "2240 N/mm2"\nz = 0.21\nsource = "{SOURCE}"\n'),
    ],
)
def test_the_same_material_in_all_notations(tmp_path: Path, name: str, text: str) -> None:
    found = load_materials(written(tmp_path, text, name))
    assert list(found) == ["34CrMo4"]
    steel = found["34CrMo4"]
    assert (steel.k_c11, steel.z, steel.source) == (STEEL_34CRMO4.k_c11, STEEL_34CRMO4.z, SOURCE)


def test_a_loaded_material_is_a_material_of_the_drilling_force(tmp_path: Path) -> None:
    soft = load_materials(written(tmp_path, f"name,k_c11,z,source\nsoft,700 N/mm2,0.18,{SOURCE}\n"))["soft"]
    assert DrillingForce(t=0.05, k=1e8, d_c=2e4, material=soft).material is soft


GOOD = f"C45,2220 N/mm2,0.14,{SOURCE}\n"

# code, text of the table, what the message says, line and column (from 1) that it names
BAD = [
    ("AC071", f"name,k_c11,source\nC45,2220 N/mm2,{SOURCE}\n", "'z' is missing", (2, 1)),
    ("AC071", f"name,k_c11,zz,source\n{GOOD}", "'zz' is not a column", (2, 16)),
    ("AC072", f"name,k_c11,z,source\nC45,hard,0.14,{SOURCE}\n", "is not a number", (2, 5)),
    ("AC072", f"name,k_c11,z,source\nC45,2220 N,0.14,{SOURCE}\n", "does not fit", (2, 5)),
    ("AC072", f"name,k_c11,z,source\nC45,-1 N/mm2,0.14,{SOURCE}\n", "k_c11 of 'C45' is -1e+06 Pa", (2, 5)),
    ("AC072", f"name,k_c11 [Pa],z,source\nC45,2220,0.14,{SOURCE}\n", "k_c11 of 'C45' is 2220 Pa", (2, 5)),
    ("AC072", f"name,k_c11,z,source\nC45, 2220 N/mm2, 1.4,{SOURCE}\n", "z of 'C45' is 1.4", (2, 18)),
    ("AC072", f"name,k_c11,z,source\n,2220 N/mm2,0.14,{SOURCE}\n", "the name is empty", (2, 1)),
    ("AC073", "name,k_c11,z,source\nC45,2220 N/mm2,0.14,\n", "'C45' has no source", (2, 21)),
    ("AC073", "name,k_c11,z\nC45,2220 N/mm2,0.14\n", "'C45' has no source", (2, 1)),
    ("AC074", f"name,k_c11,z,source\nC45,2220,0.14,{SOURCE}\n", "2220 has no unit", (2, 5)),
    ("AC075", f"name,k_c11,z,source\n{GOOD}\n{GOOD}", "'C45' occurs twice", (4, 1)),
    ("AC070", f"name,k_c11,z,source\nC45,2220 N/mm2,{SOURCE}\n", "the row has 3 cells", (2, 16)),
]


@pytest.mark.parametrize(("code", "text", "fact", "place"), BAD)
def test_what_is_wrong_in_a_table_is_named_with_its_place(
    tmp_path: Path, code: str, text: str, fact: str, place: tuple[int, int]
) -> None:
    path = written(tmp_path, text)
    with pytest.raises(AcausalError) as caught:
        load_materials(path)
    error = caught.value
    assert error.code == code
    assert fact in error.fact
    assert error.fact.startswith(f"{path}, line {place[0]}, column {place[1]}: ")
    assert (error.where[0].line, error.where[0].column) == (place[0], place[1] - 1)


def test_the_message_shows_the_cell(tmp_path: Path) -> None:
    path = written(tmp_path, f"name,k_c11,z,source\nC45,2220,0.14,{SOURCE}\n")
    with pytest.raises(AcausalError) as caught:
        load_materials(path)
    assert str(caught.value) == (
        f"error[AC074]: {path}, line 2, column 5: 2220 has no unit\n"
        f"  at      {path}:2\n"
        f"              C45,2220,0.14,{SOURCE}\n"
        "                  ^^^^\n"
        '  help    write "2220 N/mm2", or the unit of the whole column in the first line: k_c11 [N/mm2]'
    )


@pytest.mark.parametrize(
    ("text", "fact", "place"),
    [
        ('[C45]\nk_c11 = 2220.0\nz = 0.14\nsource = "s"\n', "2220.0 has no unit", (2, 9)),
        ('[C45]\nk_c11 = "2220 N/mm2"\nz = "0.14 m"\nsource = "s"\n', "does not fit", (3, 6)),
        ('# none\n\n[C45]\nk_c11 = "2220 N/mm2"\nz = 0.14\n', "'C45' has no source", (3, 1)),
        ('[C45]\nk_c11 = "2220 N/mm2\n', "Illegal character", (2, 20)),
    ],
)
def test_places_in_toml_files(tmp_path: Path, text: str, fact: str, place: tuple[int, int]) -> None:
    with pytest.raises(AcausalError) as caught:
        load_materials(written(tmp_path, text, "table.toml"))
    assert fact in caught.value.fact
    assert f"line {place[0]}, column {place[1]}" in caught.value.fact


@pytest.mark.parametrize("name", ["missing.csv", "table.xlsx"])
def test_files_that_are_no_table(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    if "missing" not in name:
        path.write_text("PK", encoding="utf-8")
    with fails_with(AcausalError, "AC070", match=name):
        load_materials(path)


@pytest.mark.parametrize("text", ["", "# only a comment\n", "name,k_c11,z,source\n"])
def test_empty_tables(tmp_path: Path, text: str) -> None:
    with fails_with(AcausalError, "AC070"):
        load_materials(written(tmp_path, text))


def test_second_material_of_the_library() -> None:
    # Dietrich, Praxis der Zerspanungstechnik, table 2.1.
    assert (STEEL_C45.k_c11, STEEL_C45.z) == (2220e6, 0.14)


def test_correction_factors_multiply_the_specific_cutting_force_and_are_1_by_default() -> None:
    def force(**values: float) -> float:
        names = {f"drill.{name}": value for name, value in values.items()}
        return float(acausal.simulate(ThinPlate(), parameters=names, stop_time=1.0).final("drill.F_c"))

    plain = force()
    assert force(K_rake=1.0, K_wear=1.0, K_speed=1.0) == plain
    assert force(K_rake=0.9, K_wear=WORN, K_speed=SPEED_HSS) == pytest.approx(0.9 * 1.3 * 1.2 * plain, rel=1e-9)


def test_one_percent_of_force_per_degree_of_rake() -> None:
    # Dietrich 2014: K = 1 - (gamma - gamma_0) / 100 degrees, gamma_0 = 6 degrees for steel.
    assert rake_correction(math.radians(26.0)) == pytest.approx(0.8)
    assert rake_correction(math.radians(6.0)) == 1.0
    with pytest.raises(DeclarationError, match="AC180"):
        rake_correction(20.0)
