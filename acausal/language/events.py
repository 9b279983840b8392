"""What happens at instants: `when` a condition becomes true, `reset` states, `terminate`; `assert_` at all times.

Meaning as in the Modelica language 3.6, chapter 8: a `when` acts at the instant its condition turns from false to
true, all its actions see the values from before, and relations are decided again afterwards.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from acausal.errors import DeclarationError
from acausal.language.declare import check_discrete
from acausal.language.expression import Expr, Operand, Operation, Symbol, as_expr, checked_condition


@dataclass(frozen=True)
class Reset:
    """A new value for a variable that is integrated, or that is discrete."""

    target: Symbol
    value: Expr


@dataclass(frozen=True)
class Terminate:
    """The end of the run, which counts as success; `message` says why."""

    message: str


@dataclass(frozen=True)
class When:
    """Actions at the instants at which a condition becomes true; yield it like an equation.

    `branches` are its `elsewhen`s in the order of their priority. Each of them is a `When` without branches, whose
    `keyword` is "elsewhen".
    """

    condition: Expr
    actions: tuple[Reset, ...]
    terminate: str | None = None
    branches: tuple[When, ...] = ()
    keyword: str = "when"

    def __str__(self) -> str:
        actions = [f"reset({a.target}, {a.value})" for a in self.actions]
        if self.terminate is not None:
            actions.append(f'terminate("{self.terminate}")')
        own = f"{self.keyword}({', '.join([str(self.condition), *actions])})"
        return ".".join([own, *map(str, self.branches)])

    def elsewhen(self, condition: Expr | Sequence[Expr], *actions: Reset | Terminate) -> When:
        """The same with a further branch, which acts when its condition becomes true and no earlier one does just then.

        Branches need not set the same variables: what a branch does not set keeps its value. Source: Modelica language
        specification 3.6, section 8.3.5.2.

        Raises
        ------
        DeclarationError
            AC108 when `condition` is no condition, AC140 when an action is neither a `reset` nor a `terminate`.
        """
        return replace(self, branches=(*self.branches, _made(condition, actions, "elsewhen")))

    def guarded(self) -> list[tuple[Expr, When]]:
        """Every branch with the condition under which it acts: its own becomes true, and none before it does."""
        if not self.branches:
            return [(self.condition, self)]
        found: list[tuple[Expr, When]] = []
        earlier: Expr | None = None
        for branch in (replace(self, branches=()), *self.branches):
            rises: Expr = Operation("edge", (branch.condition,), ())
            found.append((rises if earlier is None else rises & ~earlier, branch))
            earlier = rises if earlier is None else earlier | rises
        return found


@dataclass(frozen=True)
class Assertion:
    """A condition that must hold; made by `assert_`."""

    condition: Expr
    message: str
    level: str

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
    resets = tuple(a for a in actions if isinstance(a, Reset))
    ends = [a.message for a in actions if isinstance(a, Terminate)]
    return When(_any_of(condition), resets, "; ".join(ends) if ends else None, keyword=keyword)


def _any_of(condition: Expr | Sequence[Expr]) -> Expr:
    if not isinstance(condition, tuple | list) or not condition:
        return checked_condition(condition)
    if len(condition) == 1:
        return checked_condition(condition[0])
    # The edges, not the conditions: one that holds already must not hide that another becomes true.
    found = [Operation("edge", (checked_condition(c),), ()) for c in condition]
    total: Expr = found[0]
    for c in found[1:]:
        total = total | c
    return total


def reset(x: Expr, value: Operand) -> Reset:
    """Set a state or a discrete variable to a new value; the value may use what holds just before.

    Raises
    ------
    DeclarationError
        AC141 when `x` is not a declared scalar variable, AC147 when the value is none for a boolean or an integer.
    """
    if not isinstance(x, Symbol) or x.shape:
        raise DeclarationError("AC141", f"`{x}` cannot be reset", help="reset takes one declared scalar variable")
    if x.declaration.kind.value in ("parameter", "input"):
        raise DeclarationError(
            "AC141",
            f"`{x}` cannot be reset: it is {'an input' if x.declaration.kind.value == 'input' else 'a parameter'}",
            help="declare what changes at events with discrete(), boolean() or integer()",
        )
    new = as_expr(value)
    if new.shape:
        raise DeclarationError("AC105", f"`{x}` is a scalar, its new value `{new}` has shape {new.shape}")
    check_discrete(f"`{x}`", x.declaration, new)
    return Reset(x, new)


def terminate(message: str) -> Terminate:
    """End the run, successfully, at the instant of a `when`."""
    return Terminate(_text("terminate", message))


def assert_(condition: Expr, message: str, *, level: str = "error") -> Assertion:
    """A condition that holds in all of the run; yield it like an equation.

    Parameters
    ----------
    message
        What it means when it does not hold, for the user.
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
    raise DeclarationError("AC149", f"{what} takes a message, not {message!r}", help="say in words what has happened")
