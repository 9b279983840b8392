"""List of the components of a field, which names that field in errors."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, SupportsIndex

from acausal.errors import DeclarationError, UnknownFieldError
from acausal.language.declarations.declaration import Owner


class Parts(list[Any]):
    """Type of `self.masses` after `self.masses = [...]`.

    Raises
    ------
    DeclarationError
        AC103 for an index out of range, AC118 for a part replaced after `build`, AC127 for a field of the members that
        is read from the list.
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
                help="`build` makes its parts" if last < 0 else f"indices count from 0: [0 to {last}]",
            ) from None

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
