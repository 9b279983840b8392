"""HTML of a model, a compiled model and a result for notebooks, without external scripts or styles.

Their classes are not imported here, because they load this module when they are shown.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from typing import Any

import numpy as np

from acausal.errors import AcausalError
from acausal.flatten.instances.composition import stated_equations
from acausal.notebook.latex import latex
from acausal.result.signals import Array

# Maximum number of rows of a table, and the points and size of a sparkline.
_MOST_ROWS = 40
_POINTS = 120
_WIDTH, _HEIGHT = 120, 22


def result_html(result: Any) -> str:
    """Table of the signals that vary, with range, last value and sparkline; then the notes."""
    moving = [s for s in result.signals.values() if s.column is not None]
    rows = []
    for signal in moving[:_MOST_ROWS]:
        values = np.asarray(result[signal.name])
        finite = values[np.isfinite(values)]
        low, high = (float(finite.min()), float(finite.max())) if finite.size else (np.nan, np.nan)
        rows.append(
            (
                _code(signal.name),
                escape(signal.unit),
                *(f"{v:.5g}" for v in (low, high, float(values[-1]))),
                _sparkline(result.time, values),
                escape(signal.doc),
            )
        )
    head = ("signal", "unit", "min", "max", "end", "", "meaning")
    notes = [str(n) for n in result.stats.get("notes", ())]
    return "".join(
        (
            _title(result.model, repr(result).partition(": ")[2].removesuffix(")")),
            _table(head, rows, len(moving)),
            *(f"<p>note: {escape(n)}</p>" for n in notes),
        )
    )


def component_html(component: Any) -> str:
    """Table of the parameters, connectors, signals and parts of a component."""
    cls = type(component)
    values = component.__dict__["_values"]
    kinds = {name: str(kind) for base in cls.__mro__ for name, kind in getattr(base, "__annotations__", {}).items()}
    rows = []
    for name, declared in cls._declarations.items():
        is_part = declared.kind.value == "part"
        value = kinds.get(name, "") if is_part else _short(values.get(name, declared.default))
        rows.append((_code(name), declared.kind.value, escape(value), escape(declared.unit), escape(declared.doc)))
    for name, part in cls._prototypes.items():
        if name not in cls._declarations:
            rows.append((_code(name), "part", escape(type(part).__name__), "", escape(_first(type(part).__doc__))))
    head = ("name", "kind", "value", "unit", "meaning")
    return _title(cls.__name__, _first(cls.__doc__)) + _table(head, rows, len(rows)) + _equations(component)


def _equations(component: Any) -> str:
    """Table of the component's own equations, typeset by MathJax, or as text if they are not formulas."""
    try:
        stated = [(text, when) for text, message, when in stated_equations(component) if not message]
    except AcausalError:
        return ""  # the error is raised when the component is used
    shown = []
    for text, when in stated[:_MOST_ROWS]:
        formula = latex(text)
        cell = f"<div class='math notranslate'>\\({escape(formula)}\\)</div>" if formula else _code(_short(text))
        shown.append((cell, escape(when)))
    return _table(("equation", ""), shown, len(stated))


def compiled_html(compiled: Any) -> str:
    """Sizes and states of a compiled model."""
    text = repr(compiled).partition(": ")[2].removesuffix(")")
    described = {v.path: v.declaration for v in compiled.flat.variables}
    rows = []
    for name in compiled.states:
        declared = described.get(name) or described.get(name.rpartition("[")[0])
        unit, doc = (declared.unit, declared.doc) if declared is not None else ("", "")
        rows.append((_code(name), escape(unit), escape(doc)))
    return _title(compiled.name, text) + _table(("state", "unit", "meaning"), rows, len(rows))


def _title(name: str, text: str) -> str:
    return f"<p><b>{escape(name)}</b> {escape(text)}</p>"


def _first(doc: str | None) -> str:
    return (doc or "").strip().partition("\n")[0]


def _code(text: str) -> str:
    return f"<code>{escape(text)}</code>"


def _short(value: Any) -> str:
    text = "" if value is None else str(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _table(head: Sequence[str], rows: Iterable[Sequence[str]], count: int) -> str:
    """A table of cells that are HTML already, at most `_MOST_ROWS` of `count` rows."""
    shown = list(rows)[:_MOST_ROWS]
    if not shown:
        return ""
    cells = "".join(f"<th style='text-align:left'>{escape(h)}</th>" for h in head)
    body = "".join(
        "<tr>" + "".join(f"<td style='text-align:left'>{cell}</td>" for cell in row) + "</tr>" for row in shown
    )
    more = f"<p>and {count - len(shown)} more</p>" if count > len(shown) else ""
    return f"<table><thead><tr>{cells}</tr></thead><tbody>{body}</tbody></table>{more}"


def _sparkline(time: Array, values: Array) -> str:
    """A signal over time as an SVG polyline, which keeps extremes whatever the number of points."""
    is_finite = np.isfinite(values)
    if is_finite.sum() < 2:
        return ""
    t, x = time[is_finite], values[is_finite]
    parts = np.array_split(np.arange(len(t)), min(len(t), _POINTS))
    rows = np.unique([k for part in parts for k in (part[np.argmin(x[part])], part[np.argmax(x[part])])])
    span, height = float(np.ptp(t)) or 1.0, float(np.ptp(x)) or 1.0
    across = 1.0 + (_WIDTH - 2.0) * (t[rows] - t[0]) / span
    down = _HEIGHT - 2.0 - (_HEIGHT - 4.0) * (x[rows] - x.min()) / height
    points = " ".join(f"{a:.1f},{d:.1f}" for a, d in zip(across, down, strict=True))
    return (
        f"<svg width='{_WIDTH}' height='{_HEIGHT}' role='img' aria-label='course over time'>"
        f"<polyline points='{points}' fill='none' stroke='#0072B2' stroke-width='1.2'/></svg>"
    )
