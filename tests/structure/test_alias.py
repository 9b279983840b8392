"""Alias classes: tables from circuits and mechanisms, and the same questions answered by linear algebra."""

from __future__ import annotations

from random import Random

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

from acausal.errors import InternalError
from acausal.structure import classes, cycle
from tests.expected import fails_with

Relation = tuple[int, int, int]

TABLE = [
    # name, n, relations, priority, representative, sign, zero members, redundant
    ("nothing", 2, [], [0, 0], [0, 1], [1, 1], [], []),
    # Resistor and capacitor in series: R.n.i = -R.p.i, C.p.i = -R.n.i (node), C.n.i = -C.p.i.
    ("series", 4, [(1, 0, -1), (2, 1, -1), (3, 2, -1)], [0, 0, 0, 0], [0, 0, 0, 0], [1, -1, 1, -1], [], []),
    # The same, but C.p.i is wanted as a state.
    ("state leads", 4, [(1, 0, -1), (2, 1, -1), (3, 2, -1)], [0, 0, 5, 0], [2, 2, 2, 2], [1, -1, 1, -1], [], []),
    # Two inductors in parallel, both currents states of equal priority: the first leads.
    ("tie", 3, [(0, 2, 1), (2, 1, 1)], [0, 3, 3], [1, 1, 1], [1, 1, 1], [], []),
    # Flange connected to itself reversed: s = -s.
    ("own opposite", 2, [(0, 0, -1)], [0, 0], [0, 1], [1, 1], [0], []),
    ("own copy", 1, [(0, 0, 1)], [0], [0], [1], [], [0]),
    # Gears 1:1 in a triangle, each meshing with the next: three reversals, nothing can turn.
    ("locked gears", 4, [(0, 1, -1), (1, 2, -1), (2, 0, -1)], [0] * 4, [0, 0, 0, 3], [1, -1, 1, 1], [0, 1, 2], []),
    # Four gears in a square do turn; the last mesh repeats what the others say.
    ("free gears", 4, [(0, 1, -1), (1, 2, -1), (2, 3, -1), (3, 0, -1)], [0] * 4, [0] * 4, [1, -1, 1, -1], [], [3]),
    # A zero class says nothing more when it is closed again, nor when it meets another zero class.
    ("zero twice", 1, [(0, 0, -1), (0, 0, -1), (0, 0, 1)], [0], [0], [1], [0], [1, 2]),
    ("zeros meet", 2, [(0, 0, -1), (1, 1, -1), (0, 1, 1)], [0, 0], [0, 0], [1, 1], [0, 1], [2]),
    # One zero spreads over the class it joins.
    ("zero spreads", 3, [(0, 0, -1), (1, 2, 1), (2, 0, -1)], [0] * 3, [0, 0, 0], [1, -1, -1], [0, 1, 2], []),
]


@pytest.mark.parametrize(
    ("n", "relations", "priority", "representative", "sign", "zero", "redundant"),
    [row[1:] for row in TABLE],
    ids=[row[0] for row in TABLE],
)
def test_table(
    n: int,
    relations: list[Relation],
    priority: list[int],
    representative: list[int],
    sign: list[int],
    zero: list[int],
    redundant: list[int],
) -> None:
    result = classes(n, relations, priority)
    assert result.representative.tolist() == representative
    assert result.sign.tolist() == sign
    assert np.flatnonzero(result.zero).tolist() == zero
    assert list(result.redundant) == redundant


def test_kept_are_the_unknowns_that_remain() -> None:
    result = classes(5, [(0, 1, 1), (2, 2, -1), (3, 2, 1)], [0] * 5)
    assert result.kept.tolist() == [0, 4]
    assert repr(result) == "AliasClasses(5 unknowns, 2 kept, 2 zero, 0 redundant relations)"


def test_sign_must_be_a_sign() -> None:
    with fails_with(InternalError, "AC901", match="relation 0 has sign 2"):
        classes(2, [(0, 1, 2)], [0, 0])


@pytest.mark.parametrize("step", [1, -1])
def test_long_chain(step: int) -> None:
    # A rod of 100 000 rigid pieces, each of which reverses the sign; both directions of building the tree.
    n = 100_000
    result = classes(n, [(i, i + 1, -1) for i in range(n - 1)][::step], [0] * n)
    assert not result.representative.any()
    assert np.array_equal(result.sign, np.where(np.arange(n) % 2, -1, 1))


@given(st.integers(1, 60), st.randoms(use_true_random=False))
def test_hidden_signs_are_found(n: int, chance: Random) -> None:
    # Merging pairs, then pairs of pairs, and so on makes the deepest trees; each link states the truth about two
    # random members, and as many links again say nothing new.
    truth = [chance.choice([1, -1]) for _ in range(n)]
    groups = [[i] for i in chance.sample(range(n), n)]
    relations: list[Relation] = []
    while len(groups) > 1:
        merged = []
        for left, right in zip(groups[::2], groups[1::2], strict=False):
            i, j = chance.choice(left), chance.choice(right)
            relations.append((i, j, truth[i] * truth[j]))
            merged.append(left + right)
        groups = merged + groups[len(merged) * 2 :]
    repeated = [(i, j, truth[i] * truth[j]) for i, j in (chance.choices(range(n), k=2) for _ in range(n))]
    result = classes(n, relations + repeated, [0] * n)
    assert not result.representative.any()
    assert not result.zero.any()
    assert result.sign.tolist() == [t * truth[0] for t in truth]
    assert result.redundant == tuple(range(n - 1, 2 * n - 1))


# --- against linear algebra ---


def matrix(n: int, relations: list[Relation]) -> npt.NDArray[np.float64]:
    """Rows of v[i] - sign * v[j] = 0."""
    rows = np.zeros((len(relations), n))
    for k, (i, j, sign) in enumerate(relations):
        rows[k, i] += 1.0
        rows[k, j] -= sign
    return rows


def rank(rows: npt.NDArray[np.float64]) -> int:
    return int(np.linalg.matrix_rank(rows)) if rows.size else 0


@st.composite
def systems(draw: st.DrawFn) -> tuple[int, list[Relation], list[int]]:
    n = draw(st.integers(1, 8))
    index = st.integers(0, n - 1)
    relations = draw(st.lists(st.tuples(index, index, st.sampled_from([1, -1])), max_size=12))
    return n, relations, draw(st.lists(st.integers(0, 2), min_size=n, max_size=n))


@given(systems())
def test_classes_span_the_null_space(system: tuple[int, list[Relation], list[int]]) -> None:
    n, relations, priority = system
    result = classes(n, relations, priority)
    rows = matrix(n, relations)
    assert len(result.kept) == n - rank(rows)
    free = np.zeros(n)
    free[result.kept] = np.arange(1.0, len(result.kept) + 1)
    values = np.where(result.zero, 0.0, result.sign * free[result.representative])
    assert not np.any(rows @ values)
    assert not np.any(values[result.zero])


@given(systems())
def test_relations_that_are_not_redundant_are_independent(system: tuple[int, list[Relation], list[int]]) -> None:
    n, relations, priority = system
    redundant = classes(n, relations, priority).redundant
    independent = [r for k, r in enumerate(relations) if k not in redundant]
    assert rank(matrix(n, independent)) == len(independent) == rank(matrix(n, relations))


@given(systems(), st.randoms(use_true_random=False))
def test_classes_do_not_depend_on_the_order_of_relations(
    system: tuple[int, list[Relation], list[int]], chance: Random
) -> None:
    n, relations, priority = system
    shuffled = list(relations)
    chance.shuffle(shuffled)
    one, other = classes(n, relations, priority), classes(n, shuffled, priority)
    assert np.array_equal(one.representative, other.representative)
    assert np.array_equal(one.zero, other.zero)
    assert np.array_equal(one.sign[~one.zero], other.sign[~other.zero])


@given(systems())
def test_representative_has_the_highest_priority(system: tuple[int, list[Relation], list[int]]) -> None:
    n, relations, priority = system
    result = classes(n, relations, priority)
    for leader in set(result.representative.tolist()):
        members = np.flatnonzero(result.representative == leader).tolist()
        assert leader == max(members, key=lambda m: (priority[m], -m))
        assert result.sign[leader] == 1


# --- evidence ---


def test_cycle_is_the_shortest_one() -> None:
    # Loop of ideal wires 0-1-2-3-0 with a bridge 0-2; the last relation follows from the bridge and one wire.
    relations = [(0, 1, 1), (1, 2, 1), (2, 3, 1), (3, 0, 1), (0, 2, 1)]
    assert classes(4, relations, [0] * 4).redundant == (3, 4)
    assert cycle(relations, 3) == (2, 4)


def test_cycle_of_a_relation_that_joins_two_zeros() -> None:
    assert cycle([(0, 0, -1), (1, 1, -1), (0, 1, 1)], 2) == (0, 1)
    assert cycle([(0, 0, 1)], 0) == ()


def test_cycle_of_an_independent_relation_is_a_defect_of_the_caller() -> None:
    with fails_with(InternalError, "AC904", match="relation 0 does not follow"):
        cycle([(0, 1, 1), (1, 2, 1)], 0)


@given(systems())
def test_cycle_implies_its_relation(system: tuple[int, list[Relation], list[int]]) -> None:
    n, relations, priority = system
    for index in classes(n, relations, priority).redundant:
        others = cycle(relations, index)
        assert index not in others
        evidence = [relations[k] for k in others]
        assert rank(matrix(n, [*evidence, relations[index]])) == rank(matrix(n, evidence))
