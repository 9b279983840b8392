"""The note on relations that had no value in a run, such as `log(x) > 1` where x is negative.

A relation without a value keeps the mode it had, and is false at the start. No guard shows the instant at which it has
one again, so that this is only found within the step of the search. The rows of a run show both.
"""

from __future__ import annotations

from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np

from acausal.arrays import Vector
from acausal.diagnose.words import listed
from acausal.flatten.reduced import ReducedSystem
from acausal.lower.compiled import CompiledModel
from acausal.simulate.equations.calls.buffered import NarrowFunction
from acausal.simulate.record.record import Recorder

# Quotients are not among them, because they have no value at single points only.
_PARTIAL = frozenset(("pow", "sqrt", "log", "asin", "acos"))


@dataclass(frozen=True, eq=False)
class _Suspects:
    """Relations that may have no value, by their indices, and the function of their distances."""

    relations: tuple[int, ...]
    distances: NarrowFunction


_SUSPECTS: WeakKeyDictionary[CompiledModel, _Suspects | None] = WeakKeyDictionary()


def undefined_relations(recorder: Recorder, p: Vector, u: Vector) -> tuple[str, ...]:
    """The note on relations that were nan in some row; empty if there are none."""
    compiled = recorder.compiled
    if compiled not in _SUSPECTS:
        _SUSPECTS[compiled] = _suspects(compiled)
    suspects = _SUSPECTS[compiled]
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
        f"{names}: no value (a root or logarithm of a negative number) in {len(rows)} of {len(times)} rows, first at "
        f"t = {times[rows[0]]:.9g} s; it keeps its mode, false at the start, and the instant at which it has a value "
        "again is inexact: keep to the domain, as in sqrt(maximum(x, 0)) > 1",
    )


def _suspects(compiled: CompiledModel) -> _Suspects | None:
    """The relations that depend on a function which does not exist everywhere; None if there are none."""
    events, reduced = compiled.state_events, compiled.solution.structure.reduced
    if not any(_may_be_nan(reduced, n) for n in range(len(reduced.pool.nodes))):
        return None
    definitions = dict(compiled.solution.definitions)
    relations = tuple(
        k
        for k, node in enumerate(events.relations)
        if k not in events.watched and _is_partial(reduced, node, definitions)
    )
    if not relations:
        return None
    function = compiled.events.distances
    inputs = function.sx_in() if function.is_a("SXFunction") else function.mx_in()
    return _Suspects(relations, NarrowFunction("partial", inputs, function(*inputs)[list(relations)]))


def _may_be_nan(reduced: ReducedSystem, node: int) -> bool:
    """Whether a node is a function that does not exist everywhere; integer powers do."""
    op, *operands = reduced.pool.nodes[node]
    if op != "pow":
        return op in _PARTIAL
    kind, *value = reduced.pool.nodes[operands[1]]
    return kind != "const" or not float(value[0]).is_integer()


def _is_partial(reduced: ReducedSystem, node: int, definitions: dict[int, int]) -> bool:
    """Whether such a function is below a node or the definitions of its variables."""
    seen: set[int] = set()
    ahead = [node]
    while ahead:
        below = reduced.pool.reachable(ahead, seen)
        if any(_may_be_nan(reduced, n) for n in below):
            return True
        operations = [reduced.pool.nodes[n] for n in below]
        seen.update(below)
        ahead = [definitions[k] for op, *rest in operations if op == "var" for k in rest if k in definitions]
        ahead = [n for n in ahead if n not in seen]
    return False
