"""HTML page that shows a scene with curves and a time slider."""

from __future__ import annotations

import base64
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from acausal.animate.scene import Scene, corners, worth_seeing
from acausal.browser.page import packed, page
from acausal.errors import AcausalError
from acausal.panel import Panel
from acausal.plot.scale import to_unit
from acausal.result.result import Result

_BODY = """\
<header><h1></h1><span class="note"></span></header>
<main><div id="view"><div id="label"></div></div><div id="curves"></div></main>
<footer>
<button id="play" title="play and pause: space">▶</button>
<select id="speed" title="seconds of the run per second"></select>
<input id="slider" type="range"><span id="clock"></span>
<label><input id="trail" type="checkbox" checked> trails</label>
<label><input id="force" type="checkbox" checked> forces</label>
</footer>
<script>
document.querySelector("h1").textContent = document.title;
</script>"""
_TO_THREE = str.maketrans("", "", "[].:/")
"""Characters that three.js removes from the names of nodes (PropertyBinding.sanitizeNodeName)."""


def to_page(scene: Scene, glb: bytes, result: Result, panels: Sequence[Panel]) -> str:
    """A page with the scene, the curves of `panels` beside it, and the controls."""
    start, stop = float(scene.time[0]), float(scene.time[-1])
    lowest, highest = _box(scene)
    times = (scene.time - start).astype(np.float32).astype(float)
    data: dict[str, Any] = {
        "start": start,
        "stop": stop,
        "last": float(times[-1]),
        "times": times.tolist(),
        "digits": max(0, 3 - math.floor(math.log10(stop - start))) if stop > start else 3,
        "centre": ((lowest + highest) / 2).tolist(),
        "reach": max(float(np.linalg.norm(highest - lowest)) / 2, 1e-6),
        "names": {n.name.replace(" ", "_").translate(_TO_THREE): n.name for n in scene.nodes},
        "panels": [p for panel in panels if (p := _panel(result, panel)) is not None],
        "glb": base64.b64encode(glb).decode("ascii"),
        "notes": list(scene.notes),
        "force_scale": scene.force_scale,
    }
    body = _BODY + f"\n<script>{_controls(stop - start)}</script>"
    scripts = ("three.bundle.min.js", "uPlot.iife.min.js", "curves.js", "viewer.js")
    return page(scene.model, body, data, scripts, ("uPlot.min.css", "viewer.css"))


def _controls(duration: float) -> str:
    """Script with the selectable speeds, 1 s per s among them; at the initial one the run takes between 4 and 20 s."""
    first = min(max(duration / 20, 1.0), duration / 4) if duration > 4 else duration / 4 if duration > 0 else 1.0
    exponent = math.floor(math.log10(first))
    chosen = min((m * 10.0**exponent for m in (1, 2, 5, 10)), key=lambda s: abs(s - first))
    speeds = sorted({chosen * f for f in (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0)} | {1.0})
    options = "".join(
        f'<option value="{s:.6g}"{" selected" if s == chosen else ""}>{s:.6g} s per s</option>' for s in speeds
    )
    return f"document.getElementById('speed').innerHTML = '{options}';"


def _box(scene: Scene) -> tuple[Any, Any]:
    """Corners of a box around all bodies and their paths, with +y up."""
    every = corners(worth_seeing(scene.nodes)) @ scene.upright.T
    return every.min(axis=0), every.max(axis=0)


def _panel(result: Result, panel: Panel) -> dict[str, Any] | None:
    """The curves of a panel of the model's figure; None for a panel that is not over time or not in the result."""
    names = [n for n in panel.signals if n in result]
    if panel.against is not None or not names:
        return None
    shown = panel.unit or result.unit(names[0])
    signals = []
    for name in names:
        for signal in result.elements(name)[1]:
            try:
                scale = to_unit(signal.unit, shown) if shown != signal.unit else None
            except AcausalError:
                continue  # a second quantity has no axis here
            values = result[signal.name]
            signals.append({"name": signal.name, "values": packed(values if scale is None else scale(values))})
    return {"title": panel.title, "unit": shown, "time": packed(result.time, "<f8"), "signals": signals}
