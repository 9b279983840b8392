"""Arguments of steep functions in the equations of a model, as one function of its variables."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any
from weakref import WeakKeyDictionary

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from acausal.analyse.events.by_modes import compared
from acausal.analyse.events.steep import STEPS
from acausal.arrays import Vector
from acausal.flatten.pool import Pool
from acausal.lower.build import BUILD
from acausal.lower.compiled import CompiledModel
from acausal.lower.symbols import Symbols
from acausal.simulate.equations.calls.quick import Narrow

# Functions that change by less than this factor, or of which less than this share of a step changes, are not steep.
_MILD, _ROUNDING = 2.0, 1e-16
_COMPARING = frozenset(("max", "min", "gt", "ge", "lt", "le"))
# Sets of relations of which is kept what they put to sleep.
_MOST_SETS = 64


@dataclass(frozen=True, eq=False)
class Arguments:
    """Arguments of k steep functions, their kinds (`acausal.analyse.events.steep`), and then their middles.

    `owners` are the arguments that these columns belong to, first each to itself.
    """

    function: Narrow
    kinds: tuple[str | float, ...]
    owners: NDArray[np.int64]
    effects: Effects

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
        own = values[:, : len(self.kinds)]
        beyond = np.abs(np.diff(own, axis=0)).max(axis=0, initial=0.0)
        ends = np.stack([own.min(axis=0) - beyond, own.max(axis=0) + beyond])
        heights = self.heights(ends)
        is_step = np.array([kind in STEPS for kind in self.kinds])
        heights = np.where(is_step, np.maximum(heights, _ROUNDING), heights)
        change = heights.max(axis=0) / _MILD > heights.min(axis=0)
        is_power = np.array([not isinstance(kind, str) for kind in self.kinds])
        through = is_power & (ends[0] <= 0.0) & (ends[1] >= 0.0)
        return np.asarray((change.any(axis=0) | through)[self.owners])

    def heights(self, values: Vector) -> Vector:
        """What the functions are above both of their ends at such values; shape (n, 2, k)."""
        found = np.zeros((len(values), 2, len(self.kinds)))
        for j, kind in enumerate(self.kinds):
            own = values[:, j]
            with np.errstate(all="ignore"):
                if kind == "tanh":
                    found[:, :, j] = np.stack([1.0 / (1.0 + np.exp(-2.0 * s * own)) for s in (1.0, -1.0)], axis=1)
                elif kind == "atan":
                    found[:, :, j] = np.stack([0.5 + np.arctan(s * own) / np.pi for s in (1.0, -1.0)], axis=1)
                elif kind == "exp":
                    found[:, 0, j] = np.exp(own)
                else:
                    found[:, 0, j] = np.abs(own) ** float(kind)
        return np.nan_to_num(found)


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
        larger, changes = self._larger(compiled), dict[int, Callable[[list[Any]], Any]]()
        for number in pool.reachable([*(n for _, n in definitions), *solution.residuals]):
            told = _told(pool, number, larger)
            if told is not None:
                changes[number] = told
        for (number, _), change in zip(compiled.narrow.functions, ca.vertsplit(self._change), strict=True):
            changes[number] = partial(_plus, change, pool.nodes[number][0])
        builder.changes = changes
        rates = [pool.var(solution.structure.derivative(x)) for x in compiled.state_variables]
        column = builder.column([*rates, *solution.residuals])
        return ca.Function("changed", [*self._symbols.inputs, self._change], [column])

    def _larger(self, compiled: CompiledModel) -> dict[tuple[int, int], Any]:
        """Whether the first of two nodes is larger than the second, by the modes of relations between them."""
        events, pool = compiled.state_events, compiled.solution.structure.reduced.pool
        found: dict[tuple[int, int], Any] = {}
        first = compiled.n_modes - len(events.relations)
        for k, relation in enumerate(events.relations):
            op, *sides = pool.nodes[relation]
            mode = self._symbols.m[first + k]
            # a < b is b > a, and a <= b is not a > b
            found[compared(pool, *(sides if op in ("gt", "le") else reversed(sides)))] = (
                mode if op in ("gt", "lt") else 1 - mode
            )
        return found


def _told(pool: Pool, number: int, larger: Mapping[tuple[int, int], Any]) -> Callable[[list[Any]], Any] | None:
    """What a kink or a relation without event is of its operands, where a mode tells which one is larger."""
    op, *operands = pool.nodes[number]
    if op not in _COMPARING:
        return None
    a, b = compared(pool, *(reversed(operands) if op in ("lt", "ge") else operands))
    is_larger = larger.get((a, b))
    if is_larger is None and op in ("max", "min") and (b, a) in larger:
        is_larger = 1 - larger[b, a]
    if is_larger is None:
        return None
    if op in ("max", "min"):
        return lambda sides: ca.if_else(is_larger, *(sides if op == "max" else reversed(sides)))
    return lambda sides: is_larger if op in ("gt", "lt") else 1 - is_larger


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
    column = builder.column([builder.replaced(n) for n in nodes])
    owners = [*range(len(found.arguments)), *(place for _, place in found.middles)]
    narrow = Narrow("arguments", symbols.inputs, ca.densify(column))
    return Arguments(narrow, found.kinds, np.array(owners), Effects(compiled))
