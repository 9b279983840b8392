"""Components and connectors: class bodies declare fields, generators state equations, `build` creates parts.

An instance holds the arguments of its constructor, the parts created by `build`, its place in the source, and its owner
(for messages). There is no global registry; the flattener assigns names.
"""

from __future__ import annotations

import inspect
import math
import sys
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, Self, dataclass_transform

from acausal.collector import collector_paused
from acausal.errors import DeclarationError, calling_span, counted
from acausal.language.declarations.declaration import Declaration, Kind, Owner
from acausal.language.declarations.declare import Real, checked_shape, checked_value, parameter, structural
from acausal.language.declarations.experiment import Experiment
from acausal.language.declarations.inheritance import inherited_fields
from acausal.language.declarations.misuse import (
    annotation_of,
    assignment,
    called,
    checked_structural,
    declared_at,
    declared_class,
    endless_recursion,
    field_span,
    not_made_yet,
    own_constructor,
    own_copy,
    refuse_annotation,
    refuse_hiding,
    refuse_overruled,
    refuse_undeclared,
    unknown_field,
)
from acausal.language.declarations.parts import Outer, Parts, outer
from acausal.language.expressions.expression import Expr, Symbol
from acausal.language.statement import Ledger, Origin, Statement, recorded, refuse_discarded_generators, refuse_lost
from acausal.providers import Diagram, provided

Equations = Iterator[Statement]
"""Return type of `equations`, `initial_equations` and `ties`."""

STATING = ("equations", "initial_equations", "ties")
"""Generator methods by which a component states its equations."""

_METHODS = {"build", *STATING}

_RESERVED = {
    **{name: f"`{name}` is a method of components" for name in _METHODS},
    "time": "results, files and tables have the time of the run under this name",
}
"""Names that no field can have, and why."""


@dataclass_transform(kw_only_default=True, field_specifiers=(parameter, structural, outer))
class Component(Owner):
    """Base class of all models and their parts.

    Subclasses declare fields and may define `build(self)`, `equations(self)`, `initial_equations(self)` and
    `ties(self)`. Equations of all classes in the MRO add up, base first, without `super()`.
    """

    experiment: ClassVar[Experiment] = Experiment()
    """Default run of the model."""
    _prototypes: ClassVar[dict[str, Component]] = {}
    _outers: ClassVar[dict[str, Outer[Component]]] = {}
    _own_fields: ClassVar[tuple[str, ...]] = ()
    """Names that the class body itself declares, new ones or in place of an inherited part."""
    _to_be_connected: ClassVar[tuple[str, ...]] = ()
    """Connectors that must be connected: the zero flow of an open one would determine flows of the component."""
    _lists: ClassVar[frozenset[str]] = frozenset()
    _parts: dict[str, Component | list[Any]]

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        declarations, prototypes, outers = inherited_fields(cls)
        refuse_hiding(cls, {**declarations, **outers})
        annotated = inspect.get_annotations(cls)
        for name, annotation in annotated.items():
            if name not in cls.__dict__ and not name.startswith("_") and "ClassVar" not in str(annotation):
                value = "variable(...)" if "Real" in str(annotation) else "part()"
                signature = f"{name}: {'Real' if 'Real' in str(annotation) else annotation} = {value}"
                raise DeclarationError(
                    "AC112",
                    f"{cls.__name__}.{name} is annotated but not declared",
                    where=field_span(cls, name),
                    help=f"{signature}, or ClassVar[...] if it is no field",
                )
        for name, value in list(cls.__dict__.items()):
            if isinstance(value, Declaration | Component | Outer):
                if name not in annotated:
                    raise DeclarationError(
                        "AC112",
                        f"{cls.__name__}.{name} has no annotation",
                        where=field_span(cls, name),
                        help=f"{name}: {_annotation_for(value)} = ...",
                    )
                refuse_annotation(cls, name, annotated[name], value)
                _check_name(cls, name, value)
            else:
                refuse_undeclared(cls, name, annotated.get(name), value)
            if isinstance(value, Component):
                prototypes[name] = value
                declarations[name] = Declaration(Kind.PART, doc=(type(value).__doc__ or "").split("\n")[0])
                delattr(cls, name)
            elif isinstance(value, Outer):
                outers[name] = value
                delattr(cls, name)
            elif isinstance(value, Declaration):
                declarations[name] = value
                prototypes.pop(name, None)
                if value.kind in (Kind.STRUCTURAL, Kind.PART):
                    delattr(cls, name)
                else:
                    setattr(cls, name, Real(name, value))
        for name in annotated.keys() & declarations.keys():
            declarations[name].belongs_to(cls, name)
        cls._own_fields = tuple(n for n in annotated if n in declarations or n in outers)
        cls._declarations = declarations
        cls._is_sized = any(d.sized is not None for d in declarations.values())
        cls._prototypes = prototypes
        cls._outers = outers
        cls._lists = cls._lists - annotated.keys() | {n for n, a in annotated.items() if str(a).startswith("list[")}

    def __init__(self, /, *nameless: Any, **given: Any) -> None:
        if nameless:
            first = next((n for n in self._declarations if n not in self._prototypes), "name")
            raise DeclarationError(
                "AC127",
                f"{type(self).__name__} takes its fields by name",
                evidence=[f"fields: {', '.join(self._declarations)}"],
                help=f"{type(self).__name__}({first}=...)",
            )
        attributes = self.__dict__
        attributes["_values"] = {}
        attributes["_symbols"] = {}
        attributes["_parts"] = {}
        attributes["_owner"] = None
        attributes["_given"] = given
        caller = sys._getframe(1)
        attributes["_origin"] = Origin(caller.f_code, caller.f_lasti)
        cls = type(self)
        for name in given:
            if name not in self._declarations:
                raise unknown_field(cls, name)
        for name, around in self._outers.items():
            attributes[name] = around.cls._stand_in(self, name)
        if cls._is_sized:
            attributes["_declarations"] = self._sized()
        for name, declaration in self._declarations.items():
            if name in given:
                self._give(name, declaration, given[name])
            elif name in self._prototypes:
                self._adopt(name, self._prototypes[name]._copy())
            elif declaration.kind is Kind.STRUCTURAL:
                attributes[name] = self._decided(name, declaration)
            elif declaration.kind is not Kind.PART and declaration.default is not None:
                attributes["_values"][name] = self._declared(name, declaration)
        if hasattr(cls, "build"):
            attributes["_building"] = True
            self._build()
            for name, parts in attributes["_parts"].items():
                if isinstance(parts, list):
                    self._adopt(name, parts)  # once more, because `build` may have appended to the list
        attributes["_building"] = False
        if "_declarations" in attributes:
            self._refuse_resized()
        for name, declaration in self._declarations.items():
            if declaration.kind is Kind.PART and name not in attributes["_parts"]:
                raise DeclarationError(
                    "AC114",
                    f"{cls.__name__}: part '{name}' was not made",
                    where=(*calling_span(), *declared_at(cls, name)),
                    help=f"make it in `build`: self.{name} = {annotation_of(cls, name)}",
                )

    def _decided(self, name: str, declaration: Declaration) -> Any:
        """The default of a structural value; DeclarationError AC113 when it has none."""
        if declaration.default is None:
            raise DeclarationError(
                "AC113",
                f"{type(self).__name__}: structural '{name}' needs a value",
                cause=declaration.doc or None,
                help=f"{type(self).__name__}({name}=...)",
            )
        return own_copy(declaration.default)

    def _sized(self) -> dict[str, Declaration]:
        """Declarations of this instance, with shapes computed from its structural values."""
        cls, attributes, given = type(self), self.__dict__, self.__dict__["_given"]
        for name, declaration in cls._declarations.items():
            if declaration.kind is Kind.STRUCTURAL:
                if name in given:
                    self._give(name, declaration, given[name])
                else:
                    attributes[name] = self._decided(name, declaration)
        declarations: dict[str, Declaration] = {}
        for name, declaration in cls._declarations.items():
            if declaration.sized is not None:
                own_name = f"{cls.__name__}.{name}"
                try:
                    shape = called(f"the shape of {own_name}", "shape=lambda self: ...", declaration.sized, self)
                    declaration = declaration.of_shape(checked_shape(shape, own_name))
                except DeclarationError as error:
                    error.where = (*calling_span(), *declared_at(cls, name))
                    raise
            declarations[name] = declaration
        return declarations

    def _refuse_resized(self) -> None:
        """Refuse structural values set in `build` if they change shapes, which the start values no longer match."""
        cls = type(self)
        for name, declaration in cls._declarations.items():
            declared_shape = self._declarations[name].shape
            if declaration.sized is not None and checked_shape(declaration.sized(self)) != declared_shape:
                raise DeclarationError(
                    "AC105",
                    f"{cls.__name__}.{name} has another shape after `build` than before, when it was {declared_shape}",
                    where=declared_at(cls, name),
                    help="give the structural value that it follows from to the constructor, or as a default",
                )

    def _build(self) -> None:
        """Run `build`; statements made in it are recorded in `_stated`, and a generator must yield them later."""
        cls, ledger = type(self), Ledger()
        self.__dict__["_stated"] = ledger
        build: Any = getattr(self, "build", None)
        where = f"{cls.__name__}.build"
        try:
            with recorded(ledger), collector_paused():
                returned = called(where, "def build(self) -> None", build)
            refuse_discarded_generators(cls, where, build)
            if inspect.isgenerator(returned):
                raise DeclarationError(
                    "AC129",
                    f"{where} yields",
                    where=declared_at(cls, "build"),
                    cause="`build` makes the parts; statements about them are yielded by `equations`",
                    help="move the `yield` statements into `def equations(self) -> Equations`",
                )
            if not any(hasattr(cls, name) for name in STATING):
                refuse_lost(where, ledger)
        except RecursionError as error:
            raise endless_recursion(self) or error from None
        except DeclarationError as error:
            error.attribute_to(cls.__name__)
            raise

    def _declared(self, name: str, declaration: Declaration) -> Any:
        """The default value of a field; errors in it name the place of its declaration."""
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
        if isinstance(value, list | tuple):
            value = list(value)
        members = value if isinstance(value, list) else [value]
        prototype, declared_cls = self._prototypes.get(name), declared_class(type(self), name)
        is_list, wants_list = members is value, name in self._lists
        for k, member in enumerate(members):
            if not isinstance(member, Component):
                raise DeclarationError(
                    "AC116",
                    f"{type(self).__name__}: part '{name}' cannot be {member!r} ({type(member).__name__})",
                    help=f"it takes {annotation_of(type(self), name)}",
                )
            member._refuse_unmade()
            owner = member.__dict__["_owner"]
            if isinstance(member, Record) and owner is not None and owner[0] is not self:
                member = member._reference()
                if value is members:
                    members[k] = member
                else:
                    value = member
            if isinstance(prototype, Connector) and type(member) is not type(prototype):
                raise DeclarationError(
                    "AC116",
                    f"{type(self).__name__}: '{name}' must be a {type(prototype).__name__}, "
                    f"not a {type(member).__name__}",
                    help="a connector is declared in the class; it need not be given",
                )
            if declared_cls is not None and is_list is not wants_list:
                declared = declared_cls.__name__
                raise DeclarationError(
                    "AC116",
                    f"{type(self).__name__}: part '{name}' is "
                    + (f"a list of {declared}, not one" if wants_list else f"one {declared}, not a list"),
                    where=(*calling_span(), *declared_at(type(self), name)),
                    help=f"make {annotation_of(type(self), name)}, or declare it as "
                    + (declared if wants_list else f"list[{declared}]"),
                )
            if declared_cls is not None and not isinstance(member, declared_cls):
                raise DeclarationError(
                    "AC116",
                    f"{type(self).__name__}: part '{name}' is declared as {declared_cls.__name__}, "
                    f"{type(member).__name__} is none",
                    where=(*calling_span(), *declared_at(type(self), name)),
                    help=f"make {annotation_of(type(self), name)}, or declare a class that both derive from"
                    if prototype is None
                    else f"a part is replaced by one of its declared class: {annotation_of(type(self), name)}",
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
        self._parts[name] = Parts(members, self, name) if isinstance(value, list | tuple) else value

    def __setattr__(self, name: str, value: Any) -> None:
        cls = type(self)
        if not self.__dict__.get("_building", False):
            raise own_constructor(cls) or assignment(self, name, STATING)
        declaration = self._declarations.get(name)
        if declaration is not None and name in self.__dict__["_given"]:
            # What the constructor is given modifies the class, whose `build` has the defaults of subclasses.
            if declaration.kind is Kind.STRUCTURAL:
                refuse_overruled(cls, name, self.__dict__[name], value)
            return
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

    if not TYPE_CHECKING:  # otherwise type checkers would accept every misspelt attribute

        def __getattr__(self, name: str) -> Any:
            parts = self.__dict__.get("_parts")
            if parts is not None and name in parts:
                return parts[name]
            if parts is None and not name.startswith("_"):
                self._refuse_unmade()
            if name.startswith("__") or parts is None:
                raise AttributeError(name)
            if name in _METHODS:
                raise AttributeError(name)
            if "_stands_in" in self.__dict__:
                return self._stand_in_part(name)
            if name in self._declarations:  # a part that `build` has not created yet
                raise not_made_yet(type(self), name, self.__dict__.get("_building", False))
            raise unknown_field(type(self), name)

    def _refuse_unmade(self) -> None:
        """Raise DeclarationError AC109 for an instance whose own `__init__` did not call that of `Component`."""
        if "_origin" not in self.__dict__:
            wrong = own_constructor(type(self))
            if wrong is not None:
                raise wrong

    def _copy(self) -> Self:
        """A new instance from the same constructor arguments."""
        self._refuse_unmade()
        given = {
            k: v._copy() if isinstance(v, Component) else [m._copy() for m in v] if _is_parts(v) else v
            for k, v in self.__dict__["_given"].items()
        }
        twin = type(self)(**given)
        twin.__dict__.update(self._marks())
        return twin

    def _marks(self) -> dict[str, Any]:
        """Attributes of a copy besides the constructor arguments: place in the source, signals cut by `free`."""
        return {name: self.__dict__[name] for name in ("_origin", "_freed") if name in self.__dict__}

    @classmethod
    def _stand_in(cls, owner: Component, name: str) -> Self:
        """Placeholder of an outer component of `owner`, or a part of one, with symbols of its quantities."""
        made = object.__new__(cls)
        made.__dict__.update(_owner=(owner, name), _origin=owner.__dict__["_origin"], _stands_in=True, _building=False)
        made.__dict__.update({held: {} for held in ("_values", "_symbols", "_parts", "_given")})
        for own_name, around in cls._outers.items():
            made.__dict__[own_name] = around.cls._stand_in(made, own_name)
        return made

    def _stand_in_part(self, name: str) -> Component:
        """A part of a stand-in; raises DeclarationError AC187 for anything but quantities and parts."""
        prototype = self._prototypes.get(name)
        if prototype is None:
            path = self._path_to(name)
            raise DeclarationError(
                "AC187",
                f"`{path}` is not known yet: the surroundings of a component are known when the model is flattened",
                help=f"in `build` and in defaults take quantities of `{path.rpartition('.')[0]}` only; `equations` may "
                "read everything",
            )
        made = self._parts[name] = type(prototype)._stand_in(self, name)
        return made

    def _view(self, own: Mapping[str, Any] | None = None, parts: Mapping[str, Any] | None = None) -> Self:
        """A view of this component with some attributes and parts replaced; everything else is shared."""
        twin = object.__new__(type(self))
        twin.__dict__.update(self.__dict__)
        twin.__dict__.update(own or {}, _symbols={}, _parts={**self._parts, **(parts or {})})
        twin.__dict__["_seen"] = self.__dict__.get("_seen", self)
        return twin

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the constructor arguments only, as `build` may have created functions; a view pickles its original.

        A part of another component keeps its path, because pickled equations refer to it by that.
        """
        if "_seen" in self.__dict__:
            return dict.__getitem__, ({0: self.__dict__["_seen"]}, 0)
        stood = self._path_to("").removesuffix(".")
        return _unpickle, (
            type(self),
            self.__dict__["_given"],
            {**self._marks(), **({"_stood": stood} if stood else {})},
        )

    def __repr__(self) -> str:
        given = ", ".join(f"{k}={_shown(v)}" for k, v in self.__dict__["_given"].items())
        return f"{type(self).__name__}({given})"

    def diagram(self, *, depth: int = 1, opened: Sequence[str] = ()) -> Diagram:
        """The connection diagram; see `acausal.diagram`."""
        drawn: Diagram = provided("diagram")(self, depth=depth, opened=opened)
        return drawn

    def _repr_html_(self) -> str:
        shown: str = provided("component_html")(self)
        return shown


class Record(Component):
    """A named set of parameters, as Modelica's records: a material, a tool.

    A component declares a record as a part, `material: Material = Material()`, and reads `self.material.rho`. One
    record may be given to many components, `Rod(material=self.steel)`: each gets its own record, whose parameters are
    bound to those of the shared one.

    Raises
    ------
    DeclarationError
        AC190 when a subclass declares anything but parameters, structural values and records, or states equations.
    """

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        kinds = {n: d.kind for n, d in cls._declarations.items()}
        parts = {n: type(p) for n, p in cls._prototypes.items()}
        wrong = [n for n, k in kinds.items() if k not in (Kind.PARAMETER, Kind.STRUCTURAL, Kind.PART)]
        wrong += [n for n in STATING if hasattr(cls, n)]
        wrong += [n for n, k in kinds.items() if k is Kind.PART and not issubclass(parts.get(n, Component), Record)]
        if wrong:
            raise DeclarationError(
                "AC190",
                f"record {cls.__name__}: '{wrong[0]}' is no parameter",
                where=field_span(cls, wrong[0]),
                help="a record holds parameter(...), structural(...) and records; a Component holds everything",
            )

    def _reference(self) -> Self:
        """A record whose parameters are bound to those of this one."""
        twin = type(self)(**{name: getattr(self, name) for name in self._declarations})
        twin.__dict__["_origin"] = self.__dict__["_origin"]
        return twin


def _unpickle(cls: type[Component], given: dict[str, Any], marks: dict[str, Any]) -> Component:
    """Unpickle a component; its place in the source is that of the original."""
    component = cls(**given)
    component.__dict__.update(marks)
    return component


class Connector(Component):
    """A set of variables by which components are connected: potentials, and as many flows.

    An overconstrained connector (a frame with its rotation matrix) defines `rates(self)`, yielding
    `der(x) == expression` for its overconstrained variables, and `residuals(self, other)`, yielding the minimal
    set of equations that make two of them equal.
    """

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        count = {Kind.VARIABLE: 0, Kind.FLOW: 0}
        exempt = False
        for name, declaration in cls._declarations.items():
            if declaration.sized is not None:
                raise DeclarationError(
                    "AC123",
                    f"connector {cls.__name__}: the shape of '{name}' is a function",
                    where=field_span(cls, name),
                    help="a connector has one shape, so that all of its class can be joined: write it as a number",
                )
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
                f"connector {cls.__name__} has {counted(count[Kind.VARIABLE], 'potential')} "
                f"and {counted(count[Kind.FLOW], 'flow')}",
                evidence=[
                    f"{kind.value}: {', '.join(n for n, d in cls._declarations.items() if d.kind is kind) or 'none'}"
                    for kind in count
                ],
                help="a connector needs one flow for every potential; use signal_input and signal_output for signals",
            )


def _type_text(value: Any) -> str:
    return f"list[{type(value[0]).__name__}]" if isinstance(value, list) else type(value).__name__


def _annotation_for(value: Declaration | Component | Outer[Component]) -> str:
    """The annotation that a declaration needs, as far as its value determines it."""
    if isinstance(value, Outer):
        return value.cls.__name__
    if isinstance(value, Component):
        return type(value).__name__
    return {Kind.PART: "...", Kind.STRUCTURAL: "int"}.get(value.kind, "Real")


def _is_parts(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and isinstance(value[0], Component)


def _shown(value: Any) -> str:
    return str(value) if isinstance(value, Symbol) else repr(value)


def _check_name(cls: type[Component], name: str, value: Declaration | Component | Outer[Component]) -> None:
    if name.startswith("_") or name in _RESERVED:
        raise DeclarationError(
            "AC125",
            f"{cls.__name__}.{name}: a field cannot have this name",
            where=field_span(cls, name),
            cause=_RESERVED.get(name, "names that begin with _ are no fields"),
            help="choose another name",
        )
    for base in cls.__mro__[1:]:
        if issubclass(base, Component) and (name in base._declarations or name in base._outers):
            clash = _clash(base, name, value)
            if clash is None:
                continue
            raise DeclarationError(
                "AC126",
                f"{cls.__name__}.{name} is declared again: {base.__name__} has it already",
                where=field_span(cls, name),
                cause=clash[0],
                help=clash[1]
                or f"choose another name; a value is given where a part is made: {cls.__name__}({name}=...)",
            )


def _clash(base: type[Component], name: str, value: object) -> tuple[str, str] | None:
    """(Cause, remedy) if a field cannot be declared again; None for a part that replaces one of the declared class."""
    inherited = base._prototypes.get(name)
    if inherited is None or isinstance(inherited, Connector) or not isinstance(value, Component):
        return "", ""
    declared_cls, given = declared_class(base, name) or type(inherited), type(value)
    if issubclass(given, declared_cls):
        return None
    common = next(c for c in given.__mro__ if isinstance(inherited, c)).__name__
    remedy = f"declare it in {base.__name__} as their base: {name}: {common} = ..." if common != "Component" else ""
    return f"{base.__name__}.{name} is declared as {declared_cls.__name__}, {given.__name__} is none", remedy
