"""The note on relations that had no value in a run, such as `log(x) > 1` where x is negative.

A relation without a value keeps the mode it had, and is false at the start. No guard shows the instant at which it has
one again, so that this is only found within the step of the search. The rows of a run show both.
"""

from __future__ import annotations

from weakref import WeakKeyDictionary

import numpy as np

from acausal.arrays import Vector
from acausal.diagnose.words import listed
from acausal.flatten.reduced import ReducedSystem
from acausal.lower.compiled import CompiledModel
from acausal.simulate.record.record import Recorder

# Quotients are not among them, because they have no value at single points only.
_PARTIAL = frozenset(("pow", "sqrt", "log", "asin", "acos"))
_RELATIONS: WeakKeyDictionary[CompiledModel, list[int]] = WeakKeyDictionary()


def undefined_relations(recorder: Recorder, p: Vector, u: Vector) -> tuple[str, ...]:
    """The note on relations that were nan in some row; empty if there are none."""
    compiled = recorder.compiled
    suspects = _suspects(compiled)
    if not suspects:
        return ()
    times, x, z, m = recorder.rows()
    distances = compiled.events.distances.map(len(times))
    found = np.isnan(np.array(distances(times[None, :], x, z, _columns(u, times), _columns(p, times), m)))[suspects]
    texts = [compiled.events.texts[k] for k, rows in zip(suspects, found, strict=True) if rows.any()]
    if not texts:
        return ()
    rows = np.flatnonzero(found.any(axis=0))
    names = listed(list(dict.fromkeys(texts)), 4)
    return (
        f"{names}: no value (a root or logarithm of a negative number) in {len(rows)} of {len(times)} rows, first at "
        f"t = {times[rows[0]]:.9g} s; it keeps its mode, false at the start, and the instant at which it has a value "
        "again is inexact: keep to the domain, as in sqrt(maximum(x, 0)) > 1",
    )


def _columns(values: Vector, times: Vector) -> Vector:
    return np.repeat(np.asarray(values, dtype=float)[:, None], len(times), axis=1)


def _suspects(compiled: CompiledModel) -> list[int]:
    """Indices of the relations that depend on a function which does not exist everywhere."""
    if compiled not in _RELATIONS:
        events, reduced = compiled.state_events, compiled.solution.structure.reduced
        can_be_nan = any(op in _PARTIAL for op, *_ in reduced.pool.nodes)
        definitions = dict(compiled.solution.definitions) if can_be_nan else {}
        _RELATIONS[compiled] = [
            k
            for k, node in enumerate(events.relations)
            if can_be_nan and k not in events.watched and _is_partial(reduced, node, definitions)
        ]
    return _RELATIONS[compiled]


def _is_partial(reduced: ReducedSystem, node: int, definitions: dict[int, int]) -> bool:
    """Whether such a function is below a node or the definitions of its variables."""
    seen: set[int] = set()
    ahead = [node]
    while ahead:
        operations = [reduced.pool.nodes[n] for n in reduced.pool.reachable(ahead, seen)]
        if any(op in _PARTIAL for op, *_ in operations):
            return True
        seen.update(reduced.pool.reachable(ahead, seen))
        ahead = [definitions[k] for op, *rest in operations if op == "var" for k in rest if k in definitions]
        ahead = [n for n in ahead if n not in seen]
    return False
