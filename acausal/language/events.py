"""What happens at instants: `when` a condition becomes true, `reset` states, `terminate`; `assert_` at all times.

Meaning as in the Modelica language 3.6, chapter 8: a `when` acts at the instant its condition turns from false to
true, all its actions see the values from before, and relations are decided again afterwards.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from acausal.errors import DeclarationError
from acausal.language.declarations.declare import check_discrete
from acausal.language.expressions.expression import Expr, Operand, Symbol, as_expr, checked_condition, is_discrete
from acausal.language.statement import Statement, made, used


@dataclass(frozen=True)
class Reset:
    """A new value for a variable that is integrated or discrete; or for a velocity, by the impulse of a force."""

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
        asked = ", ".join(map(str, self.conditions))
        asked = f"({asked})" if len(self.conditions) > 1 else asked
        own = f"{self.keyword}({', '.join([asked, *actions])})"
        return ".".join([own, *map(str, self.branches)])

    def elsewhen(self, condition: Expr | Sequence[Expr], *actions: Reset | Terminate) -> When:
        """The same with a further branch, which acts when its condition becomes true and no earlier one does just then.

        Branches need not set the same variables: what a branch does not set keeps its value. Source: Modelica language
        specification 3.6, section 8.3.5.2.

        Raises DeclarationError: AC108 when `condition` is no condition, AC140 when an action is neither a `reset` nor a
        `terminate`.
        """
        used((self,))
        branches = (*self.branches, _made(condition, actions, "elsewhen"))
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
    """Do `actions` at every instant at which `condition`, or one of several, becomes true.

    `.elsewhen(other, ...)` behind it adds branches; of several that become true at one instant the first acts.

    Raises
    ------
    DeclarationError
        AC108 when `condition` is no condition, AC140 when an action is neither a `reset` nor a `terminate`.
    """
    return _made(condition, actions, "when")


def _made(condition: Expr | Sequence[Expr], actions: Sequence[object], keyword: str) -> When:
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
    """Set a state or a discrete variable to a new value; the value may use what holds just before.

    Parameters
    ----------
    x
        One declared scalar variable; with `by`, any scalar made of velocities.
    by
        A discrete variable that stands in the equations as a force. Its impulse gives `x` the new value: all velocities
        that the force changes jump, as the masses of the model determine, and constraints go on to hold. The value of
        the variable itself does not change; as a rule it is zero.

    Raises
    ------
    DeclarationError
        AC141 when `x` is not a declared scalar variable, or `by` no discrete one; AC147 when the value is none for a
        boolean or an integer.
    """
    if by is not None:
        _check_force(x, by)
    elif not isinstance(x, Symbol) or x.shape:
        raise DeclarationError("AC141", f"`{x}` cannot be reset", help="reset takes one declared scalar variable")
    elif x.declaration.kind.value in ("parameter", "input"):
        raise DeclarationError(
            "AC141",
            f"`{x}` cannot be reset: it is {'an input' if x.declaration.kind.value == 'input' else 'a parameter'}",
            help="declare what changes at events with discrete(), boolean() or integer()",
        )
    new = as_expr(value)
    if new.shape:
        raise DeclarationError("AC105", f"`{x}` is a scalar, its new value `{new}` has shape {new.shape}")
    if isinstance(x, Symbol):
        check_discrete(f"`{x}`", x.declaration, new)
    return Reset(x, new, by)


def _check_force(x: object, by: object) -> None:
    """Refuse what takes no impulse, and what is no force that could give one."""
    if not isinstance(x, Expr) or x.shape or is_discrete(x):
        raise DeclarationError(
            "AC141",
            f"`{x}` cannot be reset by an impulse",
            help="an impulse changes velocities: reset(self.v, -self.e * pre(self.v), by=self.hit)",
        )
    force = by.args[0] if isinstance(by, Expr) and by.op == "index" else by
    said = force.declaration if isinstance(force, Symbol) else None
    if said is None or not isinstance(by, Expr) or by.shape or not said.discrete or said.boolean or said.integer:
        raise DeclarationError(
            "AC141",
            f"`{by}` is no force that could act for an instant",
            help="declare one, hit: Real = discrete(unit='N'), and add it to the forces of the equations",
        )


def terminate(message: str) -> Terminate:
    """End the run, successfully, at the instant of a `when`."""
    return Terminate(_text("terminate", message))


def assert_(condition: Expr, message: str, *, level: str = "error") -> Assertion:
    """A condition that has to hold during the whole run; yield it like an equation.

    Parameters
    ----------
    message
        Text for the user when the condition does not hold.
    level
        `"error"` stops the run where the condition ceases to hold, `"warning"` only notes it.

    Raises
    ------
    DeclarationError
        AC108 when `condition` is no condition, AC149 when the message or the level is none.
    """
    if level not in ("error", "warning"):
        raise DeclarationError("AC149", f"assert_ has no level {level!r}", help='it is "error" or "warning"')
    return Assertion(checked_condition(condition), _text("assert_", message), level)


def _text(what: str, message: str) -> str:
    if isinstance(message, str):
        return message
    raise DeclarationError("AC149", f"{what} takes a message, not {message!r}", help="give a text, in quotes")
