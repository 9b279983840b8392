"""Inputs over time: functions, series, files, results; every solver, events, delays and samples."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import acausal
from acausal import (
    Component,
    Equations,
    Real,
    TimeSeries,
    boolean,
    connect,
    der,
    discrete,
    fixed,
    integer,
    part,
    pre,
    reset,
    sample,
    signal_input,
    variable,
    when,
    where,
)
from acausal.errors import AcausalError
from acausal.library.blocks import FirstOrder, FixedDelay, Ramp
from acausal.library.rotational import Inertia, Speed
from acausal.lower.variants.started import with_driven
from tests.expected import fails_with
from tests.marks import slow_but

W, T = 3.0, 0.5


class Lag(Component):
    """First-order lag of half a second."""

    u: Real = signal_input(unit="V", min=-10.0, max=10.0, doc="Voltage")
    offset: Real = signal_input(unit="V", default=0.0)
    x: Real = variable(unit="V", default=fixed(0.0))

    def equations(self) -> Equations:
        yield T * der(self.x) == acausal.unitless(self.u + self.offset - self.x)


@pytest.fixture(scope="module")
def lag() -> acausal.lower.compiled.CompiledModel:
    return acausal.compile(Lag())


def sine_answer(t: Any) -> Any:
    """Answer of the lag to sin(W t) from 0: variation of constants."""
    return (np.sin(W * t) - W * T * np.cos(W * t) + W * T * np.exp(-t / T)) / (1.0 + (W * T) ** 2)


@pytest.mark.parametrize(
    ("solver", "options", "within"),
    [
        ("idas", {"tolerance": 1e-8}, 1e-7),
        ("cvodes", {"tolerance": 1e-8}, 1e-7),
        ("rosenbrock", {"tolerance": 1e-8}, 1e-8),
        ("erk", {"tolerance": 1e-8}, 1e-8),
        ("collocation", {"step": 1e-2}, 1e-7),
        ("rk", {"step": 1e-2}, 1e-6),
        ("rk2", {"step": 1e-3}, 1e-5),
    ],
)
def test_a_function_of_time_with_every_solver(lag: Any, solver: str, options: Any, within: float) -> None:
    result = acausal.simulate(
        lag, inputs={"u": lambda t: np.sin(W * t)}, stop_time=4.0, solver=solver, native=False, **options
    )
    assert np.abs(result["x"] - sine_answer(result.time)).max() < within
    assert np.abs(result["u"] - np.sin(W * result.time)).max() < 1e-6
    assert result.at(1.2345, "x") == pytest.approx(sine_answer(1.2345), abs=within)
    assert not result.events  # it is smooth


@pytest.mark.slow
@pytest.mark.parametrize("solver", ["rosenbrock", "erk", "idas", "cvodes"])
def test_compiled_equations_take_inputs_over_time(lag: Any, solver: str) -> None:
    result = acausal.simulate(
        lag, inputs={"u": lambda t: np.sin(W * t)}, stop_time=4.0, solver=solver, tolerance=1e-8, native=True
    )
    assert result.stats["native"]
    assert np.abs(result["x"] - sine_answer(result.time)).max() < 1e-7


def lines_answer(t: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Answer of the lag at the rows to straight lines through them: exact on each, from 0."""
    x = np.zeros(len(t))
    for k, (h, a, b) in enumerate(zip(np.diff(t), u[:-1], u[1:], strict=True)):
        slope = (b - a) / h
        x[k + 1] = b - slope * T + (x[k] - a + slope * T) * np.exp(-h / T)
    return x


@pytest.mark.parametrize("solver", ["rosenbrock", "idas"])
def test_measured_noise_in_straight_lines(lag: Any, solver: str) -> None:
    t = np.linspace(0.0, 2.0, 201)
    u = np.sin(W * t) + 0.2 * np.random.default_rng(3).standard_normal(len(t))
    result = acausal.simulate(lag, inputs={"u": (t, u)}, stop_time=2.0, solver=solver, tolerance=1e-7, native=False)
    assert np.abs(result.at(t, "x") - lines_answer(t, u)).max() < 1e-6
    assert not result.events  # kinks are no events of the model


def test_what_a_solver_cannot_see_does_not_cut_the_run(lag: Any) -> None:
    """Ten thousand rows of a sine, at a tolerance at which lines and sine are one: a few polynomials, not 10 000."""
    t = np.linspace(0.0, 4.0, 10_001)
    result = acausal.simulate(lag, inputs={"u": (t, np.sin(W * t))}, stop_time=4.0, tolerance=1e-5)
    assert np.abs(result["x"] - sine_answer(result.time)).max() < 1e-4
    assert result.stats["segments"] < 30  # type: ignore[operator]


def test_held_values_jump_and_each_jump_is_an_event(lag: Any) -> None:
    """1 V from 0, -1 V from 0.7 s: exponentials."""
    series = TimeSeries([0.0, 0.3, 0.7, 2.0], [1.0, 1.0, -1.0, 5.0], "hold")
    result = acausal.simulate(lag, inputs={"u": series}, stop_time=2.0, tolerance=1e-8)
    t = result.time
    first = 1.0 - np.exp(-t / T)
    second = -1.0 + (2.0 - np.exp(-0.7 / T)) * np.exp(-(t - 0.7) / T)
    assert np.abs(result["x"] - np.where(t < 0.7, first, second)).max() < 1e-7
    assert [e.time for e in result.events] == [0.7]


@pytest.mark.parametrize("corner", ["jump", "kink", "pulse"])
def test_a_function_with_a_corner(lag: Any, corner: str) -> None:
    """Located by halving: no solver has to find it. Reference: the same as exact rows."""
    at = 1.0 / 3.0
    functions = {
        "jump": (lambda t: 0.0 if t < at else 1.0, [0.0, at, at, 2.0], [0.0, 0.0, 1.0, 1.0]),
        "kink": (lambda t: max(t - at, 0.0), [0.0, at, 2.0], [0.0, 0.0, 2.0 - at]),
        "pulse": (lambda t: float(at < t < at + 0.02), [0.0, at, at, at + 0.02, at + 0.02, 2.0], [0, 0, 1, 1, 0, 0]),
    }
    function, t, u = functions[corner]
    a = acausal.simulate(lag, inputs={"u": function}, stop_time=2.0, tolerance=1e-8)
    b = acausal.simulate(lag, inputs={"u": (t, u)}, stop_time=2.0, tolerance=1e-8)
    assert np.abs(a.at(b.time, "x") - b["x"])[b.time != at].max() < 1e-7


def test_other_data_are_other_numbers(lag: Any) -> None:
    """A second run of the same object is that of a fresh one, to the last bit, and compiles nothing."""
    first = acausal.simulate(lag, inputs={"u": lambda t: 1.0 + t}, stop_time=1.0)
    second = acausal.simulate(lag, inputs={"u": ([0.0, 0.4, 1.0], [0.0, 2.0, 1.0])}, stop_time=1.0)
    fresh = acausal.compile(Lag(), cache=False)
    again = acausal.simulate(fresh, inputs={"u": ([0.0, 0.4, 1.0], [0.0, 2.0, 1.0])}, stop_time=1.0)
    assert (second["x"] == again["x"]).all()
    assert first.final("x") != second.final("x")
    assert with_driven(lag, (0,)) is with_driven(lag, (0,))
    constant = acausal.simulate(lag, inputs={"u": 2.0, "offset": 1.0}, stop_time=1.0, tolerance=1e-8)
    assert constant.final("x") == pytest.approx(3.0 * (1.0 - np.exp(-1.0 / T)), rel=1e-6)


class Switched(Component):
    """A guard on the input, a sample of it, an algebraic loop through it, and what it was before."""

    u: Real = signal_input()
    on: Real = variable()
    x: Real = variable(default=fixed(0.0))
    z: Real = variable()
    held: Real = discrete()
    delay: FixedDelay = FixedDelay(delay_time=0.3)

    def equations(self) -> Equations:
        yield connect(self.u, self.delay.u)
        yield self.on == where(self.u > 0.5, 1.0, 0.0)
        yield der(self.x) == self.on
        yield self.z + 0.1 * acausal.sin(self.z) == self.u
        yield when(sample(0.05, 0.25), reset(self.held, self.u))


@pytest.mark.parametrize("solver", ["idas", "rosenbrock"])
def test_guards_samples_delays_and_algebraic_variables_see_the_input(solver: str) -> None:
    """sin(t) is above one half from pi/6 to 5 pi/6."""
    result = acausal.simulate(Switched(), inputs={"u": np.sin}, stop_time=3.0, tolerance=1e-8, solver=solver)
    assert result.final("x") == pytest.approx(2.0 * np.pi / 3.0, abs=1e-6)
    assert result.final("held") == pytest.approx(np.sin(2.8), abs=1e-7)
    t, z = result.time, result["z"]
    assert np.abs(z + 0.1 * np.sin(z) - np.sin(t)).max() < 1e-6
    late = t > 0.3
    assert np.abs(result["delay.y"] - np.sin(t - 0.3))[late].max() < 1e-6
    crossings = [e.time for e in result.events if "u" in e.condition]
    assert min(abs(c - np.pi / 6.0) for c in crossings) < 1e-6


class Ball(Component):
    """A bouncing ball that is shaken."""

    u: Real = signal_input(unit="m/s2")
    h: Real = variable(unit="m", default=fixed(1.0))
    v: Real = variable(unit="m/s", default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.h) == self.v
        yield der(self.v) == self.u - acausal.quantity(9.81, "m/s2")
        yield when(self.h < 0, reset(self.v, -0.7 * pre(self.v)))


@pytest.mark.parametrize("solver", ["rosenbrock", "idas", "erk", "cvodes"])
def test_bounces_on_measured_rows(solver: str) -> None:
    """Reference: scipy's DOP853 from row to row, each bounce located by it."""
    t = np.linspace(0.0, 1.2, 61)
    u = 2.0 * np.sin(7.0 * t)
    y, bounces = np.array([1.0, 0.0]), []
    for a, b in pairwise(t):
        hit = lambda _, y: y[0]  # noqa: E731
        hit.terminal, hit.direction = True, -1  # type: ignore[attr-defined]
        while a < b:
            rates = lambda s, y: [y[1], np.interp(s, t, u) - 9.81]  # noqa: E731
            found = solve_ivp(rates, (a, b), y, "DOP853", events=hit, rtol=1e-12, atol=1e-13)
            a, y = found.t[-1], found.y[:, -1]
            if found.status == 1:
                bounces.append(a)
                y = np.array([0.0, -0.7 * y[1]])
    result = acausal.simulate(Ball(), inputs={"u": (t, u)}, stop_time=1.2, solver=solver, tolerance=1e-9, native=False)
    assert [e.time for e in result.events] == pytest.approx(bounces, abs=1e-8)
    assert (result.final("h"), result.final("v")) == pytest.approx(tuple(y), abs=1e-7)


class Driven(Component):
    """A ramp into a lag."""

    ramp: Ramp = Ramp(duration=1.0, height=2.0, start_time=0.3)
    lag: FirstOrder = FirstOrder(T=T, y=fixed(0.0))
    other: FirstOrder = FirstOrder(T=T, y=fixed(0.0))

    def equations(self) -> Equations:
        yield connect(self.lag.u, self.ramp.y, self.other.u)


def test_a_freed_source_is_replayed() -> None:
    whole = acausal.simulate(Driven(), stop_time=3.0, tolerance=1e-8)
    open_ = acausal.compile(acausal.free(Driven(), "lag.u"))
    assert open_.inputs == ("lag.u",)
    again = acausal.simulate(open_, inputs={"lag.u": whole}, stop_time=3.0, tolerance=1e-8)
    assert np.abs(again["lag.y"] - whole.at(again.time, "lag.y")).max() < 1e-7
    other = acausal.simulate(open_, inputs={"lag.u": 0.0}, stop_time=3.0, tolerance=1e-8)
    assert np.abs(other["lag.y"]).max() == 0.0
    assert other.final("other.y") == pytest.approx(whole.final("other.y"), abs=1e-7)  # still driven by the ramp
    named = acausal.simulate(open_, inputs={"lag.u": (whole, "ramp.y")}, stop_time=3.0, tolerance=1e-8)
    assert (named["lag.y"] == again["lag.y"]).all()


class ByEquation(Component):
    """Inputs of parts given by an equation of the owner and where the part is made."""

    k: Real = acausal.parameter(default=2.0)
    a: FirstOrder = FirstOrder(T=T, y=fixed(0.0))
    b: FirstOrder = part()

    def build(self) -> None:
        self.b = FirstOrder(T=T, y=fixed(0.0), u=3.0 * self.k)

    def equations(self) -> Equations:
        yield self.a.u == self.k


def test_equations_and_bindings_are_cut() -> None:
    compiled = acausal.compile(acausal.free(ByEquation(), "a.u", "b.u"))
    assert compiled.inputs == ("a.u", "b.u")
    result = acausal.simulate(compiled, inputs={"a.u": 1.0, "b.u": lambda t: t}, stop_time=2.0, tolerance=1e-8)
    decay = np.exp(-2.0 / T)
    assert result.final("a.y") == pytest.approx(1.0 - decay, rel=1e-6)
    assert result.final("b.y") == pytest.approx(2.0 - T + T * decay, rel=1e-6)


@pytest.mark.parametrize("names", [("a.u", "a.u"), ("b.u", "a.u", "b.u")])
def test_an_input_is_freed_once(names: tuple[str, ...]) -> None:
    with fails_with(AcausalError, "AC047", match="twice"):
        acausal.free(ByEquation(), *names)


@pytest.mark.parametrize(("name", "words"), [("lag.x", "lag.u"), ("ramp.y", "output"), ("lag.T", "parameter")])
def test_what_is_no_input_cannot_be_freed(name: str, words: str) -> None:
    with fails_with(AcausalError, "AC047") as error:
        acausal.compile(acausal.free(Driven(), name))
    assert words in str(error.value)


class Spun(Component):
    """An inertia that follows a ramp of its speed."""

    ramp: Ramp = Ramp(duration=1.0)
    speed: Speed = Speed(phi=fixed(0.0))
    inertia: Inertia = Inertia(J=2.0)

    def equations(self) -> Equations:
        yield connect(self.ramp.y, self.speed.w_ref)
        yield connect(self.speed.flange, self.inertia.flange_a)


def test_an_input_whose_derivative_is_needed_is_named() -> None:
    """The torque needs the acceleration; the same with a filter in between has it."""
    with fails_with(AcausalError, "AC207") as error:
        acausal.compile(acausal.free(Spun(), "speed.w_ref"))
    assert "speed.w_ref" in str(error.value)


def test_start_values_of_a_run(lag: Any) -> None:
    """Free decay from 3 V; the model itself keeps its own start, and another value is not the one before."""
    for start in (3.0, -1.0):
        result = acausal.simulate(lag, inputs={"u": 0.0}, start={"x": start}, stop_time=1.0, tolerance=1e-8)
        assert result.final("x") == pytest.approx(start * np.exp(-1.0 / T), rel=1e-6)
    assert acausal.simulate(lag, inputs={"u": 0.0}, stop_time=1.0).final("x") == 0.0
    both = acausal.simulate(lag, inputs={"u": lambda t: 0.0 * t}, start={"x": 3.0}, stop_time=1.0, tolerance=1e-8)
    assert both.final("x") == pytest.approx(3.0 * np.exp(-1.0 / T), rel=1e-6)


class Bound(Component):
    """Two positions at a fixed distance."""

    a: Real = variable(default=fixed(0.0))
    b: Real = variable(default=fixed(1.0))

    def equations(self) -> Equations:
        yield der(self.a) == -self.a
        yield self.b == self.a + 1.0


class Counted(Component):
    """A number of ticks, and whether it is odd."""

    n: Real = integer()
    odd: Real = boolean()

    def equations(self) -> Equations:
        yield when(sample(0.5, 0.5), reset(self.n, pre(self.n) + 1), reset(self.odd, ~pre(self.odd)))


class Told(Component):
    """A boolean that its equation decides, and a count that begins with a tick."""

    x: Real = variable(default=fixed(1.0))
    low: Real = boolean()
    n: Real = integer()

    def equations(self) -> Equations:
        yield der(self.x) == -self.x
        yield self.low == (self.x < 0.5)
        yield when(sample(0.0, 1.0), reset(self.n, pre(self.n) + 1))


def test_a_discrete_start_that_does_not_hold_is_told() -> None:
    result = acausal.simulate(Told(), start={"low": True, "n": 4}, stop_time=0.1)
    assert (result["low"][0], result["n"][0]) == (0, 5)
    notes = result.stats["notes"]
    assert isinstance(notes, tuple)
    assert [note.split(",")[0] for note in notes] == [
        "low was given the start 1",
        "n was given the start 4",
    ]
    assert acausal.simulate(Told(), start={"low": False}, stop_time=0.1).stats["notes"] == ()


def test_start_values_are_of_their_kind() -> None:
    """An integer that began at 1.5 would go on in halves, and a boolean at 0.7 be neither."""
    result = acausal.simulate(Counted(), start={"n": 7, "odd": True}, stop_time=1.7)
    assert (result.final("n"), result.final("odd")) == (10, 0)
    assert result.stats["notes"] == ()
    for wrong in ({"n": 1.5}, {"odd": 0.7}):
        with pytest.raises(AcausalError, match="AC046"):
            acausal.simulate(Counted(), start=wrong, stop_time=1.7)


def test_start_values_must_agree_with_the_declared_ones() -> None:
    with fails_with(AcausalError, "AC302") as error:
        acausal.simulate(Bound(), start={"a": 2.0}, stop_time=1.0)
    assert "give b in start={...} too" in str(error.value)
    with pytest.raises(AcausalError, match=r"(?s)AC302.*out of start=") as error:
        acausal.simulate(Bound(), start={"a": 2.0, "b": 4.0}, stop_time=1.0)
    assert acausal.simulate(Bound(), start={"a": 2.0, "b": 3.0}, stop_time=1.0)["b"][0] == 3.0


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        ({"start": {"xx": 1.0}}, "AC046", "did you mean x"),
        ({"start": {"u": 1.0}}, "AC046", "input"),
        ({"start": {"x": float("nan")}}, "AC046", "finite"),
        ({"inputs": {"u": 11.0}}, "AC136", "-10 ... 10"),
        ({"inputs": {"u": lambda t: 20.0 * t}}, "AC136", "-10 ... 10"),
        ({"inputs": {"u": ([0.0, 1.0], [0.0, 11.0])}}, "AC136", "-10 ... 10"),
        ({"inputs": {"u": ([0.0, 0.5], [0.0, 1.0])}}, "AC044", "from 0 s to 0.5 s"),
        ({"inputs": {"u": ([0.0, 0.5, 0.4, 1.0], [0.0, 1.0, 1.0, 1.0])}}, "AC044", "row 3"),
        ({"inputs": {"u": ([0.0, 0.5, 1.0], [0.0, np.nan, 1.0])}}, "AC044", "row 2"),
        ({"inputs": {"u": lambda t: "x"}}, "AC044", "t = 0 s"),
        ({"inputs": {"u": lambda t: 1.0 / (t - 0.5)}}, "AC044", "t = 0.5 s"),
        pytest.param(
            *({"inputs": {"u": lambda t: np.random.default_rng(int(t * 1e15)).random()}}, "AC044", "varies too fast"),
            marks=pytest.mark.slow,
        ),
        ({"inputs": {"u": TimeSeries([0.0, 1.0], [0.0, 1.0], unit="N")}}, "AC151", "in N does not fit input u in V"),
        ({"inputs": {}}, "AC033", "input u has no value"),
        ({"inputs": {"u": "missing.csv"}}, "AC014", "missing.csv"),
    ],
)
def test_what_is_wrong_is_named(lag: Any, arguments: dict[str, Any], code: str, words: str) -> None:
    with fails_with(AcausalError, code) as error:
        acausal.simulate(lag, **{"stop_time": 1.0, "inputs": {"u": 1.0}, **arguments})
    assert words in str(error.value)


def test_sensitivities_take_constants_and_linearize_a_time_of_the_run(lag: Any) -> None:
    driven: Any = {"lag.u": np.sin}
    with fails_with(AcausalError, "AC033"):
        acausal.sensitivities(acausal.free(Driven(), "lag.u"), ["lag.T"], ["lag.y"], inputs=driven, stop_time=1.0)
    result = acausal.simulate(lag, inputs={"u": np.sin}, stop_time=2.0, tolerance=1e-8)
    linear = acausal.linearize(lag, 1.0, result=result)
    assert linear.u[0] == pytest.approx(np.sin(1.0), abs=1e-7)


@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_a_file_with_units_in_its_first_row(tmp_path: Path, lag: Any, separator: str) -> None:
    """Milliseconds and millivolts: the ramp 2 t."""
    file = tmp_path / "u.csv"
    rows = ["time [ms],voltage [mV],other", "# measured", *(f"{t},{2 * t},0" for t in (0.0, 100.5, 1000.0))]
    file.write_text("\n".join(rows).replace(",", separator))
    result = acausal.simulate(lag, inputs={"u": f"{file}:voltage"}, stop_time=1.0, tolerance=1e-8)
    assert np.abs(result["u"] - 2.0 * result.time).max() < 1e-12
    assert result.final("x") == pytest.approx(2.0 * (1.0 - T + T * np.exp(-1.0 / T)), rel=1e-6)


def test_decimal_commas(tmp_path: Path, lag: Any) -> None:
    file = tmp_path / "u.csv"
    file.write_text("time [s];u [V]\n0,0;0,5\n1,0;1,5\n")
    result = acausal.simulate(lag, inputs={"u": str(file)}, stop_time=1.0)
    assert np.abs(result["u"] - 0.5 - result.time).max() < 1e-12


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("x,u\n0,0\n1,1\n", "no column of times"),
        ("time,v\n0,0\n1,x\n", "u.csv:3: v is 'x'"),
        ("time,v,w\n0,0,0\n1,1,1\n", "2 columns besides the time"),
        ("time,v\n", "no row of numbers"),
        ("time,v\n0,0,5\n1,1,5\n", "u.csv:2: 2 names and 3 columns"),  # decimal commas
    ],
)
def test_a_wrong_file_is_named(tmp_path: Path, lag: Any, text: str, words: str) -> None:
    file = tmp_path / "u.csv"
    file.write_text(text)
    with fails_with(AcausalError, "AC045") as error:
        acausal.simulate(lag, inputs={"u": str(file)}, stop_time=1.0)
    assert words in str(error.value)


def test_pandas(lag: Any) -> None:
    pandas = pytest.importorskip("pandas")
    t = np.linspace(0.0, 1.0, 11)
    table = pandas.DataFrame({"time [ms]": 1e3 * t, "u [mV]": 2e3 * t, "other": 0.0 * t})
    for data in (table, pandas.Series(2.0 * t, index=t)):
        result = acausal.simulate(lag, inputs={"u": data}, stop_time=1.0)
        assert np.abs(result["u"] - 2.0 * result.time).max() < 1e-12


def test_a_column_of_a_table_of_a_run_drives_a_model() -> None:
    """`to_pandas` keeps the units of all signals on each of its columns."""
    pytest.importorskip("pandas")
    made = acausal.simulate(Lag(), inputs={"u": lambda t: 1.0 + t}, stop_time=1.0)
    column = acausal.simulate(Lag(), inputs={"u": made.to_pandas()["u"]}, stop_time=1.0)
    pair = acausal.simulate(Lag(), inputs={"u": (made.time, made["u"])}, stop_time=1.0)
    assert np.array_equal(column.matrix, pair.matrix)


@pytest.mark.parametrize("amplitude", slow_but([1e-13, 1e-9, 1e-5], 1e-13, 1e-5))
@pytest.mark.parametrize("form", ["function", "smooth", "linear"])
def test_an_input_that_hardly_changes_is_followed(amplitude: float, form: str) -> None:
    """x' = u - 300 with u = 300 + a sin(3 t) ends at a (1 - cos(6))/3, or the sum of trapezoids, up to rounding."""

    class Ripple(Component):
        u: Real = signal_input(unit="K")
        x: Real = variable(unit="K.s", nominal=1e-13, default=fixed(0.0))

        def equations(self) -> Equations:
            yield der(self.x) == self.u - acausal.quantity(300.0, "K")

    def signal(t: Any) -> Any:
        return 300.0 + amplitude * np.sin(3.0 * np.asarray(t))

    t = np.linspace(0.0, 2.0, 101)
    given = signal if form == "function" else TimeSeries(t, signal(t), interpolation=form)
    result = acausal.simulate(Ripple(), inputs={"u": given}, stop_time=2.0, tolerance=1e-6)
    lines = np.trapezoid(signal(t) - 300.0, t)
    exact = lines if form == "linear" else amplitude * (1.0 - np.cos(6.0)) / 3.0
    assert result.final("x") == pytest.approx(exact, rel=1e-5, abs=3e-12)


def test_a_result_of_a_file_has_the_same_values_as_an_input(tmp_path: Path, lag: Any) -> None:
    """Rows that jump: a spline through them swings beyond by 0.2 of the jump; what `result.at` gives does not."""
    rows = "\n".join(f"{k},{0 if k < 10 else 1000}" for k in range(31))
    (tmp_path / "steps.csv").write_text(f"time [s],u [mV]\n{rows}\n")
    steps = acausal.load(tmp_path / "steps.csv")
    times = np.linspace(0.0, 30.0, 601)
    driven = acausal.simulate(lag, inputs={"u": steps}, stop_time=30.0, tolerance=1e-6)
    assert driven.at(times, "u") == pytest.approx(1e-3 * np.asarray(steps.at(times, "u")), abs=1e-6)
