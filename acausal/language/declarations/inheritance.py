"""Fields that a class inherits, in the order in which Python looks up attributes."""

from __future__ import annotations

from typing import Any

from acausal.errors import DeclarationError, calling_span
from acausal.language.declarations.declaration import Declaration, Owner
from acausal.language.declarations.misuse import declared_at
from acausal.language.declarations.parts import Outer


def inherited_fields(cls: type[Owner]) -> tuple[dict[str, Declaration], dict[str, Any], dict[str, Outer[Any]]]:
    """Declarations, prototypes of parts, and outers of the bases of `cls`, by name.

    If two bases replace a part, that of the first base counts, unless a class derived from that base replaces it, as
    with methods. Merging the bases one by one would be wrong: a base that replaces nothing would bring back the part of
    its own base.

    Raises
    ------
    DeclarationError
        AC126 when two bases declare a name differently and have no common base with it. Equal declarations are one
        field, as in Modelica (language specification 3.6, section 7.1).
    """
    prototypes: dict[str, Any] = {}
    outers: dict[str, Outer[Any]] = {}
    declarations: dict[str, Declaration] = {}
    fields: tuple[dict[str, Any], ...] = prototypes, outers, declarations
    first_declaring: dict[str, type[Owner]] = {}
    bases = [base for base in cls.__mro__[:0:-1] if issubclass(base, Owner)]
    for base in bases:
        for name in base.__dict__.get("_own_fields", ()):
            origin = first_declaring.setdefault(name, base)
            if not issubclass(base, origin) and not _agree(base, origin, name):
                raise DeclarationError(
                    "AC126",
                    f"{cls.__name__} inherits two different fields {name}, of {base.__name__} and {origin.__name__}",
                    where=(*calling_span(), *declared_at(base, name), *declared_at(origin, name)),
                    cause="their equations would share one quantity, with the unit and the default of one of them",
                    help=f"rename one of them, declare both alike, or declare {name} in a common base of the two",
                )
            for table, fields_by_name in zip(_FIELD_TABLES, fields, strict=True):
                of_base = getattr(base, table)
                if name in of_base:
                    fields_by_name[name] = of_base[name]
                else:
                    fields_by_name.pop(name, None)
    return declarations, prototypes, outers


def _agree(one: type[Owner], other: type[Owner], name: str) -> bool:
    """Whether two classes declare a field alike, except for its description and hints to the compiler."""
    meanings: list[tuple[object, ...]] = []
    for cls in (one, other):
        part, around, declared = (getattr(cls, held).get(name) for held in _FIELD_TABLES)
        if part is not None:
            meanings.append((type(part), repr(part)))
        elif around is not None:
            meanings.append((around.cls,))
        else:
            meanings.append(tuple(repr(getattr(declared, key)) for key in _COMPARED))
    return meanings[0] == meanings[1]


_FIELD_TABLES = ("_prototypes", "_outers", "_declarations")
_COMPARED = "kind unit shape sized default min max overconstrained discrete boolean integer".split()  # noqa: SIM905
