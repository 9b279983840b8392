"""`acausal.explore`: an HTML page to explore results, with all their signals."""

from __future__ import annotations

import base64
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from acausal.browser.page import packed, page
from acausal.errors import UnitError, UsageError
from acausal.plot.scale import same_unit, to_unit
from acausal.result.files import atomic, check_suffix
from acausal.result.result import Result
from acausal.units import is_angular, parse

_BODY = """\
<aside>
<input id="search" type="search" placeholder="search names and meanings">
<div id="tree"></div>
<details id="happened"><summary></summary></details>
</aside>
<section>
<header><h1></h1><span id="results"></span>
<label><input id="events" type="checkbox" checked> events</label>
<label id="differing"><input id="difference" type="checkbox"> differences</label>
<label><input id="apart" type="checkbox"> one panel each</label>
<button id="whole">whole run</button><button id="picture">save picture</button></header>
<div id="panels"></div>
<div id="hint">Tick signals at the left. Drag over a curve to zoom, double-click to see the whole run.</div>
</section>"""


@dataclass(frozen=True, eq=False)
class Explorer:
    """Results with their names in the page, and the signals that are shown initially."""

    results: tuple[Result, ...]
    labels: tuple[str, ...]
    signals: tuple[str, ...]

    def html(self) -> str:
        """The page: less than 100 kB plus the results, in double precision."""
        data = {
            "results": [_described(r, label) for r, label in zip(_in_one_unit(self.results), self.labels, strict=True)],
            "selected": list(self.signals),
            "units": {u: choices(u) for u in dict.fromkeys(s.unit for r in self.results for s in r.signals.values())},
        }
        title = " and ".join(dict.fromkeys(self.labels)) if len(self.labels) < 4 else f"{len(self.labels)} results"
        scripts = ("uPlot.iife.min.js", "curves.js", "explorer.js")
        return page(title, _BODY, data, scripts, ("uPlot.min.css", "explorer.css"))

    def save(self, path: str | Path) -> Path:
        """Write the page to a `.html` file; UsageError AC012 or AC013."""
        path = check_page_file(Path(path))
        with atomic(path) as file:
            file.write(self.html().encode())
        return path


def check_page_file(path: Path) -> Path:
    """The path itself; UsageError AC013 if it is not a `.html` file."""
    check_suffix(path, (".html",), "format of a page")
    return path


def explore(*results: Result, labels: Sequence[str] = (), signals: Sequence[str] = ()) -> Explorer:
    """Create a page to explore results in a browser.

    Parameters
    ----------
    results
        One or several, of one model or of several.
    labels
        Names of the results in the page; by default those of their models.
    signals
        Signals that are shown initially; others can be selected in the page.

    Raises
    ------
    UsageError
        AC010 for a signal that no result has, AC085 without a result, for an argument that is not a result, or with a
        different number of labels.
    """
    if not results or (labels and len(labels) != len(results)):
        given = f"{len(results)} results and {len(labels)} labels"
        raise UsageError("AC085", f"{given} cannot be shown", help="acausal.explore(result), or one label per result")
    for result in results:
        if not isinstance(result, Result):
            raise UsageError("AC085", f"{result!r} is not a result", help="acausal.explore(acausal.simulate(model))")
    shown: list[str] = []
    for name in signals:
        holder = next((r for r in results if name in r), results[0])
        shown += [s.name for s in holder.elements(name)[1]]
    names = list(labels) or [r.model for r in results]
    for k, name in enumerate(names):
        if names.index(name) != k:
            names[k] = f"{name} ({k + 1})"
    return Explorer(tuple(results), tuple(names), tuple(shown))


def _in_one_unit(results: Sequence[Result]) -> list[Result]:
    """The results with each signal in the first unit that it has in any of them, so that mm and m coincide."""
    units: dict[str, str] = {}
    for result in results:
        for name, signal in result.signals.items():
            units[name] = units.get(name) or signal.unit
    found = []
    for result in results:
        signals, columns = dict(result.signals), [result.matrix]
        for name, signal in result.signals.items():
            known = units[name]
            if signal.unit in ("", known):
                signals[name] = replace(signal, unit=known)
                continue
            values = same_unit(known, signal.unit)(result[name])
            signals[name] = replace(signal, unit=known, column=sum(c.shape[1] for c in columns), sign=1)
            columns.append(values[:, None])
        matrix = result.matrix if len(columns) == 1 else np.hstack(columns)
        found.append(Result(result.model, result.time, matrix, signals, result.events, result.stats))
    return found


def _described(result: Result, label: str) -> dict[str, Any]:
    """A result in the format of the page: concatenated columns, compressed, with aliases as column and sign."""
    columns = np.ascontiguousarray(result.matrix.T, dtype="<f8")
    return {
        "label": label,
        "time": packed(result.time, "<f8"),
        "rows": len(result.time),
        "columns": base64.b64encode(zlib.compress(columns.tobytes(), 6)).decode("ascii"),
        "signals": {
            s.name: [s.unit, s.doc, -1 if s.column is None else s.column, s.sign, _plain(s.value), int(s.parameter)]
            for s in result.signals.values()
        },
        "events": [[e.time, e.condition, e.component] for e in result.events] or _jumps(result),
    }


def _plain(value: float) -> float | None:
    """The value, or None for nan and infinity, which JSON does not have."""
    return float(value) if np.isfinite(value) else None


def _jumps(result: Result) -> list[list[Any]]:
    """Events of a file that does not record them: times of two rows."""
    return [[float(t), "", ""] for t in np.unique(result.time[1:][np.diff(result.time) == 0.0])]


_COMMON = (
    ("m", "mm", "um", "cm", "km"),
    ("s", "ms", "us", "min", "h"),
    ("m/s", "mm/s", "m/min", "mm/min", "km/h"),
    ("m/s2", "mm/s2"),
    ("rad", "deg", "mrad"),
    ("rad/s", "deg/s"),
    ("1/s", "Hz", "1/min", "kHz"),
    ("kg", "g", "t"),
    ("N", "mN", "kN", "MN"),
    ("N.m", "mN.m", "kN.m"),
    ("Pa", "kPa", "MPa", "GPa", "bar", "N/mm2"),
    ("N/m", "N/mm", "kN/m", "MN/m"),
    ("J", "mJ", "kJ", "MJ", "kWh"),
    ("W", "mW", "kW", "MW"),
    ("V", "mV", "uV", "kV"),
    ("A", "mA", "uA", "kA"),
    ("Ohm", "mOhm", "kOhm", "MOhm"),
    ("F", "mF", "uF", "nF", "pF"),
    ("H", "mH", "uH"),
    ("C", "mC", "uC"),
    ("K", "degC"),
    ("m2", "mm2", "cm2"),
    ("m3", "l", "cm3", "mm3"),
    ("m3/s", "l/s", "l/min"),
)


@cache
def choices(declared: str) -> tuple[tuple[str, float, float], ...]:
    """Units in which values can be shown, with slope and offset of the conversion; the declared unit comes first."""
    unchanged = (declared, 1.0, 0.0)
    if not declared or declared == "1":
        return (unchanged,)
    try:
        dimension = parse(declared).dimension
    except UnitError:
        return (unchanged,)  # files of other programs may have any text here
    # hertz and rad/s, torque and work have the same dimension: prefer the row that has the declared unit itself;
    # percentages are not angles, and 1/h is not an angular velocity
    alike = [units for units in _COMMON if is_angular(units[0]) == is_angular(declared)]
    fitting = [units for units in alike if parse(units[0]).dimension == dimension]
    found = next((units for units in fitting if declared in units), fitting[0] if fitting else ())
    scales = [to_unit(declared, unit) for unit in found if unit != declared]
    return unchanged, *((s.unit, s.slope, s.offset) for s in scales)
