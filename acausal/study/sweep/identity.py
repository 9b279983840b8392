"""Identity of a sweep: hashes of its model and inputs, by which a file rejects members of other sweeps."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict
from typing import Any

import numpy as np

from acausal.flatten.pool import LEAVES, Pool
from acausal.language.expressions.external import Call
from acausal.lower.compiled import CompiledModel
from acausal.numeric.external import function, is_self_contained
from acausal.simulate.inputs.given import given_inputs
from acausal.simulate.options import Options
from acausal.simulate.options import options as run_options


def fingerprint(compiled: CompiledModel) -> str:
    """Hash of everything that determines the values of a run, by which a file recognises the model of its sweep.

    Besides equations and parameters, this includes the magnitudes by which tolerances are scaled, and the experiment of
    the model, whose tolerance, solver and steps apply unless the sweep has its own.
    """
    parts = [compiled.rhs.serialize(), compiled.modes.serialize(), compiled.instants.serialize()]
    parts += [compiled.observe.serialize(), compiled.guess.serialize(), compiled.conditions.serialize()]
    events = compiled.events
    if compiled.state_events:
        parts += [f.serialize() for f in (events.round, events.watch, events.reactions)]
    parts += [compiled.delay_signals.serialize()] if compiled.delays else []
    parts += [] if compiled.homotopy is None else [compiled.homotopy.serialize()]
    named = compiled.parameters, compiled.parameter_values, compiled.states, compiled.inputs
    sizes = compiled.nominal_x.tolist(), compiled.nominal_z.tolist()
    own = [asdict(compiled.flat.experiment), *sizes]
    parts.append(json.dumps([*named, _evaluated(compiled), _demands(compiled), own]))
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()[:16]


def referenced(compiled: CompiledModel) -> str:
    """Hash of what a pickled model takes from the classes of the process that reads it: declarations and functions."""
    flat = compiled.flat
    declared = [*(v.declaration for v in flat.variables), *(p.declaration for p in flat.parameters)]
    limits = [(d.unit, d.shape, d.nominal, d.min, d.max) for d in declared]
    called = ((call.external.name, function(call.external)) for call in _calls(compiled))
    code = sorted({(name, f.serialize() if is_self_contained(f) else "") for name, f in called})
    return hashlib.sha256(repr((limits, code)).encode()).hexdigest()


def _calls(compiled: CompiledModel) -> set[Call]:
    """Calls of external functions."""
    return {node[0] for node in compiled.flat.pool.nodes if isinstance(node[0], Call)}


def unknown_functions(compiled: CompiledModel) -> list[str]:
    """External functions that call Python or a library: a fingerprint contains their names, not what they compute."""
    return sorted({call.external.name for call in _calls(compiled) if not is_self_contained(function(call.external))})


def _evaluated(compiled: CompiledModel) -> list[str]:
    """Expressions of parameters that runs evaluate without a function: clocks, and the longest delays."""
    pool = compiled.solution.structure.reduced.pool
    longest = [item.most for item in compiled.delays.items if item.most is not None]
    roots = [*compiled.state_events.samples, *longest]
    texts = _texts(pool, roots)
    return [texts[n] for n in roots]


def _texts(pool: Pool, roots: Sequence[int]) -> dict[int, str]:
    """Hash of each node below `roots`, which does not depend on the numbers of nodes."""
    texts: dict[int, str] = {}
    for n in pool.reachable(roots):
        op, *below = pool.nodes[n]
        texts[n] = hashlib.sha256(repr((op, below if op in LEAVES else [texts[k] for k in below])).encode()).hexdigest()
    return texts


def _demands(compiled: CompiledModel) -> list[Any]:
    """Assertions and limits of parameters, because they decide whether a member fails."""
    flat = compiled.flat
    texts = _texts(flat.pool, [a.condition for a in flat.demands])
    assertions = [(a.message, a.level) for a in compiled.state_events.asserts]
    limits = [(f.declaration.min, f.declaration.max) for f in flat.parameters]
    return [assertions, [(texts[a.condition], a.message, a.level) for a in flat.demands], limits]


def driven(compiled: CompiledModel, options: Mapping[str, Any]) -> str:
    """Hash of the values of the inputs over a run: functions and files cannot be compared by name."""
    times = run_times(compiled, options)
    given = given_inputs(compiled, options.get("inputs") or {}, times.start_time, times.stop_time, times.tolerances)
    parts = [given.u, np.array(given.places), *(part for p in given.pieces for part in (p.breaks, p.numbers))]
    return hashlib.sha256(b"".join(part.tobytes() for part in parts)).hexdigest()[:16]


def as_text(options: Mapping[str, Any]) -> str:
    """Options as a text that is the same in every process."""
    return json.dumps({k: _plain(v) for k, v in sorted(options.items()) if v is not None})


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {k: _plain(v) for k, v in sorted(value.items())}
    if isinstance(value, str | int | float | bool | None):
        return value
    if hasattr(value, "__array__") or isinstance(value, tuple | list):
        with suppress(TypeError, ValueError):
            data = np.asarray(value, dtype=float)
            return [list(data.shape), hashlib.sha256(data.tobytes()).hexdigest()[:16]]
    # functions and objects can only be compared by their type
    return f"{type(value).__module__}.{type(value).__qualname__}"


def run_times(compiled: CompiledModel, options: Mapping[str, Any]) -> Options:
    """Times, tolerances and solver of all members."""
    plain = {k: v for k, v in options.items() if k not in ("inputs", "start", "force")}
    return run_options(compiled.flat.experiment, **plain)
