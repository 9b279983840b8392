"""Operators on conditions and events: `pre`, `edge`, `change`, `sample`, `initial`, `terminal`, `no_event`, `smooth`.

Semantics: Modelica language specification 3.6, sections 3.7.5 and 8.5.
"""

from __future__ import annotations

from acausal.errors import DeclarationError
from acausal.language.expressions.expression import (
    CONDITIONS,
    Expr,
    Operand,
    Operation,
    Symbol,
    as_expr,
    checked_condition,
    is_condition,
    nodes,
    shape_error,
    shape_text,
    symbols_in,
)


def is_discrete(e: Expr) -> bool:
    """True for an expression that changes at events only: of discrete variables, relations, and functions of these."""
    return not any(
        not here.declaration.discrete and here.declaration.kind.value != "parameter"
        if isinstance(here, Symbol)
        else here.op in ("time", "der", "delay", "noevent", "call") or _is_smooth_choice(here)
        for here in nodes(e, into=lambda n: () if n.op in CONDITIONS else n.args)
    )


def _is_smooth_choice(e: Expr) -> bool:
    """Whether it is `where(..., smooth=True)`, whose condition makes no event."""
    return e.op == "where" and bool(e.payload)


def pre(x: Operand) -> Expr:
    """The value just before the event, in the unit of `x`: Modelica's `pre`.

    `pre` of a discrete variable or condition may be used anywhere; it is the value at the beginning of the event. `pre`
    of any other expression may be used in a `when` only, where it is the value before the actions. A relation below
    `no_event` is such an expression.
    """
    return _before(as_expr(x))


def _before(e: Expr, exempt: bool = False) -> Expr:
    exempt = exempt or e.op == "noevent" or _is_smooth_choice(e)
    if is_discrete(e) and not (exempt and any(n.op in CONDITIONS for n in nodes(e))):
        varies = is_condition(e) or any(s.declaration.discrete for s in symbols_in(e))
        return Operation("pre", (e,), e.shape) if varies and e.op != "pre" else e
    if isinstance(e, Symbol) or e.op in ("der", "delay", "time"):
        return Operation("pre", (e,), e.shape)
    # A mixed expression is evaluated with `pre` of its operands.
    return Operation(e.op, tuple(_before(a, exempt) for a in e.args), e.shape, e.payload)


def edge(condition: Expr) -> Expr:
    """True at the instants at which `condition` becomes true: it holds, but did not hold just before.

    Raises
    ------
    DeclarationError
        AC108 when `condition` is no condition, AC146 when it is below `no_event`, so that no instant is known.
    """
    return Operation("edge", (_checked_discrete("edge", checked_condition(condition)),), ())


def change(x: Expr) -> Expr:
    """True at the instants at which a discrete variable or a condition changes.

    Raises
    ------
    DeclarationError
        AC146 when `x` is neither, and may therefore change continuously.
    """
    e = as_expr(x)
    if e.shape:
        raise shape_error("change", e)
    return Operation("change", (_checked_discrete("change", e),), ())


def _checked_discrete(what: str, e: Expr) -> Expr:
    if not is_discrete(e):
        raise DeclarationError(
            "AC146",
            f"{what}(`{e}`) has no meaning: it is not discrete",
            help="declare it with boolean(), integer() or discrete(), or write a relation, without no_event",
        )
    return e


def equals(a: Operand, b: Operand) -> Expr:
    """True where two whole numbers, or two conditions, are equal: `equals(self.mode, 1)`.

    It replaces Modelica's `==` between integers, because `==` makes an equation here. There is no such function for
    continuous numbers, which are equal at isolated instants only.

    Raises
    ------
    DeclarationError
        AC146 when one side varies between events.
    """
    x, y = as_expr(a), as_expr(b)
    if x.shape or y.shape:
        raise shape_error("equals", x, y)
    for e in (x, y):
        if not is_discrete(e):
            raise DeclarationError(
                "AC146",
                f"equals(`{x}`, `{y}`): `{e}` is not discrete",
                help="compare continuous quantities with < and >",
            )
    return Operation("equals", (x, y), ())


def sample(start: Operand, interval: Operand) -> Expr:
    """True at the instants `start + k * interval` [s], k = 0, 1, 2, ...: a clock, for the condition of a `when`.

    Both are expressions of numbers and parameters.

    Raises
    ------
    DeclarationError
        AC105 when one is no scalar, AC146 when one varies during a run.
    """
    times = as_expr(start), as_expr(interval)
    shown = f"sample(`{times[0]}`, `{times[1]}`)"
    for e in times:
        if e.shape:
            raise DeclarationError(
                "AC105", f"{shown}: `{e}` is a {shape_text(e.shape)}", help="a clock has one start and one interval"
            )
        varying = _varying(e)
        if varying is not None:
            raise DeclarationError(
                "AC146",
                f"{shown}: `{varying}` varies during a run",
                help="the start and the interval of a clock are numbers or parameters; keep a computed instant in a "
                "discrete variable: when(time > pre(t_next), reset(t_next, ...))",
            )
    return Operation("sample", times, ())


def _varying(e: Expr) -> Expr | None:
    """A part of an expression that may change during a run; None if it consists of numbers and parameters."""
    for here in nodes(e):
        if isinstance(here, Symbol) and here.declaration.kind.value != "parameter":
            return here
        if here.op in ("time", "der", "delay", "call", "sample", "initial", "after_reset", "terminal"):
            return here
    return None


def initial() -> Expr:
    """True while the consistent start of a run is computed, and false afterwards."""
    return Operation("initial", (), ())


def after_reset() -> Expr:
    """True in the round of an event that follows a `reset` of states, and false otherwise.

    What depends on whether something moves is decided anew there, as with `initial()` at the start: a brake that held a
    shaft slides as soon as the shaft gets a speed.
    """
    return Operation("after_reset", (), ())


def infinitesimal() -> Expr:
    """A positive number that tends to zero, which regularises equations that would otherwise be singular.

    Unknowns that the equations with the number zero do not determine take their limit from above. `a == where(locked,
    infinitesimal() * tau, ...)` keeps an element of dry friction at rest, and determines how several such elements
    share a load that each could bear alone: with the least sum of squares, like surfaces that creep in proportion to
    their load. The sign of its factor must be that of a resistance.
    """
    return Operation("infinitesimal", (), ())


def terminal() -> Expr:
    """True at the end of a successful run."""
    return Operation("terminal", (), ())


def no_event(x: Expr) -> Expr:
    """A condition, or an expression of any shape, without events: relations in it make none."""
    e = as_expr(x)
    return Operation("noevent", (e,), e.shape)


def smooth(order: int, x: Operand) -> Expr:
    """`x`, declared to be `order` times continuously differentiable across its conditions: Modelica's `smooth`.

    With order 1 or more there are no kinks, and no events; with order 0 `x` is continuous, and its kinks are located.

    Raises
    ------
    DeclarationError
        AC149 when `order` is not a whole number of at least 0.
    """
    if not isinstance(order, int) or isinstance(order, bool) or order < 0:
        raise DeclarationError("AC149", f"smooth: `{order}` is not an order", help="write smooth(1, expression)")
    e = as_expr(x)
    return no_event(e) if order else e
