"""CasADi's explicit Runge-Kutta integrator: the pair 5(4), adaptive or with fixed steps."""

from __future__ import annotations

from typing import Any

from acausal.simulate.problem import Problem
from acausal.simulate.solvers.base import CasadiSolver, Segment, bounded


class Erk(CasadiSolver):
    """For non-stiff problems; algebraic variables are eliminated by a rootfinder."""

    name = "erk"
    plugin = "erk"
    native = "integrator"

    def settings(self, problem: Problem, segment: Segment) -> dict[str, Any]:
        fixed = {"step_size": segment.step} if segment.step else {}
        return {
            "reltol": segment.tolerance,
            "abstol": segment.absolute,
            "max_num_steps": 10**6,
            **bounded(segment),
            **fixed,
        }
