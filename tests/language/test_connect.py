"""connect(): sets do not depend on how they are written, potentials become one, flows sum to zero."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from acausal import Component, Connector, Equations, Real, connect, flow, parameter, part, structural, variable
from acausal.flatten.flatten import flatten


class Port(Connector):
    p: Real = variable()
    q: Real = flow()


class Store(Component):
    """Two ports of one potential."""

    a: Port = Port()
    b: Port = Port()
    c: Real = parameter(default=1.0)

    def equations(self) -> Equations:
        yield self.a.p == self.b.p
        yield self.a.q + self.b.q == self.c * self.a.p


class Net(Component):
    """`size` stores; each statement joins ports by number: 2 k is `a` and 2 k + 1 is `b` of store k."""

    size: int = structural()
    joined: tuple[tuple[int, ...], ...] = structural()
    stores: list[Store] = part()

    def build(self) -> None:
        self.stores = [Store() for _ in range(self.size)]

    def equations(self) -> Equations:
        ports: list[Any] = [port for store in self.stores for port in (store.a, store.b)]
        for numbers in self.joined:
            yield connect(*(ports[n] for n in numbers))


Sets = list[list[int]]


@st.composite
def partitions(draw: st.DrawFn) -> tuple[int, Sets]:
    """Ports of up to five stores, dealt to sets; ports alone are not connected."""
    size = draw(st.integers(1, 5))
    of = draw(st.lists(st.integers(0, 4), min_size=2 * size, max_size=2 * size))
    return size, [[n for n in range(2 * size) if of[n] == k] for k in range(5) if of.count(k) > 0]


def flat_of(size: int, joined: Any) -> Any:
    return flatten(Net(size=size, joined=tuple(map(tuple, joined))))


def potentials(flat: Any, size: int) -> list[int]:
    """Number of the unknown that the potential of each port is."""
    first = {v.path: v.first for v in flat.variables}
    return [first[f"stores[{k}].{end}.p"] for k in range(size) for end in "ab"]


def junctions(flat: Any) -> list[frozenset[str]]:
    """Flows of every junction."""
    names = {v.first: v.path for v in flat.variables}
    made = [e for e in flat.equations if isinstance(e.source, str)]
    return sorted((frozenset(names[k] for k in flat.pool.variables_in(e.left)) for e in made), key=sorted)


def flows(numbers: list[int]) -> frozenset[str]:
    return frozenset(f"stores[{n // 2}].{'ab'[n % 2]}.q" for n in numbers)


@given(partitions())
def test_potentials_of_a_set_are_one_and_its_flows_sum_up(case: tuple[int, Sets]) -> None:
    size, sets = case
    flat = flat_of(size, [s for s in sets if len(s) > 1])
    unknowns = potentials(flat, size)
    for s in sets:
        assert len({unknowns[n] for n in s}) == 1
    assert len(set(unknowns)) == len(sets)
    assert junctions(flat) == sorted(map(flows, sets), key=sorted)
    assert len(flat.equations) == flat.n_scalars


@given(partitions(), st.randoms(use_true_random=False))
def test_how_a_set_is_written_does_not_matter(case: tuple[int, Sets], random: Any) -> None:
    """All at once, as a chain of pairs, as a star, in any order and direction, with repetitions."""
    size, sets = case
    joined = [s for s in sets if len(s) > 1]
    at_once = flat_of(size, joined)
    chains = [list(pair) for s in joined for pair in pairwise(s)]
    stars = [[s[-1], n] for s in joined for n in s[:-1]]
    for written in (chains, stars, chains + stars):
        shuffled = [random.sample(pair, len(pair)) for pair in random.sample(written, len(written))]
        other = flat_of(size, shuffled)
        assert junctions(other) == junctions(at_once)
        assert other.n_scalars == at_once.n_scalars


class Shell(Component):
    """A store behind ports of its own, `depth` times."""

    a: Port = Port()
    b: Port = Port()
    depth: int = structural(default=0)
    inner: Component = part()

    def build(self) -> None:
        self.inner = Shell(depth=self.depth - 1) if self.depth else Store()

    def equations(self) -> Equations:
        inner: Any = self.inner
        yield connect(self.a, inner.a)
        yield connect(inner.b, self.b)


class Ring(Component):
    """Shells of any depth in a ring."""

    depths: tuple[int, ...] = structural()
    shells: list[Shell] = part()

    def build(self) -> None:
        self.shells = [Shell(depth=d) for d in self.depths]

    def equations(self) -> Equations:
        for here, there in pairwise([*self.shells, self.shells[0]]):
            yield connect(here.b, there.a)


@given(st.lists(st.integers(0, 4), min_size=1, max_size=5))
def test_hierarchy_adds_names_but_neither_unknown_potentials_nor_freedom(depths: list[int]) -> None:
    """A ring has as many potentials as stores; every level adds two flows and the two equations for them."""
    flat = flatten(Ring(depths=tuple(depths)))
    assert len(flat.equations) == flat.n_scalars
    first = {v.first for v in flat.variables if v.path.endswith(".p")}
    # A port of a store and the one outside of it have one potential; both ports of a store are equal by its equation.
    assert len(first) == len(depths) if len(depths) > 1 else len(first) == 1
