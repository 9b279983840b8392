"""Description of one panel of a figure, independent of matplotlib, so that models can declare their figures."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Panel:
    """Signals that share one pair of axes.

    Signals of one dimension share one vertical scale. Signals without a unit share the scale of the quantity in the
    same panel, in its SI unit, so that a set point without a unit can be compared with the value that follows it. A
    second quantity has an axis on the right, which the legend indicates.

    Parameters
    ----------
    signals
        Names as in the result; arrays draw one line per element.
    title
        Text above the axes.
    unit
        Unit to show, converted from the declared one; None chooses a prefix by the size of the values.
    against
        Signal on the horizontal axis; None means time.
    """

    signals: tuple[str, ...]
    title: str = ""
    unit: str | None = None
    against: str | None = None
