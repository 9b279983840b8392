"""The note on relations that had no value in a run, because an external function returned nan.

Such a relation keeps the mode it had, and is false at the start. No guard shows the instant at which it has a value
again, so that this is only found within the step of the search. The rows of a run show both. The domains of other
functions are known (`acausal.analyse.domains.partial_relations`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from acausal.arrays import Vector
from acausal.diagnose.words import listed
from acausal.language.expressions.external import Call
from acausal.lower.compiled import CompiledModel
from acausal.recent import once_per_owner
from acausal.simulate.equations.calls.buffered import NarrowFunction
from acausal.simulate.record.record import Recorder


@dataclass(frozen=True, eq=False)
class _Suspects:
    """Relations that may have no value, by their indices, and the function of their distances."""

    relations: tuple[int, ...]
    distances: NarrowFunction


def undefined_relations(recorder: Recorder, p: Vector, u: Vector) -> tuple[str, ...]:
    """The note on relations that were nan in some row; empty if there are none."""
    compiled = recorder.compiled
    suspects = _suspects(compiled)
    if suspects is None:
        return ()
    times, x, z, m = recorder.rows()
    found = np.isnan(suspects.distances.many(times[:, None], x.T, z.T, u, p, m.T))
    rows = np.flatnonzero(found.any(axis=1))
    if not len(rows):
        return ()
    texts = [compiled.events.texts[k] for k, is_nan in zip(suspects.relations, found.T, strict=True) if is_nan.any()]
    names = listed(list(dict.fromkeys(texts)), 4)
    return (
        f"{names}: no value (an external function returned nan) in {len(rows)} of {len(times)} rows, first at "
        f"t = {times[rows[0]]:.9g} s; it keeps its mode, false at the start, and the instant at which it has a value "
        "again is inexact: let the function return a number everywhere",
    )


@once_per_owner
def _suspects(compiled: CompiledModel) -> _Suspects | None:
    """The relations that depend on an external function; None if there are none."""
    events, pool = compiled.state_events, compiled.solution.structure.reduced.pool
    calls = {n for n, (op, *_) in enumerate(pool.nodes) if isinstance(op, Call)}
    definitions = dict(compiled.solution.definitions)

    def nodes_behind(node: int) -> list[int]:
        behind = pool.variables_behind([node], definitions)
        return pool.reachable([node, *(definitions[v] for v in behind if v in definitions)])

    relations = tuple(
        k
        for k, node in enumerate(events.relations if calls else ())
        if k not in events.watched and not calls.isdisjoint(nodes_behind(node))
    )
    if not relations:
        return None
    function = compiled.events.distances
    inputs = function.sx_in() if function.is_a("SXFunction") else function.mx_in()
    return _Suspects(relations, NarrowFunction("partial", inputs, function(*inputs)[list(relations)]))
