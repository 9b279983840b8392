"""Inner and outer components (Modelica language 3.6, section 5.4): binding of each `outer` to the inner one."""

from __future__ import annotations

from collections.abc import Mapping

from acausal.errors import DeclarationError
from acausal.flatten.instances.instances import Instance, grow, instances
from acausal.language.choices import Choice
from acausal.language.component import Component
from acausal.language.declarations.parts import Outer


def placed(model: Component, choices: Mapping[str, Choice] | None = None) -> tuple[list[Instance], tuple[str, ...]]:
    """All instances of a model with outer components bound, and notes on components that had to be added."""
    found = instances(model, choices)
    return found, bind_outers(found)


def bind_outers(found: list[Instance]) -> tuple[str, ...]:
    """Bind the outer components of every instance; returns notes on components that had to be added to the model.

    Raises DeclarationError: AC188 when no enclosing component has the inner one, AC189 when several match.
    """
    known: dict[tuple[int, Outer[Component], str], Instance] = {}
    added: dict[tuple[type[Component], str], tuple[Instance, list[str]]] = {}
    bound: list[tuple[Instance, str, Instance]] = []
    for instance in found:  # `found` grows by the components added
        for name, wanted in type(instance.component)._outers.items():
            inner = _find_inner(instance, name, wanted, known)
            if inner is None:
                key = wanted.cls, name
                if key not in added:
                    added[key] = _add_default(found, instance, name, wanted), []
                inner = added[key][0]
                added[key][1].append(instance.path or type(instance.component).__name__)
            bound.append((instance, name, inner))
    for instance in dict.fromkeys(i for i, _, _ in bound):
        instance.replace_by_view(instance.component._view())
    for instance, name, inner in bound:
        _resolve_stand_in(inner, instance.component.__dict__[name])
        instance.component.__dict__[name] = inner.component  # the view is new and not shared yet
    return tuple(_note(inner, users) for inner, users in added.values())


def _find_inner(
    instance: Instance, name: str, wanted: Outer[Component], known: dict[tuple[int, Outer[Component], str], Instance]
) -> Instance | None:
    """The nearest enclosing match for an outer component; None when there is none."""
    passed: list[tuple[int, Outer[Component], str]] = []
    enclosing, answer = instance.owner, None
    while enclosing is not None and answer is None:
        key = enclosing.number, wanted, name
        answer = known.get(key)
        if answer is None or answer is instance:
            passed.append(key)
            answer = _match(enclosing, instance, name, wanted)
            enclosing = enclosing.owner
    if answer is not None and not isinstance(instance.component, wanted.cls):
        known |= dict.fromkeys(passed, answer)
    return answer


def _match(holder: Instance, instance: Instance, name: str, wanted: Outer[Component]) -> Instance | None:
    """The match among the parts of one enclosing instance, or that instance itself."""
    fitting = [p for p in holder.parts if isinstance(p.component, wanted.cls) and p is not instance]
    if len(fitting) > 1:
        fitting = [p for p in fitting if p.path == holder.prefix + name] or fitting
    if len(fitting) > 1:
        raise DeclarationError(
            "AC189",
            f"{_label(instance)} could mean {len(fitting)} components by its `{name}`",
            where=(instance.origin.span(),),
            evidence=[f"{p.path} ({type(p.component).__name__})" for p in fitting[:6]],
            help=f"keep one {wanted.cls.__name__}, or call the one that is meant `{name}`",
        )
    if fitting:
        return fitting[0]
    return holder if isinstance(holder.component, wanted.cls) else None


def _add_default(found: list[Instance], instance: Instance, name: str, wanted: Outer[Component]) -> Instance:
    """Add the default of an outer component to the model."""
    model = found[0]
    if wanted.default is None:
        raise DeclarationError(
            "AC188",
            f"{_label(instance)} finds no {wanted.cls.__name__} around it",
            where=(instance.origin.span(),),
            cause=wanted.doc or None,
            help=f"declare one in {type(model.component).__name__}: "
            f"{name}: {wanted.cls.__name__} = {wanted.cls.__name__}()",
        )
    paths = {i.path for i in found} | set(model.component._declarations)
    while name in paths:
        name += "_"
    return grow(found, wanted.default._copy(), name, model, {})


def _resolve_stand_in(inner: Instance, stand_in: Component) -> None:
    """Resolve a stand-in of an outer component, and its parts, to an instance in expressions."""
    inner.faces.append(stand_in)
    parts = {p.path: p for p in inner.parts}
    for name, part in stand_in._parts.items():
        _resolve_stand_in(parts[inner.prefix + name], part)  # type: ignore[arg-type]


def _note(inner: Instance, users: list[str]) -> str:
    shown = ", ".join(users[:4]) + (f" and {len(users) - 4} more" if len(users) > 4 else "")
    return f"no {type(inner.component).__name__} around {shown}: one with its defaults is added, as {inner.path}"


def _label(instance: Instance) -> str:
    cls = type(instance.component).__name__
    return f"{instance.path} ({cls})" if instance.path else cls
