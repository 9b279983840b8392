"""Random bipartite graphs for the property tests, and what a dense matrix says about them."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from hypothesis import strategies as st

from acausal.structure import Incidence, IntArray


@st.composite
def graphs(draw: st.DrawFn, max_size: int = 8) -> Incidence:
    """Graphs of any shape up to `max_size` rows and columns, empty rows and columns included."""
    n_rows, n_columns = draw(st.integers(0, max_size)), draw(st.integers(0, max_size))
    row = st.sets(st.integers(0, n_columns - 1), max_size=4) if n_columns else st.just(set())
    return Incidence.from_rows(draw(st.lists(row, min_size=n_rows, max_size=n_rows)), n_columns)


@st.composite
def regular_graphs(draw: st.DrawFn, max_size: int = 8) -> tuple[Incidence, IntArray]:
    """Square graphs with a hidden complete matching (row -> column), which is returned too."""
    n = draw(st.integers(1, max_size))
    hidden = draw(st.permutations(range(n)))
    extra = draw(st.lists(st.sets(st.integers(0, n - 1), max_size=3), min_size=n, max_size=n))
    graph = Incidence.from_rows([{c} | more for c, more in zip(hidden, extra, strict=True)], n)
    return graph, np.array(hidden, dtype=np.int64)


def dense(graph: Incidence) -> npt.NDArray[np.int64]:
    """0/1 matrix of a graph, element by element."""
    matrix = np.zeros((graph.n_rows, graph.n_columns), dtype=np.int64)
    for i, row in enumerate(graph.rows()):
        for j in row:
            matrix[i, j] = 1
    return matrix


def generic_rank(graph: Incidence) -> int:
    """Rank with random numbers at the entries: with probability one the size of a maximum matching (Edmonds 1967)."""
    if graph.n_entries == 0:
        return 0
    values = np.random.default_rng(7).uniform(1.0, 2.0, size=(graph.n_rows, graph.n_columns))
    return int(np.linalg.matrix_rank(dense(graph) * values))
