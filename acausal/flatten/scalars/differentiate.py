"""Time derivatives of pool expressions by the chain rule.

The derivative of variable i is the variable `pool.derivative(i)`, or the node `pool.slope[i]` where a rule was given
(rotation matrices: der(R) = R skew(w)). Every node is differentiated once per pool, so the cost is linear.
"""

from __future__ import annotations

from collections.abc import Callable

from acausal.errors import DeclarationError
from acausal.flatten.pool import LEAVES, RELATIONS, Pool
from acausal.language.expressions.delay import Delayed
from acausal.language.expressions.external import Call
from acausal.language.expressions.lookup import Lookup

_AT_INSTANTS = frozenset(("initial", "after_reset", "infinitesimal", "terminal", "sample"))
_CONSTANT = frozenset(("pre", "not", "and", "or", *_AT_INSTANTS, *RELATIONS))
"""Operations whose values are constant between events."""


def differentiate(pool: Pool, root: int) -> int:
    """The node of the time derivative of `root`."""
    derivative = pool._slopes
    stack = [root]
    while stack:
        number = stack[-1]
        if number in derivative:
            stack.pop()
            continue
        node = pool.nodes[number]
        if node[0] in LEAVES:
            derivative[number] = _leaf(pool, node[0], node[1] if len(node) > 1 else 0)
            stack.pop()
            continue
        needed = _needed(node)
        missing = [c for c in needed if c not in derivative]
        if missing:
            stack.extend(missing)
            continue
        if isinstance(node[0], Delayed):
            raise _rate_of_delay(node[0])
        if isinstance(node[0], Call):
            derivative[number] = _call(pool, node[0], node[1:])
        else:
            derivative[number] = (
                _RULES[node[0]](pool, number, *node[1:]) if node[0] in _RULES else _refuse(pool, node[0])
            )
        stack.pop()
    return derivative[root]


def partial(pool: Pool, root: int, variable: int) -> int:
    """The node of the partial derivative of `root` by one variable, by the same rules."""
    time_derivatives, pool._slopes = pool._slopes, {}
    try:
        for number in pool.reachable([root]):
            node = pool.nodes[number]
            if node[0] in LEAVES:
                pool._slopes[number] = pool.one if node == ("var", variable) else pool.zero
        return differentiate(pool, root)
    finally:
        pool._slopes = time_derivatives


def _needed(node: tuple[object, ...]) -> tuple[int, ...]:
    operands: tuple[int, ...] = node[1:]  # type: ignore[assignment]
    if node[0] in _CONSTANT:
        return ()
    return operands[1:] if node[0] == "where" else operands


def _leaf(pool: Pool, op: str, index: int) -> int:
    if op == "time":
        return pool.one
    if op != "var":
        return pool.zero
    if index in pool.slope:
        return pool.slope[index]
    return pool.var(pool.derivative(index))


def _refuse(pool: Pool, op: str) -> int:
    raise DeclarationError(
        "AC128",
        f"the time derivative of {op} is needed and does not exist",
        help="it jumps or is Boolean: keep it out of der(...) and of prescribed positions",
    )


def _rate_of_delay(op: Delayed) -> DeclarationError:
    return DeclarationError(
        "AC184",
        f"the time derivative of {op.label} is needed",
        cause="only the value of a delayed signal is available; its derivative may jump where nothing else does",
        help="delay the derivative instead: delay(der(x), T); a prescribed motion needs both",
    )


def _call(p: Pool, op: Call, operands: tuple[int, ...]) -> int:
    """Chain rule of an external function: linear in the derivatives, so that these can be solved for symbolically.

    Raises DeclarationError: AC128 for a table that jumps, whose derivative is an impulse at each jump.
    """
    slopes = [(k, p._slopes[a]) for k, a in enumerate(operands) if p._slopes[a] != p.zero]
    if not slopes:
        return p.zero
    if isinstance(op.external, Lookup) and op.external.has_jumps:
        raise DeclarationError(
            "AC128",
            f"the time derivative of a {op.external.name} that jumps is needed and does not exist",
            cause="the slope of straight segments jumps at every row, as does the second derivative of cubics",
            help="give the table as speed or acceleration instead of position, or a smooth one: CombiTable1D with "
            "smoothness=Smoothness.CONTINUOUS_DERIVATIVE on time",
        )
    partials, first = op.external.partials, op.entry * op.external.size
    return p.sum(p.mul(p.make(Call(partials, first + k), *operands), slope) for k, slope in slopes)


def _pow(p: Pool, n: int, a: int, b: int) -> int:
    exponent = p.make("pow", a, p.sub(b, p.one))
    first = p.mul(p.mul(b, exponent), p._slopes[a])
    if p._slopes[b] == p.zero:
        return first
    return p.add(first, p.mul(p.mul(n, p.make("log", a)), p._slopes[b]))


def _relation_without_event(p: Pool, relation: str, a: int, b: int) -> int:
    """Relation without an event, for derivatives of min, max and fabs, whose kinks make no events either."""
    return p.make("noevent", p.make(relation, a, b))


def _atan2(p: Pool, n: int, y: int, x: int) -> int:
    square = p.add(p.mul(x, x), p.mul(y, y))
    return p.div(p.sub(p.mul(x, p._slopes[y]), p.mul(y, p._slopes[x])), square)


def _zero(p: Pool, n: int, *args: int) -> int:
    return p.zero


def _chain(outer: Callable[[Pool, int, int], int]) -> Callable[[Pool, int, int], int]:
    def rule(p: Pool, n: int, a: int) -> int:
        return p.zero if p._slopes[a] == p.zero else p.mul(outer(p, n, a), p._slopes[a])

    return rule


def _one_minus_square(p: Pool, a: int) -> int:
    return p.sub(p.one, p.mul(a, a))


def _one_plus_square(p: Pool, a: int) -> int:
    return p.add(p.one, p.mul(a, a))


_RULES: dict[str, Callable[..., int]] = {
    "add": lambda p, n, a, b: p.add(p._slopes[a], p._slopes[b]),
    "sub": lambda p, n, a, b: p.sub(p._slopes[a], p._slopes[b]),
    "neg": lambda p, n, a: p.neg(p._slopes[a]),
    "mul": lambda p, n, a, b: p.add(p.mul(p._slopes[a], b), p.mul(a, p._slopes[b])),
    "div": lambda p, n, a, b: p.div(p.sub(p._slopes[a], p.mul(n, p._slopes[b])), b),
    "pow": _pow,
    "atan2": _atan2,
    "where": lambda p, n, c, a, b: p.where(c, p._slopes[a], p._slopes[b]),
    "min": lambda p, n, a, b: p.where(_relation_without_event(p, "lt", a, b), p._slopes[a], p._slopes[b]),
    "max": lambda p, n, a, b: p.where(_relation_without_event(p, "gt", a, b), p._slopes[a], p._slopes[b]),
    "homotopy": lambda p, n, a, s: p.make("homotopy", p._slopes[a], p._slopes[s]),
    "sign": _zero,
    "floor": _zero,
    "ceil": _zero,
    "noevent": lambda p, n, a: p.zero if p._slopes[a] == p.zero else p.make("noevent", p._slopes[a]),
    # Constant between events; nothing is differentiated at events.
    **dict.fromkeys(_CONSTANT, _zero),
    "sin": _chain(lambda p, n, a: p.make("cos", a)),
    "cos": _chain(lambda p, n, a: p.neg(p.make("sin", a))),
    "tan": _chain(lambda p, n, a: _one_plus_square(p, n)),
    "asin": _chain(lambda p, n, a: p.div(p.one, p.make("sqrt", _one_minus_square(p, a)))),
    "acos": _chain(lambda p, n, a: p.neg(p.div(p.one, p.make("sqrt", _one_minus_square(p, a))))),
    "atan": _chain(lambda p, n, a: p.div(p.one, _one_plus_square(p, a))),
    "sinh": _chain(lambda p, n, a: p.make("cosh", a)),
    "cosh": _chain(lambda p, n, a: p.make("sinh", a)),
    "tanh": _chain(lambda p, n, a: _one_minus_square(p, n)),
    "exp": _chain(lambda p, n, a: n),
    "log": _chain(lambda p, n, a: p.div(p.one, a)),
    "sqrt": _chain(lambda p, n, a: p.div(p.const(0.5), n)),
    "fabs": _chain(lambda p, n, a: p.where(_relation_without_event(p, "gt", a, p.zero), p.one, p.neg(p.one))),
}
