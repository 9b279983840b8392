"""Errors of Python in the code of a model: a wrong name, attribute, type or count of arguments, with its remedy.

Python raises them where no operator of an expression is called, as in `self.x(0)`, `self.resistor + 1` or `connect(a)`.
The methods of components pass them through `in_model_code`, the command line also those of a whole model file.
"""

from __future__ import annotations

import ast
import dis
import inspect
import re
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from types import FrameType, ModuleType, TracebackType
from typing import Any

from acausal.errors import AcausalError, ModelCodeError, is_model_code, nearest
from acausal.language.declarations.declaration import Declaration, Kind, Owner
from acausal.language.expressions.expression import Expr, shape_text
from acausal.language.statement import Origin
from acausal.language.written import called_name, parsed, written
from acausal.providers import provided

OF_PYTHON = (TypeError, AttributeError, NameError, LookupError, ArithmeticError, ValueError)
"""What Python raises for a mistake in a program; files, memory and interrupts are none."""

_ATTRIBUTES = {
    "start": "a start value is declared, variable(default=fixed(0.0)), or given where the component is made: "
    "M(x=fixed(0.0)); any other condition on the start is yielded by `initial_equations`",
    "der": "write der(self.x)",
    "sum": "write sum(v)",
    **{name: f"write {name}(v, w)" for name in ("dot", "cross")},
    **{name: "write sqrt(dot(v, v)), or norm(v)" for name in ("norm", "length")},
    **{name: f"write v[{k}]: elements of a vector have numbers" for k, name in enumerate("xyz")},
    **dict.fromkeys(
        ("value", "min", "max", "nominal", "unit", "fixed", "default"),
        "an equation reads the quantity itself, self.x; what it should know besides is a parameter(...) of its own",
    ),
}
"""Remedies for attributes that an expression does not have."""

_NO_FUNCTION = (
    "an expression is not a function: write time or self.x without brackets; an element is self.v[0], a past value "
    "delay(self.x, T), a start value variable(default=fixed(0.0))"
)
_OF_TYPES = (
    ("Declaration", "a field has no value in the class body: default=lambda self: 2 * self.x"),
    ("'float' object cannot be interpreted as an integer", "whole numbers are divided by //: n // 2"),
    ("'int' object is not iterable", "`for k in range(n)` goes from 0 to n - 1"),
    ("cannot unpack non-iterable", "`for k, mass in enumerate(self.masses)` counts the elements of a list"),
)
"""Parts of the text of a TypeError, and the remedy."""


def in_model_code(error: Exception) -> Exception:
    """The error to raise for one of `OF_PYTHON` in a method of a component: with code, place and remedy.

    An error that a `raise` statement raises says itself what is wrong, and is returned as it is; so are all errors of
    acausal.
    """
    is_explained = isinstance(error, AcausalError) or _is_raised(error.__traceback__)
    wrong = None if is_explained else model_code_error(error)
    if wrong is None:
        return error
    wrong.__cause__ = error
    return wrong


def model_code_error(error: Exception) -> ModelCodeError | None:
    """AC002 for an exception in the code of a model; None if it is raised in the compiler."""
    found = _model_frame(error.__traceback__)
    if found is None:
        return None
    frame, lasti = found
    what = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
    node = parsed(written(frame.f_code, lasti))
    values = dict(_values(node, frame))
    return ModelCodeError(
        "AC002",
        f"{_place(frame)} raised {what}",
        where=[Origin(frame.f_code, lasti).span()],
        evidence=[text for name, value in values.items() if (text := _described(name, value))],
        help=_advice(error, frame, node, values),
    )


def _is_raised(trace: TracebackType | None) -> bool:
    """Whether the innermost frame runs a `raise` statement."""
    frames = list(_walked(trace))
    if not frames:
        return False
    frame, lasti = frames[-1]
    return dis.opname[frame.f_code.co_code[lasti]] in ("RAISE_VARARGS", "RERAISE")


def _walked(trace: TracebackType | None) -> Iterator[tuple[FrameType, int]]:
    while trace is not None:
        yield trace.tb_frame, trace.tb_lasti
        trace = trace.tb_next


def _model_frame(trace: TracebackType | None) -> tuple[FrameType, int] | None:
    """The innermost frame and its instruction, if it is in a model or a library rather than in the compiler.

    Frames of Python and of installed packages are skipped: the error is attributed to their caller.
    """
    for frame, lasti in reversed(list(_walked(trace))):
        if frame.f_code.co_filename.startswith("<frozen"):
            continue
        kind = is_model_code(frame.f_code.co_filename)
        if kind is not None:
            return (frame, lasti) if kind else None
    return None


def _place(frame: FrameType) -> str:
    """The name of the code of a frame for the author of the model: `Model.equations`."""
    name = frame.f_code.co_qualname.replace("<locals>.", "")
    owner = frame.f_locals.get("self")
    if owner is not None and name.endswith(f".{frame.f_code.co_name}"):
        return f"{type(owner).__name__}.{frame.f_code.co_name}"
    return Path(frame.f_code.co_filename).name if name == "<module>" else name


def _values(node: ast.AST | None, frame: FrameType) -> Iterator[tuple[str, Any]]:
    """Names in an expression, such as `self.x`, and their values; functions, classes and modules are left out."""
    if node is None:
        return
    if isinstance(node, ast.Name | ast.Attribute):
        with suppress(Exception):  # any property may be on the way
            value = _value(node, frame)
            if not (inspect.isroutine(value) or isinstance(value, type | ModuleType)):
                yield ast.unparse(node), value
                return
    for inner in ast.iter_child_nodes(node):
        yield from _values(inner, frame)


def _value(node: ast.expr, frame: FrameType) -> Any:
    """The value of a name or of attributes of one; KeyError or AttributeError if there is none."""
    if isinstance(node, ast.Attribute):
        return getattr(_value(node.value, frame), node.attr)
    if not isinstance(node, ast.Name):
        raise KeyError
    return {**frame.f_globals, **frame.f_locals}[node.id]


def _described(name: str, value: Any) -> str:
    """A line on the value of a name, for the evidence; empty if it tells nothing."""
    if isinstance(value, Expr):
        return f"`{name}` is a {shape_text(value.shape)}" if name != "time" else ""
    if isinstance(value, Owner):
        return f"`{name}` is a {type(value).__name__}" if name != "self" else ""
    if isinstance(value, bool | int | float | str) or value is None:
        return f"`{name}` is {value!r}"
    return f"`{name}` is a list of {len(value)}" if isinstance(value, list) else ""


def _advice(error: Exception, frame: FrameType, node: ast.AST | None, values: dict[str, Any]) -> str | None:
    """A line of help, or None if there is nothing to add to the error."""
    if isinstance(error, NameError):
        return _unknown_name(str(getattr(error, "name", "")), frame)
    if isinstance(error, AttributeError):
        # Where an attribute is set, the exception has neither its name nor its owner.
        name = error.name or str(error).rpartition("attribute ")[2].strip("'")
        return _unknown_attribute(name, error.obj if error.name else next(iter(values.values()), None))
    if isinstance(error, ModuleNotFoundError):
        return provided("missing_library")(error.name or "")  # type: ignore[no-any-return]
    if isinstance(error, ImportError):
        wanted = re.search(r"cannot import name '(\w+)'", str(error))
        if wanted is None:
            return None
        return _unknown_attribute(wanted[1], sys.modules.get(error.name or "")) or _elsewhere(wanted[1])
    if isinstance(error, TypeError) and (help := _of_types(str(error), frame, node, values)):
        return help
    if any(isinstance(value, Expr) for value in values.values()) and (name := called_name(node)) in _public():
        return f"write {name}(...) with acausal.{name}: functions of math and numpy take numbers only"
    if "setting an array element" in str(error):
        return "numpy takes numbers only: use a function of acausal, such as lookup(...) for a table"
    if isinstance(error, ArithmeticError) or "math domain" in str(error):
        return "Python computes it when the model is made: refuse structural values that cannot be, in `build`"
    return None


def _of_types(text: str, frame: FrameType, node: ast.AST | None, values: dict[str, Any]) -> str | None:
    """Help for a TypeError: what was called with wrong arguments, or what an operator does not take."""
    if isinstance(node, ast.Call) and re.match(r"[\w.<>]+\(\) (missing|takes|got)", text):
        return _signature(node.func, frame)
    if re.match(r"'(Symbol|Operation)' object is not callable", text):
        return _NO_FUNCTION
    for name, value in values.items():
        if isinstance(value, list) and re.search(r"'(list|Parts)' object|list \(not", text):
            return f"take one of its elements: {name}[0]"
    for part, remedy in _OF_TYPES:
        if part in text:
            return remedy
    for name, value in values.items():
        if isinstance(value, list) and value:
            name, value = f"{name}[0]", value[0]
        if isinstance(value, Owner) and name != "self" and f"'{type(value).__name__}'" in text:
            return _quantities(name, value)
    return None


def _signature(function: ast.expr, frame: FrameType) -> str | None:
    """How a function is called, with the first line of its documentation."""
    try:
        value = _value(function, frame)
        signature = inspect.signature(value)
    except (KeyError, AttributeError, TypeError, ValueError):
        return None
    bare = [p.replace(annotation=p.empty) for p in signature.parameters.values()]
    shown = signature.replace(parameters=bare, return_annotation=signature.empty)
    doc = (inspect.getdoc(value) or "").partition("\n")[0].rstrip(".")
    return f"write {ast.unparse(function)}{shown}" + (f": {doc}" if doc and not isinstance(value, type) else "")


def _quantities(name: str, component: Owner) -> str:
    """Help for a component that is used like a quantity."""
    own = [n for n, d in component._declarations.items() if d.kind not in (Kind.STRUCTURAL, Kind.PART)]
    shown = ", ".join(f"{name}.{n}" for n in own[:3])
    return f"a component has no value; take one of its quantities: {shown or f'{name}. ...'}"


def _unknown_name(name: str, frame: FrameType) -> str | None:
    owner = frame.f_locals.get("self")
    if isinstance(owner, Owner) and (name in owner._declarations or hasattr(type(owner), name)):
        return f"write self.{name}"
    if name in _public():
        return f"from acausal import {name}"
    known = [*frame.f_locals, *frame.f_globals, *_public()]
    return _did_you_mean(name, known) or _elsewhere(name)


def _public() -> list[str]:
    """The public names of acausal."""
    return [name for name in dir(sys.modules["acausal"]) if not name.startswith("_")]


def _unknown_attribute(name: str, owner: object) -> str | None:
    if isinstance(owner, Expr):
        return _ATTRIBUTES.get(name, "an expression has operators, elements and functions such as sqrt(self.x)")
    if isinstance(owner, super):
        return f"leave it out: `{name}` of all base classes is called, the first base class first"
    if isinstance(owner, list):
        return f"take {name} of one element, [0], or go through the list with `for`"
    if isinstance(owner, Declaration):
        return "a field has no value in the class body: default=lambda self: 2 * self.x"
    if isinstance(owner, ModuleType):
        return _did_you_mean(name, [n for n in dir(owner) if not n.startswith("_")])
    return None


def _elsewhere(name: str) -> str | None:
    """Help with the libraries that have a component of this or a similar name."""
    return provided("elsewhere")(name)  # type: ignore[no-any-return]


def _did_you_mean(name: str, names: list[str]) -> str | None:
    close = nearest(name, names)
    return f"did you mean {', '.join(close)}?" if close else None
