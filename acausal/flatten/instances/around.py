"""Inner and outer (Modelica language 3.6, section 5.4): whom the outer components of all instances are."""

from __future__ import annotations

from collections.abc import Mapping

from acausal.errors import DeclarationError
from acausal.flatten.instances.instances import Instance, grow, instances
from acausal.language.choices import Choice
from acausal.language.component import Component
from acausal.language.declarations.outer import Outer


def placed(model: Component, choices: Mapping[str, Choice] | None = None) -> tuple[list[Instance], tuple[str, ...]]:
    """All instances of a model as it runs, outer components known; notes on those that had to be added."""
    found = instances(model, choices)
    return found, bind_outers(found)


def bind_outers(found: list[Instance]) -> tuple[str, ...]:
    """Let every instance see its outer components; notes on those that had to be added to the model.

    Raises DeclarationError: AC188 when a component needs one that is not around it, AC189 when several could be meant.
    """
    known: dict[tuple[int, Outer[Component], str], Instance] = {}
    added: dict[tuple[type[Component], str], tuple[Instance, list[str]]] = {}
    bound: list[tuple[Instance, str, Instance]] = []
    for instance in found:  # grows by what is added
        for name, wanted in type(instance.component)._outers.items():
            inner = _inner(instance, name, wanted, known)
            if inner is None:
                key = wanted.cls, name
                if key not in added:
                    added[key] = _added(found, instance, name, wanted), []
                inner = added[key][0]
                added[key][1].append(instance.path or type(instance.component).__name__)
            bound.append((instance, name, inner))
    for instance in dict.fromkeys(i for i, _, _ in bound):
        instance.seen_as(instance.component._view())
    for instance, name, inner in bound:
        _stand_for(inner, instance.component.__dict__[name])
        instance.component.__dict__[name] = inner.component  # of the view, which nobody else has seen yet
    return tuple(_note(inner, users) for inner, users in added.values())


def _inner(
    instance: Instance, name: str, wanted: Outer[Component], known: dict[tuple[int, Outer[Component], str], Instance]
) -> Instance | None:
    """The nearest instance around that is wanted; None when there is none."""
    passed: list[tuple[int, Outer[Component], str]] = []
    here, answer = instance.owner, None
    while here is not None and answer is None:
        key = here.number, wanted, name
        answer = known.get(key)
        if answer is None or answer is instance:
            passed.append(key)
            answer = _of(here, instance, name, wanted)
            here = here.owner
    if answer is not None and not isinstance(instance.component, wanted.cls):
        known |= dict.fromkeys(passed, answer)
    return answer


def _of(holder: Instance, instance: Instance, name: str, wanted: Outer[Component]) -> Instance | None:
    """What is wanted among the parts of one holder, or the holder itself."""
    fitting = [p for p in holder.parts if isinstance(p.component, wanted.cls) and p is not instance]
    if len(fitting) > 1:
        fitting = [p for p in fitting if p.path == holder.prefix + name] or fitting
    if len(fitting) > 1:
        raise DeclarationError(
            "AC189",
            f"{_named(instance)} could mean {len(fitting)} components by its `{name}`",
            where=(instance.origin.span(),),
            evidence=[f"{p.path} ({type(p.component).__name__})" for p in fitting[:6]],
            help=f"keep one {wanted.cls.__name__}, or call the one that is meant `{name}`",
        )
    if fitting:
        return fitting[0]
    return holder if isinstance(holder.component, wanted.cls) else None


def _added(found: list[Instance], instance: Instance, name: str, wanted: Outer[Component]) -> Instance:
    """The default, put into the model."""
    model = found[0]
    if wanted.default is None:
        raise DeclarationError(
            "AC188",
            f"{_named(instance)} finds no {wanted.cls.__name__} around it",
            where=(instance.origin.span(),),
            cause=wanted.doc or None,
            help=f"declare one in {type(model.component).__name__}: "
            f"{name}: {wanted.cls.__name__} = {wanted.cls.__name__}()",
        )
    paths = {i.path for i in found} | set(model.component._declarations)
    while name in paths:
        name += "_"
    return grow(found, wanted.default._copy(), name, model, {})


def _stand_for(inner: Instance, stand_in: Component) -> None:
    """Let an instance be what its stand-in, and the parts of this, are in expressions."""
    inner.faces.append(stand_in)
    parts = {p.path: p for p in inner.parts}
    for name, part in stand_in._parts.items():
        _stand_for(parts[inner.prefix + name], part)  # type: ignore[arg-type]


def _note(inner: Instance, users: list[str]) -> str:
    shown = ", ".join(users[:4]) + (f" and {len(users) - 4} more" if len(users) > 4 else "")
    return f"no {type(inner.component).__name__} around {shown}: one with its defaults is added, as {inner.path}"


def _named(instance: Instance) -> str:
    cls = type(instance.component).__name__
    return f"{instance.path} ({cls})" if instance.path else cls
