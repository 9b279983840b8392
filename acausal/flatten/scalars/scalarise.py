"""Language expressions, with their vectors and matrices, to scalar pool nodes in row-major order."""

from __future__ import annotations

from collections.abc import Callable
from itertools import product

from acausal.errors import DeclarationError
from acausal.flatten.pool import Pool
from acausal.flatten.scalars.differentiate import differentiate
from acausal.language.expressions.expression import Expr, Symbol, is_condition, is_discrete
from acausal.language.expressions.external import Call

Scalars = tuple[int, ...]
Resolve = Callable[[Symbol], Scalars]


def scalars(pool: Pool, root: Expr, resolve: Resolve, done: dict[int, Scalars]) -> Scalars:
    """Nodes of the entries of `root`; `resolve` gives those of a symbol, `done` shares work by identity.

    The caller keeps the expressions alive as long as `done` is used.
    """
    stack = [root]
    while stack:
        e = stack[-1]
        key = id(e)
        if key in done:
            stack.pop()
            continue
        missing = [a for a in e.args if id(a) not in done]
        if missing:
            stack.extend(missing)
            continue
        done[key] = _entries(pool, e, resolve, [done[id(a)] for a in e.args])
        stack.pop()
    return done[id(root)]


def _entries(pool: Pool, e: Expr, resolve: Resolve, args: list[Scalars]) -> Scalars:
    op = e.op
    if isinstance(e, Symbol):
        return resolve(e)
    if op == "const":
        values = e.payload if isinstance(e.payload, tuple) else (e.payload,)
        return tuple(pool.const(v) for v in values)
    if op == "time":
        return (pool.time,)
    if op in ("quantity", "unitless"):
        return args[0]
    if op == "neg":
        return tuple(pool.neg(a) for a in args[0])
    if op == "der":
        if is_condition(e.args[0]):
            raise DeclarationError(
                "AC128",
                f"the time derivative of {e.args[0]} is needed and does not exist",
                help="it jumps or is Boolean: keep it out of der(...) and of prescribed positions",
            )
        return tuple(differentiate(pool, a) for a in args[0])
    if op in ("stack", "concatenate"):
        return tuple(a for part in args for a in part)
    if op == "index":
        position = 0
        for i, n in zip(e.payload, e.args[0].shape, strict=True):
            position = position * n + i
        return (args[0][position],)
    if op == "slice":
        return _sliced(e, args[0])
    if op == "fill":
        return args[0] * e.shape[0]
    if op == "transpose":
        m, n = e.args[0].shape
        return tuple(args[0][i * n + j] for j, i in product(range(n), range(m)))
    if op == "matmul":
        return _matmul(pool, e, args)
    if op == "cross":
        a, b = args
        return tuple(pool.sub(pool.mul(a[i], b[j]), pool.mul(a[j], b[i])) for i, j in ((1, 2), (2, 0), (0, 1)))
    if op == "call":
        external, output = e.payload
        flat = [a for part in args for a in part]
        return tuple(pool.make(Call(external, k), *flat) for k in external.entries(output))
    if op == "pre":
        # of a continuous expression it stands in a `when`, which sees everything as it was before
        return tuple(pool.make("pre", a) for a in args[0]) if is_discrete(e.args[0]) else args[0]
    if op == "delay":
        return _delayed(pool, e, args)
    if op in ("edge", "change", "equals"):
        return (_compared(pool, op, [a[0] for a in args], is_condition(e.args[0])),)
    if op == "where":
        conditions = tuple(pool.make("noevent", c) for c in args[0]) if e.payload else args[0]
        size = max(map(len, args))
        columns = [_wide(a, size) for a in (conditions, *args[1:])]
        return tuple(pool.where(c, a, b) for c, a, b in zip(*columns, strict=True))
    if not args:
        return (pool.make(op),)
    size = max(len(a) for a in args)
    columns = [_wide(a, size) for a in args]
    return tuple(pool.make(op, *operands) for operands in zip(*columns, strict=True))


def _sliced(e: Expr, entries: Scalars) -> Scalars:
    places, _ = e.payload
    if len(places) == 1:
        return tuple(entries[k] for k in places[0])
    first, second = (p if isinstance(p, range) else (p,) for p in places)
    width = e.args[0].shape[1]
    return tuple(entries[i * width + j] for i, j in product(first, second))


def _delayed(pool: Pool, e: Expr, args: list[Scalars]) -> Scalars:
    """What never changes, or is delayed by nothing, is itself."""
    time, most = args[1][0], args[2][0] if len(args) > 2 else None
    if pool.parameter_value(time) == 0.0:
        pool.undelayed.append((time, str(e)))
        return args[0]
    constant = [all(pool.nodes[n][0] in ("const", "par") for n in pool.reachable([a])) for a in args[0]]
    return tuple(
        a if still else pool.delayed(a, time, most, str(e)) for a, still in zip(args[0], constant, strict=True)
    )


def _compared(pool: Pool, op: str, args: list[int], is_logical: bool) -> int:
    """`edge`, `change` and `equals` by relations and `pre`; whole numbers differ where they are half a step apart."""
    a = args[0]
    b = args[1] if op == "equals" else pool.make("pre", a)
    if op == "edge":
        return pool.make("and", a, pool.make("not", b))
    if op == "change" and is_logical:
        return pool.make("or", pool.make("and", a, pool.make("not", b)), pool.make("and", pool.make("not", a), b))
    if op == "change":
        return pool.make("or", pool.make("lt", a, b), pool.make("gt", a, b))
    half = pool.const(0.5)
    below, above = pool.make("lt", a, pool.sub(b, half)), pool.make("gt", a, pool.add(b, half))
    return pool.make("not", pool.make("or", below, above))


def _wide(a: Scalars, size: int) -> Scalars:
    return a if len(a) == size else a * size


def _matmul(pool: Pool, e: Expr, args: list[Scalars]) -> Scalars:
    a, b = args
    inner = e.args[0].shape[-1]
    rows, columns = len(a) // inner, len(b) // inner
    return tuple(
        pool.sum(pool.mul(a[i * inner + k], b[k * columns + j]) for k in range(inner))
        for i, j in product(range(rows), range(columns))
    )
