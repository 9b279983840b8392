"""Delayed signals: `delay(x, T)`.

Semantics: Modelica language specification 3.6, section 3.7.4.1.
"""

from __future__ import annotations

from acausal.errors import DeclarationError
from acausal.language.expressions.expression import Expr, Operand, Operation, as_expr, is_condition, shape_error

_LONGEST_LABEL = 60


def delay(x: Operand, delay_time: Operand, max_delay: Operand | None = None) -> Expr:
    """The value of `x` at the current time minus `delay_time`, or at the start of the run if that is later.

    Parameters
    ----------
    x
        Signal to delay, of any shape and unit; the result has both.
    delay_time
        Delay [s], at least zero. Without `max_delay` it is an expression of numbers and parameters.
    max_delay
        Upper limit of `delay_time` [s], an expression of numbers and parameters. With it the delay may vary.

    Raises
    ------
    DeclarationError
        AC105 when a time is no scalar, AC181 when `x` is true or false.
    """
    e, times = as_expr(x), [as_expr(delay_time)]
    if max_delay is not None:
        times.append(as_expr(max_delay))
    for t in times:
        if t.shape:
            raise shape_error("delay", e, t)
    if is_condition(e):
        raise DeclarationError(
            "AC181",
            f"`{e}` is a condition: delay takes numbers",
            help="delay(where(condition, 1.0, 0.0), T) > 0.5 is the condition as it was T ago",
        )
    return Operation("delay", (e, *times), e.shape)


class Delayed(str):
    """Operation of a pool node whose operand is the instant at which a delayed signal is read.

    A string, like all operations. `number` is the index of the delay in its pool, `label` its text in the model.
    """

    number: int
    label: str

    def __new__(cls, number: int, label: str) -> Delayed:
        operation = super().__new__(cls, f"delay[{number}]")
        operation.number = number
        operation.label = label if len(label) <= _LONGEST_LABEL else label[: _LONGEST_LABEL - 4] + " ..."
        return operation

    def __reduce__(self) -> tuple[type[Delayed], tuple[int, str]]:
        return Delayed, (self.number, self.label)
