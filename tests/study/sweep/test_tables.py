"""Tables of a sweep, read by the packages that will read them, and its pictures."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

import acausal
from acausal import Component, Equations, Range, Real, der, fixed, parameter, variable
from acausal.errors import UsageError
from tests.study.sweep.decays import Decay


@pytest.fixture(scope="module")
def found() -> acausal.Sweep:
    """Three rates, two starts, of which 9 m is above the limit."""
    vary = {"k": Range(0.5, 1.5, 3), "a": [1.0, 9.0]}
    return acausal.sweep(Decay(), vary, signals=["x", "y"], stop_time=1.0, output_interval=0.1, workers=1)


def test_csv_has_a_row_for_each_member(found: acausal.Sweep, tmp_path: Path) -> None:
    found.save(tmp_path / "x.csv")
    with (tmp_path / "x.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [float(r["k"]) for r in rows] == [0.5, 0.5, 1.0, 1.0, 1.5, 1.5]
    assert [r["status"] for r in rows] == ["ok", "failed"] * 3
    assert float(rows[2]["x"]) == pytest.approx(np.exp(-1.0), abs=1e-5)
    assert rows[3]["code"] == found.codes[3]


def test_parquet_has_the_rows_over_time_too(found: acausal.Sweep, tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    found.save(tmp_path / "x.parquet")
    table = parquet.read_table(tmp_path / "x.parquet")
    assert table.num_rows == 6
    assert np.array_equal(table["time"][4].as_py(), found.time)
    assert np.array_equal(table["y(time)"][4].as_py(), found["y"][4])
    assert table.schema.field("x").metadata[b"unit"] == b"m"
    assert table["message"][1].as_py() == found.messages[1]


def test_xarray_unstacks_to_the_grid_and_goes_to_a_file(found: acausal.Sweep, tmp_path: Path) -> None:
    xarray = pytest.importorskip("xarray")
    data = found.to_xarray()
    assert data["x"].attrs == {"units": "m", "long_name": "Length."}
    grid = data.set_index(member=["k", "a"]).unstack("member")
    assert grid["x"].sel(k=1.5, a=1.0).values == pytest.approx(np.exp(-1.5 * found.time), abs=1e-5)
    assert np.isnan(grid["x"].sel(a=9.0)).all()
    found.save(tmp_path / "x.nc")
    with xarray.open_dataset(tmp_path / "x.nc", engine="scipy") as back:
        assert np.array_equal(back["x"], found["x"], equal_nan=True)
        assert back["code"].values.tolist() == list(found.codes)


def test_pandas_is_indexed_by_member(found: acausal.Sweep) -> None:
    pytest.importorskip("pandas")
    table = found.to_pandas()
    assert table.index.name == "member"
    assert table.loc[2, "x"] == found.final("x")[2]


def test_names_that_are_not_there_are_refused(found: acausal.Sweep, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="AC010"):
        found["z"]
    with pytest.raises(UsageError, match="AC013"):
        found.save(tmp_path / "x.xls")
    with pytest.raises(UsageError, match="AC016"):
        found.plot("x", by="x")


def test_a_family_has_a_line_for_each_member_units_and_a_key(found: acausal.Sweep, tmp_path: Path) -> None:
    figure = found.plot("x", "y", file=tmp_path / "x.png")
    upper, lower = figure.axes[:2]
    assert len(upper.lines) == 3  # three of six have values
    assert (upper.get_ylabel(), lower.get_ylabel()) == ("x [m]", "y [m]")
    assert lower.get_xlabel() == "Time [s]"
    key, styles = figure.legends
    assert key.get_title().get_text() == "k [1/s]"
    assert [t.get_text() for t in key.get_texts()] == ["0.5", "1", "1.5"]
    assert styles.get_title().get_text() == "a [m]"
    assert len({str(line.get_color()) for line in upper.lines}) == 3


def test_many_members_are_bands_of_quantiles() -> None:
    """x = exp(-k) at the end; the median of a sample is that of k, which is 1."""
    drawn = acausal.sweep(
        Decay(),
        {"k": Range(0.5, 1.5)},
        sample="sobol:256",
        signals=["x"],
        stop_time=1.0,
        output_interval=0.5,
        workers=1,
    )
    ax = drawn.plot("x").axes[0]
    (median,) = ax.lines
    assert np.asarray(median.get_ydata())[-1] == pytest.approx(np.exp(-1.0), rel=5e-3)
    assert len(ax.collections) == 2


class Named(Component):
    """x' = -k x under names that tables have columns of their own for."""

    status: Real = parameter(default=1.0, unit="1/s")
    events: Real = variable(default=fixed(2.0))
    member: Real = variable()

    def equations(self) -> Equations:
        yield der(self.events) == -self.status * self.events
        yield self.member == 3.0 * self.events


def test_names_of_the_model_are_those_of_the_table(tmp_path: Path) -> None:
    """Every table has the values of the model under its own names; how the members went stands beside them."""
    rates = [0.5, 1.0, 2.0]
    made = acausal.sweep(Named(), {"status": rates}, signals=["events", "member"], stop_time=1.0, workers=1)
    made.save(tmp_path / "x.csv")
    with (tmp_path / "x.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    parquet = pytest.importorskip("pyarrow.parquet")
    made.save(tmp_path / "x.parquet")
    tables = [made.to_pandas(), {n: [row[n] for row in rows] for n in rows[0]}]
    tables.append(parquet.read_table(tmp_path / "x.parquet").to_pandas())
    for table in tables:
        assert np.array(table["status"], dtype=float) == pytest.approx(rates)
        assert np.array(table["events"], dtype=float) == pytest.approx(2.0 * np.exp(-np.array(rates)), rel=1e-5)
        assert np.array(table["member"], dtype=float) == pytest.approx(6.0 * np.exp(-np.array(rates)), rel=1e-5)
        assert list(table["run.status"]) == ["ok"] * 3
    data = made.to_xarray()
    assert data["events"].shape == data["member"].shape == (3, len(made.time))
    assert data["events.final"].values == pytest.approx(2.0 * np.exp(-np.array(rates)), rel=1e-5)
