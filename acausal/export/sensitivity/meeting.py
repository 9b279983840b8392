"""Events at one instant that parameters may move apart: their maps are those of one event after the other.

Two balls that hit the floor together are one event of the run, but a parameter of one of them moves only its own
impact. With instants that differ by dt, the run passes them in one order for a positive change, and in the other for a
negative one, and between them for a time dt a regime holds in which only the first has happened. The derivative exists
where both orders give the same map, as for parts that do not act on each other; it is the product of the saltation
matrices of its events. Where the orders differ, it exists only for parameters that move all of the instants alike, for
which the map is that of the event as a whole.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from acausal.arrays import Vector
from acausal.errors import AcausalError
from acausal.simulate.driver.agenda import due
from acausal.simulate.driver.hybrid import Hybrid, Passage
from acausal.simulate.events.guards import Moment

Instant = tuple[Vector, Vector]
"""Derivatives of an instant [s] by the carried variables before it, (size,), and by the parameters, (count,)."""
# Relative difference of derivatives that count as equal: of instants, and of maps, which are products.
_SAME_INSTANT, _SAME_MAP = 1e-9, 1e-7
# Number of events at one instant of which all orders are compared.
_ALL = 3


@dataclass(frozen=True, eq=False)
class Group:
    """Guards, as (relation, side), that are reached at one instant however the parameters change; none: known times."""

    guards: tuple[tuple[int, int], ...]
    instant: Instant


def groups(hybrid: Hybrid, passage: Passage, instant: Callable[[Passage], Instant]) -> list[Group]:
    """The events of a passage, a group for each instant; `instant` gives the derivatives of that of one guard."""
    if passage.edge or not passage.left.regime.active_set.owners:
        return []
    left, owners = passage.left, passage.left.regime.active_set.owners
    g, rate, noise = hybrid.guards.state(passage.time, left)
    decided = passage.happened.jumps[0].moment if passage.happened.jumps else passage.happened.moment
    has_flipped = left.m[hybrid.guards.first :] != decided.m[hybrid.guards.first :]
    watched = hybrid.problem.compiled.state_events.watched
    reached = [
        k
        for k, (relation, side) in enumerate(owners)
        if k == passage.guard
        or (has_flipped[relation] and side < 0 and relation not in watched and g[k] <= noise[k] and rate[k] < -noise[k])
    ]
    if len(reached) + (passage.guard is None) < 2:
        return []
    found: list[tuple[list[tuple[int, int]], Instant]] = []
    if passage.guard is None:
        found.append(([], instant(passage)))
    for k in sorted(reached, key=lambda k: k != passage.guard):
        this = instant(Passage(passage.time, left, k, passage.happened))
        alike = next((members for members, other in found if members and _alike(this, other)), None)
        if alike is None:
            found.append(([owners[k]], this))
        else:
            alike.append(owners[k])
    return [Group(tuple(members), at) for members, at in found]


def _alike(a: Instant, b: Instant) -> bool:
    return all(
        np.allclose(v, w, rtol=_SAME_INSTANT, atol=1e-12 * np.abs(v).max(initial=0.0))
        for v, w in zip(a, b, strict=False)
    )


def orders(met: Sequence[Group]) -> Iterator[list[Group]]:
    """Orders of events: all of two or three, and four of more, of which one half comes first or last."""
    for k in range(len(met)) if len(met) <= _ALL else (0, len(met) // 2):
        yield [*met[k:], *met[:k]]
        if len(met) > 2:
            yield [*met[k:], *met[:k]][::-1]


def in_turn(hybrid: Hybrid, passage: Passage, order: Sequence[Group]) -> list[Passage] | None:
    """The events of `order` as passages one after the other; None if they do not end where `passage` does."""
    moment, found, t = passage.left, [], passage.time
    iteration, first = hybrid.iteration, hybrid.guards.first
    try:
        for k, group in enumerate(order):
            iteration.waiting = {relation for later in order[k + 1 :] for relation, _ in later.guards}
            owners = moment.regime.active_set.owners
            if not set(group.guards) <= set(owners):
                return None
            flips = np.array([owner in group.guards for owner in owners], dtype=bool)
            g, rate, noise = hybrid.guards.state(t, moment)
            if not (np.abs(g[flips]) <= noise[flips]).all() or not (rate[flips] < 0.0).all():
                return None
            now, samples = iteration.flipped(moment, flips), None
            if not group.guards:
                compiled = hybrid.problem.compiled
                m = moment.m.copy()
                m[: compiled.n_timely] = passage.happened.moment.m[: compiled.n_timely]
                now, samples = Moment(now.x, now.z, m, now.regime), due(compiled, hybrid.problem.p, np.array([t]))[0]
            happened = iteration.settle(t, now, moment.m, samples=samples)
            guard = int(np.argmax(flips)) if group.guards else None
            found.append(Passage(t, moment, guard, happened))
            moment = happened.moment
    except AcausalError:
        return None
    finally:
        iteration.waiting = set()
    right = passage.happened.moment
    is_same = np.array_equal(moment.m[first:], right.m[first:]) and moment.regime.holds == right.regime.holds
    return found if is_same and np.allclose(moment.x, right.x, rtol=1e-9, atol=1e-12) else None


def composed(maps: Sequence[tuple[Vector, Vector, Vector, Vector]]) -> tuple[Vector, Vector]:
    """(dx+/dx-, dx+/dp) of maps one after the other."""
    by_x, by_p = maps[0][:2]
    for next_x, next_p, *_ in maps[1:]:
        by_x, by_p = next_x @ by_x, next_x @ by_p + next_p
    return by_x, by_p


def are_equal(a: tuple[Vector, Vector], b: tuple[Vector, Vector]) -> bool:
    """Whether two maps are equal up to the errors of their entries."""
    return all(
        np.allclose(v, w, rtol=_SAME_MAP, atol=_SAME_MAP * np.abs(v).max(initial=0.0))
        for v, w in zip(a, b, strict=False)
    )
