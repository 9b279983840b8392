"""Flattening of a component: instance tree, connection sets and scalar equations become a `FlatSystem`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from math import prod
from typing import Any

from acausal.errors import DeclarationError
from acausal.flatten.connections.connections import (
    FlowSet,
    Joint,
    SignalJoint,
    check_signals,
    flow_sets,
    joints,
    refuse_open,
)
from acausal.flatten.connections.idle import idle_components
from acausal.flatten.connections.orientation import spanning_tree
from acausal.flatten.connections.signals import (
    ElementJoint,
    Entry,
    Signal,
    cut_equations,
    cut_joints,
    element_equations,
    element_joints,
    freed_signals,
    input_scalars,
    open_inputs,
)
from acausal.flatten.delays import delays
from acausal.flatten.discrete import asserts, assignments, check_assigned, constancy, fill_starts, places
from acausal.flatten.flat import (
    FlatAssert,
    FlatAssignment,
    FlatComponent,
    FlatEquation,
    FlatStart,
    FlatSystem,
    FlatWhen,
)
from acausal.flatten.instances.instances import Instance, numbers, placed
from acausal.flatten.instances.statements import Statement, refuse_unstated, run, statements
from acausal.flatten.parameters import (
    ParameterTable,
    check_bound,
    check_overrides,
    check_values,
    foreign,
    given_values,
    refuse_time,
    unheard_parameters,
)
from acausal.flatten.pool import IMPULSE, Pool
from acausal.flatten.scalars.scalarise import (
    Scalars,
    Template,
    allocate,
    make_template,
    replay,
    scalars,
    sides,
    template_key,
)
from acausal.language.choices import Choice
from acausal.language.component import Component, Connector
from acausal.language.connections.connect import Connection
from acausal.language.declarations.declaration import Fixed, Guess, Kind
from acausal.language.events import Reset, When
from acausal.language.expressions.expression import Equation, Expr, Symbol, assigned
from acausal.language.statement import Origin


def flatten(
    model: Component,
    parameters: Mapping[str, object] | None = None,
    choices: Mapping[str, Choice] | None = None,
) -> FlatSystem:
    """The flat system of a model.

    Parameters
    ----------
    model
        The outermost component.
    parameters
        Values by path, in SI; they replace values and bindings of the model.
    choices
        Structure of each component that can have several, by path; by default it has all contacts that can ever occur.

    Raises
    ------
    DeclarationError, UnitError, UsageError, StructureError
        With the path of the faulty component and its place in the source; AC028 if `model` is not a component.
    """
    overrides, (all_instances, added) = given_values(parameters), placed(model, choices)
    check_overrides(overrides, all_instances)
    pool, number_of = Pool(), numbers(all_instances)
    composites = {i.number: statements(i.component) for i in all_instances if not i.is_leaf}
    leaves = _LeafStatements([i for i in all_instances if i.number not in composites])
    connected = _connections({**composites, **leaves.connecting()})
    physical, signals = joints(connected, number_of)
    check_signals(all_instances, signals)
    cut = freed_signals(model, all_instances)
    elements = [j for j in element_joints(all_instances, connected, signals, number_of) if j.sink[:2] not in cut]
    signals = cut_joints(signals, cut)
    tree = spanning_tree(all_instances, physical, number_of)
    variables = allocate(pool, all_instances, physical, signals, tree.cut)
    free = ParameterTable(pool, all_instances, number_of, overrides)
    builder = _Builder(pool, all_instances, number_of, free, open_inputs(all_instances[0], cut))
    builder.slopes()  # before counting scalars: rules for derivatives may add unknowns
    n_scalars, table = pool.n_variables, tuple(free.table())
    equations = builder.leaf_equations(leaves) + builder.composite_equations(composites)
    equations = cut_equations(pool, all_instances, equations, cut)
    inputs = input_scalars(all_instances, builder.open)
    discrete = places(all_instances, inputs)
    equations += constancy(pool, discrete) + builder.inputs(signals, elements)
    check_assigned(builder.assignments, builder.whens, discrete, inputs)
    junctions = flow_sets(all_instances, physical)
    refuse_open(all_instances, junctions)
    cuts = [physical[k] for k in sorted(tree.cut)]
    equations += builder.flow_equations(junctions) + builder.residuals(cuts)
    starts, surplus = builder.starts()
    initial = builder.initial_equations() + surplus
    fill_starts(pool, starts, discrete)
    delayed = delays(pool, [*equations, *initial], *builder.clauses) if pool.delays else ()
    demands = [a for a in builder.asserts if pool.is_constant(a.condition)]
    flat = FlatSystem(
        name=type(model).__name__,
        pool=pool,
        n_scalars=n_scalars,
        variables=tuple(variables),
        parameters=table,
        equations=tuple(equations),
        initial_equations=tuple(initial),
        whens=tuple(builder.whens),
        assignments=tuple(builder.assignments),
        asserts=tuple(a for a in builder.asserts if a not in demands),
        demands=tuple(demands),
        inputs=inputs,
        parameter_values=tuple(free.values),
        starts=starts,
        delays=delayed,
        undelayed=tuple(pool.undelayed),
        experiment=type(model).experiment,
        components={i.path: FlatComponent(type(i.component), i.origin) for i in all_instances},
        loops=tree.loops,
        notes=(*added, *_cuts(all_instances, cuts), *idle_components(pool, all_instances, junctions, equations)),
    )
    check_values(flat, flat.parameter_values)
    _finish(all_instances)
    if choices or not overrides:  # with choices, a parameter may matter in another structure of the model
        return flat
    return replace(flat, notes=(*flat.notes, *unheard_parameters(flat, overrides)))


def _finish(instances: Sequence[Instance]) -> None:
    """Refuse statements that nobody has yielded, and break the cycles of owners and parts.

    These would stay in memory while garbage collection is paused.
    """
    refuse_unstated([i.component for i in instances])
    for instance in instances:
        instance.parts.clear()


def _connections(stated: Mapping[int, Sequence[Statement]]) -> list[tuple[int, Connection, Origin]]:
    """All connections with the number of the component that states them."""
    return [
        (number, item, origin)
        for number, items in stated.items()
        for item, origin in items
        if isinstance(item, Connection)
    ]


def _cuts(all_instances: Sequence[Instance], cut: Sequence[Joint]) -> list[str]:
    return [f"loop of frames cut between {all_instances[j.a].path} and {all_instances[j.b].path}" for j in cut]


class _LeafStatements:
    """Statements of leaf components, generated once per template, after the roles of frames are known."""

    def __init__(self, leaves: Sequence[Instance]) -> None:
        self.leaves = [i for i in leaves if hasattr(type(i.component), "equations")]
        self._early: dict[int, list[Statement]] = {}
        self._keys: dict[int, object] = {}
        self._with_connections: set[type[Component]] = set()

    def connecting(self) -> dict[int, list[Statement]]:
        """Statements of leaf components that connect their own connectors, which excludes templates and `ties`."""
        checked: dict[object, bool] = {}
        for leaf in self.leaves:
            cls = type(leaf.component)
            if hasattr(cls, "ties") or len(leaf.parts) + len(cls._declarations) < 2:
                continue
            key = self._keys[leaf.number] = template_key(leaf)
            if key is None or checked.get(key, True):
                items = statements(leaf.component)
                connects = any(isinstance(item, Connection) for item, _ in items)
                if key is not None:
                    checked[key] = connects
                    if not connects:
                        self._early[leaf.number] = items
                if connects:
                    self._with_connections.add(cls)
                    self._early[leaf.number] = items
        return {k: v for k, v in self._early.items() if any(isinstance(item, Connection) for item, _ in v)}

    def of(self, leaf: Instance) -> list[Statement]:
        """Statements of one leaf."""
        early = self._early.get(leaf.number)
        if early is not None:
            return early
        items = statements(leaf.component)
        for item, origin in items:
            if isinstance(item, Connection) and hasattr(type(leaf.component), "ties"):
                raise DeclarationError(
                    "AC130",
                    f"{leaf.path or type(leaf.component).__name__} has `ties` and connects its own connectors",
                    where=(origin.span(),),
                    help="make the connection in the component that owns it",
                )
        return items

    def key(self, leaf: Instance) -> object:
        """Template key of a leaf; None for one that states connections, which cannot be a template."""
        if type(leaf.component) in self._with_connections:
            return None
        early_key = self._keys.get(leaf.number)
        # The roles of frames are part of the key, and were not yet known when it was first computed.
        return (
            early_key
            if early_key and not any("_roles" in p.component.__dict__ for p in leaf.parts)
            else template_key(leaf)
        )


@dataclass
class _Builder:
    pool: Pool
    found: Sequence[Instance]
    number_of: dict[int, int]
    table: ParameterTable
    open: frozenset[Signal] = frozenset()
    whens: list[FlatWhen] = field(default_factory=list)
    assignments: list[FlatAssignment] = field(default_factory=list)
    asserts: list[FlatAssert] = field(default_factory=list)

    @property
    def clauses(self) -> tuple[list[FlatWhen], list[FlatAssignment], list[FlatAssert]]:
        """The statements besides equations that have been collected so far."""
        return self.whens, self.assignments, self.asserts

    def resolve(self, symbol: Symbol) -> Scalars:
        number = self.number_of.get(id(symbol.owner))
        if number is None:
            raise foreign(symbol)
        instance = self.found[number]
        first = instance.first.get(symbol.name)
        if first is None:
            return self.table.nodes(instance, symbol.name)
        return self.pool.vars(range(first, first + prod(symbol.shape)))

    def all(self, instance: Instance, items: Sequence[Statement]) -> list[FlatEquation]:
        """Equations of a component without a template; also collects its clauses, discrete equations and assertions."""
        self.whens += self.when(instance, items)
        self.assignments += assignments(self.pool, instance, items, self.resolve)
        self.asserts += asserts(self.pool, instance, items, self.resolve)
        return self.direct(
            instance, [(item, o) for item, o in items if isinstance(item, Equation) and assigned(item) is None]
        )

    def direct(self, instance: Instance, items: Sequence[Statement]) -> list[FlatEquation]:
        """Equations of a component without a template, with symbols resolved in the whole model."""
        done: dict[int, Scalars] = {}
        return [
            FlatEquation(left, right, origin, instance.path, item, k)
            for item, origin in items
            if isinstance(item, Equation)
            for k, (left, right) in enumerate(sides(self.pool, item, self.resolve, done, origin))
        ]

    def when(self, instance: Instance, items: Sequence[Statement]) -> list[FlatWhen]:
        """The `when` clauses of a component, one for each branch."""
        done: dict[int, Scalars] = {}
        clauses = []
        for item, origin in ((item, origin) for item, origin in items if isinstance(item, When)):
            earlier: tuple[int, ...] = ()
            for branch in (item, *item.branches):
                conditions = tuple(scalars(self.pool, c, self.resolve, done)[0] for c in branch.conditions)
                actions = tuple(pair for a in branch.actions for pair in self.action(a, done))
                source = replace(branch, branches=())
                clauses.append(FlatWhen(conditions, earlier, actions, origin, instance.path, source, branch.terminate))
                earlier += conditions
        return clauses

    def action(self, reset: Reset, done: dict[int, Scalars]) -> list[tuple[int, int]]:
        """(Scalar, node of its new value) for each entry of a `reset`.

        For an impulse, the scalar is that of the force, and the node contains the velocity before and after it.
        """
        values = scalars(self.pool, reset.value, self.resolve, done)
        targets = scalars(self.pool, reset.target, self.resolve, done)
        if reset.by is not None:
            values = tuple(self.pool.make(IMPULSE, *pair) for pair in zip(targets, values, strict=True))
            targets = scalars(self.pool, reset.by, self.resolve, done)
        return [(int(self.pool.nodes[t][1]), value) for t, value in zip(targets, values, strict=True)]

    def leaf_equations(self, leaves: _LeafStatements) -> list[FlatEquation]:
        """Equations of leaf components, replayed from a template where one exists."""
        templates: dict[object, Template | None] = {}
        equations: list[FlatEquation] = []
        for leaf in leaves.leaves:
            key = leaves.key(leaf)
            if key is not None and key not in templates:
                templates[key] = make_template(leaf, leaves.of(leaf))
            template = templates.get(key)
            if template is None:
                equations += self.all(leaf, leaves.of(leaf))
            else:
                stated, demanded = replay(template, leaf, self.pool, self.table.nodes)
                equations += stated
                self.asserts += demanded
        return equations

    def composite_equations(self, stated: Mapping[int, Sequence[Statement]]) -> list[FlatEquation]:
        """Equations of components with parts, by their numbers."""
        return [e for number, items in stated.items() for e in self.all(self.found[number], items)]

    def slopes(self) -> None:
        """Enter the derivatives of overconstrained variables in the pool, once per set of connected frames."""
        classes = {type(instance.component) for instance in self.found}
        stating: dict[type, Any] = {c: getattr(c, "rates", None) for c in classes if issubclass(c, Connector)}
        for instance in self.found if any(stating.values()) else ():
            cls = type(instance.component)
            if not stating.get(cls):
                continue
            for equation, _ in run(instance.component, cls.__name__, "rates", stating[cls]):
                variable = equation.left.args[0]
                nodes = self.resolve(variable)
                if self.pool.nodes[nodes[0]][1] in self.pool.slope:
                    break
                right = scalars(self.pool, equation.right, self.resolve, {})
                for node, slope in zip(nodes, right, strict=True):
                    self.pool.slope[self.pool.nodes[node][1]] = slope

    def residuals(self, cut: Sequence[Joint]) -> list[FlatEquation]:
        """Equations that close a cut loop."""
        equations: list[FlatEquation] = []
        for joint in cut:
            a, b = self.found[joint.a], self.found[joint.b]
            method = type(a.component).residuals  # type: ignore[attr-defined]
            items = run(a.component, type(a.component).__name__, "residuals", method, b.component)
            for item, _ in items:
                for left, right in sides(self.pool, item, self.resolve, {}):
                    equations.append(FlatEquation(left, right, joint.origin, self.found[joint.by].path, item))
        return equations

    def inputs(self, signals: Sequence[SignalJoint], joints: Sequence[ElementJoint]) -> list[FlatEquation]:
        """Equations of bindings and of connected elements of signals; discrete ones are collected as assignments."""
        driven = {end for j in signals for end in (j.a, j.b) if end[0] != j.by}
        bound = self.bindings(driven, {j.sink for j in joints})
        equations, assigned = element_equations(self.pool, self.found, joints)
        self.assignments += assigned
        return bound + equations

    def bindings(self, connected: set[tuple[int, str]], elements: set[Entry]) -> list[FlatEquation]:
        """Equations that bind variables and inputs to the expressions given in constructors; collects discrete ones.

        `connected` are the signals that their owners connect, `elements` the connected entries. A component that
        connects its own input to something reads it, which does not count as driving it.
        """
        equations: list[FlatEquation] = []
        for instance in self.found:
            for name, value in instance.component.__dict__["_values"].items():
                declaration = instance.component._declarations[name]
                if declaration.kind is Kind.PARAMETER or isinstance(value, Fixed | Guess):
                    continue
                if (instance.number, name) in self.open:
                    continue
                connected_entries = {
                    k for k in range(prod(declaration.shape)) if (instance.number, name, k) in elements
                }
                is_driven = (instance.number, name) in connected or bool(connected_entries)
                is_given = name in instance.component.__dict__["_given"]
                if is_driven and declaration.kind is Kind.INPUT and not is_given and not connected_entries:
                    continue  # the connection replaces a declared default
                if is_driven and declaration.kind is Kind.INPUT and is_given:
                    raise DeclarationError(
                        "AC137",
                        f"input {instance.prefix}{name} is both bound to `{value}` and connected",
                        where=(instance.origin.span(),),
                        help="remove one of the two",
                    )
                check_bound(instance, name, value)
                right = scalars(self.pool, value, self.resolve, {})
                text = f"{instance.prefix}{name} == {value}"
                for k, node in enumerate(right):
                    if k in connected_entries:
                        continue
                    scalar = instance.first[name] + k
                    if declaration.discrete:
                        self.assignments.append(FlatAssignment(scalar, node, instance.origin, instance.path, text))
                        continue
                    left = self.pool.var(scalar)
                    equations.append(FlatEquation(left, node, instance.origin, instance.path, text))
        return equations

    def flow_equations(self, sets: Sequence[FlowSet]) -> list[FlatEquation]:
        """Flows of a junction sum to zero."""
        pool = self.pool
        equations: list[FlatEquation] = []
        for flow_set in sets:
            first = self.found[flow_set.members[0][0]]
            names = [(n, d, d.shape) for n, d in first.component._declarations.items() if d.kind is Kind.FLOW]
            shown = [self.found[m].path for m, _ in flow_set.members[:4]]
            more = f" and {len(flow_set.members) - 4} more" if len(flow_set.members) > 4 else ""
            owner = first.owner
            component = owner.path if owner else ""
            origin: Origin | None = flow_set.origin or (owner.origin if owner else None)
            for name, _, shape in names:
                text = f"the {name} of {', '.join(shown)}{more} " + (
                    "sum to zero" if len(flow_set.members) > 1 else "is zero: not connected"
                )
                for k in range(prod(shape)):
                    total = pool.zero
                    for member, sign in flow_set.members:
                        node = pool.var(self.found[member].first[name] + k)
                        total = pool.add(total, node) if sign > 0 else pool.sub(total, node)
                    equations.append(FlatEquation(total, pool.zero, origin, component, text))
        return equations

    def initial_equations(self) -> list[FlatEquation]:
        """The start equations of all instances."""
        return [
            equation
            for instance in self.found
            if hasattr(type(instance.component), "initial_equations")
            for equation in self.direct(instance, statements(instance.component, "initial_equations"))
        ]

    def starts(self) -> tuple[dict[int, FlatStart], list[FlatEquation]]:
        """Declared starts by scalar; a fixed one has priority over guesses of connected potentials.

        If connected potentials are fixed twice, the second start becomes an initial equation and must agree with the
        first.
        """
        starts: dict[int, FlatStart] = {}
        surplus: list[FlatEquation] = []
        for instance in self.found:
            for name, given in instance.component.__dict__["_values"].items():
                # The default of an open input of the model is its value unless data are given.
                is_default = (instance.number, name) in self.open and isinstance(given, Expr) and given.op == "const"
                value = Guess(given) if is_default else given
                if not isinstance(value, Fixed | Guess):
                    continue
                expr: Expr = value.value
                resolve = partial(self.table.symbol, user=f"the start of {instance.prefix}{name}")
                origin = instance.origin_of_value(name)
                refuse_time(f"the start of {instance.prefix}{name}", expr, origin)
                check_bound(instance, name, expr)
                nodes = scalars(self.pool, expr, resolve, {})
                for k, node in enumerate(nodes):
                    scalar = instance.first[name] + k
                    start = FlatStart(node, isinstance(value, Fixed), origin, instance.prefix + name)
                    other = starts.get(scalar)
                    if other is not None and other.is_fixed and start.is_fixed:
                        text = f"{start.path} == {expr}"
                        left = self.pool.var(scalar)
                        surplus.append(FlatEquation(left, node, instance.origin, instance.path, text))
                    elif other is None or start.is_fixed:
                        starts[scalar] = start
        return starts, surplus
