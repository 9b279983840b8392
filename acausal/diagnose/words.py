"""Names, places and equations as the author of the model knows them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from acausal.errors import Span, counted
from acausal.flatten.flat import FlatAssignment, FlatEquation, FlatSystem, FlatWhen, suffix
from acausal.language.component import Component
from acausal.language.declarations.declaration import Declaration
from acausal.language.declarations.misuse import declared_at

_WIDTH = 110
_LOOSE = " is zero: not connected"


def listed(names: Iterable[str], limit: int = 6) -> str:
    """`a, b and c`, or the first few and how many more there are."""
    found = list(dict.fromkeys(names))
    if len(found) > limit:
        return f"{', '.join(found[:limit])} and {len(found) - limit} more"
    return " and ".join([", ".join(found[:-1]), found[-1]] if len(found) > 1 else found)


def short(span: Span) -> str:
    """`components.py:31`, with the domain before it for the library: `electrical/components.py:31`."""
    path = Path(span.file)
    parent = f"{path.parent.name}/" if "library" in path.parts[-4:] else ""
    return f"{parent}{path.name}:{span.line}"


def line(flat: FlatSystem, equation: FlatEquation) -> str:
    """An equation with the class and the place it comes from."""
    text = flat.text(equation)
    if len(text) > _WIDTH:
        text = text[: _WIDTH - 4] + " ..."
    made_by_connect = isinstance(equation.source, str)
    found = flat.components.get(equation.component)
    names = [] if made_by_connect or found is None else [found.cls.__name__]
    places = [] if equation.origin is None else [short(equation.origin.span())]
    return f"{text}   ({', '.join(names + places)})"


def lines(flat: FlatSystem, equations: Sequence[FlatEquation], limit: int = 6) -> list[str]:
    """Lines of several equations; entries of one vector equation are one line."""
    found = list(dict.fromkeys(line(flat, e) for e in equations))
    more = [f"and {counted(len(found) - limit, 'more equation')}"] if len(found) > limit else []
    return [f"  {text}" for text in found[:limit] + more]


def component_of(flat: FlatSystem, path: str) -> str:
    """Path of the component that a variable or a connector belongs to."""
    owner = _above(path)
    while owner and owner in flat.components and flat.components[owner].is_connector:
        owner = _above(owner)
    return owner


def _above(path: str) -> str:
    return path.rpartition(".")[0]


def connector_of(flat: FlatSystem, path: str) -> str | None:
    """Path of the connector that a variable belongs to, if it is one's."""
    owner = _above(path)
    found = flat.components.get(owner)
    return owner if found is not None and found.is_connector else None


def label(flat: FlatSystem, path: str) -> str:
    """Name of a component: its path, or the model's class name for the outermost."""
    return path or flat.name


def subject(flat: FlatSystem, fact: str, path: str) -> str:
    """`Model: part fact` for a part, `Model fact` for the outermost component itself."""
    return f"{flat.name}: {path} {fact}" if path else f"{flat.name} {fact}"


def equations_of(flat: FlatSystem, components: Sequence[str]) -> str:
    """`Model: equations of a and b`, or `equations of Model` when they are its own."""
    components = list(dict.fromkeys(components))
    if components == [""]:
        return f"equations of {flat.name}"
    return f"{flat.name}: equations of {listed((label(flat, c) for c in components), 3)}"


def places(
    flat: FlatSystem, equations: Iterable[FlatEquation | FlatAssignment | FlatWhen], limit: int = 3
) -> list[Span]:
    """Where equations stand; for those of the library, where the component was made that they belong to."""
    found: list[Span] = []
    for e in equations:
        of_library = e.origin is None or "library" in Path(e.origin.span().file).parts[-4:]
        found += made_at(flat, e.component) if of_library or e.origin is None else (e.origin.span(),)
    return list(dict.fromkeys(found))[:limit]


def loose(flat: FlatSystem, connectors: Iterable[str]) -> list[str]:
    """Those connectors that nothing is connected to."""
    wanted = dict.fromkeys(connectors)
    texts = [e.source for e in flat.equations if isinstance(e.source, str) and e.source.endswith(_LOOSE)]
    return [path for path in wanted if any(text.endswith(f" of {path}{_LOOSE}") for text in texts)]


def unconnected(flat: FlatSystem, component: str) -> bool:
    """True for a component with connectors of its own to none of which anything is connected."""
    own = [p for p, c in flat.components.items() if c.is_connector and _above(p) == component]
    return bool(component and own) and len(loose(flat, own)) == len(own)


def made_at(flat: FlatSystem, path: str) -> tuple[Span, ...]:
    """Where the component was made; for the model itself, where its equations are."""
    found = flat.components.get(path)
    if found is None:
        return ()
    return (stated_at(found.cls) if not path else ()) or (found.origin.span(),)


def parameter_at(flat: FlatSystem, path: str | None) -> tuple[Span, ...]:
    """Where a parameter has its value from: where its component was made; for the model's own, where it is declared."""
    if path is None:
        return ()
    owner, _, name = path.rpartition(".")
    return made_at(flat, owner) if owner else declared_at(flat.components[""].cls, name.partition("[")[0])


def stated_at(cls: type[Component]) -> tuple[Span, ...]:
    """Where the equations of a class begin."""
    for base in cls.__mro__:
        method = base.__dict__.get("equations")
        code = getattr(method, "__code__", None)
        if code is not None:
            return (Span(code.co_filename, code.co_firstlineno),)
    return ()


def hint(declarations: Iterable[Declaration]) -> tuple[str | None, str | None]:
    """Cause and help from the first hint declared beside one of the variables: `cause; help`, or a cause only."""
    for declaration in declarations:
        if declaration.hint:
            cause, _, advice = declaration.hint.partition("; ")
            return cause, advice or None
    return None, None


def names_of(flat: FlatSystem, scalars: Iterable[int]) -> list[str]:
    """Every declared name that stands for one of the scalars: connected potentials have several."""
    wanted = set(scalars)
    return [
        v.path + suffix(v.declaration.shape, k - v.first)
        for v in flat.variables
        for k in range(v.first, v.first + v.size)
        if k in wanted
    ]
