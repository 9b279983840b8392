"""Index reduction: which equations must be differentiated, and how often.

Source: C. C. Pantelides, The consistent initialization of differential-algebraic systems, SIAM J. Sci. Stat. Comput.
9 (1988) 213-231, algorithms 3.1 and 3.2. It starts from a maximum matching, so that the search is needed only for the
equations that this leaves unmatched. It terminates if the graph in which a variable and its derivatives are one node
has a perfect matching (theorem 5.1 there); the caller checks that first.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

from acausal.structure.graph import Incidence


class Differentiable(Protocol):
    """Operations on the equations that the algorithm needs."""

    @property
    def derivative_of(self) -> Mapping[int, int]:
        """Maps variables to their derivatives, for those that have one so far."""
        ...

    def n_variables(self) -> int:
        """Number of variables so far."""
        ...

    def incidence(self, equation: int) -> Sequence[int]:
        """Unknowns of an equation, derivatives included."""
        ...

    def differentiate_variable(self, variable: int) -> int:
        """Create the derivative of a variable; return its number."""
        ...

    def differentiate_equation(self, equation: int) -> int:
        """Append the derivative of an equation, whose variables already have derivatives; return its number."""
        ...


def highest_derivatives(system: Differentiable, n_equations: int) -> Incidence:
    """The equations and their highest derivatives; columns are variables, and those with a derivative have no entry."""
    rows = ([v for v in system.incidence(e) if v not in system.derivative_of] for e in range(n_equations))
    return Incidence.from_rows(rows, system.n_variables())


def pantelides(system: Differentiable, first: Sequence[int]) -> tuple[dict[int, int], dict[int, int]]:
    """Differentiate until every equation is matched with a variable that has no derivative.

    `first` is a maximum matching of `highest_derivatives`: the variable of each equation, -1 for an unmatched one.

    Returns
    -------
    (assigned, derivative)
        `assigned[variable]` is the equation matched with each highest derivative; `derivative[equation]` is the
        equation that is its time derivative.
    """
    assigned = {v: e for e, v in enumerate(first) if v >= 0}
    derivative: dict[int, int] = {}
    for unmatched in [e for e, v in enumerate(first) if v < 0]:
        equation = unmatched
        while True:
            coloured_equations, coloured_variables = _augment(system, assigned, equation)
            if coloured_equations is None:
                break
            equation = _differentiate(system, assigned, derivative, coloured_equations, coloured_variables, equation)
    return {v: e for v, e in assigned.items() if v not in system.derivative_of}, derivative


def _augment(system: Differentiable, assigned: dict[int, int], equation: int) -> tuple[list[int] | None, list[int]]:
    """Match `equation` along an augmenting path; if there is none, return the (equations, variables) coloured by the
    search.
    """
    came_from: dict[int, int] = {}  # variable -> equation it was reached from
    queue = [equation]
    seen = {equation}
    while queue:
        here = queue.pop()
        for variable in system.incidence(here):
            if variable in came_from or variable in system.derivative_of:
                continue
            came_from[variable] = here
            other = assigned.get(variable)
            if other is None:
                _flip(assigned, came_from, variable, equation)
                return None, []
            if other not in seen:
                seen.add(other)
                queue.append(other)
    return sorted(seen), sorted(came_from)


def _flip(assigned: dict[int, int], came_from: dict[int, int], variable: int, root: int) -> None:
    """Exchange matched and unmatched edges along the augmenting path, from `variable` back to `root`."""
    previous = {assigned[v]: v for v in came_from if v in assigned}
    while True:
        equation = came_from[variable]
        assigned[variable] = equation
        if equation == root:
            return
        variable = previous[equation]


def _differentiate(
    system: Differentiable,
    assigned: dict[int, int],
    derivative: dict[int, int],
    equations: list[int],
    variables: list[int],
    current: int,
) -> int:
    """Differentiate the coloured equations and variables; return the derivative of the `current` equation."""
    derivative_of = {v: system.differentiate_variable(v) for v in variables}
    for e in equations:
        derivative[e] = system.differentiate_equation(e)
    for v, dv in derivative_of.items():
        assigned[dv] = derivative[assigned[v]]
    return derivative[current]
