"""`--set path=value`: values converted to declared units, and structural arguments, which rebuild the model."""

from __future__ import annotations

import ast
import inspect
import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any

from acausal.errors import AcausalError, Span, UsageError
from acausal.flatten.instances.instances import Instance, placed
from acausal.flatten.parameters import check_limits, check_overrides
from acausal.language.component import Component
from acausal.language.connections.freeing import free
from acausal.language.declarations.declaration import Declaration, Kind
from acausal.language.statement import Origin
from acausal.units import convert, is_coherent

# `_COMMA` matches commas between names, not those of R[0,1].
_NUMBER = re.compile(r"\s*[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")
_QUANTITY = re.compile(rf"{_NUMBER.pattern}(?P<unit>.*)", re.DOTALL)
_COMMA = re.compile(r",(?![^\[]*\])")
_SPACE = 3
_ELEMENT = re.compile(r"(?P<path>.+?)\[(?P<index>\d+(?:\s*,\s*\d+)*)\]")


@dataclass(frozen=True)
class Prepared:
    """A model with the requested settings: an instance, and values of its parameters by path, in SI."""

    model: Component
    parameters: dict[str, object]
    structural: dict[str, object]


def prepare(cls: type[Component], assignments: Sequence[str] = (), freed: Sequence[str] = ()) -> Prepared:
    """An instance of `cls` with the requested structural arguments, and the other values by path.

    `freed`: paths of signal inputs that become inputs of the model.

    Raises UsageError: AC003 for a text that is not an assignment or a value, AC006 for a value of the wrong size, AC008
    for a structural argument without value, AC020 and AC021 for a wrong path, AC136 for a value outside its limits,
    AC150 to AC152 for its unit.
    """
    given = _once("--set", map(_split, assignments))
    declared = cls._declarations
    structural = {
        path: _structural(path, text, declared[path])
        for path, text in given.items()
        if path in declared and declared[path].kind is Kind.STRUCTURAL
    }
    for name, declaration in declared.items():
        if declaration.kind is Kind.STRUCTURAL and declaration.default is None and name not in structural:
            raise UsageError(
                "AC008",
                f"structural '{name}' of {cls.__name__} has no value",
                evidence=[declaration.doc] if declaration.doc else [],
                help=f"--set {name}=...",
            )
    model = cls(**structural)
    # messages shall refer to the class, not to this line, where the instance is created
    model.__dict__["_origin"] = _Definition(prepare.__code__, 0, cls)
    model = free(model, *freed) if freed else model
    numeric = {path: text for path, text in given.items() if path not in structural}
    return Prepared(model, _values(model, numeric) if numeric else {}, structural)


def values_of(flag: str, given: Sequence[str] | None) -> dict[str, str]:
    """The values of texts NAME=VALUE as texts, by name."""
    for text in given or ():
        if "=" not in text:
            raise UsageError("AC009", f"{flag} {text}: write NAME=VALUE")
    pairs = ([part.strip() for part in text.split("=", 1)] for text in given or ())
    return _once(flag, ((name, value) for name, value in pairs))


def number_in(flag: str, text: str, value: str, declared: Declaration | None) -> float:
    """The number in `value`, in the declared unit (1 if none is declared); errors show `flag` and `text`."""
    if declared is not None:
        return float(as_usage(f"{flag} {text}", convert, value, declared.unit or "1"))
    try:
        return float(value)
    except ValueError as error:
        fact = "not a number, and the model declares no unit for this name"
        raise UsageError("AC009", f"{flag} {text}: {fact}") from error


def refuse_mixed(argument: str, texts: Sequence[str], unit: str) -> None:
    """Refuse numbers without a unit beside numbers in another unit than the declared one: in `1,2,3mm` 1 is no metre.

    Raises UsageError: AC151. Zeros are the same in all units, but for temperatures with an offset.
    """
    units = {text.strip(): match["unit"].strip() for text in texts if (match := _QUANTITY.fullmatch(text))}
    other = next((u for u in units.values() if u and not is_coherent(u)), None)
    has_offset = other is not None and convert(f"0 {other}", unit or "1") != 0.0
    for text, own in units.items():
        if other is not None and not own and (has_offset or float(text) != 0.0):
            raise UsageError(
                "AC151",
                f"{argument}: {text} has no unit, and another number is in {other}",
                help=f"write {text}{other}" + (f", or {text}{unit}" if unit else ""),
            )


def difference_in(flag: str, text: str, value: str, declared: Declaration | None) -> float:
    """The difference in `value`, as `number_in`: a difference in degrees Celsius has no offset."""
    match = _NUMBER.match(value)
    number = number_in(flag, text, value, declared)
    return number - number_in(flag, text, "0" + value[match.end() :], declared) if match else number


def listed(texts: Sequence[str] | None) -> list[str]:
    """Names from texts `A,B` of a repeatable option; commas inside `R[0,1]` do not separate names."""
    return [name.strip() for text in texts or () for name in _COMMA.split(text) if name.strip()]


def seconds_of(name: str, text: str | None) -> float | None:
    """A time option in seconds."""
    return None if text is None else float(as_usage(f"--{name.replace('_', '-')} {text}", convert, text, "s"))


@dataclass(frozen=True)
class _Definition(Origin):
    """The position of a class in its source, as the origin of the outermost instance."""

    cls: type[Component]

    def span(self) -> Span:
        """File and first line of the class."""
        try:
            return Span(inspect.getsourcefile(self.cls) or "", inspect.getsourcelines(self.cls)[1])
        except (OSError, TypeError):
            return Span(self.cls.__module__, 1)


def _once(flag: str, pairs: Iterable[tuple[str, str]]) -> dict[str, str]:
    """Values by name; AC003 for a name that is given twice."""
    found: dict[str, str] = {}
    for name, value in pairs:
        if name in found:
            raise UsageError(
                "AC003", f"{flag} gives {name} twice: {found[name]} and {value}", help="leave one of them out"
            )
        found[name] = value
    return found


def _split(text: str) -> tuple[str, str]:
    path, sign, value = text.partition("=")
    if not sign or not path.strip() or not value.strip():
        raise UsageError(
            "AC003", f"'--set {text}' is not an assignment", help="write --set path=value, such as --set mass.m=2.5kg"
        )
    return path.strip(), value.strip()


def _structural(path: str, text: str, declaration: Declaration) -> object:
    default = declaration.default
    if isinstance(default, Enum):
        members = type(default).__members__
        name = text.removeprefix(f"{type(default).__name__}.")  # as `acausal info` shows it
        if name in members:
            return members[name]
        raise UsageError(
            "AC003",
            f"'{text}' is not a value for the structural '{path}'",
            evidence=[f"its default is {default.name}"],
            help=f"give one of {', '.join(members)}",
        )
    try:
        value = ast.literal_eval(text)
    except (ValueError, SyntaxError, MemoryError, RecursionError):
        if isinstance(default, str):
            return text
    else:
        value = tuple(value) if isinstance(value, list) and isinstance(default, tuple) else value
        if _fits(value, default):
            return value
    raise UsageError(
        "AC003",
        f"'{text}' is not a value for the structural '{path}'",
        evidence=[f"its default is {default!r}"] if default is not None else [],
        help="give a Python literal of the same type: 10, True, (0, 0, 1), 'text'",
    )


def _fits(value: object, default: object) -> bool:
    """Whether a value has the type of the default; a default of another type permits any value."""
    if isinstance(default, float):
        return isinstance(value, int | float) and not isinstance(value, bool)
    return type(value) is type(default) if isinstance(default, bool | int | str | tuple) else True


def _values(model: Component, given: dict[str, str]) -> dict[str, object]:
    found, _ = placed(model)
    declared = {
        instance.prefix + name: (instance, d)
        for instance in found
        for name, d in instance.component._declarations.items()
    }
    whole = {path if path in declared else _element(path)[0] for path in given}
    check_overrides(dict.fromkeys(whole), found)
    values: dict[str, object] = {}
    # an entry replaces that of the whole, wherever it stands
    for path, text in sorted(given.items(), key=lambda item: item[0] not in declared):
        base, index = (path, None) if path in declared else _element(path)
        instance, declaration = declared[base]
        if index is None:
            values[path] = _value(path, text, declaration)
        else:
            entries: Any = values[base] if base in values else _present(instance, base, declaration)
            values[base] = _replaced(path, entries, index, _scalar(path, text, declaration), declaration.shape)
    for path, value in values.items():
        flat = value if isinstance(value, tuple) else (value,)
        as_usage(f"--set {path}", check_limits, path, declared[path][1], flat, path=path)
    return {path: _nested(value, declared[path][1].shape) for path, value in values.items()}


def _element(path: str) -> tuple[str, tuple[int, ...] | None]:
    match = _ELEMENT.fullmatch(path)
    return (match["path"], tuple(int(i) for i in match["index"].split(","))) if match else (path, None)


def _value(path: str, text: str, declaration: Declaration) -> Any:
    """A float, or the entries of an array, row-major; one number fills an array, but not a vector of three."""
    if not declaration.shape:
        return _scalar(path, text, declaration)
    shape, rows = declaration.shape, [_list(part) for part in _list(text)]
    is_nested = any(_is_list(part) for part in _list(text))
    entries = tuple(_scalar(path, entry, declaration) for row in rows for entry in row)
    refuse_mixed(f"--set {path}", [entry for row in rows for entry in row], declaration.unit)
    size = math.prod(shape)
    if len(entries) == 1 and size > _SPACE and not is_nested:
        return entries * size
    if is_nested and (len(rows), *{len(row) for row in rows}) != shape:
        fact = (
            f"{path} has {' x '.join(map(str, shape))} entries, not rows of {', '.join(str(len(row)) for row in rows)}"
        )
    elif len(entries) != size:
        fact = f"{path} has {size} entries, not {len(entries)}"
    else:
        return entries
    row = f"[{', '.join(['0.0'] * min(shape[-1], 9))}]"
    whole = f"[{', '.join([row] * min(shape[0], 9))}]" if len(shape) > 1 else row
    first = ",".join("0" * len(shape))
    raise UsageError("AC006", fact, help=f"write --set '{path}={whole}', or one of its entries: {path}[{first}]=...")


def _is_list(text: str) -> bool:
    return text.strip()[:1] in ("[", "(")


def _list(text: str) -> list[str]:
    """The parts of `[a, b]`, `(a, b)` or `a, b`; commas inside brackets separate no parts, as in `[1, 2], [3, 4]`."""
    parts, depth = [""], 0
    for letter in text:
        depth += (letter in "[(") - (letter in "])")
        if letter == "," and depth == 0:
            parts.append("")
        else:
            parts[-1] += letter
    parts = [part.strip() for part in parts if part.strip()]
    if len(parts) == 1 and _is_list(parts[0]) and parts[0][-1] in "])":
        return _list(parts[0][1:-1])
    return parts


def _scalar(path: str, text: str, declaration: Declaration) -> float:
    return float(as_usage(f"--set {path}", convert, text.strip(), declaration.unit, path=path))


def as_usage(argument: str, function: Any, *arguments: Any, path: str | None = None) -> Any:
    """Call a function, and convert its errors to usage errors: the argument is wrong, not the model."""
    try:
        return function(*arguments)
    except AcausalError as error:
        fact = error.fact if path is not None and error.fact.startswith(path) else f"{argument}: {error.fact}"
        raise UsageError(error.code, fact, evidence=error.evidence, cause=error.cause, help=error.help) from error


def _present(instance: Instance, path: str, declaration: Declaration) -> tuple[float, ...]:
    """The entries a parameter has in the model, so that one of them can be replaced."""
    value = instance.component.__dict__["_values"].get(path.removeprefix(instance.prefix))
    if value is None or value.op != "const":
        raise UsageError(
            "AC006",
            f"one entry of {path} cannot be set: "
            + ("it has no value" if value is None else f"it is bound to `{value}`"),
            help=f"give all entries: --set '{path}=[...]'",
        )
    return tuple(value.payload) if isinstance(value.payload, tuple) else (value.payload,) * math.prod(declaration.shape)


def _replaced(
    path: str, entries: tuple[float, ...], index: tuple[int, ...], value: float, shape: tuple[int, ...]
) -> tuple[float, ...]:
    if len(index) != len(shape) or not all(i < n for i, n in zip(index, shape, strict=True)):
        raise UsageError("AC006", f"there is no entry {path}: its shape is {shape}", help="indices count from 0")
    k = 0
    for i, n in zip(index, shape, strict=True):
        k = k * n + i
    return (*entries[:k], value, *entries[k + 1 :])


def _nested(value: Any, shape: tuple[int, ...]) -> object:
    """Row-major entries as the (nested) tuple for the argument `parameters`."""
    if len(shape) < 2:
        return value
    rows, columns = shape
    return tuple(tuple(value[i * columns : (i + 1) * columns]) for i in range(rows))
