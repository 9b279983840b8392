"""Alias elimination on integers: classes of unknowns that are equal up to sign."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from acausal.errors import InternalError
from acausal.structure.graph import BoolArray, IntArray

Relation = tuple[int, int, int]


@dataclass(frozen=True, eq=False)
class AliasClasses:
    """Unknowns as signed copies of representatives: v[i] = sign[i] * v[representative[i]]."""

    representative: IntArray  # shape (n,): the member that represents the class of each unknown; usually itself
    sign: IntArray  # shape (n,): +1 or -1; +1 for representatives
    zero: BoolArray  # shape (n,): whether the relations of the class imply v = -v, so that all its members are 0
    # Indices of the relations that follow from earlier ones. They carry no information: each is one equation too many
    # in its cycle, and `cycle` finds the others of that cycle.
    redundant: tuple[int, ...]

    @property
    def kept(self) -> IntArray:
        """Unknowns that remain, ascending: representatives of the classes that are not zero. Shape (n_kept,)."""
        is_representative = self.representative == np.arange(len(self.representative))
        return np.flatnonzero(is_representative & ~self.zero)

    def __repr__(self) -> str:
        return (
            f"AliasClasses({len(self.representative)} unknowns, {len(self.kept)} kept, "
            f"{int(self.zero.sum())} zero, {len(self.redundant)} redundant relations)"
        )


def classes(n: int, relations: Sequence[Relation], priority: Sequence[int] | IntArray) -> AliasClasses:
    """Alias classes of `n` unknowns.

    Parameters
    ----------
    relations
        Triples (i, j, sign) that state v[i] = sign * v[j], sign +1 or -1; i = j is allowed.
    priority
        Shape (n,): the member with the highest priority represents its class; ties go to the lowest index.

    The partition does not depend on the order of the relations; of a cycle, the latest relation counts as `redundant`.

    Raises InternalError (AC901) for a sign other than +1 and -1.

    Source: union-find by size with path halving, Tarjan and van Leeuwen, "Worst-case analysis of set union algorithms",
    J. ACM 31 (1984); each link carries the sign between its ends.
    """
    # Plain lists, and the find operation written out twice: an element of a numpy array costs 10 times one of a list,
    # and a call 50 ns.
    parent = list(range(n))
    to_parent = [1] * n
    size = [1] * n
    zero = [False] * n
    redundant: list[int] = []
    for index, (i, j, sign) in enumerate(relations):
        if sign != 1 and sign != -1:
            raise InternalError("AC901", f"alias relation {index} has sign {sign}; it must be +1 or -1")
        product = sign
        while (up := parent[i]) != i:
            to_parent[i] *= to_parent[up]
            product *= to_parent[i]
            parent[i] = up = parent[up]
            i = up
        while (up := parent[j]) != j:
            to_parent[j] *= to_parent[up]
            product *= to_parent[j]
            parent[j] = up = parent[up]
            j = up
        # `i` and `j` are roots now, and the relation reads v[i] = product * v[j].
        if i == j:
            if product == 1 or zero[i]:
                redundant.append(index)
            else:
                zero[i] = True
            continue
        if zero[i] and zero[j]:
            redundant.append(index)
        if size[i] > size[j]:
            i, j = j, i
        parent[i] = j
        to_parent[i] = product
        size[j] += size[i]
        zero[j] = zero[j] or zero[i]
    return _represent(parent, to_parent, zero, redundant, np.asarray(priority, dtype=np.int64))


def _represent(
    parent: list[int], to_parent: list[int], zero: list[bool], redundant: list[int], priority: IntArray
) -> AliasClasses:
    """Turn the forest into classes that are represented by their member of highest priority."""
    root = np.array(parent, dtype=np.int64)
    sign = np.array(to_parent, dtype=np.int64)
    while not np.array_equal(root, above := root[root]):
        # The sign of a root is +1, so elements that have reached their root do not change any more.
        sign = sign * sign[root]
        root = above
    order = np.lexsort((np.arange(len(root)), -priority, root))
    first = np.flatnonzero(np.diff(root[order], prepend=-1))
    leader = np.arange(len(root))
    leader[root[order[first]]] = order[first]
    representative = leader[root]
    return AliasClasses(
        representative=representative,
        sign=sign * sign[representative],
        zero=np.array(zero, dtype=bool)[root],
        redundant=tuple(redundant),
    )


def cycle(relations: Sequence[Relation], index: int) -> tuple[int, ...]:
    """Other relations from which relation `index` follows, along a shortest path; evidence for a message.

    Empty if the relation is trivial (i = i). Costs O(number of relations), which is paid only for those reported.

    Raises InternalError (AC904) if the others do not imply it, which cannot happen for `AliasClasses.redundant`.
    """
    i, j, sign = relations[index]
    if i == j and sign == 1:
        return ()
    neighbours: dict[int, list[tuple[int, int, int]]] = {}
    for k, (a, b, s) in enumerate(relations):
        if k != index:
            neighbours.setdefault(a, []).append((b, s, k))
            neighbours.setdefault(b, []).append((a, s, k))
    path = _signed_path(neighbours, i, j, sign)
    if path is None:
        # Each side is zero by itself: v[i] = -v[i] and v[j] = -v[j].
        left, right = _signed_path(neighbours, i, i, -1), _signed_path(neighbours, j, j, -1)
        if left is None or right is None:
            raise InternalError("AC904", f"alias relation {index} does not follow from the others")
        path = left + right
    return tuple(dict.fromkeys(path))


def _signed_path(
    neighbours: dict[int, list[tuple[int, int, int]]], start: int, end: int, sign: int
) -> list[int] | None:
    """Shortest chain of relations that implies v[start] = sign * v[end]: breadth first over (unknown, sign) pairs."""
    origin, goal = (start, 1), (end, sign)
    reached_from: dict[tuple[int, int], tuple[tuple[int, int], int]] = {origin: (origin, -1)}
    queue = deque([origin])
    while queue and goal not in reached_from:
        here = queue.popleft()
        for other, s, k in neighbours.get(here[0], ()):
            there = (other, here[1] * s)
            if there not in reached_from:
                reached_from[there] = (here, k)
                queue.append(there)
    if goal not in reached_from:
        return None
    path: list[int] = []
    while goal != origin:
        goal, k = reached_from[goal]
        path.append(k)
    return path[::-1]
