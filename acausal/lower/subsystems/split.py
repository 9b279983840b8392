"""A compiled model as several independent systems, each with its own steps and events in a run.

If they were integrated as one system, every impact would force small steps on all bodies. Equal systems share one
model, in which the numbers that differ are parameters, so that compile time and memory do not grow with the number of
systems. They are found in the lowered model, so that aliases, states and located relations are those of the whole
model.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any
from weakref import ref

import numpy as np

from acausal.analyse.blocks.solve import Solution
from acausal.analyse.events.state_events import StateEvents
from acausal.analyse.events.steep import Steep
from acausal.analyse.events.time_events import TimeEvents
from acausal.analyse.start import StartProblem
from acausal.arrays import Indices, Vector
from acausal.errors import Span
from acausal.flatten.pool import Pool
from acausal.lower.compile import with_functions
from acausal.lower.compiled import CompiledModel
from acausal.lower.events.functions import EventFunctions
from acausal.lower.subsystems.extract import Extract, extract
from acausal.lower.subsystems.partition import Group, groups, may_be_split
from acausal.recent import once_per_owner

FEWEST = 4
"""Least number of systems with located events with which splitting pays."""
_MOST_KINDS = 32


@dataclass(frozen=True, eq=False)
class Subsystem:
    """One independent system."""

    # A model with its own names, which shares the functions of all equal systems (`CompiledModel.like`).
    model: CompiledModel
    # Indices of its states and modes among those of the whole model.
    states: Indices
    modes: Indices
    # Its parameters are entries of p of the whole model, with indices `parameters`, then entries of u, with indices
    # `inputs`, then `numbers`.
    parameters: Indices
    inputs: Indices
    numbers: Vector

    def p(self, p: Vector, u: Vector) -> Vector:
        """Parameters of the system, from those of the whole model, shape (np,), and its inputs, shape (nu,)."""
        return np.concatenate([p[self.parameters], u[self.inputs], self.numbers])


@once_per_owner
def subsystems(compiled: CompiledModel) -> tuple[Subsystem, ...]:
    """Independent systems of a model, cached; empty if it is one system, or cannot be split.

    States that belong to none of them never change.
    """
    if not (compiled.state_events and may_be_split(compiled)):
        return ()
    candidates = [g for g in groups(compiled) if not _is_constant(compiled, g)]
    # Only systems with dynamic states and relations benefit from steps of their own.
    if sum(bool(g.relations) and g.states[0] < compiled.n_dynamic for g in candidates) < FEWEST:
        return ()
    definition = {v: (k, node) for k, (v, node) in enumerate(compiled.solution.definitions)}
    inputs = {v: k for k, v in enumerate(compiled.solution.structure.reduced.inputs)}
    statements = [_Statements(compiled, g) for g in candidates]
    pool = compiled.solution.structure.reduced.pool
    extracts = [extract(pool, w.roots, definition, compiled.rewritten, inputs) for w in statements]
    if not set(compiled.narrow.arguments) <= {n for e in extracts for n in e.nodes}:
        return ()  # a steep function belongs to none of them
    kinds: dict[Any, list[int]] = {}
    for k, (w, e) in enumerate(zip(statements, extracts, strict=True)):
        kinds.setdefault((e.key, w.key(e)), []).append(k)
    if len(kinds) > _MOST_KINDS:
        return ()
    systems: dict[int, Subsystem] = {}
    for members in kinds.values():
        kind = _Kind([extracts[k] for k in members], statements[members[0]])
        for k in members:
            systems[k] = kind.subsystem(statements[k], extracts[k])
    return tuple(systems[k] for k in range(len(candidates)))


def _is_constant(compiled: CompiledModel, group: Group) -> bool:
    """Whether no state of a group ever changes, because it consists of discrete variables that no clause sets."""
    return group.has_no_events and min(group.states) >= len(compiled.states) - compiled.discretes


class _Statements:
    """The statements of one group, as nodes of the whole model."""

    def __init__(self, compiled: CompiledModel, group: Group) -> None:
        self.compiled, self.group = compiled, group
        events, pool = compiled.state_events, compiled.solution.structure.reduced.pool
        structure = compiled.solution.structure
        self.variables = [compiled.state_variables[k] for k in group.states]
        self.relations = [events.relations[k] for k in group.relations]
        self.clauses = [events.clauses[k] for k in group.clauses]
        self.assignments = [events.assignments[k] for k in group.assignments]
        self.asserts = [events.asserts[k] for k in group.asserts]
        self.memories = [events.memories[k] for k in group.memories]
        self.rates = [structure.derivative(x) for x in self.variables]
        self.roots = [
            *map(pool.var, self.variables),
            *map(pool.var, self.rates),
            *self.relations,
            *(n for c in self.clauses for n in (*c.conditions, *c.earlier, *(v for _, v in c.actions))),
            *(a.node for a in self.assignments),
            *(a.condition for a in self.asserts),
            *self.memories,
        ]
        discretes = len(compiled.state_variables) - compiled.discretes
        self.discretes = sum(k >= discretes for k in group.states)

    def key(self, e: Extract) -> Any:
        """Key that equal groups share in addition to that of their expressions."""
        group, events = self.group, self.compiled.state_events
        position_of = {k: index for index, k in enumerate(group.states)}
        return (
            self.discretes,
            tuple(self.compiled.nominal_x[list(group.states)].tolist()),
            tuple(k in events.watched for k in group.relations),
            tuple(
                (len(c.conditions), len(c.earlier), tuple(position_of[k] for k, _ in c.actions), c.terminate is None)
                for c in self.clauses
            ),
            tuple(position_of[a.position] for a in self.assignments),
            tuple(a.level for a in self.asserts),
            self.steep(e),
            *(tuple(index for index, _ in self.shared(e, nodes)) for nodes in self._shared_nodes),
        )

    @property
    def _shared_nodes(self) -> tuple[Sequence[int], ...]:
        """Relations of time, samples and flags of the whole model, which groups may share."""
        return self.compiled.time_events.relations, self.compiled.state_events.samples, self.compiled.state_events.flags

    @staticmethod
    def shared(e: Extract, nodes: Sequence[int]) -> list[tuple[int, int]]:
        """(Index in the extract, index among `nodes`) of those nodes that a group contains."""
        number = {n: k for k, n in enumerate(nodes)}
        return [(index, number[n]) for index, n in enumerate(e.nodes) if n in number]

    def steep(self, e: Extract) -> Steep:
        """The steep functions of the whole model that are in the group, by indices in the extract."""
        whole, index_of = self.compiled.narrow, {n: k for k, n in enumerate(e.nodes)}
        indices = [j for j, n in enumerate(whole.arguments) if n in index_of]
        number = {j: k for k, j in enumerate(indices)}
        return Steep(
            tuple(index_of[whole.arguments[j]] for j in indices),
            tuple(whole.kinds[j] for j in indices),
            tuple((index_of[w], number[j]) for w, j in whole.middles if j in number),
            tuple((index_of[n], tuple(number[j] for j in places)) for n, places in whole.functions if n in index_of),
        )

    def timely(self, e: Extract) -> tuple[list[int], list[int], list[int]]:
        """Indices of the relations of time, samples and flags that the group contains."""
        shared_indices = [[k for _, k in self.shared(e, nodes)] for nodes in self._shared_nodes]
        return shared_indices[0], shared_indices[1], shared_indices[2]

    def modes(self, e: Extract) -> Indices:
        """Indices of the modes of the group among those of the whole model, in the order of `mode_nodes`."""
        timely, samples, flags = self.timely(e)
        events, places = self.compiled.state_events, self.compiled.mode_places
        first = np.cumsum([0, len(self.compiled.time_events.relations), len(events.samples), len(events.memories)])
        last = len(self.compiled.mode_nodes) - len(events.relations)
        numbers = [
            *timely,
            *(first[1] + k for k in samples),
            *(first[2] + k for k in self.group.memories),
            *(first[3] + k for k in flags),
            *(last + k for k in self.group.relations),
        ]
        return np.array([places[k] for k in numbers], dtype=np.int64)


class _Kind:
    """Equal systems: one model, with a parameter for each hole whose content differs."""

    def __init__(self, members: Sequence[Extract], whole: _Statements) -> None:
        e = members[0]
        fills = list(zip(*(m.holes for m in members), strict=True))
        numbers = [k for k, fill in enumerate(fills) if fill[0][0] == "const" and len(set(fill)) > 1]
        by_kind = {kind: [k for k, (kind_, _) in enumerate(e.holes) if kind_ == kind] for kind in ("par", "input")}
        self.holes = *by_kind["par"], *by_kind["input"], *numbers
        slot = {hole: k for k, hole in enumerate(self.holes)}
        pool = Pool()
        pool.n_variables = len(e.variables)
        self.node: list[int] = []
        for op, *below in e.entries:
            if op == "hole":
                k = below[0]
                self.node.append(pool.par(slot[k]) if k in slot else pool.const(e.holes[k][1]))
            elif op in ("const", "var", "time"):
                self.node.append(pool.intern((op, *below)))
            else:
                self.node.append(pool.intern((op, *(self.node[c] for c in below))))
        self.model = self._model(pool, e, whole)

    def _model(self, pool: Pool, e: Extract, whole: _Statements) -> CompiledModel:
        compiled = whole.compiled
        node = dict(zip(e.nodes, self.node, strict=True))
        number = {v: k for k, v in enumerate(e.variables)}
        states = tuple(number[v] for v in whole.variables)
        pool.derivative_of = {number[x]: number[dx] for x, dx in zip(whole.variables, whole.rates, strict=True)}
        pool.integral_of = {dx: x for x, dx in pool.derivative_of.items()}
        definitions = tuple((v, self.node[index]) for v, index in e.definitions)
        old = compiled.solution.structure
        flat = replace(old.reduced.flat, parameters=(), inputs=(), parameter_values=(0.0,) * len(self.holes))
        flat.__dict__["parameter_names"] = tuple(f"number {k}" for k in range(len(self.holes)))
        reduced = replace(
            old.reduced,
            flat=flat,
            pool=pool,
            scalar=tuple(old.reduced.scalar[v] if v < len(old.reduced.scalar) else -1 for v in e.variables),
            image=(),
            inputs=(),
            residuals=(),
            equation=(),
            initial=(),
            whens=(),
            assignments=(),
            asserts=(),
        )
        structure = replace(
            old, reduced=reduced, residuals=(), integral={}, states=states, blocks=(), choices=(), invariants=()
        )
        solution = Solution(
            structure, definitions, (), (), frozenset(v for v, _ in definitions), (), compiled.solution.formulation
        )
        steep_functions = whole.steep(e)
        middles = tuple((self.node[k], owner) for k, owner in steep_functions.middles)
        functions = tuple((self.node[k], places) for k, places in steep_functions.functions)
        shell = CompiledModel(
            compiled.name,
            solution,
            states,
            0,
            whole.discretes,
            StartProblem({}, (), (), (), {}),
            self._time_events(e, whole, node, pool),
            None,
            None,
            None,
            state_events=self._events(e, whole, node),
            steep=Steep(
                tuple(self.node[k] for k in steep_functions.arguments), steep_functions.kinds, middles, functions
            ),
        )
        system = with_functions(shell)
        system.__dict__["nominal_x"] = compiled.nominal_x[list(whole.group.states)]
        system.__dict__["nominal_z"] = np.zeros(0)
        return system

    def _time_events(self, e: Extract, whole: _Statements, node: dict[int, int], pool: Pool) -> TimeEvents:
        """Relations of time of the group, without instants, because a run takes those of the whole model."""
        relations = tuple(node[whole.compiled.time_events.relations[k]] for k in whole.timely(e)[0])
        unknown = (pool.zero,) * len(relations)
        return TimeEvents(relations, unknown, unknown, {})

    def _events(self, e: Extract, whole: _Statements, node: dict[int, int]) -> StateEvents:
        events, group = whole.compiled.state_events, whole.group
        _, samples, flags = whole.timely(e)
        position_of = {k: index for index, k in enumerate(group.states)}

        def nodes(numbers: Sequence[int]) -> tuple[int, ...]:
            return tuple(node[n] for n in numbers)

        return StateEvents(
            nodes([events.samples[k] for k in samples]),
            nodes(whole.memories),
            nodes([events.flags[k] for k in flags]),
            nodes(whole.relations),
            {self.node[a]: self.node[b] for a, b in e.images},
            tuple(
                replace(
                    c,
                    conditions=nodes(c.conditions),
                    earlier=nodes(c.earlier),
                    actions=tuple((position_of[k], node[v]) for k, v in c.actions),
                )
                for c in whole.clauses
            ),
            tuple(replace(a, position=position_of[a.position], node=node[a.node]) for a in whole.assignments),
            tuple(replace(a, condition=node[a.condition]) for a in whole.asserts),
            frozenset(index for index, k in enumerate(group.relations) if k in events.watched),
        )

    def subsystem(self, whole: _Statements, e: Extract) -> Subsystem:
        """One of the equal systems, with its names and texts."""
        like, compiled = self.model, whole.compiled
        events = like.state_events
        clauses = zip(events.clauses, whole.clauses, strict=True)
        own_events = replace(
            events,
            clauses=tuple(replace(shared, text=c.text, component=c.component, where=c.where) for shared, c in clauses),
            assignments=tuple(
                replace(shared, text=a.text) for shared, a in zip(events.assignments, whole.assignments, strict=True)
            ),
            asserts=tuple(
                replace(shared, message=a.message, component=a.component, where=a.where)
                for shared, a in zip(events.asserts, whole.asserts, strict=True)
            ),
        )
        model = replace(like, state_events=own_events, like=like)
        names = tuple(compiled.states[k] for k in whole.group.states)
        model.__dict__.update(states=names, nominal_x=like.nominal_x, nominal_z=like.nominal_z)
        model.__dict__["events"] = _TextsOfSystem(like, compiled, whole.group.relations)
        by_kind: dict[str, list[float]] = {"par": [], "input": [], "const": []}
        for k in self.holes:
            by_kind[e.holes[k][0]].append(e.holes[k][1])
        return Subsystem(
            model,
            np.array(whole.group.states, dtype=np.int64),
            whole.modes(e),
            np.array(by_kind["par"], dtype=np.int64),
            np.array(by_kind["input"], dtype=np.int64),
            np.array(by_kind["const"]),
        )


class _TextsOfSystem(EventFunctions):
    """The functions that equal systems share, with the texts of one system."""

    def __init__(self, like: CompiledModel, whole: CompiledModel, relations: Sequence[int]) -> None:
        super().__init__(like)
        self._whole_ref = ref(whole)  # weak, because the cache of a model must not keep it alive
        self._relations = relations

    @property
    def _whole(self) -> CompiledModel:
        whole = self._whole_ref()
        assert whole is not None, "the caller keeps a reference to the model"
        return whole

    @cached_property
    def texts(self) -> tuple[str, ...]:
        """The relations as the user reads them."""
        return tuple(self._whole.events.texts[k] for k in self._relations)

    @cached_property
    def places(self) -> tuple[tuple[Span | None, str], ...]:
        """Place in the source and component of the first statement that contains each relation."""
        return tuple(self._whole.events.places[k] for k in self._relations)
