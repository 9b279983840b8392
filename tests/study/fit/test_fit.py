"""Parameters from measurements: against closed forms of regression, and on data whose truth is known."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas
import pytest
from numpy.typing import NDArray
from typer.testing import CliRunner

import acausal
from acausal import (
    Component,
    Dataset,
    Equations,
    Real,
    cos,
    der,
    fit,
    fixed,
    no_event,
    parameter,
    sign,
    signal_input,
    sin,
    variable,
)
from acausal.cli.main import app
from acausal.errors import AcausalError
from acausal.models.bouncing_ball import BouncingBall
from acausal.models.drilling_kinematic import ThinPlate
from acausal.models.oscillator import Oscillator
from acausal.plot.scale import readable
from acausal.simulate.record.record import Dense
from acausal.study.fit.judge import Unknowns, judge
from tests.expected import fails_with
from tests.export.test_sensitivity_meeting import Both

Vector = NDArray[np.float64]


class Line(Component):
    """x = t + b*t^2, y = x + a, level = a: linear in its parameters."""

    a: Real = parameter(default=0.5, unit="1")
    b: Real = parameter(default=1.0, unit="1")
    tau: Real = parameter(default=1.0, unit="s")
    x: Real = variable(default=fixed(0.0), unit="1")
    y: Real = variable(unit="1")

    level: Real = variable(unit="1")

    def equations(self) -> Equations:
        yield self.tau * der(self.x) == 1.0 + 2.0 * self.b * acausal.time / self.tau
        yield self.y == self.x + self.a
        yield self.level == self.y - self.x


class Lag(Component):
    """First order lag of an input."""

    u: Real = signal_input(unit="1")
    T: Real = parameter(default=1.0, unit="s", min=0.0)
    y: Real = variable(default=fixed(0.0), unit="1")

    def equations(self) -> Equations:
        yield self.T * der(self.y) == self.u - self.y


TIMES = np.linspace(0.0, 2.0, 41)


def noisy_line(seed: int) -> Vector:
    """Values of y for a = 0.7, b = -0.3, with noise of 0.05."""
    noise = np.random.default_rng(seed).normal(0.0, 0.05, len(TIMES))
    return np.asarray(TIMES - 0.3 * TIMES**2 + 0.7 + noise)


def test_linear_models_give_the_normal_equations() -> None:
    """Estimates and covariance of linear regression: (X'X)^-1 X'y and s^2 (X'X)^-1."""
    y = noisy_line(3)
    found = fit(Line(), {"y": (TIMES, y)}, ["a", "b"])
    x = np.column_stack([np.ones_like(TIMES), TIMES**2])
    best, rest, *_ = np.linalg.lstsq(x, y - TIMES, rcond=None)
    covariance = float(rest[0]) / (len(TIMES) - 2) * np.linalg.inv(x.T @ x)
    np.testing.assert_allclose(found.value, best, rtol=1e-5)
    np.testing.assert_allclose(found.covariance, covariance, rtol=1e-3)
    # Student's 97.5 % quantile with 39 degrees of freedom: 2.0227
    np.testing.assert_allclose(found.interval[:, 1] - found.value, 2.0227 * np.sqrt(np.diag(covariance)), rtol=1e-3)
    assert not found.notes


def test_a_differentiated_run_has_its_rows_where_the_data_have_them(monkeypatch: pytest.MonkeyPatch) -> None:
    """Parameters are found again from uneven times, and no run is integrated again to read it, ten runs for each."""
    plate, names = acausal.compile(ThinPlate()), ["drill.k_c11", "drill.z"]
    run = acausal.simulate(plate, stop_time=3.0)
    times = np.sort(np.random.default_rng(5).uniform(0.0, 3.0, 40))
    sets = [
        Dataset({"drill.F_c": (times, run.at(times, "drill.F_c"))}),
        Dataset(
            {"drill.F_c": (times, acausal.simulate(plate, parameters={"v": 3e-3}).at(times, "drill.F_c"))},
            parameters={"v": 3e-3},
        ),
    ]

    def again(self: Dense, wanted: Vector) -> Vector:
        raise AssertionError(f"integrated again up to {wanted}")

    monkeypatch.setattr(Dense, "__call__", again)
    found = fit(plate, sets, names, parameters={"drill.k_c11": 1.7e9, "drill.z": 0.3})
    np.testing.assert_allclose(found.value, [float(run.final(name)) for name in names], rtol=1e-6)


class Decay(Component):
    """An offset that rises as x decays at a rate."""

    k: Real = parameter(default=1.0, unit="1/s")
    a: Real = parameter(default=1.0, unit="1")
    x: Real = variable(default=fixed(1.0), unit="1")
    y: Real = variable(unit="1")

    def equations(self) -> Equations:
        yield der(self.x) == -self.k * self.x
        yield self.y == self.a * self.x**2


@pytest.mark.parametrize("free", [["a"], ["k", "a"]])
def test_derivatives_of_runs_and_differences_say_the_same(free: list[str]) -> None:
    """Both against scipy's fit of the closed form y = a exp(-2 k t); `native=True` differentiates by compiled steps."""
    from scipy.optimize import curve_fit

    y = 1.3 * np.exp(-2.0 * TIMES) + np.random.default_rng(4).normal(0.0, 0.02, len(TIMES))
    names = {"a": lambda t, a: a * np.exp(-2.0 * t), "ka": lambda t, k, a: a * np.exp(-2.0 * k * t)}
    best, covariance = curve_fit(names["".join(free)], TIMES, y, p0=[1.0] * len(free), method="lm")
    for native in (True, False):
        found = fit(Decay(), {"y": (TIMES, y)}, free, native=native)
        assert bool(found.gradients) == (native or free == ["a"])
        std = np.sqrt(np.diag(covariance))
        assert (np.abs(found.value - best) < 0.01 * std).all()
        np.testing.assert_allclose(found.std, std, rtol=2e-3)


def test_known_noise_rules_the_intervals() -> None:
    sigma = 0.2
    found = fit(Line(), Dataset({"y": (TIMES, noisy_line(3))}, sigma={"y": sigma}), ["a", "b"])
    x = np.column_stack([np.ones_like(TIMES), TIMES**2])
    np.testing.assert_allclose(found.std, sigma * np.sqrt(np.diag(np.linalg.inv(x.T @ x))), rtol=1e-3)


@pytest.mark.parametrize("order", [1, -1])
def test_each_data_set_has_the_weight_of_its_own_noise(order: int) -> None:
    """Generalised least squares (Aitken 1936): (X'WX)^-1 X'W y with W = diag(1/sigma^2), in any order of the sets."""
    sigmas = (0.01, 1.0)
    sets = [Dataset({"y": (TIMES, noisy_line(k) + k)}, sigma={"y": s}) for k, s in enumerate(sigmas)]
    found = fit(Line(), sets[::order], ["a", "b"])
    x = np.tile(np.column_stack([np.ones_like(TIMES), TIMES**2]), (2, 1))
    y = np.concatenate([noisy_line(0), noisy_line(1) + 1.0]) - np.tile(TIMES, 2)
    weight = np.repeat(1.0 / np.array(sigmas) ** 2, len(TIMES))
    covariance = np.linalg.inv(x.T @ (weight[:, None] * x))
    np.testing.assert_allclose(found.value, covariance @ (x.T @ (weight * y)), atol=1e-2 * np.sqrt(covariance[0, 0]))
    np.testing.assert_allclose(found.std, np.sqrt(np.diag(covariance)), rtol=1e-3)


@pytest.mark.slow
def test_intervals_hold_the_truth_as_often_as_they_say() -> None:
    """Of 60 intervals of 95 % fewer than 51 hold the truth once in 3000 times (binomial distribution)."""
    model = acausal.compile(Line())
    hits = np.zeros(2)
    for seed in range(60):
        found = fit(model, {"y": (TIMES, noisy_line(seed))}, ["a", "b"])
        hits += (found.interval[:, 0] <= (0.7, -0.3)) & (found.interval[:, 1] >= (0.7, -0.3))
    assert hits.min() >= 51


@pytest.mark.parametrize("is_known", [False, True])
def test_many_values_of_one_signal_do_not_narrow_the_interval_of_another(is_known: bool) -> None:
    """y = a + b t at five times alone tells b, whatever 200 values z = a have: 95 % of the intervals hold the truth.

    By Student's distribution with the three degrees of freedom of y (Student, Biometrika 6, 1908). The binomial
    distribution gives less than 461 of 500 once in 300 times; the freedom of y and z together gave 386.
    """
    t = np.linspace(0.0, 2.0, 5)
    x = np.vstack([np.column_stack([np.ones(5), t]), np.tile([1.0, 0.0], (200, 1))])
    rows = {"y": np.arange(5), "z": np.arange(5, 205)}
    weight = np.repeat([1.0 / 0.05, 1.0 / 20.0], [5, 200])
    unknown = Unknowns(("a", "b"), ("1", "1"), np.ones(2), np.full(2, -np.inf), np.full(2, np.inf))
    rng = np.random.default_rng(4)
    hits = 0
    for _ in range(500):
        data = weight * (x @ (0.7, -0.3)) + rng.normal(0.0, 1.0, len(x))
        q = np.linalg.lstsq(weight[:, None] * x, data, rcond=None)[0]
        # fit weighs by the root mean square of the residuals of each signal
        rest = weight * (x @ q) - data
        own = weight / np.repeat([np.sqrt(np.mean(rest[part] ** 2)) for part in rows.values()], [5, 200])
        noisy = {"y": rows["y"]} if is_known else rows
        own = np.where(np.arange(len(x)) < 5, own, weight if is_known else own)
        low, high = judge(own / weight * rest, own[:, None] * x, q, unknown, noisy, {}).interval[1]
        hits += low <= -0.3 <= high
    assert hits >= 461


def swing(c: float, d: float, seed: int = 1) -> dict[str, tuple[Vector, Vector]]:
    """Position and speed of the oscillator by its closed form, 1 kg from 0.1 m, with noise of 1 mm and 50 mm/s."""
    rng = np.random.default_rng(seed)
    t = np.linspace(0.0, 5.0, 251)
    damping = d / 2.0
    w = np.sqrt(c - damping**2)
    s = 0.1 * np.exp(-damping * t) * (np.cos(w * t) + damping / w * np.sin(w * t))
    v = -0.1 * np.exp(-damping * t) * c / w * np.sin(w * t)
    return {"mass.s": (t, s + rng.normal(0.0, 1e-3, len(t))), "mass.v": (t, v + rng.normal(0.0, 5e-2, len(t)))}


def test_two_signals_are_weighted_by_their_noise() -> None:
    found = fit(Oscillator(), swing(110.0, 1.2), ["c", "d"])
    assert found.interval[0, 0] <= 110.0 <= found.interval[0, 1]
    assert found.interval[1, 0] <= 1.2 <= found.interval[1, 1]
    assert found.noise["mass.s"] == pytest.approx(1e-3, rel=0.15)
    assert found.noise["mass.v"] == pytest.approx(5e-2, rel=0.15)
    assert found.runs <= 30


@pytest.mark.slow
def test_what_the_data_do_not_tell_apart_is_named() -> None:
    """Only c/m and d/m rule a free swing; nothing else."""
    found = fit(Oscillator(), swing(110.0, 1.2), ["c", "d", "m"])
    assert np.isinf(found.std).all()
    assert any("combination of c, d, m" in note for note in found.notes)
    assert found.value[0] / found.value[2] == pytest.approx(110.0, rel=1e-2)


def test_residuals_that_are_no_noise_are_said() -> None:
    """A constant is fitted to an oscillation."""
    t = np.linspace(0.0, 2.0, 101)
    found = fit(Line(), {"y": (t, np.sin(3.0 * t))}, ["a"])
    assert any("correlated in time" in note for note in found.notes)


def test_errors_of_the_run_are_not_called_a_wrong_model() -> None:
    """Exact data leave residuals of rounding errors, which follow one another and tell nothing of the model."""
    truth = acausal.simulate(Line(), parameters={"a": 0.7, "b": -0.3}, stop_time=2.0, output_interval=0.02)
    found = fit(Line(), {"y": (truth.time, truth["y"])}, ["a", "b"])
    assert found.rms["y"] < 1e-7
    assert found.notes == ()


def test_two_values_do_not_tell_the_noise_of_a_line() -> None:
    """y has as many values as parameters that it alone determines: no freedom is left to tell its noise."""
    few, many = np.array([0.5, 2.0]), np.linspace(0.0, 2.0, 21)
    z = 0.7 + np.random.default_rng(1).normal(0.0, 20.0, len(many))
    found = fit(Line(), {"y": (few, [1.1, 1.6]), "level": (many, z)}, ["a", "b"])
    assert any("y has too few values" in note for note in found.notes)
    assert np.isinf(found.interval[1]).all()


def test_the_measured_input_drives_the_model(tmp_path: Path) -> None:
    """Step response 1 - exp(-t/T) with T = 0.4 s, in percent and milliseconds; empty cells are no measurements."""
    t = np.linspace(0.0, 2.0, 41)
    y = 100.0 * (1.0 - np.exp(-t / 0.4))
    rows = [
        f"{1e3 * a:.9g},1,{b:.9g}" if k % 3 else f"{1e3 * a:.9g},1," for k, (a, b) in enumerate(zip(t, y, strict=True))
    ]
    file = tmp_path / "step.csv"
    file.write_text("\n".join(["time [ms],u,y [%]", *rows]))
    found = fit(Lag(), str(file), ["T"])
    assert found.parameters["T"] == pytest.approx(0.4, rel=1e-5)
    assert found.rows == 27


def test_events_move_with_the_parameters() -> None:
    """The coefficient of restitution from heights: bounces are later the more elastic the ball is."""
    truth = acausal.simulate(BouncingBall(), parameters={"e": 0.83}, stop_time=2.5, tolerance=1e-10)
    rng = np.random.default_rng(5)
    heights = truth["h"] + rng.normal(0.0, 1e-3, len(truth.time))
    found = fit(BouncingBall(), {"h": (truth.time, heights)}, ["e"])
    assert found.interval[0, 0] <= 0.83 <= found.interval[0, 1]
    assert found.std[0] < 1e-3


def test_several_experiments_share_the_parameters() -> None:
    """One feed per tooth tells one k_c only; a second one tells k_c1.1 and z (Kienzle)."""
    truth = {"drill.k_c11": 2.24e9, "drill.z": 0.21}  # 34CrMo4, as printed in the paper
    rng = np.random.default_rng(2)
    model = acausal.compile(ThinPlate())
    sets = []
    for v in (0.8e-3, 1.672e-3, 3.5e-3):
        run = acausal.simulate(model, parameters={"v": v, **truth}, stop_time=3.0, output_interval=0.02)
        forces = run["drill.F_c"] + rng.normal(0.0, 20.0, len(run.time))
        sets.append(Dataset({"drill.F_c": (run.time, forces)}, parameters={"v": v}))
    guess = {"drill.k_c11": 1.7e9, "drill.z": 0.3}
    found = fit(model, sets, list(truth), parameters=guess)
    for (low, high), true in zip(found.interval, truth.values(), strict=True):
        assert low <= true <= high
    assert found.std[0] < 0.02 * truth["drill.k_c11"]
    assert found.runs <= 18  # of all three together; derivatives by both parameters take a fifth of a run each
    assert found.gradients <= found.runs
    alone = fit(model, sets[1], list(truth), parameters=guess)
    assert any("combination of drill.k_c11, drill.z" in note for note in alone.notes)


CASES: dict[str, tuple[Callable[[], object], str, str]] = {
    "no such column": (lambda: fit(Line(), {"z": (TIMES, TIMES)}, ["a"]), "AC055", "'z'"),
    "nothing to compare": (lambda: fit(Lag(), {"u": (TIMES, TIMES)}, ["T"]), "AC055", "nothing"),
    "no data": (lambda: fit(Line(), 3.0, ["a"]), "AC055", "float"),
    "no such parameter": (lambda: fit(Line(), {"y": (TIMES, TIMES)}, ["aa"]), "AC056", "'aa'"),
    "bound parameter": (lambda: fit(Oscillator(), swing(1.0, 1.0), ["mass.m"]), "AC056", "mass.m"),
    "no parameter": (lambda: fit(Line(), {"y": (TIMES, TIMES)}, []), "AC056", "no parameter"),
    "outside its limits": (lambda: fit(Line(), {"y": (TIMES, TIMES)}, {"a": (1.0, 2.0)}), "AC056", "starts at 0.5"),
    "too few values": (lambda: fit(Line(), {"y": (TIMES[:2], TIMES[:2])}, ["a", "b"]), "AC057", "2 measured values"),
    "before the start": (lambda: fit(Line(), {"y": (TIMES - 1.0, TIMES)}, ["a"]), "AC011", "-1 s"),
    "a value of its own": (
        lambda: fit(Line(), [Dataset({"y": (TIMES, TIMES)}, parameters={"a": float(k)}) for k in (1, 2)], ["a"]),
        "AC056",
        "one value for all experiments",
    ),
    "no deviation": (lambda: fit(Line(), Dataset({"y": (TIMES, TIMES)}, sigma={"y": 0.0}), ["a"]), "AC055", "sigma"),
}


FRAMES: dict[str, tuple[Callable[[], object], str]] = {
    "no columns": (lambda: pandas.DataFrame(index=TIMES), "no measurement"),
    "two columns of one name": (
        lambda: pandas.DataFrame({"y [m/m]": TIMES, "y": TIMES}, index=TIMES),
        "two columns 'y'",
    ),
    "texts": (lambda: pandas.DataFrame({"y": ["1 m"] * len(TIMES)}, index=TIMES), "does not consist of numbers"),
    "dates": (lambda: pandas.DataFrame({"y": TIMES}, index=pandas.to_datetime(TIMES, unit="s")), "dates"),
}


@pytest.mark.parametrize("case", FRAMES)
def test_a_frame_that_holds_no_measurements_is_refused(case: str) -> None:
    call, words = FRAMES[case]
    with fails_with(AcausalError, "AC055", match=words):
        fit(Line(), call(), ["a"])


class Ending(Component):
    """x = exp(-k t), which is over below 0.1."""

    k: Real = parameter(default=1.0, unit="1/s")
    x: Real = variable(default=fixed(1.0))

    def equations(self) -> Equations:
        yield der(self.x) == -self.k * self.x
        yield acausal.when(self.x < 0.1, acausal.terminate("empty"))


def test_a_run_that_ends_before_the_data_is_no_candidate() -> None:
    """Runs with k above ln(10)/2 end early: the search may try some, and cannot begin there."""
    times = np.linspace(0.0, 2.0, 21)
    data = {"x": (times, np.exp(-1.1 * times))}
    found = fit(Ending(), data, {"k": ("6 1/min", 9.0)}, parameters={"k": 0.2})
    assert found.value == pytest.approx([1.1], rel=1e-6)
    with fails_with(AcausalError, "AC011", match="the data end at 2 s"):
        fit(Ending(), data, ["k"], parameters={"k": 3.0})


class Cooling(Component):
    """T' = k (T_end - T) from 300 K."""

    k: Real = parameter(default=1.0, unit="1/s")
    T_end: Real = parameter(default=350.0, unit="K")
    T: Real = variable(default=fixed(300.0), unit="K")

    def equations(self) -> Equations:
        yield der(self.T) == self.k * (self.T_end - self.T)


@pytest.mark.parametrize("form", ["frame", "frame with times", "csv", "series in degF"])
def test_a_column_of_temperatures_is_not_taken_for_the_time(form: str, tmp_path: Path) -> None:
    values = 400.0 - 100.0 * np.exp(-1.7 * TIMES)
    if form == "frame":
        data: object = pandas.DataFrame({"T [degC]": values - 273.15}, index=TIMES)
    elif form == "frame with times":
        data = pandas.DataFrame({"T": values, "t [ms]": 1e3 * TIMES})
    elif form == "csv":
        rows = [f"{v!r},{t!r}" for v, t in zip(values.tolist(), TIMES.tolist(), strict=True)]
        (tmp_path / "T.csv").write_text("\n".join(["T,t", *rows]))
        data = str(tmp_path / "T.csv")
    else:
        data = {"T": acausal.TimeSeries(TIMES, 1.8 * (values - 273.15) + 32.0, unit="degF")}
    found = fit(Cooling(), data, ["k", "T_end"])
    assert found.value == pytest.approx([1.7, 400.0], rel=1e-6)


class Switched(Component):
    """y = h exp(-k t), and 3 more from an instant on."""

    k: Real = parameter(default=1.0, unit="1/s")
    h: Real = parameter(default=1.0)
    at: Real = parameter(default=0.5, unit="s")
    x: Real = variable(default=fixed(1.0))
    y: Real = variable()

    def equations(self) -> Equations:
        yield der(self.x) == -self.k * self.x
        yield self.y == self.h * self.x + acausal.where(acausal.time > self.at, 3.0, 0.0)


@pytest.mark.parametrize("by_name", [True, False])
def test_a_fit_to_a_run_that_jumps_finds_its_parameters(by_name: bool) -> None:
    """A run has two rows at a jump, the values before and after it: an undisturbed run is fitted without residuals."""
    model, truth = acausal.compile(Switched()), {"k": 1.3, "h": 2.0}
    run = acausal.simulate(model, parameters={"at": 0.31, **truth}, stop_time=1.0, output_interval=0.1)
    data: object = {"y": (run.time, run["y"])} if by_name else run
    found = fit(model, data, list(truth), parameters={"at": 0.31})
    assert found.value == pytest.approx(list(truth.values()), rel=1e-6)
    assert max(found.rms.values()) < 1e-7


def test_a_jump_of_the_data_is_compared_with_that_of_the_run() -> None:
    """The ball bounces at another time with each parameter tried."""
    model, truth = acausal.compile(BouncingBall()), {"e": 0.7, "h0": 1.3}
    run = acausal.simulate(model, parameters=truth, stop_time=1.5, output_interval=0.1)
    data = {name: (run.time, run[name]) for name in ("h", "v")}
    found = fit(model, data, list(truth), parameters={"e": 0.74, "h0": 1.35})
    assert found.value == pytest.approx(list(truth.values()), rel=1e-6)
    shown = np.asarray(found.plot().axes[3].get_lines()[0].get_ydata())  # of v, which jumps by metres per second
    unit = readable(found.results[0].unit("v"), 3.0 * found.rms["v"]).slope
    assert np.abs(shown).max() / unit < 1e-4


@pytest.mark.parametrize("case", CASES)
def test_what_cannot_be_fitted_is_refused(case: str) -> None:
    call, code, words = CASES[case]
    with fails_with(AcausalError, code) as caught:
        call()
    assert words in str(caught.value)


@pytest.mark.slow
def test_the_command_prints_what_was_found(tmp_path: Path) -> None:
    file, picture = tmp_path / "swing.csv", tmp_path / "fit.png"
    data = swing(110.0, 1.2)
    rows = zip(data["mass.s"][0], 1e3 * data["mass.s"][1], data["mass.v"][1], strict=True)
    text = ["time [s],mass.s [mm],mass.v [m/s]", *(",".join(f"{x:.9g}" for x in row) for row in rows)]
    file.write_text("\n".join(text))
    shown = CliRunner().invoke(app, ["fit", "Oscillator", str(file), "--free", "c,d=0:5", "--plot-file", str(picture)])
    assert shown.exit_code == 0
    assert "95 % interval" in shown.output
    assert picture.stat().st_size > 10_000
    again = CliRunner().invoke(app, ["fit", "Oscillator", str(file), "--free", "c,d=0:5", "--json"])
    values = {p["name"]: p for p in json.loads(again.output)["parameters"]}
    assert values["c"]["low"] <= 110.0 <= values["c"]["high"]
    assert values["d"]["unit"] == "N.s/m"
    twice = CliRunner().invoke(app, ["fit", "Oscillator", str(file), str(file), "--free", "c"])
    assert twice.exit_code == 2


def test_noise_and_limits_have_units_on_the_command_line(tmp_path: Path) -> None:
    """A deviation of 0.5 degC is one of 0.5 K; a limit of 40 degC is 313.15 K (SI brochure, section 2.3.1)."""
    t = np.linspace(0.0, 3.0, 7)
    file = tmp_path / "warm.csv"
    file.write_text("\n".join(["time [s],T [degC]", *(f"{x},{20.0 + 50.0 * np.exp(-x)}" for x in t)]))
    model = tmp_path / "warm.py"
    model.write_text(
        "from acausal import Component, Equations, Real, der, fixed, parameter, variable\n\n\n"
        "class Warm(Component):\n"
        '    T0: Real = parameter(default=290.0, unit="K")\n'
        '    k: Real = parameter(default=1.0, unit="1/s")\n'
        '    T: Real = variable(default=fixed(343.15), unit="K")\n\n'
        "    def equations(self) -> Equations:\n"
        "        yield der(self.T) == -self.k * (self.T - self.T0)\n"
    )

    def std(sigma: str, limits: str) -> tuple[float, float]:
        words = ["fit", str(model), str(file), "--free", f"T0={limits}", "--sigma", f"T={sigma}", "--json"]
        (found,) = json.loads(CliRunner().invoke(app, words).output)["parameters"]
        return found["value"], found["std"]

    assert std("0.5degC", "10degC:40degC") == std("0.5", "283.15:313.15")
    assert std("0.5", "10degC:40degC")[0] == pytest.approx(293.15, abs=1e-3)


class Turning(Component):
    """x' = -1 from b on, and y' = sign(x) without an event: the derivative of y by b is that of an instant."""

    b: Real = parameter(default=0.5)
    x: Real = variable()
    y: Real = variable(default=fixed(0.0))

    def initial_equations(self) -> Equations:
        yield self.x == self.b

    def equations(self) -> Equations:
        yield der(self.x) == -1.0
        yield der(self.y) == no_event(sign(self.x))


def test_a_jump_without_an_event_is_fitted_by_differences() -> None:
    """y(t) = t up to b, and 2 b - t from there on; derivatives between events know nothing of b."""
    times, b = np.linspace(0.0, 1.0, 21), 0.3137
    found = fit(Turning(), {"y": (times, np.where(times < b, times, 2.0 * b - times))}, ["b"])
    assert found.value[0] == pytest.approx(b, abs=1e-4)


@pytest.mark.parametrize(("limits", "code"), [("c=1:2:3", "AC009"), ("c=3", "AC009"), ("c=xinf:3", "AC152")])
def test_limits_that_cannot_be_read_are_refused(tmp_path: Path, limits: str, code: str) -> None:
    """PATH=LOW:HIGH, each a number with an optional unit."""
    file = tmp_path / "swing.csv"
    file.write_text("time [s],mass.s [m]\n0,0.1\n1,0.05\n2,0.03\n")
    shown = CliRunner().invoke(app, ["fit", "Oscillator", str(file), "--free", limits])
    assert shown.exit_code == 2, shown.output
    assert code in shown.output
    assert limits in shown.output


def test_a_search_that_begins_where_a_parameter_has_no_effect_does_not_stall() -> None:
    """n = t - max(1/p, 1/q) with q = 1: at p = 1 slopes are rounding errors on one side, and 1 on the other."""
    t = np.linspace(0.0, 2.0, 41)
    found = fit(Both(), {"n": (t, np.maximum(0.0, t - 1.0 / 0.9))}, ["p"], parameters={"p": 1.0})
    assert found.parameters["p"] == pytest.approx(0.9, abs=1e-6)


class Circle(Component):
    """A point at the angle p on the unit circle."""

    p: Real = parameter(default=0.0)
    x: Real = variable()
    y: Real = variable()

    def equations(self) -> Equations:
        yield self.x == cos(self.p)
        yield self.y == sin(self.p)


def test_a_guess_at_a_maximum_is_left() -> None:
    """The sum of squares for a point at (-1, 0) is 2 + 2 cos p for each row: p = 0 is its maximum, pi its minimum."""
    found = fit(Circle(), {"x": (TIMES, -np.ones(41)), "y": (TIMES, np.zeros(41))}, ["p"])
    assert abs(found.parameters["p"]) == pytest.approx(np.pi, abs=1e-5)


def test_columns_of_parameters_do_not_give_them_away(tmp_path: Path) -> None:
    """A file of a run has columns of its parameters; the estimate is that of the normal equations, not that column."""
    y = noisy_line(3)
    alone = fit(Line(), {"y": (TIMES, y)}, ["a"])
    rows = "\n".join(f"{t!r},{v!r},0.7" for t, v in zip(TIMES.tolist(), y.tolist(), strict=True))
    (tmp_path / "line.csv").write_text(f"time,y,a\n{rows}\n")
    found = fit(Line(), str(tmp_path / "line.csv"), ["a"])
    np.testing.assert_array_equal(found.value, alone.value)
    np.testing.assert_array_equal(found.std, alone.std)
    assert "columns of parameters are not compared" in found.notes[-1]


def test_all_settings_of_the_command_line_count(tmp_path: Path) -> None:
    """x = k (r0 + r1) t = 12 t: with r = (1, 2) k is 4, and with r = (2, 4), an array, it is 2."""
    (tmp_path / "sums.py").write_text(
        "from acausal import Component, Equations, Real, der, fixed, parameter, variable\n\n\n"
        "class Sums(Component):\n"
        "    k: Real = parameter(default=1.0)\n"
        "    r: Real = parameter(default=(1.0, 2.0), shape=2)\n"
        "    x: Real = variable(default=fixed(0.0))\n\n"
        "    def equations(self) -> Equations:\n"
        "        yield der(self.x) == self.k * (self.r[0] + self.r[1])\n"
    )
    (tmp_path / "data.csv").write_text("time,x\n0,0\n1,12\n2,24\n")
    words = ["fit", f"{tmp_path}/sums.py", f"{tmp_path}/data.csv", "--free", "k", "--set", "r=2,4", "--set", "k=3"]
    (found,) = json.loads(CliRunner().invoke(app, [*words, "--json"]).output)["parameters"]
    assert found["value"] == pytest.approx(2.0)
    # the command to run it keeps them, but for the guess
    assert "sums.py --set r=2,4 --set k=2\n" in CliRunner().invoke(app, words).output
