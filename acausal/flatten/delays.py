"""Delays of a flat system: the statement that contains each, and checks of their times."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from acausal.errors import DeclarationError
from acausal.flatten.flat import FlatAssert, FlatAssignment, FlatDelay, FlatEquation, FlatWhen
from acausal.flatten.pool import Pool
from acausal.language.expressions.delay import Delayed
from acausal.language.statement import Origin

_Statement = tuple[tuple[int, ...], Origin | None, str]


def delays(
    pool: Pool,
    equations: Iterable[FlatEquation],
    whens: Iterable[FlatWhen],
    assignments: Iterable[FlatAssignment],
    asserts: Iterable[FlatAssert],
) -> tuple[FlatDelay, ...]:
    """Every delay of the pool with the first statement that contains it.

    Raises DeclarationError: AC182 if a delay is negative, or longer than its maximum; AC183 if it varies and has no
    maximum.
    """
    statements_with_nodes: list[_Statement] = [((e.left, e.right), e.origin, e.component) for e in equations]
    statements_with_nodes += [
        ((*w.conditions, *w.earlier, *(n for _, n in w.actions)), w.origin, w.component) for w in whens
    ]
    statements_with_nodes += [((a.node,), a.origin, a.component) for a in assignments]
    statements_with_nodes += [((a.condition,), a.origin, a.component) for a in asserts]
    flat_delays: list[FlatDelay] = []
    places = _places(pool, statements_with_nodes)
    for k, (source, time, most, label) in enumerate(pool.delays):
        origin, component = places.get(k, (None, ""))
        delay = FlatDelay(source, time, most, label, origin, component)
        _check(pool, delay)
        flat_delays.append(delay)
    return tuple(flat_delays)


def _places(pool: Pool, statements_with_nodes: Sequence[_Statement]) -> dict[int, tuple[Origin | None, str]]:
    """Place and component of each delay; a nested delay has those of the outer one."""
    places: dict[int, tuple[Origin | None, str]] = {}

    def inside(roots: Iterable[int]) -> Iterator[int]:
        for n in pool.reachable(roots):
            op = pool.nodes[n][0]
            if isinstance(op, Delayed):
                yield op.number

    for roots, origin, component in statements_with_nodes:
        todo = [k for k in inside(roots) if k not in places]
        while todo:
            k = todo.pop()
            places[k] = origin, component
            todo += [j for j in inside(pool.delays[k][:1]) if j not in places]
        if len(places) == len(pool.delays):
            break
    return places


def _check(pool: Pool, delay: FlatDelay) -> None:
    where = (delay.origin.span(),) if delay.origin is not None else ()
    name = f"{delay.label} in {delay.component}" if delay.component else delay.label
    if delay.most is not None and pool.varies(delay.most):
        raise DeclarationError(
            "AC183",
            f"{name}: the maximum of a delay must be constant",
            where=where,
            help="make it of numbers and parameters",
        )
    if pool.varies(delay.time):
        if delay.most is None:
            raise DeclarationError(
                "AC183",
                f"{name}: a delay that varies needs a maximum",
                where=where,
                cause="the maximum decides how much of the past must be stored",
                help="give the longest delay as third argument: delay(x, T, T_max)",
            )
        return
    t = pool.parameter_value(delay.time)
    if t < 0.0:
        raise DeclarationError(
            "AC182",
            f"{name}: the delay is {t:g} s",
            where=where,
            cause="the future of a signal is unknown",
            help='give a delay of at least zero: parameter(unit="s", min=0.0)',
        )
    limit = pool.parameter_value(delay.most) if delay.most is not None else t
    if t > limit:
        raise DeclarationError(
            "AC182",
            f"{name}: the delay of {t:g} s is longer than its maximum of {limit:g} s",
            where=where,
            help="raise the maximum, the third argument of delay",
        )
