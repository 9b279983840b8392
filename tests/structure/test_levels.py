"""Levels of dependence: a graph in, the expected levels out."""

from __future__ import annotations

import numpy as np
import pytest

from acausal.structure.blt import levels


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
