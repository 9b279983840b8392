"""Functions evaluated at many instants of a phase, assembled row by row.

A program repeats the equations of the model at every collocation point. It contains symbols for their results, so that
`derivatives.py` can differentiate the function once, and the rest of the program separately.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import casadi as ca


def symbols_in(expression: Any) -> set[int]:
    """Keys of the symbols in an MX expression."""
    return {key(s) for s in ca.symvar(expression)}


def key(symbol: Any) -> int:
    """Hash of an MX symbol, unique while the symbol exists."""
    return int(symbol.__hash__())


@dataclass(frozen=True, eq=False)
class Points:
    """Function evaluated at n instants."""

    inputs: list[Any]  # SX symbols of the quantities at one instant, columns
    # Their values at all instants: linear expressions of the unknowns, shape (rows, n).
    arguments: list[Any]
    n: int
    # Results: SX columns of expressions of `inputs`, and the MX symbols of their values, each of shape (rows, n).
    rows: list[Any] = field(default_factory=list)
    symbols: list[Any] = field(default_factory=list)

    def add(self, expression: Any) -> Any:
        """Add results; returns the symbol of their values at all instants, shape (rows, n).

        `expression` is an SX column of shape (rows, 1).
        """
        if not expression.numel():
            return ca.MX(0, self.n)
        self.rows.append(ca.densify(expression))
        self.symbols.append(ca.MX.sym(f"rows{len(self.rows)}", expression.numel(), self.n))
        return self.symbols[-1]

    def with_input(self, argument: Any) -> Any:
        """Add an argument of shape (1, n); returns its SX symbol."""
        self.inputs.append(ca.SX.sym(f"number{len(self.inputs)}"))
        self.arguments.append(argument)
        return self.inputs[-1]

    @property
    def local(self) -> Any:
        """All arguments at one instant, a column."""
        return ca.vertcat(*self.inputs)

    @property
    def results(self) -> Any:
        """All results at one instant, a column."""
        return ca.vertcat(*self.rows)

    @property
    def stacked(self) -> Any:
        """All arguments at all instants, shape (arguments, n)."""
        return ca.vertcat(*self.arguments)

    def split(self, values: Any) -> list[Any]:
        """Split all results, shape (all rows, n), into those of each call of `add`."""
        borders = [0]
        for row in self.rows:
            borders.append(borders[-1] + row.numel())
        return list(ca.vertsplit(values, borders)) if self.rows else []

    def values(self) -> Any:
        """All results as an expression of the unknowns, shape (all rows, n)."""
        return ca.Function("points", [self.local], [self.results]).map(self.n)(self.stacked)


def insert_functions(expressions: Sequence[Any], points: Sequence[Points]) -> list[Any]:
    """Expressions in which the symbols of results are replaced by calls of the functions."""
    used = [p for p in points if p.rows]
    symbols = [s for p in used for s in p.symbols]
    return list(ca.substitute(list(expressions), symbols, [v for p in used for v in p.split(p.values())]))
