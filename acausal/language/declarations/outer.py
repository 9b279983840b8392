"""`outer(World)`: a reference to an enclosing component, as Modelica's inner and outer.

While a model is being composed its surroundings are unknown. Until then a stand-in provides symbols of its quantities,
for `build` and for defaults; the flattener binds it to the actual component.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Generic, Literal, TypeVar

from acausal.language.declarations.declaration import Owner

Around = TypeVar("Around", bound=Owner)


@dataclass(frozen=True, eq=False)
class Outer(Generic[Around]):
    """Declaration made by `outer`: the class of the enclosing component, and the default added if there is none."""

    cls: type[Around]
    default: Around | None
    doc: str


def outer(cls: type[Around], *, default: Around | None = None, doc: str = "", init: Literal[False] = False) -> Around:
    """The nearest enclosing component of class `cls`: a part of the owner, or of the owner's owner, and so on.

    It is declared as a field, `world: World = outer(World)`, and read like a part: `self.world.g_0`. If an owner has
    several parts of the class, the one with the name of the field is taken. If there is none at all, `default` is added
    to the model under the name of the field; without a default that is an error.

    `init` is for type checkers: an outer component is not given to the constructor.

    Raises
    ------
    DeclarationError
        When the model is flattened: AC188 when there is none, AC189 when several match.
    """
    declaration: Any = Outer(cls, default, doc)
    return declaration  # type: ignore[no-any-return]
