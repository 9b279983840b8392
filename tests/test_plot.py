"""Plots: assignment of signals to axes and units, picture files, choice of prefixes."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection

from acausal.errors import UnitError, UsageError
from acausal.panel import Panel
from acausal.plot.compare import compared
from acausal.plot.plot import figure, plot, show
from acausal.plot.scale import Scale, readable, to_unit
from acausal.result.result import Event, Result, Signal
from tests.expected import fails_with

TIME = np.linspace(0.0, 4.0, 9)
SIGNALS = (
    Signal("drill.s", "m", "Depth", 0),
    Signal("drill.s_tar", "m", "Drilled depth", 0, sign=-1),
    Signal("drill.F_f", "N", "Feed force", 1),
    Signal("eps", "m", "Roughness", 2),
    Signal("still", "m", "", value=0.0),
    Signal("T", "K", "Temperature", value=300.0),
    Signal("n", "", "Count", value=3.0),
    *(Signal(f"body.v[{i}]", "m/s", "Velocity", 1) for i in range(3)),
)


@pytest.fixture
def result() -> Result:
    trajectories = np.column_stack([4e-3 * TIME, 500.0 * TIME, 1e-8 * TIME])
    events = (Event(1.0, "gap > 0"), Event(1.0, "same time"), Event(3.0, "through"))
    return Result("Drill", TIME, trajectories, {s.name: s for s in SIGNALS}, events)


def lines(ax: Axes) -> dict[str, np.ndarray]:
    return {str(line.get_label()): np.asarray(line.get_ydata()) for line in ax.get_lines()}


def test_one_panel_per_unit_in_readable_units(result: Result) -> None:
    depth, force = plot(result, "drill.s", "drill.F_f", "drill.s_tar").axes
    assert list(lines(depth)) == ["drill.s", "drill.s_tar"]
    # 4e-3 m/s for 4 s are 16 mm; 500 N/s for 4 s are 2 kN.
    assert lines(depth)["drill.s"][-1] == pytest.approx(16.0)
    assert lines(depth)["drill.s_tar"][-1] == pytest.approx(-16.0)
    assert depth.get_ylabel() == "Depth, Drilled depth [mm]"
    assert lines(force)["drill.F_f"][-1] == pytest.approx(2.0)
    assert force.get_ylabel() == "Feed force [kN]"
    assert force.get_xlabel() == "Time [s]"


def test_magnitudes_a_thousand_times_apart_are_parted(result: Result) -> None:
    depth, tiny = plot(result, "drill.s", "eps", "still").axes
    assert list(lines(depth)) == ["drill.s", "still"]
    assert tiny.get_ylabel() == "Roughness [nm]"


def test_events_are_thin_lines_drawn_once(result: Result) -> None:
    (ax,) = plot(result, "drill.s").axes
    (marks,) = [c for c in ax.collections if isinstance(c, LineCollection)]
    assert [segment[0][0] for segment in marks.get_segments()] == [1.0, 3.0]


def test_together_uses_a_second_axis(result: Result) -> None:
    left, right = plot(result, "drill.s", "drill.F_f", together=True).axes
    assert left.get_ylabel() == "Depth [mm]"
    assert right.get_ylabel() == "Feed force [kN]"
    legend = left.get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == ["drill.s", "drill.F_f (right)"]
    with fails_with(UsageError, "AC016", match="one panel cannot show 3 units"):
        plot(result, "drill.s", "drill.F_f", "T", together=True)


def following(unit: str, other: str) -> Result:
    """A value that settles at its set point, 25 at the end, and a torque."""
    signals = (
        Signal("setpoint", unit, "Set point", 0),
        Signal("motor.w", other, "Speed", 1),
        Signal("motor.tau", "N.m", "Torque", 2),
    )
    trajectories = np.column_stack([25.0 + 0.0 * TIME, 25.0 * (1.0 - np.exp(-9.0 * TIME)), 10.0 - TIME])
    return Result("Servo", TIME, trajectories, {s.name: s for s in signals})


@pytest.mark.parametrize(
    ("unit", "other"), [("", "rad/s"), ("1", "rad/s"), ("rad/s", ""), ("1/s", "rad/s"), ("1", "1/s")]
)
@pytest.mark.parametrize("together", [True, False])
def test_a_settled_value_meets_its_set_point(unit: str, other: str, together: bool) -> None:
    result = following(unit, other)
    names = ("setpoint", "motor.w")
    drawing = plot(result, *names, together=True) if together else figure(result, [Panel(names)])
    (ax,) = drawing.axes  # one scale
    first, second = (np.asarray(line.get_ydata()) for line in ax.get_lines())
    assert first[-1] == pytest.approx(second[-1], rel=1e-12)
    assert ax.get_ylabel().endswith("s]")


def test_a_plain_number_is_converted_with_what_it_stands_beside() -> None:
    result = following("1", "rad/s")
    (ax,) = figure(result, [Panel(("setpoint", "motor.w"), unit="rpm")]).axes
    # 25 rad/s are 25 * 60 / (2 pi) revolutions in a minute
    assert lines(ax)["setpoint [1]"][-1] == pytest.approx(238.732414637843, rel=1e-12)
    assert lines(ax)["motor.w"][-1] == pytest.approx(238.732414637843, rel=1e-12)
    assert "rpm" in ax.get_ylabel()


# 25 rad/s are 25 * 60 / (2 pi) rpm, 25 mm are 0.025 m
@pytest.mark.parametrize(
    ("unit", "other", "one"),
    [("rad/s", "rpm", 60 / (2 * np.pi)), ("rpm", "rad/s", 2 * np.pi / 60), ("mm", "m", 1e-3), ("1", "mm", 1e3)],
)
@pytest.mark.parametrize("together", [True, False])
def test_units_of_one_dimension_share_a_scale(unit: str, other: str, one: float, together: bool) -> None:
    signals = {s.name: s for s in (Signal("set", unit, "", 0), Signal("w", other, "", 1))}
    result = Result("Servo", TIME, np.column_stack([25.0 + 0.0 * TIME, 25.0 * one + 0.0 * TIME]), signals)
    drawing = plot(result, "set", "w", together=True) if together else figure(result, [Panel(("set", "w"))])
    (ax,) = drawing.axes  # one scale
    first, second = (np.asarray(line.get_ydata()) for line in ax.get_lines())
    assert first == pytest.approx(second, rel=1e-12)


def test_cycles_and_radians_per_second_have_a_scale_each() -> None:
    """50 Hz turn as fast as 314 rad/s, although the SI gives both the dimension 1/s; kHz join them."""
    signals = {s.name: s for s in (Signal("f", "Hz", "", 0), Signal("w", "rad/s", "", 1), Signal("g", "kHz", "", 2))}
    values = np.column_stack([x + 0.0 * TIME for x in (50.0, 100.0 * np.pi, 0.4)])
    left, right = plot(Result("Motor", TIME, values, signals), "f", "w", "g", together=True).axes
    assert (left.get_ylabel(), right.get_ylabel()) == ("[Hz]", "[rad/s]")
    assert [values[-1] for values in lines(left).values()] == pytest.approx([50.0, 400.0])


def test_volts_per_hertz_are_no_hertz() -> None:
    signals = {s.name: s for s in (Signal("f", "Hz", "", 0), Signal("k", "V/Hz", "", 1))}
    values = np.column_stack([50.0 + 0.0 * TIME, 8.0 + 0.0 * TIME])
    left, right = plot(Result("Motor", TIME, values, signals), "f", "k", together=True).axes
    assert (left.get_ylabel(), right.get_ylabel()) == ("[Hz]", "[V/Hz]")


def test_a_plain_number_beside_two_quantities_is_refused() -> None:
    with fails_with(UsageError, "AC016"):
        figure(following("", "rad/s"), [Panel(("setpoint", "motor.w", "motor.tau"))])


def test_prefixes_hold_for_all_of_a_scale() -> None:
    result = Result(
        "Press",
        TIME,
        np.column_stack([2e4 + 0.0 * TIME, 2e4 + 0.0 * TIME]),
        {s.name: s for s in (Signal("set", "", "", 0), Signal("f", "N", "Force", 1))},
    )
    (ax,) = plot(result, "set", "f", together=True).axes
    assert lines(ax)["set [1]"][0] == pytest.approx(20.0)
    assert lines(ax)["f"][0] == pytest.approx(20.0)


def test_against_another_signal(result: Result) -> None:
    (ax,) = plot(result, "drill.F_f", against="drill.s").axes
    assert ax.get_xlabel() == "Depth [mm]"
    assert np.asarray(ax.get_lines()[0].get_xdata())[-1] == pytest.approx(16.0)
    assert not ax.collections
    with pytest.raises(UsageError, match="is an array"):
        plot(result, "drill.F_f", against="body.v")


def test_arrays_draw_one_line_per_element(result: Result) -> None:
    (ax,) = plot(result, "body.v").axes
    assert list(lines(ax)) == ["body.v[0]", "body.v[1]", "body.v[2]"]


def test_figure_of_a_model(result: Result) -> None:
    panels = [Panel(("drill.s",), "Depth", unit="cm"), Panel(("T",), unit="degC"), Panel(("n",))]
    drawing = figure(result, panels, title="", xlabel="t")
    depth, temperature, count = drawing.axes
    assert depth.get_title(loc="left") == "Depth"
    assert lines(depth)["drill.s"][-1] == pytest.approx(1.6)
    assert depth.get_ylabel() == "[cm]"  # the title says the rest
    # 300 K - 273.15 K
    assert lines(temperature)["T"][0] == pytest.approx(26.85)
    assert count.get_ylabel() == "Count"
    assert count.get_xlabel() == "t"
    assert depth.get_xlabel() == ""


def test_many_panels_take_two_columns(result: Result) -> None:
    drawing = figure(result, [Panel(("drill.s",))] * 7)
    assert len(drawing.axes) == 7
    # The lowest panel of each column carries the label: the third row right, the fourth left.
    assert [bool(ax.get_xlabel()) for ax in drawing.axes] == [False] * 5 + [True, True]


def test_a_wrong_unit_is_refused(result: Result) -> None:
    with pytest.raises(UnitError):
        figure(result, [Panel(("drill.s",), unit="kg")])


def test_nothing_to_draw_is_refused(result: Result) -> None:
    with pytest.raises(UsageError, match="there is no signal to"):
        plot(result)
    with pytest.raises(UsageError, match="at least one panel"):
        figure(result, [])
    with pytest.raises(UsageError, match="has no signal"):
        figure(result, [Panel(())])


@pytest.mark.parametrize(("suffix", "magic"), [(".png", b"\x89PNG"), (".svg", b"<?xml"), (".pdf", b"%PDF")])
def test_pictures_are_written_and_reproducible(result: Result, tmp_path: Path, suffix: str, magic: bytes) -> None:
    first, second = tmp_path / f"a{suffix}", tmp_path / f"b{suffix}"
    result.plot("drill.s", file=first)
    result.plot("drill.s", file=second)
    assert first.read_bytes().startswith(magic)
    assert first.read_bytes() == second.read_bytes()


def test_png_has_150_dots_per_inch(result: Result, tmp_path: Path) -> None:
    drawing = plot(result, "drill.s", file=tmp_path / "a.png")
    # Bytes 16 to 24 of a PNG are its width and height (W3C PNG specification, 11.2.2).
    size = np.frombuffer((tmp_path / "a.png").read_bytes()[16:24], ">i4")
    assert size.tolist() == (drawing.get_size_inches() * 150).astype(int).tolist()


def test_wrong_files_are_refused(result: Result, tmp_path: Path) -> None:
    for name, code in (("a.xyz", "AC013"), ("nowhere/a.png", "AC012")):
        with fails_with(UsageError, code):
            plot(result, "drill.s", file=tmp_path / name)
    assert list(tmp_path.iterdir()) == []


def test_values_that_are_not_finite_or_equal_to_rounding(result: Result) -> None:
    values = np.column_stack([np.full(9, np.nan), 5.0 + 1e-15 * TIME])
    r = Result("M", TIME, values, {"bad": Signal("bad", "N", column=0), "flat": Signal("flat", "W", column=1)})
    _, flat = plot(r, "bad", "flat").axes
    assert flat.get_ylim() == pytest.approx((4.5, 5.5))


def test_no_window_without_a_display(result: Result) -> None:
    import matplotlib

    with matplotlib.rc_context({"backend": "agg"}), pytest.raises(UsageError, match="no display"):
        show(plot(result, "drill.s"))


def test_plotting_to_a_file_does_not_load_pyplot() -> None:
    code = "import sys, acausal.plot.plot; print('matplotlib.pyplot' in sys.modules)"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert out.strip() == "False"


@pytest.mark.parametrize(
    ("unit", "magnitude", "shown", "factor"),
    [
        ("m", 0.016, "mm", 1e3),
        ("m", 0.5, "m", 1.0),
        ("m", 5e7, "km", 1e-3),
        ("N", 2300.0, "kN", 1e-3),
        ("N", 1000.0, "kN", 1e-3),
        ("N", 999.0, "N", 1.0),
        ("Pa", 2.3e8, "MPa", 1e-6),
        ("N/m2", 1.7e9, "N/mm2", 1e-6),
        ("N/m", 4.2e7, "MN/m", 1e-6),
        ("N.m", 0.02, "mN.m", 1e3),
        ("m/s", 2e-4, "um/s", 1e6),
        ("m2", 3e-6, "mm2", 1e6),
        ("m3", 5e-8, "mm3", 1e9),
        ("m3/s", 5e-4, "cm3/s", 1e6),
        ("s", 1e5, "s", 1.0),
        ("s", 2e-3, "ms", 1e3),
        ("A", 1e-15, "pA", 1e12),
        ("mm", 1e-5, "mm", 1.0),
        ("kg", 1e-5, "kg", 1.0),
        ("mol", 1e-5, "mol", 1.0),
        ("rad/s", 1e5, "rad/s", 1.0),
        ("", 1e9, "", 1.0),
        ("N", 0.0, "N", 1.0),
        ("N", float("inf"), "N", 1.0),
    ],
)
def test_prefixes(unit: str, magnitude: float, shown: str, factor: float) -> None:
    scale = readable(unit, magnitude)
    assert scale.unit == shown
    assert scale.slope == pytest.approx(factor, rel=1e-15)
    if unit:
        # The prefix agrees with the unit system.
        assert to_unit(unit, shown).slope == pytest.approx(factor, rel=1e-12)


def test_labels_are_typeset() -> None:
    assert Scale("um/s2").label == "[\u00b5m/s\u00b2]"
    assert Scale("kN.m").label == "[kN\u00b7m]"
    assert Scale("kOhm").label == "[k\u03a9]"
    assert Scale("1").label == ""


def test_two_results_share_panels_and_units(result: Result) -> None:
    """A measurement in mm and a run in m: 16 mm at the end of both; signals missing from one are drawn once."""
    measured = Result("rig", TIME[::4], 4.0 * TIME[::4, None], {"drill.s": Signal("drill.s", "mm", "", 0)})
    depth, force = plot(result, "drill.s", "drill.F_f", also=measured).axes
    assert list(lines(depth)) == ["drill.s (Drill)", "drill.s (rig)"]
    assert [y[-1] for y in lines(depth).values()] == pytest.approx([16.0, 16.0])
    assert list(lines(force)) == ["drill.F_f (Drill)"]
    (ax,) = plot(result, "drill.s", also={"twice": result}).axes
    assert list(lines(ax)) == ["drill.s (Drill)", "drill.s (twice)"]
    (ax,) = plot(result, "drill.s", also=[result]).axes
    assert list(lines(ax)) == ["drill.s (Drill 1)", "drill.s (Drill 2)"]


def test_results_share_the_unit_of_the_horizontal_axis(result: Result) -> None:
    """Force over depth, once in m and once in mm, is one curve."""
    signals = {"drill.s": Signal("drill.s", "mm", "", 0), "drill.F_f": result.signals["drill.F_f"]}
    signals["drill.F_f"] = replace(signals["drill.F_f"], column=1, sign=1)
    table = np.column_stack([1e3 * result["drill.s"], result["drill.F_f"]])
    measured = Result("rig", TIME, table, signals)
    (ax,) = plot(result, "drill.F_f", against="drill.s", also=measured).axes
    one, other = ax.get_lines()
    np.testing.assert_allclose(np.asarray(one.get_xdata()), np.asarray(other.get_xdata()))


def test_panels_on_one_time_axis_have_one_unit_of_time() -> None:
    """A signal of 50 ms above one that another run has for 5 s: both share the time axis below."""
    time, signals = np.array([0.0, 0.05]), {"x": Signal("x", "m", "", 0), "z": Signal("z", "V", "", 0)}
    short = Result("short", time, time[:, None], signals)
    long = Result("long", 100 * time, time[:, None], {"x": signals["x"]})
    above, below = plot(short, "z", "x", also=long).axes
    ends = [np.asarray(line.get_xdata())[-1] for ax in (above, below) for line in ax.get_lines()]
    assert ends == pytest.approx([0.05, 0.05, 5.0])


def test_differences_are_those_of_one_unit(result: Result) -> None:
    """1 mm added to a measurement in mm: the run lies 1 mm below it."""
    measured = Result("rig", TIME[::4], 4.0 * TIME[::4, None] + 1.0, {"drill.s": Signal("drill.s", "mm", "", 0)})
    upper, lower = compared(measured, result, ["drill.s"]).axes
    assert np.asarray(lines(upper)["Drill"])[-1] == pytest.approx(16.0)
    assert np.asarray(lower.get_lines()[0].get_ydata()) == pytest.approx([-1.0] * 3)


def test_many_compared_signals_stand_in_rows(result: Result) -> None:
    """Five signals beside each other were 23 inches wide, and shrunk on a screen until nothing could be read."""
    drawing = compared(result, result, ["drill.s", "drill.F_f", "eps", "body.v[0]", "body.v[1]"])
    assert drawing.get_size_inches()[0] < 10.0
    titles = [ax.get_title(loc="left") for ax in drawing.axes]
    assert [t for t in titles if t] == ["drill.s", "drill.F_f", "eps", "body.v[0]", "body.v[1]"]
    assert len(titles) == 10


def test_a_jump_that_both_results_have_is_no_difference() -> None:
    time, values = np.array([0.0, 1.0, 1.0, 2.0]), np.array([[0.0], [0.0], [5.0], [5.0]])
    step = Result("step", time, values, {"y": Signal("y", "m", "", 0)})
    _, lower = compared(step, step, ["y"]).axes
    assert np.asarray(lower.get_lines()[0].get_ydata()) == pytest.approx([0.0] * 3)


@pytest.mark.parametrize("title", [r"$\frac{1}$", "$5 and $x_$", "costs $"])
def test_dollar_signs_around_no_formula_stay(result: Result, title: str, tmp_path: Path) -> None:
    """A title is shown as typed; matplotlib cannot parse these as formulas."""
    plot(result, "body.v", title=title, file=tmp_path / "h.png")
    assert (tmp_path / "h.png").stat().st_size > 0


def test_matplotlib_has_nothing_to_say_about_a_wrapped_label(caplog: pytest.LogCaptureFixture, tmp_path: Path) -> None:
    """A unit with an exponent after a line break: mathtext used to look up the break in its font, with a warning."""
    signals = (Signal("k_c", "N/mm2", "Specific cutting force", 0), Signal("n", "1/s", "Speed of the spindle", 0))
    r = Result("M", TIME, (7e3 * TIME)[:, None], {signal.name: signal for signal in signals})
    panels = (Panel(("k_c",), title="Force"), Panel(("n",), title="Speed"))
    figure(r, panels, file=tmp_path / "k.png")
    assert not [record.getMessage() for record in caplog.records if record.name.startswith("matplotlib")]


def test_a_curve_on_top_of_another_one_leaves_it_visible(result: Result) -> None:
    """Equal curves differ in style, and those that differ in value do not."""
    signals = {s.name: s for s in (Signal("a", "m", "", 0), Signal("b", "m", "", 0), Signal("c", "m", "", 0, sign=-1))}
    (panel,) = plot(replace(result, signals=signals), "a", "b", "c").axes
    assert [line.get_linestyle() for line in panel.get_lines()] == ["-", "--", "-"]


def test_a_long_title_stays_within_the_figure(result: Result) -> None:
    drawing = plot(result, "drill.s", title="Phase portrait of the oscillator, " * 5)
    title = drawing.get_suptitle()
    assert title.count("\n") >= 2
    drawing.canvas.draw()
    heading = drawing._suptitle  # type: ignore[attr-defined]
    box = heading.get_window_extent()
    assert 0.0 <= box.x0 < box.x1 <= drawing.bbox.x1


@pytest.mark.parametrize(("unit", "shown"), [("degC", "[°C]"), ("deg", "[°]"), ("deg/s", "[°/s]"), ("m", "[m]")])
def test_degrees_have_their_sign(unit: str, shown: str) -> None:
    assert Scale(unit).label == shown
