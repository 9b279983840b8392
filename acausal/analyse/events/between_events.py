"""What conditions and values are between two events: true, false, constant, or varying (Modelica 3.6, section 3.8).

Discrete equations and conditions of `when` are evaluated at events only. A value that varies without an event,
`no_event(x > 0)` or x itself, would be that of some earlier instant, and a condition on it would act late or never.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import cached_property
from typing import NamedTuple

from acausal.analyse.blocks.solve import Solution
from acausal.analyse.events.jumping_tables import jumping_tables
from acausal.errors import DeclarationError
from acausal.flatten.pool import LEAVES, RELATIONS
from acausal.language.expressions.delay import Delayed

_AT_INSTANTS = frozenset(("initial", "after_reset", "infinitesimal", "terminal", "sample"))
_LOCATED = frozenset((*RELATIONS, "sign", "floor", "ceil"))


class _Node(NamedTuple):
    """`varies`: a part that varies between events, as a node; None if nothing does. `truth`: None if not known."""

    varies: int | None = None
    truth: bool | None = None


class BetweenEvents:
    """Tells what event nodes of a solution are between events. Relations are located, unless below a `no_event`."""

    def __init__(self, solution: Solution, discrete: frozenset[int]) -> None:
        reduced = self._reduced = solution.structure.reduced
        self._pool, self._discrete = reduced.pool, discrete
        self._algebraic, self._residuals = frozenset(solution.algebraic), solution.residuals
        self._definitions = dict(solution.definitions)
        # By (node, whether it is below a `no_event`).
        self._known: dict[tuple[int, bool], _Node] = {}
        self._seen: dict[int, bool] = {}
        self._variables: dict[int, _Node] = {}
        self._plain_of: dict[int, int] = {}
        # Once for all that will be asked: many conditions of a chain depend on all of its variables.
        roots = reduced.event_nodes
        behind = self._pool.variables_behind(roots, self._definitions) if roots else set()
        used = [(v, node) for v, node in solution.definitions if v in behind]
        below = self._pool.reachable([*roots, *(node for _, node in used)])
        self._tables = frozenset(jumping_tables(self._pool, below, self._definitions))
        for v, _ in used:
            self._variable(v)

    def holds(self, node: int) -> bool:
        """Whether a condition is true between events whatever the values, as `~initial() | c` is."""
        return self._of(node).truth is True

    def varying(self, node: int) -> int | None:
        """A part of a node that varies between events."""
        return self._of(node).varies

    def _of(self, root: int) -> _Node:
        for n in self._pool.reachable([root], self._seen):
            for exempt in (False, True):
                self._known[n, exempt] = self._made(n, exempt)
            self._seen[n] = True
        return self._known[root, False]

    def _variable(self, v: int) -> _Node:
        if v not in self._variables:
            self._variables[v] = _Node(self._definitions[v])  # varies, if its own past decides
            self._variables[v] = self._of(self._definitions[v])
        return self._variables[v]

    def _made(self, number: int, exempt: bool) -> _Node:
        op, *operands = self._pool.nodes[number]
        if op in LEAVES or isinstance(op, Delayed):
            return self._leaf(number, op, operands)
        if op in _AT_INSTANTS:
            return _Node(truth=False)
        if op == "pre":
            return _Node()
        if op == "noevent":
            return self._known[operands[0], True]
        parts = [self._known[n, exempt] for n in operands]
        varies = next((p.varies for p in parts if p.varies is not None), None)
        if op == "not":
            return _Node(varies, None if parts[0].truth is None else not parts[0].truth)
        if op in ("and", "or"):
            return self._logical(op, operands, exempt, varies)
        if op == "where" and parts[0].truth is not None:
            return parts[1 if parts[0].truth else 2]
        if op in RELATIONS and varies is None and self._plain(operands[0]) == self._plain(operands[1]):  # change(n)
            return _Node(truth=op in ("le", "ge"))
        if (op in _LOCATED or number in self._tables) and not exempt:
            return _Node()
        return _Node(number if varies is not None and exempt and op in _LOCATED else varies)

    def _leaf(self, number: int, op: str, operands: list[int]) -> _Node:
        if op == "const":
            return _Node(truth=bool(operands[0]))
        if op == "par":
            return _Node()
        if isinstance(op, Delayed):  # a signal that is constant between events jumps at events only, later
            return _Node(number if self._of(self._reduced.delays[op.number][0]).varies is not None else None)
        if op == "var" and operands[0] in self._discrete:
            return _Node()
        if op == "var" and operands[0] in self._definitions:
            return _Node(None if self._variable(operands[0]).varies is None else number)
        if op == "var" and operands[0] in self._algebraic and not self._moves:
            return _Node()
        return _Node(number)

    @cached_property
    def _moves(self) -> bool:
        """Whether the equations of the algebraic variables contain anything that varies by itself."""
        pool = self._pool
        behind = pool.variables_behind(self._residuals, self._definitions)
        given = behind - self._algebraic - self._definitions.keys() - self._discrete
        roots = [*self._residuals, *(self._definitions[v] for v in behind if v in self._definitions)]
        return bool(given) or any(pool.nodes[n][0] == "time" for n in pool.reachable(roots))

    def _logical(self, op: str, operands: list[int], exempt: bool, varies: int | None) -> _Node:
        decisive = op == "or"  # the truth of one operand that decides
        known = [self._known[n, exempt].truth for n in operands]
        if decisive in known:
            return _Node(truth=decisive)
        if None not in known:
            return _Node(truth=not decisive)
        # c & ~pre(c), an edge
        terms = [self._plain(n) for n in self._terms(op, operands)]
        if any(self._pool.make("not", n) in terms for n in terms):
            return _Node(truth=decisive)
        return _Node(varies)

    def _terms(self, op: str, operands: Iterable[int]) -> Iterable[int]:
        for n in operands:
            own, *below = self._pool.nodes[n]
            if own == op:
                yield from self._terms(op, below)
            else:
                yield n

    def _plain(self, root: int) -> int:
        """A node with each `pre` of what is constant between events replaced by its operand, which it equals there."""
        pool, done = self._pool, self._plain_of
        for n in pool.reachable([root], done):
            op, *operands = pool.nodes[n]
            if op in LEAVES or isinstance(op, Delayed) or not operands:
                done[n] = n
            elif op == "pre" and self._known[operands[0], False].varies is None:
                done[n] = done[operands[0]]
            else:
                image = [done[k] for k in operands]
                done[n] = n if image == operands else pool.make(op, *image)
        return done[root]


def checked_between_events(solution: Solution, discrete: frozenset[int]) -> BetweenEvents:
    """What tells how nodes vary between events, once no discrete equation and no condition of a `when` does.

    Raises DeclarationError: AC146.
    """
    reduced, between = solution.structure.reduced, BetweenEvents(solution, discrete)
    for equation, node in zip(reduced.flat.assignments, reduced.assignments, strict=True):
        part = between.varying(node)
        if part is not None:
            name = reduced.flat.scalar_name(equation.scalar)
            raise DeclarationError(
                "AC146",
                f"{name} is discrete, but its value varies between events",
                where=(equation.origin.span(),) if equation.origin else (),
                evidence=[str(equation.source), f"{reduced.text(part)} varies without an event"],
                cause="a discrete equation is evaluated at events only, so that it would keep an earlier value",
                help=f"declare {name.rpartition('.')[2]} with variable(), or say when it takes the value: reset it in "
                "a `when`, or write where(sample(0, 0.1), value, pre(variable))",
            )
    for when, nodes in zip(reduced.flat.whens, reduced.whens, strict=True):
        part = next((p for p in map(between.varying, nodes.guards) if p is not None), None)
        if part is not None:
            raise DeclarationError(
                "AC146",
                f"{reduced.text(part)} makes no event, so that a `when` on it would act late or never",
                where=(when.origin.span(),) if when.origin else (),
                evidence=[str(when.source)],
                help="remove no_event; or join it to an instant, edge(x > 0) & no_event(y > 0)",
            )
    return between
