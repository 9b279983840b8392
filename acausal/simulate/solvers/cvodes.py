"""CVODES: BDF for ODEs; algebraic variables are eliminated by a rootfinder."""

from __future__ import annotations

from typing import Any

from acausal.simulate.equations.problem import Problem
from acausal.simulate.solvers.base import CasadiSolver, beginning, bounded
from acausal.simulate.solvers.segment import Segment


class Cvodes(CasadiSolver):
    """SUNDIALS CVODES as CasADi ships it."""

    name = "cvodes"
    plugin = "cvodes"
    merges_outputs = True
    multistep = True
    native = "equations"

    def settings(self, problem: Problem, segment: Segment) -> dict[str, Any]:
        return {
            "reltol": segment.tolerances.relative,
            "abstol": segment.tolerances.absolute,
            "max_num_steps": segment.most_steps,
            # CVODES would print a line for each step below rounding before the run ends and reports the reason
            "disable_internal_warnings": True,
            **bounded(segment),
            **(beginning(segment) if segment.partial else {}),
        }
