"""What is evaluated at many instants of a phase: one function of the values at an instant, asked for row by row.

A program repeats the equations of the model at every collocation point. It is written with a symbol for each row of
results, so that `derivatives.py` takes derivatives of the function once, and of the rest without it.

Instants of a phase: what the symbols of a problem are there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import casadi as ca

from acausal.errors import UsageError
from acausal.optimal_control.program.law import Law
from acausal.optimal_control.program.nlp import Nlp
from acausal.optimal_control.quantities import Quantities


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


@dataclass(frozen=True, eq=False)
class Site:
    """Instants of a phase with the equations that hold there."""

    points: Points
    point: list[Any]  # SX symbols of t, x, z, u and the open parameters w at one instant
    law: Law
    # Vector, place and sign of the variables that were asked for where they are states or inputs, None for others.
    places: list[tuple[str, int, int] | None]
    arguments: Sequence[Any]  # t, x, z, u at all instants

    @cached_property
    def equations(self) -> Any:
        """SX expressions ode, alg, y at one instant."""
        return self.law.equations(*self.point)

    def signal(self, k: int) -> Any:
        """The variable that was asked for as number k at one instant, an SX expression."""
        place = self.places[k]
        if place is None:
            return self.equations[2][self.law.wanted.index(k)]
        vector, number, sign = place
        return sign * self.point[1 if vector == "x" else 3][number]

    def direct(self, k: int) -> Any:
        """The same at all instants, a linear expression of the unknowns, shape (1, n); None where it is none."""
        place = self.places[k]
        if place is None:
            return None
        vector, number, sign = place
        return sign * self.arguments[1 if vector == "x" else 3][number, :]

    @cached_property
    def model(self) -> list[Any]:
        """SX arguments t, x, z, u, p of functions of the model."""
        (t, x, z, u, w), law = self.point, self.law
        own = law.algebraic(t, x, u, w) if law.algebraic is not None else z[: z.numel() - law.answers]
        return [t, x, own, u, law.parameters(w)]

    def integrand(self, q: Quantities, expression: Any) -> Any:
        """An expression of variables, the time and decided parameters at one instant, SX.

        Raises UsageError: AC053 where it holds durations or other values.
        """
        symbols = [q.time, *q.symbols, *(d[3] for d in q.decided)]
        known = {key(s) for s in symbols}
        others = [v for v in ca.symvar(expression) if key(v) not in known]
        if others:
            raise UsageError(
                "AC053",
                f"{others[0].name()} stands inside of an integral, which shooting takes over each interval",
                help="put it in front of the integral, or solve by collocation",
            )
        function = ca.Function("integrand", symbols, [expression]).expand()
        return function(self.point[0], *(self.signal(k) for k in range(len(q.outputs))), *ca.vertsplit(self.point[4]))


def site_of(nlp: Nlp, q: Quantities, law: Law, w: Any, arguments: Sequence[Any], n: int) -> Site:
    """Instants at which t, x, z, u are `arguments`, of n columns, and the open parameters are w."""
    names = ("t", "x", "z", "u", "w")
    point = [ca.SX.sym(name, law.equations.numel_in(k)) for k, name in enumerate(names)]
    points = nlp.at([*arguments, ca.repmat(w, 1, n)], point, n)
    return Site(points, point, law, [q.place(output.name) for output in q.outputs], arguments)
