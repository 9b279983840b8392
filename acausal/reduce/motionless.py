"""Constants of motion: states that provably stay at their start, relations that never switch, and their consequences.

A body that is guided along one axis has eleven other states in three dimensions; they start at rest and nothing moves
them. This is proved by assuming it: all states are first assumed to be constant, and every expression is evaluated
under that assumption. If the rate of a state is not exactly zero, the assumption is withdrawn for this state and for
everything that depends on it. The remaining assumptions are consistent: their values satisfy the equations, whatever
the other variables do, and are therefore the solution. Relations are decided in the same pass, by bounds of their two
sides, because bodies often stay in a plane only as long as some contact cannot occur.

Parameters remain symbols, so that the results hold for all their values within the declared limits.

Source: M. N. Wegman, F. K. Zadeck, Constant propagation with conditional branches, ACM TOPLAS 13 (1991) 181-210.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from acausal.analyse.blocks.elimination import safety
from acausal.analyse.blocks.solve import Solution
from acausal.analyse.start import start_problem
from acausal.flatten.flat import FlatSystem
from acausal.flatten.pool import LEAVES, RELATIONS
from acausal.numeric.intervals import EVERYTHING, Interval, decided, interval, partial

_KINKS = frozenset(("min", "max", "fabs"))
# Bounds of a node that may have no value, such as the root of a negative number: they decide nothing, as nan does.
_NO_VALUE: Interval = (math.nan, math.nan)


@dataclass(frozen=True)
class Constants:
    """Everything that does not change during a run."""

    # Variable -> node of parameters only that it always equals; states among them stay at their start.
    variables: Mapping[int, int]
    equal: Mapping[int, int]  # constant expression -> node of parameters only
    branches: Mapping[int, int]  # branch or kink that always equals the same operand -> the operand
    relations: Mapping[int, bool]  # relation of variables that never switches -> whether it holds


def constants(solution: Solution) -> Constants:
    """States, variables and relations that provably never change."""
    return _Propagation(solution).run()


def bounds(solution: Solution, nodes: Sequence[int]) -> list[Interval]:
    """Bounds of nodes in all possible runs, one per node."""
    propagation = _Propagation(solution)
    propagation.run()
    for node in nodes:
        propagation.visit(node)
    return [EVERYTHING if math.isnan(propagation.bounds[node][0]) else propagation.bounds[node] for node in nodes]


class _Propagation:
    def __init__(self, solution: Solution) -> None:
        reduced = solution.structure.reduced
        self.solution = solution
        self.pool = reduced.pool
        self.points = solution.structure.points
        self.limits = _parameter_limits(reduced.flat)
        self.definition = dict(solution.definitions)
        self.known = _resting(solution)  # variable -> node it is taken to equal
        self.equal: dict[int, int] = {}  # node -> node of parameters that it equals
        self.taken: dict[int, int] = {}  # branch or kink -> the one operand it always equals
        self.bounds: dict[int, Interval] = {}
        self.relations: dict[int, bool] = {}
        roots = [n for _, n in solution.definitions] + list(solution.residuals)
        roots += reduced.event_nodes
        self.roots = [*roots, *reduced.image, *(reduced.pool.var(self.rate(x)) for x in self.known)]
        self.users: dict[int, list[int]] = {}
        self.order: list[int] = []  # nodes in the order of their evaluation
        self.definitions_of: dict[int, list[int]] = {}
        for variable, node in solution.definitions:
            self.definitions_of.setdefault(node, []).append(variable)

    def rate(self, state: int) -> int:
        return self.solution.structure.derivative(state)

    def run(self) -> Constants:
        self.first_pass()
        states = [x for x in self.solution.structure.states if x in self.known]
        while True:
            moving = [x for x in states if self.known.get(self.rate(x)) != self.pool.zero]
            if moving:
                states = [x for x in states if x not in set(moving)]
                self.lower_variables(moving)
                continue
            unproved_decisions = self.unproved()
            if not unproved_decisions:
                break
            self.lower_nodes(unproved_decisions)
        equal = {n: k for n, k in self.equal.items() if n != k}
        return Constants(
            dict(self.known), equal, dict(self.taken), {n: v for n, v in self.relations.items() if self.varies(n)}
        )

    def varies(self, relation: int) -> bool:
        """Whether a side of a decided relation varies."""
        return any(a not in self.equal for a in self.pool.nodes[relation][1:])

    def first_pass(self) -> None:
        """Evaluate everything under the assumption that no state moves, in evaluation order."""
        for variable, node in self.solution.definitions:
            self.visit(node)
            if node in self.equal:
                self.known[variable] = self.equal[node]
        for root in self.roots:
            self.visit(root)

    def visit(self, root: int) -> None:
        """Evaluate those nodes below a root that have not been evaluated yet."""
        nodes = self.pool.nodes
        for here in self.pool.reachable([root], self.bounds):
            node = nodes[here]
            for c in () if node[0] in LEAVES else node[1:]:
                self.users.setdefault(c, []).append(here)
            self.order.append(here)
            self.evaluate(here)

    def evaluate(self, number: int) -> None:
        """Determine the value and the bounds of a node whose operands have been evaluated."""
        equal = self.value(number)
        if equal is not None:
            self.equal[number] = equal
        else:
            self.equal.pop(number, None)
        self.bounds[number] = self.bound(number)

    def value(self, number: int) -> int | None:
        """Node of parameters that a node equals; None if it varies."""
        pool = self.pool
        node = pool.nodes[number]
        op = node[0]
        self.taken.pop(number, None)
        if op in ("const", "par"):
            return number
        if op == "var":
            return self.known.get(node[1])
        args = node[1:]
        if op in LEAVES or op == "sample" or not args:
            return None  # time, and operations that distinguish the first instant of a run from others
        equal_operands = [self.equal.get(a) for a in args]
        if op == "div" and equal_operands[0] == pool.zero and safety(self.points, args[1]) is not None:
            return pool.zero
        assumed = None if None in equal_operands else pool.make(op, *[f for f in equal_operands if f is not None])
        if op in RELATIONS and (assumed is None or pool.value(assumed) is None):
            assumed = self.decide(number, assumed)
        if assumed is not None or op in RELATIONS:
            return assumed
        zero = pool.zero
        if op == "mul" and zero in equal_operands:
            return zero
        if op == "and" and zero in equal_operands:
            return zero
        if op == "or" and pool.one in equal_operands:
            return pool.one
        chosen = self.branch(op, args, equal_operands)
        if chosen is None:
            return None
        self.taken[number] = chosen
        return self.equal.get(chosen)

    def branch(self, op: str, args: tuple[int, ...], equal_operands: list[int | None]) -> int | None:
        """The operand that a branch or a kink always equals."""
        pool = self.pool
        if op == "where":
            condition = pool.value(equal_operands[0]) if equal_operands[0] is not None else None
            if condition is not None:
                return args[1] if condition else args[2]
            return args[1] if equal_operands[1] is not None and equal_operands[1] == equal_operands[2] else None
        if op in ("min", "max"):
            a, b = (self.bounds[x] for x in args)
            if a[0] >= b[1]:
                return args[0] if op == "max" else args[1]
            if b[0] >= a[1]:
                return args[1] if op == "max" else args[0]
        if op == "fabs" and self.bounds[args[0]][0] >= 0.0:
            return args[0]
        return None

    def decide(self, number: int, otherwise: int | None) -> int | None:
        """The value of a relation by the bounds of its sides; `otherwise` if they do not decide it."""
        op, a, b = self.pool.nodes[number]
        holds = decided(op, self.bounds[a], self.bounds[b])
        if holds is None:
            self.relations.pop(number, None)
            return otherwise
        self.relations[number] = holds
        return self.pool.one if holds else self.pool.zero

    def bound(self, number: int) -> Interval:
        pool = self.pool
        equal = self.equal.get(number)
        if equal is not None and equal != number:
            return self.parameter_bounds(equal)
        op, *args = pool.nodes[number]
        if op == "const":
            return (args[0], args[0])
        if op == "par":
            return self.limits[args[0]] if args[0] < len(self.limits) else EVERYTHING
        if op == "var":
            node = self.definition.get(args[0])
            return self.bounds.get(node, EVERYTHING) if node is not None else EVERYTHING
        if not args:
            return EVERYTHING
        if number in self.taken:
            return self.bounds.get(self.taken[number], EVERYTHING)
        operands = [self.bounds[a] for a in args]
        if partial(op, operands) or any(math.isnan(low) for low, _ in operands):
            return _NO_VALUE
        return interval(op, args, operands)

    def parameter_bounds(self, node: int) -> Interval:
        """Bounds of a node of parameters, which may be new."""
        for n in self.pool.reachable([node]):
            if n not in self.bounds:
                self.equal[n] = n
                self.bounds[n] = self.bound(n)
        return self.bounds[node]

    def lower_variables(self, variables: Iterable[int]) -> None:
        """Withdraw the assumption that these variables are constant."""
        changed = []
        for v in variables:
            self.known.pop(v, None)
            changed.append(self.pool.var(v))
        self.lower_nodes(changed)

    def lower_nodes(self, nodes: Iterable[int]) -> None:
        """Evaluate nodes again, and everything that depends on them."""
        stack = list(nodes)
        while stack:
            number = stack.pop()
            before = self.equal.get(number), self.taken.get(number)
            self.evaluate(number)
            if (self.equal.get(number), self.taken.get(number)) == before:
                continue
            stack += self.users.get(number, ())
            for variable in self.definitions_of.get(number, ()):
                if self.known.get(variable) is not None and number not in self.equal:
                    del self.known[variable]
                    stack.append(self.pool.var(variable))

    def unproved(self) -> list[int]:
        """Compute all bounds anew; return the decisions by bounds that these no longer support."""
        for number in self.order:
            self.bounds[number] = self.bound(number)
        unsupported = []
        for number in list(self.bounds):
            op, *args = self.pool.nodes[number]
            if op in RELATIONS and number in self.relations:
                a, b = args
                if decided(op, self.bounds[a], self.bounds[b]) != self.relations[number]:
                    unsupported.append(number)
            elif op in _KINKS and number in self.taken:
                chosen = self.branch(op, tuple(args), [self.equal.get(a) for a in args])
                if chosen != self.taken[number]:
                    unsupported.append(number)
        return unsupported


def _parameter_limits(flat: FlatSystem) -> list[Interval]:
    """Interval of the values that a run accepts for each free parameter scalar, by its declared limits."""
    limits = [EVERYTHING] * len(flat.parameter_values)
    for parameter in flat.parameters:
        if parameter.free:
            for op, *number in (flat.pool.nodes[n] for n in parameter.nodes):
                if op == "par":
                    limits[number[0]] = (parameter.declaration.min, parameter.declaration.max)
    return limits


def _resting(solution: Solution) -> dict[int, int]:
    """Maps states that may stay at their start to the node of the start; without those that an event sets."""
    structure = solution.structure
    reduced = structure.reduced
    start = start_problem(solution)
    resting = dict(start.direct)
    for x in start.defaulted:
        resting[x] = start.guesses.get(x, reduced.pool.zero)
    stabilised = reduced.pool.variables_in(*(node for _, node in structure.invariants))
    for scalar in (s for when in reduced.flat.whens for s, _ in when.actions):
        stabilised |= reduced.pool.variables_in(reduced.image[scalar])
    for assignment in reduced.flat.assignments:
        stabilised |= reduced.pool.variables_in(reduced.image[assignment.scalar])
    return {x: node for x, node in resting.items() if x not in stabilised}
