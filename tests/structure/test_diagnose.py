"""Dulmage-Mendelsohn parts: tables from broken circuits, and the definitions by brute force."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given

from acausal.errors import InternalError
from acausal.structure import Incidence, dulmage_mendelsohn, inverse, match, minimal_over, minimal_under
from tests.expected import fails_with
from tests.structure.graphs import generic_rank, graphs

TABLE = [
    # name, (rows, n_columns), over rows, over columns, square rows, square columns, under rows, under columns
    ("regular loop", ([[0, 1], [0, 1]], 2), [], [], [0, 1], [0, 1], [], []),
    # Two voltage sources on one node (v = 1; v = 2) with a resistor behind it (u = v - 0; u = R*i).
    ("sources", ([[0], [0], [0, 1], [1, 2]], 3), [0, 1], [0], [2, 3], [1, 2], [], []),
    # Resistor without ground: u = v_p - v_n; u = R*i; i known from a source elsewhere (i = 1).
    ("no ground", ([[0, 1, 2], [0, 3], [3]], 4), [], [], [1, 2], [0, 3], [0], [1, 2]),
    # Both at once in separate islands, plus an unknown in no equation and an equation without unknowns.
    ("both", ([[0], [0], [1, 2], []], 4), [0, 1, 3], [0], [], [], [2], [1, 2, 3]),
    ("nothing", ([], 0), [], [], [], [], [], []),
]


@pytest.mark.parametrize(("graph", "parts"), [(row[1], row[2:]) for row in TABLE], ids=[str(row[0]) for row in TABLE])
def test_table(graph: tuple[list[list[int]], int], parts: tuple[list[int], ...]) -> None:
    incidence = Incidence.from_rows(*graph)
    dm = dulmage_mendelsohn(incidence, match(incidence))
    found = (dm.over_rows, dm.over_columns, dm.square_rows, dm.square_columns, dm.under_rows, dm.under_columns)
    assert [list(part) for part in found] == list(parts)
    assert dm.surplus == len(parts[0]) - len(parts[1])
    assert dm.missing == len(parts[5]) - len(parts[4])


def test_minimal_over_names_one_conflict_of_two() -> None:
    # Two nodes, each with two voltage sources, joined by a resistor: two separate conflicts.
    graph = Incidence.from_rows([[0], [0], [1], [1], [0, 1, 2]], 3)
    columns = match(graph)
    conflicts = {minimal_over(graph, r, columns) for r in np.flatnonzero(columns < 0).tolist()}
    assert conflicts == {((0, 1), (0,)), ((2, 3), (1,))}


def test_minimal_over_follows_the_chain_of_determinations() -> None:
    # x0 = 1, x1 = x0, x2 = x1, x2 = 5, and x3 = x0, which is innocent.
    graph = Incidence.from_rows([[0], [1, 0], [2, 1], [2], [3, 0]], 4)
    columns = match(graph)
    (surplus,) = np.flatnonzero(columns < 0).tolist()
    assert minimal_over(graph, surplus, columns) == ((0, 1, 2, 3), (0, 1, 2))


def test_minimal_under_names_one_island_of_two() -> None:
    # Two floating resistors (v_p - v_n given) and a determined unknown 4 that occurs in the first of them.
    graph = Incidence.from_rows([[0, 1, 4], [2, 3], [4]], 5)
    columns = match(graph)
    free = np.flatnonzero(inverse(columns, 5) < 0).tolist()
    assert {minimal_under(graph, c, columns) for c in free} == {((0,), (0, 1)), ((1,), (2, 3))}


def test_matched_row_or_column_is_no_evidence() -> None:
    graph = Incidence.from_rows([[0]], 1)
    with pytest.raises(InternalError, match="row 0 is matched"):
        minimal_over(graph, 0, match(graph))
    with pytest.raises(InternalError, match="column 0 is matched"):
        minimal_under(graph, 0, match(graph))


def test_matching_that_is_not_maximum_is_noticed() -> None:
    with fails_with(InternalError, "AC903", match="not maximum"):
        dulmage_mendelsohn(Incidence.from_rows([[0]], 1), np.array([-1]))


# --- definitions ---


@given(graphs())
def test_over_rows_are_those_that_can_be_missed(graph: Incidence) -> None:
    # A row is in the over-determined part exactly if a maximum matching exists without it.
    dm = dulmage_mendelsohn(graph, match(graph))
    full = generic_rank(graph)
    others = [[r for r in range(graph.n_rows) if r != row] for row in range(graph.n_rows)]
    every_column = range(graph.n_columns)
    expected = [row for row, rest in enumerate(others) if generic_rank(graph.restrict(rest, every_column)) == full]
    assert list(dm.over_rows) == expected


@given(graphs())
def test_parts_of_the_transposed_graph_are_exchanged(graph: Incidence) -> None:
    columns = match(graph)
    dm, turned = dulmage_mendelsohn(graph, columns), dulmage_mendelsohn(graph.transpose(), match(graph.transpose()))
    assert (dm.over_rows, dm.over_columns) == (turned.under_columns, turned.under_rows)
    assert (dm.under_rows, dm.under_columns) == (turned.over_columns, turned.over_rows)
    assert (dm.square_rows, dm.square_columns) == (turned.square_columns, turned.square_rows)


@given(graphs())
def test_parts_are_a_triangular_partition(graph: Incidence) -> None:
    dm = dulmage_mendelsohn(graph, match(graph))
    assert sorted(dm.over_rows + dm.square_rows + dm.under_rows) == list(range(graph.n_rows))
    assert sorted(dm.over_columns + dm.square_columns + dm.under_columns) == list(range(graph.n_columns))
    for row in dm.over_rows:
        assert set(graph.row(row).tolist()) <= set(dm.over_columns)
    for row in dm.square_rows:
        assert not set(graph.row(row).tolist()) & set(dm.under_columns)
    # Each part has full rank in its shorter direction.
    assert generic_rank(graph.restrict(dm.over_rows, dm.over_columns)) == len(dm.over_columns)
    assert generic_rank(graph.restrict(dm.square_rows, dm.square_columns)) == len(dm.square_rows)
    assert len(dm.square_rows) == len(dm.square_columns)
    assert generic_rank(graph.restrict(dm.under_rows, dm.under_columns)) == len(dm.under_rows)


@given(graphs())
def test_minimal_over_is_a_circuit(graph: Incidence) -> None:
    columns = match(graph)
    surplus = np.flatnonzero(columns < 0).tolist()
    assume(surplus)
    for row in surplus:
        found = minimal_over(graph, row, columns)
        assert row in found.rows
        assert len(found.rows) == len(found.columns) + 1
        for left_out in found.rows:
            rest = [r for r in found.rows if r != left_out]
            assert generic_rank(graph.restrict(rest, range(graph.n_columns))) == len(rest)


@given(graphs())
def test_minimal_under_is_a_circuit(graph: Incidence) -> None:
    columns = match(graph)
    free = np.flatnonzero(inverse(columns, graph.n_columns) < 0).tolist()
    assume(free)
    for column in free:
        found = minimal_under(graph, column, columns)
        assert column in found.columns
        assert len(found.columns) == len(found.rows) + 1
        users = [r for r, row in enumerate(graph.rows()) if set(row) & set(found.columns)]
        assert list(found.rows) == users
        for given_value in found.columns:
            rest = [c for c in found.columns if c != given_value]
            assert generic_rank(graph.restrict(found.rows, rest)) == len(rest)
