"""Typeset equations are accepted by matplotlib's TeX parser and have the same value as the text."""

from __future__ import annotations

import re
from importlib import import_module

import pytest
from matplotlib.mathtext import MathTextParser

from acausal.cli.arguments.catalogue import library_parts
from acausal.cli.models.component import described
from acausal.library.electrical import Resistor
from acausal.notebook.latex import LONGEST, latex


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("v == R * i", r"v = R\,i"),
        ("der(x) == (u - x) / T", r"\dot{x} = \frac{u - x}{T}"),
        ("J * der(w_rel) == flange_a.tau", r"J\,\frac{d}{dt}w_{\mathrm{rel}} = \mathrm{flange}_{\mathrm{a}}.\tau"),
        # What binds less tightly keeps its brackets, as in Python.
        ("a - (b - c) == (a + b) * c", r"a - \left(b - c\right) = \left(a + b\right)\,c"),
        ("(x**2)**3 == (-x)**2", r"\left(x^{2}\right)^{3} = \left(-x\right)^{2}"),
        ("a * (-b) == a + (-b)", r"a\,\left(-b\right) = a + \left(-b\right)"),
        # A factor after a derivative or a product of vectors is not part of it.
        ("der(w_rel) * J == a", r"\left(\frac{d}{dt}w_{\mathrm{rel}}\right)\,J = a"),
        ("J * der(w_rel) * k == a", r"\left(J\,\frac{d}{dt}w_{\mathrm{rel}}\right)\,k = a"),
        ("dot(a, b) * c == -cross(a, b)", r"\left(a \cdot b\right)\,c = -a \times b"),
        ("x == 2 * 3e-5", r"x = 2 \cdot 3 \cdot 10^{-5}"),
        ("y == where(u > 1, a, b)", r"y = \begin{cases} a & \mathrm{if}\ u > 1 \\ b & \mathrm{otherwise} \end{cases}"),
        ("when(x > 0, reset(v, -e * pre(v)))", None),
        ("connect(a.p, b.n)", None),
        ("f(", None),
    ],
)
def test_formulas(text: str, expected: str | None) -> None:
    found = latex(text)
    if text.startswith("when"):
        assert found is not None
        assert r"v := -e\,\mathrm{pre}\left(v\right)" in found
    else:
        assert found == expected


@pytest.mark.slow
def test_every_equation_of_the_library_is_typeset() -> None:
    """All except assertions, connections and long equations; matplotlib does not support `cases`, which are omitted."""
    reader = MathTextParser("path")
    texts = [
        equation["text"]
        for part in library_parts()
        for equation in described(part, getattr(import_module(f"acausal.library.{part.family}"), part.name))[
            "equations"
        ]
        if not equation["text"].startswith(("assert_(", "connect(", "and what ")) and len(equation["text"]) <= LONGEST
    ]
    formulas = [formula for text in texts if (formula := latex(text)) is not None]
    assert len(formulas) > 0.97 * len(texts) > 1000
    for formula in formulas:
        known = re.sub(r"\\(begin|end)\{cases\}", "", formula).replace("&", r"\ ").replace("\\\\", r"\ ")
        reader.parse(f"${known}$")


def test_a_notebook_shows_them() -> None:
    shown = Resistor(R=10.0)._repr_html_()
    assert r"\(v = R\,i\)" in shown
