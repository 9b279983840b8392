"""Result files are read back unchanged, by acausal and by readers of Modelica tools."""

from __future__ import annotations

import csv
import stat
from pathlib import Path

import numpy as np
import pytest

from acausal.errors import Span, UsageError
from acausal.result.files import atomic
from acausal.result.result import Event, Result, Signal, load
from acausal.result.series import read_series
from tests.expected import fails_with

TIME = np.array([0.0, 0.1, 0.2, 0.2, 1.0 / 3.0])
# Numbers that a short decimal form would change.
VALUES = np.array([[0.1 + 0.2, 1e-300], [np.pi, -1e22], [-0.0, 5e-324], [1.0, 1.7976931348623157e308], [2 / 3, -7.0]])
SIGNALS = (
    Signal("a.x", "m", "Way of a", 0),
    Signal("a.y", "degC", "Temperature, \u03b8 of a [measured]", 1),
    Signal("b.x", "m", "", 0, sign=-1),
    Signal("R[0,1]", "", 'Element "0, 1"', 1),
    Signal("a.k", "N/m", "Stiffness", value=4.2e7, parameter=True),
)


@pytest.fixture
def result() -> Result:
    return Result(
        "Two",
        TIME,
        VALUES,
        {s.name: s for s in SIGNALS},
        (Event(0.2, "a.x > 1", Span("model.py", 7, 4, 9), "a", ("a.y",)),),
        {"solver": "idas", "steps": np.int64(12), "time": {"solve": 0.25}, "order": np.array([1, 2])},
    )


@pytest.mark.parametrize("suffix", [".csv", ".mat", ".npz", ".parquet", ".CSV"])
def test_values_survive_to_the_last_bit(result: Result, tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"run{suffix}"
    result.save(path)
    back = load(path)
    assert back.names == result.names
    assert np.array_equal(back.time, TIME)
    for name in result.names:
        assert np.array_equal(back[name], result[name]), name
    assert [e.time for e in back.events] == [0.2]
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("suffix", [".csv", ".mat", ".npz", ".parquet"])
def test_a_signal_without_dimension_survives(tmp_path: Path, suffix: str) -> None:
    """Its unit is the number 1, or none while its meaning ends with a bracket."""
    path = tmp_path / f"run{suffix}"
    signals = {"n": Signal("n", "1", "Count", 0), "s": Signal("s", "", "Share in [0, 1]", 0)}
    Result("Plain", np.array([0.0, 1.0]), np.array([[0.0], [0.5]]), signals).save(path, units=True)
    back = load(path)
    assert back["n"].tolist() == back["s"].tolist() == [0.0, 0.5]
    assert back.unit("n") == "1"
    assert back.unit("s") in ("", "1")


@pytest.mark.parametrize("suffix", [".mat", ".npz"])
def test_units_and_docs_survive(result: Result, tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"run{suffix}"
    result.save(path)
    assert [(s.unit, s.doc, s.column, s.sign) for s in load(path).signals.values()] == [
        (s.unit, s.doc, s.column, s.sign) for s in SIGNALS
    ]


def test_npz_keeps_everything(result: Result, tmp_path: Path) -> None:
    result.save(tmp_path / "run.npz")
    back = load(tmp_path / "run.npz")
    assert back.model == "Two"
    assert back.events == result.events
    assert dict(back.signals) == dict(result.signals)
    assert back.stats == {"solver": "idas", "steps": 12, "time": {"solve": 0.25}, "order": [1, 2]}


def test_csv_has_the_exact_names_time_first(result: Result, tmp_path: Path) -> None:
    result.save(tmp_path / "run.csv")
    with (tmp_path / "run.csv").open(newline="") as file:
        rows = list(csv.reader(file))
    assert rows[0] == ["time", "a.x", "a.y", "b.x", "R[0,1]", "a.k"]
    assert rows[1] == ["0.0", "0.30000000000000004", "1e-300", "-0.30000000000000004", "1e-300", "42000000.0"]
    assert len(rows) == 1 + len(TIME)


def test_mat_has_the_documented_layout(result: Result, tmp_path: Path) -> None:
    # Layout: Dymola User Manual 2, trajectory files 1.1; OpenModelica's reader insists on order, types and 4 x 11.
    from scipy.io import loadmat, whosmat

    path = tmp_path / "run.mat"
    result.save(path)
    assert [name for name, *_ in whosmat(path)] == ["Aclass", "name", "description", "dataInfo", "data_1", "data_2"]
    assert np.frombuffer(path.read_bytes()[:20], "<i4").tolist() == [51, 4, 11, 0, 7]
    content = loadmat(path, chars_as_strings=False)
    assert ["".join(row) for row in content["Aclass"]] == ["Atrajectory", "1.1", "", "binTrans"]
    assert ["".join(row) for row in content["name"].T] == ["time", *result.names]
    assert "".join(content["description"].T[1]) == "Way of a [m]"
    assert content["dataInfo"].tolist() == [[0, 2, 2, 2, 2, 1], [1, 2, 3, -2, 3, 2], [0] * 6, [-1] * 6]
    assert content["data_1"].tolist() == [[0.0, 1.0 / 3.0], [4.2e7, 4.2e7]]
    assert np.array_equal(content["data_2"], np.vstack([TIME, VALUES.T]))


def test_dymat_reads_our_mat(result: Result, tmp_path: Path) -> None:
    reader = pytest.importorskip("DyMat")
    result.save(tmp_path / "run.mat")
    file = reader.DyMatFile(str(tmp_path / "run.mat"))
    assert set(file.names()) == set(result.names)
    for name in ("a.x", "b.x", "R[0,1]"):
        assert np.array_equal(file.data(name), result[name])
    assert file.data("a.k").tolist() == [4.2e7, 4.2e7]
    assert np.array_equal(file.abscissa("a.x", valuesOnly=True), TIME)
    assert file.description("a.k") == "Stiffness [N/m]"
    assert file.sharedData("a.x") == [("b.x", -1)]


def test_we_read_dymolas_normal_layout(tmp_path: Path) -> None:
    # binNormal is binTrans transposed, as written by Dymola's "save as"; time is called Time there.
    from scipy.io import savemat

    content = {
        "Aclass": np.array(["Atrajectory", "1.1", "", "binNormal"]),
        "name": np.array(["Time", "x", "p"]),
        "description": np.array(["Time in [s]", "Position [m|mm]", "Parameter"]),
        "dataInfo": np.array([[0, 1, 0, -1], [2, -2, 0, -1], [1, 2, 0, -1]], dtype=np.int32),
        "data_1": np.array([[0.0, 5.0], [1.0, 5.0]]),
        "data_2": np.array([[0.0, 3.0], [1.0, 4.0]], dtype=np.float32),
    }
    savemat(tmp_path / "normal.mat", content, format="4")
    r = load(tmp_path / "normal.mat")
    assert r.names == ("x", "p")
    assert r["x"].tolist() == [-3.0, -4.0]
    assert r.unit("x") == "m"
    assert r["p"].tolist() == [5.0, 5.0]


@pytest.mark.parametrize("name", ["x.json", "x", ".csv"])
def test_other_suffixes_are_refused(result: Result, tmp_path: Path, name: str) -> None:
    for action in (result.save, load):
        with fails_with(UsageError, "AC013") as caught:
            action(tmp_path / name)
        assert caught.value.help == "accepted are .mat, .csv, .npz, .parquet"


def test_a_missing_folder_is_named(result: Result, tmp_path: Path) -> None:
    path = tmp_path / "nowhere" / "run.csv"
    with fails_with(UsageError, "AC012", str(path), match="No such file or directory"):
        result.save(path)


def test_a_folder_in_the_way(result: Result, tmp_path: Path) -> None:
    (tmp_path / "run.csv").mkdir()
    with pytest.raises(UsageError, match="it is a directory"):
        result.save(tmp_path / "run.csv")


def test_a_write_that_fails_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text("old")

    def fail(error: BaseException) -> None:
        with atomic(path) as file:
            file.write(b"half")
            raise error

    with pytest.raises(UsageError, match="disk full"):
        fail(OSError(28, "disk full"))
    with pytest.raises(KeyboardInterrupt):
        fail(KeyboardInterrupt())
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_ordinary_permissions_and_links(result: Result, tmp_path: Path) -> None:
    (tmp_path / "plain").touch()
    (tmp_path / "link.csv").symlink_to(tmp_path / "target.csv")
    result.save(tmp_path / "link.csv")
    assert (tmp_path / "link.csv").is_symlink()
    mode = (tmp_path / "target.csv").stat().st_mode
    assert stat.S_IMODE(mode) == stat.S_IMODE((tmp_path / "plain").stat().st_mode)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.csv", b""),
        ("a.csv", b"x,when\n1,2\n"),
        ("a.csv", b"time,x\n1,two\n"),
        ("a.csv", b"time,x\n1,2,3\n"),
        ("a.csv", b"\xff\xfe\x00"),
        ("a.mat", b"not a matrix"),
        ("a.mat", b""),
        ("a.npz", b"not a zip"),
        ("a.npz", b"PK\x03\x04broken"),
    ],
)
def test_what_is_no_result_is_refused_by_name(tmp_path: Path, name: str, content: bytes) -> None:
    (tmp_path / name).write_bytes(content)
    with fails_with(UsageError, "AC014", match=name):
        load(tmp_path / name)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="No such file"):
        load(tmp_path / "none.mat")


def test_a_csv_has_units_on_request(result: Result, tmp_path: Path) -> None:
    """Units are in the second row, which `load` and inputs read; without the option the file has no such row."""
    result.save(tmp_path / "run.csv", units=True)
    lines = (tmp_path / "run.csv").read_text().splitlines()
    assert lines[1] == "s,m,degC,m,,N/m"
    back = load(tmp_path / "run.csv")
    assert [s.unit for s in back.signals.values()] == [s.unit for s in SIGNALS]
    assert all(np.array_equal(back[name], result[name]) for name in result.names)
    series = read_series(tmp_path / "run.csv", "a.k")
    assert (series.unit, series.values[0]) == ("N/m", 4.2e7)


@pytest.mark.parametrize(
    "text",
    [
        "time [ms],x [kN]\n0,1.5\n500,-2\n",
        "# a rig\nt;x\nms;kN\n0;1,5\n500;-2,0\n",
        "x [kN]\tTime [ms]\n1.5\t0\n-2\t500\n",
        "time,x\nms,kN\n0,1.5\n500,-2\n",
    ],
)
def test_measurements_are_results(tmp_path: Path, text: str) -> None:
    """Names with units, a row of units, other separators and decimal signs are equivalent, also for inputs."""
    (tmp_path / "m.csv").write_text(text)
    r = load(tmp_path / "m.csv")
    assert r.time.tolist() == [0.0, 0.5]
    assert (r["x"].tolist(), r.unit("x")) == ([1.5, -2.0], "kN")
    series = read_series(tmp_path / "m.csv")
    assert (series.times.tolist(), series.values.tolist(), series.unit) == ([0.0, 0.5], [1.5, -2.0], "kN")


def test_a_comma_between_thousands_is_no_decimal_sign(tmp_path: Path) -> None:
    """The first row alone is ambiguous: next to 0.5, 1,234 means 1234."""
    path = tmp_path / "m.csv"
    path.write_text("time;x\n0;0\n0.5;1,234\n")
    with pytest.raises(UsageError, match="commas, as in line 3"):
        load(path)
    path.write_text("time;x\n0;0\n0,5;1,25\n")
    assert load(path)["x"].tolist() == [0.0, 1.25]


def test_a_broken_first_row_of_numbers_is_no_row_of_units(tmp_path: Path) -> None:
    (tmp_path / "m.csv").write_text("time,x\nO.0,l.5\n1,2\n2,3\n")
    with fails_with(UsageError, "AC014", match="as a result") as caught:
        load(tmp_path / "m.csv")
    assert "m.csv:2: time is 'O.0', not a number" in caught.value.evidence[0]


def test_parquet_is_read_and_written_by_pandas(result: Result, tmp_path: Path) -> None:
    """pandas reads values to the last bit and units from `attrs`; its frames with units in names are read back."""
    pandas = pytest.importorskip("pandas", reason="pandas is not installed")
    pytest.importorskip("pyarrow", reason="pyarrow is not installed")
    result.save(tmp_path / "run.parquet")
    frame = pandas.read_parquet(tmp_path / "run.parquet")
    assert frame.attrs["units"]["a.k"] == "N/m"
    back = load(tmp_path / "run.parquet")
    assert [(s.unit, s.doc) for s in back.signals.values()] == [(s.unit, s.doc) for s in SIGNALS]
    assert all(np.array_equal(frame[name].to_numpy(), result[name]) for name in result.names)
    other = pandas.DataFrame({"x [kN]": [1.5, -2.0]}, index=pandas.Index([0.0, 500.0], name="time [ms]"))
    other.to_parquet(tmp_path / "other.parquet")
    r = load(tmp_path / "other.parquet")
    assert (r.time.tolist(), r["x"].tolist(), r.unit("x")) == ([0.0, 0.5], [1.5, -2.0], "kN")
    other.loc[250.0] = float("nan")
    other.astype("Float64").convert_dtypes().to_parquet(tmp_path / "holes.parquet")
    with fails_with(UsageError, "AC014"):
        load(tmp_path / "holes.parquet")
