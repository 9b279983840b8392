"""Instants of a phase: what the symbols of a problem are there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca

from acausal.errors import UsageError
from acausal.optimal_control.program.law import Law
from acausal.optimal_control.program.nlp import Nlp
from acausal.optimal_control.program.points import Points, key
from acausal.optimal_control.quantities import Quantities


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
