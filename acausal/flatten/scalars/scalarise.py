"""Scalarisation: language expressions with vectors and matrices become scalar pool nodes in row-major order.

Scalars are allocated here, too: connected potentials share one variable, every other unknown has its own.

Instances of one class with the same structural values have the same equations up to the numbers of their variables.
Their equations are therefore generated once, as a `Template`, and replayed for every equal instance: for ten thousand
resistors the generator runs once. This determines the cost per scalar equation.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, partial
from itertools import product
from typing import Any

from acausal.errors import DeclarationError
from acausal.flatten.connections.connections import Joint, SignalJoint, UnionFind
from acausal.flatten.flat import FlatAssert, FlatEquation, FlatVariable
from acausal.flatten.instances.instances import Instance, numbers
from acausal.flatten.instances.statements import Statement
from acausal.flatten.pool import Pool
from acausal.flatten.scalars.differentiate import differentiate
from acausal.language.component import Component, Connector
from acausal.language.declarations.declaration import Declaration, Kind
from acausal.language.events import Assertion
from acausal.language.expressions.conditions import is_discrete
from acausal.language.expressions.expression import Equation, Expr, Symbol, assigned, is_condition, symbols_in
from acausal.language.expressions.external import Call
from acausal.language.statement import Origin

Scalars = tuple[int, ...]
Resolve = Callable[[Symbol], Scalars]
# Constructs a FlatEquation in a third of the time of its Python constructor, which matters as there are so many.
_EQUATION = partial(tuple.__new__, FlatEquation)
_COMMON = range(len(Pool().nodes))  # nodes that every pool has


def scalars(pool: Pool, root: Expr, resolve: Resolve, done: dict[int, Scalars]) -> Scalars:
    """Nodes of the entries of `root`; `resolve` returns those of a symbol, `done` caches results by `id`.

    The caller must keep the expressions alive as long as it uses `done`.
    """
    stack = [root]
    while stack:
        e = stack[-1]
        key = id(e)
        if key in done:
            stack.pop()
            continue
        missing = [a for a in e.args if id(a) not in done]
        if missing:
            stack.extend(missing)
            continue
        done[key] = _entries(pool, e, resolve, [done[id(a)] for a in e.args])
        stack.pop()
    return done[id(root)]


def sides(
    pool: Pool, equation: Equation, resolve: Resolve, done: dict[int, Scalars], origin: Origin | None = None
) -> list[tuple[int, int]]:
    """The scalar equations of a language equation as pairs of nodes; errors name `origin` as their place."""
    try:
        left = scalars(pool, equation.left, resolve, done)
        right = scalars(pool, equation.right, resolve, done)
    except DeclarationError as error:
        if origin is not None:
            origin_of_symbol = error.where if error.code == "AC131" else ()
            error.where = (origin.span(), *origin_of_symbol)
            error.evidence = error.evidence or (str(equation),)
        raise
    size = max(len(left), len(right))
    if len(left) < size:
        left = left * size
    if len(right) < size:
        right = right * size
    return list(zip(left, right, strict=True))


def _entries(pool: Pool, e: Expr, resolve: Resolve, args: list[Scalars]) -> Scalars:
    op = e.op
    if isinstance(e, Symbol):
        return resolve(e)
    if op == "const":
        values = e.payload if isinstance(e.payload, tuple) else (e.payload,)
        return tuple(pool.const(v) for v in values)
    if op == "time":
        return (pool.time,)
    if op in ("quantity", "unitless"):
        return args[0]
    if op == "neg":
        return tuple(pool.neg(a) for a in args[0])
    if op == "der":
        if is_condition(e.args[0]):
            raise DeclarationError(
                "AC128",
                f"the time derivative of {e.args[0]} is needed and does not exist",
                help="it jumps or is Boolean: keep it out of der(...) and of prescribed positions",
            )
        return tuple(differentiate(pool, a) for a in args[0])
    if op in ("stack", "concatenate"):
        return tuple(a for part in args for a in part)
    if op == "index":
        position = 0
        for i, n in zip(e.payload, e.args[0].shape, strict=True):
            position = position * n + i
        return (args[0][position],)
    if op == "slice":
        return _slice(e, args[0])
    if op == "fill":
        return args[0] * e.shape[0]
    if op == "transpose":
        m, n = e.args[0].shape
        return tuple(args[0][i * n + j] for j, i in product(range(n), range(m)))
    if op == "matmul":
        return _matmul(pool, e, args)
    if op == "cross":
        a, b = args
        return tuple(pool.sub(pool.mul(a[i], b[j]), pool.mul(a[j], b[i])) for i, j in ((1, 2), (2, 0), (0, 1)))
    if op == "call":
        external, output = e.payload
        flat = [a for part in args for a in part]
        return tuple(pool.make(Call(external, k), *flat) for k in external.entries(output))
    if op == "pre":
        # For a continuous expression `pre` is allowed in a `when` only, which evaluates it before any reset.
        return tuple(pool.make("pre", a) for a in args[0]) if is_discrete(e.args[0]) else args[0]
    if op == "delay":
        return _delay(pool, e, args)
    if op in ("edge", "change", "equals"):
        return (_event_comparison(pool, op, [a[0] for a in args], is_condition(e.args[0])),)
    if op == "where":
        conditions = tuple(pool.make("noevent", c) for c in args[0]) if e.payload else args[0]
        size = max(map(len, args))
        columns = [_broadcast(a, size) for a in (conditions, *args[1:])]
        return tuple(pool.where(c, a, b) for c, a, b in zip(*columns, strict=True))
    if not args:
        return (pool.make(op),)
    size = max(len(a) for a in args)
    columns = [_broadcast(a, size) for a in args]
    return tuple(pool.make(op, *operands) for operands in zip(*columns, strict=True))


def _slice(e: Expr, entries: Scalars) -> Scalars:
    indices, _ = e.payload
    if len(indices) == 1:
        return tuple(entries[k] for k in indices[0])
    first, second = (p if isinstance(p, range) else (p,) for p in indices)
    width = e.args[0].shape[1]
    return tuple(entries[i * width + j] for i, j in product(first, second))


def _delay(pool: Pool, e: Expr, args: list[Scalars]) -> Scalars:
    """Delayed entries; constants, and signals with a delay of zero, are returned unchanged."""
    time, most = args[1][0], args[2][0] if len(args) > 2 else None
    if pool.parameter_value(time) == 0.0:
        pool.undelayed.append((time, str(e)))
        return args[0]
    constant = [all(pool.nodes[n][0] in ("const", "par") for n in pool.reachable([a])) for a in args[0]]
    return tuple(
        a if is_constant else pool.delayed(a, time, most, str(e))
        for a, is_constant in zip(args[0], constant, strict=True)
    )


def _event_comparison(pool: Pool, op: str, args: list[int], is_logical: bool) -> int:
    """`edge`, `change` and `equals` as relations and `pre`; integers are equal within one half."""
    a = args[0]
    b = args[1] if op == "equals" else pool.make("pre", a)
    if op == "edge":
        return pool.make("and", a, pool.make("not", b))
    if op == "change" and is_logical:
        return pool.make("or", pool.make("and", a, pool.make("not", b)), pool.make("and", pool.make("not", a), b))
    if op == "change":
        return pool.make("or", pool.make("lt", a, b), pool.make("gt", a, b))
    half = pool.const(0.5)
    below, above = pool.make("lt", a, pool.sub(b, half)), pool.make("gt", a, pool.add(b, half))
    return pool.make("not", pool.make("or", below, above))


def _broadcast(a: Scalars, size: int) -> Scalars:
    return a if len(a) == size else a * size


def _matmul(pool: Pool, e: Expr, args: list[Scalars]) -> Scalars:
    a, b = args
    inner = e.args[0].shape[-1]
    rows, columns = len(a) // inner, len(b) // inner
    return tuple(
        pool.sum(pool.mul(a[i * inner + k], b[k * columns + j]) for k in range(inner))
        for i, j in product(range(rows), range(columns))
    )


Layout = tuple[tuple[str, Declaration, int], ...]
"""Declared quantities with their number of scalars, in order."""


def _layouts(*kinds: Kind) -> Callable[[Component], Layout]:
    def of(owner: Any) -> Layout:
        return tuple((n, d, math.prod(d.shape)) for n, d in owner._declarations.items() if d.kind in kinds)

    of_class: Callable[..., Layout] = cache(of)

    def layout(component: Component) -> Layout:
        """Layout of a class, or of a component whose shapes depend on its structural values."""
        return of(component) if "_declarations" in component.__dict__ else of_class(type(component))

    return layout


unknowns_of = _layouts(Kind.VARIABLE, Kind.FLOW, Kind.INPUT, Kind.OUTPUT)
parameters_of = _layouts(Kind.PARAMETER)


def allocate(
    pool: Pool,
    all_instances: Sequence[Instance],
    physical: Sequence[Joint],
    signals: Sequence[SignalJoint],
    cut: frozenset[int],
) -> list[FlatVariable]:
    """Give every declared unknown its scalars; fills `Instance.first`."""
    plain = UnionFind(len(all_instances))
    for joint in physical:
        plain.union(joint.a, joint.b)
    oriented = UnionFind(len(all_instances)) if cut else plain
    for k, joint in enumerate(physical if cut else ()):
        if k not in cut:
            oriented.union(joint.a, joint.b)
    shared_signals = _signal_representatives(signals)
    variables: list[FlatVariable] = []
    count = pool.n_variables
    flat_variable = partial(tuple.__new__, FlatVariable)  # takes a third of the time of its Python constructor
    for instance in all_instances:
        unknowns = unknowns_of(instance.component)
        if not unknowns:
            continue
        first = instance.first
        number = instance.number
        prefix = instance.prefix
        is_connector = isinstance(instance.component, Connector)
        for name, declaration, size in unknowns:
            if is_connector and declaration.kind is Kind.VARIABLE:
                sets = oriented if declaration.overconstrained else plain
                source = all_instances[sets.find(number)]
                start = source.first[name] if source is not instance else count
            elif (number, name) in shared_signals:
                other, other_name = shared_signals[number, name]
                shared = all_instances[other].first
                start = shared.setdefault(other_name, count)
            else:
                start = count
            count = max(count, start + size)
            first[name] = start
            variables.append(flat_variable((prefix + name, declaration, start, size)))
    pool.new_variables(count - pool.n_variables)
    return variables


def _signal_representatives(signals: Sequence[SignalJoint]) -> dict[tuple[int, str], tuple[int, str]]:
    index: dict[tuple[int, str], int] = {}
    for joint in signals:
        index.setdefault(joint.a, len(index))
        index.setdefault(joint.b, len(index))
    ends = list(index)
    sets = UnionFind(len(ends))
    for joint in signals:
        sets.union(index[joint.a], index[joint.b])
    return {end: ends[sets.find(k)] for end, k in index.items()}


@dataclass(frozen=True, eq=False)
class Template:
    """Equations of a component over local numbers of its variables, those of its connectors, and its parameters.

    `leaves` are nodes that all pools have in common, then those of all variables, derivatives last, then those of the
    entries of all parameters; `inner` are the other nodes.
    """

    pool: Pool
    n_local: int
    parameters: tuple[str, ...]
    leaves: tuple[int, ...]
    inner: tuple[int, ...]
    equations: tuple[tuple[int, int, Origin, Equation, int], ...]
    demands: tuple[tuple[int, Origin, Assertion], ...]


def template_key(instance: Instance) -> object:
    """A key that is equal for instances with the same equations; None if it cannot be hashed."""
    component = instance.component
    values = component.__dict__
    given = tuple([values[n] for n in _structural(type(component))])
    parts = [p.component for p in instance.parts]
    roles = tuple([tuple(p.__dict__["_roles"].items()) for p in parts if "_roles" in p.__dict__])
    lengths = tuple([len(p) for p in component._parts.values() if isinstance(p, list)])
    around = tuple([id(values[n]) for n in type(component)._outers])
    sizes = tuple([d.shape for d in component._declarations.values()]) if "_declarations" in values else ()
    key = (type(component), given, roles, tuple([type(p) for p in parts]), lengths, around, sizes)
    try:
        hash(key)
    except TypeError:
        return None
    return key


def _structural_names(cls: Any) -> tuple[str, ...]:
    """Names of the structural values of a class."""
    return tuple(n for n, d in cls._declarations.items() if d.kind is Kind.STRUCTURAL)


_structural: Callable[..., tuple[str, ...]] = cache(_structural_names)


def make_template(instance: Instance, items: Sequence[Statement]) -> Template | None:
    """The template of a leaf component from the statements of one instance: equations, and assertions on parameters.

    None for components with clauses, discrete equations, delays, or symbols of other components: a function that is
    given as a structural value may close over the parameters of the owner.
    """
    number_of = numbers((instance, *instance.parts))
    for item, _ in items:
        if not isinstance(item, Equation) or assigned(item) is not None:
            return None
        if any(id(s.owner) not in number_of for s in symbols_in(item.left, item.right)):
            return None
    pool = Pool()
    first: dict[tuple[int, str], int] = {}
    n_local = 0
    for part in (instance, *instance.parts):
        for name, _, size in unknowns_of(part.component):
            first[part.number, name] = n_local
            n_local += size
    pool.new_variables(n_local)
    nodes = pool.vars(range(n_local))
    parameters: list[str] = []
    position: dict[str, Scalars] = {}
    count = 0

    def resolve(symbol: Symbol) -> Scalars:
        nonlocal count
        start = first.get((number_of[id(symbol.owner)], symbol.name))
        if start is not None:
            size = max(1, math.prod(symbol.shape))
            return nodes[start : start + size]
        if symbol.name not in position:
            parameters.append(symbol.name)
            position[symbol.name] = tuple(pool.par(count + k) for k in range(math.prod(symbol.shape)))
            count += math.prod(symbol.shape)
        return position[symbol.name]

    done: dict[int, Scalars] = {}
    equations = [
        (left, right, origin, item, k)
        for item, origin in items
        if isinstance(item, Equation)
        for k, (left, right) in enumerate(sides(pool, item, resolve, done, origin))
    ]
    demands = [
        (scalars(pool, item.condition, resolve, done)[0], origin, item)
        for item, origin in items
        if isinstance(item, Assertion)
    ]
    if pool.delays or pool.undelayed or not all(pool.is_constant(condition) for condition, *_ in demands):
        return None
    leaves = *_COMMON, *pool.vars(range(pool.n_variables)), *(node for name in parameters for node in position[name])
    inner = tuple(n for n in range(len(pool.nodes)) if n not in leaves)
    return Template(pool, n_local, tuple(parameters), leaves, inner, tuple(equations), tuple(demands))


def replay(
    template: Template, instance: Instance, pool: Pool, values: Callable[[Instance, str], Scalars]
) -> tuple[list[FlatEquation], list[FlatAssert]]:
    """The equations of `instance` in the pool of the model, and its assertions on parameters.

    `values` returns the nodes of a parameter of an instance in that pool.
    """
    numbers_of: list[int] = []
    for part in (instance, *instance.parts):
        first = part.first
        for name, _, size in unknowns_of(part.component):
            if size == 1:
                numbers_of.append(first[name])
            else:
                numbers_of += range(first[name], first[name] + size)
    variables = [*_COMMON, *pool.vars(numbers_of)]
    local = template.pool
    for number in range(template.n_local, local.n_variables):
        variables.append(differentiate(pool, variables[len(_COMMON) + local.integral_of[number]]))
    parameters = [node for name in template.parameters for node in values(instance, name)]
    image = dict(zip(template.leaves, (*variables, *parameters), strict=True))
    pool.copy(local, template.inner, image)
    path = instance.path
    demands = [FlatAssert(image[c], a.message, a.level, origin, path, a) for c, origin, a in template.demands]
    stated = template.equations
    return [_EQUATION((image[a], image[b], origin, path, e, k)) for a, b, origin, e, k in stated], demands
