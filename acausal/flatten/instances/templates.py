"""Equations of a component class, generated once and replayed for every equal instance.

For ten thousand resistors the generator runs once: instances of one class with the same structural values have the same
equations up to the numbers of their variables. This decides the cost per scalar equation.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, partial
from typing import Any

from acausal.errors import DeclarationError
from acausal.flatten.flat import FlatAssert, FlatEquation
from acausal.flatten.instances.instances import Instance, numbers
from acausal.flatten.instances.statements import Statement
from acausal.flatten.parameters import ParameterTable
from acausal.flatten.pool import Pool
from acausal.flatten.scalars.differentiate import differentiate
from acausal.flatten.scalars.scalarise import Scalars, layout, scalars
from acausal.language.declarations.declaration import Kind
from acausal.language.events import Assertion
from acausal.language.expressions.expression import Equation, Symbol, assigned, symbols_in
from acausal.language.statement import Origin

# Constructs a FlatEquation in a third of the time of its Python constructor, which counts for every equation.
_EQUATION = partial(tuple.__new__, FlatEquation)


@dataclass(frozen=True, eq=False)
class Template:
    """Equations over local numbers: variables of the component and its connectors, then its parameters.

    `leaves` are the nodes of all variables, derivatives last, and then those of the entries of all parameters.
    """

    pool: Pool
    n_local: int
    parameters: tuple[str, ...]
    leaves: tuple[int, ...]
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


def make_template(instance: Instance, found: Sequence[Statement]) -> Template | None:
    """The template of a leaf component from the statements of one instance: equations, and assertions on parameters.

    None for clauses, discrete equations, delays, and symbols of other components: a function given as structural value
    may close over the parameters of the owner.
    """
    number_of = numbers((instance, *instance.parts))
    for item, _ in found:
        if not isinstance(item, Equation) or assigned(item) is not None:
            return None
        if any(id(s.owner) not in number_of for s in symbols_in(item.left, item.right)):
            return None
    pool = Pool()
    first: dict[tuple[int, str], int] = {}
    n_local = 0
    for part in (instance, *instance.parts):
        for name, _, size in layout(part.component):
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
            size = max(1, _size(symbol))
            return nodes[start : start + size]
        if symbol.name not in position:
            parameters.append(symbol.name)
            position[symbol.name] = tuple(pool.par(count + k) for k in range(_size(symbol)))
            count += _size(symbol)
        return position[symbol.name]

    done: dict[int, Scalars] = {}
    equations = [
        (left, right, origin, item, k)
        for item, origin in found
        if isinstance(item, Equation)
        for k, (left, right) in enumerate(sides(pool, item, resolve, done, origin))
    ]
    demands = [
        (scalars(pool, item.condition, resolve, done)[0], origin, item)
        for item, origin in found
        if isinstance(item, Assertion)
    ]
    if pool.delays or pool.undelayed or not all(pool.is_constant(condition) for condition, *_ in demands):
        return None
    leaves = *pool.vars(range(pool.n_variables)), *(node for name in parameters for node in position[name])
    return Template(pool, n_local, tuple(parameters), leaves, tuple(equations), tuple(demands))


def _size(symbol: Symbol) -> int:
    size = 1
    for n in symbol.shape:
        size *= n
    return size


def sides(
    pool: Pool, equation: Equation, resolve: object, done: dict[int, Scalars], origin: Origin | None = None
) -> list[tuple[int, int]]:
    """The scalar equations of a language equation as pairs of nodes; `origin` is the place named in errors."""
    try:
        left = scalars(pool, equation.left, resolve, done)  # type: ignore[arg-type]
        right = scalars(pool, equation.right, resolve, done)  # type: ignore[arg-type]
    except DeclarationError as error:
        if origin is not None:
            made = error.where if error.code == "AC131" else ()
            error.where = (origin.span(), *made)
            error.evidence = error.evidence or (str(equation),)
        raise
    size = max(len(left), len(right))
    if len(left) < size:
        left = left * size
    if len(right) < size:
        right = right * size
    return list(zip(left, right, strict=True))


def replay(
    template: Template, instance: Instance, pool: Pool, table: ParameterTable
) -> tuple[list[FlatEquation], list[FlatAssert]]:
    """The equations of `instance` in the pool of the model, and its assertions on parameters."""
    numbers_of: list[int] = []
    for part in (instance, *instance.parts):
        first = part.first
        for name, _, size in layout(part.component):
            numbers_of += range(first[name], first[name] + size)
    variables = list(pool.vars(numbers_of))
    local = template.pool
    for number in range(template.n_local, local.n_variables):
        variables.append(differentiate(pool, variables[local.integral_of[number]]))
    parameters = [node for name in template.parameters for node in table.nodes(instance, name)]
    image = dict(zip(template.leaves, (*variables, *parameters), strict=True))
    pool.copy(local, range(len(local.nodes)), image)
    path = instance.path
    demands = [FlatAssert(image[c], a.message, a.level, origin, path, a) for c, origin, a in template.demands]
    stated = template.equations
    return [_EQUATION((image[a], image[b], origin, path, e, k)) for a, b, origin, e, k in stated], demands
