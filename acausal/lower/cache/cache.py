"""Compiled models by structure: equations that differ in numbers only are not compiled again.

The signature of a flat system leaves out places in the source and the values of parameters, except for their signs and
which are zero. Every other decision that depends on values is checked: divisors that were safe, such as the difference
of two stiffnesses, must be safe for the new values, and the choice of states must still hold. Otherwise the model is
compiled anew.
"""

from __future__ import annotations

from array import array
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import numpy as np

from acausal.analyse.analyse import Structure
from acausal.analyse.blocks.pivots import keeps_sign
from acausal.analyse.start import start_problem
from acausal.flatten.flat import FlatParameter, FlatSystem
from acausal.language.declarations.declaration import Declaration
from acausal.lower.cache.divisors import shrunken_divisor
from acausal.lower.cache.stored import find, keep
from acausal.lower.compiled import CompiledModel
from acausal.numeric.evaluate import gradients
from acausal.numeric.samples import COUNT, FAR, SamplePoints
from acausal.recent import Recent

Signature = tuple[Any, ...]

_MOST_MODELS = 32
# Ratio of a divisor to its value at compile time below which other pivots may be better.
_SHRUNK = 1e-6
_MOST_NODES = 1_000_000
_MOST_EQUATIONS = 200
# Types of nearly all values; checking for abstract classes takes ten times as long.
_HASHABLE = frozenset((int, float, str, bool, FlatParameter))
# Fields of the flat system without structural information, or with an entry of their own in the signature.
_SEPARATE = {"pool", "equations", "variables", "parameter_values", "experiment", "components", "loops", "notes"}


def signature(flat: FlatSystem, formulation: str, reduction_options: Any = None) -> Signature:
    """Everything that determines how a flat system is compiled; computed before any pass adds nodes to its pool.

    `reduction_options` are the options of a reduced model; its signature includes the values of parameters.
    """
    pool = flat.pool
    return (
        formulation,
        reduction_options if reduction_options is None else (reduction_options, flat.parameter_values, flat.experiment),
        tuple(pool.nodes),
        pool.n_variables,
        tuple(pool.integral_of.items()),
        tuple(pool.slope.items()),
        array("q", [e.left for e in flat.equations]).tobytes(),
        array("q", [e.right for e in flat.equations]).tobytes(),
        tuple([e.component for e in flat.equations]),
        tuple(flat.variables),
        tuple((v > 0) - (v < 0) for v in flat.parameter_values),
        *(_hashable(getattr(flat, f.name)) for f in fields(flat) if f.name not in _SEPARATE),
    )


def _hashable(value: Any) -> Any:
    """Hashable copy of numbers, names, declarations and classes; None for the rest, such as places in the source."""
    if type(value) in _HASHABLE:
        return value
    if isinstance(value, Mapping):
        return tuple((k, _hashable(v)) for k, v in value.items())
    if isinstance(value, tuple | list):
        return tuple(_hashable(v) for v in value)
    return value if isinstance(value, int | float | str | type | Declaration | None) else None


@dataclass(frozen=True, eq=False)
class _Entry:
    """A compiled model shared by models of the same structure."""

    compiled: CompiledModel

    @property
    def size(self) -> int:
        """Number of nodes in its pools."""
        structure = self.compiled.solution.structure
        return len(structure.reduced.pool.nodes) + len(structure.reduced.flat.pool.nodes)

    @cached_property
    def divisors(self) -> tuple[int, ...]:
        """Divisors of the definitions that are safe for the values the model was compiled with."""
        solution = self.compiled.solution
        nodes = solution.structure.reduced.pool.nodes
        roots = [n for _, n in solution.definitions]
        candidates = {nodes[n][2] for n in solution.structure.reduced.pool.reachable(roots) if nodes[n][0] == "div"}
        return tuple(_safe(solution.structure.points, sorted(candidates)))


_cache: Recent[_Entry] = Recent(_MOST_MODELS, lambda entry: entry.size, _MOST_NODES)


def recall(key: Signature, flat: FlatSystem) -> CompiledModel | None:
    """The cached model of this structure with the values of `flat`; None if there is none, or it is unsafe for them."""
    entry = _cache.get(key)
    if entry is None:
        model = find(key, flat)
        if model is None:
            return None
        entry = _Entry(model)
        _cache.put(key, entry)
    if entry.compiled.selection is not None:
        # The values are part of the signature, and therefore the same.
        recalled: CompiledModel = replaced(entry.compiled, timings={})
        return recalled
    _ = entry.compiled.constant_divisors  # kept by the models for other values, which compare theirs with them
    model = _with_values(entry.compiled, flat)
    if shrunken_divisor(model, model.parameter_values, _SHRUNK):
        return None
    points = model.solution.structure.points
    for variable, node in model.solution.definitions:
        points.define(variable, node)
    divisors = entry.divisors
    if len(list(_safe(points, divisors))) < len(divisors) or not _choices_hold(model.solution.structure):
        return None
    return model


def remember(key: Signature, compiled: CompiledModel) -> None:
    """Add a model to the cache of this process and, if it was expensive, to the one on disk."""
    _cache.put(key, _Entry(compiled))
    keep(key, compiled)


def forget() -> None:
    """Empty the cache."""
    _cache.clear()


def _with_values(compiled: CompiledModel, flat: FlatSystem) -> CompiledModel:
    """A compiled model for another flat system of the same structure; functions made so far are shared."""
    old = compiled.solution.structure
    # keep the old pool: it equals the new one but for derivatives added by the compiler
    fields_with_values = ("parameter_values", "experiment", "components", "loops", "notes")
    new_values = {name: getattr(flat, name) for name in fields_with_values}
    old_flat = old.reduced.flat
    # keep the old variables too where the compiler has added some, for combinations of equations
    has_more = old_flat.n_scalars > flat.n_scalars
    new_flat = replace(old_flat, **new_values) if has_more else replace(flat, pool=old_flat.pool)
    reduced = replaced(old.reduced, flat=new_flat)
    structure = replace(old, reduced=reduced, points=SamplePoints(reduced, old.points.visited))
    solution = replace(compiled.solution, structure=structure)
    start = compiled.start
    if start.conditions or start.surplus:
        start = start_problem(solution)  # its messages name places in the source
    recalled: CompiledModel = replaced(compiled, solution=solution, start=start, timings={})
    return recalled


def replaced(old: Any, **changes: Any) -> Any:
    """Like `dataclasses.replace`, but keep cached properties; none of them may depend on the values of parameters."""
    new = replace(old, **changes)
    for name in {n for cls in type(old).__mro__ for n, v in vars(cls).items() if isinstance(v, cached_property)}:
        if name in old.__dict__:
            new.__dict__[name] = old.__dict__[name]
    return new


def _safe(points: SamplePoints, nodes: Sequence[int]) -> Iterator[int]:
    """Nodes that keep their sign at all sample points, so that dividing by them is safe."""
    return (n for n in nodes if keeps_sign(points.significant(n)))


def choices_hold_for(compiled: CompiledModel, values: Sequence[float]) -> bool:
    """Whether the choice of states also holds for these values of the free parameters."""
    structure = compiled.solution.structure
    if not any(choice.varies for choice in structure.choices):
        return True
    flat = replace(compiled.flat, parameter_values=tuple(values[: len(compiled.flat.parameter_values)]))
    reduced = replaced(structure.reduced, flat=flat)
    return _choices_hold(replace(structure, reduced=reduced, points=SamplePoints(reduced, structure.points.visited)))


def _choices_hold(structure: Structure) -> bool:
    """Whether the constraints still determine their dummy derivatives: determinants keep their sign and size."""
    pool = structure.reduced.pool
    for choice in structure.choices:
        unsolved = {*choice.floating, *choice.deficient}
        rows = [structure.residuals[structure.integral[e]] for e in choice.equations if e not in unsolved]
        column_of = {pool.integral_of[v]: k for k, v in enumerate(choice.dummies)}
        if choice.deficient or len(rows) > _MOST_EQUATIONS or len(rows) != len(column_of):
            return False
        # Include points far from the start, as when the states were chosen.
        use_far_points = choice.varies and all(v < len(structure.reduced.scalar) for v in choice.dummies)
        leaves = structure.points.leaves_anywhere if use_far_points else structure.points.leaves
        jacobian = np.zeros((COUNT + FAR if use_far_points else COUNT, len(rows), len(rows)))
        for i, gradient in enumerate(gradients(pool, rows, column_of, leaves)):
            for v, g in gradient.items():
                jacobian[:, i, column_of[v]] = g
        if not np.isfinite(jacobian).all():
            return False
        sign, size = np.linalg.slogdet(jacobian)
        if len(rows) and not ((sign == sign[0]).all() and sign[0] != 0 and np.ptp(size) < _LARGEST_LOG_RATIO):
            return False
    return True


_LARGEST_LOG_RATIO = 12.0
"""Natural logarithm of the largest ratio of determinants between sample points."""
