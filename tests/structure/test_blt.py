"""Block triangular form, strong components and levels: tables, and the definitions by brute force."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from acausal.errors import InternalError
from acausal.structure import Block, Incidence, IntArray, blocks, blt, match
from acausal.structure.blt import levels, strong_components
from tests.expected import fails_with
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
    with fails_with(InternalError, "AC902", match="row 1 is not matched"):
        blocks(Incidence.from_rows([[0], [0]], 1), np.array([0, -1]))


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


Edges = list[tuple[int, int]]

STRONG: list[tuple[Edges, int, list[list[int]]]] = [
    ([], 0, []),
    ([], 2, [[0], [1]]),
    ([(0, 1), (1, 0), (1, 2)], 3, [[0, 1], [2]]),
    ([(0, 0)], 1, [[0]]),
    # Tarjan's own example needs the second edge into the stack: 0 -> 1 -> 2 -> 0, 2 -> 3 -> 4 -> 3, 4 -> 1.
    ([(0, 1), (1, 2), (2, 0), (2, 3), (3, 4), (4, 3), (4, 1)], 5, [[0, 1, 2, 3, 4]]),
    # A cross edge to a finished component does not join it.
    ([(0, 1), (2, 1), (1, 3), (3, 1)], 4, [[0], [1, 3], [2]]),
]


def parts(edges: Edges, n: int) -> list[list[int]]:
    source, target = (np.array([e[k] for e in edges], dtype=np.int64) for k in (0, 1))
    labels = strong_components(source, target, n).tolist()
    return sorted([i for i in range(n) if labels[i] == label] for label in set(labels))


@pytest.mark.parametrize("small", [2000, -1])
@pytest.mark.parametrize(("edges", "n", "expected"), STRONG)
def test_strong_components(
    edges: Edges, n: int, expected: list[list[int]], small: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By our own algorithm, and by SciPy's."""
    monkeypatch.setattr(blt, "_MOST_WITHOUT_SCIPY", small)
    assert parts(edges, n) == (expected if n else [])


@given(st.integers(1, 7).flatmap(lambda n: st.tuples(st.just(n), st.sets(st.tuples(*[st.integers(0, n - 1)] * 2)))))
def test_two_nodes_belong_together_when_each_reaches_the_other(case: tuple[int, set[tuple[int, int]]]) -> None:
    n, edges = case
    reach = np.eye(n, dtype=bool)
    for a, b in edges:
        reach[a, b] = True
    for _ in range(n):
        reach = reach @ reach
    both = reach & reach.T
    assert parts(sorted(edges), n) == sorted(list(t) for t in {tuple(np.flatnonzero(row).tolist()) for row in both})


def test_a_long_chain_needs_no_recursion() -> None:
    n = blt._MOST_WITHOUT_SCIPY
    edges = [(k, k + 1) for k in range(n - 1)]
    assert parts(edges, n) == [[k] for k in range(n)]
    assert parts([*edges, (n - 1, 0)], n) == [list(range(n))]


@pytest.mark.parametrize(
    ("edges", "late", "expected"),
    [
        ([], [], []),
        ([], [True, False], [0, 0]),
        # 0 is late: what follows from it waits, what follows from that does not wait once more
        ([(0, 1), (1, 2)], [True, False, False], [0, 1, 1]),
        ([(0, 1), (1, 2)], [True, True, False], [0, 1, 2]),
        # the longest way counts
        ([(0, 1), (1, 3), (0, 2), (2, 3)], [True, True, False, False], [0, 1, 1, 2]),
        # a circle is one level, and what follows from its late member waits for it
        ([(0, 1), (1, 0), (1, 2)], [True, True, False], [0, 0, 1]),
        ([(0, 0), (0, 1)], [True, False], [0, 1]),
        ([(3, 2), (2, 1), (1, 0)], [True, True, True, True], [3, 2, 1, 0]),
    ],
)
def test_levels(edges: list[tuple[int, int]], late: list[bool], expected: list[int]) -> None:
    ends = np.array(edges, dtype=np.int64).reshape(-1, 2)
    assert levels(ends[:, 0], ends[:, 1], late).tolist() == expected
