"""Multiple shooting: intervals bridged by the exported steps of fixed length, integrals with them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import casadi as ca

from acausal.errors import UsageError
from acausal.export.methods import METHODS, Method
from acausal.optimal_control.law import Law

if TYPE_CHECKING:
    from acausal.optimal_control.quantities import Quantities


@dataclass(frozen=True)
class Steps:
    """How an interval is bridged: `count` steps of a method of `acausal.export.methods`."""

    method: str
    count: int

    def __post_init__(self) -> None:
        if self.method not in METHODS or self.count < 1:
            raise UsageError(
                "AC053",
                f"intervals of {self.count} steps of '{self.method}'",
                help=f"shooting is one of {', '.join(METHODS)}, with one step at least in an interval",
            )


def bridge(q: Quantities, law: Law, steps: Steps, integrands: Sequence[Any]) -> Any:
    """`(t, h, x, z, u, w) -> (x, integrals)` over an interval of length h with constant inputs; SX.

    `integrands` are expressions of the problem's symbols: of variables, the time and decided parameters.

    Raises
    ------
    UsageError
        AC053 for an integrand with durations or other values in it.
    """
    function = law.equations
    t, x, z, u, w = (ca.SX.sym(function.name_in(k), function.numel_in(k)) for k in range(5))
    ode, alg, y = function(t, x, z, u, w)
    signals = []
    for k, output in enumerate(q.outputs):
        place = q.place(output.name)
        if place is None:
            signals.append(y[law.wanted.index(k)])
        else:
            signals.append(place[2] * (x if place[0] == "x" else u)[place[1]])
    symbols = [q.time, *q.symbols, *(d[3] for d in q.decided)]
    rows = [_integrand(symbols, expression)(t, *signals, *ca.vertsplit(w)) for expression in integrands]
    n, m = x.numel(), len(rows)
    both = ca.SX.sym("xq", n + m)
    inner = ca.Function("inner", [t, x, z, u, w], [ca.vertcat(ode, *rows), alg])
    rates = ca.Function("rates", [t, both, z, u, w], list(inner(t, both[:n], z, u, w)), *_NAMES)
    method = Method(steps.method, rates)
    h, now, state, algebraic = ca.SX.sym("h"), t, ca.vertcat(x, ca.SX(m, 1)), z
    for _ in range(steps.count):
        state, algebraic = method.step(now, h / steps.count, state, algebraic, [u, w])
        now = now + h / steps.count
    return ca.Function("bridge", [t, h, x, z, u, w], [state[:n], state[n:]])


_NAMES = (["t", "x", "z", "u", "w"], ["ode", "alg"])


def _integrand(symbols: Sequence[Any], expression: Any) -> Any:
    others = [v for v in ca.symvar(expression) if not any(ca.is_equal(v, s) for s in symbols)]
    if others:
        raise UsageError(
            "AC053",
            f"{others[0].name()} stands inside of an integral, which shooting takes over each interval",
            help="put it in front of the integral, or solve by collocation",
        )
    return ca.Function("integrand", list(symbols), [expression]).expand()
