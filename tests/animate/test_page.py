"""The page in a headless Chromium, by numbers: `app.seek(t)` and `app.pose(name)`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import acausal
from acausal.models.contact_scenes import StackedPlates
from acausal.models.drilling_dynamic import ThickBlock
from acausal.models.pendulum_chain import PendulumChain
from tests.browser.chromium import probe

pytest.importorskip("pygltflib")


@pytest.mark.slow
def test_poses_are_those_of_the_run(tmp_path: Path) -> None:
    """At recorded times to single precision; between them as a chord is: an eighth of the second difference off."""
    model = PendulumChain(n=3)
    result = acausal.simulate(model, output_interval=2.0 / 400)
    page = acausal.animate(model, result).html()
    times = [0.0, 0.5, 1.0, 1.2525, 2.0]
    chord = np.abs(np.diff(result["links[2].frame_a.r_0"], 2, axis=0)).max() / 8
    script = f"await app.ready; return {times}.map((t) => [app.seek(t), app.pose('links[2]'), app.time]);"
    for t, (shown, pose, now) in zip(times, probe(page, script, tmp_path), strict=True):
        assert shown == now == t
        matrix = np.array(pose)
        assert np.allclose(matrix[:3, 3], result.at(t, "links[2].frame_a.r_0"), atol=chord + 1e-6)
        assert np.allclose(matrix[:3, :3], result.at(t, "links[2].frame_a.R"), atol=2e-4)
        assert np.allclose(matrix[3], [0, 0, 0, 1])


@pytest.mark.slow
def test_the_drill_is_where_it_is_whatever_is_up(tmp_path: Path) -> None:
    """Poses are in the model's axes, not in those that the page turns upright; s(20 s) = 10.521275 mm."""
    page = acausal.animate(ThickBlock(), poses=1000).html()
    script = """
      await app.ready; app.seek(20);
      const curves = document.querySelectorAll('.uplot').length;
      return {drill: app.pose('drill'), names: app.names(), curves};
    """
    found = probe(page, script, tmp_path)
    assert found["drill"][2][3] == pytest.approx(10.521275e-3, abs=1e-7)
    assert {"drill", "workpiece", "body", "drill.hole"} <= set(found["names"])
    assert found["curves"] == len(ThickBlock.figure)


@pytest.mark.slow
def test_scenes_of_contact_shapes_move_too(tmp_path: Path) -> None:
    model = StackedPlates()
    result = acausal.simulate(model, stop_time=0.5)
    page = acausal.animate(model, result).html()
    script = "await app.ready; return app.names().map((n) => [n, app.seek(0.5) && app.pose(n)]);"
    poses = {name: np.array(pose) for name, pose in probe(page, script, tmp_path)}
    assert poses["scene.lower"][2, 3] == pytest.approx(float(result.final("guide.s")), abs=1e-7)
    assert poses["scene.drill"][2, 3] == pytest.approx(float(result.final("slide.s")), abs=1e-7)


def test_the_controls_move_the_scene(tmp_path: Path) -> None:
    model = PendulumChain(n=1)
    page = acausal.animate(model, poses=100).html()
    script = """
      await app.ready;
      const slider = document.getElementById("slider");
      slider.value = 1.0; slider.dispatchEvent(new Event("input"));
      const moved = app.time;
      app.seek(1e9);
      const end = [app.time, document.getElementById("clock").textContent];
      app.seek(-5);
      const curves = [[0, 1, 2], [0, 1, 2], [2, 1, 0]];
      return {moved, end, begin: app.time, dashes: curves.map((c, k) => dashOver(curves, k).length)};
    """
    found = probe(page, script, tmp_path)
    assert found["moved"] == pytest.approx(1.0, abs=2e-3)
    assert found["end"][0] == 2.0
    assert found["end"][1].startswith("2.0")
    assert found["begin"] == 0.0
    assert found["dashes"] == [0, 2, 0]  # a curve equal to the first is dashed, so that the first one is seen


def test_the_page_asks_for_nothing_from_outside() -> None:
    page = acausal.animate(PendulumChain(n=1), poses=10).html()
    assert "src=" not in page.split("<script>const acausal")[0]
    assert 'href="http' not in page
    assert len(page) < 1_000_000
