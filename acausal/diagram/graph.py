"""The graph of a model's composition: blocks in blocks, connectors at their sides, connections between them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from acausal.diagram.symbols import family_of, sides_of, symbol_of
from acausal.flatten.instances.composition import Composition, compose
from acausal.flatten.instances.instances import Instance
from acausal.language.component import Component, Connector
from acausal.language.connections.connect import Connection, is_element, signal_of
from acausal.language.declarations.declaration import Declaration, Kind
from acausal.language.expressions.expression import Expr, Symbol

Graph = dict[str, Any]
"""A block: `path`, `name`, `cls`, `doc`, `values`, `symbol`, `ports`, `blocks` and `edges`, ready for JSON."""

_WEST = ("frame_a", "flange_a", "p", "p1", "port_a", "plug_p", "fluid", "bearing")
_EAST = ("frame_b", "flange_b", "n", "n2", "p2", "port_b", "plug_n", "frame_w", "flange", "solid", "port")
_SIDES = {"axis": "N", "support": "S", "heatPort": "S", **dict.fromkeys(_WEST, "W"), **dict.fromkeys(_EAST, "E")}
_SIDES |= {"n1": "W", "frames": "E"}
_FAMILIES = ("electrical", "translational", "rotational", "thermal", "multibody")
_LONGEST = 24


def graph_of(model: Component) -> Graph:
    """The graph of a model with all its parts.

    Raises AcausalError: for faults of the composition itself: connected ends outside the model, missing outer
    components.
    """
    composition = compose(model)
    edges: dict[int, list[Graph]] = {}
    for by, connection in composition.connections:
        edges.setdefault(by, []).extend(_edges(composition, by, connection))
    connected = {tuple(end) for found in edges.values() for e in found for end in (e["from"], e["to"])}
    return _block(composition.found[0], edges, connected, model)


def _block(
    instance: Instance, edges: dict[int, list[Graph]], connected: set[tuple[str, str]], model: Component
) -> Graph:
    component = instance.component
    parts = [p for p in instance.parts if not isinstance(p.component, Connector)]
    name = instance.path.rpartition(".")[2]
    return {
        "path": instance.path,
        "name": name or type(model).__name__,
        "cls": type(component).__name__,
        "doc": (type(component).__doc__ or "").split("\n")[0],
        "domain": _domain_of(instance),
        "values": _values(component),
        "symbol": symbol_of(type(component)) or "",
        "ports": list(_ports(instance, connected)),
        "blocks": [_block(p, edges, connected, model) for p in parts],
        "edges": edges.get(instance.number, []),
    }


def _ports(instance: Instance, connected: set[tuple[str, str]]) -> Iterator[Graph]:
    """Connectors of a component, and those of its signals that are connected."""
    component, special = instance.component, sides_of(instance.component)
    single = sum(isinstance(p.component, Connector) for p in instance.parts) == 1
    for p in instance.parts:
        if isinstance(p.component, Connector):
            name = p.path.removeprefix(instance.prefix)
            side = special.get(name) or _side(name, single)
            if side in "NS" and (instance.path, name) not in connected and instance.owner is not None:
                continue  # optional, such as the drive of a joint
            yield {"name": name, "side": side, "domain": domain(p.component), "direction": ""}
    for name, d in component._declarations.items():
        if d.kind in (Kind.INPUT, Kind.OUTPUT) and (instance.path, name) in connected:
            is_input = d.kind is Kind.INPUT
            side = special.get(name) or ("W" if is_input else "E")
            yield {"name": name, "side": side, "domain": _signal(d), "direction": "in" if is_input else "out"}


def _side(name: str, single: bool) -> str:
    """Side of a connector from its Modelica name: `..._a` is left, `..._b` right; an index does not matter."""
    known = _SIDES.get(name)
    if known is not None:
        return known
    base = name.partition("[")[0]
    if base in _SIDES:
        return _SIDES[base]
    if base.endswith("_a"):
        return "W"
    return "E" if base.endswith("_b") or single else "W"


def domain(connector: Connector) -> str:
    """The library of the connector's class, which determines its colour."""
    for cls in type(connector).__mro__:
        if family_of(cls) in _FAMILIES:
            return family_of(cls)
    return "other"


def _domain_of(instance: Instance) -> str:
    """The domain of a component: that of most of its connectors."""
    found = [domain(p.component) for p in instance.parts if isinstance(p.component, Connector)]
    return max(dict.fromkeys(found), key=found.count) if found else "signal"


def _signal(d: Declaration) -> str:
    return "boolean" if d.boolean else "integer" if d.integer else "signal"


def _values(component: Component) -> list[str]:
    """Texts of the parameters that were given to the component: `c = 100 N/m`."""
    shown = []
    for name, d in component._declarations.items():
        if d.kind is Kind.PARAMETER and name in component.__dict__["_given"]:
            value = component.__dict__["_values"].get(name)
            if isinstance(value, Expr):
                text = _number(value.payload) if value.op == "const" else str(value)
                unit = f" {d.unit}" if value.op == "const" and d.unit not in ("", "1") else ""
                shown.append(f"{name} = {text[:_LONGEST]}{unit}")
    return shown


def _number(value: object) -> str:
    if isinstance(value, tuple):
        return "(" + ", ".join(_number(v) for v in value) + ")"
    return f"{value:g}" if isinstance(value, float | int) else str(value)


def _edges(composition: Composition, by: int, connection: Connection) -> Iterator[Graph]:
    """A connection as lines between pairs of ends: a star around one of them."""
    ends = [_end(composition, end) for end in connection.ends]
    if isinstance(connection.ends[0], Expr):
        declarations = [signal_of(e).declaration for e in connection.ends if isinstance(e, Expr)]
        is_source = [(d.kind is Kind.INPUT) == (owner == by) for d, (owner, _) in zip(declarations, ends, strict=True)]
        source = is_source.index(True) if True in is_source else 0
        for k, end in enumerate(ends):
            if k != source:
                yield _edge(composition, ends[source], end, _signal(declarations[source]))
        return
    connectors = [e for e in connection.ends if isinstance(e, Connector)]
    kind = domain(connectors[0])
    inner = [_facing(composition, by, owner, name) for owner, name in ends]
    hub = _hub(inner)
    for k in range(len(ends)):
        if k != hub:
            first, second = (hub, k) if _rank(inner[hub]) <= _rank(inner[k]) else (k, hub)
            yield _edge(composition, ends[first], ends[second], kind)


def _edge(composition: Composition, a: tuple[int, str], b: tuple[int, str], kind: str) -> Graph:
    return {
        "from": [composition.found[a[0]].path, a[1]],
        "to": [composition.found[b[0]].path, b[1]],
        "domain": kind,
        "forward": a[0] < b[0],
        "directed": kind in ("signal", "boolean", "integer"),
    }


def _end(composition: Composition, end: Connector | Expr) -> tuple[int, str]:
    """Number of the component at an end, and the name of its connector or signal."""
    if isinstance(end, Connector):
        instance = composition.found[composition.number_of[id(end)]]
        assert instance.owner is not None, "a connector is a part"
        return instance.owner.number, instance.path.removeprefix(instance.owner.prefix)
    symbol: Symbol = signal_of(end) if is_element(end) else end  # type: ignore[assignment]
    return composition.number_of[id(symbol.owner)], symbol.name


def _facing(composition: Composition, by: int, owner: int, name: str) -> str:
    """The side from which a line leaves a connector: inside its own composite it is the opposite one."""
    instance = composition.found[owner]
    single = sum(isinstance(p.component, Connector) for p in instance.parts) == 1
    side = sides_of(instance.component).get(name) or _side(name, single)
    return {"W": "E", "E": "W", "N": "S", "S": "N"}[side] if owner == by else side


def _rank(side: str) -> int:
    """Rank of a side: lines run from left to right, from an eastern connector to a western one."""
    return {"E": 0, "N": 1, "S": 1, "W": 2}[side]


def _hub(sides: list[str]) -> int:
    """Index of the end at the centre of the star: the only one on its side, else the first."""
    for side in ("E", "W"):
        if sides.count(side) == 1 and len(sides) > 2:
            return sides.index(side)
    return 0
