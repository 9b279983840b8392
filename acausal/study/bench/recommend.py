"""The cheapest way to a wanted accuracy, out of what was measured."""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from acausal.errors import IntegrationError
from acausal.lower.compiled import CompiledModel
from acausal.study.bench.case import ADAPTIVE, IMPLICIT
from acausal.study.bench.report import Bench, Run, monotone

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Recommendation:
    """What to pass on to `simulate`; `tolerance` is None for fixed steps, `step` for adaptive ones."""

    accuracy: float
    run: Run
    tried: int
    digits: float

    @property
    def options(self) -> dict[str, Any]:
        """Keywords of `simulate`."""
        case = self.run.case
        return {"solver": case.solver, "tolerance": case.tolerance, "step": case.step}

    @property
    def text(self) -> str:
        """One sentence."""
        case = self.run.case
        form = "" if case.formulation == "torn" else f", formulation {case.formulation}"
        return (
            f"{case.solver} with {case.knob}{form}: error {self.run.error:.1e}, "
            f"{1e3 * self.run.cost:.3g} ms, the cheapest of {self.tried} runs"
        )

    @property
    def command(self) -> str:
        """Options of `acausal simulate`."""
        case = self.run.case
        knob = f"--step {case.step:.6g}" if case.step is not None else f"--tolerance {case.tolerance:.3g}"
        form = "" if case.formulation == "torn" else f" --formulation {case.formulation}"
        native = " --native" if self.run.native else ""
        return f"--solver {case.solver} {knob}{form}{native}"

    def record(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "accuracy": self.accuracy,
            **self.options,
            "formulation": self.run.case.formulation,
            "native": self.run.native,
            "error": self.run.error,
            "solve_time": self.run.solve_time,
            "cost": self.run.cost,
            "tried": self.tried,
            "trusted_digits": self.digits,
            "command": self.command,
        }


def recommend(bench: Bench, accuracy: float) -> Recommendation:
    """The cheapest run of a bench whose error is at most `accuracy`, with that of every tighter run of its solver.

    Raises
    ------
    IntegrationError
        AC411 when nothing reaches it, or the reference cannot tell.
    """
    digits = bench.reference.trusted_digits
    if bench.reference.trusted_error > accuracy:
        raise IntegrationError(
            "AC411",
            f"an accuracy of {accuracy:g} cannot be judged for {bench.model}: "
            + (f"its reference is trusted to {digits:.1f} digits only" if digits > 0 else "its reference has no digit"),
            evidence=[bench.reference.source, *bench.reference.notes],
            cause="the model amplifies rounding (chaos), or has jumps the solvers place differently",
            help="shorten the run (--stop-time), or ask for less",
        )
    good = [run for runs in bench.series.values() for run in monotone(runs, accuracy)]
    if not good:
        arrived = sorted((run for run in bench.runs if run.distance is not None), key=lambda run: run.error)
        raise IntegrationError(
            "AC411",
            f"no run of {bench.model} reached an accuracy of {accuracy:g}",
            evidence=[f"{run.case.series}, {run.case.knob}: error {run.error:.1e}" for run in arrived[:3]],
            help="try tighter tolerances (--tolerance), or ask for less",
        )
    best = min(good, key=lambda run: run.cost)
    return Recommendation(accuracy, best, len(bench.runs), bench.reference.trusted_digits)


def tolerances_for(accuracy: float) -> tuple[float, ...]:
    """Tolerances at which an accuracy is looked for: end errors lie within some decades of the tolerance."""
    return tuple(t for t in (accuracy * f for f in (30.0, 3.0, 0.3, 0.03, 0.003)) if 1e-13 <= t < 0.5) or (1e-12,)


def for_accuracy(
    compiled: CompiledModel, accuracy: float, solver: str | None, options: Mapping[str, Any]
) -> Recommendation:
    """What `simulate(accuracy=...)` uses: a small bench of the compiled model with its run's own options."""
    from acausal.study.bench.bench import bench_compiled

    # inside a right-hand side, algebraic variables cost a rootfinder: rarely worth a try
    likely = IMPLICIT if compiled.algebraic else ADAPTIVE
    made = bench_compiled(
        compiled,
        solvers=likely if solver in (None, "auto") else (str(solver),),
        tolerances=tolerances_for(accuracy),
        steps=(),
        repeat=3,
        time_limit=20.0,
        options=options,
        enough=2.0 - math.log10(accuracy),
        patience=10.0,
        say=_log.debug,
    )
    return recommend(made, accuracy)
