"""The instance tree as a list: one entry per component, depth first, owners before their parts.

Inner and outer components follow the Modelica language 3.6, section 5.4: each `outer` is bound to the nearest enclosing
inner component.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field

from acausal.errors import DeclarationError
from acausal.language.check_model import check_model
from acausal.language.choices import Changing, Choice, is_changing
from acausal.language.component import STATING, Component, Connector
from acausal.language.declarations.declaration import Kind
from acausal.language.declarations.misuse import Declared, own_constructor, refuse_misnamed
from acausal.language.declarations.parts import Outer
from acausal.language.statement import Origin


@dataclass(eq=False, slots=True)
class Instance:
    """One component of the model.

    `first` maps declared names to the number of their first scalar, once these are allocated. `prefix`, the path and a
    dot, or "", precedes the names of its fields. `component` may be a view, because flattening must not change the
    user's component. `faces` are the other objects that expressions use for this instance: the user's component, and
    stand-ins of outer components.
    """

    component: Component
    path: str
    number: int
    owner: Instance | None
    parts: list[Instance] = field(default_factory=list)
    faces: list[Component] = field(default_factory=list)
    first: dict[str, int] = field(default_factory=dict)
    prefix: str = field(init=False)

    def __post_init__(self) -> None:
        self.prefix = self.path + "." if self.path else ""

    @property
    def is_leaf(self) -> bool:
        """True when all parts are connectors, so that equal instances have equal equations."""
        # A list, because for few parts a generator costs more.
        return not self.parts or all([isinstance(p.component, Connector) for p in self.parts])

    @property
    def origin(self) -> Origin:
        """Place in the source where the component is constructed."""
        origin: Origin = self.component.__dict__["_origin"]
        return origin

    def replace_by_view(self, component: Component) -> None:
        """Replace the component by a view of it."""
        self.faces.append(self.component)
        self.component = component

    def origin_of_value(self, name: str) -> Origin | Declared:
        """Place in the source of the value of a field: the call that made the component, else the class body."""
        is_given = name in self.component.__dict__["_given"]
        return self.origin if is_given else Declared(type(self.component), name, self.origin)


def numbers(all_instances: Iterable[Instance]) -> dict[int, int]:
    """Number of the instance of every component and face, by `id`."""
    return {id(c): i.number for i in all_instances for c in (i.component, *i.faces)}


def instances(model: Component, choices: Mapping[str, Choice] | None = None) -> list[Instance]:
    """All instances of a model; the model itself is the first, with an empty path.

    `choices` are structures of components by path; without one a component has all possible contacts.

    Raises UsageError: AC028 if `model` is not a component.
    """
    check_model(model)
    all_instances: list[Instance] = []
    _grow(all_instances, model, "", None, choices or {})
    return all_instances


def placed(model: Component, choices: Mapping[str, Choice] | None = None) -> tuple[list[Instance], tuple[str, ...]]:
    """All instances of a model with outer components bound, and notes on components that had to be added."""
    all_instances = instances(model, choices)
    return all_instances, _bind_outers(all_instances)


def components(model: Component) -> Iterator[tuple[str, Component]]:
    """All components of a model with their paths, without applying structures."""
    check_model(model)
    stack: list[tuple[str, Component]] = [("", model)]
    while stack:
        path, component = stack.pop()
        _check_constructed(component)
        yield path, component
        if component._parts:
            stack.extend(reversed(list(_parts(component, path + "." if path else ""))))


def changing(model: Component) -> dict[str, Changing]:
    """Components whose structure changes during a run, by path."""
    return {path: c for path, c in components(model) if is_changing(c) and c.is_variable()}


def _check_constructed(component: Component) -> None:
    """Refuse a component whose constructor has not called that of its base class."""
    if "_origin" not in component.__dict__:
        raise own_constructor(type(component)) or TypeError(component)


def _grow(
    all_instances: list[Instance], model: Component, path: str, owner: Instance | None, choices: Mapping[str, Choice]
) -> Instance:
    """Append a component and all its parts to `all_instances`; return the instance of the component itself."""
    first = len(all_instances)
    seen: dict[int, str] = {}
    stack: list[tuple[Component, str, Instance | None]] = [(model, path, owner)]
    while stack:
        component, path, owner = stack.pop()
        _check_constructed(component)
        refuse_misnamed(type(component), STATING)
        if id(component) in seen:
            raise DeclarationError(
                "AC117",
                f"the same {type(component).__name__} is both {seen[id(component)]} and {path}",
                where=(component.__dict__["_origin"].span(),),
                help="make one component per place",
            )
        seen[id(component)] = path
        instance = Instance(component, path, len(all_instances), owner)
        structured = _with_structure(component, path, choices)
        if structured is not component:
            instance.replace_by_view(structured)
            component = structured
        all_instances.append(instance)
        if owner is not None and len(all_instances) > first + 1:
            owner.parts.append(instance)
        if component._parts:
            stack.extend([(c, p, instance) for p, c in reversed(list(_parts(component, instance.prefix)))])
    return all_instances[first]


def _with_structure(component: Component, path: str, choices: Mapping[str, Choice]) -> Component:
    """A component with the structure chosen for it, else with all possible contacts."""
    if path in choices:
        return choices[path].applied()
    return component.whole().applied() if is_changing(component) else component


def _parts(component: Component, prefix: str) -> Iterator[tuple[str, Component]]:
    parts = component._parts
    if not parts:
        return
    for name, declaration in component._declarations.items():
        if declaration.kind is Kind.PART:
            value = parts[name]
            if isinstance(value, list):
                yield from ((f"{prefix}{name}[{k}]", v) for k, v in enumerate(value))
            else:
                yield prefix + name, value


def _bind_outers(all_instances: list[Instance]) -> tuple[str, ...]:
    """Bind the outer components of every instance; return notes on components that had to be added to the model.

    Raises DeclarationError: AC188 if no enclosing component has the inner one, AC189 if several match.
    """
    inner_of: dict[tuple[int, Outer[Component], str], Instance] = {}
    added: dict[tuple[type[Component], str], tuple[Instance, list[str]]] = {}
    bound: list[tuple[Instance, str, Instance]] = []
    for instance in all_instances:  # `all_instances` grows by the components added
        for name, declared in type(instance.component)._outers.items():
            inner = _find_inner(instance, name, declared, inner_of)
            if inner is None:
                key = declared.cls, name
                if key not in added:
                    added[key] = _add_default(all_instances, instance, name, declared), []
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
    instance: Instance,
    name: str,
    declared: Outer[Component],
    inner_of: dict[tuple[int, Outer[Component], str], Instance],
) -> Instance | None:
    """The nearest enclosing match for an outer component; None if there is none."""
    passed: list[tuple[int, Outer[Component], str]] = []
    enclosing, answer = instance.owner, None
    while enclosing is not None and answer is None:
        key = enclosing.number, declared, name
        answer = inner_of.get(key)
        if answer is None or answer is instance:
            passed.append(key)
            answer = _match(enclosing, instance, name, declared)
            enclosing = enclosing.owner
    if answer is not None and not isinstance(instance.component, declared.cls):
        inner_of |= dict.fromkeys(passed, answer)
    return answer


def _match(holder: Instance, instance: Instance, name: str, declared: Outer[Component]) -> Instance | None:
    """The match among the parts of one enclosing instance, or that instance itself."""
    fitting = [p for p in holder.parts if isinstance(p.component, declared.cls) and p is not instance]
    if len(fitting) > 1:
        fitting = [p for p in fitting if p.path == holder.prefix + name] or fitting
    if len(fitting) > 1:
        raise DeclarationError(
            "AC189",
            f"{_label(instance)} could mean {len(fitting)} components by its `{name}`",
            where=(instance.origin.span(),),
            evidence=[f"{p.path} ({type(p.component).__name__})" for p in fitting[:6]],
            help=f"keep one {declared.cls.__name__}, or call the one that is meant `{name}`",
        )
    if fitting:
        return fitting[0]
    return holder if isinstance(holder.component, declared.cls) else None


def _add_default(all_instances: list[Instance], instance: Instance, name: str, declared: Outer[Component]) -> Instance:
    """Add the default of an outer component to the model; return its instance."""
    model = all_instances[0]
    if declared.default is None:
        raise DeclarationError(
            "AC188",
            f"{_label(instance)} finds no {declared.cls.__name__} around it",
            where=(instance.origin.span(),),
            cause=declared.doc or None,
            help=f"declare one in {type(model.component).__name__}: "
            f"{name}: {declared.cls.__name__} = {declared.cls.__name__}()",
        )
    paths = {i.path for i in all_instances} | set(model.component._declarations)
    while name in paths:
        name += "_"
    return _grow(all_instances, declared.default._copy(), name, model, {})


def _resolve_stand_in(inner: Instance, stand_in: Component) -> None:
    """Let a stand-in of an outer component, and its parts, represent an instance in expressions."""
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
