"""`outer(World)`: a component that stands somewhere around, as Modelica's inner and outer.

While recipes are made nobody knows what will be around them. Until then a stand-in takes its place: expressions of its
quantities can be written, in `build` and in defaults; the flattener knows whom it stands for.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Generic, Literal, TypeVar

from acausal.language.declarations.declaration import Owner

Around = TypeVar("Around", bound=Owner)


@dataclass(frozen=True, eq=False)
class Outer(Generic[Around]):
    """What `outer` makes: the class that is looked for, and what is put into the model when none is around."""

    cls: type[Around]
    default: Around | None
    doc: str


def outer(cls: type[Around], *, default: Around | None = None, doc: str = "", init: Literal[False] = False) -> Around:
    """The nearest component of class `cls` around this one: a part of its owner, or of the owner of that, and so on.

    It is declared as a field, `world: World = outer(World)`, and read like a part: `self.world.g_0`. Of several parts
    of the class the one with the name of the field is meant. Where none is around, `default` is put into the model
    under the name of the field; without a default it is an error.

    `init` is for type checkers: an outer component is not given to the constructor.

    Raises
    ------
    DeclarationError
        Where a model is flattened: AC188 when none is around, AC189 when several could be meant.
    """
    made: Any = Outer(cls, default, doc)
    return made  # type: ignore[no-any-return]
