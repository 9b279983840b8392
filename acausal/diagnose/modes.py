"""Equations that switch constraints on and off, so that the structure of the system depends on the mode.

`where(taut, x**2 + y**2 - 1, lam) == 0` contains a force while the string is slack, and positions while it is taut:
there are two states fewer then, two equations have to be differentiated more, and velocities jump when the string
becomes taut. One structure is determined here for all modes, in which such an equation has no unknown in one of them.

This is refused if the structure shows it: in the mode of one branch, together with the branches around it, the
equations of a block cannot be matched with its unknowns, whatever the other modes are. Modelica tools have the same
limit; removing it takes a structural analysis for each mode (Benveniste, Caillaud, Malandain, "The mathematical
foundations of physical systems modeling languages", Annual Reviews in Control 50 (2020) 72-118).
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

_MOST_BRANCHES_CHECKED = 1000  # per block
_OPPOSITE = {"lt": "ge", "le": "gt"}
_AT_INSTANTS = frozenset(("initial", "after_reset", "infinitesimal", "terminal"))  # modes of an instant
Modes = Mapping[int, bool]
"""Conditions that are decided: node -> whether it holds."""


def refuse_changing_structure(
    reduced: ReducedSystem, residuals: Sequence[int], blocks: Sequence[Block], sources: Sequence[int]
) -> None:
    """Refuse blocks that cannot be solved in one of their modes.

    Raises StructureError: AC213, with the equation and the condition.

    `residuals` are nodes that must be zero, `blocks` the rows of these and the variables that they determine, `sources`
    the flat equation of each residual.
    """
    pool = reduced.pool
    switched = _switched(pool, residuals)
    if not switched:
        return
    for block in blocks:
        rows = [residuals[r] for r in block.rows]
        column_of = {v: k for k, v in enumerate(block.columns)}

        def columns(variables: Collection[int], column_of: dict[int, int] = column_of) -> list[int]:
            return sorted(column_of[v] for v in variables if v in column_of)

        if not switched.intersection(rows) or (_matched([columns(_always(pool, row)) for row in rows]) >= 0).all():
            continue
        usual_columns = [columns(pool.variables_in(row)) for row in rows]
        matched = _matched(usual_columns).tolist()
        conditions = [_conditions(pool, row) for row in rows]
        for modes in _branches(pool, rows, set(block.columns)):
            touched = [k for k, row_conditions in enumerate(conditions) if not row_conditions.isdisjoint(modes)]
            changed = {k: columns(pool.variables_in(_in_modes(pool, rows[k], modes))) for k in touched}
            if not stays_matched(usual_columns, matched, changed):
                lost = max(touched, key=lambda k: len(usual_columns[k]) - len(changed[k]))
                raise _refusal(reduced, sources[block.rows[lost]], block, modes)


def _matched(rows: Sequence[Sequence[int]]) -> IntArray:
    return match(Incidence.from_rows(rows, len(rows)))


def _conditions(pool: Pool, root: int) -> set[int]:
    """The conditions of all branches below a node."""
    nodes = (pool.nodes[n] for n in pool.reachable([root]))
    return {_normalised(pool, node[1], True)[0] for node in nodes if node[0] == "where"}


def _switched(pool: Pool, residuals: Sequence[int]) -> set[int]:
    """Those residuals that contain a branch."""
    holds: set[int] = set()
    for number in pool.reachable(residuals):
        op, *operands = pool.nodes[number]
        if op == "where" or (op not in LEAVES and not holds.isdisjoint(operands)):
            holds.add(number)
    return holds.intersection(residuals)


def _branches(pool: Pool, rows: Sequence[int], unknowns: set[int]) -> Iterator[Modes]:
    """The modes of each branch, together with those of the branches around it."""
    seen: set[frozenset[tuple[int, bool]]] = set()
    todo: deque[tuple[int, dict[int, bool]]] = deque((row, {}) for row in rows)
    while todo and len(seen) < _MOST_BRANCHES_CHECKED:
        root, modes = todo.popleft()
        for number in _wheres(pool, root, modes):
            _, condition, *alternatives = pool.nodes[number]
            decisive, holds = _normalised(pool, condition, True)
            concerns = pool.variables_in(*alternatives) & unknowns or pool.zero in alternatives
            if not concerns or _is_fixed_in_run(pool, decisive):
                continue
            for node, is_true in zip(alternatives, (holds, not holds), strict=True):
                nested_modes = {**modes, decisive: is_true}
                key = frozenset(nested_modes.items())
                if key not in seen:
                    seen.add(key)
                    yield nested_modes
                    todo.append((node, nested_modes))


def _is_fixed_in_run(pool: Pool, condition: int) -> bool:
    """Whether a condition cannot change during a run: it depends on parameters only, or is true at single instants."""
    below = pool.reachable([condition])
    return pool.is_constant(condition) or any(pool.nodes[n][0] in _AT_INSTANTS for n in below)


def _normalised(pool: Pool, condition: int, holds: bool) -> tuple[int, bool]:
    """A condition without `not` and `noevent`, and with `<` turned into `>=`, and whether its value is the same."""
    while pool.nodes[condition][0] in ("not", "noevent"):
        holds ^= pool.nodes[condition][0] == "not"
        condition = pool.nodes[condition][1]
    op, *operands = pool.nodes[condition]
    if op in _OPPOSITE:
        condition, holds = pool.make(_OPPOSITE[op], *operands), not holds
    return condition, holds


def _always(pool: Pool, root: int) -> set[int]:
    """Variables on which a node depends in all modes: neither below a branch nor multiplied by one."""
    switched: list[int] = []

    def unswitched(number: int) -> Sequence[int]:
        op, *operands = pool.nodes[number]
        if op == "where" or (op in ("mul", "div") and any(_is_switched(pool, n) for n in operands)):
            switched.append(number)
            return ()
        return () if op in LEAVES else operands

    variables = {pool.nodes[n][1] for n in closure([root], unswitched) if pool.nodes[n][0] == "var"}
    return variables - pool.variables_in(*switched)


def _is_switched(pool: Pool, number: int) -> bool:
    while pool.nodes[number][0] in ("neg", "noevent"):
        number = pool.nodes[number][1]
    return bool(pool.nodes[number][0] == "where")


def _in_modes(pool: Pool, root: int, modes: Modes) -> int:
    """A node with branches replaced by those active in `modes`, as far as decided, and without terms that cancel."""
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
    """The branch that is active in `modes`; None if its condition is not decided."""
    normalised, holds = _normalised(pool, operands[0], True)
    return operands[1 if modes[normalised] == holds else 2] if normalised in modes else None


def _wheres(pool: Pool, root: int, modes: Modes) -> list[int]:
    """The outermost branches whose condition `modes` does not decide."""
    undecided = []

    def decided(number: int) -> Sequence[int]:
        op, *operands = pool.nodes[number]
        if op != "where":
            return () if op in LEAVES else operands
        chosen = _chosen(pool, operands, modes)
        if chosen is None:
            undecided.append(number)
        return () if chosen is None else (chosen,)

    closure([root], decided)
    return sorted(undecided)


def _as_true_relation(pool: Pool, condition: int, holds: bool) -> tuple[int, bool]:
    """A relation that does not hold, expressed by its opposite, which does."""
    op, *operands = pool.nodes[condition]
    opposite = next((other for other, own in _OPPOSITE.items() if own == op), None)
    return (condition, holds) if holds or opposite is None else (pool.make(opposite, *operands), True)


def _refusal(reduced: ReducedSystem, source: int, block: Block, modes: Modes) -> StructureError:
    flat, pool = reduced.flat, reduced.pool
    equation = flat.equations[source]

    shown = dict(_as_true_relation(pool, n, holds) for n, holds in modes.items())
    texts = [f"`{reduced.text(n)}`{'' if holds else ' is false'}" for n, holds in shown.items()]
    when = " and ".join(texts)
    names = listed((reduced.name(v) for v in block.columns), 3)
    return StructureError(
        "AC213",
        f"{flat.name}: the structure depends on the mode: where {when}, nothing determines {names}",
        where=places(flat, [equation]),
        evidence=[
            line(flat, equation),
            f"in one mode it is an equation for {names}, in the other a constraint between known variables",
        ],
        cause="a constraint is switched on and off: the number of states would change, with impulses",
        help="give it a force: a stiff spring and damper, where(r > l, c*(r - l) + d*der(r), 0); or constrain "
        "accelerations instead, and let a `when` make the velocities jump, reset(velocity, 0, by=force); or make a "
        "model for each mode",
    )
