"""A flat system moved to another pool: with parameters replaced by constants, or with additional variables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from acausal.flatten.flat import FlatEquation, FlatParameter, FlatSystem
from acausal.flatten.pool import LEAVES, Pool


def translated(flat: FlatSystem, pool: Pool, image: Mapping[int, int]) -> FlatSystem:
    """The flat system with the images of its nodes in another pool."""

    def equations(old: Sequence[FlatEquation]) -> tuple[FlatEquation, ...]:
        return tuple(e._replace(left=image[e.left], right=image[e.right]) for e in old)

    def parameter(p: FlatParameter) -> FlatParameter:
        nodes = tuple(image[n] for n in p.nodes)
        return p._replace(nodes=nodes, free=p.free and any(pool.nodes[n][0] == "par" for n in nodes))

    return replace(
        flat,
        pool=pool,
        equations=equations(flat.equations),
        initial_equations=equations(flat.initial_equations),
        whens=tuple(
            w._replace(
                conditions=tuple(image[n] for n in w.conditions),
                earlier=tuple(image[n] for n in w.earlier),
                actions=tuple((s, image[n]) for s, n in w.actions),
            )
            for w in flat.whens
        ),
        assignments=tuple(a._replace(node=image[a.node]) for a in flat.assignments),
        asserts=tuple(a._replace(condition=image[a.condition]) for a in flat.asserts),
        demands=tuple(a._replace(condition=image[a.condition]) for a in flat.demands),
        parameters=tuple(map(parameter, flat.parameters)),
        starts={s: start._replace(node=image[start.node]) for s, start in flat.starts.items()},
        delays=tuple(
            d._replace(source=image[d.source], time=image[d.time], most=None if d.most is None else image[d.most])
            for d in flat.delays
        ),
        undelayed=tuple((image[n], words) for n, words in flat.undelayed),
    )


def with_variables(flat: FlatSystem, count: int) -> tuple[FlatSystem, dict[int, int]]:
    """The flat system with `count` additional scalars, which the caller declares, and the images of its nodes."""
    old, pool, n = flat.pool, Pool(), flat.n_scalars

    def number(variable: int) -> int:
        return variable if variable < n else variable + count

    pool.new_variables(old.n_variables + count)
    pool.derivative_of.update((number(x), number(dx)) for x, dx in old.derivative_of.items())
    pool.integral_of.update((number(dx), number(x)) for dx, x in old.integral_of.items())
    pool.parameter_values = old.parameter_values
    image: dict[int, int] = {}
    for k, (op, *operands) in enumerate(old.nodes):
        if op == "var":
            image[k] = pool.var(number(operands[0]))
        elif op in LEAVES:
            image[k] = pool.intern(old.nodes[k])
        else:
            image[k] = pool.make(op, *[image[c] for c in operands])
    pool.slope.update((number(v), image[node]) for v, node in old.slope.items())
    pool.delays = [(image[s], image[t], None if m is None else image[m], words) for s, t, m, words in old.delays]
    pool.undelayed = [(image[node], words) for node, words in old.undelayed]
    return replace(translated(flat, pool, image), n_scalars=n + count), image
