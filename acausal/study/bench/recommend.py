"""What a bench recommends: the cheapest way to a wanted accuracy, out of what was measured."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from acausal.study.bench.run import Run


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
