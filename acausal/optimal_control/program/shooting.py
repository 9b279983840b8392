"""Multiple shooting: states and integrals over an interval, by the exported integrators of fixed step size."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca

from acausal.errors import UsageError
from acausal.export.step.methods import METHODS, Method
from acausal.optimal_control.program.law import Law


@dataclass(frozen=True)
class Steps:
    """Integration over an interval: `count` steps of a method of `acausal.export.step.methods`."""

    method: str
    count: int

    def __post_init__(self) -> None:
        if self.method not in METHODS or not isinstance(self.count, int) or self.count < 1:
            raise UsageError(
                "AC053",
                f"intervals of {self.count} steps of '{self.method}'",
                help=f"shooting is one of {', '.join(METHODS)}, with at least one step in an interval",
            )


def integrate_interval(law: Law, steps: Steps, point: Sequence[Any], h: Any, rows: Sequence[Any]) -> tuple[Any, Any]:
    """(States, integrals of `rows`) after an interval of length h [s] with constant inputs, as SX expressions.

    `point` are the SX symbols t, x, z, u, w at its start, and `rows` scalar expressions of them.
    """
    t, x, z, u, w = point
    ode, alg, _ = law.equations(t, x, z, u, w)
    n, m = x.numel(), len(rows)
    both = ca.SX.sym("xq", n + m)
    inner = ca.Function("inner", [t, x, z, u, w], [ca.vertcat(ode, *rows), alg])
    rates = ca.Function("rates", [t, both, z, u, w], list(inner(t, both[:n], z, u, w)), *_NAMES)
    method = Method(steps.method, rates, ca.DM.ones(n + m + z.numel()))
    now, state, algebraic = t, ca.vertcat(x, ca.SX(m, 1)), z
    for _ in range(steps.count):
        # the replay of the solution shows whether these Newton steps suffice
        state, algebraic, _ = method.step(now, h / steps.count, state, algebraic, [u, w])
        now = now + h / steps.count
    return state[:n], state[n:]


_NAMES = (["t", "x", "z", "u", "w"], ["ode", "alg"])
