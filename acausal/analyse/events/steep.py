"""Steep functions, which change only in a narrow range of their argument, and their arguments.

Examples are `tanh`, `atan`, `exp`, high powers, and roots of and divisions by a square plus a small constant. Far from
that range a rate is constant, so that nothing but the argument bounds the step of a solver, and the argument is smooth.
Between two instants over which the argument is monotone, the values at the ends show that the function has changed. It
may change and change back where the argument has an extremum, or, if one rate contains several steps, where one of them
is at its middle.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from acausal.flatten.pool import LEAVES, Pool
from acausal.numeric.intervals import ranges
from acausal.numeric.samples import SamplePoints

_NAMED = {"tanh": "tanh", "atan": "atan", "exp": "exp", "cosh": "cosh", "sinh": "cosh"}
_KINKS = frozenset(("min", "max", "noevent"))
_LEAST_EXPONENT = 8.0
# An argument whose samples differ by less than this factor has no narrow valley.
_VALLEY_RATIO = 300.0
# Fraction of an upper bound by which rounding errors may make a lower bound of zero negative.
_ROUNDING = 1e-12
STEPS = frozenset(("tanh", "atan"))
"""Functions that go from one limit to another, around a zero of their argument."""
_THROUGH = frozenset(("add", "sub", "neg", "mul", "div", "sqrt", "pow"))
_SUMS = frozenset(("add", "sub"))


@dataclass(frozen=True)
class Base:
    """An exponential with another base than e; `rate` is the logarithm of the base."""

    rate: float


Kind = str | float | Base
"""Kind of a steep function: "tanh", "atan", "exp", "cosh" (also for sinh), a `Base`, or the exponent of a power."""


@dataclass(frozen=True)
class Steep:
    """Arguments of steep functions, as nodes, and the kind of function of each.

    Roots and denominators count as powers. `middles` are nodes that are zero where the function changes, each with the
    index of its argument: the argument of a step itself, or w for an argument that is even in w. `functions` are the
    nodes of the functions, in evaluation order, each with the indices of its arguments.
    """

    arguments: tuple[int, ...] = ()
    kinds: tuple[Kind, ...] = ()
    middles: tuple[tuple[int, int], ...] = ()
    functions: tuple[tuple[int, tuple[int, ...]], ...] = ()


class Moving:
    """Tells whether a node varies between events."""

    def __init__(self, pool: Pool, discrete: frozenset[int]) -> None:
        self._pool, self._discrete = pool, discrete
        self._known: dict[int, bool] = {}

    def __call__(self, number: int) -> bool:
        known = self._known.get(number)
        if known is not None:
            return known
        for n in self._pool.reachable([number], self._known):
            op, *rest = self._pool.nodes[n]
            moving = (op == "var" and rest[0] not in self._discrete) or op == "time"
            self._known[n] = moving or (op not in LEAVES and any(self._known[c] for c in rest))
        return self._known[number]


def steep(pool: Pool, points: SamplePoints, reachable: Iterable[int], moves: Callable[[int], bool]) -> Steep:
    """The steep functions among `reachable` nodes, in evaluation order, whose argument varies between events."""
    index_of: dict[tuple[int, Kind], int] = {}
    functions: list[tuple[int, tuple[int, ...]]] = []
    # Few, because most quotients divide by parameters.
    candidates = [(n, a) for n, a in _arguments(pool, reachable, moves) if moves(a)]
    if not candidates:
        return Steep()
    below = pool.reachable(a for _, a in candidates)
    has_floor = _floors(pool, below, moves)
    bounds = ranges(pool, below, lambda n: None if moves(n) else float(points.of(n)[0]))

    def is_valley(argument: int) -> bool:
        """Whether an argument has a narrow minimum above zero, much smaller than its values elsewhere."""
        low, high = bounds[argument]
        low, high = (low, high) if low + high > 0.0 else (-high, -low)
        if low >= -_ROUNDING * high and math.isfinite(high):
            return high > _VALLEY_RATIO * low or any(pool.nodes[n][0] == "par" for n in pool.reachable([argument]))
        return has_floor[argument] or (low > 0.0 and _is_narrow_valley(points, argument))

    for number, argument in candidates:
        op, *operands = pool.nodes[number]
        kind: Kind | None = None
        if op in _NAMED:
            kind = _NAMED[op]
        elif op in ("sqrt", "div") and is_valley(argument):
            kind = 0.5 if op == "sqrt" else -1.0
        elif op == "pow" and argument == operands[1]:
            kind = Base(_rate(points, operands[0]))
        elif op == "pow":
            exponent = float(points.of(operands[1])[0])
            if exponent >= _LEAST_EXPONENT or (exponent < 1.0 and is_valley(argument)):
                kind = exponent
        if kind is not None:
            indices = [index_of.setdefault((n, kind), len(index_of)) for n in _operands_of_kinks(pool, argument, moves)]
            functions.append((number, tuple(indices)))
    middles = [
        (w, index)
        for index, (argument, kind) in enumerate(index_of)
        for w in ([argument] if kind in STEPS else _even_variables(pool, argument, moves))
    ]
    return Steep(tuple(n for n, _ in index_of), tuple(kind for _, kind in index_of), tuple(middles), tuple(functions))


def _arguments(pool: Pool, reachable: Iterable[int], moves: Callable[[int], bool]) -> Iterator[tuple[int, int]]:
    """(Node, argument) of functions that may be steep."""
    nodes = pool.nodes
    for number in reachable:
        node = nodes[number]
        op = node[0]
        if op == "div":
            yield number, node[2]
        elif op == "pow":
            yield number, node[2] if moves(node[2]) else node[1]
        elif op in _NAMED or op == "sqrt":
            yield number, node[1]


def _rate(points: SamplePoints, base: int) -> float:
    """The logarithm of a base, the largest in magnitude if the base varies; 1 where it would be zero or undefined."""
    values = np.abs(points.everywhere(base))
    with np.errstate(divide="ignore"):
        sizes = np.log(values[np.isfinite(values)])
    sizes = sizes[np.isfinite(sizes)]
    return float(sizes[np.abs(sizes).argmax()]) if sizes.size and sizes.any() else 1.0


def _even_variables(pool: Pool, number: int, moves: Callable[[int], bool]) -> list[int]:
    """Nodes of which an expression contains an even function, found through its sums, products, powers and roots."""
    even_nodes, stack, seen = [], [number], set[int]()
    while stack:
        here = stack.pop()
        op, *operands = pool.nodes[here]
        if here in seen or not moves(here):
            continue
        seen.add(here)
        if _is_even(pool, op, operands):
            even_nodes.append(operands[0])
        elif op in _THROUGH:
            stack += operands
    return even_nodes


def _is_even(pool: Pool, op: str, operands: list[int]) -> bool:
    if op == "mul":
        return operands[0] == operands[1]
    if op == "pow":
        node = pool.nodes[operands[1]]
        return node[0] == "const" and float(node[1]) % 2.0 == 0.0
    return op in ("fabs", "cosh")


def _operands_of_kinks(pool: Pool, number: int, moves: Callable[[int], bool]) -> list[int]:
    """An argument, or the operands if it is a `minimum` or `maximum`, which may be constant over a long time."""
    arguments, stack, seen = [], [number], set[int]()
    while stack:
        here = stack.pop()
        op, *operands = pool.nodes[here]
        if here in seen:
            continue
        seen.add(here)
        if op in _KINKS:
            stack += [n for n in operands if moves(n)]
        else:
            arguments.append(here)
    return arguments


def _is_narrow_valley(points: SamplePoints, number: int) -> bool:
    """Whether a positive argument has a narrow valley: at some sample points it is far larger than at others."""
    values = np.abs(points.everywhere(number))
    values = values[np.isfinite(values)]
    return bool(values.size and values.max() > _VALLEY_RATIO * values.min())


def _floors(pool: Pool, reachable: Iterable[int], moves: Callable[[int], bool]) -> dict[int, bool]:
    """Whether each of these nodes contains the sum of a constant and an even power: w**2 + eps**2.

    A single pass in evaluation order; a search from every root would visit shared expressions repeatedly.
    """
    constant: dict[int, bool] = {}
    even: dict[int, bool] = {}
    for here in reachable:
        op, *operands = pool.nodes[here]
        constant[here], even[here] = not moves(here), False
        if constant[here]:
            continue
        if op == "pow":
            even[here] = not moves(operands[1])
        elif op == "mul" and operands[0] == operands[1]:
            even[here] = True
        elif op in _SUMS or op in ("mul", "div"):
            relevant = operands if op in _SUMS else [n for n in operands if moves(n)]
            constant[here], even[here] = (any(flag[n] for n in relevant) for flag in (constant, even))
    return {n: constant[n] and even[n] for n in constant}
