"""Strong components: tables, reachability by brute force, and no recursion."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from acausal.structure import blt
from acausal.structure.blt import strong_components

Edges = list[tuple[int, int]]

TABLE: list[tuple[Edges, int, list[list[int]]]] = [
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
@pytest.mark.parametrize(("edges", "n", "expected"), TABLE)
def test_table(edges: Edges, n: int, expected: list[list[int]], small: int, monkeypatch: pytest.MonkeyPatch) -> None:
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
