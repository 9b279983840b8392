"""`connect(a, b, ...)`: potentials become equal, flows sum to zero, an output drives inputs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

from acausal.errors import DeclarationError, UnitError
from acausal.language.component import Component, Connector
from acausal.language.declarations.declaration import Kind
from acausal.language.expressions.expression import Expr, Symbol, shape_text
from acausal.language.statement import RECORDING, Statement, made
from acausal.units import ambiguous, parse

Connectable = TypeVar("Connectable", bound=Connector | Expr)
_ENDS = (Connector, Symbol)


@dataclass(frozen=True)
class Connection(Statement):
    """A connection, made by `connect`; yield it like an equation."""

    ends: tuple[Connector, ...] | tuple[Expr, ...]

    def __post_init__(self) -> None:
        made(self)

    def __str__(self) -> str:
        return f"connect({', '.join(_name(end) for end in self.ends)})"


def connect(first: Connectable, second: Connectable, *more: Connectable) -> Connection:
    """Connect connectors of one type, or a signal output with signal inputs, including elements such as `self.u[2]`.

    Raises
    ------
    DeclarationError
        AC120 when the ends are of different types, AC121 when an end is neither connector nor signal, AC186 outside of
        the methods of a component, where the connection would be lost.
    UnitError
        AC154 when connected signals have different dimensions.
    """
    ends = (first, second, *more)
    for end in ends:
        if not isinstance(end, _ENDS) and not is_element(end):
            shown = _component_name(end) if isinstance(end, Component) else f"`{end}`"
            has = _connectors_of(end)
            raise DeclarationError(
                "AC121",
                f"{shown} is neither a connector nor a signal",
                help=f"connect one of its connectors: {has}" if has else "connect flanges, frames, pins or signals",
            )
    kinds: set[type] = {Symbol if is_element(end) else type(end) for end in ends}
    if len(kinds) > 1:
        shown = " and ".join(f"{_name(e)} ({_type_name(e, kinds)})" for e in ends)
        raise DeclarationError(
            "AC120",
            f"cannot connect {shown}",
            cause="a connection joins connectors of one type",
            help="put a component that has both connectors between them",
        )
    repeated = next((e for k, e in enumerate(ends) if any(_is_same(e, other) for other in ends[:k])), None)
    if repeated is not None:
        raise DeclarationError(
            "AC121",
            f"{_name(repeated)} is connected with itself",
            help="name the other end; a connection with itself has no effect",
        )
    if isinstance(first, Expr):
        _check_signals(ends)  # type: ignore[arg-type]
    connection = Connection(ends)  # type: ignore[arg-type]
    if RECORDING.get() is None:
        raise DeclarationError(
            "AC186",
            f"`{connection}` is made outside of a component's `equations`",
            cause="it would be lost: only statements that methods of components yield are part of a model",
            help="yield it in the `equations` of a component that has both ends, or of a class derived from it",
        )
    return connection


def _is_same(a: object, b: object) -> bool:
    if isinstance(a, Expr) and isinstance(b, Expr) and a.op == b.op == "index":
        return a.args[0] is b.args[0] and a.payload == b.payload
    return a is b


def is_element(end: object) -> bool:
    """Whether an end of a connection is an element of a signal that is a vector or a matrix."""
    return isinstance(end, Expr) and end.op == "index" and isinstance(end.args[0], Symbol)


def signal_of(end: Expr) -> Symbol:
    """The signal at an end of a connection; for an element the whole signal."""
    signal = end.args[0] if is_element(end) else end
    assert isinstance(signal, Symbol), "checked by connect"
    return signal


def _check_signals(ends: tuple[Expr, ...]) -> None:
    first, declared = ends[0], signal_of(ends[0]).declaration
    for end in ends:
        of_end = signal_of(end).declaration
        if of_end.kind not in (Kind.INPUT, Kind.OUTPUT):
            owner = signal_of(end).owner
            signals = [n for n, d in type(owner)._declarations.items() if d.kind in (Kind.INPUT, Kind.OUTPUT)]
            raise DeclarationError(
                "AC121",
                f"`{end}` is a {of_end.kind.value}, not a signal",
                evidence=[f"signals of {type(owner).__name__}: {', '.join(signals[:6])}"] if signals else [],
                help="only signal_input and signal_output can be connected; write an equation for anything else",
            )
        if end.shape != first.shape:
            raise DeclarationError(
                "AC105",
                f"`{first}` ({shape_text(first.shape)}) and `{end}` ({shape_text(end.shape)}) cannot be connected",
                help="connected signals have the same shape",
            )
        if of_end.boolean != declared.boolean:
            on, number = (first, end) if declared.boolean else (end, first)
            raise DeclarationError(
                "AC147",
                f"`{on}` is boolean, `{number}` is a number: they cannot be connected",
                help="put a BooleanToReal or a GreaterThreshold of acausal.library.blocks between them",
            )
        a, b = declared.unit, of_end.unit
        if a and b and parse(a).dimension != parse(b).dimension:
            raise UnitError(
                "AC154",
                f"`{first}` [{a}] and `{end}` [{b}] cannot be connected: their dimensions differ",
                help="put a Gain that states the conversion between them",
            )
        reason = ambiguous(a, b) if a and b else None
        if reason is not None:
            raise UnitError(
                "AC154",
                f"`{first}` [{a}] and `{end}` [{b}] cannot be connected: one counts cycles, the other one radians",
                evidence=[reason],
                help="put a Gain of 2*pi, or of its inverse, between them",
            )


def _type_name(end: Connector | Expr, kinds: set[type]) -> str:
    """Class name of an end, with its library if classes of the same name are connected."""
    cls = type(end)
    if sum(kind.__name__ == cls.__name__ for kind in kinds) == 1:
        return "signal" if isinstance(end, Expr) else cls.__name__
    package = cls.__module__.split(".")
    return f"{'.'.join(package[-2:-1] or package)}.{cls.__name__}"


def _name(end: Connector | Expr) -> str:
    return str(end) if isinstance(end, Expr) else end._path_to("").rstrip(".")


def _component_name(component: Component) -> str:
    path = component._path_to("").rstrip(".")
    return f"{path} ({type(component).__name__})" if path else f"a {type(component).__name__}"


def _connectors_of(end: object) -> str:
    if not isinstance(end, Component):
        return ""
    return ", ".join(n for n, p in end._parts.items() if isinstance(p, Connector))
