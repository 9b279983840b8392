"""Detection of common errors in class bodies: an `__init__`, hidden fields, wrong signatures, endless recursion."""

from __future__ import annotations

import difflib
import inspect
import linecache
import re
import sys
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from types import FrameType
from typing import Any

from acausal.errors import DeclarationError, Span, UnknownFieldError, calling_span, nearest
from acausal.language.declarations.declaration import Declaration, Kind, Owner, Start
from acausal.language.declarations.experiment import Experiment
from acausal.language.declarations.parts import Outer
from acausal.language.model_code import OF_PYTHON, in_model_code
from acausal.language.statement import Origin


def refuse_hiding(cls: type[Owner], inherited: dict[str, Declaration | Outer[Any]]) -> None:
    """Refuse class attributes with the name of an inherited field (DeclarationError AC126)."""
    for name in inherited.keys() & cls.__dict__.keys():
        if not isinstance(cls.__dict__[name], Declaration | Outer) and not hasattr(cls.__dict__[name], "_declarations"):
            raise DeclarationError(
                "AC126",
                f"{cls.__name__}.{name} hides the {_kind(inherited[name])} {name} that it inherits",
                where=field_span(cls, name),
                help=f"give the value where it is made: {cls.__name__}({name}=...), or in `build`: self.{name} = ...",
            )


def _kind(inherited: Declaration | Outer[Any]) -> str:
    return "outer" if isinstance(inherited, Outer) else inherited.kind.value


def own_constructor(cls: type[Owner]) -> DeclarationError | None:
    """DeclarationError AC109 for a class that defines `__init__`; None for all others."""
    codes = ((base, getattr(base.__dict__.get("__init__"), "__code__", None)) for base in cls.__mro__)
    base, code = next((found for found in codes if found[1] is not None), (cls, None))
    if base.__module__ == "acausal.language.component":
        return None
    return DeclarationError(
        "AC109",
        f"{base.__name__} defines __init__",
        where=()
        if code is None or code.co_filename.startswith("<")
        else (Span(code.co_filename, code.co_firstlineno),),
        cause="acausal makes the constructor, which takes the fields by name",
        help="declare the arguments as parameter(...) or structural(...), and make parts in `build`",
    )


def refuse_undeclared(cls: type[Owner], name: str, annotation: object, value: object) -> None:
    """Refuse class attributes that only look like fields (AC112): `mass: Mass = Mass`, `k: Real = 2.0`.

    An experiment under another name is refused, too, because it would be ignored.
    """
    if (name == "experiment") is not isinstance(value, Experiment):
        raise DeclarationError(
            "AC112",
            f"{cls.__name__}.{name} is {'an' if name != 'experiment' else 'no'} Experiment",
            where=field_span(cls, name),
            help="the default run of a model is declared as experiment = Experiment(stop_time=...)",
        )
    if annotation is None or "ClassVar" in str(annotation):
        return
    is_list = isinstance(value, list | tuple) and any(isinstance(member, Owner) for member in value)
    if isinstance(value, type) and issubclass(value, Owner):
        fact, help = (
            f"is the class {value.__name__}, not a component",
            f"{name}: {value.__name__} = {value.__name__}(...)",
        )
    elif is_list:
        fact = "is a list of components, which all components of the class would share"
        help = f"{name}: list[...] = part(), and in `build`: self.{name} = [...]"
    elif _is_real(annotation) and isinstance(value, int | float):
        fact = f"is the plain number {value}, which cannot be set and has no unit"
        help = f"{name}: Real = parameter(default={value}), or {name}: ClassVar[float] = {value}"
    elif _is_real(annotation):
        start = type(value).__name__.lower()
        fact = f"is {value!r}, which declares no quantity"
        help = (
            f"{name}: Real = variable(default={start}(...))"
            if isinstance(value, Start)
            else f"{name}: Real = variable(...), parameter(...) or another declaration"
        )
    else:
        return
    raise DeclarationError("AC112", f"{cls.__name__}.{name} {fact}", where=field_span(cls, name), help=help)


def refuse_annotation(cls: type[Owner], name: str, annotation: object, value: object) -> None:
    """Refuse `Real` for anything but a quantity, and a quantity that is not `Real` (AC112)."""
    kind = value.kind if isinstance(value, Declaration) else Kind.PART
    is_quantity = kind not in (Kind.STRUCTURAL, Kind.PART)
    declared = annotation if isinstance(annotation, str) else getattr(annotation, "__name__", str(annotation))
    if is_quantity is not _is_real(annotation) and declared != "Any":
        own = "part" if kind is Kind.PART else kind.value
        raise DeclarationError(
            "AC112",
            f"{cls.__name__}.{name} is annotated {declared}, but {_article(own)} is declared",
            where=field_span(cls, name),
            cause=f"type checkers would take self.{name} for {_article(declared)}",
            help=f"{name}: Real = {own}(...)"
            if is_quantity
            else f"{name}: {'int' if kind is Kind.STRUCTURAL else 'Component'} = ..., "
            "the type of its value; a quantity is variable(...) or parameter(...)",
        )
    if isinstance(value, Declaration) and kind is Kind.STRUCTURAL and value.default is not None:
        checked_structural(cls, name, value.default)


def _article(noun: str) -> str:
    return f"{'an' if noun[0] in 'aeiou' else 'a'} {noun}"


def _is_real(annotation: object) -> bool:
    return getattr(annotation, "__name__", annotation) in ("Real", "acausal.Real")


def assignment(component: Owner, name: str, stating: tuple[str, ...]) -> DeclarationError:
    """DeclarationError AC118 for `self.f = ...` after construction, with a remedy that depends on the method.

    `stating` are the names of the generator methods, in which an equation was probably meant.
    """
    cls = type(component)
    declared = component._declarations.get(name)
    frame: FrameType | None = sys._getframe(1)
    while frame is not None and not (frame.f_code.co_name in stating and "self" in frame.f_locals):
        frame = frame.f_back
    if frame is None:
        return DeclarationError(
            "AC118",
            f"{cls.__name__}.{name} cannot be set after construction",
            help=f"a value is given where it is made: {cls.__name__}({name}=...); "
            f"an equation is yielded: yield self.{name} == ...",
        )
    caller = frame.f_locals["self"]
    full_path = component._path_to(name)
    caller_path = caller._path_to("") if hasattr(caller, "_path_to") else ""
    path = full_path.removeprefix(caller_path)
    what = f"{type(caller).__name__}.{frame.f_code.co_name} assigns self.{path}"
    if declared is None:
        return DeclarationError(
            "AC118",
            f"{what}, which is not declared",
            help=f"write {name} = ... for a local abbreviation; or declare {name}, and yield self.{path} == ...",
        )
    if declared.kind.value in ("variable", "flow", "input", "output"):
        return DeclarationError(
            "AC118",
            f"{what}: write `yield self.{path} == ...`",
            cause="an assignment states no equation",
            help=f"yield self.{path} == ...",
        )
    return DeclarationError(
        "AC118",
        f"{what}, a {declared.kind.value}, which is fixed by then",
        help=f"give it where the component is made: {cls.__name__}({name}=...), or set it in `build`",
    )


def refuse_overruled(cls: type[Owner], name: str, given: Any, value: Any) -> None:
    """Refuse a structural value in `build` that differs from the one given to the constructor (AC118)."""
    same = given is value or (type(given) is type(value) and repr(given) == repr(value))
    if not same:
        raise DeclarationError(
            "AC118",
            f"{cls.__name__}.build sets the structural '{name}' to {value!r}, but the constructor is given {given!r}",
            where=(*calling_span(), *declared_at(cls, "build")),
            cause="one of the two would be lost, although equations depend on it",
            help=f"leave {name}=... out where the {cls.__name__} is made, or compute it under another name in `build`",
        )


def refuse_misnamed(cls: type[Owner], stating: tuple[str, ...]) -> None:
    """Refuse uncalled generator methods with a name close to one of `stating`, probably misspelt (AC129)."""
    if "_is_named_right" in cls.__dict__:
        return
    members = {n: m for base in reversed(cls.__mro__) for n, m in base.__dict__.items() if inspect.isfunction(m)}
    called_names = {n for m in members.values() for n in m.__code__.co_names}
    for name, member in members.items():
        meant = difflib.get_close_matches(name.lower(), stating, n=1, cutoff=0.85)
        if name not in stating and meant and inspect.isgeneratorfunction(member) and name not in called_names:
            raise DeclarationError(
                "AC129",
                f"{cls.__name__}.{name} is never called: the method is `{meant[0]}`",
                where=(Span(member.__code__.co_filename, member.__code__.co_firstlineno),),
                cause="its statements would be lost",
                help=f"def {meant[0]}(self) -> Equations",
            )
    cls._is_named_right = True


def called(what: str, form: str, function: Callable[..., Any], *args: Any) -> Any:
    """Call a function of the model; raises DeclarationError AC109 if it does not accept `args`.

    Other errors of Python in it become ModelCodeError AC002.
    """
    try:
        return function(*args)
    except OF_PYTHON as error:
        in_function = error.__traceback__.tb_next if error.__traceback__ is not None else None
        if in_function is not None or not isinstance(error, TypeError):
            raise in_model_code(error)  # noqa: B904 (it sets the cause)
        code = getattr(function, "__code__", None)
        raise DeclarationError(
            "AC109",
            f"{what} cannot be called: {error}",
            where=() if code is None else (Span(code.co_filename, code.co_firstlineno),),
            help=f"write it as `{form}`",
        ) from None


def endless_recursion(component: Owner) -> DeclarationError | None:
    """Error AC138 for components whose `build` creates themselves recursively; None for other recursions."""
    here = sys._getframe(1)
    frame: FrameType | None = here
    building: list[str] = []
    while frame is not None:
        if frame.f_code is here.f_code:
            building.append(type(frame.f_locals["self"]).__name__)
        frame = frame.f_back
    names = building[::-1]
    first = next((k for k, name in enumerate(names) if name in names[k + 1 :]), None)
    if first is None:
        return None
    circle = names[first : names.index(names[first], first + 1) + 1]
    return DeclarationError(
        "AC138",
        f"{circle[0]} is built inside itself without end: {' -> '.join(circle)}",
        where=declared_at(type(component), "build"),
        help="a part cannot contain its own owner; end the recursion by a structural number",
    )


def declared_at(cls: type[Owner], name: str) -> tuple[Span, ...]:
    """Line of the class body that declares a field or a method; empty if the source is not available."""
    for base in cls.__mro__:
        member = base.__dict__.get(name)
        code = getattr(member, "__code__", None)
        if code is not None:
            return (Span(code.co_filename, code.co_firstlineno),)
        if name in inspect.get_annotations(base):
            try:
                source, line = inspect.getsourcelines(base)
                file = inspect.getsourcefile(base)
            except (OSError, TypeError):
                return ()
            line += next((k for k, text in enumerate(source) if text.lstrip().startswith("class ")), 0)  # decorators
            return () if file is None else _declaring_line(Span(file, line), name)
    return ()


@dataclass(frozen=True, slots=True)
class Declared:
    """Place in the source of the declaration of a field; like an `Origin`, it is looked up only for a message."""

    cls: type[Owner]
    name: str
    made: Origin

    def span(self) -> Span:
        """The declaration; for a class of the library, the place where the component was made."""
        declared = declared_at(self.cls, self.name)
        return declared[0] if declared and not declared[0].of_library else self.made.span()


def declared_class(cls: type[Owner], name: str) -> type[Owner] | None:
    """Declared class of a part, or of the members of a list; None where the annotation names no component."""
    by_name = cls.__dict__.get("_classes")
    if by_name is None:
        by_name = cls._classes = {}  # not inherited: a subclass may redeclare the part
    if name not in by_name:
        by_name[name] = _annotated_class(cls, name)
    declared: type[Owner] | None = by_name[name]
    return declared


_PLAIN: dict[str, tuple[type, ...]] = {"int": (int,), "bool": (bool,), "str": (str,), "float": (int, float)}


def checked_structural(cls: type[Owner], name: str, value: Any) -> Any:
    """A given structural value, with numpy scalars converted to Python numbers, and containers copied.

    Raises DeclarationError: AC115 if it is not of the plain type that the class declares, or no member of the
    enumeration of its default.
    """
    annotation = next((a[name] for base in cls.__mro__ if name in (a := inspect.get_annotations(base))), None)
    declared = annotation if isinstance(annotation, str) else getattr(annotation, "__name__", "")
    default, accepted = getattr(cls._declarations.get(name), "default", None), _PLAIN.get(declared)
    if accepted is None and isinstance(default, Enum) and not isinstance(default, int | str):
        # its members equal nothing else: any other value would count as none of them
        accepted, declared = (type(default),), type(default).__name__
    if accepted is None:
        return own_copy(value)
    plain = value.item() if hasattr(value, "item") else value
    if isinstance(plain, accepted):
        return plain
    raise DeclarationError(
        "AC115",
        f"{cls.__name__}: structural '{name}' is declared as {declared}, but {value!r} is none",
        help=f"give {'an' if declared[0] in 'aeiouAEIOU' else 'a'} {declared}: {cls.__name__}({name}=...)",
    )


def own_copy(value: Any) -> Any:
    """A copy of lists, dicts, sets and arrays, nested ones included; anything else is returned unchanged.

    Equations are generated later than components are made: if a modeller made three tables from one list with changed
    contents, all would be equal to the last one. Not `copy.deepcopy`, because functions, shapes and components have to
    remain the same objects.
    """
    if type(value) is list:
        return [own_copy(member) for member in value]
    if type(value) is tuple:
        members = tuple(map(own_copy, value))
        return value if all(a is b for a, b in zip(members, value, strict=True)) else members
    if type(value) is dict:
        return {key: own_copy(member) for key, member in value.items()}
    if type(value) is set or (hasattr(value, "setflags") and hasattr(value, "copy")):
        return value.copy()
    return value


def _annotated_class(cls: type[Owner], name: str) -> type[Owner] | None:
    for base in cls.__mro__:
        text = inspect.get_annotations(base).get(name)
        if text is None:
            continue
        members = getattr(text, "__args__", ())
        found = members[0] if members else text
        if isinstance(text, str):
            text = text.removeprefix("list[").removesuffix("]") if text.startswith("list[") else text
            found = vars(sys.modules.get(base.__module__, sys)).get(text.partition(".")[0])
            for part in text.split(".")[1:]:
                found = getattr(found, part, None)
        return found if isinstance(found, type) and hasattr(found, "_declarations") else None
    return None


def field_span(cls: type[Owner], name: str) -> tuple[Span, ...]:
    """Line of the class body that declares `name`, searched from the line of the class statement."""
    for start in calling_span():
        return _declaring_line(start, name)
    return ()


def _declaring_line(start: Span, name: str) -> tuple[Span, ...]:
    first = linecache.getline(start.file, start.line)
    indent = len(first) - len(first.lstrip())
    declares = re.compile(rf"(^|;\s*){re.escape(name)}\s*[:=]")
    for number in range(start.line + 1, len(linecache.getlines(start.file)) + 1):
        line = linecache.getline(start.file, number)
        text = line.strip()
        if text and len(line) - len(line.lstrip()) <= indent:
            break
        if declares.search(text):
            return (Span(start.file, number),)
    return (start,)


def annotation_of(cls: type[Owner], name: str) -> str:
    """The call that makes a part, from its annotation: `Mass(...)`, `[Mass(...), ...]`."""
    for base in cls.__mro__:
        annotation = inspect.get_annotations(base).get(name)
        if annotation is not None:
            members = getattr(annotation, "__args__", ())  # an annotation is text, a class or list[class]
            is_text = isinstance(annotation, str)
            text = annotation if is_text else getattr(annotation, "__name__", str(annotation))
            inner = text[5:-1] if is_text and text.startswith("list[") else members[0].__name__ if members else ""
            return f"[{inner}(...), ...]" if inner else f"{text}(...)"
    return "..."


def not_made_yet(cls: type[Owner], name: str, building: bool) -> DeclarationError:
    """The error for a part that is read by a default, or by `build` before the line that makes it."""
    if building:
        return DeclarationError(
            "AC114",
            f"{cls.__name__}: part '{name}' is not made yet",
            cause="`build` reads the part before the line that makes it; only `equations` can read all parts",
            help=f"move the line `self.{name} = {annotation_of(cls, name)}` above the one that reads it",
        )
    return DeclarationError(
        "AC114",
        f"{cls.__name__}: part '{name}' is not made yet",
        cause="defaults of parameters are evaluated before `build` makes the parts",
        help=f"bind the other way round, in `build`: self.{name} = {annotation_of(cls, name)} with parameters of self",
    )


def unknown_field(cls: type[Owner], name: str) -> UnknownFieldError:
    """The error for a field that a class does not have, with the nearest name."""
    names = [n for n in cls._declarations]
    suggestions = nearest(name, names)
    return UnknownFieldError(
        "AC127",
        f"{cls.__name__} has no field '{name}'" + (f"; did you mean '{suggestions[0]}'?" if suggestions else ""),
        evidence=(f"fields: {', '.join(names)}",) if names else (),
    )
