"""Maximum matching: tables, and its size against the rank of a random matrix with the same pattern."""

from __future__ import annotations

import random

import pytest
from hypothesis import given

from acausal.structure import Incidence, match, matching
from tests.structure.graphs import generic_rank, graphs

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
