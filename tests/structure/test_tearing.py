"""Tearing: tables with their physical origin, counts known from the topology, and validity on random blocks."""

from __future__ import annotations

from collections.abc import Iterable
from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from acausal.errors import InternalError
from acausal.structure import Incidence, IntArray, Tearing, match, tear
from tests.expected import fails_with
from tests.structure.graphs import graphs, regular_graphs

Pairs = set[tuple[int, int]]


def everywhere(rows: Iterable[Iterable[int]]) -> Pairs:
    return {(r, c) for r, columns in enumerate(rows) for c in columns}


TABLE = [
    # Voltage divider: u1 = R1*i; u2 = R2*i; u1 + u2 = U, unknowns u1, u2, i. Ohm's law is not divided by R.
    (
        "divider",
        [[0, 2], [1, 2], [0, 1]],
        {(0, 0), (1, 1), (2, 0), (2, 1)},
        Tearing(torn=(2,), residual=(2,), sequence=((0, 0), (1, 1))),
    ),
    # Diode and resistor: i = Is*(exp(u/Vt) - 1); u_R = R*i; u + u_R = U, unknowns i, u, u_R. exp is not inverted and
    # u_R = R*i is solved both ways: from u the rest follows one way round, the sum is left.
    (
        "diode",
        [[0, 1], [2, 0], [1, 2]],
        {(0, 0), (1, 2), (1, 0), (2, 1), (2, 2)},
        Tearing(torn=(1,), residual=(1,), sequence=((0, 0), (2, 2))),
    ),
    # Two bodies pushed as one, m1*a = F - f; m2*a = f, unknowns a, f: one equation feeds the other.
    ("pushed", [[0, 1], [0, 1]], {(0, 1), (1, 1)}, Tearing(torn=(0,), residual=(1,), sequence=((0, 1),))),
    # x + y*y = 1; x*x + y = 2 with nothing solvable: both are iterated upon.
    ("nothing solvable", [[0, 1], [0, 1]], set(), Tearing(torn=(0, 1), residual=(0, 1), sequence=())),
    # One equation in one unknown, explicit or not.
    ("explicit", [[0]], {(0, 0)}, Tearing((), (), ((0, 0),))),
    ("implicit", [[0]], set(), Tearing((0,), (0,), ())),
    ("empty", [], set(), Tearing((), (), ())),
    # Not a block: x is wanted by y only, y = f(x), x = 1, and z occurs only in the last row: no tearing at all.
    ("causal", [[0, 1, 2], [0], [0, 1]], {(0, 2), (1, 0), (2, 1)}, Tearing((), (), ((1, 0), (2, 1), (0, 2)))),
]


@pytest.mark.parametrize(("rows", "solvable", "expected"), [r[1:] for r in TABLE], ids=[str(r[0]) for r in TABLE])
def test_table(rows: list[list[int]], solvable: Pairs, expected: Tearing) -> None:
    assert tear(Incidence.from_rows(rows, len(rows)), solvable) == expected


def check(incidence: Incidence, solvable: Pairs, result: Tearing) -> None:
    """The contract of `Tearing`."""
    n = incidence.n_rows
    assert sorted([*result.residual, *(r for r, _ in result.sequence)]) == list(range(n))
    assert sorted([*result.torn, *(c for _, c in result.sequence)]) == list(range(n))
    assert list(result.residual) == sorted(result.residual)
    known = set(result.torn)
    for row, column in result.sequence:
        assert (row, column) in solvable
        known.add(column)
        assert set(incidence.row(row).tolist()) <= known


@given(regular_graphs(), st.randoms(use_true_random=False))
def test_valid_on_random_blocks(system: tuple[Incidence, IntArray], chance: Random) -> None:
    graph, _ = system
    solvable = {pair for pair in sorted(everywhere(graph.rows())) if chance.random() < 0.6}
    weight = [chance.random() for _ in range(graph.n_columns)]
    check(graph, solvable, tear(graph, solvable))
    check(graph, solvable, tear(graph, solvable, weight))


@given(graphs())
def test_valid_even_without_a_matching(graph: Incidence) -> None:
    size = min(graph.n_rows, graph.n_columns)
    square = graph.restrict(range(size), range(size))
    result = tear(square, everywhere(square.rows()))
    check(square, everywhere(square.rows()), result)
    assert len(result.sequence) <= int((match(square) >= 0).sum())


@given(st.integers(1, 30), st.randoms(use_true_random=False))
def test_lower_triangle_in_disguise_is_hardly_torn(n: int, chance: Random) -> None:
    # x[i] = f(x[j] of some j < i): explicit. Fed back from the last unknown to the first row: tearing it is enough.
    order = list(range(n))
    chance.shuffle(order)
    rows = [[j for j in range(i + 1) if j >= i - 1 or chance.random() < 0.3] for i in range(n)]
    named = [[order[j] for j in row] for row in rows]
    diagonal = set(enumerate(order))
    explicit = tear(Incidence.from_rows(named, n), diagonal)
    assert explicit.torn == ()
    assert explicit.sequence == tuple(enumerate(order))
    if n > 1:
        named[0].append(order[-1])
        assert len(tear(Incidence.from_rows(named, n), diagonal).torn) == 1


def ladder(n: int) -> list[list[int]]:
    """Node voltages of a resistor ladder: row k balances the currents from k - 1, k, k + 1."""
    return [[j for j in (i - 1, i, i + 1) if 0 <= j < n] for i in range(n)]


def grid(m: int) -> list[list[int]]:
    """Node voltages of an m x m resistor grid, five-point stencil."""
    steps = ((0, 0), (-1, 0), (1, 0), (0, -1), (0, 1))
    return [
        [(i + a) * m + j + b for a, b in steps if 0 <= i + a < m and 0 <= j + b < m] for i in range(m) for j in range(m)
    ]


def linkage(joints: int) -> tuple[list[list[int]], Pairs]:
    """Accelerations (6), cut forces (6) and joint acceleration of a chain of bodies with revolute joints.

    Kinematics gives each acceleration outwards, Newton-Euler each cut force inwards, and the torque about the joint
    axis is given: three forces in a row that is solvable for none of them, as the axis may point anywhere.
    """
    rows: list[list[int]] = []
    solvable: Pairs = set()
    for i in range(joints):
        a, f = 13 * i, 13 * i + 6
        for k in range(6):
            half = range(k // 3 * 3, k // 3 * 3 + 3)
            inner = [a - 13 + j for j in (range(6) if k < 3 else half)] if i else []
            outer = [f + 13 + j for j in (half if k < 3 else range(6))] if i + 1 < joints else []
            solvable |= {(len(rows), a + k), (len(rows) + 1, f + k)}
            rows.append([a + k, 13 * i + 12, *inner])
            rows.append([f + k, *(a + j for j in half), *outer])
        rows.append([f + 3, f + 4, f + 5])
    return rows, solvable


@pytest.mark.parametrize(
    ("rows", "solvable", "torn"),
    [
        # Known voltages at nodes 0 and 1 give all others one by one; one of the two follows from the end.
        (ladder(100), everywhere(ladder(100)), 1),
        # The same from one edge of the grid inwards: m torn voltages.
        (grid(10), everywhere(grid(10)), 10),
        # The joint accelerations: inverse dynamics in the sequence, as many residuals as joints.
        (*linkage(1), 1),
        (*linkage(6), 6),
    ],
    ids=["ladder", "grid", "one joint", "six joints"],
)
def test_count_known_from_the_topology(rows: list[list[int]], solvable: Pairs, torn: int) -> None:
    incidence = Incidence.from_rows(rows, len(rows))
    result = tear(incidence, solvable)
    check(incidence, solvable, result)
    assert len(result.torn) == torn


def test_linkage_is_torn_at_its_joints() -> None:
    rows, solvable = linkage(4)
    assert sorted(tear(Incidence.from_rows(rows, len(rows)), solvable).torn) == [13 * i + 12 for i in range(4)]


def test_weight_decides_between_equals_and_overrides() -> None:
    # A ring is torn equally well anywhere; without weight at the lowest column.
    ring = Incidence.from_rows([[i, (i + 1) % 6] for i in range(6)], 6)
    assert tear(ring, everywhere(ring.rows())).torn == (0,)
    assert tear(ring, everywhere(ring.rows()), [0, 0, 0, 0.5, 0, 0]).torn == (3,)
    # In the ladder, node 1 (or 98) is the good place; a large weight forces the middle, which then is not enough.
    incidence = Incidence.from_rows(ladder(100), 100)
    forced = tear(incidence, everywhere(incidence.rows()), [1000.0 * (i == 50) for i in range(100)])
    assert forced.torn[0] == 50
    check(incidence, everywhere(incidence.rows()), forced)


def test_predicate_and_set_mean_the_same() -> None:
    rows, solvable = linkage(2)
    incidence = Incidence.from_rows(rows, len(rows))
    assert tear(incidence, lambda r, c: (r, c) in solvable) == tear(incidence, solvable)


def test_block_must_be_square() -> None:
    with fails_with(InternalError, "AC905", match="1 equations in 2 unknowns"):
        tear(Incidence.from_rows([[0, 1]], 2), set())


def test_large_block() -> None:
    # 5 000 unknowns in one loop with random chords and one balance over all unknowns.
    n = 5_000
    rows = [{i, (i + 1) % n, (i * 7919 + 13) % n} for i in range(n)]
    rows[0] = set(range(n))
    incidence = Incidence.from_rows(rows, n)
    result = tear(incidence, lambda r, c: True)
    check(incidence, everywhere(rows), result)
    assert len(result.torn) < n // 5
