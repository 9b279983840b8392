"""Compiled models by structure: the same equations with other numbers are not compiled a second time.

The signature of a flat system leaves out the values of parameters and where things stand in the source; it keeps which
of them are zero and which negative. Beyond that nothing is believed: what was divided by safely, the difference of two
stiffnesses for example, must be safe for the new numbers, and the choice of states must stand, else the model is
compiled anew.
"""

from __future__ import annotations

import threading
from array import array
from collections import OrderedDict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import numpy as np

from acausal.analyse.analyse import Structure
from acausal.analyse.blocks.pivots import keeps_sign
from acausal.analyse.start import start_problem
from acausal.flatten.flat import FlatSystem
from acausal.language.declarations.declaration import Declaration
from acausal.lower.cache.stored import find, keep
from acausal.lower.compiled import CompiledModel
from acausal.numeric.evaluate import gradients
from acausal.numeric.samples import COUNT, FAR, SamplePoints

Signature = tuple[Any, ...]

_MOST_MODELS = 32
_MOST_NODES = 1_000_000
_LARGEST_CHOICE = 200
_PLAIN = frozenset((int, float, str, bool))  # nearly all there is: asking for abstract classes takes ten times as long
# Fields of the flat system that say nothing about structure, or are treated apart.
_APART = {"pool", "equations", "variables", "parameter_values", "experiment", "components", "loops", "notes"}


def signature(flat: FlatSystem, formulation: str, wishes: Any = None) -> Signature:
    """What decides how a flat system is compiled; to be taken before anything else uses its pool.

    `wishes` are those of a model that is made smaller; the values of its parameters then count too.
    """
    pool = flat.pool
    return (
        formulation,
        wishes if wishes is None else (wishes, flat.parameter_values, flat.experiment),
        tuple(pool.nodes),
        pool.n_variables,
        tuple(pool.integral_of.items()),
        tuple(pool.slope.items()),
        array("q", [e.left for e in flat.equations]).tobytes(),
        array("q", [e.right for e in flat.equations]).tobytes(),
        tuple([e.component for e in flat.equations]),
        tuple(flat.variables),
        tuple((v > 0) - (v < 0) for v in flat.parameter_values),
        *(_frozen(getattr(flat, f.name)) for f in fields(flat) if f.name not in _APART),
    )


def _frozen(value: Any) -> Any:
    """Numbers, names, declarations and classes, nested as they were; places in the source and texts drop out."""
    if type(value) in _PLAIN:
        return value
    if isinstance(value, Mapping):
        return tuple((k, _frozen(v)) for k, v in value.items())
    if isinstance(value, tuple | list):
        return tuple(_frozen(v) for v in value)
    return value if isinstance(value, int | float | str | type | Declaration | None) else None


@dataclass(frozen=True, eq=False)
class _Entry:
    """A compiled model that others of its structure share."""

    compiled: CompiledModel

    @property
    def size(self) -> int:
        """Nodes it holds."""
        structure = self.compiled.solution.structure
        return len(structure.reduced.pool.nodes) + len(structure.reduced.flat.pool.nodes)

    @cached_property
    def divisors(self) -> tuple[int, ...]:
        """What is divided by, as far as it is safe for the numbers the model was compiled with."""
        solution = self.compiled.solution
        nodes = solution.structure.reduced.pool.nodes
        roots = [n for _, n in solution.definitions]
        found = {nodes[n][2] for n in solution.structure.reduced.pool.reachable(roots) if nodes[n][0] == "div"}
        return tuple(_safe(solution.structure.points, sorted(found)))


class _Cache:
    """The models used last, as many as fit."""

    def __init__(self) -> None:
        self.entries: OrderedDict[Signature, _Entry] = OrderedDict()
        self.lock = threading.Lock()

    def get(self, key: Signature) -> _Entry | None:
        with self.lock:
            entry = self.entries.get(key)
            if entry is not None:
                self.entries.move_to_end(key)
            return entry

    def put(self, key: Signature, entry: _Entry) -> None:
        with self.lock:
            self.entries[key] = entry
            self.entries.move_to_end(key)
            while len(self.entries) > 1 and (
                len(self.entries) > _MOST_MODELS or sum(e.size for e in self.entries.values()) > _MOST_NODES
            ):
                self.entries.popitem(last=False)


_cache = _Cache()


def recall(key: Signature, flat: FlatSystem) -> CompiledModel | None:
    """The model of this structure with the values of `flat`; None when there is none, or it would not be safe."""
    entry = _cache.get(key)
    if entry is None:
        found = find(key, flat)
        if found is None:
            return None
        entry = _Entry(found)
        _cache.put(key, entry)
    if entry.compiled.selection is not None:
        # its flat system is a part of this one, and its values are the same
        recalled: CompiledModel = replaced(entry.compiled, timings={})
        return recalled
    found = _with_values(entry.compiled, flat)
    points = found.solution.structure.points
    for variable, node in found.solution.definitions:
        points.define(variable, node)
    divisors = entry.divisors
    if len(list(_safe(points, divisors))) < len(divisors) or not _choices_stand(found.solution.structure):
        return None
    return found


def remember(key: Signature, compiled: CompiledModel) -> None:
    """Keep a model for others of its structure, of this process and of others."""
    _cache.put(key, _Entry(compiled))
    keep(key, compiled)


def forget() -> None:
    """Empty the cache."""
    with _cache.lock:
        _cache.entries.clear()


def _with_values(compiled: CompiledModel, flat: FlatSystem) -> CompiledModel:
    """A compiled model for another flat system of the same structure; functions made so far are shared."""
    old = compiled.solution.structure
    # compiling has put derivatives into the old pool, which otherwise equals the new one
    known = {name: getattr(flat, name) for name in ("parameter_values", "experiment", "components", "loops", "notes")}
    own = old.reduced.flat
    named = own.n_scalars > flat.n_scalars  # variables for combinations, which other places in the source say as well
    reduced = replaced(old.reduced, flat=replace(own, **known) if named else replace(flat, pool=own.pool))
    structure = replace(old, reduced=reduced, points=SamplePoints(reduced, old.points.visited))
    solution = replace(compiled.solution, structure=structure)
    start = compiled.start
    if start.conditions or start.surplus:
        start = start_problem(solution)  # for the places in its messages
    recalled: CompiledModel = replaced(compiled, solution=solution, start=start, timings={})
    return recalled


def replaced(old: Any, **changes: Any) -> Any:
    """As `dataclasses.replace`; properties computed already are kept, because none depends on parameters' values."""
    new = replace(old, **changes)
    for name in {n for cls in type(old).__mro__ for n, v in vars(cls).items() if isinstance(v, cached_property)}:
        if name in old.__dict__:
            new.__dict__[name] = old.__dict__[name]
    return new


def _safe(points: SamplePoints, nodes: Sequence[int]) -> Iterator[int]:
    """Nodes that keep their sign at all sample points."""
    return (n for n in nodes if keeps_sign(points.significant(n)))


def choices_stand_for(compiled: CompiledModel, values: Sequence[float]) -> bool:
    """Whether the states that were chosen are good for other values of the free parameters, too."""
    structure = compiled.solution.structure
    if not any(choice.varies for choice in structure.choices):
        return True
    flat = replace(compiled.flat, parameter_values=tuple(values[: len(compiled.flat.parameter_values)]))
    reduced = replaced(structure.reduced, flat=flat)
    return _choices_stand(replace(structure, reduced=reduced, points=SamplePoints(reduced, structure.points.visited)))


def _choices_stand(structure: Structure) -> bool:
    """Whether the constraints still determine what was left to them, with pivots as large as was asked for."""
    pool = structure.reduced.pool
    for choice in structure.choices:
        stuck = {*choice.floating, *choice.deficient}
        rows = [structure.residuals[structure.integral[e]] for e in choice.equations if e not in stuck]
        place = {pool.integral_of[v]: k for k, v in enumerate(choice.dummies)}
        if choice.deficient or len(rows) > _LARGEST_CHOICE or len(rows) != len(place):
            return False
        # a choice that holds wherever the run may go was judged there
        everywhere = choice.varies and all(v < len(structure.reduced.scalar) for v in choice.dummies)
        leaves = structure.points.leaves_anywhere if everywhere else structure.points.leaves
        jacobian = np.zeros((COUNT + FAR if everywhere else COUNT, len(rows), len(rows)))
        for i, gradient in enumerate(gradients(pool, rows, place, leaves)):
            for v, g in gradient.items():
                jacobian[:, i, place[v]] = g
        if not np.isfinite(jacobian).all():
            return False
        sign, size = np.linalg.slogdet(jacobian)
        if len(rows) and not ((sign == sign[0]).all() and sign[0] != 0 and np.ptp(size) < _SPREAD):
            return False
    return True


_SPREAD = 12.0
"""Logarithm of the largest ratio of determinants between sample points."""
