"""The start problem: conditions that hold at the start, and the states that they leave undetermined."""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass

from acausal.analyse.blocks.solve import Solution
from acausal.errors import Span
from acausal.flatten.flat import FlatStart, span_of
from acausal.flatten.reduced import ReducedSystem
from acausal.structure import Incidence, match
from acausal.structure.graph import IntArray


@dataclass(frozen=True)
class Condition:
    """A node that must be zero at the start, with its text and its place in the source."""

    node: int
    text: str
    where: tuple[Span, ...]
    scalar: int | None = None
    """The flat scalar whose declared start this is; None for an equation."""


@dataclass(frozen=True, eq=False)
class StartProblem:
    """Explicit start values, and conditions for the other states."""

    direct: dict[int, int]  # states with explicit start values: variable -> node of parameters
    # Other conditions, solved for the remaining states together with the algebraic variables.
    conditions: tuple[Condition, ...]
    # Redundant conditions, for which no state is left; the solution must satisfy them.
    surplus: tuple[Condition, ...]
    defaulted: tuple[int, ...]  # undetermined states, which start at their guesses; a note reports them
    guesses: dict[int, int]  # variable (state or algebraic) -> node of parameters where its iteration starts


def start_problem(solution: Solution) -> StartProblem:
    """Assign the declared starts and initial equations to the states they determine."""
    reduced = solution.structure.reduced
    states = solution.structure.states
    state_set = set(states)
    direct: dict[int, int] = {}
    given: list[Condition] = []
    guesses = _guesses(reduced)
    for scalar, start in reduced.flat.starts.items():
        if not start.is_fixed:
            continue
        variable, value = _variable_and_value(reduced, scalar, start)
        if variable is not None:
            guesses[variable] = value
        if variable in state_set and variable not in direct:
            direct[variable] = value
        else:
            given.append(_condition(reduced, scalar, start))
    for e, node in solution.structure.invariants:
        source = reduced.flat.equations[solution.structure.flat_equation(e)]
        given.append(Condition(node, _derivative_text(solution, e, reduced.flat.text(source)), span_of(source)))
    for equation, node in zip(reduced.flat.initial_equations, reduced.initial, strict=True):
        given.append(Condition(node, reduced.flat.text(equation), span_of(equation)))
    open_states = [x for x in states if x not in direct]
    used, surplus, defaulted = _assign(solution, given, open_states, guesses)
    return StartProblem(direct, tuple(used), tuple(surplus), tuple(defaulted), guesses)


def _guesses(reduced: ReducedSystem) -> dict[int, int]:
    """Declared guesses; if a variable has several, that of the outermost alias, then the first in the alphabet."""
    guesses: dict[int, int] = {}
    declared = [s for s, start in reduced.flat.starts.items() if not start.is_fixed]
    names = {s: reduced.flat.scalar_name(s) for s in declared}
    for scalar in sorted(declared, key=lambda s: (names[s].count("."), names[s])):
        variable, value = _variable_and_value(reduced, scalar, reduced.flat.starts[scalar])
        if variable is not None:
            guesses.setdefault(variable, value)
    return guesses


def _derivative_text(solution: Solution, equation: int, text: str) -> str:
    """Text of a constraint, or of its first or second derivative: `d/dt (x ** 2 + y ** 2 == 1)`."""
    times = 0
    while equation in solution.structure.integral:
        equation, times = solution.structure.integral[equation], times + 1
    order = f"{times}" * (times > 1)
    return f"d{order}/dt{order} ({text})" if times else text


def _variable_and_value(reduced: ReducedSystem, scalar: int, start: FlatStart) -> tuple[int | None, int]:
    """(Variable of a declared start, node of its value); None for an eliminated scalar."""
    pool = reduced.pool
    value = imported(reduced, start.node)
    op, *rest = pool.nodes[reduced.image[scalar]]
    if op == "var":
        return rest[0], value
    if op == "neg" and pool.nodes[rest[0]][0] == "var":
        return pool.nodes[rest[0]][1], pool.neg(value)
    return None, value


def imported(reduced: ReducedSystem, node: int) -> int:
    """Copy a node of parameters from the flat pool to the reduced one."""
    old, new = reduced.flat.pool, reduced.pool
    done: dict[int, int] = {}
    for number in old.reachable([node]):
        entry = old.nodes[number]
        done[number] = (
            new.intern(entry)
            if entry[0] in ("const", "par", "time")
            else new.make(entry[0], *[done[c] for c in entry[1:]])
        )
    return done[node]


def _condition(reduced: ReducedSystem, scalar: int, start: FlatStart) -> Condition:
    node = reduced.pool.sub(reduced.image[scalar], imported(reduced, start.node))
    name = reduced.flat.scalar_name(scalar)
    where = (start.origin.span(),) if start.origin is not None else ()
    return Condition(node, name, where, scalar)


def _assign(
    solution: Solution, given: list[Condition], open_states: list[int], guesses: dict[int, int]
) -> tuple[list[Condition], list[Condition], list[int]]:
    """Match conditions with open states, those without a declared guess first: (used, surplus, defaulted)."""
    if not given and not open_states:
        return [], [], []
    dependence = Dependence(solution)
    rows = [sorted(dependence.of(c.node)) for c in given] + [sorted(dependence.of(r)) for r in solution.residuals]
    order = list(solution.algebraic) + sorted(open_states, key=lambda x: x in guesses)
    fewest = max(len(solution.algebraic) + sum(x not in guesses for x in open_states), min(len(rows), len(order)))

    def matching(count: int) -> IntArray:
        column_of = {v: k for k, v in enumerate(order[:count])}
        return match(Incidence.from_rows([[column_of[v] for v in row if v in column_of] for row in rows], count))

    # bisection: if the first `count` variables suffice for all rows, more do too
    count = len(order)
    if (matching(count) >= 0).all():
        count = bisect_left(range(len(order)), True, fewest, key=lambda k: bool((matching(k) >= 0).all()))
    matched = matching(count)
    determined = {order[int(c)] for c in matched if c >= 0}
    used = [c for c, m in zip(given, matched, strict=False) if m >= 0]
    surplus = [c for c, m in zip(given, matched, strict=False) if m < 0]
    if surplus and not (matched[len(given) :] < 0).any():
        used = [c for c in given if c not in surplus]
    return used, surplus, [x for x in open_states if x not in determined]


class Dependence:
    """Dependence of nodes on states, inputs and algebraic variables, through the definitions."""

    def __init__(self, solution: Solution) -> None:
        self.pool = solution.structure.reduced.pool
        self.inputs = solution.structure.reduced.inputs
        self.definition = dict(solution.definitions)

    def nodes_behind(self, node: int) -> list[int]:
        """All nodes that a node depends on, definitions included, in evaluation order."""
        variables = self.pool.variables_behind([node], self.definition)
        return self.pool.reachable([node, *(self.definition[v] for v in variables if v in self.definition)])

    def of(self, node: int) -> set[int]:
        """Undefined variables (states, inputs, algebraic) that a node depends on."""
        return self.pool.variables_behind([node], self.definition) - self.definition.keys()
