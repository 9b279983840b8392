"""Block triangular form: tables, and the definition of an irreducible block by brute force."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given

from acausal.errors import InternalError
from acausal.structure import Block, Incidence, IntArray, blocks, match
from tests.structure.graphs import regular_graphs

TABLE = [
    # RC circuit, u_C a state (known): R*i = u_R (i, u_R); C*der_u = i (der_u, i); u_R + u_C = U (u_R).
    (
        "RC circuit",
        ([[0, 1], [2, 0], [1]], 3),
        [((2,), (1,)), ((0,), (0,)), ((1,), (2,))],
    ),
    # Voltage divider: u1 = R1*i, u2 = R2*i, u1 + u2 = U, then the loss P = U*i: a loop of three and its user.
    (
        "divider",
        ([[3, 2], [0, 2], [1, 2], [0, 1]], 4),
        [((1, 2, 3), None), ((0,), (3,))],
    ),
    # Two independent loops: the one with the smaller row comes first.
    (
        "two islands",
        ([[2, 3], [0, 1], [0, 1], [2, 3]], 4),
        [((0, 3), None), ((1, 2), None)],
    ),
    # Four assignments written backwards.
    (
        "reverse",
        ([[0, 1], [1, 2], [2, 3], [3]], 4),
        [((3,), (3,)), ((2,), (2,)), ((1,), (1,)), ((0,), (0,))],
    ),
    # A known unknown (column 0 is matched by nobody): x1 = f(x0), x2 = g(x0, x1).
    ("known column", ([[0, 1, 2], [1]], 3), [((1,), (1,)), ((0,), None)]),
    ("nothing", ([], 0), []),
]


@pytest.mark.parametrize(("graph", "expected"), [row[1:] for row in TABLE], ids=[str(row[0]) for row in TABLE])
def test_table(
    graph: tuple[list[list[int]], int], expected: list[tuple[tuple[int, ...], tuple[int, ...] | None]]
) -> None:
    incidence = Incidence.from_rows(*graph)
    row_to_column = match(incidence)
    result = blocks(incidence, row_to_column)
    assert [block.rows for block in result] == [rows for rows, _ in expected]
    for block, (rows, columns) in zip(result, expected, strict=True):
        # Inside a loop the pairing is free: it is the one of the matching.
        assert block.columns == (columns or tuple(row_to_column[list(rows)].tolist()))


def test_unmatched_row_is_refused() -> None:
    with pytest.raises(InternalError, match="row 1 is not matched") as caught:
        blocks(Incidence.from_rows([[0], [0]], 1), np.array([0, -1]))
    assert caught.value.code == "AC902"


def test_block_has_a_length() -> None:
    assert len(Block((3, 5), (1, 0))) == 2


@given(regular_graphs())
def test_blocks_can_be_solved_in_their_order(system: tuple[Incidence, IntArray]) -> None:
    graph, hidden = system
    solved: set[int] = set()
    seen_rows: list[int] = []
    for block in blocks(graph, hidden):
        assert block.columns == tuple(hidden[list(block.rows)].tolist())
        solved |= set(block.columns)
        seen_rows += block.rows
        for row in block.rows:
            assert set(graph.row(row).tolist()) <= solved
    assert sorted(seen_rows) == list(range(graph.n_rows))


@given(regular_graphs(max_size=7))
def test_blocks_are_irreducible(system: tuple[Incidence, IntArray]) -> None:
    # Irreducible: every proper part of the rows has more unknowns of the block than rows, so it cannot be solved alone.
    graph, hidden = system
    for block in blocks(graph, hidden):
        own = set(block.columns)
        for size in range(1, len(block)):
            for rows in combinations(block.rows, size):
                assert len(own & _union(graph, rows)) > size


def _union(graph: Incidence, rows: tuple[int, ...]) -> set[int]:
    return {c for row in rows for c in graph.row(row).tolist()}


@given(regular_graphs())
def test_blocks_do_not_depend_on_the_matching(system: tuple[Incidence, IntArray]) -> None:
    graph, hidden = system
    ours = [(b.rows, set(b.columns)) for b in blocks(graph, hidden)]
    assert ours == [(b.rows, set(b.columns)) for b in blocks(graph, match(graph))]


def test_deep_chain_and_long_loop() -> None:
    # 20 000 equations one after the other; closing the chain makes all of them one block. No recursion in either.
    n = 20_000
    chain = [[i, i + 1] for i in range(n - 1)] + [[n - 1]]
    order = blocks(Incidence.from_rows(chain, n), np.arange(n))
    assert [block.rows[0] for block in order] == list(range(n - 1, -1, -1))
    chain[-1] = [n - 1, 0]
    assert [len(block) for block in blocks(Incidence.from_rows(chain, n), np.arange(n))] == [n]
