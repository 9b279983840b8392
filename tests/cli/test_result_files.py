"""`acausal plot, compare, export casadi`: what is done with files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from acausal.result.result import Result, load
from acausal.result.signals import Signal
from tests.cli.running import run


def _result(shift: float = 0.0, n: int = 201, stop: float = 2.0) -> Result:
    t = np.linspace(0.0, stop, n)
    values = np.stack([np.sin(3.0 * t) + shift, 5.0 * t], axis=1)
    signals = {"a": Signal("a", "m", column=0), "b": Signal("b", "N", column=1), "k": Signal("k", value=4.0)}
    return Result("M", t, values, signals)


def test_plot_draws_into_the_file_beside_the_result() -> None:
    _result().save("r.mat")
    outcome = run("plot", "r.mat", "a", "b")
    assert outcome.code == 0, outcome.err
    assert Path("r.png").read_bytes().startswith(b"\x89PNG")
    assert run("plot", "r.mat", "b", "--against", "a", "--output-file", "x.svg", "--together").code == 0
    assert Path("x.svg").exists()


def test_plot_without_names_lists_them() -> None:
    _result().save("r.mat")
    assert run("plot", "r.mat").out.split("\n")[:2] == ["a [m]", "b [N]"]


def test_plot_of_an_unknown_signal_names_near_ones() -> None:
    _result().save("r.npz")
    outcome = run("plot", "r.npz", "aa")
    assert outcome.code == 2
    assert "AC010" in outcome.err
    assert not Path("r.png").exists()


def test_equal_results_agree() -> None:
    _result().save("a.mat")
    _result().save("b.csv")
    outcome = run("compare", "a.mat", "b.csv")
    assert outcome.code == 0, outcome.err
    assert "3 common signals" in outcome.out


def test_a_smooth_signal_on_another_grid_agrees() -> None:
    """sin 3t in rows 10 ms apart: a spline between them is off by h**4 f''''/384 = 2e-9 (de Boor 1978, chapter V)."""
    _result().save("a.mat")
    t = np.sort(np.random.default_rng(3).uniform(0.0, 2.0, 70))
    Result("M", t, np.sin(3.0 * t)[:, None], {"a": Signal("a", "m", column=0)}).save("b.csv")
    outcome = run("compare", "a.mat", "b.csv", "--tolerance", "1e-6", "--signals", "a")
    assert outcome.code == 0, outcome.out


def test_between_the_rows_of_a_corner_nothing_overshoots() -> None:
    t = np.linspace(0.0, 2.0, 41)
    ramp = np.clip(t / 0.73, 0.0, 1.0)
    Result("M", t, ramp[:, None], {"a": Signal("a", column=0)}).save("a.npz")
    between = np.asarray(load("a.npz").at(np.linspace(0.0, 2.0, 999), "a"))
    assert between.min() >= 0.0
    assert between.max() <= 1.0


def test_what_cannot_be_compared_is_named() -> None:
    _result().save("a.mat")
    Path("kg.csv").write_text("time [s],a [kg]\n0,1\n1,1\n2,1\n")
    Path("gap.csv").write_text("time [s],a [m]\n0,0\n1,nan\n2,0\n")
    for arguments, code, word in (
        (("kg.csv", "a.mat"), 2, "a: kg in kg, m in a"),
        (("a.mat", "a.mat", "--tolerance", "nan"), 2, "--tolerance nan"),
        (("a.mat", "a.mat", "--floor", "0"), 2, "--floor 0"),
        (("gap.csv", "a.mat", "--tolerance", "10"), 3, "a is not a number in one of the files at 1 s"),
    ):
        outcome = run("compare", *arguments)
        assert outcome.code == code
        assert word in outcome.out + outcome.err


def test_deviation_is_relative_to_the_range() -> None:
    """Shifted by 0.02 in a range of 2 (sin 3t over 2 s passes +1 and -1): 1 %."""
    _result(n=2001).save("a.mat")
    _result(0.02, n=2001).save("b.mat")
    outcome = run("compare", "a.mat", "b.mat", "--tolerance", "1e-2", "--json")
    worst = outcome.json["deviations"][0]
    assert worst["name"] == "a"
    assert worst["absolute"] == pytest.approx(0.02, rel=1e-9)
    assert worst["relative"] == pytest.approx(0.01, rel=1e-4)
    assert run("compare", "a.mat", "b.mat", "--tolerance", "1.1e-2").code == 0
    assert run("compare", "a.mat", "b.mat", "--tolerance", "0.9e-2").code == 3
    assert run("compare", "a.mat", "b.mat", "--signals", "b").code == 0
    assert run("compare", "a.mat", "b.mat", "--signals", "b*", "--signals", "b").code == 0


def test_different_grids_are_compared_on_the_coarser() -> None:
    _result(n=101).save("a.mat")
    _result(n=2001).save("b.mat")
    assert run("compare", "a.mat", "b.mat", "--tolerance", "1e-6").code == 0
    assert run("compare", "b.mat", "a.mat", "--tolerance", "1e-6").code == 0


def test_a_run_that_broke_off_does_not_agree_with_its_reference() -> None:
    """Equal as far as both go: the short one lacks what the reference has, not the other way round."""
    _result(n=101).save("a.mat")
    _result(n=61, stop=1.2).save("b.mat")
    found = run("compare", "a.mat", "b.mat", "--json")
    assert (found.code, found.json["covers_first"], found.json["within_tolerance"]) == (3, False, False)
    assert found.json["to"] == pytest.approx(1.2)
    assert "out of tolerance" in run("compare", "a.mat", "b.mat").out
    assert run("compare", "b.mat", "a.mat").code == 0


def test_a_result_that_lacks_a_signal_does_not_agree_with_its_reference() -> None:
    _result().save("a.mat")
    whole = _result()
    Result("M", whole.time, whole.matrix[:, :1], {"a": whole.signals["a"]}).save("less.npz")
    found = run("compare", "a.mat", "less.npz")
    assert found.code == 3
    assert "less.npz lacks b and k of a.mat: out of tolerance" in found.out
    assert run("compare", "a.mat", "less.npz", "--signals", "a").code == 0
    assert run("compare", "less.npz", "a.mat").code == 0


def test_a_jump_is_not_compared_at_its_own_instant() -> None:
    """The same step, one of the two a rounding error later."""
    signals = {"y": Signal("y", column=0)}
    for name, at in (("a.npz", 1.0), ("b.npz", 1.0 + 1e-12)):
        times = np.array([0.0, 0.5, at, at, 1.5, 2.0])
        Result("M", times, np.array([[0.0], [0.0], [0.0], [1.0], [1.0], [1.0]]), signals).save(name)
    assert run("compare", "a.npz", "b.npz", "--tolerance", "1e-9").code == 0


def test_measurements_that_drive_a_run_are_compared_at_all_their_rows() -> None:
    """A run stops at the rows of its input, which are events of it alone: only what jumps there has two values.

    Without its rows at events the comparison had one instant left, and anything agreed.
    """
    rows, signals = np.arange(5.0), {"x": Signal("x", column=0), "y": Signal("y", column=1)}
    times = np.repeat(rows, 2)[1:-1]
    run_rows = np.stack([times, [0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0]], axis=1)
    Result("M", times, run_rows, signals).save("b.npz")
    for wrong, code in ((0.0, 0), (0.25, 3)):
        measured = np.stack([rows + wrong * (rows == 3.0), [0.0, 0.0, 1.0, 1.0, 1.0]], axis=1)
        Result("M", rows, measured, signals).save("a.npz")
        found = run("compare", "a.npz", "b.npz", "--json").json
        assert found["instants"] == 5
        assert found["deviations"][0]["absolute"] == wrong
        assert run("compare", "a.npz", "b.npz").code == run("compare", "b.npz", "a.npz").code == code


def test_results_whose_rows_are_all_samples_are_compared() -> None:
    """Every row of both is an event at one time: they differ behind it."""
    times = np.repeat(np.arange(5.0), 2)
    for name, step in (("a.npz", 1.0), ("b.npz", 1.5)):
        values = step * np.concatenate([[0.0], np.repeat(np.arange(4.0), 2), [4.0]])
        Result("M", times, values[:, None], {"y": Signal("y", column=0)}).save(name)
    found = run("compare", "a.npz", "b.npz", "--json")
    assert (found.code, found.json["instants"]) == (3, 5)
    assert found.json["deviations"][0]["absolute"] == pytest.approx(2.0)
    assert run("compare", "a.npz", "a.npz").code == 0


def test_results_with_nothing_in_common_are_refused() -> None:
    _result().save("a.npz")
    t = np.linspace(0.0, 1.0, 5)
    Result("M", t, t[:, None], {"z": Signal("z", column=0)}).save("b.npz")
    outcome = run("compare", "a.npz", "b.npz")
    assert outcome.code == 2
    assert "AC007" in outcome.err


def test_exported_functions_can_be_loaded_and_called() -> None:
    """ode of the oscillator at rest, displaced by 0.1 m: acceleration -c*s/m = -10 m/s2."""
    from acausal.export.casadi.casadi_file import load_casadi

    outcome = run("export", "casadi", "Oscillator", "-o", "o.casadi", "--outputs", "mass.a")
    assert outcome.code == 0, outcome.err
    assert "mass.s" in outcome.out
    model = load_casadi("o.casadi")
    rate = model.ode(model.x.start, [], model.p.start)[0]
    assert np.array(rate).ravel() == pytest.approx([0.0, -10.0])


def test_export_default_file_and_json() -> None:
    content = run("export", "casadi", "Oscillator", "--json").json
    assert content["files"] == ["Oscillator.casadi"]
    assert [port["name"] for port in content["x"]] == ["mass.s", "mass.v"]


def test_measurements_are_compared_in_their_unit() -> None:
    """sin(3 t) m against its values in cm at eleven times, one of them 2 cm off, of a range of 2 m."""
    t = np.linspace(0.0, 2.0, 11)
    shifted = 100.0 * np.sin(3.0 * t) + 2.0 * (t == t[4])
    rows = "\n".join(f"{1e3 * a!r},{b!r}" for a, b in zip(t.tolist(), shifted.tolist(), strict=True))
    Path("m.csv").write_text(f"time [ms],a [cm]\n{rows}\n")
    _result(n=2001).save("r.mat")
    outcome = run("compare", "m.csv", "r.mat", "--tolerance", "0.02", "--plot", "--json")
    assert outcome.code == 0, outcome.err
    (worst,) = outcome.json["deviations"]
    assert worst["absolute"] == pytest.approx(2.0, abs=1e-4)
    assert worst["rms"] == pytest.approx(2.0 / np.sqrt(11.0), abs=1e-4)
    assert (worst["unit"], worst["time"]) == ("cm", pytest.approx(t[4]))
    assert Path("r.png").read_bytes().startswith(b"\x89PNG")
    assert run("compare", "m.csv", "r.mat", "--tolerance", "1e-3", "--quiet").code == 3


def test_units_that_do_not_fit_are_refused() -> None:
    Path("m.csv").write_text("time [s],a [kg]\n0,1\n1,2\n")
    _result().save("r.mat")
    for verb in (("compare", "m.csv", "r.mat"), ("plot", "m.csv", "r.mat", "a"), ("explore", "m.csv", "r.mat")):
        assert "AC151" in run(*verb).err, verb


def test_two_results_are_drawn_over_each_other() -> None:
    _result().save("one.mat")
    _result(0.5).save("two.parquet")
    outcome = run("plot", "one.mat", "two.parquet", "a", "-o", "both.svg")
    assert outcome.code == 0, outcome.err
    text = Path("both.svg").read_text()
    assert "a (one)" in text
    assert "a (two)" in text


def test_a_csv_with_units_on_request() -> None:
    assert run("simulate", "Oscillator", "--output-file", "r.csv", "--units", "--quiet").code == 0
    head, units = Path("r.csv").read_text().splitlines()[:2]
    assert dict(zip(head.split(","), units.split(","), strict=True))["mass.v"] == "m/s"
    assert run("compare", "r.csv", "r.csv").code == 0
