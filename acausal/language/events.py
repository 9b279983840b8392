"""What happens at instants: `when` a condition becomes true, `reset` states; `sample` conditions of time.

Meaning as in the Modelica language 3.6, chapter 8: a `when` acts at the instant its condition turns from false to
true, all its actions see the values from before, and relations are decided again afterwards.
"""

from __future__ import annotations

from dataclasses import dataclass

from acausal.errors import DeclarationError
from acausal.language.expression import CONDITIONS, Expr, Operand, Symbol, as_expr


@dataclass(frozen=True)
class Reset:
    """A new value for a variable that is integrated, or that is discrete."""

    target: Symbol
    value: Expr


@dataclass(frozen=True)
class When:
    """Actions at the instants at which a condition becomes true; yield it like an equation."""

    condition: Expr
    actions: tuple[Reset, ...]

    def __str__(self) -> str:
        actions = ", ".join(f"reset({a.target}, {a.value})" for a in self.actions)
        return f"when({self.condition}, {actions})"


def when(condition: Expr, *actions: Reset) -> When:
    """Do `actions` at every instant at which `condition` becomes true.

    Raises
    ------
    DeclarationError
        AC108 when `condition` is no condition, AC140 when an action is not a `reset`.
    """
    if not isinstance(condition, Expr) or condition.op not in CONDITIONS:
        raise DeclarationError("AC108", f"`{condition}` is not a condition", help="write a relation such as x > 0")
    for action in actions:
        if not isinstance(action, Reset):
            raise DeclarationError("AC140", f"`{action}` is not an action", help="when(condition, reset(x, value))")
    return When(condition, actions)


def reset(x: Expr, value: Operand) -> Reset:
    """Set a state or a discrete variable to a new value; the value may use what holds just before.

    Raises
    ------
    DeclarationError
        AC141 when `x` is not a declared scalar variable.
    """
    if not isinstance(x, Symbol) or x.shape:
        raise DeclarationError("AC141", f"`{x}` cannot be reset", help="reset takes one declared scalar variable")
    new = as_expr(value)
    if new.shape:
        raise DeclarationError("AC105", f"`{x}` is a scalar, its new value `{new}` has shape {new.shape}")
    return Reset(x, new)


def pre(x: Operand) -> Expr:
    """The value just before the event, in the actions of a `when`; between events it is the value itself."""
    e = as_expr(x)
    return Expr("pre", (e,), e.shape)


def sample(start: Operand, interval: Operand) -> Expr:
    """True at the instants `start + k * interval`, k = 0, 1, 2, ...; for the condition of a `when` [s]."""
    return Expr("sample", (as_expr(start), as_expr(interval)), ())


def no_event(condition: Expr) -> Expr:
    """A condition that is decided at every evaluation, without locating where it changes."""
    return Expr("noevent", (condition,), ())
