"""Arguments of steep functions in the equations of a model, as one function of its variables."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from typing import Any
from weakref import WeakKeyDictionary

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from acausal.analyse.events.by_modes import KINKS, deciding_relation, sides
from acausal.analyse.events.steep import Base, Kind
from acausal.arrays import Vector
from acausal.lower.build import BUILD, Symbols
from acausal.lower.compiled import CompiledModel
from acausal.simulate.equations.calls.buffered import NarrowFunction
from acausal.simulate.equations.levels import Levels

# Functions that change by less than this factor, or of which less than this share of a step changes, are not steep.
_MILD, _ROUNDING = 2.0, 1e-16
# Sets of relations of which is kept what they put to sleep.
_MOST_SETS = 64


@dataclass(frozen=True, eq=False)
class Arguments:
    """Arguments of k steep functions, their kinds (`acausal.analyse.events.steep`), and then their middles.

    `owners` are the arguments that these columns belong to, first each to itself.
    """

    function: NarrowFunction
    levels: Levels
    owners: NDArray[np.int64]
    effects: Effects
    along: Callable[[], Any]
    """`(t, x, z, u, p, m, v) -> (columns, their slopes, heights, relative rates)`, by rates v of dynamic states.

    Heights are those of `Levels.heights`. A relative rate is a bound of the rate of both, over their size [1/s].
    """

    def awake(self, m: Vector) -> NDArray[np.bool_]:
        """Columns of functions on which rates depend while these modes are in force; shape of the columns."""
        return np.asarray(self.effects.of(m)[self.owners])

    def at(self, times: Vector, x: Vector, z: Vector, u: Vector, p: Vector, m: Vector) -> Vector:
        """All of them at n instants; states and algebraic variables have shapes (nx, n) and (nz, n)."""
        return self.function.many(times[:, None], x.T, z.T, u, p, m)

    def are_steep(self, values: Vector) -> NDArray[np.bool_]:
        """Whether these columns belong to functions that are steep where their arguments go; shape of the columns.

        Arguments may go as far beyond their values at the n instants as they go from any of them to the next.
        """
        own = values[:, : self.levels.count]
        beyond = np.abs(np.diff(own, axis=0)).max(axis=0, initial=0.0)
        ends = np.stack([own.min(axis=0) - beyond, own.max(axis=0) + beyond])
        heights = self.levels.heights(ends)
        heights = np.where(self.levels.is_step, np.maximum(heights, _ROUNDING), heights)
        change = heights.max(axis=0) / _MILD > heights.min(axis=0)
        through = self.levels.may_turn & (ends[0] <= 0.0) & (ends[1] >= 0.0)
        return np.asarray((change.any(axis=0) | through)[self.owners])


class Effects:
    """On which steep functions rates and residuals depend while relations are as they are.

    The friction of a contact is a factor of a force that is zero while nothing touches: nothing is searched there.
    """

    def __init__(self, compiled: CompiledModel) -> None:
        self._symbols = Symbols(compiled)
        self._known: dict[bytes, NDArray[np.bool_]] = {}
        events, timely = compiled.state_events, len(compiled.time_events.relations)
        first = compiled.n_modes - len(events.relations)
        self._decided = [*range(timely), *range(first, compiled.n_modes)]
        self._uses = tuple(places for _, places in compiled.narrow.functions)
        # of a regime the rates are others; an argument whose function is not known is never asleep
        unknown = set(range(len(compiled.narrow.arguments))).difference(*self._uses)
        self._always = np.array([compiled.varied or j in unknown for j in range(len(compiled.narrow.arguments))])
        self._change = ca.SX.sym("change", len(self._uses))
        self._rates: Any = None if self._always.all() else self._changed(compiled)

    def of(self, m: Vector) -> NDArray[np.bool_]:
        """The arguments of those functions, shape (k,)."""
        if self._rates is None:
            return self._always
        key = m[self._decided].tobytes()
        if key not in self._known:
            if len(self._known) >= _MOST_SETS:
                return np.ones_like(self._always)
            self._known[key] = self._found(m)
        return self._known[key]

    def _found(self, m: Vector) -> NDArray[np.bool_]:
        """Where nothing of a function is left once modes are numbers, it has no effect."""
        *given, modes = self._symbols.inputs
        modes = ca.SX(modes)
        for k in self._decided:
            modes[k] = m[k]
        left = self._rates(*given, modes, self._change)
        found = self._always.copy()
        for places, counts in zip(self._uses, ca.which_depends(left, self._change, 1, False), strict=True):
            found[list(places)] |= counts
        return found

    def _changed(self, compiled: CompiledModel) -> Any:
        """Rates and residuals, in which something is added to each of the functions, and kinks are what they tell."""
        # as the equations were written: what stands for a function beyond a guard has no place of its own
        builder = self._symbols.builder(compiled)
        solution, pool = compiled.solution, builder.pool
        definitions = [d for d in solution.definitions if d[0] in solution.needed]
        builder.define(definitions, {})
        changes: dict[int, Callable[[list[Any]], Any]] = {}
        first = compiled.n_modes - len(compiled.state_events.relations)
        modes = {n: self._symbols.m[first + k] for k, n in enumerate(compiled.state_events.relations)}
        known = sides(pool, modes)
        for number in pool.reachable([*(n for _, n in definitions), *solution.residuals]):
            told = deciding_relation(pool, number, known)
            if told is not None and number not in modes:
                truth = modes[told[0]] if told[1] else 1 - modes[told[0]]
                changes[number] = partial(_on_one_side, pool.nodes[number][0], truth)
        for (number, _), change in zip(compiled.narrow.functions, ca.vertsplit(self._change), strict=True):
            changes[number] = partial(_plus, change, pool.nodes[number][0])
        builder.changes = changes
        rates = solution.structure.rates(compiled.state_variables)
        column = builder.column([*rates, *solution.residuals])
        return ca.Function("changed", [*self._symbols.inputs, self._change], [column])


def _on_one_side(op: str, truth: Any, operands: list[Any]) -> Any:
    """A kink of which the first operand is the larger one, or not; a relation that holds, or not."""
    if op not in KINKS:
        return truth
    a, b = operands if len(operands) == 2 else (operands[0], -operands[0])
    return ca.if_else(truth, b, a) if op == "min" else ca.if_else(truth, a, b)


def _plus(change: Any, op: str, operands: list[Any]) -> Any:
    return BUILD[op](*operands) + change


_MADE: WeakKeyDictionary[CompiledModel, Arguments | None] = WeakKeyDictionary()


def arguments(compiled: CompiledModel) -> Arguments | None:
    """Those of a model; None where no rate depends on such a function."""
    compiled = compiled.common
    if compiled not in _MADE:
        _MADE[compiled] = _made(compiled)
    return _MADE[compiled]


def _made(compiled: CompiledModel) -> Arguments | None:
    found = compiled.narrow
    if not found.arguments:
        return None
    symbols = Symbols(compiled)
    builder = symbols.defined(compiled)
    nodes = *found.arguments, *(w for w, _ in found.middles)
    column = builder.column(builder.replaced(nodes))
    owners = [*range(len(found.arguments)), *(place for _, place in found.middles)]
    column = ca.densify(column)
    narrow = NarrowFunction("arguments", symbols.inputs, column)
    along = cache(partial(_along, symbols, column, found.kinds, compiled.n_dynamic))
    return Arguments(narrow, Levels(found.kinds), np.array(owners), Effects(compiled), along)


def _along(symbols: Symbols, column: Any, kinds: tuple[Kind, ...], n: int) -> Any:
    """See `Arguments.along`."""
    t, x, *_ = symbols.inputs
    v = ca.SX.sym("v", n)
    slopes = ca.jtimes(column, x, ca.vertcat(v, ca.SX.zeros(x.numel() - n))) + ca.jtimes(column, t, ca.SX(1))
    heights = [h for kind, own in zip(kinds, ca.vertsplit(column), strict=False) for h in _both_ends(kind, own)]
    both = zip(kinds, ca.vertsplit(column), ca.vertsplit(ca.densify(slopes)), strict=False)
    rates = [_relative(kind, own, ca.fabs(slope)) for kind, own, slope in both]
    outputs = [column, *map(ca.densify, (slopes, ca.vertcat(*heights), ca.vertcat(*rates)))]
    return ca.Function("steep", [*symbols.inputs, v], outputs)


def _relative(kind: Kind, argument: Any, rate: Any) -> Any:
    """The largest rate of what `_both_ends` are, relative to their size, at this rate of the argument."""
    if kind == "tanh":
        return 2.0 * rate
    if isinstance(kind, Base):
        return abs(kind.rate) * rate
    return abs(kind) * rate / ca.fabs(argument) if isinstance(kind, float) else rate  # that of others is at most one


def _both_ends(kind: Kind, argument: Any) -> tuple[Any, Any]:
    if kind == "tanh":
        return 1.0 / (1.0 + ca.exp(-2.0 * argument)), 1.0 / (1.0 + ca.exp(2.0 * argument))
    if kind == "atan":
        return 0.5 + ca.atan(argument) / np.pi, 0.5 - ca.atan(argument) / np.pi
    if kind == "cosh":
        return ca.cosh(argument), ca.SX(0)
    if isinstance(kind, Base):
        return ca.exp(kind.rate * argument), ca.SX(0)
    return (ca.exp(argument) if kind == "exp" else ca.fabs(argument) ** float(kind)), ca.SX(0)
