"""`acausal info Resistor`: a component of the library, from its declarations, equations and source."""

from __future__ import annotations

import ast
import inspect
import textwrap
from collections.abc import Mapping
from typing import Any

from acausal.cli.arguments.catalogue import Part, used_in
from acausal.cli.output.report import place, record, say, table
from acausal.errors import AcausalError, Span
from acausal.language.component import Component, Connector
from acausal.language.declarations.declaration import Declaration, Fixed, Guess, Kind

_MOST_USES = 12
_LONGEST = 50
_WIDEST = 160
_LONG_ASSERTION = 150
_TITLES = {
    "parameters": "Parameters",
    "structural": "Structural arguments",
    "inputs": "Inputs",
    "outputs": "Outputs",
    "variables": "Variables",
}


def show_part(part: Part, cls: type[Component], as_json: bool) -> None:
    """Print a component of the library: connectors, parameters, signals, parts, equations, uses."""
    content = described(part, cls)
    if as_json:
        record(content)
    else:
        _print(content)


def described(part: Part, cls: type[Component]) -> dict[str, Any]:
    """The content of `acausal info` on a component, as data."""
    try:
        example: Component | None = cls()
    except AcausalError:  # an argument has no default: describe the class alone
        example = None
    models, components = used_in(part)
    return {
        "component": part.name,
        "kind": part.kind,
        "reference": part.reference,
        "import": f"from acausal.library.{part.family} import {part.name}",
        "source": place(Span(inspect.getsourcefile(cls) or "", inspect.getsourcelines(cls)[1])),
        "doc": part.doc,
        "connectors": _connectors(cls),
        **_declared(cls),
        "parts": _parts(cls, example),
        "equations": _equations(cls, example),
        "used_in": {"models": list(models), "components": list(components)},
    }


def _connectors(cls: type[Component]) -> list[dict[str, Any]]:
    return [
        {"path": name, "type": type(value).__name__, "carries": _carries(type(value))}
        for name, value in cls._prototypes.items()
        if isinstance(value, Connector)
    ]


def _carries(cls: type[Connector]) -> str:
    """`v [V], flow i [A]`."""
    return ", ".join(
        f"{'flow ' * (d.kind is Kind.FLOW)}{name}" + (f" [{d.unit}]" if d.unit else "")
        for name, d in cls._declarations.items()
    )


def _declared(cls: type[Component]) -> dict[str, list[dict[str, Any]]]:
    """Declarations by kind; potentials and flows of a connector count as variables."""
    kinds = {
        "parameters": (Kind.PARAMETER,),
        "structural": (Kind.STRUCTURAL,),
        "inputs": (Kind.INPUT,),
        "outputs": (Kind.OUTPUT,),
        "variables": (Kind.VARIABLE, Kind.FLOW),
    }
    return {
        title: [_described(name, d) for name, d in cls._declarations.items() if d.kind in wanted]
        for title, wanted in kinds.items()
    }


def _described(name: str, d: Declaration) -> dict[str, Any]:
    return {
        "path": name,
        "default": _default(d),
        "unit": d.unit,
        "shape": list(d.shape),
        "min": d.min,
        "max": d.max,
        "doc": d.doc,
    }


def _default(d: Declaration) -> str | None:
    """Text of the default in the class body; None if a value has to be given or computed."""
    value = d.default
    if isinstance(value, Fixed | Guess):
        return f"{type(value).__name__.lower()}({value.value:g})" if isinstance(value.value, int | float) else None
    if callable(value):
        return _lambda_text(value)
    if value is None:
        return None
    text = f"{value:g}" if isinstance(value, float) else str(value)
    return text if len(text) <= _LONGEST else text[: _LONGEST - 4] + " ..."


def _lambda_text(function: Any) -> str:
    """The body of `lambda self: sin(self.sigma)` from the source."""
    try:
        body = inspect.getsource(function).partition("lambda self:")[2].strip()
    except OSError:
        return "computed"
    # other arguments may follow in the line: the body is the longest prefix that is an expression but not a tuple
    for end in range(len(body), 0, -1):
        try:
            tree = ast.parse(body[:end], mode="eval")
        except SyntaxError:
            continue
        if not isinstance(tree.body, ast.Tuple):
            return ast.unparse(tree).replace("self.", "")
    return "computed"


def _parts(cls: type[Component], example: Component | None) -> list[dict[str, Any]]:
    shown = []
    for name, d in cls._declarations.items():
        if d.kind is not Kind.PART or isinstance(cls._prototypes.get(name), Connector):
            continue
        value = example._parts.get(name) if example is not None else cls._prototypes.get(name)
        kind = f"{len(value)} of them" if isinstance(value, list) else type(value).__name__ if value is not None else ""
        shown.append({"path": name, "type": kind, "doc": d.doc})
    return shown


def _equations(cls: type[Component], example: Component | None) -> list[dict[str, str]]:
    """The equations of the classes, base first; from the source if the component needs arguments to be created."""
    from acausal.flatten.instances.composition import stated_equations

    if example is None or isinstance(example, Connector):
        return _from_source(cls)
    try:
        stated = stated_equations(example)
    except AcausalError:
        return _from_source(cls)
    return [{"text": _text(text, message), "when": when} for text, message, when in stated]


def _text(text: str, message: str) -> str:
    """The text of an equation; of a long assertion only the message."""
    return text if not message or len(text) <= _LONG_ASSERTION else f'assert_(..., "{message}")'


def _from_source(cls: type[Component]) -> list[dict[str, str]]:
    found = []
    for base in reversed(cls.__mro__):
        for method in ("equations", "initial_equations"):
            function = base.__dict__.get(method)
            if function is None or not base.__module__.startswith("acausal.library"):
                continue
            tree = ast.parse(textwrap.dedent(inspect.getsource(function)))
            when = "at the start" if method == "initial_equations" else ""
            for node in ast.walk(tree):
                if isinstance(node, ast.Yield) and node.value is not None:
                    found.append({"text": ast.unparse(node.value).replace("self.", ""), "when": when})
                elif isinstance(node, ast.YieldFrom):
                    text = f"and what {ast.unparse(node.value).replace('self.', '')} states"
                    found.append({"text": text, "when": when})
    return found


def _print(content: Mapping[str, Any]) -> None:
    say(f"{content['component']}   {content['kind']} of the library   {content['source']}")
    say()
    for line in content["doc"].split("\n"):
        say(f"    {line}".rstrip())
    say()
    say(f"    {content['import']}")
    _head(content["connectors"], "Connectors", [(c["path"], c["type"], c["carries"]) for c in content["connectors"]])
    for key, title in _TITLES.items():
        required = "required" if key in ("parameters", "structural") else ""
        rows = [_row(d, required, key) for d in content[key]]
        _head(rows, title, rows)
    _head(content["parts"], "Parts", [(p["path"], p["type"], p["doc"]) for p in content["parts"]])
    _head(content["equations"], "Equations", [(_cut(e["text"]), e["when"]) for e in content["equations"]])
    used = content["used_in"]
    rows = [(kind, _some(names)) for kind, names in used.items() if names]
    _head(rows, "Used in", rows)


def _row(d: Mapping[str, Any], required: str, key: str) -> tuple[str, ...]:
    shape = "x".join(map(str, d["shape"]))
    unit = (d["unit"] or ("1" if key != "structural" else "")) + (f" ({shape})" if shape else "")
    default = d["default"] if d["default"] is not None else required
    return d["path"], default, unit, _limits(d["min"], d["max"]), d["doc"]


def _limits(low: float, high: float) -> str:
    texts = [f">= {low:g}" * (low != float("-inf")), f"<= {high:g}" * (high != float("inf"))]
    return ", ".join(t for t in texts if t)


def _cut(text: str) -> str:
    """A text shortened to a readable length; `--json` prints it in full."""
    return text if len(text) <= _WIDEST else text[: _WIDEST - 4] + " ..."


def _some(names: list[str]) -> str:
    more = len(names) - _MOST_USES
    return ", ".join(names[:_MOST_USES]) + (f" and {more} more" if more > 0 else "")


def _head(content: Any, title: str, rows: list[tuple[str, ...]]) -> None:
    if content:
        say()
        say(title)
        table(rows, indent="  ")
