"""IDAS: BDF of orders 1 to 5 for semi-explicit index-1 DAEs; the reference solver."""

from __future__ import annotations

from typing import Any

from acausal.simulate.equations.problem import Problem
from acausal.simulate.solvers.attainable import attainable
from acausal.simulate.solvers.base import CasadiSolver, beginning, bounded
from acausal.simulate.solvers.segment import Piece, Segment


class Idas(CasadiSolver):
    """SUNDIALS IDAS as CasADi ships it, started from a consistent point with consistent derivatives."""

    name = "idas"
    plugin = "idas"
    algebraic = True
    merges_outputs = True
    multistep = True
    native = "equations"

    def __init__(self, convergence: float = 0.01) -> None:
        self.convergence = convergence

    def integrate(self, problem: Problem, segment: Segment) -> Piece:
        """Solve one segment with a strict convergence test, which is relaxed if a start at a kink fails it."""
        for convergence in (0.01, 0.1) if problem.compiled.algebraic else ():
            try:
                return Idas(convergence).attempt(problem, segment)
            except RuntimeError as error:
                if "IDA_TOO_MUCH_WORK" in str(error):
                    if segment.partial:
                        raise
                    break
                if "IDA_RES_FAIL" in str(error):
                    raise  # Ctrl-C during an evaluation appears as this error, and must not lead to another attempt
        return Idas(0.33).attempt(problem, segment)

    def attempt(self, problem: Problem, segment: Segment) -> Piece:
        """Make one attempt with this object's convergence coefficient."""
        return super().integrate(problem, segment)

    def rates(self, problem: Problem, segment: Segment) -> list[float]:
        """The scaled rates at the start."""
        x = segment.x[: problem.n_dynamic] / problem.scale_x
        numbers = problem.vector(segment.p, segment.x, segment.start)
        return list(problem.scaled.buffered(0.0, x, segment.z / problem.scale_z, numbers, [])[0].tolist())

    def settings(self, problem: Problem, segment: Segment) -> dict[str, Any]:
        return {
            "reltol": segment.tolerances.relative,
            "abstol": segment.tolerances.absolute,
            # the start is already consistent, and IDACalcIC fails on some starts that acausal's own start system solves
            "calc_ic": False,
            **({"init_xdot": self.rates(problem, segment)} if segment.fractions is None else {}),
            "suppress_algebraic": True,
            # Algebraic variables are outside the error test, so only the convergence test keeps them accurate. With
            # IDA's default of 0.33, a drill that falls 8 mm before contact passes through the block at some tolerances
            # (measured). The error test covers all of an ODE, for which a strict value costs half as many evaluations
            # again without benefit.
            "nonlin_conv_coeff": self.convergence,
            "max_num_steps": segment.most_steps,
            **bounded(segment),
            **(beginning(segment) if segment.partial else {}),
            **attainable(problem, segment, self.convergence),
        }
