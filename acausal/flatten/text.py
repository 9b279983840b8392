"""Python-like text of pool expressions, for messages and listings."""

from __future__ import annotations

from collections.abc import Callable

from acausal.flatten.pool import Node, Pool
from acausal.language.expressions.delay import Delayed

NameOf = Callable[[str, int], str]
"""Name of a leaf: ("var", number) or ("par", number)."""

# Operator and precedence as in Python, where & and | bind more tightly than comparisons.
_INFIX = {
    "lt": ("<", 1),
    "le": ("<=", 1),
    "gt": (">", 1),
    "ge": (">=", 1),
    "or": ("|", 2),
    "and": ("&", 3),
    "add": ("+", 4),
    "sub": ("-", 4),
    "mul": ("*", 5),
    "div": ("/", 5),
    "pow": ("**", 7),
}
_NEG = 6
_TIGHT = {"mul", "div", "pow"}
_CALLED = {"min": "minimum", "max": "maximum"}


def to_text(pool: Pool, node: int, name_of: NameOf, limit: int = 400) -> str:
    """Text of a node, with no more parentheses than Python needs.

    Shared sub-expressions are repeated wherever they are used, so the full text can be exponentially longer than the
    pool: it is written from left to right and ends with ` ...` after `limit` characters.
    """
    parts: list[str] = []
    length = 0
    # Stack of pending items: a text, or (node, precedence of its context).
    pending: list[str | tuple[int, int]] = [(node, 0)]
    while pending:
        item = pending.pop()
        if isinstance(item, str):
            parts.append(item)
            length += len(item)
            if length > limit and pending:
                parts.append(" ...")
                break
        else:
            pending.extend(reversed(_pieces(pool.nodes[item[0]], item[1], name_of)))
    return "".join(parts)


def _pieces(node: Node, context: int, name_of: NameOf) -> list[str | tuple[int, int]]:
    op = node[0]
    if op == "const":
        return _closed([number(node[1])], node[1] < 0.0 and context >= _NEG)
    if op in ("var", "par"):
        return [name_of(str(op), node[1])]
    if op == "time":
        return ["time"]
    if isinstance(op, Delayed):
        return [op.label]
    if op == "neg":
        return _closed(["-", (node[1], _NEG)], context > _NEG)
    if op == "not":
        return _closed(["~", (node[1], _NEG)], context > _NEG)
    if op in _INFIX:
        sign, binding = _INFIX[op]
        shown = sign if op in _TIGHT else f" {sign} "
        # `**` groups to the right, comparisons not at all, everything else to the left.
        left = binding + (op == "pow" or binding == 1)
        right = binding + (op != "pow")
        return _closed([(node[1], left), shown, (node[2], right)], context > binding)
    pieces: list[str | tuple[int, int]] = [_CALLED.get(op, str(op)), "("]
    for k, argument in enumerate(node[1:]):
        pieces += [", ", (argument, 0)] if k else [(argument, 0)]
    return [*pieces, ")"]


def _closed(pieces: list[str | tuple[int, int]], closed: bool) -> list[str | tuple[int, int]]:
    return ["(", *pieces, ")"] if closed else pieces


def number(value: float) -> str:
    """Shortest text of a number to nine digits: 0.5, 1e+08, 3."""
    return f"{value:.9g}"
