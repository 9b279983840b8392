"""Values of the symbols of a problem at instants of a phase."""

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
    """Instants of a phase, with its equations."""

    points: Points
    point: list[Any]  # SX symbols of t, x, z, u and the open parameters w at one instant
    law: Law
    # (Vector, index, sign) of each variable used in the problem that is a state or an input; None for others.
    places: list[tuple[str, int, int] | None]
    arguments: Sequence[Any]  # t, x, z, u at all instants

    @cached_property
    def equations(self) -> Any:
        """SX expressions ode, alg, y at one instant."""
        return self.law.equations(*self.point)

    def signal(self, k: int) -> Any:
        """Variable k of those used in the problem at one instant, an SX expression."""
        place = self.places[k]
        if place is None:
            return self.equations[2][self.law.wanted.index(k)]
        vector, number, sign = place
        return sign * self.point[1 if vector == "x" else 3][number]

    def in_unknowns(self, k: int) -> Any:
        """Variable k at all instants as a linear expression of the unknowns, shape (1, n); None if it is not one."""
        place = self.places[k]
        if place is None:
            return None
        vector, number, sign = place
        return sign * self.arguments[1 if vector == "x" else 3][number, :]

    @cached_property
    def model(self) -> list[Any]:
        """SX arguments t, x, z, u, p for functions of the model."""
        (t, x, z, u, w), law = self.point, self.law
        own = law.algebraic(t, x, u, w) if law.algebraic is not None else z[: z.numel() - law.selectors]
        return [t, x, own, u, law.parameters(w)]

    def integrand(self, q: Quantities, expression: Any) -> Any:
        """The integrand of an integral at one instant, an SX expression.

        Raises UsageError: AC053 if it contains durations, boundary values or integrals.
        """
        symbols = [q.time, *q.symbols, *(d[3] for d in q.decided)]
        known = {key(s) for s in symbols}
        others = [v for v in ca.symvar(expression) if key(v) not in known]
        if others:
            raise UsageError(
                "AC053",
                f"{others[0].name()} is inside an integral, which shooting evaluates interval by interval",
                help="move it outside the integral, or solve by collocation",
            )
        function = ca.Function("integrand", symbols, [expression]).expand()
        return function(self.point[0], *(self.signal(k) for k in range(len(q.outputs))), *ca.vertsplit(self.point[4]))


def site_of(nlp: Nlp, q: Quantities, law: Law, w: Any, arguments: Sequence[Any], n: int) -> Site:
    """Add n instants at which t, x, z, u are `arguments`, of shapes (rows, n), and the open parameters are w."""
    names = ("t", "x", "z", "u", "w")
    point = [ca.SX.sym(name, law.equations.numel_in(k)) for k, name in enumerate(names)]
    points = nlp.at([*arguments, ca.repmat(w, 1, n)], point, n)
    return Site(points, point, law, [q.place(output.name) for output in q.outputs], arguments)
