"""Statements about events: `when`, `reset` and `terminate`; and `assert_` for conditions that must always hold.

Semantics as in the Modelica language 3.6, chapter 8: a `when` acts at the instant at which its condition turns from
false to true, all its actions use the values from before, and relations are evaluated again afterwards.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from acausal.errors import DeclarationError
from acausal.language.declarations.declare import check_discrete
from acausal.language.expressions.arrays import fill
from acausal.language.expressions.conditions import is_discrete
from acausal.language.expressions.expression import (
    Expr,
    Operand,
    Symbol,
    as_expr,
    checked_condition,
    shape_text,
)
from acausal.language.statement import Statement, made, used


@dataclass(frozen=True)
class Reset:
    """Assignment of a new value to a state or discrete variable, or to a velocity by the impulse of a force."""

    target: Expr
    value: Expr
    by: Expr | None = None

    def __post_init__(self) -> None:
        made(self)

    def __str__(self) -> str:
        by = "" if self.by is None else f", by={self.by}"
        return f"reset({self.target}, {self.value}{by})"


@dataclass(frozen=True)
class Terminate:
    """The end of the run, which counts as success; `message` says why."""

    message: str

    def __post_init__(self) -> None:
        made(self)

    def __str__(self) -> str:
        return f'terminate("{self.message}")'


@dataclass(frozen=True)
class When(Statement):
    """Actions at the instants at which a condition becomes true; yield it like an equation.

    It acts when any of its `conditions` becomes true. `branches` are its `elsewhen`s in the order of their priority.
    Each of them is a `When` without branches, whose `keyword` is "elsewhen".
    """

    conditions: tuple[Expr, ...]
    actions: tuple[Reset, ...]
    terminate: str | None = None
    branches: tuple[When, ...] = ()
    keyword: str = "when"

    def __post_init__(self) -> None:
        used(self.branches)
        made(self)

    def __str__(self) -> str:
        actions = [str(a) for a in self.actions]
        if self.terminate is not None:
            actions.append(f'terminate("{self.terminate}")')
        conditions_text = ", ".join(map(str, self.conditions))
        conditions_text = f"({conditions_text})" if len(self.conditions) > 1 else conditions_text
        text = f"{self.keyword}({', '.join([conditions_text, *actions])})"
        return ".".join([text, *map(str, self.branches)])

    def elsewhen(self, condition: Expr | Sequence[Expr], *actions: Reset | Terminate) -> When:
        """This `when` with another branch, which acts when its condition becomes true and no earlier one does so too.

        Branches need not set the same variables: a variable that a branch does not set keeps its value. Source:
        Modelica language specification 3.6, section 8.3.5.2.

        Raises DeclarationError: AC108 when `condition` is no condition, AC140 when an action is neither a `reset` nor a
        `terminate`.
        """
        used((self,))
        branches = (*self.branches, _when(condition, actions, "elsewhen"))
        return When(self.conditions, self.actions, self.terminate, branches, self.keyword)


@dataclass(frozen=True)
class Assertion(Statement):
    """A condition that must hold; made by `assert_`."""

    condition: Expr
    message: str
    level: str

    def __post_init__(self) -> None:
        made(self)

    def __str__(self) -> str:
        return f'assert_({self.condition}, "{self.message}")'


def when(condition: Expr | Sequence[Expr], *actions: Reset | Terminate) -> When:
    """Perform `actions` at every instant at which `condition`, or one of several, becomes true.

    `.elsewhen(other, ...)` adds branches; if several conditions become true at one instant, the first branch acts.

    Raises
    ------
    DeclarationError
        AC108 when `condition` is no condition, AC140 when an action is neither a `reset` nor a `terminate`.
    """
    return _when(condition, actions, "when")


def _when(condition: Expr | Sequence[Expr], actions: Sequence[object], keyword: str) -> When:
    for action in actions:
        if not isinstance(action, Reset | Terminate):
            raise DeclarationError(
                "AC140",
                f"`{action}` is not an action",
                help=f'write {keyword}(condition, reset(x, value)) or {keyword}(condition, terminate("why"))',
            )
    used(actions)
    resets = tuple(a for a in actions if isinstance(a, Reset))
    ends = [a.message for a in actions if isinstance(a, Terminate)]
    return When(_conditions(condition), resets, "; ".join(ends) if ends else None, keyword=keyword)


def _conditions(condition: Expr | Sequence[Expr]) -> tuple[Expr, ...]:
    if isinstance(condition, tuple | list) and condition:
        return tuple(checked_condition(c) for c in condition)
    return (checked_condition(condition),)


def reset(x: Expr, value: Operand, *, by: Expr | None = None) -> Reset:
    """Set a state or a discrete variable to a new value, computed from values just before the event.

    Parameters
    ----------
    x
        A declared variable, an element or a slice of one; with `by`, any scalar expression of velocities.
    value
        Of the shape of `x`, or one number for all elements of a vector.
    by
        A discrete variable that acts as a force in the equations. Its impulse gives `x` the new value: all velocities
        on which the force acts jump, as determined by the masses of the model, and constraints continue to hold. The
        value of the variable itself, usually zero, does not change.

    Raises
    ------
    DeclarationError
        AC105 when the value has another shape; AC141 when `x` is not a declared variable or a part of one, or `by` no
        discrete one; AC147 when a boolean or an integer cannot have the value.
    """
    declared = x.args[0] if isinstance(x, Expr) and x.op in ("index", "slice") else x
    if by is not None:
        _check_force(x, by)
    elif not isinstance(declared, Symbol):
        raise DeclarationError("AC141", f"`{x}` cannot be reset", help="reset takes one declared variable")
    elif declared.declaration.kind.value in ("parameter", "input"):
        kind = "an input" if declared.declaration.kind.value == "input" else "a parameter"
        raise DeclarationError(
            "AC141",
            f"`{x}` cannot be reset: it is {kind}",
            help="declare variables that change at events with discrete(), boolean() or integer()",
        )
    new = as_expr(value)
    if len(x.shape) == 1 and not new.shape:
        new = fill(new, *x.shape)
    if new.shape != x.shape:
        raise DeclarationError(
            "AC105", f"`{x}` is {shape_text(x.shape)}, its new value `{new}` {shape_text(new.shape)}"
        )
    if isinstance(declared, Symbol):
        check_discrete(f"`{x}`", declared.declaration, new)
    return Reset(x, new, by)


def _check_force(x: object, by: object) -> None:
    """Raise DeclarationError AC141 for an `x` that no impulse can change, and a `by` that is no force."""
    if not isinstance(x, Expr) or x.shape or is_discrete(x):
        raise DeclarationError(
            "AC141",
            f"`{x}` cannot be reset by an impulse",
            help="an impulse changes velocities: reset(self.v, -self.e * pre(self.v), by=self.hit)",
        )
    force = by.args[0] if isinstance(by, Expr) and by.op == "index" else by
    declaration = force.declaration if isinstance(force, Symbol) else None
    if (
        declaration is None
        or not isinstance(by, Expr)
        or by.shape
        or not declaration.discrete
        or declaration.boolean
        or declaration.integer
    ):
        raise DeclarationError(
            "AC141",
            f"`{by}` is no force that can act for an instant",
            help="declare one, hit: Real = discrete(unit='N'), and add it to the forces of the equations",
        )


def terminate(message: str) -> Terminate:
    """End the run, successfully, at the instant of a `when`."""
    return Terminate(_text("terminate", message))


def assert_(condition: Expr, message: str, *, level: str = "error") -> Assertion:
    """A condition that must hold throughout the run; yield it like an equation.

    Parameters
    ----------
    message
        Text for the user if the condition does not hold.
    level
        `"error"` stops the run when the condition ceases to hold, `"warning"` adds a note to the result.

    Raises
    ------
    DeclarationError
        AC108 when `condition` is no condition, AC149 for a message that is not a text, or an unknown level.
    """
    if level not in ("error", "warning"):
        raise DeclarationError("AC149", f"assert_ has no level {level!r}", help='it is "error" or "warning"')
    return Assertion(checked_condition(condition), _text("assert_", message), level)


def _text(what: str, message: str) -> str:
    if isinstance(message, str):
        return message
    raise DeclarationError("AC149", f"{what} takes a message, not {message!r}", help="give a text, in quotes")
