"""Values of parameters: free ones get a number, bound ones become expressions of the parameters they are bound to."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from typing import Any

from acausal.errors import DeclarationError, Span, UnitError, UsageError, listed_names, meant
from acausal.flatten.flat import FlatAssert, FlatParameter, FlatSystem, suffix, suffixes
from acausal.flatten.instances.instances import Instance
from acausal.flatten.pool import Pool
from acausal.flatten.scalars.scalarise import Scalars, parameters_of, scalars
from acausal.language.component import Component
from acausal.language.declarations.declaration import Declaration, Kind
from acausal.language.declarations.misuse import Declared, declared_at
from acausal.language.expressions.dimensions import check_dimensions
from acausal.language.expressions.expression import Equation, Expr, Shape, Symbol, nodes, shape_text
from acausal.language.statement import Origin
from acausal.units import convert

_TINY = 1e-50
"""A positive `min` up to this value means that the parameter must be positive, as with `Modelica.Constants.small`."""


class ParameterTable:
    """Resolves parameters on first use, because they may be bound to expressions of others in any order."""

    def __init__(
        self, pool: Pool, all_instances: Sequence[Instance], number_of: dict[int, int], overrides: Mapping[str, object]
    ) -> None:
        self.pool = pool
        self.instances = all_instances
        self.number_of = number_of
        self.overrides = dict(overrides)
        self.values: list[float] = []
        pool.parameter_values = self.values
        self._nodes: dict[tuple[int, str], Scalars] = {}
        self._free_paths: set[str] = set()
        self._resolving: dict[str, tuple[Expr, Origin | Declared]] = {}

    def table(self) -> list[FlatParameter]:
        """All parameters in the order of declaration; DeclarationError AC133 lists those without a value."""
        declared = [
            (instance, name, d) for instance in self.instances for name, d, _ in parameters_of(instance.component)
        ]
        missing = [
            (instance, name, d)
            for instance, name, d in declared
            if name not in instance.component.__dict__["_values"] and instance.prefix + name not in self.overrides
        ]
        if missing:
            raise _missing(missing)
        return [
            FlatParameter(path := instance.prefix + name, d, self.nodes(instance, name), path in self._free_paths)
            for instance, name, d in declared
        ]

    def nodes(self, instance: Instance, name: str) -> Scalars:
        """Nodes of the entries of one parameter."""
        key = (instance.number, name)
        nodes_of_entries = self._nodes.get(key)
        if nodes_of_entries is None:
            nodes_of_entries = self._nodes[key] = self._resolve(instance, name)
        return nodes_of_entries

    def _resolve(self, instance: Instance, name: str) -> Scalars:
        path = instance.prefix + name
        declaration = instance.component._declarations[name]
        entry_overrides: dict[int, float] = (
            {}
            if not self.overrides
            else {
                k: entries(path + s, (), self.overrides[path + s], declaration.unit)[0]
                for k, s in enumerate(suffixes(declaration.shape))
                if s and path + s in self.overrides
            }
        )
        if path in self.overrides:
            whole = entries(path, declaration.shape, self.overrides[path], declaration.unit)
            return self._free(path, declaration, [entry_overrides.get(k, v) for k, v in enumerate(whole)])
        value: Expr | None = instance.component.__dict__["_values"].get(name)
        if value is None:
            raise _missing([(instance, name, declaration)])
        if value.op == "const":
            numbers: list[float] = list(value.payload) if isinstance(value.payload, tuple) else [value.payload]
            for k, number in entry_overrides.items():
                numbers[k] = number
            return self._free(path, declaration, numbers, instance)
        if entry_overrides:
            names = ", ".join(path + suffix(declaration.shape, k) for k in entry_overrides)
            raise UsageError(
                "AC022",
                f"{names} cannot be set alone: {path} is bound as a whole, to `{value}`",
                where=(instance.origin_of_value(name).span(),),
                help=f"set all of it: parameters={{{path!r}: [...]}}",
            )
        if path in self._resolving:
            raise self._cyclic_binding(path)
        origin = instance.origin_of_value(name)
        refuse_time(path, value, origin)
        check_bound(instance, name, value)
        self._resolving[path] = (value, origin)
        result = scalars(self.pool, value, lambda s: self.symbol(s, path), {})
        del self._resolving[path]
        constants_or_none = [self.pool.value(node) for node in result]
        constants = [v for v in constants_or_none if v is not None]
        # An expression of constants, such as 2 * sqrt(2), is a number: the parameter stays free.
        return (
            self._free(path, declaration, constants, instance) if len(constants) == len(constants_or_none) else result
        )

    def _cyclic_binding(self, path: str) -> DeclarationError:
        names = list(self._resolving)
        names = names[names.index(path) :]
        return DeclarationError(
            "AC134",
            f"parameters are bound in a circle: {' -> '.join([*names, path])}",
            where=[self._resolving[n][1].span() for n in names[:3]],
            evidence=[f"{n} = {self._resolving[n][0]}" for n in names[:6]],
            help="give one of them a number",
        )

    def symbol(self, symbol: Symbol, user: str) -> Scalars:
        """Nodes of a symbol that must be a parameter."""
        number = self.number_of.get(id(symbol.owner))
        if number is None:
            raise foreign(symbol)
        if symbol.declaration.kind is not Kind.PARAMETER:
            path, _, name = user.rpartition(" ")[2].rpartition(".")
            bound = next((i for i in self.instances if i.path == path), self.instances[number])
            raise DeclarationError(
                "AC135",
                f"{user} is bound to {self.instances[number].prefix}{symbol.name}, which varies in time",
                where=(bound.origin_of_value(name).span(),),
                help="bind parameters to parameters; give signals by connect or to a signal_input",
            )
        return self.nodes(self.instances[number], symbol.name)

    def _free(
        self, path: str, declaration: Declaration, values: Sequence[float], instance: Instance | None = None
    ) -> Scalars:
        check_limits(path, declaration, values, instance)
        first = len(self.values)
        self.values.extend(values)
        self._free_paths.add(path)
        return tuple(self.pool.par(first + k) for k in range(len(values)))


def check_limits(
    path: str, declaration: Declaration, values: Sequence[float], instance: Instance | None = None
) -> None:
    """Refuse values outside the declared limits (AC136)."""

    def where() -> Sequence[Span]:
        return () if instance is None else (instance.origin_of_value(path[len(instance.prefix) :]).span(),)

    for ending, value in zip(suffixes(declaration.shape), values, strict=True):
        check_limit(path, ending, declaration, value, where)


def check_limit(
    path: str, suffix: str, declaration: Declaration, value: float, where: Callable[[], Sequence[Span]] = tuple
) -> None:
    """Refuse one entry outside the declared limits (AC136); `suffix` is its index, "" for a scalar."""
    if declaration.min <= value <= declaration.max and not math.isnan(value):
        return
    unit = f" {declaration.unit}" if declaration.unit not in ("", "1") else ""
    if math.isnan(value):
        fault = "is not a number"
    elif value <= 0.0 < declaration.min <= _TINY:
        fault = "is not positive"
    else:
        fault = f"is outside its limits {declaration.min:g} ... {declaration.max:g}"
    raise DeclarationError(
        "AC136",
        f"{path}{suffix} = {value:g}{unit} {fault}",
        where=where(),
        evidence=[f"{path}   {declaration.doc}"] if declaration.doc else [],
        help=f"give {_limits(declaration, unit)}",
    )


def _limits(declaration: Declaration, unit: str) -> str:
    low, high = declaration.min, declaration.max
    if math.isinf(low) and math.isinf(high):
        return "a number"
    if 0.0 < low <= _TINY:
        return "a value greater than 0" + ("" if math.isinf(high) else f", up to {high:g}") + unit
    if math.isinf(high):
        return f"a value of at least {low:g}{unit}"
    return f"a value of at most {high:g}{unit}" if math.isinf(low) else f"a value from {low:g} to {high:g}{unit}"


def check_values(flat: FlatSystem, values: Sequence[float]) -> None:
    """Refuse values of the free parameters, shape (np,), that violate limits of bound ones or an assertion.

    Raises DeclarationError: AC136 for a limit, AC139 for an assertion about parameters alone.
    """
    for node, p, k in flat.limited:
        value, declaration = flat.pool.parameter_value(node, values), p.declaration
        is_rounding = declaration.min == 0.0 and abs(value) < 1e-12 * declaration.nominal
        if not is_rounding and not math.isnan(value):  # a nan is reported by the run, which names the operation
            where = partial(_bound_at, flat, p.path)
            check_limit(p.path, suffix(declaration.shape, k), declaration, value, where)
    for demand in _violated(flat, values, "error"):
        raise _violation(flat, demand, values)


def doubtful_values(flat: FlatSystem, values: Sequence[float]) -> tuple[str, ...]:
    """Warnings of assertions about parameters alone."""
    return tuple(f"{_subject(flat, d)}: {d.message}" for d in _violated(flat, values, "warning"))


def _violated(flat: FlatSystem, values: Sequence[float], level: str) -> list[FlatAssert]:
    of_level = (d for d in flat.demands if d.level == level)
    return [d for d in of_level if flat.pool.parameter_value(d.condition, values) == 0.0]


def _subject(flat: FlatSystem, demand: FlatAssert) -> str:
    kind = flat.components[demand.component].cls.__name__
    return f"{demand.component} ({kind})" if demand.component else kind


def _bound_at(flat: FlatSystem, path: str) -> Sequence[Span]:
    owner, _, name = path.rpartition(".")
    component = flat.components[owner]
    return [component.origin.span()] if owner else declared_at(component.cls, name)


def _violation(flat: FlatSystem, demand: FlatAssert, values: Sequence[float]) -> DeclarationError:
    pool, component = flat.pool, flat.components[demand.component]
    numbers = sorted({pool.nodes[n][1] for n in pool.reachable([demand.condition]) if pool.nodes[n][0] == "par"})
    names = [flat.parameter_names[k] for k in numbers]
    place_of_assertion = demand.origin.span()
    return DeclarationError(
        "AC139",
        f"{_subject(flat, demand)}: {demand.message}",
        where=[
            *([component.origin.span()] if demand.component else []),
            *([] if place_of_assertion.of_library else [place_of_assertion]),
        ],
        evidence=["with " + ", ".join(f"{name} = {values[k]:g}" for k, name in zip(numbers, names, strict=True))],
        help=f"change {' or '.join(names)}",
    )


# What to do instead of setting a value that is no parameter.
_INSTEAD = {
    Kind.STRUCTURAL: "a structural value decides which equations there are: give it where the component is made",
    Kind.PART: "set its parameters one by one, as in {path}.m=...",
    Kind.INPUT: "drive it: inputs={{'{path}': ...}}, or --input {path}=...; --free {path} first if a source drives it",
}


def given_values(parameters: Mapping[str, object] | None) -> dict[str, object]:
    """Values of parameters by their paths, as given; raises UsageError AC023 if they are no dictionary."""
    if parameters is None:
        return {}
    if not isinstance(parameters, Mapping):
        fact = f"parameters is a {type(parameters).__name__}"
        raise UsageError("AC023", fact, help="a dictionary: parameters={'mass.m': 2.0}")
    listed_names("parameters", parameters)
    return dict(parameters)


def check_overrides(overrides: Mapping[str, object], all_instances: Sequence[Instance]) -> None:
    """Refuse values for names that are no parameters (AC020), with the nearest names."""
    if not overrides:
        return
    kinds = {
        instance.prefix + name: d.kind
        for instance in all_instances
        for name, d in instance.component._declarations.items()
    }
    parameters = [n for n, kind in kinds.items() if kind is Kind.PARAMETER]
    for path in overrides:
        if kinds.get(path) is Kind.PARAMETER or _is_entry(path, all_instances):
            continue
        if path in kinds:
            kind = kinds[path]
            help_ = _INSTEAD.get(kind, "give its start value: start={{'{path}': ...}}, or --start {path}=...")
            named = "structural argument" if kind is Kind.STRUCTURAL else kind.value
            fact = f"{path} is {'an' if named[0] in 'aeio' else 'a'} {named}, not a parameter"
            raise UsageError("AC021", fact, help=help_.format(path=path))
        raise UsageError(
            "AC020",
            f"there is no parameter '{path}'",
            evidence=meant(path, parameters),
            help="list them with: acausal info MODEL",
        )


def _is_entry(path: str, all_instances: Sequence[Instance]) -> bool:
    """Whether a path names an entry of a parameter that is a vector or a matrix, such as `d[1]`."""
    base, bracket, _ = path.rpartition("[")
    owner, _, name = base.rpartition(".")
    return bool(bracket) and any(
        declaration.kind is Kind.PARAMETER and path[len(base) :] in suffixes(declaration.shape)
        for instance in all_instances
        if instance.prefix.removesuffix(".") == owner
        if (declaration := instance.component._declarations.get(name)) is not None and declaration.shape
    )


def _missing(parameters: Sequence[tuple[Instance, str, Declaration]]) -> DeclarationError:
    instance, name, _ = parameters[0]
    names = ", ".join(f"{i.prefix}{n}" for i, n, _ in parameters[:4])
    more = f" and {len(parameters) - 4} more" if len(parameters) > 4 else ""
    return DeclarationError(
        "AC133",
        f"parameter {instance.prefix}{name} has no value"
        if len(parameters) == 1
        else f"{len(parameters)} parameters have no value: {names}{more}",
        where=(instance.origin.span(),) if instance.path else (instance.origin_of_value(name).span(),),
        evidence=[f"{i.prefix}{n} [{p.unit or '1'}]   {p.doc}".rstrip() for i, n, p in parameters[:6]],
        help=f"give it where the component is made: {type(instance.component).__name__}({name}=...)",
    )


def refuse_time(user: str, value: Expr, origin_of_value: Origin | Declared) -> None:
    """Raise DeclarationError AC135 when a value that must be constant depends on `time`."""
    if value.op == "time" or (value.args and any(e.op == "time" for e in nodes(value))):
        raise DeclarationError(
            "AC135",
            f"{user} is bound to `{value}`, which varies in time",
            where=(origin_of_value.span(),),
            help="bind parameters and starts to numbers and parameters; give a varying value to a signal_input",
        )


def entries(path: str, shape: Shape, value: object, unit: str) -> tuple[float, ...]:
    """Values of the entries of a variable, row-major, from numbers in `unit` or texts with a unit: 2.5, "25 mm".

    One number fills a vector or a matrix. A matrix is given as rows, or as one list in row-major order.

    Raises UsageError: AC023 for anything else.
    Raises UnitError: AC150 to AC152 for the unit of a text.
    """
    try:
        numbers = _numbers(path, value, unit)
    except (TypeError, ValueError):
        raise UsageError("AC023", f"{path} cannot be {value!r}", help=f"give {_wanted(shape)}") from None
    size = math.prod(shape)
    rows = _rows(value)
    if len(shape) == 2 and len(numbers) == size and rows and rows != [shape[1]] * shape[0]:
        raise UsageError(
            "AC023",
            f"{path} is a {shape_text(shape)}, and rows of {' and '.join(map(str, sorted(set(rows))))} are given",
            help=f"give {shape[0]} rows of {shape[1]} numbers",
        )
    if len(numbers) == size or len(numbers) == 1:
        return numbers if len(numbers) == size else numbers * size
    raise UsageError("AC023", f"{path} takes {_wanted(shape)}, {len(numbers)} were given")


def _numbers(path: str, value: Any, unit: str) -> tuple[float, ...]:
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, list | tuple):
        return tuple(x for v in value for x in _numbers(path, v, unit))
    if isinstance(value, int | float):
        return (float(value),)
    if isinstance(value, str):
        try:
            return (convert(value, unit),)
        except UnitError as error:
            fact = error.fact if error.fact.startswith(path) else f"{path} = {value!r}: {error.fact}"
            raise UnitError(error.code, fact, evidence=error.evidence, cause=error.cause, help=error.help) from None
    raise TypeError


def _rows(value: Any) -> list[int]:
    """Lengths of the rows of nested lists or an array; empty for a number or a list of numbers."""
    value = value.tolist() if hasattr(value, "tolist") else value
    if not isinstance(value, list | tuple):
        return []
    return [len(row) for row in value if isinstance(row, list | tuple)]


def _wanted(shape: Shape) -> str:
    return f"{math.prod(shape)} numbers" if shape else "one number"


def foreign(symbol: Symbol) -> DeclarationError:
    """The error for a symbol of a component that is not part of the model."""
    owner: Component = symbol.owner
    return DeclarationError(
        "AC131",
        f"`{symbol}` belongs to a {type(owner).__name__} that is not part of the model",
        where=(owner.__dict__["_origin"].span(),),
        help="declare it with part(), set it in `build`, and write self.<part>",
    )


def check_bound(instance: Instance, name: str, value: Expr) -> None:
    """Raise UnitError AC155 if the dimensions of `value` and of the field are known and differ."""
    unit = instance.component._declarations[name].unit
    if value.op == "const" or (isinstance(value, Symbol) and value.declaration.unit == unit):
        return
    field: Symbol = getattr(instance.component, name)
    check_dimensions(Equation(field, value), (instance.origin_of_value(name).span(),))


def unheard_parameters(flat: FlatSystem, names: Iterable[str]) -> tuple[str, ...]:
    """Notes on those of the parameters `names`, or entries of them, on which no equation, start or event depends.

    A value given to them changes nothing. Examples are the strength of gravity if its vector has an explicit value, and
    the time constant of a part of a controller that is left out. This is no error, because studies set one parameter
    for many variants, but without a note equal runs could pass for a result.
    """
    requested = {part for name in names for part in (name, name.rpartition("[")[0])}
    return tuple(
        f"{p.path} is set, but nothing in the model depends on it"
        for p in flat.parameters
        if p.path in requested and p.free and flat.parameters_in_use.isdisjoint(p.nodes)
    )
