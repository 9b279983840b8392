"""Conditions beyond relations: what changes, what held before, clocks, and what is exempt from events.

Source of the meaning: Modelica language specification 3.6, sections 3.7.5 and 8.5.
"""

from __future__ import annotations

from acausal.errors import DeclarationError
from acausal.language.expressions.expression import (
    Expr,
    Operand,
    Operation,
    Symbol,
    as_expr,
    checked_condition,
    is_condition,
    is_discrete,
    shape_error,
    symbols_in,
)


def pre(x: Operand) -> Expr:
    """The value just before the event, in the unit of `x`: Modelica's `pre`.

    `pre` of a discrete variable or of a condition may stand anywhere; it is the value from when the event began. That
    of any other expression may stand in a `when` only, where it is the value before the actions.
    """
    return _before(as_expr(x))


def _before(e: Expr) -> Expr:
    if is_discrete(e):
        varies = is_condition(e) or any(s.declaration.discrete for s in symbols_in(e))
        return Operation("pre", (e,), e.shape) if varies and e.op != "pre" else e
    if isinstance(e, Symbol) or e.op in ("der", "delay", "time"):
        return Operation("pre", (e,), e.shape)
    # What mixes both kinds is computed from what its parts were before.
    return Operation(e.op, tuple(map(_before, e.args)), e.shape, e.payload)


def edge(condition: Expr) -> Expr:
    """True at the instants at which `condition` becomes true: it holds, and did not just before."""
    return Operation("edge", (checked_condition(condition),), ())


def change(x: Expr) -> Expr:
    """True at the instants at which a discrete variable or a condition changes.

    Raises
    ------
    DeclarationError
        AC146 when `x` is neither: it changes all the time.
    """
    e = as_expr(x)
    if e.shape:
        raise shape_error("change", e)
    if not is_discrete(e):
        raise DeclarationError(
            "AC146",
            f"change(`{e}`) has no meaning: it is not discrete",
            help="declare it with boolean(), integer() or discrete(), or write a relation",
        )
    return Operation("change", (e,), ())


def equals(a: Operand, b: Operand) -> Expr:
    """True where two whole numbers, or two conditions, are equal: `equals(self.mode, 1)`.

    It stands for Modelica's `==` between integers, since `==` makes an equation here. Numbers that vary continuously
    have no such condition: it would hold at single instants only.

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
                help="compare what varies continuously with < and >",
            )
    return Operation("equals", (x, y), ())


def sample(start: Operand, interval: Operand) -> Expr:
    """True at the instants `start + k * interval` [s], k = 0, 1, 2, ...: a clock, for the condition of a `when`."""
    return Operation("sample", (as_expr(start), as_expr(interval)), ())


def initial() -> Expr:
    """True while the consistent start of a run is computed, and false from then on."""
    return Operation("initial", (), ())


def infinitesimal() -> Expr:
    """A positive number smaller than any other: zero, except where the equations leave something open because of it.

    What they leave open is then its limit from above. `a == where(locked, infinitesimal() * tau, ...)` keeps an element
    of dry friction at rest, and says how several of them share a load that each could bear alone: with the least sum of
    squares, as surfaces do that creep in proportion to their load. The factor of it must oppose what it is added to.
    """
    return Operation("infinitesimal", (), ())


def terminal() -> Expr:
    """True at the end of a run that succeeds."""
    return Operation("terminal", (), ())


def no_event(x: Expr) -> Expr:
    """A condition, or an expression of any shape, without events: it is evaluated at every point, not located."""
    e = as_expr(x)
    return Operation("noevent", (e,), e.shape)


def smooth(order: int, x: Operand) -> Expr:
    """`x` with the promise that it is `order` times continuously differentiable, whatever its conditions do.

    With order 1 and more there is no kink, and nothing is located; with order 0 `x` is continuous, and its kinks are
    located.

    Raises
    ------
    DeclarationError
        AC149 when `order` is not a whole number of at least 0.
    """
    if not isinstance(order, int) or isinstance(order, bool) or order < 0:
        raise DeclarationError("AC149", f"smooth: `{order}` is not an order", help="write smooth(1, expression)")
    e = as_expr(x)
    return no_event(e) if order else e
