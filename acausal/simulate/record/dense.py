"""Values of a run between its rows."""

from __future__ import annotations

import logging
from collections.abc import Callable

import numpy as np

from acausal.arrays import Vector
from acausal.simulate.record.project import projected
from acausal.simulate.record.record import Recorder
from acausal.simulate.solvers.base import Piece

Again = Callable[[int, Vector], tuple[Piece, Vector]]
"""`(row, times) -> (piece, modes)`: the solution integrated again from a recorded row."""
_log = logging.getLogger(__name__)


class Dense:
    """Values at any times: integrated again from the stored points before them, once for all between two of these.

    Rows are nan where the solver does not go, as over less time than it can tell apart.
    """

    def __init__(self, recorder: Recorder, again: Again) -> None:
        self._recorder, self._again = recorder, again
        # the signals of a result are asked for one by one, at the same times
        self._last: tuple[Vector, Vector] | None = None

    def __call__(self, wanted: Vector) -> Vector:
        """All trajectories at `wanted` [s], shape (times, columns)."""
        if self._last is not None and np.array_equal(self._last[0], wanted):
            return self._last[1]
        recorder = self._recorder
        times, place = np.unique(wanted, return_inverse=True)
        found = np.full((len(times), len(recorder.compiled.columns)), np.nan)
        before = np.array([recorder.before(t) for t in times])
        for k in np.unique(before):
            inside = np.flatnonzero(before == k)
            for some in (inside, *inside[:, None]):
                missing = some[np.isnan(found[some]).all(axis=1)]
                if missing.size:
                    try:
                        found[missing] = self._between(int(k), times[missing])
                    except RuntimeError as error:
                        _log.debug("no values at %s s: %s", times[missing], error)
        self._last = wanted.copy(), found[place]
        return self._last[1]

    def _between(self, k: int, times: Vector) -> Vector:
        """Rows behind row k, before the next one."""
        recorder = self._recorder
        piece, m = self._again(k, times)
        on = projected(recorder.compiled, times, piece.x, piece.z, recorder.u, recorder.p, m)
        modes = m if m.ndim == 2 else np.repeat(m[:, None], len(times), axis=1)
        return np.asarray(recorder.observe(times, on, piece.z, modes))
