"""What is evaluated at many instants of a phase: one function of the values at an instant, asked for row by row.

A program repeats the equations of the model at every collocation point. It is written with a symbol for each row of
results, so that `derivatives.py` takes derivatives of the function once, and of the rest without it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import casadi as ca


def symbols_in(expression: Any) -> set[int]:
    """The symbols that an MX expression holds, by what `key` says of each."""
    return {key(s) for s in ca.symvar(expression)}


def key(symbol: Any) -> int:
    """A number for an MX symbol, its own as long as the symbol is kept."""
    return int(symbol.__hash__())


@dataclass(frozen=True, eq=False)
class Points:
    """Instants with the same equations."""

    inputs: list[Any]  # SX symbols of the quantities at one instant, columns
    # What they are at all instants: expressions of the unknowns, shape (rows, n), which are linear.
    arguments: list[Any]
    n: int
    # `rows`, `symbols`: SX expressions that were asked for, columns, and the MX symbols that stand for them, each of
    # shape (rows, n).
    rows: list[Any] = field(default_factory=list)
    symbols: list[Any] = field(default_factory=list)

    def ask(self, expression: Any) -> Any:
        """The values of a column of expressions at all instants, shape (rows, n)."""
        if not expression.numel():
            return ca.MX(0, self.n)
        self.rows.append(ca.densify(expression))
        self.symbols.append(ca.MX.sym(f"rows{len(self.rows)}", expression.numel(), self.n))
        return self.symbols[-1]

    def with_input(self, argument: Any) -> Any:
        """A further quantity, the SX symbol of a row of shape (1, n)."""
        self.inputs.append(ca.SX.sym(f"number{len(self.inputs)}"))
        self.arguments.append(argument)
        return self.inputs[-1]

    @property
    def local(self) -> Any:
        """All quantities at one instant, a column."""
        return ca.vertcat(*self.inputs)

    @property
    def results(self) -> Any:
        """All rows that were asked for, a column."""
        return ca.vertcat(*self.rows)

    @property
    def stacked(self) -> Any:
        """All arguments, shape (quantities, n)."""
        return ca.vertcat(*self.arguments)

    def split(self, values: Any) -> list[Any]:
        """Results of shape (all rows, n) as they were asked for."""
        borders = [0]
        for row in self.rows:
            borders.append(borders[-1] + row.numel())
        return list(ca.vertsplit(values, borders)) if self.rows else []

    def values(self) -> Any:
        """The results of the function itself, shape (all rows, n)."""
        return ca.Function("points", [self.local], [self.results]).map(self.n)(self.stacked)


def replaced(expressions: Sequence[Any], points: Sequence[Points]) -> list[Any]:
    """Expressions with the functions in place of the symbols of their results."""
    used = [p for p in points if p.rows]
    symbols = [s for p in used for s in p.symbols]
    return list(ca.substitute(list(expressions), symbols, [v for p in used for v in p.split(p.values())]))
