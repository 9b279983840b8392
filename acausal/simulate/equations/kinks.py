"""Stops of a run, and bounds on its steps, for kinks in long tables of time.

The rows of a table are divided into stretches, on which they are one smooth curve within a tenth of the run's tolerance
(`acausal.numeric.stretches`). A feature that begins at the end of a stretch may be over before a solver's step ends. A
one-step method, which restarts at no cost, ends a step at each of these instants. A multistep method restarts only
where the length of the stretches changes. In between its steps are bounded to half of the shortest stretch; where rows
are noisy, its steps are shorter anyway.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from acausal.arrays import Vector
from acausal.lower.compiled import CompiledModel
from acausal.numeric.evaluate import values
from acausal.numeric.table_ends import regular_groups, table_ends
from acausal.simulate.equations.function_cache import functions_of

# Instants closer than this to one of a relation of time, relative to the length of the run, count as the same.
_SAME_INSTANT = 1e-12


@dataclass(frozen=True, eq=False)
class Kinks:
    """The ends of stretches of all tables of time within a run."""

    instants: Vector  # [s], ascending, shape (n,)
    # `cuts`, `bounds`: for multistep methods: instants at which the run is cut [s], and the longest steps before,
    # between and after the cuts [s], infinite without a bound; shapes (k,) and (k + 1,).
    cuts: Vector
    bounds: Vector

    @property
    def are_dense(self) -> bool:
        """Whether steps are bounded somewhere in the run."""
        return bool(np.isfinite(self.bounds).any())

    def longest(self, start: float, end: float, most: float | None = None) -> float | None:
        """The bound on steps between two instants [s], at most `most`; None without a bound."""
        first, last = np.searchsorted(self.cuts, start, side="right"), np.searchsorted(self.cuts, end, side="left")
        bound = float(self.bounds[int(first) : int(last) + 1].min())
        bound = bound if most is None else min(bound, most)
        return bound if np.isfinite(bound) else None


NONE = Kinks(np.zeros(0), np.zeros(0), np.array([np.inf]))


def kinks(compiled: CompiledModel, p: Vector, relative: float, start: float, stop: float) -> Kinks:
    """The kinks that a run of this relative tolerance must not step over."""
    parts = [
        inside
        for ends in time_ends(compiled, p, relative)
        if len(inside := ends[(ends > start) & (ends < stop)])
    ]  # fmt: skip
    if not parts:
        return NONE
    located = np.append(functions_of(compiled).instants(p)[0], [start, stop])
    tolerance = _SAME_INSTANT * (stop - start)
    cuts: list[float] = []
    groups = [regular_groups(np.concatenate([[start], ends, [stop]])) for ends in parts]
    for marks, _ in groups:
        cuts += marks[1:-1]
    all_cuts = np.unique(cuts)
    middles = 0.5 * (np.append(start, all_cuts) + np.append(all_cuts, stop))
    bounds = np.full(len(middles), np.inf)
    for marks, longest in groups:
        bounds = np.minimum(bounds, np.array(longest)[np.searchsorted(marks[1:-1], middles)])
    others = _others(np.unique(np.concatenate(parts)), located, tolerance)
    is_new = np.isin(all_cuts, others)
    # cuts left out are stops of the run anyway; there the smaller of the bounds on both sides applies to both
    joined = np.minimum.reduceat(bounds, np.append(0, np.flatnonzero(is_new) + 1))
    return Kinks(others, all_cuts[is_new], joined)


def _others(instants: Vector, known: Vector, near: float) -> Vector:
    """The instants that are not within `near` of a known one."""
    known = np.sort(known[np.isfinite(known)])
    following = np.searchsorted(known, instants)
    left = known[np.maximum(following - 1, 0)]
    right = known[np.minimum(following, len(known) - 1)]
    return np.asarray(instants[np.minimum(np.abs(instants - left), np.abs(instants - right)) > near])


def time_ends(compiled: CompiledModel, p: Vector, relative: float) -> list[Vector]:
    """The instants at which stretches end [s], ascending, as an array for each table of time."""
    tables = functions_of(compiled).time_tables
    if not tables:
        return []
    pool = compiled.solution.structure.reduced.pool
    nodes = [n for t in tables for n in (t.origin, t.slope)]
    values_of = values(pool, nodes, {"par": p.__getitem__, "time": lambda _: 0.0})
    ends = []
    for t in tables:
        origin, slope = float(values_of[t.origin]), float(values_of[t.slope])
        if np.isfinite(origin) and np.isfinite(slope) and slope != 0.0:
            ends.append(np.sort(origin + table_ends(t.table, relative) / slope))
    return ends
