"""An integration that also notes down the signals that are read later, finely enough for the tolerance."""

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
_MOST_TRIES = 7
_MOST_PANELS = 256


class Recording:
    """Integrates a stretch again, with more points, until the polynomials through them are good enough."""

    def __init__(self, integrate: Integrate, signals: Signals) -> None:
        self.integrate = integrate
        self.signals = signals
        self.width = np.inf  # of the panels that were needed last

    def __call__(
        self, regime: Regime, segment: Segment, limits: Callable[[Vector], Vector]
    ) -> tuple[Piece, list[Panel]]:
        """Rows at `segment.times`, and panels over the stretch; `limits(values)` says what may be left open."""
        a, b = segment.start, float(segment.times[-1])
        count = int(np.clip(np.ceil((b - a) / self.width - 1e-6), 1, _MOST_PANELS))
        edges = np.linspace(a, b, count + 1)
        edges[0], edges[-1] = a, b
        worst, tries = np.inf, 0
        while True:
            tries += 1
            nodes, times = _merged([_nodes(float(u), float(v)) for u, v in pairwise(edges)], segment.times)
            piece = self.integrate(regime, replace(segment, times=times))
            values = self.signals(regime, segment, times, piece)
            place = np.append(a, times)
            panels = [_panel(n, values[np.searchsorted(place, n)]) for n in nodes]
            allowed = limits(values)
            rough = np.array([float((tail(p.coefficients) / allowed).max(initial=0.0)) for p in panels])
            largest = float(rough.max())
            # below the solver's own noise nothing gets better
            if largest <= 1.0 or largest > 0.5 * worst or 2 * len(panels) > _MOST_PANELS or tries == _MOST_TRIES:
                break
            worst = largest
            middles = [0.5 * (p.low + p.high) for p, r in zip(panels, rough, strict=True) if r > 1.0]
            edges = np.union1d(edges, middles)
        finest = float(np.diff(edges).min())
        self.width = 2.0 * finest if largest < 1e-3 else finest
        keep = np.isin(times, segment.times)
        return Piece(piece.x[:, keep], piece.z[:, keep], piece.counters), panels


def _nodes(a: float, b: float) -> Vector:
    """Points of a panel; its ends only where nothing fits in between."""
    fits = b - a > 1e6 * np.spacing(max(abs(a), abs(b)))
    return between(a, b, DEGREE) if fits else np.array([a, b])


def _panel(nodes: Vector, values: Vector) -> Panel:
    a, b = float(nodes[0]), float(nodes[-1])
    return Panel(a, b, a, b, fitted(values))


def _merged(nodes: list[Vector], times: Vector) -> tuple[list[Vector], Vector]:
    """The nodes, where they all but coincide with given times moved onto these; and all times together."""
    found = []
    for panel in nodes:
        near = times[np.clip(np.searchsorted(times, panel), 0, len(times) - 1)]
        below = times[np.clip(np.searchsorted(times, panel) - 1, 0, len(times) - 1)]
        near = np.where(np.abs(below - panel) < np.abs(near - panel), below, near)
        close = np.abs(near - panel) <= 1e-9 * (panel[-1] - panel[0])
        close[[0, -1]] = False
        found.append(np.where(close, near, panel))
    inner = np.concatenate(found)
    return found, np.union1d(times, inner[inner > nodes[0][0]])
