"""Equations that switch constraints on and off: what has to be solved for what depends on the mode.

`where(taut, x**2 + y**2 - 1, lam) == 0` holds a force when the string is slack, and positions when it is taut: two
states fewer, two more differentiations, and velocities that jump when it becomes taut. One structure is found for all
modes here, so that such an equation has no unknown to be solved for in one of them.

This is refused where it can be seen from the structure: in the mode of one branch, together with the branches it is
nested in, the equations of a block cannot be matched with its unknowns, whatever all other modes are. Modelica tools
have the same limit; what lifts it is a structural analysis for each mode (Benveniste, Caillaud, Malandain, "The
mathematical foundations of physical systems modeling languages", Annual Reviews in Control 50 (2020) 72-118).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Iterator, Mapping, Sequence

from acausal.diagnose.words import line, listed, places
from acausal.errors import StructureError
from acausal.flatten.pool import LEAVES, Pool, closure
from acausal.flatten.reduced import ReducedSystem
from acausal.flatten.terms import SUMS
from acausal.structure import Block, Incidence, match, stays_matched
from acausal.structure.graph import IntArray

_MOST_BRANCHES = 1000  # of one block that are looked at
_OPPOSITE = {"lt": "ge", "le": "gt"}
_AT_ONCE = frozenset(("initial", "infinitesimal", "terminal"))  # modes of an instant
Modes = Mapping[int, bool]
"""Conditions that are decided: node -> whether it holds."""


def refuse_changing_structure(
    reduced: ReducedSystem, residuals: Sequence[int], blocks: Sequence[Block], sources: Sequence[int]
) -> None:
    """Refuse blocks that cannot be solved in one of their modes.

    Raises StructureError: AC213, with the equation and the condition.

    `residuals`, `blocks`: Nodes that must be zero, and which of them are solved for which variables.
    `sources`: The flat equation that each residual comes from.
    """
    pool = reduced.pool
    switched = _switched(pool, residuals)
    if not switched:
        return
    for block in blocks:
        rows = [residuals[r] for r in block.rows]
        place = {v: k for k, v in enumerate(block.columns)}

        def columns(held: Collection[int], place: dict[int, int] = place) -> list[int]:
            return sorted(place[v] for v in held if v in place)

        if not switched.intersection(rows) or (_matched([columns(_always(pool, row)) for row in rows]) >= 0).all():
            continue
        usual = [columns(pool.variables_in(row)) for row in rows]
        matched = _matched(usual).tolist()
        held = [_conditions(pool, row) for row in rows]
        for modes in _branches(pool, rows, set(block.columns)):
            touched = [k for k, own in enumerate(held) if not own.isdisjoint(modes)]
            changed = {k: columns(pool.variables_in(_in_modes(pool, rows[k], modes))) for k in touched}
            if not stays_matched(usual, matched, changed):
                lost = max(touched, key=lambda k: len(usual[k]) - len(changed[k]))
                raise _refusal(reduced, sources[block.rows[lost]], block, modes)


def _matched(rows: Sequence[Sequence[int]]) -> IntArray:
    return match(Incidence.from_rows(rows, len(rows)))


def _conditions(pool: Pool, root: int) -> set[int]:
    """The conditions of all branches below a node."""
    nodes = (pool.nodes[n] for n in pool.reachable([root]))
    return {_plain(pool, node[1], True)[0] for node in nodes if node[0] == "where"}


def _switched(pool: Pool, residuals: Sequence[int]) -> set[int]:
    """Those residuals that hold a branch."""
    holds: set[int] = set()
    for number in pool.reachable(residuals):
        op, *operands = pool.nodes[number]
        if op == "where" or (op not in LEAVES and not holds.isdisjoint(operands)):
            holds.add(number)
    return holds.intersection(residuals)


def _branches(pool: Pool, rows: Sequence[int], unknowns: set[int]) -> Iterator[Modes]:
    """The modes of each branch, with those of the branches that it is nested in."""
    seen: set[frozenset[tuple[int, bool]]] = set()
    todo: deque[tuple[int, dict[int, bool]]] = deque((row, {}) for row in rows)
    while todo and len(seen) < _MOST_BRANCHES:
        root, modes = todo.popleft()
        for number in _wheres(pool, root, modes):
            _, condition, *both = pool.nodes[number]
            known, holds = _plain(pool, condition, True)
            concerns = pool.variables_in(*both) & unknowns or pool.zero in both
            if not concerns or _is_settled(pool, known):
                continue
            for node, is_true in zip(both, (holds, not holds), strict=True):
                own = {**modes, known: is_true}
                key = frozenset(own.items())
                if key not in seen:
                    seen.add(key)
                    yield own
                    todo.append((node, own))


def _is_settled(pool: Pool, condition: int) -> bool:
    """Whether a condition is none of the run: it depends on parameters only, or is true at single instants."""
    below = pool.reachable([condition])
    return pool.is_constant(condition) or any(pool.nodes[n][0] in _AT_ONCE for n in below)


def _plain(pool: Pool, condition: int, holds: bool) -> tuple[int, bool]:
    """A condition without `not` and `noevent`, `<` for `>=`: the same for a mode and its opposite."""
    while pool.nodes[condition][0] in ("not", "noevent"):
        holds ^= pool.nodes[condition][0] == "not"
        condition = pool.nodes[condition][1]
    op, *operands = pool.nodes[condition]
    if op in _OPPOSITE:
        condition, holds = pool.make(_OPPOSITE[op], *operands), not holds
    return condition, holds


def _always(pool: Pool, root: int) -> set[int]:
    """Variables that a node depends on whatever the modes are: not below a branch, nor with such a factor."""
    inside: list[int] = []

    def outside(number: int) -> Sequence[int]:
        op, *operands = pool.nodes[number]
        if op == "where" or (op in ("mul", "div") and any(_is_switched(pool, n) for n in operands)):
            inside.append(number)
            return ()
        return () if op in LEAVES else operands

    found = {pool.nodes[n][1] for n in closure([root], outside) if pool.nodes[n][0] == "var"}
    return found - pool.variables_in(*inside)


def _is_switched(pool: Pool, number: int) -> bool:
    while pool.nodes[number][0] in ("neg", "noevent"):
        number = pool.nodes[number][1]
    return bool(pool.nodes[number][0] == "where")


def _in_modes(pool: Pool, root: int, modes: Modes) -> int:
    """A node with the branches that are meant, as far as that is decided, and without what then cancels."""
    done: dict[int, int] = {}
    for number in pool.reachable([root]):
        op, *operands = pool.nodes[number]
        if op in LEAVES:
            done[number] = number
            continue
        chosen = _chosen(pool, operands, modes) if op == "where" else None
        image = done[chosen] if chosen is not None else pool.make(op, *[done[n] for n in operands])
        done[number] = pool.collected(image) if op in SUMS else image
    return done[root]


def _chosen(pool: Pool, operands: Sequence[int], modes: Modes) -> int | None:
    """The branch that is meant; None where its condition is not decided."""
    known, holds = _plain(pool, operands[0], True)
    return operands[1 if modes[known] == holds else 2] if known in modes else None


def _wheres(pool: Pool, root: int, modes: Modes) -> list[int]:
    """The outermost branches whose condition is not decided."""
    found = []

    def decided(number: int) -> Sequence[int]:
        op, *operands = pool.nodes[number]
        if op != "where":
            return () if op in LEAVES else operands
        chosen = _chosen(pool, operands, modes)
        if chosen is None:
            found.append(number)
        return () if chosen is None else (chosen,)

    closure([root], decided)
    return sorted(found)


def _worded(pool: Pool, condition: int, holds: bool) -> tuple[int, bool]:
    """A relation that does not hold, as the opposite that does."""
    op, *operands = pool.nodes[condition]
    opposite = next((other for other, own in _OPPOSITE.items() if own == op), None)
    return (condition, holds) if holds or opposite is None else (pool.make(opposite, *operands), True)


def _refusal(reduced: ReducedSystem, source: int, block: Block, modes: Modes) -> StructureError:
    flat, pool = reduced.flat, reduced.pool
    equation = flat.equations[source]

    shown = dict(_worded(pool, n, holds) for n, holds in modes.items())
    texts = [f"`{reduced.text(n)}`{'' if holds else ' is false'}" for n, holds in shown.items()]
    when = " and ".join(texts)
    names = listed((reduced.name(v) for v in block.columns), 3)
    return StructureError(
        "AC213",
        f"{flat.name}: the structure depends on the mode: where {when}, nothing determines {names}",
        where=places(flat, [equation]),
        evidence=[
            line(flat, equation),
            f"in one mode it is an equation for {names}, in the other a constraint on what is known by then",
        ],
        cause="a constraint is switched on and off: states would come and go, and impulses come with it",
        help="give it a force: a stiff spring and damper, where(r > l, c*(r - l) + d*der(r), 0); or hold accelerations "
        "instead, and let a `when` make the velocities jump, reset(velocity, 0, by=force); or make a model for each",
    )
