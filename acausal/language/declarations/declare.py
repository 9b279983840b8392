"""Declarations of fields: the right-hand sides of `name: Real = ...` in class bodies."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable
from functools import wraps
from numbers import Real as Number
from types import NoneType
from typing import Any, TypeVar, cast, overload

from acausal.errors import DeclarationError, UnitError, calling_span, nearest
from acausal.language.declarations.declaration import Declaration, Fixed, Guess, Kind, Owner
from acausal.language.expressions.expression import (
    Expr,
    Operand,
    Operation,
    Shape,
    Symbol,
    as_expr,
    is_condition,
    is_truth,
    nodes,
    shape_text,
)
from acausal.units import declared, format_dimension, parse

Sizes = Shape | int | Callable[[Any], Shape | int]
"""A shape, or a function of the component that returns one."""

Function = TypeVar("Function", bound=Callable[..., Any])
# Names of the argument `default` in other tools, for a hint.
_NAMES_OF_DEFAULT = ("start", "value", "init", "initial", "fixed", "guess")


_TYPES: dict[str, tuple[tuple[type, ...], str]] = {
    **dict.fromkeys(("unit", "doc", "hint"), ((str,), "a text")),
    **dict.fromkeys(("nominal", "min", "max"), ((Number,), "one number")),
    "monotone_above": ((Number, NoneType), "one number"),
    "prefer_state": ((bool, NoneType), "True or False"),
    "overconstrained": ((bool,), "True or False"),
}
"""Types of the arguments of declarations, and their description in messages."""


def _by_keyword(function: Function) -> Function:
    """Make unknown and positional arguments a DeclarationError AC110 that lists the arguments."""

    @wraps(function)
    def declared_by(*given: Any, **named: Any) -> Any:
        if given or named.keys() - arguments:
            wrong = next((name for name in named if name not in arguments), "")
            raise _wrong_argument(function.__name__, list(arguments), wrong)
        for name, value in named.items():
            if name in _TYPES:
                _check_argument(function.__name__, name, value)
        return function(**named)

    arguments = inspect.signature(function).parameters.keys()
    return cast(Function, declared_by)


def _check_argument(kind: str, name: str, value: Any) -> None:
    types, description = _TYPES[name]
    if not isinstance(value, types) or (isinstance(value, bool) and bool not in types):
        several = " for all elements" if isinstance(value, list | tuple) else ""
        raise DeclarationError(
            "AC110",
            f"{kind}: {name} is {value!r}, not {description}",
            where=calling_span(),
            help=f"give {description}{several}, or leave it out",
        )


def _wrong_argument(kind: str, names: list[str], wrong: str) -> DeclarationError:
    accepted = f"{kind} takes {', '.join(names)}"
    if not wrong:
        return DeclarationError("AC110", f"{kind} takes its arguments by name", where=calling_span(), help=accepted)
    advice = f"did you mean {', '.join(close)}? {accepted}" if (close := nearest(wrong, names)) else accepted
    if wrong in _NAMES_OF_DEFAULT and "default" in names:
        starts = kind in ("variable", "signal_output")
        advice = f"write {'default=fixed(...) or default=guess(...)' if starts else 'default=...'}; {accepted}"
    return DeclarationError("AC110", f"{kind} has no argument '{wrong}'", where=calling_span(), help=advice)


def fixed(value: Operand) -> Fixed:
    """A start value that is an initial equation, as Modelica's `start` with `fixed = true`."""
    return Fixed(value)


def guess(value: Operand) -> Guess:
    """A start value that is the initial guess for consistent initialisation; no equation. Modelica's `start`."""
    return Guess(value)


def _declare(kind: Kind, *, unit: str, shape: Sizes = (), **rest: Any) -> Any:
    if unit:
        declared(unit)
    low, high, nominal = rest.get("min", -math.inf), rest.get("max", math.inf), rest.get("nominal", 1.0)
    if not low <= high:
        raise DeclarationError("AC110", f"min={low:g} is above max={high:g}", help="swap the two, or leave out a limit")
    if not 0.0 < nominal < math.inf:
        raise DeclarationError(
            "AC110", f"nominal={nominal:g} is no magnitude", help="give the typical size of the variable: nominal=1e-3"
        )
    return Declaration(kind, unit=unit, **_sizes(shape), **rest)


@_by_keyword
def variable(
    *,
    unit: str = "",
    doc: str = "",
    shape: Sizes = (),
    default: Any = None,
    nominal: float = 1.0,
    min: float = -math.inf,
    max: float = math.inf,
    prefer_state: bool | None = None,
    hint: str = "",
    monotone_above: float | None = None,
    overconstrained: bool = False,
) -> Any:
    """An unknown of the model; in a connector, a potential: equal in all connected connectors.

    `min` and `max` are no constraints: a run that leaves them goes on and says so in a note.
    """
    return _declare(Kind.VARIABLE, **locals())


@_by_keyword
def discrete(*, unit: str = "", doc: str = "", shape: Sizes = (), default: Any = None, nominal: float = 1.0) -> Any:
    """A variable that is constant between events; `when(..., reset(x, value))` changes it. Starts at 0.

    An equation with the variable alone on its left assigns it too: `yield self.n == where(...)`.
    """
    return _held(default, shape, doc, unit=unit, nominal=nominal)


@_by_keyword
def boolean(*, default: Any = None, shape: Sizes = (), doc: str = "") -> Any:
    """A variable that is true or false and changes at events only; it can be used as a condition.

    An equation assigns it, `yield self.on == (self.x > 1)`, or a `when(..., reset(self.on, True))`. `default` is its
    value before the start, False if not given.
    """
    return _held(default, shape, doc, boolean=True)


@_by_keyword
def integer(*, default: Any = None, shape: Sizes = (), doc: str = "") -> Any:
    """An integer variable that changes at events only; assigned like a `boolean`. Starts at 0."""
    return _held(default, shape, doc, integer=True)


@_by_keyword
def boolean_input(*, default: Any = None, shape: Sizes = (), doc: str = "") -> Any:
    """A signal that is true or false; connect it to a `boolean_output`, or bind it to a condition."""
    return Declaration(Kind.INPUT, **_sizes(shape), doc=doc, default=default, discrete=True, boolean=True)


@_by_keyword
def boolean_output(*, shape: Sizes = (), doc: str = "") -> Any:
    """A signal that is true or false; `yield self.y == condition` computes it."""
    return Declaration(Kind.OUTPUT, **_sizes(shape), doc=doc, discrete=True, boolean=True)


def _held(default: Any, shape: Sizes, doc: str, unit: str = "", **rest: Any) -> Any:
    """A discrete variable, which starts at 0 if no default is given."""
    start = Fixed(0.0) if default is None else default
    start = start if isinstance(start, Fixed | Guess) or callable(start) else Fixed(start)
    kept: dict[str, Any] = {"default": start, "prefer_state": True, "discrete": True, **rest}
    return _declare(Kind.VARIABLE, unit=unit, shape=shape, doc=doc, **kept)


def _sizes(shape: Sizes) -> dict[str, Any]:
    return {"sized": shape} if callable(shape) else {"shape": checked_shape(shape)}


def checked_shape(shape: Shape | int, owner: str = "") -> Shape:
    """A shape as a tuple: (3,) for `3`; `owner` is the declared name, for the error.

    Raises DeclarationError: AC105 for an invalid shape.
    """
    sizes = shape if isinstance(shape, tuple | list) else (shape,)
    if len(sizes) > 2 or not all(isinstance(n, int) and n > 0 for n in sizes):
        raise DeclarationError(
            "AC105",
            f"{owner + ': ' if owner else ''}shape={shape!r} is no shape",
            help="shape=3 declares a vector, shape=(3, 3) a matrix, shape=lambda self: self.n a vector whose length is "
            "the structural n; leave it out for a scalar",
        )
    return tuple(sizes)


@_by_keyword
def flow(*, unit: str = "", doc: str = "", shape: Sizes = (), nominal: float = 1.0, hint: str = "") -> Any:
    """A connector variable that sums to zero over a connection, positive into the component."""
    return _declare(Kind.FLOW, **locals())


@_by_keyword
def signal_input(
    *,
    unit: str = "",
    doc: str = "",
    shape: Sizes = (),
    default: Any = None,
    nominal: float = 1.0,
    min: float = -math.inf,
    max: float = math.inf,
    hint: str = "",
) -> Any:
    """A signal the component reads; connect it to a `signal_output`, or bind it in the constructor.

    In the outermost component it is an input of the model: `simulate(inputs={...})`. There a number as `default` is its
    value without data, values outside `min ... max` are refused, and optimal control uses these bounds.
    """
    return _declare(Kind.INPUT, **locals())


@_by_keyword
def signal_output(
    *,
    unit: str = "",
    doc: str = "",
    shape: Sizes = (),
    nominal: float = 1.0,
    monotone_above: float | None = None,
) -> Any:
    """A signal that the component computes; connect it to a `signal_input`."""
    return _declare(Kind.OUTPUT, **locals())


@_by_keyword
def parameter(
    *,
    default: Any = None,
    unit: str = "",
    doc: str = "",
    shape: Sizes = (),
    nominal: float = 1.0,
    min: float = -math.inf,
    max: float = math.inf,
) -> Any:
    """A value that is constant during a run. It is a symbol to the compiler: a new value needs no recompilation.

    `default` may be a function of the instance: `parameter(default=lambda self: self.d / 2)`.
    """
    return _declare(Kind.PARAMETER, **locals())


@_by_keyword
def structural(*, default: Any = None, doc: str = "") -> Any:
    """A Python value (int, bool, str, tuple, function) on which the equations depend; a new value recompiles."""
    return Declaration(Kind.STRUCTURAL, doc=doc, default=default)


@_by_keyword
def part(*, doc: str = "") -> Any:
    """A component, or a list of components, created in `build`, unless one is given to the constructor."""
    return Declaration(Kind.PART, doc=doc)


class Real:
    """Type of a declared quantity: reads as an expression; accepts a number, an expression or a start value."""

    def __init__(self, name: str, declaration: Declaration) -> None:
        self.name = name
        self.declaration = declaration

    @overload
    def __get__(self, instance: None, owner: type[Any]) -> Declaration: ...
    @overload
    def __get__(self, instance: Owner, owner: type[Any]) -> Expr: ...
    def __get__(self, instance: Owner | None, owner: type[Any]) -> Declaration | Expr:
        if instance is None:
            return self.declaration
        if "_symbols" not in instance.__dict__:
            instance._refuse_unmade()
        symbols: dict[str, Symbol] = instance.__dict__["_symbols"]
        found = symbols.get(self.name)
        if found is None:
            found = symbols[self.name] = Symbol(instance, self.name, self._declaration_for(instance))
        return found

    def _declaration_for(self, instance: Owner) -> Declaration:
        """The declaration for an instance, with its shape."""
        declaration = self.declaration if self.declaration.sized is None else instance._declarations[self.name]
        if declaration.sized is not None:
            path = instance._path_to(self.name)
            raise DeclarationError(
                "AC187",
                f"`{path}` is not known yet: its shape is known once the component around it is",
                help="read it in `equations` only, not in `build`, in defaults and in other shapes",
            )
        return declaration

    def __set__(self, instance: Owner, value: float | Expr | Fixed | Guess | tuple[Any, ...] | list[Any]) -> None:
        instance.__dict__["_values"][self.name] = checked_value(
            type(instance).__name__, self.name, self._declaration_for(instance), value
        )


def checked_value(owner: str, name: str, declaration: Declaration, value: Any) -> Any:
    """Check and convert a value: Expr for parameters and bindings, Fixed or Guess of an Expr for starts.

    Raises DeclarationError AC105, AC110, AC111, AC147; UnitError AC151.
    """
    kind = declaration.kind
    if isinstance(value, Fixed | Guess):
        if kind in (Kind.PARAMETER, Kind.STRUCTURAL):
            raise DeclarationError(
                "AC110",
                f"{owner}: {kind.value} '{name}' takes a value, not a start",
                help=f"{owner}({name}=...) without fixed() and guess(): they are for variables",
            )
        return type(value)(_fitting(owner, name, declaration, value.value))
    if isinstance(value, str) or value is None:
        unit = f" in {declaration.unit}" if declaration.unit else ""
        raise DeclarationError(
            "AC111",
            f"{owner}: {kind.value} '{name}' cannot be {value!r}",
            help=f"give a number{unit}, or an expression"
            + ("; values with units are for the command line" if isinstance(value, str) else ""),
        )
    expr = _fitting(owner, name, declaration, value)
    is_number = not isinstance(value, Expr) or value.op == "quantity"
    if kind in (Kind.VARIABLE, Kind.FLOW, Kind.OUTPUT) and is_number and expr.op == "const":
        return Fixed(expr)
    return expr


def _fitting(owner: str, name: str, declaration: Declaration, value: Any) -> Expr:
    expr = as_expr(value)
    if expr.op == "quantity":
        expr = _in_unit(owner, name, declaration, expr)
    if expr.shape != declaration.shape:
        if expr.op == "const" and expr.shape == ():
            size = math.prod(declaration.shape)
            return Operation("const", (), declaration.shape, (expr.payload,) * size)
        raise DeclarationError(
            "AC105",
            f"{owner}: '{name}' is a {shape_text(declaration.shape)}, the value `{expr}` a {shape_text(expr.shape)}",
            help="a single number fills a vector or a matrix; anything else needs its shape",
        )
    check_discrete(f"{owner}: '{name}'", declaration, expr)
    return expr


def _in_unit(owner: str, name: str, declaration: Declaration, given: Expr) -> Expr:
    """The number of a `quantity`, checked against the declared unit."""
    dimension = parse(given.payload[1]).dimension
    if declaration.unit and dimension != parse(declaration.unit).dimension:
        raise UnitError(
            "AC151",
            f"{owner}: '{name}' is in {declaration.unit}, `{given}` in {format_dimension(dimension)}",
            help=f"give a number in {declaration.unit}, or a quantity of its dimension",
        )
    return given.args[0]


def check_discrete(name: str, declaration: Declaration, value: Expr) -> None:
    """Refuse values that a boolean or an integer cannot have.

    Raises DeclarationError: AC147 when a boolean would be neither true nor false, or an integer a fraction.
    """
    numbers = value.payload if isinstance(value.payload, tuple) else (value.payload,)
    if declaration.boolean:
        is_truth_value = value.op == "const" and set(numbers) <= {0.0, 1.0}
        parts = value.args if value.op == "stack" else (value,)
        if not is_truth_value and not all(is_condition(e) or is_truth(e) or _is_choice(e) for e in parts):
            raise DeclarationError(
                "AC147",
                f"{name} is boolean, `{value}` is a number",
                help="write a relation such as x > 0, or True or False",
            )
    elif declaration.integer and value.op == "const" and not all(float(v).is_integer() for v in numbers):
        raise DeclarationError(
            "AC147", f"{name} is an integer, `{value}` is not", help="declare it with discrete() for other numbers"
        )


def _is_choice(e: Expr) -> bool:
    """Whether an expression is a possibly nested `where` whose values are all true or false."""
    values = nodes(e, into=lambda n: n.args[1:] if n.op == "where" else ())
    return all(n.op == "where" or is_truth(n) or is_condition(n) for n in values)
