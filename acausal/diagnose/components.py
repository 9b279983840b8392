"""Components that state too few or too many equations for their unknowns.

Connections contribute one equation for every potential of a connector (Modelica 3.6, section 4.8), so that a component
has to state one for each of its own variables and one for each flow of its connectors.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from acausal.diagnose.words import (
    component_of,
    connector_of,
    hint,
    label,
    lines,
    listed,
    loose,
    made_at,
    places,
    stated_at,
    subject,
)
from acausal.errors import StructureError, counted
from acausal.flatten.flat import FlatEquation, FlatSystem, FlatVariable
from acausal.language.component import Component
from acausal.language.declarations.declaration import Kind


@dataclass
class _Count:
    own: list[FlatVariable] = field(default_factory=list)
    flows: list[FlatVariable] = field(default_factory=list)
    stated: list[FlatEquation] = field(default_factory=list)
    is_oriented: bool = False
    is_composite: bool = False

    def imbalance(self) -> int:
        """Number of equations too many (positive) or too few (negative); 0 if it cannot be decided."""
        if self.is_oriented:
            return 0
        least = sum(v.size for v in self.own)
        most = least + sum(v.size for v in self.flows)
        if not self.is_composite:
            return len(self.stated) - most
        # Inside a composite, connections may determine the flows of its own connectors.
        return min(len(self.stated) - least, 0) or max(len(self.stated) - most, 0)


def unbalanced_component(flat: FlatSystem) -> StructureError | None:
    """AC201 or AC202 if a single component is the cause."""
    missing = flat.n_scalars - len(flat.inputs) - len(flat.equations)
    counts = _counts(flat)
    if missing == 0:
        return _both_ways(flat, counts)
    unbalanced = [p for p, c in counts.items() if c.imbalance() * missing < 0]
    if not unbalanced:
        return None
    path = min(unbalanced, key=lambda p: (counts[p].is_composite, p.count("."), p))
    alike = [p for p in unbalanced if p != path and flat.components[p].cls is flat.components[path].cls]
    return (_too_few if missing > 0 else _too_many)(flat, path, counts[path], alike)


def _both_ways(flat: FlatSystem, counts: dict[str, _Count]) -> StructureError | None:
    """AC201 if one component without parts has too few equations and another too many, which balance each other."""
    imbalance = {p: c.imbalance() for p, c in counts.items() if not c.is_composite and c.imbalance()}
    few, many = ([p for p in imbalance if imbalance[p] * sign > 0] for sign in (-1, 1))
    if not few or not many:
        return None
    error = _too_few(flat, few[0], counts[few[0]], [])
    other = many[0]
    error.evidence = (
        *error.evidence,
        f"while {label(flat, other)} {_balance(counts[other])}:",
        *lines(flat, counts[other].stated),
    )
    error.where = (*error.where[:1], *made_at(flat, other))
    return error


def _counts(flat: FlatSystem) -> dict[str, _Count]:
    counts = {p: _Count() for p, c in flat.components.items() if not c.is_connector}
    for path, component in flat.components.items():
        owner = component_of(flat, path)
        if path and not component.is_connector and owner in counts:
            counts[owner].is_composite = True
    computed: dict[int, str] = {}  # of connected outputs the innermost, which is the one that an equation computes
    for v in flat.variables:
        if v.declaration.kind is Kind.OUTPUT and v.path.count(".") >= computed.get(v.first, "").count("."):
            computed[v.first] = v.path
    for v in flat.variables:
        count = counts[component_of(flat, v.path)]
        count.is_oriented |= v.declaration.overconstrained
        if connector_of(flat, v.path) is not None:
            if v.declaration.kind is Kind.FLOW:
                count.flows.append(v)
        elif v.declaration.kind in (Kind.VARIABLE, Kind.FLOW) or computed.get(v.first) == v.path:
            count.own.append(v)
    inputs = {v.path for v in flat.variables if v.declaration.kind is Kind.INPUT}
    for e in flat.equations:
        if e.component in counts and not _of_connection(e, inputs):
            counts[e.component].stated.append(e)
    return counts


def _of_connection(equation: FlatEquation, inputs: set[str]) -> bool:
    """True for an equation that comes from a connection, and for the binding of an input."""
    source = equation.source
    if not isinstance(source, str):
        return False
    path, is_binding, _ = source.partition(" == ")
    return not is_binding or path in inputs


def _too_few(flat: FlatSystem, path: str, count: _Count, alike: list[str]) -> StructureError:
    cls = flat.components[path].cls
    declared = [v.path for v in count.own] + [v.path for v in count.flows]
    used = {k for e in count.stated for k in flat.pool.variables_in(e.left, e.right)}
    used |= {flat.pool.integral_of[k] for k in used if k in flat.pool.integral_of}
    unused = [v for v in count.own + count.flows if not used & set(range(v.first, v.first + v.size))]
    unknowns = sum(v.size for v in (*count.own, *count.flows))
    # The hint of a flow is about a flow that no component takes up, not about a component without an equation for it.
    cause, advice = hint(v.declaration for v in unused or count.own if v.declaration.kind is not Kind.FLOW)
    return StructureError(
        "AC201",
        subject(flat, _balance(count), path) + (f"; none contains {listed(v.path for v in unused)}" if unused else ""),
        where=[*made_at(flat, path), *stated_at(cls)],
        evidence=[f"unknowns: {listed(declared, 8)}", *_stated(flat, count.stated), *_alike_text(cls.__name__, alike)],
        cause=cause or "a component needs one equation for each own variable and one for each flow of its connectors",
        help=advice or f"state {counted(unknowns - len(count.stated), 'more equation')} in {cls.__name__}.equations",
    )


def _balance(count: _Count) -> str:
    unknowns = sum(v.size for v in (*count.own, *count.flows))
    return f"states {counted(len(count.stated), 'equation')} for {counted(unknowns, 'unknown')}"


def _stated(flat: FlatSystem, equations: list[FlatEquation]) -> list[str]:
    return ["equations:", *lines(flat, equations)] if equations else ["equations: none"]


def _alike_text(cls: str, alike: list[str]) -> list[str]:
    return [f"so do the other {cls}: {listed(alike, 4)}"] if alike else []


def _too_many(flat: FlatSystem, path: str, count: _Count, alike: list[str]) -> StructureError:
    cls = flat.components[path].cls
    unknowns = sum(v.size for v in (*count.own, *count.flows))
    surplus = len(count.stated) - unknowns
    bindings = [e for e in count.stated if isinstance(e.source, str)]
    surplus_equations = bindings or (count.stated if unknowns == 0 else [])
    fact = subject(flat, _balance(count), path)
    if len(surplus_equations) == 1:
        fact += f": `{flat.text(surplus_equations[0])}` is one too many"
    cause = "a component needs one equation for each own variable and one for each flow of its connectors, no more"
    if bindings:
        cause = "the constructor binds a variable that the component determines by its own equations"
    elif surplus_equations:
        ends = _loose(flat, surplus_equations)
        cause = "the parts and their connections already determine the variables of the parts"
        if ends:
            cause = f"{listed(ends)} is not connected, so its flow is zero; it cannot be given a potential as well"
    advice = _advice(bindings, surplus_equations, surplus, cls.__name__)
    base = _restated(cls, count.stated)
    if base is not None:
        cause = f"`super().equations()` repeats the equations of {base.__name__}, which a subclass inherits anyway"
        advice = "state the new equations only, without `yield from super().equations()`"
    return StructureError(
        "AC202",
        fact,
        where=places(flat, surplus_equations[:1]) or [*made_at(flat, path), *stated_at(cls)],
        evidence=[*_stated(flat, count.stated), *_alike_text(cls.__name__, alike)],
        cause=cause,
        help=advice,
    )


def _restated(cls: type[Component], stated: list[FlatEquation]) -> type[Component] | None:
    """The base class with an equation that its subclass `cls` repeats, from the same place in the source."""
    seen = set()
    for e in stated:
        origin_and_sides = (e.origin, e.left, e.right)
        code = getattr(e.origin, "code", None)
        if origin_and_sides in seen:
            for base in cls.__mro__[1:]:
                if code is not None and getattr(base.__dict__.get("equations"), "__code__", None) is code:
                    return base
        seen.add(origin_and_sides)
    return None


def _advice(bound: list[FlatEquation], blamed: list[FlatEquation], surplus: int, cls: str) -> str:
    if bound:
        field = str(bound[0].source).partition(" == ")[0].rpartition(".")[2]
        return f"make the {cls} without {field}=..., or with {field}=fixed(...) for a start value"
    if blamed:
        return "remove it, or connect a component that enforces it: a constraint needs a force, a voltage a current"
    return f"remove {counted(surplus, 'equation')} from {cls}"


def _loose(flat: FlatSystem, equations: list[FlatEquation]) -> list[str]:
    """Connectors in these equations to which nothing is connected."""
    scalars = {k for e in equations for k in flat.pool.variables_in(e.left, e.right)}
    paths = {connector_of(flat, v.path) for v in flat.variables if scalars & set(range(v.first, v.first + v.size))}
    return loose(flat, sorted(filter(None, paths)))
