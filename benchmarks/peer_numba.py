"""The right-hand sides of peer_problems.py as typically written for Numba: loops over arrays in memory."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from peer_problems import SECTIONS


def vanderpol(t: float, y: Any, out: Any, p: Any) -> None:
    """mu = 1000."""
    out[0] = y[1]
    out[1] = 1000.0 * (1.0 - y[0] * y[0]) * y[1] - y[0]


def robertson(t: float, y: Any, out: Any, p: Any) -> None:
    """Three reactions."""
    slow, fast, fastest = 0.04 * y[0], 1e4 * y[1] * y[2], 3e7 * y[1] * y[1]
    out[0] = fast - slow
    out[1] = slow - fast - fastest
    out[2] = fastest


def ladder(t: float, y: Any, out: Any, p: Any) -> None:
    """1 V at the near end, R = C = 1."""
    for k in range(SECTIONS):
        before = y[k - 1] if k > 0 else 1.0
        after = y[k + 1] if k < SECTIONS - 1 else y[k]
        out[k] = before - 2.0 * y[k] + after


def pleiades(t: float, y: Any, out: Any, p: Any) -> None:
    """Seven bodies in the plane with masses 1 ... 7."""
    for i in range(7):
        out[i], out[7 + i] = y[14 + i], y[21 + i]
        pull_x, pull_y = 0.0, 0.0
        for j in range(7):
            if j != i:
                dx, dy = y[j] - y[i], y[7 + j] - y[7 + i]
                pull = (j + 1.0) / (dx * dx + dy * dy) ** 1.5
                pull_x += pull * dx
                pull_y += pull * dy
        out[14 + i], out[21 + i] = pull_x, pull_y


def compiled_rates(problem: str) -> Any:
    """The compiled right-hand side of a problem, by the beginning of its name."""
    import numba
    from numbalsoda import lsoda_sig

    rates: dict[str, Callable[..., None]] = {
        "Van": vanderpol,
        "Rob": robertson,
        "RC ": ladder,
        "Ple": pleiades,
    }
    return numba.cfunc(lsoda_sig)(rates[problem[:3]])
