"""Random networks of Boolean blocks against a plain evaluation of their truth tables.

Sources change on a grid of eighths of a second, so that many of their edges coincide. The reference evaluates the
network at each instant, with what `pre` remembers, until nothing changes; then once more with triggers that are false
again. Every signal is counted by its edges, and compared at the end.
"""

from __future__ import annotations

import random
from dataclasses import dataclass
from typing import Any

import pytest

import acausal
from acausal import (
    Component,
    Equations,
    Real,
    boolean_input,
    connect,
    edge,
    integer,
    part,
    pre,
    reset,
    structural,
    when,
)
from acausal.library import blocks
from tests.marks import seeds, slow_but

TABLES: dict[str, Any] = {
    "And": lambda a, b: a and b,
    "Or": lambda a, b: a or b,
    "Xor": lambda a, b: a != b,
    "Nor": lambda a, b: not (a or b),
    "Nand": lambda a, b: not (a and b),
    "Not": lambda a: not a,
}
REMEMBERING: dict[str, Any] = {
    "Pre": lambda now, before: before,
    "Edge": lambda now, before: now and not before,
    "FallingEdge": lambda now, before: before and not now,
    "Change": lambda now, before: now != before,
}
_STOP = 24  # eighths of a second


@dataclass(frozen=True)
class Block:
    """A source with times in eighths of a second from the start, or a block with the numbers of its inputs."""

    kind: str
    numbers: tuple[int, ...]


class Counter(Component):
    """Counts the edges of its input."""

    u: Real = boolean_input()
    n: Real = integer()

    def equations(self) -> Equations:
        yield when(edge(self.u), reset(self.n, pre(self.n) + 1))


class Network(Component):
    """Blocks, wired and counted."""

    plan: tuple[Block, ...] = structural()
    start: float = structural()
    parts: list[Component] = part()
    counters: list[Counter] = part()

    def build(self) -> None:
        self.parts = [_part(b, self.start) for b in self.plan]
        self.counters = [Counter() for _ in self.plan]

    def equations(self) -> Equations:
        signals: list[Any] = [p.y for p in self.parts]  # type: ignore[attr-defined]
        for block, own, signal, counter in zip(self.plan, self.parts, signals, self.counters, strict=True):
            yield connect(signal, counter.u)
            if block.kind in TABLES or block.kind in REMEMBERING:
                for name, k in zip(("u",) if len(block.numbers) == 2 else ("u1", "u2"), block.numbers[1:], strict=True):
                    yield connect(signals[k], getattr(own, name))


def _part(block: Block, start: float) -> Component:
    rest = block.numbers[1:]
    times = [start + 0.125 * n for n in block.numbers]
    if block.kind == "pulse":
        return blocks.BooleanPulse(start_time=times[0], period=0.125 * rest[0], width=rest[1] / rest[0])
    if block.kind == "step":
        return blocks.BooleanStep(start_time=times[0], start_value=bool(rest[0]))
    if block.kind == "table":
        return blocks.BooleanTable(table=tuple(times))
    if block.kind == "trigger":
        return blocks.SampleTrigger(start_time=times[0], period=0.125 * rest[0])
    made: Component = getattr(blocks, block.kind)()
    return made


def drawn(seed: int) -> tuple[Block, ...]:
    """Up to four sources, then blocks, of which the first number is their own; a `Pre` may look at a later one."""
    r = random.Random(seed)
    plan: list[Block] = []
    for _ in range(r.randint(1, 4)):
        kind, at = r.choice(["pulse", "step", "table", "trigger"]), r.randrange(_STOP)
        if kind == "pulse":
            period = r.choice([2, 3, 4, 8])
            plan.append(Block(kind, (at, period, r.randrange(period + 1))))
        elif kind == "table":
            plan.append(Block(kind, tuple(sorted(r.sample(range(_STOP), r.randint(1, 5))))))
        else:
            plan.append(Block(kind, (at, r.choice([2, 3, 4]) if kind == "trigger" else r.randrange(2))))
    count = len(plan) + r.randint(2, 9)
    while len(plan) < count:
        kind, own = r.choice([*TABLES, *REMEMBERING, "Pre"]), len(plan)
        inputs = [r.randrange(own) for _ in range(2 if kind in TABLES and kind != "Not" else 1)]
        if kind == "Pre" and r.random() < 0.5:
            inputs = [r.randrange(own, count)]
        plan.append(Block(kind, (own, *inputs)))
    return tuple(plan)


def _source(block: Block, t: int, ticks: bool) -> bool:
    a, *rest = block.numbers
    if block.kind == "pulse":
        return t >= a and (t - a) % rest[0] < rest[1]
    if block.kind == "step":
        return (t >= a) != bool(rest[0])
    if block.kind == "table":
        return sum(t >= n for n in block.numbers) % 2 == 1
    return ticks and t >= a and (t - a) % rest[0] == 0


def _values(plan: tuple[Block, ...], t: int, ticks: bool, before: list[bool]) -> list[bool]:
    now: list[bool] = []
    for block in plan:
        inputs = block.numbers[1:]
        if block.kind in TABLES:
            now.append(TABLES[block.kind](*(now[k] for k in inputs)))
        elif block.kind in REMEMBERING:
            own = now[inputs[0]] if inputs[0] < len(now) else False  # of a later one `Pre` asks what was only
            now.append(REMEMBERING[block.kind](own, before[inputs[0]]))
        else:
            now.append(_source(block, t, ticks))
    return now


def expected(plan: tuple[Block, ...]) -> tuple[list[int], list[bool]] | None:
    """Edges and last values of all signals; None where they do not settle."""
    edges, before = [0] * len(plan), _values(plan, 0, False, [False] * len(plan))
    for t in range(_STOP + 1):
        for ticks in (False, True, False) if t == 0 else (True, False):
            for _ in range(60):
                now = _values(plan, t, ticks, before)
                edges = [n + (b and not a) for n, a, b in zip(edges, before, now, strict=True)]
                if now == before:
                    break
                before = now
            else:
                return None
    return edges, before


@pytest.mark.parametrize("part", slow_but(seeds("0:60", 10), seeds("0:60", 10)[0]), ids=str)
def test_networks_of_boolean_blocks(part: range) -> None:
    for seed in part:
        plan = drawn(seed)
        reference = expected(plan)
        if reference is None:
            continue
        start = random.Random(seed).choice([0.0, -2.0, 100.0])
        r = acausal.simulate(Network(plan=plan, start=start), start_time=start, stop_time=start + 0.125 * _STOP)
        edges, last = reference
        assert [r.final(f"counters[{k}].n") for k in range(len(plan))] == edges, seed
        assert [r.final(f"parts[{k}].y") for k in range(len(plan))] == last, seed
