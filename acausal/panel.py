"""The description of one panel of a figure, apart from matplotlib so that models can declare their figures."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Panel:
    """Signals that share one pair of axes.

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
