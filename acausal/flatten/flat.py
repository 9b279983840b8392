"""The flat system: every scalar variable, parameter and equation of a model, with names and places in the source."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import NamedTuple

from acausal.errors import Span
from acausal.flatten.pool import Pool
from acausal.language.component import Component, Connector
from acausal.language.declarations.declaration import Declaration
from acausal.language.declarations.experiment import Experiment
from acausal.language.declarations.misuse import Declared
from acausal.language.events import Assertion, When
from acausal.language.expressions.arrays import one_of
from acausal.language.expressions.expression import Equation, Symbol, equation_text, symbols_in
from acausal.language.review import Reviewing, is_reviewing
from acausal.language.statement import Origin


class FlatVariable(NamedTuple):
    """A declared variable: its entries are the scalars `first ... first + size - 1`, row-major.

    Connected potentials are one scalar with several FlatVariables: they share `first`.
    """

    path: str
    declaration: Declaration
    first: int
    size: int


class FlatParameter(NamedTuple):
    """A declared parameter: one node per entry, a ("par", k) if it is free, an expression if it is bound.

    A parameter that is bound to just another parameter has the nodes of that one and is not free.
    """

    path: str
    declaration: Declaration
    nodes: tuple[int, ...]
    free: bool


class FlatEquation(NamedTuple):
    """`left == right` between scalar nodes; `source` is the language equation, or a text for a generated one.

    For an equation between vectors or matrices, `entry` is the row-major index of this scalar equation.
    """

    left: int
    right: int
    origin: Origin | None
    component: str
    source: Equation | str
    entry: int = 0


class FlatComponent(NamedTuple):
    """A component of the instance tree: its class, and the place in the source where it is constructed."""

    cls: type[Component]
    origin: Origin

    @property
    def is_connector(self) -> bool:
        """True for pins, flanges, frames."""
        return issubclass(self.cls, Connector)


class FlatLoop(NamedTuple):
    """A closed loop of frames: the two frames between which it was cut, and the components along the loop."""

    ends: tuple[str, str]
    origin: Origin
    components: tuple[str, ...]


class FlatWhen(NamedTuple):
    """One branch of a `when`: its actions (scalar, node of its new value) and conditions.

    The actions are taken when one of the nodes `conditions` becomes true, unless one of `earlier`, the conditions of
    the branches before it, becomes true at the same instant. If `terminate` is a message, the run ends there.
    """

    conditions: tuple[int, ...]
    earlier: tuple[int, ...]
    actions: tuple[tuple[int, int], ...]
    origin: Origin
    component: str
    source: When
    terminate: str | None = None


class FlatAssignment(NamedTuple):
    """A discrete equation: at events, and only there, the discrete `scalar` takes the value of `node`."""

    scalar: int
    node: int
    origin: Origin | None
    component: str
    source: Equation | str
    entry: int = 0


class FlatAssert(NamedTuple):
    """A condition that must hold throughout a run; `level` is "error" or "warning"."""

    condition: int
    message: str
    level: str
    origin: Origin
    component: str
    source: Assertion


class FlatDelay(NamedTuple):
    """The value of node `source` at the current time minus `time`; `most` bounds a varying delay.

    Its index in `FlatSystem.delays` is the number in `Delayed` nodes.
    """

    source: int
    time: int
    most: int | None
    label: str
    origin: Origin | None
    component: str


class FlatStart(NamedTuple):
    """A declared start of one scalar: an initial equation when `is_fixed`, else a guess."""

    node: int
    is_fixed: bool
    origin: Origin | Declared | None
    path: str


@dataclass(frozen=True, eq=False)
class FlatSystem:
    """A flat model, made by `flatten`.

    Attributes
    ----------
    name
        Class name of the model.
    pool
        The scalar expressions; variables 0 ... n-1 come first, derivatives after them.
    variables, parameters
        In the order of declaration, depth first.
    equations, initial_equations
        Scalar equations with their origin.
    whens
        `when` clauses, one for each branch.
    assignments
        Discrete equations, at most one per scalar. The scalar also has the equation der(d) == 0 among `equations`.
    asserts, demands
        Conditions that must hold throughout a run, and conditions of the parameters alone.
    inputs
        Scalar variables of the unconnected inputs of the model itself.
    parameter_values
        Value of each free parameter scalar.
    starts
        Declared starts by scalar variable.
    components
        Every component by its path; the model itself has the path "".
    loops
        Closed loops of frames that were cut.
    notes
        Facts that the user should see, for example connections cut in closed loops.
    frozen
        Names of parameter scalars that were replaced by constants (`acausal.reduce.freeze`).
    nominals
        Magnitude of each scalar before parameters were frozen, empty if none were: frozen zeros turn variables into
        aliases, which must not change tolerances.
    delays
        Delayed signals.
    undelayed
        Delays that are zero for the values of the parameters: node of the delay, and its text.
    """

    name: str
    pool: Pool
    n_scalars: int
    variables: tuple[FlatVariable, ...]
    parameters: tuple[FlatParameter, ...]
    equations: tuple[FlatEquation, ...]
    initial_equations: tuple[FlatEquation, ...]
    whens: tuple[FlatWhen, ...]
    assignments: tuple[FlatAssignment, ...]
    asserts: tuple[FlatAssert, ...]
    demands: tuple[FlatAssert, ...]
    inputs: tuple[int, ...]
    parameter_values: tuple[float, ...]
    starts: Mapping[int, FlatStart]
    experiment: Experiment
    components: Mapping[str, FlatComponent]
    loops: tuple[FlatLoop, ...] = ()
    notes: tuple[str, ...] = ()
    frozen: tuple[str, ...] = ()
    nominals: tuple[float, ...] = ()
    delays: tuple[FlatDelay, ...] = ()
    undelayed: tuple[tuple[int, str], ...] = ()

    def __repr__(self) -> str:
        return (
            f"FlatSystem({self.name}: {len(self.equations)} equations, {self.n_scalars} variables, "
            f"{len(self.parameter_values)} parameters)"
        )

    @cached_property
    def owner(self) -> dict[int, FlatVariable]:
        """The first declared variable of each scalar."""
        owners: dict[int, FlatVariable] = {}
        for v in self.variables:
            _, _, first, size = v
            for k in range(first, first + size):
                owners.setdefault(k, v)
        return owners

    @cached_property
    def reviewing(self) -> dict[str, type[Reviewing]]:
        """Classes of the components that look back on runs, by path."""
        classes: dict[type, type[Reviewing]] = {
            cls: cls for cls in {c.cls for c in self.components.values()} if is_reviewing(cls)
        }
        return {path: classes[c.cls] for path, c in self.components.items() if c.cls in classes} if classes else {}

    def declaration(self, scalar: int) -> Declaration:
        """Declaration of a scalar; of the integrated variable for a derivative."""
        while scalar in self.pool.integral_of:
            scalar = self.pool.integral_of[scalar]
        return self.owner[scalar].declaration

    def scalar_name(self, scalar: int) -> str:
        """`path`, `path[i]`, `path[i,j]`, or `der(...)` of these."""
        if scalar in self.pool.integral_of:
            return f"der({self.scalar_name(self.pool.integral_of[scalar])})"
        variable = self.owner[scalar]
        return variable.path + suffix(variable.declaration.shape, scalar - variable.first)

    def text(self, equation: FlatEquation | FlatAssignment) -> str:
        """The equation as the modeller wrote it, with the names of the component to which it belongs.

        Equal components share one language equation, which contains the names of the first of them.
        """
        source = equation.source
        if isinstance(source, str):
            return source
        source = one_of(source, equation.entry)
        written_for = _written_for(source)
        here = self.components.get(equation.component)
        if written_for is None or here is None or type(written_for) is not here.cls:
            return str(source)
        old = written_for._path_to("")
        new = equation.component + "." if equation.component else ""

        def name_of(symbol: Symbol) -> str:
            path: str = symbol.owner._path_to(symbol.name)
            return new + path.removeprefix(old)

        return equation_text(source, name_of)

    @cached_property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the free parameter scalars."""
        names = [""] * len(self.parameter_values)
        for p in self.parameters:
            if p.free:
                for suffix, node in zip(suffixes(p.declaration.shape), p.nodes, strict=True):
                    op, *number = self.pool.nodes[node]
                    if op == "par":  # single entries may be frozen
                        names[number[0]] = p.path + suffix
        return tuple(names)

    @cached_property
    def parameters_in_use(self) -> frozenset[int]:
        """Nodes of the parameters that an equation, a start, an event or a condition depends on."""
        roots = [n for e in (*self.equations, *self.initial_equations) for n in (e.left, e.right)]
        for w in self.whens:
            roots += [*w.conditions, *w.earlier, *(n for _, n in w.actions)]
        roots += [a.node for a in self.assignments]
        roots += [a.condition for a in (*self.asserts, *self.demands)]
        roots += [s.node for s in self.starts.values()]
        roots += [n for d in self.delays for n in (d.source, d.time, d.most) if n is not None]
        roots += [n for n, _ in self.undelayed]
        return frozenset(n for n in self.pool.reachable(roots) if self.pool.nodes[n][0] == "par")

    @cached_property
    def limited(self) -> tuple[tuple[int, FlatParameter, int], ...]:
        """Entries of bound parameters with limits: (node, parameter, index of the entry), without duplicates."""
        unique: dict[tuple[int, int], tuple[int, FlatParameter, int]] = {}
        for p in self.parameters:
            if not p.free and (p.declaration.min > -math.inf or p.declaration.max < math.inf):
                for k, node in enumerate(p.nodes):
                    unique.setdefault((node, id(p.declaration)), (node, p, k))
        return tuple(unique.values())


def _written_for(equation: Equation) -> Component | None:
    """The component whose symbols, or those of its connectors, an equation contains exclusively; None if none."""
    component: Component | None = None
    for symbol in symbols_in(equation.left, equation.right):
        owner: Component = symbol.owner
        if isinstance(owner, Connector) and owner.__dict__["_owner"] is not None:
            owner = owner.__dict__["_owner"][0]
        if component is not None and owner is not component:
            return None
        component = owner
    return component


def suffixes(shape: tuple[int, ...]) -> list[str]:
    """`[""]` for a scalar, `["[0]", "[1]", ...]` for a vector, `["[0,0]", ...]` for a matrix."""
    if not shape:
        return [""]
    return ["[" + ",".join(map(str, index)) + "]" for index in product(*(range(n) for n in shape))]


def suffix(shape: tuple[int, ...], entry: int) -> str:
    """`suffixes(shape)[entry]`, without building the list."""
    index = []
    for n in reversed(shape):
        entry, k = divmod(entry, n)
        index.append(str(k))
    return "[" + ",".join(reversed(index)) + "]" if shape else ""


def span_of(equation: FlatEquation | FlatAssignment) -> tuple[Span, ...]:
    """Place of an equation in the source, as a tuple for `AcausalError.where`; empty if it is unknown."""
    return () if equation.origin is None else (equation.origin.span(),)


def translated(flat: FlatSystem, pool: Pool, image: Mapping[int, int]) -> FlatSystem:
    """The flat system with the images of its nodes in another pool."""

    def equations(old: Sequence[FlatEquation]) -> tuple[FlatEquation, ...]:
        return tuple(e._replace(left=image[e.left], right=image[e.right]) for e in old)

    def parameter(p: FlatParameter) -> FlatParameter:
        nodes = tuple(image[n] for n in p.nodes)
        return p._replace(nodes=nodes, free=p.free and any(pool.nodes[n][0] == "par" for n in nodes))

    return replace(
        flat,
        pool=pool,
        equations=equations(flat.equations),
        initial_equations=equations(flat.initial_equations),
        whens=tuple(
            w._replace(
                conditions=tuple(image[n] for n in w.conditions),
                earlier=tuple(image[n] for n in w.earlier),
                actions=tuple((s, image[n]) for s, n in w.actions),
            )
            for w in flat.whens
        ),
        assignments=tuple(a._replace(node=image[a.node]) for a in flat.assignments),
        asserts=tuple(a._replace(condition=image[a.condition]) for a in flat.asserts),
        demands=tuple(a._replace(condition=image[a.condition]) for a in flat.demands),
        parameters=tuple(map(parameter, flat.parameters)),
        starts={s: start._replace(node=image[start.node]) for s, start in flat.starts.items()},
        delays=tuple(
            d._replace(source=image[d.source], time=image[d.time], most=None if d.most is None else image[d.most])
            for d in flat.delays
        ),
        undelayed=tuple((image[n], words) for n, words in flat.undelayed),
    )


def with_variables(flat: FlatSystem, count: int) -> tuple[FlatSystem, dict[int, int]]:
    """(Flat system with `count` additional scalars, which the caller declares; map from old nodes to new ones)."""
    old, pool, n = flat.pool, Pool(), flat.n_scalars

    def number(variable: int) -> int:
        return variable if variable < n else variable + count

    pool.new_variables(old.n_variables + count)
    pool.derivative_of.update((number(x), number(dx)) for x, dx in old.derivative_of.items())
    pool.integral_of.update((number(dx), number(x)) for dx, x in old.integral_of.items())
    pool.parameter_values = old.parameter_values
    image = {k: pool.var(number(node[1])) for k, node in enumerate(old.nodes) if node[0] == "var"}
    pool.copy(old, range(len(old.nodes)), image)
    pool.slope.update((number(v), image[node]) for v, node in old.slope.items())
    pool.delays = [(image[s], image[t], None if m is None else image[m], words) for s, t, m, words in old.delays]
    pool.undelayed = [(image[node], words) for node, words in old.undelayed]
    return replace(translated(flat, pool, image), n_scalars=n + count), image
