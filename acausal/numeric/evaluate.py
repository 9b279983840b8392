"""Evaluation of pool expressions without CasADi: values and sparse gradients at several points at once.

The compiler decides by them which pivots and which states are safe, so that a fast set-up matters more than exactness.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from acausal.flatten.pool import IMPULSE, LEAVES, Pool
from acausal.flatten.terms import SUMS, is_long, terms
from acausal.language.expressions.delay import Delayed
from acausal.language.expressions.external import Call, External

Samples = NDArray[np.float64]
Gradient = dict[int, Any]

# Long sums are differentiated as a whole if an expression has at least this many nodes.
_LEAST_NODES = 100

FUNCTIONS: dict[str, Callable[..., Any]] = {
    "add": np.add,
    "sub": np.subtract,
    "mul": np.multiply,
    "div": np.divide,
    "neg": np.negative,
    "pow": np.power,
    "atan2": np.arctan2,
    "homotopy": lambda a, s: a,
    "noevent": lambda a: a,
    "sample": lambda a, b: 0.0,
    "pre": lambda a: a,
    IMPULSE: lambda velocity, value: value - velocity,
    "initial": lambda: 0.0,
    "after_reset": lambda: 0.0,
    "infinitesimal": lambda: 0.0,
    "terminal": lambda: 0.0,
    "min": np.minimum,
    "max": np.maximum,
    "lt": np.less,
    "le": np.less_equal,
    "gt": np.greater,
    "ge": np.greater_equal,
    "and": np.logical_and,
    "or": np.logical_or,
    "not": np.logical_not,
    "where": np.where,
    "asin": np.arcsin,
    "acos": np.arccos,
    "atan": np.arctan,
    "fabs": np.abs,
    **{n: getattr(np, n) for n in ("sin", "cos", "tan", "sinh", "cosh", "tanh", "exp", "log", "sqrt")},
    **{n: getattr(np, n) for n in ("sign", "floor", "ceil")},
}


def operation(op: str) -> Callable[..., Any]:
    """The numpy function of an operation."""
    if isinstance(op, Delayed):  # delayed values are unknown before the run: use a signal with values of both signs
        return lambda instant: np.sin(37.0 * np.asarray(instant) + 1.0 + op.number)
    return _External(op) if isinstance(op, Call) else FUNCTIONS[op]


class _External:
    """One scalar output of an external function.

    The last evaluation is cached, because the other outputs are requested right after it with the same arrays.
    """

    last: tuple[External, tuple[Any, ...], Any] | None = None

    def __init__(self, op: Call) -> None:
        self.op = op

    def __call__(self, *operands: Any) -> Any:
        external = self.op.external
        last = _External.last
        if last is None or last[0] is not external or any(a is not b for a, b in zip(last[1], operands, strict=True)):
            from acausal.numeric.external import evaluate

            last = _External.last = external, operands, evaluate(external, operands)
        return last[2][self.op.entry]


def values(
    pool: Pool,
    roots: Iterable[int],
    leaves: Mapping[str, Callable[[int], Any]],
    known: Mapping[int, Any] | None = None,
) -> dict[int, Any]:
    """Value of every node below `roots`, by node number; scalars or arrays of shape (K,) at K points.

    `leaves` maps "var", "par" and "time" to functions of the number of a leaf; `known` has values evaluated before.
    """
    value: dict[int, Any] = dict(known) if known and len(known) < 64 else {}
    with np.errstate(all="ignore"):
        for number in pool.reachable(roots):
            if number in value:
                continue
            node = pool.nodes[number]
            op = node[0]
            if op == "const":
                value[number] = node[1]
            elif op in leaves:
                value[number] = leaves[op](node[1] if len(node) > 1 else 0)
            else:
                value[number] = operation(op)(*[value[c] for c in node[1:]])
    return value


def gradients(
    pool: Pool, roots: Sequence[int], variables: Iterable[int], leaves: Mapping[str, Callable[[int], Any]]
) -> list[Gradient]:
    """Partial derivatives of each root by `variables`, as sparse rows that map variables to values, shape (K,)."""
    requested = set(variables)
    value = values(pool, roots, leaves)
    slope: dict[int, Gradient] = {}
    chains, needed = _sums(pool, roots, value)
    with np.errstate(all="ignore"):
        for number in sorted(needed):
            node = pool.nodes[number]
            op = node[0]
            if number in chains:
                slope[number] = _combine((float(times), slope[a]) for a, times in chains[number])
            elif op == "var":
                slope[number] = {node[1]: 1.0} if node[1] in requested else {}
            elif op in ("const", "par", "time"):
                slope[number] = {}
            else:
                slope[number] = _gradient(op, number, node[1:], value, slope)
    return [slope[r] for r in roots]


def _sums(
    pool: Pool, roots: Sequence[int], value: Mapping[int, Any]
) -> tuple[dict[int, list[tuple[int, int]]], Iterable[int]]:
    """Terms of the long sums below the roots, and the nodes that must be differentiated if partial sums are skipped.

    A sum of n terms is a chain of n - 1 additions: differentiation node by node would need n^2 entries.
    """
    chains: dict[int, list[tuple[int, int]]] = {}
    if len(value) < _LEAST_NODES:
        return chains, value
    needed = set(roots)
    for number in sorted(value, reverse=True):
        if number not in needed:
            continue
        op, *operands = pool.nodes[number]
        if op in SUMS and is_long(pool, number):
            chains[number] = terms(pool, number)
            needed.update(a for a, _ in chains[number])
        elif op not in LEAVES:
            needed.update(operands)
    return chains, needed


def _combine(parts: Iterable[tuple[Any, Gradient]]) -> Gradient:
    """Linear combination of sparse rows."""
    total: Gradient = {}
    for factor, gradient in parts:
        for v, g in gradient.items():
            total[v] = total[v] + factor * g if v in total else factor * g
    return total


def _gradient(
    op: str, number: int, args: tuple[int, ...], value: dict[int, Any], slope: dict[int, Gradient]
) -> Gradient:
    """Sparse gradient of one operation by the chain rule."""
    if not any(slope[a] for a in args):
        return {}
    if op == "where":
        c = np.asarray(value[args[0]], dtype=bool)
        return _combine(((c * 1.0, slope[args[1]]), (~c * 1.0, slope[args[2]])))
    if isinstance(op, Call):
        external = op.external
        operands = [value[a] for a in args]
        factors = [operation(Call(external.partials, op.entry * external.size + k)) for k in range(len(args))]
        pairs = zip(factors, args, strict=True)
        return _combine((f(*operands), slope[a]) for f, a in pairs if slope[a])
    if isinstance(op, Delayed):
        return _combine([(37.0 * np.cos(37.0 * np.asarray(value[args[0]]) + 1.0 + op.number), slope[args[0]])])
    partial = PARTIALS.get(op)
    if partial is None:
        return {}
    return _combine(zip(partial(value[number], *[value[a] for a in args]), (slope[a] for a in args), strict=True))


PARTIALS: dict[str, Callable[..., tuple[Any, ...]]] = {
    "add": lambda y, a, b: (1.0, 1.0),
    "sub": lambda y, a, b: (1.0, -1.0),
    "neg": lambda y, a: (-1.0,),
    "noevent": lambda y, a: (1.0,),
    "mul": lambda y, a, b: (b, a),
    "div": lambda y, a, b: (1.0 / np.asarray(b), -y / b),
    "pow": lambda y, a, b: (b * np.power(a, np.asarray(b) - 1.0), y * np.log(np.abs(a) + 1e-300)),
    "homotopy": lambda y, a, s: (1.0, 0.0),
    "atan2": lambda y, a, b: (b / (a * a + b * b), -a / (a * a + b * b)),
    "min": lambda y, a, b: (np.less(a, b) * 1.0, np.greater_equal(a, b) * 1.0),
    "max": lambda y, a, b: (np.greater(a, b) * 1.0, np.less_equal(a, b) * 1.0),
    "sin": lambda y, a: (np.cos(a),),
    "cos": lambda y, a: (-np.sin(a),),
    "tan": lambda y, a: (1.0 + y * y,),
    "asin": lambda y, a: (1.0 / np.sqrt(1.0 - np.square(a)),),
    "acos": lambda y, a: (-1.0 / np.sqrt(1.0 - np.square(a)),),
    "atan": lambda y, a: (1.0 / (1.0 + np.square(a)),),
    "sinh": lambda y, a: (np.cosh(a),),
    "cosh": lambda y, a: (np.sinh(a),),
    "tanh": lambda y, a: (1.0 - y * y,),
    "exp": lambda y, a: (y,),
    "log": lambda y, a: (1.0 / np.asarray(a),),
    "sqrt": lambda y, a: (0.5 / y,),
    "fabs": lambda y, a: (np.sign(a),),
}
