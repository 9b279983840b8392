"""State events of a model: relations of variables, samples, `when` clauses and discrete equations.

Every relation on which an integrated quantity depends is a mode, constant between events, so that the right-hand side
is smooth in each mode; `no_event` and `where(..., smooth=True)` exempt a relation. `sign`, `floor` and `ceil` of a
variable become relations too, because they jump. `minimum`, `maximum` and `fabs` only have kinks and make no events, as
in Modelica (3.6, section 3.7.2). Relations of time only switch at instants known in advance (`time_events`); relations
of discrete variables change at events only.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from acausal.analyse.blocks.solve import Solution
from acausal.analyse.delays import Delays
from acausal.analyse.domains.branches import guarded
from acausal.analyse.domains.partial_relations import Existence, in_domains
from acausal.analyse.domains.without_value import EXTREMA, WithoutValue
from acausal.analyse.events.assertions import Assert, assertions
from acausal.analyse.events.between_events import checked_between_events
from acausal.analyse.events.by_modes import by_modes
from acausal.analyse.events.jumping_tables import jumping_tables, on_segment
from acausal.analyse.events.located_kinks import LocatedKinks
from acausal.analyse.events.resting import Kinks, split_at_kinks
from acausal.analyse.events.steep import Moving
from acausal.analyse.events.time_events import TimeEvents, segment_number
from acausal.errors import Span, StructureError
from acausal.flatten.pool import IMPULSE, LEAVES, RELATIONS, Pool, closure
from acausal.flatten.reduced import ReducedSystem

# Operations that make events, or are rewritten because of events; expressions without them need no search.
_EVENT_OPERATIONS = frozenset((*RELATIONS, "sign", "floor", "ceil", "where", "pow", "sqrt"))
_SIGN = "gt", "ge"
# Operations whose values jump at events. Those of `_STEPS` change during a run even if their operand depends on time
# alone, as they are not among the time events.
_STEPS = frozenset(("floor", "ceil"))
_JUMPS = frozenset((*RELATIONS, *_STEPS, "sign"))
_EVENT_OPERATIONS |= {"sample", "pre", "initial", "after_reset", "infinitesimal", "terminal"}


@dataclass(frozen=True)
class Clause:
    """One `when` or `elsewhen`: it acts when one of `conditions` becomes true and none of `earlier` does.

    `actions` are pairs (index in the state vector, node of the new value); for an impulse the index is that of the
    force.
    """

    conditions: tuple[int, ...]
    earlier: tuple[int, ...]
    actions: tuple[tuple[int, int], ...]
    terminate: str | None
    text: str
    component: str
    where: Span


@dataclass(frozen=True)
class Assignment:
    """A discrete equation: the state with index `position` takes the value of `node` at every event."""

    position: int
    node: int
    text: str


@dataclass(frozen=True)
class StateEvents:
    """Everything that can cause an event apart from known instants, as nodes of the reduced pool."""

    samples: tuple[int, ...] = ()  # `sample(start, interval)`: true at instants only
    memories: tuple[int, ...] = ()  # `pre(...)`: the value before this round of the event iteration
    flags: tuple[int, ...] = ()  # `initial()`, `infinitesimal()` and `terminal()`, if the model uses them
    relations: tuple[int, ...] = ()  # relations of variables, located
    # Maps `sign`, `floor` and `ceil` of variables to branches on such relations, and branches with partially defined
    # functions to extensions (`acausal.analyse.domains.branches`).
    rewritten: dict[int, int] = field(default_factory=dict)
    # `clauses`, `assignments`, `asserts`: in the order of the source.
    clauses: tuple[Clause, ...] = ()
    assignments: tuple[Assignment, ...] = ()
    asserts: tuple[Assert, ...] = ()
    # Indices of `relations` that make no event: kinks (`located_kinks.py`), and ends of stretches of tables
    # (`time_events.py`).
    watched: frozenset[int] = frozenset()
    # Indices of `relations` whose sides may stay equal for a while (`resting.py`).
    resting: frozenset[int] = frozenset()
    # Maps relations with extensions beyond the domains of their functions to what the model says (`in_domains`).
    written: dict[int, int] = field(default_factory=dict)

    @property
    def conditions(self) -> tuple[int, ...]:
        """The conditions of all clauses, without repetitions."""
        return tuple(dict.fromkeys(n for c in self.clauses for n in (*c.conditions, *c.earlier)))

    @property
    def are_silent(self) -> bool:
        """Whether no event can occur; an assertion on more than an instant has relations."""
        return len(self.relations) == len(self.watched) and not (self.clauses or self.assignments)

    def __bool__(self) -> bool:
        return bool(self.relations or self.memories or self.clauses or self.assignments or self.asserts)


def find_state_events(
    solution: Solution, states: tuple[int, ...], time_events: TimeEvents, kinks_to_locate: LocatedKinks
) -> StateEvents:
    """State events of a solution, and the relations of `kinks_to_locate`.

    Raises StructureError: AC210 when a variable is reset that is neither integrated nor discrete. DeclarationError:
    AC146 for what is evaluated at events only, but varies between them.
    """
    reduced = solution.structure.reduced
    pool = reduced.pool
    clauses = tuple(_clauses(reduced, states))
    assignments = tuple(_assignments(reduced, states))
    discrete = discrete_variables(reduced)
    asserts = tuple(assertions(reduced, checked_between_events(solution, discrete)))
    event_nodes = _event_nodes(solution, clauses, assignments, asserts, kinks_to_locate)
    equation_nodes = [*solution.residuals, *_definitions(solution, event_nodes)]
    definitions = dict(solution.definitions)
    # Possibly few: of a field with a thousand cells, one may contain an event.
    equation_nodes = _with_events(pool, equation_nodes, definitions)
    roots = [*event_nodes, *equation_nodes]
    has_extrema = any(node[0] in EXTREMA for node in pool.nodes)
    if not (roots or kinks_to_locate.watched or has_extrema):
        return StateEvents(clauses=clauses, assignments=assignments, asserts=asserts)
    # those below `no_event`, too, but none of the steps that solve a block
    stated = pool.reachable([*event_nodes, *solution.structure.residuals])
    without_value = WithoutValue(solution, stated)
    swallowing = without_value.extrema() if has_extrema else []
    if not (roots or kinks_to_locate.watched or swallowing):
        return StateEvents(clauses=clauses, assignments=assignments, asserts=asserts)
    rewritten = dict(time_events.rewritten)
    moves = Moving(pool, discrete)
    steps = _stepping(pool, clauses, event_nodes, equation_nodes)
    visible = _visible(pool, roots)
    visible = sorted({*visible, *_of_signs(pool, visible, rewritten, moves)})
    kinks = Kinks(pool, solution.definitions)
    done = dict(rewritten)
    existence = Existence(solution, moves, frozenset(stated), exempt=False)
    below_no_event = Existence(solution, moves, exempt=True)
    branches = in_domains(pool, existence, visible, done)
    branches |= split_at_kinks(kinks, solution.structure.points, visible, done)
    all_visible = [*visible, *_visible(pool, branches.values())]
    branches |= _jumps(pool, all_visible, steps, moves, {**rewritten, **branches}, definitions, without_value)
    done = {**rewritten, **branches}
    if kinks_to_locate.branches:
        located = [n for n in visible if pool.nodes[n][0] in RELATIONS]
        integrated = [*solution.residuals, *(n for v, n in solution.definitions if v in solution.needed)]
        kink_branches = by_modes(pool, [*roots, *integrated], below_no_event, located, kinks_to_locate.watched, done)
        branches |= kink_branches
        done = {**rewritten, **branches}
        # Beyond a kink that became a branch, a root or a power may be undefined, as beyond any relation.
        roots += set(integrated).difference(roots) if kink_branches else ()
    branches |= in_domains(pool, below_no_event, stated, done)
    branches |= without_value.images(swallowing, done)
    done |= branches
    kept = list(filter(without_value.concerns, branches))
    branches |= guarded(pool, roots, done, _assigned(reduced), solution.definitions, kept)
    done = {**rewritten, **branches}
    if kinks_to_locate.bursts:
        branches |= without_underflow(pool, roots, done)
    pool.rewrite(roots, pool.var, done)
    modes = _conditions(pool, [done[r] for r in roots], set(time_events.relations), moves)
    modes["pre"] |= _before_impulses(pool, states, clauses, assignments)
    relations = tuple(sorted(set(modes["relation"]).difference(kinks_to_locate.watched)))
    number_nodes = set(pool.reachable([done[n] for n in kinks_to_locate.numbers]))
    stretch_ends = (k for k, n in enumerate(relations) if n in number_nodes)
    resting = kinks.resting_relations(solution.structure.points, relations)
    return StateEvents(
        tuple(sorted(modes["sample"])),
        tuple(sorted(modes["pre"])),
        tuple(sorted(modes["flag"])),
        (*relations, *kinks_to_locate.watched),
        branches,
        clauses,
        assignments,
        asserts,
        frozenset((*stretch_ends, *range(len(relations), len(relations) + len(kinks_to_locate.watched)))),
        frozenset(k for k, n in enumerate(relations) if n in resting),
        existence.written,
    )


def _event_nodes(
    solution: Solution,
    clauses: Iterable[Clause],
    assignments: Iterable[Assignment],
    asserts: Iterable[Assert],
    kinks_to_locate: LocatedKinks,
) -> list[int]:
    """Nodes that are evaluated for events, not for rates."""
    reduced = solution.structure.reduced
    return [
        *(n for c in clauses for n in (*c.conditions, *c.earlier, *(v for _, v in c.actions))),
        *(a.node for a in assignments),
        *(a.condition for a in asserts),
        *(n for d in reduced.delays for n in d[:2]),
        *map(reduced.pool.var, switched_dependents(solution)),
        *kinks_to_locate.numbers,
    ]


def _before_impulses(
    pool: Pool, states: tuple[int, ...], clauses: Iterable[Clause], assignments: Iterable[Assignment]
) -> set[int]:
    """`pre` of all discrete variables if there are impulses, which use the equations from before the event."""
    actions = [action for clause in clauses for action in clause.actions]
    if not any(pool.nodes[node][0] == IMPULSE for _, node in actions):
        return set()
    discrete = [k for k, node in actions if pool.nodes[node][0] != IMPULSE] + [a.position for a in assignments]
    return {pool.make("pre", pool.var(states[k])) for k in discrete}


def _stepping(pool: Pool, clauses: Iterable[Clause], event_nodes: list[int], equation_nodes: list[int]) -> set[int]:
    """Nodes whose steps make events.

    Values of a `when` are computed at its instants only: a sampled quantiser makes no event at each of its steps.
    """
    values = {v for c in clauses for _, v in c.actions}
    return set(_visible(pool, [*(n for n in event_nodes if n not in values), *equation_nodes]))


def discrete_variables(reduced: ReducedSystem) -> frozenset[int]:
    """Variables that change at events only."""
    flat = reduced.flat
    declared = {v.first + k for v in flat.variables if v.declaration.discrete for k in range(v.size)}
    if not declared:  # the usual case of large models, whose aliases are many
        return frozenset()
    return frozenset(v for v, scalars in reduced.aliases.items() if not declared.isdisjoint(scalars))


def switched_dependents(solution: Solution, prescribed: bool = False) -> list[int]:
    """Differentiated variables that are not states but depend on states in a way that differs between modes.

    They must not jump while the states do not, whether or not integrated quantities depend on them. With `prescribed`,
    those that depend on time instead of states.
    """
    reduced = solution.structure.reduced
    pool = reduced.pool
    given_variables = {*solution.structure.states, *reduced.inputs}
    if not pool.derivative_of.keys() - given_variables:
        return []
    discrete = discrete_variables(reduced)
    if not discrete and not any(node[0] in _JUMPS for node in pool.nodes):
        return []
    ops = {pool.nodes[n][0] for n in pool.reachable(solution.residuals)}
    switched = dict.fromkeys(solution.algebraic, bool(ops & _JUMPS))
    varying = dict.fromkeys(solution.algebraic, True)
    flags_of: dict[int, tuple[bool, bool]] = {}  # by node, because definitions share nodes
    for v, node in solution.definitions:  # in the order of evaluation
        for n in pool.reachable([node], flags_of):
            op, *rest = pool.nodes[n]
            if op == "var":
                w = rest[0]
                flags_of[n] = switched.get(w, w in discrete), varying.get(w, w not in discrete)
            else:
                operand_flags = [flags_of[k] for k in rest] if op not in LEAVES else []
                flags_of[n] = (
                    op in _JUMPS or any(a for a, _ in operand_flags),
                    op in _STEPS or any(b for _, b in operand_flags),
                )
        switched[v], varying[v] = flags_of[node]
    dependents = [v for v in switched if v in pool.derivative_of and switched[v] and varying[v] != prescribed]
    if prescribed:  # a mere output, such as the acceleration of a joint that moves nothing, needs no impulse
        used = {w for _, node in solution.definitions for w in pool.variables_in(node)}
        dependents = [v for v in dependents if pool.derivative_of[v] in used]
    return dependents


def _assigned(reduced: ReducedSystem) -> dict[int, int]:
    """Maps discrete variables to the nodes of their discrete equations."""
    images = (
        (reduced.pool.nodes[reduced.image[e.scalar]], n)
        for e, n in zip(reduced.flat.assignments, reduced.assignments, strict=True)
    )
    return {image[1]: node for image, node in images if image[0] == "var"}


def _definitions(solution: Solution, roots: Iterable[int]) -> list[int]:
    """Nodes of all definitions that the integrator or `roots` need."""
    behind = solution.structure.reduced.pool.variables_behind(roots, dict(solution.definitions))
    needed = solution.needed | behind
    return [node for v, node in solution.definitions if v in needed]


def _jumps(
    pool: Pool,
    visible: Iterable[int],
    steps: set[int],
    moves: Moving,
    rewritten: Mapping[int, int],
    definitions: Mapping[int, int],
    without_value: WithoutValue,
) -> dict[int, int]:
    """Maps `sign` of varying expressions, and those of `steps` that are `floor`, `ceil` or tables, to branches."""
    image_of: dict[int, int] = {}
    done = dict(rewritten)

    def stairs(number: int, op: str, u: int) -> int:
        image_of[number] = done[number] = _stairs(pool, number, op, u)
        memory = pool.make("pre", number)
        image_of[memory] = done[memory] = memory  # the memory stores the value of the branch under this node
        return image_of[number]

    tables = jumping_tables(pool, steps, definitions)
    for number in visible:
        op, *operands = pool.nodes[number]
        table = tables.get(number)
        if table is not None and moves(operands[0]):
            segment = segment_number(pool, operands[0], list(table.breaks))
            below = pool.nodes[segment][1]
            pool.rewrite([below, *operands], pool.var, done)
            k = stairs(segment, "floor", done[below])
            on = on_segment(pool, table, done[operands[0]], k)
            image_of[number] = done[number] = without_value.kept(on, operands, done)
        if number in rewritten or op not in ("sign", "floor", "ceil") or not moves(operands[0]):
            continue
        pool.rewrite(operands, pool.var, done)
        u = done[operands[0]]
        if op == "sign":
            sides = [pool.make(kind, operands[0], pool.zero) for kind in _SIGN]
            pool.rewrite(sides, pool.var, done)
            above, below = (done[side] for side in sides)
            over, under = pool.where(above, pool.one, pool.zero), pool.where(below, pool.zero, pool.neg(pool.one))
            image_of[number] = done[number] = without_value.kept(pool.add(over, under), operands, done)
        elif number in steps:
            # its memory must not become nan, or it would stay so
            step = pool.make(op, pool.make("noevent", operands[0])) if without_value.is_for(operands[0]) else number
            image_of[number] = done[number] = without_value.kept(stairs(step, op, u), operands, done)
    return image_of


def _of_signs(pool: Pool, visible: Iterable[int], done: dict[int, int], moves: Moving) -> list[int]:
    """Relations > and >= for each `sign` of a varying expression; both, because it is zero while its operand is."""
    signs = (n for n in visible if pool.nodes[n][0] == "sign" and n not in done)
    operands = [k for _, k in (pool.nodes[n] for n in signs) if moves(k)]
    return [pool.make(kind, k, pool.zero) for k in operands for kind in _SIGN]


def _stairs(pool: Pool, number: int, op: str, u: int) -> int:
    """`floor` or `ceil` of u as a number k that is constant until u leaves its step.

    k is the value of the node at the last event, `pre` of itself. When u leaves a step, it equals the end of the step
    only up to rounding errors. Therefore k changes by at least one, and by more if u has jumped.
    """
    k = pool.make("pre", number)
    up, down = pool.add(k, pool.one), pool.sub(k, pool.one)
    rises, falls = ("ge", "lt") if op == "floor" else ("gt", "le")
    above, below = (up, k) if op == "floor" else (k, down)
    here = pool.make(op, u)
    lower = pool.where(pool.make(falls, u, below), pool.make("min", down, here), k)
    return pool.where(pool.make(rises, u, above), pool.make("max", up, here), lower)


def _with_events(pool: Pool, roots: Sequence[int], definitions: Mapping[int, int]) -> list[int]:
    """Those of `roots` that contain an operation of `_EVENT_OPERATIONS`, or a table that jumps."""
    nodes = pool.nodes
    below = pool.reachable(roots)
    containing = set[int](jumping_tables(pool, below, definitions))
    for number in below:
        op, *operands = nodes[number]
        if op in _EVENT_OPERATIONS or (op not in LEAVES and not containing.isdisjoint(operands)):
            containing.add(number)
    return [n for n in roots if n in containing]


def _visible(pool: Pool, roots: Iterable[int]) -> list[int]:
    """All nodes below `roots` that are not below a `no_event`; what a `pre` remembers is visible there, too."""
    nodes = pool.nodes
    roots = set(roots)
    memories = (n for n in pool.reachable(roots) if nodes[n][0] == "pre")
    return sorted(
        closure(
            [*roots, *memories], lambda n: () if nodes[n][0] in LEAVES or nodes[n][0] == "noevent" else nodes[n][1:]
        )
    )


def _conditions(pool: Pool, roots: Iterable[int], time_relations: set[int], moves: Moving) -> dict[str, set[int]]:
    """Nodes that become modes, by kind; nodes below a relation of time are skipped.

    Relations below a `no_event` are no modes, but `pre`, with the relations it remembers, and the other kinds are.
    """
    nodes_of_kind: dict[str, set[int]] = {"sample": set(), "pre": set(), "flag": set(), "relation": set()}
    seen: set[tuple[int, bool]] = set()
    stack = [(n, False) for n in roots]
    while stack:
        number, is_exempt = stack.pop()
        if (number, is_exempt) in seen or (number, False) in seen or number in time_relations:
            continue
        seen.add((number, is_exempt))
        node = pool.nodes[number]
        op = node[0]
        if op in ("sample", "pre"):
            nodes_of_kind[op].add(number)
        if op in ("initial", "after_reset", "infinitesimal", "terminal"):
            nodes_of_kind["flag"].add(number)
        elif op not in LEAVES and op != "sample":
            if op in RELATIONS and not is_exempt and moves(number):
                nodes_of_kind["relation"].add(number)
            stack += [(n, (is_exempt or op == "noevent") and op != "pre") for n in node[1:]]
    return nodes_of_kind


def _position(reduced: ReducedSystem, scalar: int, index_of: dict[int, int]) -> tuple[int, bool] | None:
    """(Index of the state that equals a flat scalar, whether the scalar is its negative); None if it is no state."""
    op, *rest = reduced.pool.nodes[reduced.image[scalar]]
    negative = op == "neg"
    if negative:
        op, *rest = reduced.pool.nodes[rest[0]]
    return (index_of[rest[0]], negative) if op == "var" and rest[0] in index_of else None


def _clauses(reduced: ReducedSystem, states: tuple[int, ...]) -> Iterable[Clause]:
    pool = reduced.pool
    index_of = {v: k for k, v in enumerate(states)}
    for when, nodes in zip(reduced.flat.whens, reduced.whens, strict=True):
        actions = []
        for (scalar, _), value in zip(when.actions, nodes.values, strict=True):
            position = _position(reduced, scalar, index_of)
            if position is None:
                is_preferred = reduced.flat.declaration(scalar).prefer_state is True
                others = "" if is_preferred else ", or declare it prefer_state=True or discrete()"
                raise StructureError(
                    "AC210",
                    f"{reduced.flat.scalar_name(scalar)} cannot be reset: it is not a state of {reduced.flat.name}",
                    where=(when.origin.span(),),
                    evidence=[f"states: {', '.join(reduced.name(x) for x in states[:8])}"],
                    cause="it follows from other variables, so a new value would contradict them",
                    help="reset the state it follows from" + others,
                )
            is_impulse = pool.nodes[value][0] == IMPULSE  # an impulse acts with whatever sign it needs
            actions.append((position[0], pool.neg(value) if position[1] and not is_impulse else value))
        description = when.terminate, str(when.source), when.component, when.origin.span()
        yield Clause(nodes.conditions, nodes.earlier, tuple(actions), *description)


def _assignments(reduced: ReducedSystem, states: tuple[int, ...]) -> Iterable[Assignment]:
    index_of = {v: k for k, v in enumerate(states)}
    for equation, node in zip(reduced.flat.assignments, reduced.assignments, strict=True):
        position = _position(reduced, equation.scalar, index_of)
        if position is not None:  # a variable that equals a parameter needs no assignment
            yield Assignment(position[0], reduced.pool.neg(node) if position[1] else node, str(equation.source))


def origins(
    solution: Solution, events: StateEvents, delays: Delays, rewritten: dict[int, int]
) -> list[tuple[Span | None, str]]:
    """Place in the source and component of the first statement that contains each relation."""
    reduced = solution.structure.reduced
    flat, pool = reduced.flat, reduced.pool
    rows = {v: b.rows for b in solution.structure.blocks for v in b.columns}
    statements: list[tuple[int, Span | None, str]] = []
    for c in events.clauses:
        statements += [(n, c.where, c.component) for n in (*c.conditions, *c.earlier, *(v for _, v in c.actions))]
    statements += [(a.condition, a.where, a.component) for a in events.asserts]
    statements += [
        (node, e.origin.span() if e.origin else None, e.component)
        for e, node in zip(flat.assignments, reduced.assignments, strict=True)
    ]
    statements += [(n, d.where, d.component) for d in delays.items for n in (delays.sources[d.source], d.time)]
    equations = [(node, solution.structure.flat_equation(rows[v][0])) for v, node in solution.definitions if v in rows]
    equations += [(node, solution.structure.flat_equation(e)) for e, node in enumerate(solution.structure.residuals)]
    statement_of: dict[int, tuple[Span | None, str]] = {}
    missing = set(events.relations)
    # A relation belongs to the first statement that contains it, so that every node is visited only once.
    done, seen = dict(rewritten), set[int]()

    def relations_in(node: int) -> set[int]:
        pool.rewrite([node], pool.var, done)
        unvisited = pool.reachable([done[node]], seen)
        seen.update(unvisited)
        return missing.intersection(unvisited)

    for node, where, component in statements:
        for r in relations_in(node):
            statement_of[r] = (where, component)
    missing -= statement_of.keys()
    for node, k in equations:
        if not missing:
            break
        for r in relations_in(node):
            equation = flat.equations[k]
            statement_of[r] = (equation.origin.span() if equation.origin else None, equation.component)
        missing -= statement_of.keys()
    return [statement_of.get(r, (None, "")) for r in events.relations]


_LOWEST_EXPONENT = 8.0
_LOWEST_LOGARITHM = -300.0


def without_underflow(pool: Pool, roots: Iterable[int], done: dict[int, int]) -> dict[int, int]:
    """Images of exponentials and high even powers that are constant where they are below 1e-130; `done` receives them.

    A factorisation squares entries and divides by the squares. Where these underflow (1e-155 squared), a run would stop
    with AC400, far from any burst.
    """
    images: dict[int, int] = {}
    for number in pool.reachable(roots):
        op, *operands = pool.nodes[number]
        if number in done or op not in ("exp", "pow"):
            continue
        exponent = pool.nodes[operands[-1]]
        if op == "exp":
            pool.rewrite(operands, pool.var, done)
            bounded = pool.make("exp", pool.make("max", done[operands[0]], pool.const(_LOWEST_LOGARITHM)))
        elif exponent[0] == "const" and exponent[1] >= _LOWEST_EXPONENT and exponent[1] % 2.0 == 0.0:
            pool.rewrite(operands, pool.var, done)
            least = pool.const(float(np.exp(_LOWEST_LOGARITHM / exponent[1])))
            bounded = pool.make("pow", pool.make("max", pool.make("fabs", done[operands[0]]), least), operands[1])
        else:
            continue
        images[number] = done[number] = bounded
    return images
