"""Times of data in whatever they are counted: durations are seconds, dates and metres are none."""

from __future__ import annotations

from datetime import timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import acausal
from acausal import Component, Equations, Real, TimeSeries, der, fixed, parameter, signal_input, variable
from acausal.errors import AcausalError
from acausal.result.seconds import seconds

T = np.array([0.0, 0.5, 1.0, 2.0])
U = np.array([290.0, 300.0, 300.0, 280.0])


class Sum(Component):
    """Integral of its input."""

    k: Real = parameter(default=0.5)
    u: Real = signal_input(unit="K")
    x: Real = variable(default=fixed(0.0), unit="K.s")

    def equations(self) -> Equations:
        yield der(self.x) == self.u


@pytest.fixture(scope="module")
def model() -> Any:
    return acausal.compile(Sum())


def integral(model: Any, data: Any, stop: float = 2.0) -> float:
    return float(acausal.simulate(model, inputs={"u": data}, stop_time=stop).final("x"))


@pytest.mark.parametrize("unit", ["ns", "us", "ms"])
def test_durations_are_seconds(model: Any, unit: str) -> None:
    """numpy's durations count units of their own, which are no seconds."""
    durations = (T * 1e9).astype("timedelta64[ns]").astype(f"timedelta64[{unit}]")
    for data in ((durations, U), TimeSeries(durations, U), ([timedelta(seconds=t) for t in T.tolist()], U)):
        assert integral(model, data) == pytest.approx(np.trapezoid(U, T), rel=1e-9)


def test_durations_of_tables(model: Any, tmp_path: Path) -> None:
    pandas, _ = pytest.importorskip("pandas"), pytest.importorskip("pyarrow")
    durations = pandas.to_timedelta(T, unit="s")
    table = pandas.DataFrame({"time": durations, "u": U})
    table.to_parquet(tmp_path / "u.parquet")
    for data in (table, pandas.Series(U, index=durations), f"{tmp_path / 'u.parquet'}:u"):
        assert integral(model, data) == pytest.approx(np.trapezoid(U, T), rel=1e-9)
    assert acausal.load(tmp_path / "u.parquet").time == pytest.approx(T)


def test_measurements_over_durations() -> None:
    """x = 3 k t: a fit to durations of whole seconds finds k = 2."""
    pandas = pytest.importorskip("pandas")

    class Line(Component):
        k: Real = parameter(default=0.5)
        x: Real = variable(default=fixed(0.0))

        def equations(self) -> Equations:
            yield der(self.x) == 3.0 * self.k

    data = pandas.DataFrame({"x": [0.0, 6.0, 12.0]}, index=pandas.to_timedelta([0, 1, 2], unit="s"))
    assert acausal.fit(Line(), data, ["k"]).value == pytest.approx([2.0])
    data.index = pandas.to_datetime([0, 1, 2], unit="s")
    with pytest.raises(AcausalError, match=r"AC055.*dates"):
        acausal.fit(Line(), data, ["k"])


def test_dates_are_refused(model: Any) -> None:
    dates = np.array(["2024-01-01T00:00:00", "2024-01-01T00:00:02"], dtype="datetime64[ns]")
    for data in ((dates, U[:2]), TimeSeries):
        with pytest.raises(AcausalError, match=r"AC044.*dates"):
            integral(model, data if isinstance(data, tuple) else data(dates, U[:2]))


@pytest.mark.parametrize(("unit", "factor"), [("ms", 1e-3), ("min", 60.0), ("h", 3600.0), ("", 1.0)])
def test_units_of_times(unit: str, factor: float) -> None:
    assert seconds(T, unit) == pytest.approx(factor * T)


@pytest.mark.parametrize(("unit", "code"), [("m", "AC151"), ("degC", "AC151"), ("sec.", "AC150")])
def test_a_time_in_metres_is_refused(model: Any, tmp_path: Path, unit: str, code: str) -> None:
    """Whoever means minutes by m would have had seconds."""
    file = tmp_path / "u.csv"
    file.write_text(f"time [{unit}],u\n0,290\n2,290\n")
    for read in (lambda: integral(model, f"{file}:u"), lambda: acausal.load(file)):
        with pytest.raises(AcausalError, match=f"{code}.*u.csv"):
            read()


def test_a_constant_with_a_unit(model: Any) -> None:
    assert integral(model, "20 degC") == pytest.approx(2 * 293.15)
    with pytest.raises(AcausalError, match=r"AC151.*does not fit"):
        integral(model, "20 mm")


def test_a_run_beside_its_data_is_told_where_they_are(model: Any) -> None:
    """The help names a run that begins before it ends."""
    with pytest.raises(AcausalError, match="start_time=1700000000 to stop_time=1700000002"):
        integral(model, (1.7e9 + T, U))
