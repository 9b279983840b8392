"""Arguments of the steep functions in the equations of a model, computed by one function of its variables."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from acausal.analyse.events.by_modes import KINKS, deciding_relation, sides
from acausal.analyse.events.steep import Base, Kind
from acausal.arrays import Vector
from acausal.lower.build import BUILD, Symbols
from acausal.lower.compiled import CompiledModel
from acausal.recent import once_per_owner
from acausal.simulate.equations.calls.buffered import NarrowFunction
from acausal.simulate.equations.levels import Levels

# Functions that change by less than this factor, or steps by less than this fraction of their height, are not steep.
_MILD, _ROUNDING = 2.0, 1e-16
# Combinations of modes for which the active functions are cached.
_MOST_SETS = 64


@dataclass(frozen=True, eq=False)
class Arguments:
    """Arguments of k steep functions, and after them the midpoints that belong to some of them.

    The kinds of functions and their midpoints are those of `acausal.analyse.events.steep`. `owners` are the indices of
    the arguments to which the columns belong, shape (columns,); each of the first k belongs to itself.
    """

    function: NarrowFunction
    levels: Levels
    owners: NDArray[np.int64]
    effects: Effects
    along: Callable[[], Any]
    """`(t, x, z, u, p, m, v) -> (columns, their rates, heights, relative rates)`, for rates v of the dynamic states.

    Heights are those of `Levels.heights`. A relative rate bounds the rates of both heights, divided by them [1/s].
    """

    def are_active(self, m: Vector) -> NDArray[np.bool_]:
        """Whether the rates depend on the functions of these columns in these modes, shape (columns,)."""
        return np.asarray(self.effects.of(m)[self.owners])

    def at(self, times: Vector, x: Vector, z: Vector, u: Vector, p: Vector, m: Vector) -> Vector:
        """All columns at n instants, shape (n, columns); `x` and `z` have shapes (nx, n) and (nz, n)."""
        return self.function.many(times[:, None], x.T, z.T, u, p, m)

    def are_steep(self, values: Vector) -> NDArray[np.bool_]:
        """Whether the columns belong to functions that are steep in the range of their arguments, shape (columns,).

        That range extends the values at the n instants, shape (n, columns), by the largest change from any instant to
        the next.
        """
        arguments = values[:, : self.levels.count]
        margin = np.abs(np.diff(arguments, axis=0)).max(axis=0, initial=0.0)
        ends = np.stack([arguments.min(axis=0) - margin, arguments.max(axis=0) + margin])
        heights = self.levels.heights(ends)
        heights = np.where(self.levels.is_step, np.maximum(heights, _ROUNDING), heights)
        change = heights.max(axis=0) / _MILD > heights.min(axis=0)
        passes_zero = self.levels.may_turn & (ends[0] <= 0.0) & (ends[1] >= 0.0)
        return np.asarray((change.any(axis=0) | passes_zero)[self.owners])


class Effects:
    """Determines the steep functions on which rates and residuals depend in given modes.

    For example the friction of a contact is multiplied by a force that is zero while nothing touches, so that its
    function needs no search then.
    """

    def __init__(self, compiled: CompiledModel) -> None:
        self._symbols = Symbols(compiled)
        self._active_by_modes: dict[bytes, NDArray[np.bool_]] = {}
        events, timely = compiled.state_events, len(compiled.time_events.relations)
        first = compiled.n_modes - len(events.relations)
        self._relation_modes = [*range(timely), *range(first, compiled.n_modes)]
        self._arguments_of = tuple(places for _, places in compiled.narrow.functions)
        # the rates of a regime are different, and an argument whose function is unknown always counts as active
        unknown = set(range(len(compiled.narrow.arguments))).difference(*self._arguments_of)
        self._always_active = np.array([compiled.varied or j in unknown for j in range(len(compiled.narrow.arguments))])
        self._change = ca.SX.sym("change", len(self._arguments_of))
        self._rates: Any = None if self._always_active.all() else self._with_changes(compiled)

    def of(self, m: Vector) -> NDArray[np.bool_]:
        """Whether each argument belongs to an active function, shape (k,)."""
        if self._rates is None:
            return self._always_active
        key = m[self._relation_modes].tobytes()
        if key not in self._active_by_modes:
            if len(self._active_by_modes) >= _MOST_SETS:
                return np.ones_like(self._always_active)
            self._active_by_modes[key] = self._active_in(m)
        return self._active_by_modes[key]

    def _active_in(self, m: Vector) -> NDArray[np.bool_]:
        """The active arguments: their functions remain in the rates after modes are replaced by numbers, shape (k,)."""
        *given, modes = self._symbols.inputs
        modes = ca.SX(modes)
        for k in self._relation_modes:
            modes[k] = m[k]
        rates = self._rates(*given, modes, self._change)
        active = self._always_active.copy()
        for places, counts in zip(self._arguments_of, ca.which_depends(rates, self._change, 1, False), strict=True):
            active[list(places)] |= counts
        return active

    def _with_changes(self, compiled: CompiledModel) -> Any:
        """Rates and residuals with a symbol added to each function, and with kinks and relations decided by modes."""
        # In the equations as written: where a guard replaces a function, it could not be varied separately.
        builder = self._symbols.builder(compiled)
        solution, pool = compiled.solution, builder.pool
        definitions = [d for d in solution.definitions if d[0] in solution.needed]
        builder.define(definitions, {})
        changes: dict[int, Callable[[list[Any]], Any]] = {}
        first = compiled.n_modes - len(compiled.state_events.relations)
        modes = {n: self._symbols.m[first + k] for k, n in enumerate(compiled.state_events.relations)}
        known = sides(pool, modes)
        for number in pool.reachable([*(n for _, n in definitions), *solution.residuals]):
            decision = deciding_relation(pool, number, known)
            if decision is not None and number not in modes:
                truth = modes[decision[0]] if decision[1] else 1 - modes[decision[0]]
                changes[number] = partial(_on_one_side, pool.nodes[number][0], truth)
        for (number, _), change in zip(compiled.narrow.functions, ca.vertsplit(self._change), strict=True):
            changes[number] = partial(_plus, change, pool.nodes[number][0])
        builder.changes = changes
        rates = solution.structure.rates(compiled.state_variables)
        column = builder.column([*rates, *solution.residuals])
        return ca.Function("changed", [*self._symbols.inputs, self._change], [column])


def _on_one_side(op: str, truth: Any, operands: list[Any]) -> Any:
    """A kink as one of its operands, by the mode that says which is larger; for a relation its mode."""
    if op not in KINKS:
        return truth
    a, b = operands if len(operands) == 2 else (operands[0], -operands[0])
    return ca.if_else(truth, b, a) if op == "min" else ca.if_else(truth, a, b)


def _plus(change: Any, op: str, operands: list[Any]) -> Any:
    return BUILD[op](*operands) + change


def arguments(compiled: CompiledModel) -> Arguments | None:
    """The arguments of the steep functions of a model; None if no rate depends on such a function."""
    return _arguments(compiled.common)


@once_per_owner
def _arguments(compiled: CompiledModel) -> Arguments | None:
    narrow_functions = compiled.narrow
    if not narrow_functions.arguments:
        return None
    symbols = Symbols(compiled)
    builder = symbols.defined(compiled)
    nodes = *narrow_functions.arguments, *(w for w, _ in narrow_functions.middles)
    column = builder.column(builder.replaced(nodes))
    owners = [*range(len(narrow_functions.arguments)), *(place for _, place in narrow_functions.middles)]
    column = ca.densify(column)
    narrow = NarrowFunction("arguments", symbols.inputs, column)
    along = cache(partial(_along, symbols, column, narrow_functions.kinds, compiled.n_dynamic))
    return Arguments(narrow, Levels(narrow_functions.kinds), np.array(owners), Effects(compiled), along)


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
    """A bound on the rates of both results of `_both_ends`, divided by them, for this rate of the argument."""
    if kind == "tanh":
        return 2.0 * rate
    if isinstance(kind, Base):
        return abs(kind.rate) * rate
    # the logarithmic derivative of the other kinds is at most one
    return abs(kind) * rate / ca.fabs(argument) if isinstance(kind, float) else rate


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
