"""Incidence: every operation against the same operation on a dense 0/1 matrix."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from acausal.errors import InternalError
from acausal.structure import Incidence, inverse
from tests.structure.graphs import dense, graphs


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
    with pytest.raises(InternalError, match=f"names column .*{column}, outside 0 .. 1") as caught:
        Incidence.from_rows([[column]], 2)
    assert caught.value.code == "AC901"


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
