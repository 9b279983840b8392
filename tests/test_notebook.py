"""The output in notebooks is complete, well formed and escaped."""

from __future__ import annotations

from html.parser import HTMLParser

import numpy as np
import pytest

import acausal
from acausal.library.electrical import Resistor
from acausal.models.oscillator import Oscillator
from acausal.result.result import Result
from acausal.result.signals import Signal


class Reader(HTMLParser):
    """Texts of cells, and whether every tag is closed."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.texts: list[str] = []
        self.points: list[str] = []
        self.feed(html)
        assert not self.open

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag == "polyline":
            self.points.append(dict(attrs)["points"] or "")
        else:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag == "polyline":
            self.points.append(dict(attrs)["points"] or "")

    def handle_data(self, data: str) -> None:
        self.texts.append(data)


def test_a_result_shows_signals_with_units_and_courses() -> None:
    result = acausal.simulate(Oscillator(), stop_time=1.0)
    shown = Reader(result._repr_html_())
    assert "mass.s" in shown.texts
    assert "m/s" in shown.texts
    assert f"{np.max(result['mass.v']):.5g}" in shown.texts
    assert len(shown.points) == sum(s.column is not None for s in result.signals.values())


def test_a_peak_of_one_row_is_in_the_course() -> None:
    """A line of 22 pixels, two of them margins: the peak reaches the upper one, whichever neighbours are left out."""
    values = np.zeros((10_001, 1))
    values[5003] = 1.0
    result = Result("Peak", np.linspace(0.0, 1.0, 10_001), values, {"<x>": Signal("<x>", column=0)})
    shown = Reader(result._repr_html_())
    assert "<x>" in shown.texts
    assert min(float(p.split(",")[1]) for p in shown.points[0].split()) == pytest.approx(2.0)


def test_models_show_parameters_and_states() -> None:
    component = Reader(Resistor(R=47.0)._repr_html_())
    assert {"Resistor", "R", "47", "Ohm"} <= set(component.texts)
    compiled = Reader(acausal.compile(Oscillator())._repr_html_())
    assert {"mass.s", "mass.v"} <= set(compiled.texts)


def test_data_frames_know_their_units() -> None:
    pytest.importorskip("pandas", reason="pandas is not installed")
    frame = acausal.simulate(Oscillator(), stop_time=0.1).to_pandas()
    assert frame.attrs["units"]["mass.v"] == "m/s"


def test_figures_show_themselves_without_pyplot() -> None:
    drawing = acausal.simulate(Oscillator(), stop_time=0.1).plot("mass.s")
    assert drawing._repr_png_().startswith(b"\x89PNG")  # type: ignore[attr-defined]
