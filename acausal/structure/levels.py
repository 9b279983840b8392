"""Levels of a dependency graph: the order in which dependent things are decided; a cycle is decided at once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from acausal.structure.blt import in_topological_order, strong_components
from acausal.structure.graph import IntArray


def levels(source: IntArray, target: IntArray, late: Sequence[bool]) -> IntArray:
    """Level of each node: at least that of the nodes it depends on, and above that of the late ones among them.

    Parameters
    ----------
    source, target
        Shape (n_edges,): `target[k]` depends on `source[k]`.
    late
        Shape (n,): whether dependents of a node must wait until it is known.

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
    for a, b, wait in zip(component[source].tolist(), component[target].tolist(), step.tolist(), strict=True):
        if a != b:
            followers[a].append((b, wait))
    level = [0] * count
    for a in in_topological_order(component[source], component[target], count):
        for b, wait in followers[a]:
            level[b] = max(level[b], level[a] + wait)
    return np.array(level, dtype=np.int64)[component]
