"""Reading a result by name and by time.

The run is made by hand: a mass moves with s = t^2 until it is kicked at t = 2, and with s = 4 - 3 (t - 2) after, so
every expected value is this closed form.
"""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import acausal
from acausal.errors import InternalError, UsageError
from acausal.models.bouncing_ball import BouncingBall
from acausal.result.result import Event, Result, Signal
from acausal.result.signals import Array
from tests.expected import fails_with

TIME = np.array([0.0, 0.5, 1.0, 1.5, 2.0, 2.0, 3.0, 4.0])
AFTER = np.arange(8) > 4


def motion(t: Array, after: NDArray[np.bool_]) -> Array:
    """Columns s and v."""
    s = np.where(after, 4.0 - 3.0 * (t - 2.0), t**2)
    return np.column_stack([s, np.where(after, -3.0, 2.0 * t)])


SIGNALS = (
    Signal("mass.s", "m", "Position", 0),
    Signal("mass.v", "m/s", "Velocity", 1),
    Signal("spring.s_rel", "m", "Length", 0, sign=-1),
    Signal("mass.m", "kg", "Mass", value=2.5, parameter=True),
    Signal("body.r_0[0]", "m", column=0),
    Signal("body.r_0[1]", "m", value=7.0),
    Signal("body.r_0[2]", "m", column=0, sign=-1),
    *(Signal(f"body.R[{i},{j}]", "", value=10.0 * i + j) for i in range(3) for j in range(3)),
)


def make(**changes: object) -> Result:
    arguments: dict[str, object] = {
        "model": "Kick",
        "time": TIME,
        "trajectories": motion(TIME, AFTER),
        "signals": {s.name: s for s in SIGNALS},
        "events": (Event(2.0, "time >= 2"),),
        "stats": {"solver": "idas"},
    }
    return Result(**{**arguments, **changes})  # type: ignore[arg-type]


def test_scalars_aliases_and_constants() -> None:
    r = make()
    assert r["mass.s"].tolist() == [0.0, 0.25, 1.0, 2.25, 4.0, 4.0, 1.0, -2.0]
    assert r["spring.s_rel"].tolist() == (-r["mass.s"] + 0.0).tolist()
    assert r["mass.m"].tolist() == [2.5] * 8
    assert r["time"].tolist() == TIME.tolist()
    # A negated zero prints as 0.0, not -0.0.
    assert not np.signbit(r["spring.s_rel"][0])


def test_arrays_are_assembled_in_row_major_order() -> None:
    r = make()
    assert r["body.r_0"].shape == (8, 3)
    assert r["body.r_0"][-1].tolist() == [-2.0, 7.0, 2.0]
    assert r["body.R"].shape == (8, 3, 3)
    assert r["body.R"][3, 1, 2] == 12.0
    assert np.asarray(r.final("body.R")).shape == (3, 3)


def test_arrays_of_modelica_files_count_from_one() -> None:
    signals = {f"x[{i}]": Signal(f"x[{i}]", value=float(i)) for i in (1, 2, 3)}
    assert make(signals=signals)["x"][0].tolist() == [1.0, 2.0, 3.0]


def test_names_units_membership() -> None:
    r = make()
    assert r.names[:3] == ("mass.s", "mass.v", "spring.s_rel")
    assert r.unit("mass.v") == "m/s"
    assert r.unit("body.r_0") == "m"
    assert "mass.s" in r
    assert "body.r_0" in r
    assert "time" in r
    assert "mass" not in r
    assert r.final("mass.s") == -2.0
    assert tuple(r) == r.names


def test_what_is_read_is_a_copy() -> None:
    r = make()
    r["mass.s"][:] = 99.0
    r["time"][:] = 99.0
    assert r.final("mass.s") == -2.0
    assert r.time[0] == 0.0


def test_unknown_name_names_the_nearest() -> None:
    with fails_with(UsageError, "AC010", match=r"Kick has no signal 'mas\.s'") as caught:
        make()["mas.s"]
    assert "mass.s" in caught.value.evidence[0]


@pytest.mark.parametrize("key", [0, ["mass.s"], None, slice(0, 1)])
def test_what_is_no_name_is_refused(key: Any) -> None:
    with pytest.raises(UsageError, match="is not a name of a signal"):
        make()[key]
    assert key not in make()


def test_at_takes_the_time_first() -> None:
    wrong: Any = "mass.s"
    with fails_with(UsageError, "AC011", match="takes times"):
        make().at(wrong, "mass.s")


def test_an_array_with_a_gap_is_unknown() -> None:
    signals = {f"x[{i}]": Signal(f"x[{i}]") for i in (0, 2)}
    with pytest.raises(UsageError):
        make(signals=signals)["x"]


@pytest.mark.parametrize("kept", [(1, 2), (1,), (2,)])
def test_a_part_of_an_array_is_no_array(kept: tuple[int, ...]) -> None:
    """In a run whose arrays count from 0, y and z do not form a vector whose first entry is y."""
    signals = {f"r[{i}]": Signal(f"r[{i}]") for i in kept} | {"q[0]": Signal("q[0]")}
    with pytest.raises(UsageError, match="AC010"):
        make(signals=signals)["r"]


def test_trajectories_are_computed_once_and_not_for_constants() -> None:
    calls = []

    def compute() -> Array:
        calls.append(1)
        return motion(TIME, AFTER)

    r = make(trajectories=compute)
    assert r.final("mass.m") == 2.5
    assert repr(r) == "Result(Kick: 0 .. 4 s, 8 points, 16 signals, 1 event, idas)"
    assert calls == []
    assert r.final("mass.s") == -2.0
    assert r.final("mass.v") == -3.0
    assert calls == [1]


def test_at_a_stored_time_is_the_value_after_the_event() -> None:
    r = make()
    assert r.at(1.5, "mass.s") == 2.25
    assert r.at(2.0, "mass.v") == -3.0
    # 2 minus one unit in the last place also returns the stored point.
    assert r.at(np.nextafter(2.0, 0.0), "mass.v") == -3.0
    assert r.at([0.0, 4.0], "mass.s").tolist() == [0.0, -2.0]  # type: ignore[union-attr]


def test_between_points_the_cubic_does_not_see_across_the_event() -> None:
    r = make()
    # After the event s is a straight line, which a shape-preserving cubic reproduces.
    assert r.at(2.25, "mass.s") == pytest.approx(3.25, abs=1e-14)
    assert r.at(2.25, "mass.v") == -3.0
    # Before it v is a straight line; s is a parabola, accurate to the third power of the step of 0.5 s.
    assert r.at(1.75, "mass.v") == pytest.approx(3.5, abs=1e-14)
    assert r.at(1.25, "mass.s") == pytest.approx(1.25**2, abs=0.02)


def test_the_cubic_never_overshoots() -> None:
    # A force that stops at zero stays non-negative: the reason for a shape-preserving cubic (Fritsch and Carlson 1980).
    time = np.arange(6.0)
    r = make(time=time, trajectories=np.array([[9.0, 4.0, 1.0, 0.0, 0.0, 0.0]]).T, signals={"f": Signal("f", column=0)})
    assert np.min(r.at(np.linspace(0, 5, 101), "f")) >= 0.0


def test_dense_output_serves_times_between_points_only() -> None:
    asked: list[float] = []

    def dense(t: Array) -> Array:
        asked.extend(t.tolist())
        return motion(t, t >= 2.0)

    r = make(dense=dense)
    values = np.asarray(r.at([[0.3, 1.0], [2.0, 3.5]], "body.r_0"))
    assert values.shape == (2, 2, 3)
    assert values[..., 0] == pytest.approx(np.array([[0.09, 1.0], [4.0, -0.5]]), abs=1e-15)
    assert asked == [0.3, 3.5]


@pytest.mark.parametrize("t", [-0.1, 4.1, np.nan])
def test_outside_the_run_is_refused(t: float) -> None:
    with fails_with(UsageError, "AC011", match="outside the run of Kick") as caught:
        make().at(t, "mass.s")
    assert caught.value.evidence == ("the run goes from 0 s to 4 s",)


def test_two_points_and_one_point() -> None:
    r = make(time=[1.0, 3.0], trajectories=np.array([[2.0, 0.0], [6.0, 0.0]]))
    assert r.at(1.5, "mass.s") == 3.0
    single = make(time=[1.0], trajectories=np.array([[2.0, 0.0]]))
    assert single.at(1.0, "mass.s") == 2.0


def test_to_pandas() -> None:
    pytest.importorskip("pandas")
    frame = make().to_pandas()
    assert list(frame.columns) == list(make().names)
    assert frame.index.name == "time"
    assert frame["mass.s"].iloc[-1] == -2.0


def test_to_xarray() -> None:
    pytest.importorskip("xarray")
    data = make().to_xarray()
    assert data["mass.v"].attrs == {"units": "m/s", "long_name": "Velocity"}
    assert data["mass.v"].values[-1] == -3.0


def test_a_missing_package_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)
    with fails_with(UsageError, "AC015", match="needs the package pandas"):
        make().to_pandas()


@pytest.mark.parametrize(
    "changes", [{"time": TIME[::-1]}, {"trajectories": np.zeros((3, 2))}, {"trajectories": np.zeros(8)}]
)
def test_inconsistent_runs_are_a_defect_of_acausal(changes: dict[str, object]) -> None:
    with pytest.raises(InternalError):
        make(**changes).final("mass.s")


def test_reading_results_loads_neither_scipy_nor_matplotlib() -> None:
    loading = "import sys, acausal.result.result, acausal.result.files, acausal.panel"
    code = f"{loading}; print(*{{m.split('.')[0] for m in sys.modules}})"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert not {"scipy", "matplotlib", "casadi", "pandas"} & set(loaded)


def test_several_times_between_two_rows_of_a_run_with_events() -> None:
    """Free fall from 1 m: h = 1 - 9.81 t**2/2 until 0.45 s."""
    run = acausal.simulate(BouncingBall(), stop_time=1.0, output_interval=0.1)
    t = np.array([0.12, 0.15, 0.17])
    np.testing.assert_allclose(run.at(t, "h"), 1.0 - 9.81 * t**2 / 2, rtol=1e-9)


def test_the_stop_time_is_inside_where_an_event_is_at_it() -> None:
    """An event closer to the stop time than 1e-12 of the run ends it: the last row has the time of the event."""
    r = make()
    assert r.at(4.0 + 2e-12, "body.r_0") == pytest.approx(r.final("body.r_0"), abs=0.0)
    with pytest.raises(UsageError):
        r.at(4.0 + 1e-11, "body.r_0")


def test_events_are_counted_as_they_are_described() -> None:
    """The count of a run is known before its events are described, which for thousands takes as long as the run.

    Law: each flight of a ball is 0.7 of the one before it, by its restitution.
    """
    result = acausal.simulate(BouncingBall(), stop_time=2.0)
    count = result.stats["events"]
    assert callable(result.__dict__["events"])
    assert len(result.events) == count
    assert result.events is result.events
    flights = np.diff([event.time for event in result.events])
    assert len(flights) > 1
    assert flights[1:] / flights[:-1] == pytest.approx(0.7, rel=1e-4)
