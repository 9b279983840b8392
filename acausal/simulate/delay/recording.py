"""An integration that also records the signals that are read later, as polynomials that meet the tolerance."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np

from acausal.arrays import Vector
from acausal.lower.chebyshev import between, fitted, tail
from acausal.simulate.delay.history import Panel
from acausal.simulate.events.regime import Regime
from acausal.simulate.solvers.segment import Piece, Segment

Integrate = Callable[[Regime, Segment], Piece]
Signals = Callable[[Regime, Segment, Vector, Piece], Vector]
"""Signals at the start of a segment and at n instants after it, shape (n + 1, signals)."""

DEGREE = 16
_MOST_ATTEMPTS = 7
_MOST_PANELS = 256


class Recording:
    """Integrates a stretch, and repeats that with more points until the polynomials through them are good enough."""

    def __init__(self, integrate: Integrate, signals: Signals) -> None:
        self.integrate = integrate
        self.signals = signals
        self.width = np.inf  # of the panels that the last stretch needed [s]

    def __call__(
        self, regime: Regime, segment: Segment, limits: Callable[[Vector], Vector]
    ) -> tuple[Piece, list[Panel]]:
        """Return rows at `segment.times`, and panels over the stretch; `limits(values)` are their allowed errors."""
        a, b = segment.start, float(segment.times[-1])
        count = int(np.clip(np.ceil((b - a) / self.width - 1e-6), 1, _MOST_PANELS))
        edges = np.linspace(a, b, count + 1)
        edges[0], edges[-1] = a, b
        worst, attempts = np.inf, 0
        while True:
            attempts += 1
            nodes, times = _merged([_nodes(float(u), float(v)) for u, v in pairwise(edges)], segment.times)
            piece = self.integrate(regime, replace(segment, times=times))
            values = self.signals(regime, segment, times, piece)
            recorded_times = np.append(a, times)
            panels = [_panel(n, values[np.searchsorted(recorded_times, n)]) for n in nodes]
            allowed = limits(values)
            relative_errors = np.array([float((tail(p.coefficients) / allowed).max(initial=0.0)) for p in panels])
            largest = float(relative_errors.max())
            # more points do not help when the error is that of the solver
            if largest <= 1.0 or largest > 0.5 * worst or 2 * len(panels) > _MOST_PANELS or attempts == _MOST_ATTEMPTS:
                break
            worst = largest
            midpoints = [0.5 * (p.low + p.high) for p, r in zip(panels, relative_errors, strict=True) if r > 1.0]
            edges = np.union1d(edges, midpoints)
        finest = float(np.diff(edges).min())
        self.width = 2.0 * finest if largest < 1e-3 else finest
        is_output = np.isin(times, segment.times)
        return Piece(piece.x[:, is_output], piece.z[:, is_output], piece.counters), panels


def _nodes(a: float, b: float) -> Vector:
    """Nodes of a panel; only its ends if it is too short for points between them."""
    fits = b - a > 1e6 * np.spacing(max(abs(a), abs(b)))
    return between(a, b, DEGREE) if fits else np.array([a, b])


def _panel(nodes: Vector, values: Vector) -> Panel:
    a, b = float(nodes[0]), float(nodes[-1])
    return Panel(a, b, a, b, fitted(values))


def _merged(nodes: list[Vector], times: Vector) -> tuple[list[Vector], Vector]:
    """Move nodes that nearly coincide with a given time onto it; returns the nodes, and all times together."""
    merged = []
    for panel in nodes:
        nearest = times[np.clip(np.searchsorted(times, panel), 0, len(times) - 1)]
        below = times[np.clip(np.searchsorted(times, panel) - 1, 0, len(times) - 1)]
        nearest = np.where(np.abs(below - panel) < np.abs(nearest - panel), below, nearest)
        close = np.abs(nearest - panel) <= 1e-9 * (panel[-1] - panel[0])
        close[[0, -1]] = False
        merged.append(np.where(close, nearest, panel))
    inner = np.concatenate(merged)
    return merged, np.union1d(times, inner[inner > nodes[0][0]])
