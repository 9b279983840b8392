"""Texts for messages: names, places and equations as the author of the model wrote them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from acausal.errors import Span, counted
from acausal.flatten.flat import FlatAssignment, FlatEquation, FlatSystem, FlatWhen, suffix
from acausal.language.component import Component
from acausal.language.declarations.declaration import Declaration
from acausal.language.declarations.misuse import declared_at

_WIDTH = 110
_NOT_CONNECTED = " is zero: not connected"


def listed(names: Iterable[str], limit: int = 6) -> str:
    """`a, b and c`, or the first few of many and the number of the others."""
    names_in_order = list(dict.fromkeys(names))
    if len(names_in_order) > limit:
        return f"{', '.join(names_in_order[:limit])} and {len(names_in_order) - limit} more"
    return " and ".join(
        [", ".join(names_in_order[:-1]), names_in_order[-1]] if len(names_in_order) > 1 else names_in_order
    )


def short(span: Span) -> str:
    """`components.py:31`, preceded by the domain for the library: `electrical/components.py:31`."""
    path = Path(span.file)
    parent = f"{path.parent.name}/" if "library" in path.parts[-4:] else ""
    return f"{parent}{path.name}:{span.line}"


def line(flat: FlatSystem, equation: FlatEquation) -> str:
    """An equation with its class and its place in the source."""
    text = flat.text(equation)
    if len(text) > _WIDTH:
        text = text[: _WIDTH - 4] + " ..."
    made_by_connect = isinstance(equation.source, str)
    owner = flat.components.get(equation.component)
    names = [] if made_by_connect or owner is None else [owner.cls.__name__]
    sources = [] if equation.origin is None else [short(equation.origin.span())]
    return f"{text}   ({', '.join(names + sources)})"


def lines(flat: FlatSystem, equations: Sequence[FlatEquation], limit: int = 6) -> list[str]:
    """Lines of several equations; entries of one vector equation are one line."""
    texts = list(dict.fromkeys(line(flat, e) for e in equations))
    more = [f"and {counted(len(texts) - limit, 'more equation')}"] if len(texts) > limit else []
    return [f"  {text}" for text in texts[:limit] + more]


def component_of(flat: FlatSystem, path: str) -> str:
    """Path of the component to which a variable or a connector belongs."""
    owner = _above(path)
    while owner and owner in flat.components and flat.components[owner].is_connector:
        owner = _above(owner)
    return owner


def _above(path: str) -> str:
    return path.rpartition(".")[0]


def connector_of(flat: FlatSystem, path: str) -> str | None:
    """Path of the connector to which a variable belongs; None if it belongs to none."""
    owner = _above(path)
    component = flat.components.get(owner)
    return owner if component is not None and component.is_connector else None


def label(flat: FlatSystem, path: str) -> str:
    """Name of a component: its path, or the model's class name for the outermost."""
    return path or flat.name


def subject(flat: FlatSystem, fact: str, path: str) -> str:
    """`Model: part fact` for a part, `Model fact` for the outermost component itself."""
    return f"{flat.name}: {path} {fact}" if path else f"{flat.name} {fact}"


def equations_of(flat: FlatSystem, components: Sequence[str]) -> str:
    """`Model: equations of a and b`, or `equations of Model` if they are those of the model itself."""
    components = list(dict.fromkeys(components))
    if components == [""]:
        return f"equations of {flat.name}"
    return f"{flat.name}: equations of {listed((label(flat, c) for c in components), 3)}"


def places(
    flat: FlatSystem, equations: Iterable[FlatEquation | FlatAssignment | FlatWhen], limit: int = 3
) -> list[Span]:
    """Places of equations in the source; for those of the library, where their component was made."""
    spans: list[Span] = []
    for e in equations:
        of_library = e.origin is None or "library" in Path(e.origin.span().file).parts[-4:]
        spans += made_at(flat, e.component) if of_library or e.origin is None else (e.origin.span(),)
    return list(dict.fromkeys(spans))[:limit]


def loose(flat: FlatSystem, connectors: Iterable[str]) -> list[str]:
    """Those of the connectors to which nothing is connected."""
    wanted = dict.fromkeys(connectors)
    texts = [e.source for e in flat.equations if isinstance(e.source, str) and e.source.endswith(_NOT_CONNECTED)]
    return [path for path in wanted if any(text.endswith(f" of {path}{_NOT_CONNECTED}") for text in texts)]


def unconnected(flat: FlatSystem, component: str) -> bool:
    """True for a component that has connectors, none of which is connected."""
    connectors = [p for p, c in flat.components.items() if c.is_connector and _above(p) == component]
    return bool(component and connectors) and len(loose(flat, connectors)) == len(connectors)


def made_at(flat: FlatSystem, path: str) -> tuple[Span, ...]:
    """Place where the component was made; for the model itself, where its equations begin."""
    component = flat.components.get(path)
    if component is None:
        return ()
    return (stated_at(component.cls) if not path else ()) or (component.origin.span(),)


def parameter_at(flat: FlatSystem, path: str | None) -> tuple[Span, ...]:
    """Place where a parameter gets its value: where its component was made; for the model itself, its declaration."""
    if path is None:
        return ()
    owner, _, name = path.rpartition(".")
    return made_at(flat, owner) if owner else declared_at(flat.components[""].cls, name.partition("[")[0])


def stated_at(cls: type[Component]) -> tuple[Span, ...]:
    """Place where the equations of a class begin."""
    for base in cls.__mro__:
        method = base.__dict__.get("equations")
        code = getattr(method, "__code__", None)
        if code is not None:
            return (Span(code.co_filename, code.co_firstlineno),)
    return ()


def hint(declarations: Iterable[Declaration]) -> tuple[str | None, str | None]:
    """Cause and help from the first hint in the declarations: `cause; help`, or only a cause."""
    for declaration in declarations:
        if declaration.hint:
            cause, _, advice = declaration.hint.partition("; ")
            return cause, advice or None
    return None, None


def names_of(flat: FlatSystem, scalars: Iterable[int]) -> list[str]:
    """All declared names of the scalars; connected potentials have several."""
    requested = set(scalars)
    return [
        v.path + suffix(v.declaration.shape, k - v.first)
        for v in flat.variables
        for k in range(v.first, v.first + v.size)
        if k in requested
    ]
