"""Fields that hold components: lists of them, and references to enclosing ones by `outer(World)` as in Modelica.

While a component is being composed, its surroundings are not yet known. Until they are, a stand-in provides symbols of
the quantities of an outer component, for `build` and for defaults; the flattener binds it to the actual component.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Generic, Literal, SupportsIndex, TypeVar

from acausal.errors import DeclarationError, UnknownFieldError
from acausal.language.declarations.declaration import Kind, Owner


class Parts(list[Any]):
    """Type of `self.masses` after `self.masses = [...]`.

    Raises
    ------
    DeclarationError
        AC103 for an index out of range, AC118 if a part is replaced after `build`, AC127 if a field of the members is
        read from the list.
    """

    __slots__ = ("_name", "_owner")

    def __init__(self, members: list[Any], owner: Owner, name: str) -> None:
        super().__init__(members)
        self._owner = owner
        self._name = name

    def _description(self) -> str:
        count = f"{len(self)} {type(self[0]).__name__}" if self else "no parts"
        return f"`{self._owner._path_to(self._name)}` is a list of {count}"

    def __getitem__(self, index: SupportsIndex | slice) -> Any:
        try:
            return super().__getitem__(index)
        except (IndexError, TypeError):
            shown = index if isinstance(index, int) else repr(index)
            last = len(self) - 1
            raise DeclarationError(
                "AC103",
                f"{self._description()}; it has no element [{shown}]",
                evidence=[] if last >= 0 else self._counts(),
                help=f"indices count from 0: [0 to {last}]"
                if last >= 0
                else "give a value with which `build` makes at least one part, or state the equations without them",
            ) from None

    def _counts(self) -> list[str]:
        """A line with the whole numbers of the owner, on which the number of parts depends."""
        declared = self._owner._declarations.items()
        numbers = {n: self._owner.__dict__.get(n) for n, d in declared if d.kind is Kind.STRUCTURAL}
        shown = ", ".join(f"{n}={value}" for n, value in numbers.items() if isinstance(value, int))
        return [f"{type(self._owner).__name__} has {shown}"] if shown else []

    def __setitem__(self, index: SupportsIndex | slice, value: Any) -> None:
        if not self._owner.__dict__["_building"]:
            raise DeclarationError(
                "AC118",
                f"{self._description()}; none of them can be replaced after `build`",
                help=f"make it where the list is made: self.{self._name} = [...]",
            )
        super().__setitem__(index, value)

    if not TYPE_CHECKING:  # otherwise type checkers would accept every misspelt method

        def __getattr__(self, name: str) -> Any:
            if name.startswith("__") or not hasattr(type(self[0]) if self else None, "_declarations"):
                raise AttributeError(name)
            raise UnknownFieldError(
                "AC127",
                f"{self._description()}; the list has no field '{name}'",
                help=f"take one of them, self.{self._name}[0].{name}, or go through them with `for`",
            )


Around = TypeVar("Around", bound=Owner)


@dataclass(frozen=True, eq=False)
class Outer(Generic[Around]):
    """Declaration made by `outer`: the class of the enclosing component, and the default that is added if needed."""

    cls: type[Around]
    default: Around | None
    doc: str


def outer(cls: type[Around], *, default: Around | None = None, doc: str = "", init: Literal[False] = False) -> Around:
    """The nearest enclosing component of class `cls`: a part of the owner, or of the owner's owner, and so on.

    It is declared as a field, `world: World = outer(World)`, and read like a part: `self.world.g_0`. If an owner has
    several parts of the class, the one with the name of the field is used. If there is none at all, `default` is added
    to the model under the name of the field; without a default this is an error.

    `init` is for type checkers: an outer component is not given to the constructor.

    Raises
    ------
    DeclarationError
        When the model is flattened: AC188 when there is none, AC189 when several match.
    """
    if not (isinstance(cls, type) and issubclass(cls, Owner)):
        shown = type(cls).__name__
        raise DeclarationError(
            "AC112", f"outer takes a class of components, not {cls!r} ({shown})", help="world: World = outer(World)"
        )
    declaration: Any = Outer(cls, default, doc)
    return declaration  # type: ignore[no-any-return]
