"""Components and connectors: a class body declares, a generator states, `build` makes the parts.

Instances are recipes: they hold what was given to the constructor, the parts that `build` made, the place where
they were made, and the owner they were given to (for messages). Nothing is global; the flattener gives names.
"""

from __future__ import annotations

import inspect
import math
import sys
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, ClassVar, Self, dataclass_transform

from acausal.errors import DeclarationError, UnknownFieldError, calling_span, nearest
from acausal.language.declare import Declaration, Kind, Real, checked_value, parameter, structural
from acausal.language.expression import Expr, Symbol
from acausal.language.misuse import (
    called,
    checked_structural,
    declared_at,
    declared_class,
    endless,
    field_span,
    own_constructor,
    refuse_hiding,
)
from acausal.language.origin import Origin

Equations = Iterator[Any]
"""Return type of `equations`, `initial_equations` and `ties`."""

_RESERVED = {"build", "equations", "initial_equations", "ties"}


@dataclass_transform(kw_only_default=True, field_specifiers=(parameter, structural))
class Component:
    """Base of everything a modeller writes.

    Subclasses declare fields and may define `build(self)`, `equations(self)`, `initial_equations(self)` and
    `ties(self)`. Equations of all classes in the MRO add up, base first, without `super()`.
    """

    _declarations: ClassVar[dict[str, Declaration]] = {}
    _prototypes: ClassVar[dict[str, Component]] = {}
    _classes: ClassVar[dict[str, type[Component] | None]]
    _parts: dict[str, Component | list[Any]]

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        declarations: dict[str, Declaration] = {}
        prototypes: dict[str, Component] = {}
        for base in reversed(cls.__bases__):
            declarations |= getattr(base, "_declarations", {})
            prototypes |= getattr(base, "_prototypes", {})
        refuse_hiding(cls, declarations)
        annotated = inspect.get_annotations(cls)
        for name, annotation in annotated.items():
            if name not in cls.__dict__ and not name.startswith("_") and "ClassVar" not in str(annotation):
                value = "variable(...)" if "Real" in str(annotation) else "part()"
                made = f"{name}: {'Real' if 'Real' in str(annotation) else annotation} = {value}"
                raise DeclarationError(
                    "AC112",
                    f"{cls.__name__}.{name} is annotated but not declared",
                    where=field_span(cls, name),
                    help=f"{made}, or ClassVar[...] for what is no field",
                )
        for name, value in list(cls.__dict__.items()):
            if isinstance(value, Declaration | Component):
                if name not in annotated:
                    raise DeclarationError(
                        "AC112",
                        f"{cls.__name__}.{name} has no annotation",
                        where=field_span(cls, name),
                        help=f"{name}: {_annotation_for(value)} = ...",
                    )
                _check_name(cls, name)
            if isinstance(value, Component):
                prototypes[name] = value
                declarations[name] = Declaration(Kind.PART, doc=(type(value).__doc__ or "").split("\n")[0])
                delattr(cls, name)
            elif isinstance(value, Declaration):
                declarations[name] = value
                prototypes.pop(name, None)
                if value.kind in (Kind.STRUCTURAL, Kind.PART):
                    delattr(cls, name)
                else:
                    setattr(cls, name, Real(name, value))
        cls._declarations = declarations
        cls._prototypes = prototypes

    def __init__(self, /, *nameless: Any, **given: Any) -> None:
        if nameless:
            first = next((n for n in self._declarations if n not in self._prototypes), "name")
            raise DeclarationError(
                "AC127",
                f"{type(self).__name__} takes its fields by name",
                evidence=[f"fields: {', '.join(self._declarations)}"],
                help=f"{type(self).__name__}({first}=...)",
            )
        own = self.__dict__
        own["_values"] = {}
        own["_symbols"] = {}
        own["_parts"] = {}
        own["_owner"] = None
        own["_given"] = dict(given)
        caller = sys._getframe(1)
        own["_origin"] = Origin(caller.f_code, caller.f_lasti)
        cls = type(self)
        for name in given:
            if name not in self._declarations:
                raise _unknown_field(cls, name)
        for name, declaration in self._declarations.items():
            if name in given:
                self._give(name, declaration, given[name])
            elif name in self._prototypes:
                self._adopt(name, self._prototypes[name]._copy())
            elif declaration.kind is Kind.STRUCTURAL:
                if declaration.default is None:
                    raise DeclarationError(
                        "AC113",
                        f"{cls.__name__}: structural '{name}' needs a value",
                        cause=declaration.doc or None,
                        help=f"{cls.__name__}({name}=...)",
                    )
                own[name] = declaration.default
            elif declaration.kind is not Kind.PART and declaration.default is not None:
                own["_values"][name] = self._declared(name, declaration)
        own["_building"] = True
        build = getattr(self, "build", None)
        if build is not None:
            try:
                called(f"{cls.__name__}.build", "def build(self) -> None", build)
            except RecursionError as error:
                raise endless(self) or error from None
            except DeclarationError as error:
                error.attribute_to(cls.__name__)
                raise
        for name, parts in own["_parts"].items():
            if isinstance(parts, list):
                self._adopt(name, parts)  # again: build may have appended to it
        own["_building"] = False
        for name, declaration in self._declarations.items():
            if declaration.kind is Kind.PART and name not in own["_parts"]:
                raise DeclarationError(
                    "AC114",
                    f"{cls.__name__}: part '{name}' was not made",
                    where=(*calling_span(), *declared_at(cls, name)),
                    help=f"make it in `build`: self.{name} = {_annotation_of(cls, name)}",
                )

    def _declared(self, name: str, declaration: Declaration) -> Any:
        """The value that the class body gives; what is wrong with it is wrong there."""
        value = declaration.default
        cls = type(self)
        try:
            if callable(value):
                value = called(f"the default of {cls.__name__}.{name}", "default=lambda self: ...", value, self)
            return checked_value(cls.__name__, name, declaration, value)
        except DeclarationError as error:
            error.where = error.where if callable(declaration.default) and error.where else declared_at(cls, name)
            raise

    def _give(self, name: str, declaration: Declaration, value: Any) -> None:
        if declaration.kind is Kind.STRUCTURAL:
            if isinstance(value, Expr):
                raise DeclarationError(
                    "AC115",
                    f"{type(self).__name__}: '{name}' is structural and cannot be the symbol `{value}`",
                    help="give a Python value, or declare the source structural too",
                )
            self.__dict__[name] = checked_structural(type(self), name, value)
        elif declaration.kind is Kind.PART:
            self._adopt(name, value)
        else:
            self.__dict__["_values"][name] = checked_value(type(self).__name__, name, declaration, value)

    def _adopt(self, name: str, value: Any) -> None:
        members = value if isinstance(value, list | tuple) else [value]
        for k, member in enumerate(members):
            if not isinstance(member, Component):
                raise DeclarationError(
                    "AC116",
                    f"{type(self).__name__}: part '{name}' cannot be {member!r} ({type(member).__name__})",
                    help=f"it takes {_annotation_of(type(self), name)}",
                )
            prototype = self._prototypes.get(name)
            if isinstance(prototype, Connector) and type(member) is not type(prototype):
                raise DeclarationError(
                    "AC116",
                    f"{type(self).__name__}: '{name}' must be a {type(prototype).__name__}, "
                    f"not a {type(member).__name__}",
                    help="a connector is declared in the class; it need not be given",
                )
            wanted = None if prototype is not None else declared_class(type(self), name)
            if wanted is not None and members is value and _annotation_of(type(self), name)[0] != "[":
                raise DeclarationError(
                    "AC116",
                    f"{type(self).__name__}: part '{name}' is one {wanted.__name__}, not a list",
                    where=(*calling_span(), *declared_at(type(self), name)),
                    help=f"make {_annotation_of(type(self), name)}, or declare it as list[{wanted.__name__}]",
                )
            if wanted is not None and not isinstance(member, wanted):
                raise DeclarationError(
                    "AC116",
                    f"{type(self).__name__}: part '{name}' is declared as {wanted.__name__}, "
                    f"{type(member).__name__} is none",
                    where=(*calling_span(), *declared_at(type(self), name)),
                    help=f"make {_annotation_of(type(self), name)}, or declare a class that both derive from",
                )
            if member.__dict__["_owner"] is not None and member.__dict__["_owner"][0] is not self:
                owner, its_name = member.__dict__["_owner"]
                raise DeclarationError(
                    "AC117",
                    f"{type(self).__name__}: the {type(member).__name__} given for '{name}' is already '{its_name}' of "
                    f"{type(owner).__name__}",
                    where=(*calling_span(), member.__dict__["_origin"].span()),
                    help="make one component per place: call its class in `build`",
                )
            member.__dict__["_owner"] = (self, f"{name}[{k}]" if isinstance(value, list | tuple) else name)
        self._parts[name] = list(members) if isinstance(value, list | tuple) else value

    def __setattr__(self, name: str, value: Any) -> None:
        cls = type(self)
        if not self.__dict__.get("_building", False):
            raise own_constructor(cls) or DeclarationError(
                "AC118",
                f"{cls.__name__}.{name} cannot be set after construction",
                help=f"a value is given where it is made: {cls.__name__}({name}=...); "
                f"an equation is yielded: yield self.{name} == ...",
            )
        declaration = self._declarations.get(name)
        if declaration is not None:
            self._give(name, declaration, value)
        elif isinstance(value, Component) or (isinstance(value, list) and value and isinstance(value[0], Component)):
            raise DeclarationError(
                "AC119",
                f"{cls.__name__}.{name} is not declared",
                help=f"write `{name}: {_type_text(value)} = part()` in the class body",
            )
        else:
            self.__dict__[name] = value

    if not TYPE_CHECKING:  # else every misspelt attribute would be one to a type checker

        def __getattr__(self, name: str) -> Any:
            parts = self.__dict__.get("_parts")
            if parts is not None and name in parts:
                return parts[name]
            if name.startswith("__") or parts is None:
                raise AttributeError(name)
            if name in _RESERVED:
                raise AttributeError(name)
            if name in self._declarations:  # a part: `__init__` has declared it and `build` has not run yet
                raise _not_made_yet(type(self), name)
            raise _unknown_field(type(self), name)

    def _copy(self) -> Self:
        """A fresh instance of the same recipe."""
        given = {
            k: v._copy() if isinstance(v, Component) else [m._copy() for m in v] if _is_parts(v) else v
            for k, v in self.__dict__["_given"].items()
        }
        twin = type(self)(**given)
        twin.__dict__["_origin"] = self.__dict__["_origin"]
        return twin

    def _path_to(self, name: str) -> str:
        """Path of a field as seen from the outermost owner, for messages."""
        names = [name]
        here: Component = self
        while here.__dict__["_owner"] is not None:
            here, own_name = here.__dict__["_owner"]
            names.append(own_name)
        return ".".join(reversed(names))

    def __repr__(self) -> str:
        given = ", ".join(f"{k}={_shown(v)}" for k, v in self.__dict__["_given"].items())
        return f"{type(self).__name__}({given})"


class Connector(Component):
    """A set of variables through which components are joined: potentials and as many flows.

    An overconstrained connector (a frame with its rotation matrix) defines `rates(self)`, yielding
    `der(x) == expression` for its overconstrained variables, and `residuals(self, other)`, yielding the minimal
    set of equations that make two of them equal.
    """

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        count = {Kind.VARIABLE: 0, Kind.FLOW: 0}
        exempt = False
        for name, declaration in cls._declarations.items():
            if declaration.kind not in count or declaration.discrete:
                raise DeclarationError(
                    "AC123",
                    f"connector {cls.__name__}: '{name}' is a "
                    f"{'discrete ' * declaration.discrete}{declaration.kind.value}",
                    where=field_span(cls, name),
                    help="a connector holds variable(...) and flow(...); everything else belongs to the component",
                )
            count[declaration.kind] += math.prod(declaration.shape)
            exempt = exempt or declaration.overconstrained
        if count[Kind.VARIABLE] != count[Kind.FLOW] and not exempt:
            raise DeclarationError(
                "AC124",
                f"connector {cls.__name__} has {_amount(count[Kind.VARIABLE], 'potential')} "
                f"and {_amount(count[Kind.FLOW], 'flow')}",
                evidence=[
                    f"{kind.value}: {', '.join(n for n, d in cls._declarations.items() if d.kind is kind) or 'none'}"
                    for kind in count
                ],
                help="a connector needs one flow for every potential; use signal_input and signal_output for signals",
            )


def _amount(count: int, noun: str) -> str:
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def _type_text(value: Any) -> str:
    return f"list[{type(value[0]).__name__}]" if isinstance(value, list) else type(value).__name__


def _annotation_for(value: Declaration | Component) -> str:
    """The annotation that a declaration needs, as far as it can be told."""
    if isinstance(value, Component):
        return type(value).__name__
    return {Kind.PART: "...", Kind.STRUCTURAL: "int"}.get(value.kind, "Real")


def _annotation_of(cls: type[Component], name: str) -> str:
    """How a part is made, from its annotation: `Mass(...)`, `[Mass(...), ...]`."""
    for base in cls.__mro__:
        found = inspect.get_annotations(base).get(name)
        if found is not None:
            members = getattr(found, "__args__", ())  # an annotation is text, a class or list[class]
            is_text = isinstance(found, str)
            text = found if is_text else getattr(found, "__name__", str(found))
            inner = text[5:-1] if is_text and text.startswith("list[") else members[0].__name__ if members else ""
            return f"[{inner}(...), ...]" if inner else f"{text}(...)"
    return "..."


def _is_parts(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and isinstance(value[0], Component)


def _shown(value: Any) -> str:
    if isinstance(value, Symbol):
        return str(value)
    return repr(value)


def _check_name(cls: type[Component], name: str) -> None:
    if name.startswith("_") or name in _RESERVED:
        raise DeclarationError(
            "AC125",
            f"{cls.__name__}.{name}: a field cannot have this name",
            where=field_span(cls, name),
            cause=f"`{name}` is a method of components" if name in _RESERVED else "names with _ in front are no fields",
            help="choose another name",
        )
    for base in cls.__mro__[1:]:
        if issubclass(base, Component) and name in base._declarations:
            raise DeclarationError(
                "AC126",
                f"{cls.__name__}.{name} is declared again: {base.__name__} has it already",
                where=field_span(cls, name),
                help=f"choose another name; a value is given where a part is made: {cls.__name__}({name}=...)",
            )


def _not_made_yet(cls: type[Component], name: str) -> DeclarationError:
    return DeclarationError(
        "AC114",
        f"{cls.__name__}: part '{name}' is not made yet",
        cause="defaults of parameters are worked out before `build` makes the parts",
        help=f"bind the other way round, in `build`: self.{name} = {_annotation_of(cls, name)} with own parameters",
    )


def _unknown_field(cls: type[Component], name: str) -> UnknownFieldError:
    known = [n for n in cls._declarations]
    close = nearest(name, known)
    return UnknownFieldError(
        "AC127",
        f"{cls.__name__} has no field '{name}'" + (f"; did you mean '{close[0]}'?" if close else ""),
        evidence=(f"fields: {', '.join(known)}",) if known else (),
    )
