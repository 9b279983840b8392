"""Block lower triangular form: which equations must be solved together, and in which order; levels of dependence."""

from __future__ import annotations

import heapq
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from acausal.errors import InternalError
from acausal.structure.graph import Incidence, IntArray, inverse


@dataclass(frozen=True, slots=True)
class Block:
    """Equations that can only be solved together, for as many unknowns.

    `rows` is ascending; `columns[k]` is the column `rows[k]` is matched to.
    """

    rows: tuple[int, ...]
    columns: tuple[int, ...]

    def __len__(self) -> int:
        return len(self.rows)


def blocks(incidence: Incidence, row_to_column: IntArray) -> tuple[Block, ...]:
    """Irreducible blocks in an order in which they can be solved one after the other.

    Of all such orders this is the one that takes, at each step, the solvable block with the smallest row. It follows
    the order of the source as far as possible and does not depend on the version of SciPy.

    Parameters
    ----------
    incidence
        The graph. A column that is not matched with a row counts as known.
    row_to_column
        Shape (n_rows,): a matching of every row, see `matching.match`.

    Raises InternalError (AC902) if a row is unmatched: such systems belong to `diagnose`.

    Source: strong components are Tarjan's, see `strong_components`; Kahn, "Topological sorting of large
    networks", CACM 5 (1962), for the order.
    """
    n_rows = incidence.n_rows
    if n_rows == 0:
        return ()
    if np.any(row_to_column < 0):
        unmatched = int(np.argmax(row_to_column < 0))
        raise InternalError("AC902", f"row {unmatched} is not matched: block triangular form needs every row matched")
    needed = inverse(row_to_column, incidence.n_columns)[incidence.indices]
    user = incidence.row_of_entry
    inner = (needed >= 0) & (needed != user)
    user, needed = user[inner], needed[inner]

    component = _components(user, needed, n_rows)
    order = in_topological_order(component[needed], component[user], int(component.max()) + 1)

    # Rows grouped by component; ascending inside because the sort is stable.
    by_component = np.argsort(component, kind="stable")
    rows = by_component.tolist()
    columns = row_to_column[by_component].tolist()
    ends = np.cumsum(np.bincount(component)).tolist()
    starts = [0, *ends[:-1]]
    return tuple(Block(tuple(rows[starts[k] : ends[k]]), tuple(columns[starts[k] : ends[k]])) for k in order)


def _components(user: IntArray, needed: IntArray, n_rows: int) -> IntArray:
    """Strong component of each row, numbered by the smallest row in it."""
    # SciPy's labels happen to be in topological order, which it does not guarantee: use the partition only.
    labels = strong_components(user, needed, n_rows)
    _, first, compact = np.unique(labels, return_index=True, return_inverse=True)
    number = np.empty(len(first), dtype=np.int64)
    number[np.argsort(first)] = np.arange(len(first))
    return np.asarray(number[compact], dtype=np.int64)


def in_topological_order(before: IntArray, after: IntArray, count: int) -> list[int]:
    """Topological order of the components 0 .. count - 1; where there is a choice, the smallest number comes first.

    Parameters
    ----------
    before, after
        Shape (n_edges,): `before[k]` must precede `after[k]`. Edges from a component to itself are ignored.
    """
    outer = before != after
    keys = np.unique(before[outer] * count + after[outer])
    source, target = keys // count, keys % count
    waiting = np.bincount(target, minlength=count).tolist()
    starts = np.searchsorted(source, np.arange(count + 1)).tolist()
    targets = target.tolist()
    ready = [k for k in range(count) if waiting[k] == 0]
    order: list[int] = []
    while ready:
        k = heapq.heappop(ready)
        order.append(k)
        for j in targets[starts[k] : starts[k + 1]]:
            waiting[j] -= 1
            if waiting[j] == 0:
                heapq.heappush(ready, j)
    return order


_MOST_WITHOUT_SCIPY = 2000
"""Up to this many nodes SciPy is not imported: the import takes a quarter of a second, `_tarjan` a few milliseconds."""


def strong_components(source: IntArray, target: IntArray, n: int) -> IntArray:
    """Label of the strong component of each of `n` nodes, shape (n,); labels are arbitrary.

    `source` and `target`, of shape (n_edges,), are the ends of the edges source[k] -> target[k].

    Source: Tarjan, "Depth-first search and linear graph algorithms", SIAM J. Comput. 1 (1972); for large graphs SciPy's
    implementation.
    """
    if n > _MOST_WITHOUT_SCIPY:
        from scipy.sparse import csr_array
        from scipy.sparse.csgraph import connected_components

        edges = csr_array((np.ones(len(source)), (source, target)), shape=(n, n))
        return np.asarray(connected_components(edges, directed=True, connection="strong")[1], dtype=np.int64)
    successors: list[list[int]] = [[] for _ in range(n)]
    for a, b in zip(source.tolist(), target.tolist(), strict=True):
        successors[a].append(b)
    return np.array(_tarjan(successors), dtype=np.int64)


def _tarjan(successors: list[list[int]]) -> list[int]:
    """Tarjan's algorithm without recursion; `path` is the current branch, each node with its unvisited successors."""
    n = len(successors)
    label = [-1] * n
    order = [0] * n  # when a node was first seen, from 1
    low = [0] * n  # the earliest node on the stack that is reached from it
    stack: list[int] = []
    seen = components = 0
    for root in range(n):
        if order[root]:
            continue
        path = [(root, iter(successors[root]))]
        seen += 1
        order[root] = low[root] = seen
        stack.append(root)
        while path:
            node, rest = path[-1]
            for other in rest:
                if not order[other]:
                    seen += 1
                    order[other] = low[other] = seen
                    stack.append(other)
                    path.append((other, iter(successors[other])))
                    break
                if label[other] < 0:
                    low[node] = min(low[node], order[other])
            else:
                path.pop()
                if path:
                    low[path[-1][0]] = min(low[path[-1][0]], low[node])
                if low[node] == order[node]:
                    while label[node] < 0:
                        label[stack.pop()] = components
                    components += 1
    return label


def levels(source: IntArray, target: IntArray, late: Sequence[bool]) -> IntArray:
    """Level of each node: at least that of the nodes on which it depends, and above that of the `late` ones among them.

    Parameters
    ----------
    source, target
        Shape (n_edges,): `target[k]` depends on `source[k]`.
    late
        Shape (n,): whether dependents of a node must be on a higher level.

    Returns
    -------
    Shape (n,): the smallest levels, from 0. Nodes of one cycle share a level, whether they are late or not.

    Source: longest paths in the condensation of the graph; R. Tarjan, "Depth-first search and linear graph algorithms",
    SIAM J. Comput. 1 (1972), and A. Kahn, "Topological sorting of large networks", CACM 5 (1962).
    """
    n = len(late)
    if n == 0:
        return np.zeros(0, dtype=np.int64)
    _, component = np.unique(strong_components(source, target, n), return_inverse=True)
    count = int(component.max()) + 1
    step = np.asarray(late, dtype=np.int64)[source]
    followers: list[list[tuple[int, int]]] = [[] for _ in range(count)]
    for a, b, step_to in zip(component[source].tolist(), component[target].tolist(), step.tolist(), strict=True):
        if a != b:
            followers[a].append((b, step_to))
    level = [0] * count
    for a in in_topological_order(component[source], component[target], count):
        for b, step_to in followers[a]:
            level[b] = max(level[b], level[a] + step_to)
    return np.array(level, dtype=np.int64)[component]
