"""Choice of states where known rates hide the coordinates: quasi-velocities, as the angular velocity of a frame."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from acausal.structure import Block, select_dummies

# A wheel on a slope: position q, rate w with der(q) = g(q, w) given by other equations, and the constraint c(q) = 0,
# whose derivatives are written in w alone: c' = J w, c'' = J der(w) + ...
Q0, Q1, W0, W1, DQ0, DQ1, DW0, DW1 = range(8)
C, C1, C2 = range(3)
VARIABLE_INTEGRAL = {DQ0: Q0, DQ1: Q1, DW0: W0, DW1: W1}
EQUATION_INTEGRAL = {C1: C, C2: C1}


def sampled(
    entry: dict[tuple[int, int], float], equations: Sequence[int], variables: Sequence[int]
) -> list[dict[int, NDArray[np.float64]]]:
    """The same sparse rows at two points."""
    return [{v: np.full(2, entry[e, v]) for v in variables if (e, v) in entry} for e in equations]


def jacobian(equations: Sequence[int], variables: Sequence[int]) -> list[dict[int, NDArray[np.float64]]]:
    """Only c depends on q, only c' on w; the second coordinate is the better one to give up."""
    entry = {(C, Q0): 0.1, (C, Q1): 1.0, (C1, W0): 1.0, (C1, W1): 0.1, (C2, DW0): 1.0, (C2, DW1): 0.1}
    return sampled(entry, equations, variables)


def hidden(equation: int) -> list[int]:
    return {C1: [DQ0, DQ1]}.get(equation, [])


def test_hidden_coordinates_become_candidates_at_the_constraint_itself() -> None:
    blocks = [Block((C2,), (DW0, DW1))]
    choices = select_dummies(blocks, EQUATION_INTEGRAL, VARIABLE_INTEGRAL, jacobian, lambda v: 1.0, hidden)
    assert [c.dummies for c in choices] == [(DW0,), (DQ1,)]
    assert not any(c.deficient for c in choices)


def test_without_them_the_constraint_looks_dependent() -> None:
    blocks = [Block((C2,), (DW0, DW1))]
    choices = select_dummies(blocks, EQUATION_INTEGRAL, VARIABLE_INTEGRAL, jacobian, lambda v: 1.0)
    assert choices[-1].deficient == (C1,)


def test_groups_are_joined_where_the_coordinate_was_chosen_elsewhere() -> None:
    """The rate u of q is a dummy of another block: both choices at the level below are made together.

    Variables 8 = u (the derivative of 10 = q) and 9 = der(u); equation 3 is 4 differentiated, and links u with w.
    """
    u, du, q = 8, 9, 10
    variable_integral = {DW0: W0, du: u, u: q}
    equation_integral = {C2: C1, C1: C, 3: 4}
    entry = {(C1, W0): 1.0, (4, u): 1.0, (4, W0): -1.0, (C, q): 1.0}

    def both(equations: Sequence[int], variables: Sequence[int]) -> list[dict[int, NDArray[np.float64]]]:
        return sampled(entry, equations, variables)

    blocks = [Block((C2,), (DW0,)), Block((3,), (du,))]
    choices = select_dummies(
        blocks, equation_integral, variable_integral, both, lambda v: 1.0, lambda e: [u] if e == C1 else []
    )
    assert [c.dummies for c in choices] == [(DW0,), (du,), (u,)]
    assert not any(c.deficient for c in choices)
