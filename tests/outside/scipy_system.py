"""An export from outside: the model as a system for SciPy's `solve_ivp`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

import acausal


@dataclass(frozen=True)
class System:
    """`rates(t, x)` [1/s], states at the start and their names; parameters as declared."""

    rates: Callable[[float, np.ndarray], np.ndarray]
    start: np.ndarray
    names: tuple[str, ...]


def scipy_system(model: acausal.Component) -> System:
    """The explicit ODE of a model without inputs."""
    made = acausal.compile(model).casadi()
    u, p = made.u.start, made.p.start

    def rates(t: float, x: np.ndarray) -> np.ndarray:
        time = () if made.autonomous else (t,)
        return np.asarray(made.ode(*time, x, u, p)[0]).ravel()

    return System(rates, np.array(made.x.start), made.x.names)
