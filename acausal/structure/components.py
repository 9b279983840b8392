"""Strong components of directed graphs."""

from __future__ import annotations

import numpy as np

from acausal.structure.graph import IntArray

_SMALL = 2000
"""Nodes up to which SciPy is not loaded for it: that takes a quarter of a second, this algorithm some milliseconds."""


def strong_components(source: IntArray, target: IntArray, n: int) -> IntArray:
    """Label of the strong component of each of `n` nodes, for edges source[k] -> target[k]; labels are arbitrary.

    Source: Tarjan, "Depth-first search and linear graph algorithms", SIAM J. Comput. 1 (1972); for large graphs as in
    SciPy.
    """
    if n > _SMALL:
        from scipy.sparse import csr_array
        from scipy.sparse.csgraph import connected_components

        edges = csr_array((np.ones(len(source)), (source, target)), shape=(n, n))
        return np.asarray(connected_components(edges, directed=True, connection="strong")[1], dtype=np.int64)
    successors: list[list[int]] = [[] for _ in range(n)]
    for a, b in zip(source.tolist(), target.tolist(), strict=True):
        successors[a].append(b)
    return np.array(_tarjan(successors), dtype=np.int64)


def _tarjan(successors: list[list[int]]) -> list[int]:
    """Without recursion: `path` holds the nodes of the current branch, each with its successors still to visit."""
    n = len(successors)
    label = [-1] * n
    order = [0] * n  # when a node was first seen, from 1
    low = [0] * n  # the earliest node on the stack that is reached from it
    stack: list[int] = []
    seen = found = 0
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
                        label[stack.pop()] = found
                    found += 1
    return label
