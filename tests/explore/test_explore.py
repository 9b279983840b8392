"""The explorer in a headless Chromium, by numbers; units and page without one."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import acausal
from acausal.errors import UsageError
from acausal.explore.explore import _in_one_unit, choices
from acausal.models.bouncing_ball import BouncingBall
from acausal.models.oscillator import Oscillator
from acausal.result.result import Result
from acausal.result.signals import Event, Signal
from tests.browser.chromium import probe


def line(time: list[float], values: list[float], **more: object) -> Result:
    """A result of a length x, its negative as an alias, and a constant."""
    signals = {
        "part.x": Signal("part.x", "m", "Where it is", 0),
        "part.back": Signal("part.back", "m", "The other way", 0, -1),
        "k": Signal("k", "N/m", "Stiffness", None, 1, 40.0, True),
    }
    return Result("Line", np.array(time), np.array(values)[:, None], signals, **more)  # type: ignore[arg-type]


def test_curves_are_the_values_of_the_results(tmp_path: Path) -> None:
    """All digits: the page holds double precision."""
    result = acausal.simulate(Oscillator(), stop_time=2.0)
    page = acausal.explore(result, signals=["mass.s"]).html()
    script = """
      await app.ready;
      const plain = (c) => ({t: Array.from(c.t), y: Array.from(c.y)});
      return {s: plain(app.curve("mass.s", 0)), f: plain(app.curve("spring.flange_a.f", 0)), panels: app.panels()};
    """
    found = probe(page, script, tmp_path)
    assert np.array_equal(found["s"]["t"], result.time)
    assert np.array_equal(found["s"]["y"], result["mass.s"])
    assert np.array_equal(found["f"]["y"], result["spring.flange_a.f"])
    assert [p["signals"] for p in found["panels"]] == [["mass.s"]]


@pytest.mark.slow
def test_differences_are_at_the_times_of_the_first_and_know_jumps(tmp_path: Path) -> None:
    """3 t + 1 less 2 t is t + 1 on any grid; a jump of 3 less a jump of 1 is 0 before and 2 after."""
    straight = acausal.explore(line([0, 0.4, 1], [0, 0.8, 2]), line([0, 0.3, 0.9], [1, 1.9, 3.7])).html()
    script = "await app.ready; return Array.from(app.difference('part.x', 1).y);"
    first, second, outside = probe(straight, script, tmp_path)
    assert (first, second) == (pytest.approx(1.0), pytest.approx(1.4))
    assert outside is None  # the second run ends at 0.9 s
    jumping = acausal.explore(line([0, 0.5, 0.5, 1], [0, 0, 1, 1]), line([0, 0.5, 0.5, 1], [0, 0, 3, 3])).html()
    assert probe(jumping, script, tmp_path) == [0.0, 0.0, 2.0, 2.0]


@pytest.mark.slow
def test_units_zoom_search_and_events(tmp_path: Path) -> None:
    events = (Event(0.5, "x > 1", None, "part"),)
    page = acausal.explore(line([0, 0.5, 1], [0, 1, 2], events=events), signals=["part.x", "k"]).html()
    script = """
      await app.ready;
      const before = app.panels();
      app.setUnit("m", "mm");
      app.zoom(0.25, 0.75);
      await new Promise((r) => setTimeout(r, 50));
      const y = (name) => Array.from(app.curve(name, 0).y), found = app.search("OTHER way");
      return {
        before, after: app.panels(), mm: y("part.x"), back: y("part.back"), constant: y("k"), found,
        listed: Array.from(document.querySelectorAll("#happened div"), (e) => e.textContent),
        events: app.events(0), picture: app.picture().length,
        boxes: document.querySelectorAll("#tree input").length,
      };
    """
    found = probe(page, script, tmp_path)
    assert [p["unit"] for p in found["before"]] == ["m", "N/m"]
    assert [p["unit"] for p in found["after"]] == ["mm", "N/m"]
    assert found["after"][0]["x"] == [0.25, 0.75]
    assert found["mm"] == [0.0, 1000.0, 2000.0]
    assert found["back"] == [0.0, -1000.0, -2000.0]
    assert found["constant"] == [40.0, 40.0, 40.0]
    assert found["found"] == ["part.back"]
    assert found["boxes"] == 1
    assert found["events"] == [[0.5, "x > 1", "part"]]
    assert found["listed"] == ["0.5 s  part: x > 1"]
    assert found["picture"] > 5000


def test_the_tree_opens_and_ticks_show_curves(tmp_path: Path) -> None:
    page = acausal.explore(acausal.simulate(BouncingBall()), line([0, 1], [0, 1]), labels=["ball", "line"]).html()
    script = """
      await app.ready;
      const branch = document.querySelector("#tree details");
      branch.open = true;
      await new Promise((r) => setTimeout(r, 100));
      const box = document.querySelector('input[data-name="part.x"]');
      box.click();
      document.querySelector('input[data-name="h"]').click();
      const together = app.panels().length;
      document.getElementById("apart").click();
      return {together, apart: app.panels().length, labels: app.panels().flatMap((p) => p.signals),
              doc: box.parentElement.title, events: app.events(0).length};
    """
    found = probe(page, script, tmp_path)
    assert (found["together"], found["apart"]) == (1, 2)
    assert found["labels"] == ["part.x · line", "h · ball"]
    assert found["doc"] == "part.x: Where it is"
    assert found["events"] > 5


def test_the_page_is_small_and_asks_for_nothing() -> None:
    page = acausal.explore(line([0, 1], [0, 1])).html()
    assert len(page) < 100_000
    assert "http" not in page.split("<script>")[0]


def test_whatever_names_and_docs_hold_stays_text(tmp_path: Path) -> None:
    signals = {"a</script>": Signal("a</script>", "m", "<img src=x onerror=alert(1)> & more", 0)}
    nasty = Result("<b>M</b>", np.array([0.0, 1.0]), np.array([[math.nan], [math.inf]]), signals)
    page = acausal.explore(nasty, signals=["a</script>"]).html()
    script = (
        "await app.ready; return {title: document.title, images: document.images.length, panels: app.panels().length};"
    )
    assert probe(page, script, tmp_path) == {"title": "<b>M</b>", "images": 0, "panels": 1}


@pytest.mark.parametrize(
    ("declared", "shown", "value", "expected"),
    [
        ("m", "mm", 0.016, 16.0),
        ("rad", "deg", math.pi, 180.0),
        ("K", "degC", 300.0, 26.85),
        ("N/m2", "N/mm2", 2.24e9, 2240.0),
        ("1/s", "1/min", 9.28, 556.8),
        ("N.m", "mN.m", 0.5, 500.0),
        ("W", "kW", 1500.0, 1.5),
    ],
)
def test_units_to_choose_from(declared: str, shown: str, value: float, expected: float) -> None:
    found = {unit: (slope, offset) for unit, slope, offset in choices(declared)}
    assert next(iter(found)) == declared
    slope, offset = found[shown]
    assert value * slope + offset == pytest.approx(expected, rel=1e-12)


def test_units_without_common_ones_stay() -> None:
    assert choices("kg.m2") == (("kg.m2", 1.0, 0.0),)
    assert choices("") == (("", 1.0, 0.0),)
    assert choices("%") == (("%", 1.0, 0.0),)  # of what, nobody knows; no angle


@pytest.mark.parametrize("unit", ["dB", "MHz", "1/h", "Nm", "rpm"])
def test_files_of_other_programs_are_shown_whatever_their_units(unit: str) -> None:
    """One unit that acausal does not know, or that might count turns, refuses no page."""
    named = Result("rig", np.array([0.0, 1.0]), np.array([[0.0], [3.0]]), {"x": Signal("x", unit, "", 0)})
    assert "uPlot" in acausal.explore(named, line([0, 1], [0, 1])).html()


def test_wrong_requests_are_refused() -> None:
    result = line([0, 1], [0, 1])
    with pytest.raises(UsageError, match="AC010"):
        acausal.explore(result, signals=["part.y"])
    with pytest.raises(UsageError, match="AC085"):
        acausal.explore()
    with pytest.raises(UsageError, match="AC085"):
        acausal.explore(result, labels=["a", "b"])
    with pytest.raises(UsageError, match="AC013"):
        acausal.explore(result).save("x.png")


def test_results_in_other_units_stand_on_one_axis(tmp_path: Path) -> None:
    """x of 0, 1, 2 m, and 0, 3 m measured in mm: 0 and 1000 mm apart at the first and last time."""
    measured = Result("rig", np.array([0.0, 1.0]), np.array([[0.0], [3e3]]), {"part.x": Signal("part.x", "mm", "", 0)})
    page = acausal.explore(line([0, 0.5, 1], [0, 1, 2]), measured).html()
    script = (
        "await app.ready; return [app.curve('part.x', 1).y, app.difference('part.x', 1).y].map((y) => Array.from(y));"
    )
    values, difference = probe(page, script, tmp_path)
    assert values == pytest.approx([0.0, 3.0])
    assert [difference[0], difference[-1]] == pytest.approx([0.0, 1.0])


def test_a_result_without_units_does_not_keep_others_from_one_unit() -> None:
    """Behind a file of plain numbers, 3000 mm and 3 m are drawn at one height."""
    ends = {"": 3.0, "mm": 3e3, "m": 3.0}
    found = _in_one_unit(
        [
            Result("rig", np.array([0.0, 1.0]), np.array([[0.0], [end]]), {"x": Signal("x", unit, "", 0)})
            for unit, end in ends.items()
        ]
    )
    assert [(r.unit("x"), r.final("x")) for r in found] == [("mm", 3.0), ("mm", 3e3), ("mm", 3e3)]
