"""CasADi's explicit Runge-Kutta integrator: a 5(4) pair with adaptive or fixed steps."""

from __future__ import annotations

from typing import Any

from acausal.simulate.equations.problem import Problem
from acausal.simulate.solvers.base import CasadiSolver, stepping
from acausal.simulate.solvers.segment import Segment


class Erk(CasadiSolver):
    """For non-stiff problems; algebraic variables are eliminated by a rootfinder."""

    name = "erk"
    plugin = "erk"
    native = "integrator"
    explicit = True
    interpolates = True

    def settings(self, problem: Problem, segment: Segment) -> dict[str, Any]:
        return {
            "reltol": segment.tolerances.relative,
            "abstol": segment.tolerances.absolute,
            **stepping(segment),
        }
