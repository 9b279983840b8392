"""Where a run stops, or how long its steps may be, because of what long tables of time do.

The rows of a table are one smooth curve up to the end of a stretch (`acausal.numeric.stretches`), within a tenth of
what the run may be off. What begins there may be over before the next step ends. A method that starts again at no cost
ends a step at each of these instants. One of several steps starts again only where the lengths of stretches change, and
in between takes two steps in the shortest of them at least: where rows make noise its steps are shorter anyway.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from acausal.arrays import Vector
from acausal.lower.compiled import CompiledModel
from acausal.numeric.evaluate import values
from acausal.numeric.table_ends import regular_groups, table_ends
from acausal.simulate.equations.function_cache import functions_of

# Instants nearer than this to those of relations of time, by the length of the run, are those.
_APART = 1e-12


@dataclass(frozen=True, eq=False)
class Kinks:
    """The ends of stretches of all tables of time within a run."""

    instants: Vector  # where they are [s], ascending, shape (n,)
    # `cuts`, `bounds`: for methods of several steps: where the run is cut [s], and the longest step before, between and
    # behind the cuts [s], infinite where there is no bound; shapes (k,) and (k + 1,).
    cuts: Vector
    bounds: Vector

    @property
    def are_dense(self) -> bool:
        """Whether somewhere they are passed with bounded steps."""
        return bool(np.isfinite(self.bounds).any())

    def longest(self, start: float, end: float, most: float | None = None) -> float | None:
        """The bound on steps between two instants, if there is one; at most `most`."""
        first, last = np.searchsorted(self.cuts, start, side="right"), np.searchsorted(self.cuts, end, side="left")
        bound = float(self.bounds[int(first) : int(last) + 1].min())
        bound = bound if most is None else min(bound, most)
        return bound if np.isfinite(bound) else None


NONE = Kinks(np.zeros(0), np.zeros(0), np.array([np.inf]))


def kinks(compiled: CompiledModel, p: Vector, relative: float, start: float, stop: float) -> Kinks:
    """The kinks that a run of this relative tolerance has to see."""
    parts = [
        inside
        for ends in time_ends(compiled, p, relative)
        if len(inside := ends[(ends > start) & (ends < stop)])
    ]  # fmt: skip
    if not parts:
        return NONE
    located = np.append(functions_of(compiled).instants(p)[0], [start, stop])
    near = _APART * (stop - start)
    cuts: list[float] = []
    groups = [regular_groups(np.concatenate([[start], ends, [stop]])) for ends in parts]
    for marks, _ in groups:
        cuts += marks[1:-1]
    whole = np.unique(cuts)
    middles = 0.5 * (np.append(start, whole) + np.append(whole, stop))
    bounds = np.full(len(middles), np.inf)
    for marks, longest in groups:
        bounds = np.minimum(bounds, np.array(longest)[np.searchsorted(marks[1:-1], middles)])
    own = _others(np.unique(np.concatenate(parts)), located, near)
    is_new = np.isin(whole, own)
    # what is left out stops the run by itself; the bounds on both sides of it hold on both
    joined = np.minimum.reduceat(bounds, np.append(0, np.flatnonzero(is_new) + 1))
    return Kinks(own, whole[is_new], joined)


def _others(instants: Vector, known: Vector, near: float) -> Vector:
    """Those that are none of the known ones."""
    known = np.sort(known[np.isfinite(known)])
    place = np.searchsorted(known, instants)
    left = known[np.maximum(place - 1, 0)]
    right = known[np.minimum(place, len(known) - 1)]
    return np.asarray(instants[np.minimum(np.abs(instants - left), np.abs(instants - right)) > near])


def time_ends(compiled: CompiledModel, p: Vector, relative: float) -> list[Vector]:
    """The instants [s] at which stretches end, ascending: an array of any length for each table of time."""
    tables = functions_of(compiled).time_tables
    if not tables:
        return []
    pool = compiled.solution.structure.reduced.pool
    nodes = [n for t in tables for n in (t.origin, t.slope)]
    known = values(pool, nodes, {"par": p.__getitem__, "time": lambda _: 0.0})
    found = []
    for t in tables:
        origin, slope = float(known[t.origin]), float(known[t.slope])
        if np.isfinite(origin) and np.isfinite(slope) and slope != 0.0:
            found.append(np.sort(origin + table_ends(t.table, relative) / slope))
    return found
