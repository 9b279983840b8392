"""Incidence and maximum matching against dense 0/1 matrices."""

from __future__ import annotations

import random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from acausal.errors import InternalError
from acausal.structure import Incidence, inverse, match, matching
from tests.expected import fails_with
from tests.structure.graphs import dense, generic_rank, graphs


def test_rows_are_sorted_and_without_repetition() -> None:
    graph = Incidence.from_rows([[3, 1, 3], [], [0]], 5)
    assert graph.indptr.tolist() == [0, 2, 2, 3]
    assert graph.indices.tolist() == [1, 3, 0]
    assert (graph.n_rows, graph.n_columns, graph.n_entries) == (3, 5, 3)
    assert graph.row(0).tolist() == [1, 3]
    assert graph.rows() == [[1, 3], [], [0]]
    assert graph.row_of_entry.tolist() == [0, 0, 2]


def test_rows_may_be_generators() -> None:
    assert Incidence.from_rows((range(i) for i in range(4)), 3).rows() == [[], [0], [0, 1], [0, 1, 2]]


@pytest.mark.parametrize("n_columns", [0, 4])
def test_graph_without_rows(n_columns: int) -> None:
    graph = Incidence.from_rows([], n_columns)
    assert graph.rows() == []
    assert graph.transpose().rows() == [[]] * n_columns
    assert graph.to_csr().shape == (0, n_columns)


@pytest.mark.parametrize("column", [-1, 2])
def test_column_outside_is_a_defect_of_the_caller(column: int) -> None:
    with fails_with(InternalError, "AC901", match=f"names column .*{column}, outside 0 .. 1"):
        Incidence.from_rows([[column]], 2)


def test_repr_shows_the_first_rows_only() -> None:
    assert repr(Incidence.from_rows([[1], [0, 2]], 3)) == "Incidence(2 rows, 3 columns, 3 entries; 0: [1], 1: [0, 2])"
    assert repr(Incidence.from_rows([], 3)) == "Incidence(0 rows, 3 columns, 0 entries)"
    long = repr(Incidence.from_rows([[0]] * 100, 1))
    assert long.endswith("11: [0], ...)")
    assert len(long) < 250


def test_equality_compares_contents() -> None:
    assert Incidence.from_rows([[1, 0]], 2) == Incidence.from_rows([[0, 1]], 2)
    assert Incidence.from_rows([[0]], 2) != Incidence.from_rows([[0]], 3)
    assert Incidence.from_rows([[0]], 2) != [[0]]


def test_inverse_of_a_matching() -> None:
    assert inverse(np.array([2, -1, 0]), 4).tolist() == [2, -1, 0, -1]


@given(graphs())
def test_csr_and_transpose_are_those_of_the_matrix(graph: Incidence) -> None:
    assert np.array_equal(graph.to_csr().toarray(), dense(graph))
    assert np.array_equal(dense(graph.transpose()), dense(graph).T)
    assert graph.transpose().transpose() == graph


@given(graphs(), st.data())
def test_restriction_is_fancy_indexing(graph: Incidence, data: st.DataObject) -> None:
    rows = data.draw(st.permutations(range(graph.n_rows)))[: data.draw(st.integers(0, graph.n_rows))]
    columns = data.draw(st.permutations(range(graph.n_columns)))[: data.draw(st.integers(0, graph.n_columns))]
    part = graph.restrict(rows, columns)
    assert np.array_equal(dense(part), dense(graph)[np.ix_(rows, columns)])
    assert part == Incidence.from_rows(part.rows(), len(columns))


# Unique matchings, so that the vector is determined and not only its size.
UNIQUE = [
    # Mass under a known force: m*a = F (a); der(v) = a (der_v, a); p = F*v_known (p).
    ([[0], [1, 0], [2]], 3, [0, 1, 2]),
    # The same backwards: row k needs everything after it, so that only the last one is free to start.
    ([[0, 1, 2], [1, 2], [2]], 3, [0, 1, 2]),
    # More unknowns than equations; column 1 occurs nowhere.
    ([[2], [0, 2]], 3, [2, 0]),
    # A row without unknowns, such as 0 = p - 3 in a parameter p.
    ([[], [0]], 1, [-1, 0]),
    ([], 2, []),
    ([[], []], 0, [-1, -1]),
]


@pytest.mark.parametrize(("rows", "n_columns", "expected"), UNIQUE)
def test_unique_matchings(rows: list[list[int]], n_columns: int, expected: list[int]) -> None:
    assert match(Incidence.from_rows(rows, n_columns)).tolist() == expected


def test_two_sources_at_one_node_leave_one_row() -> None:
    # v = 1, v = 2, u = v: two ideal voltage sources in parallel.
    columns = match(Incidence.from_rows([[0], [0], [0, 1]], 2))
    assert sorted(columns.tolist()) == [-1, 0, 1]
    assert columns[2] == 1


@pytest.mark.parametrize("small", [500, 0])
@given(graph=graphs())
def test_size_is_the_generic_rank(small: int, graph: Incidence) -> None:
    """By our own augmenting paths, and by SciPy's algorithm."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(matching, "_MOST_WITHOUT_SCIPY", small)
        columns = match(graph)
    assert columns.shape == (graph.n_rows,)
    pairs = [(r, c) for r, c in enumerate(columns.tolist()) if c >= 0]
    assert all(c in graph.row(r) for r, c in pairs)
    assert len({c for _, c in pairs}) == len(pairs) == generic_rank(graph)


@pytest.mark.parametrize("blocks_of", [1, 2])
def test_long_causal_chain_in_random_order(blocks_of: int) -> None:
    # 20 000 equations, each needing results of earlier ones, singly or in pairs to be solved together.
    n = 20_000
    chance = random.Random(1)
    place = chance.sample(range(n), n)
    rows = []
    for i in range(n):
        first = i - i % blocks_of
        earlier = [chance.randrange(first), first - 1] if first else []
        rows.append([place[j] for j in (*range(first, first + blocks_of), *earlier)])
    chance.shuffle(rows)
    columns = match(Incidence.from_rows(rows, n))
    assert sorted(columns.tolist()) == list(range(n))
    assert all(c in row for row, c in zip(rows, columns.tolist(), strict=True))
