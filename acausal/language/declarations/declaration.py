"""Declarations of names in class bodies, and the base class of the components that hold them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any, ClassVar, NoReturn

from acausal.errors import DeclarationError


class Kind(Enum):
    """Role of a declared name for the compiler."""

    VARIABLE = "variable"
    FLOW = "flow"
    PARAMETER = "parameter"
    INPUT = "input"
    OUTPUT = "output"
    STRUCTURAL = "structural"
    PART = "part"


@dataclass(frozen=True)
class Fixed:
    """A start value that is an equation of the initial system."""

    value: Any


@dataclass(frozen=True)
class Guess:
    """A start value that is only the initial guess of Newton's method."""

    value: Any


Start = Fixed | Guess


@dataclass(frozen=True, eq=False)
class Declaration:
    """Attributes of one declared name, except its value.

    `default` is a number, a nested tuple, a function of the instance (`lambda self: sin(self.sigma)`), a `Fixed` or a
    `Guess`, or None. `prefer_state` ranks candidates for states: True before undeclared before False. `hint` is printed
    if the compiler cannot determine the variable. `monotone_above` promises that the residual of the equation for the
    variable is monotone and convex or concave above this value: if the equation is nonlinear, the compiler then solves
    it inside the equations by a safeguarded Newton iteration instead of leaving an algebraic variable. A `discrete`
    variable is constant between events; `boolean` ones are true or false, `integer` ones whole numbers. If `sized` is a
    function of the instance, each instance has its own declaration with the shape that it returns.
    """

    kind: Kind
    shape: tuple[int, ...] = ()
    unit: str = ""
    doc: str = ""
    default: Any = None
    nominal: float = 1.0
    min: float = -math.inf
    max: float = math.inf
    prefer_state: bool | None = None
    hint: str = ""
    monotone_above: float | None = None
    overconstrained: bool = False
    discrete: bool = False
    boolean: bool = False
    integer: bool = False
    sized: Callable[[Any], Any] | None = None

    def of_shape(self, shape: tuple[int, ...]) -> Declaration:
        """This declaration with a shape returned by `sized`; all instances of that shape share one object."""
        by_shape: dict[tuple[int, ...], Declaration] = self.__dict__.setdefault("_made", {})
        sized_declaration = by_shape.get(shape)
        if sized_declaration is None:
            sized_declaration = by_shape[shape] = replace(self, shape=shape, sized=None)
            if "_home" in self.__dict__:
                object.__setattr__(sized_declaration, "_home", (*self.__dict__["_home"], shape))
        return sized_declaration

    def belongs_to(self, cls: type[Owner], name: str) -> None:
        """Store the class that declares it, because a declaration is pickled by name, like a class."""
        object.__setattr__(self, "_home", (cls, name))

    def __reduce__(self) -> Any:
        home = self.__dict__.get("_home")
        return super().__reduce_ex__(2) if home is None else (_declaration_of, home)


def _no_operand(declaration: Declaration, *_: object) -> NoReturn:
    raise DeclarationError(
        "AC110",
        f"a {declaration.kind.value} has no value in the class body",
        help="a default is computed from other fields by a function: default=lambda self: 2 * self.x",
    )


for _name in ("neg", "abs", *(side + name for name in ("add", "sub", "mul", "truediv", "pow") for side in ("", "r"))):
    setattr(Declaration, f"__{_name}__", _no_operand)


def _declaration_of(cls: type[Owner], name: str, shape: tuple[int, ...] | None = None) -> Declaration:
    declaration = cls._declarations[name]
    return declaration if shape is None else declaration.of_shape(shape)


class Owner:
    """Base of `Component`, its only subclass, for modules that `component.py` imports."""

    _declarations: ClassVar[dict[str, Declaration]] = {}
    _classes: ClassVar[dict[str, type[Owner] | None]]
    _is_named_right: ClassVar[bool]
    _is_sized: ClassVar[bool] = False

    def _path_to(self, name: str) -> str:
        """Path of a field from the outermost owner, for messages; a part that was pickled keeps its former path."""
        names = [name]
        component: Owner = self
        while component.__dict__["_owner"] is not None:
            component, own_name = component.__dict__["_owner"]
            names.append(own_name)
        if "_stood" in component.__dict__:
            names.append(component.__dict__["_stood"])
        return ".".join(reversed(names))

    def _refuse_unmade(self) -> None:
        """Raise DeclarationError AC109 for an instance whose own `__init__` did not call that of `Component`."""
        raise NotImplementedError
