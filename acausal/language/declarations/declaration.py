"""What is known of a declared name, and of the component that declares it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any, ClassVar


class Kind(Enum):
    """What a declared name is to the compiler."""

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
    """A start value that only starts Newton's method."""

    value: Any


Start = Fixed | Guess


@dataclass(frozen=True, eq=False)
class Declaration:
    """Everything said about one name, except its value.

    `default` is a number, a nested tuple, a function of the instance (`lambda self: sin(self.sigma)`), a
    `Fixed` or a `Guess`, or None. `prefer_state` ranks candidates for states: True before undeclared before False.
    `hint` is printed when the compiler cannot determine the variable. `monotone_above` is a value from which on the
    equations rise or fall steadily with the variable, along a curve that bends to one side: where they are nonlinear in
    it, the compiler solves them inside the equations instead of leaving an algebraic variable. A `discrete` variable
    keeps its value between events; of these, `boolean` ones are true or false and `integer` ones count. Where `sized`
    is a function of the instance, each instance has a declaration of its own with the shape that it returns.
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
        """What instances have whose `sized` gives this shape: one object for all of them."""
        made: dict[tuple[int, ...], Declaration] = self.__dict__.setdefault("_made", {})
        found = made.get(shape)
        if found is None:
            found = made[shape] = replace(self, shape=shape, sized=None)
            if "_home" in self.__dict__:
                object.__setattr__(found, "_home", (*self.__dict__["_home"], shape))
        return found

    def belongs_to(self, cls: type[Owner], name: str) -> None:
        """Remember the class whose body this stands in: as a class, a declaration is pickled by its name."""
        object.__setattr__(self, "_home", (cls, name))

    def __reduce__(self) -> Any:
        home = self.__dict__.get("_home")
        return super().__reduce_ex__(2) if home is None else (_declaration_of, home)


def _declaration_of(cls: type[Owner], name: str, shape: tuple[int, ...] | None = None) -> Declaration:
    found = cls._declarations[name]
    return found if shape is None else found.of_shape(shape)


class Owner:
    """What a component is to its declarations: `Component` is the one subclass."""

    _declarations: ClassVar[dict[str, Declaration]] = {}
    _classes: ClassVar[dict[str, type[Owner] | None]]
    _is_named_right: ClassVar[bool]
    _is_sized: ClassVar[bool] = False

    def _path_to(self, name: str) -> str:
        """Path of a field as seen from the outermost owner, or from that of what was pickled, for messages."""
        names = [name]
        here: Owner = self
        while here.__dict__["_owner"] is not None:
            here, own_name = here.__dict__["_owner"]
            names.append(own_name)
        if "_stood" in here.__dict__:
            names.append(here.__dict__["_stood"])
        return ".".join(reversed(names))

    def _refuse_unmade(self) -> None:
        """Refuse what a constructor of its own has left without all that a component is (AC109)."""
        raise NotImplementedError
