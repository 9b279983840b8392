"""Cost of the derivatives of a run relative to runs: ten parameters of ThickBlock at 1e-8, and of a chain of 40 masses.

    python benchmarks/sensitivities.py

Medians of processor time of five rounds, each with a run and both methods in turn. "interpreted" differentiates a run
that is not compiled, with the default solver of the model and steps in Python; "default" leaves the decision on
compiling to the program, after it has compiled; "compiled" uses compiled `rosenbrock` and compiled steps. Each is
divided by a run of the same kind; "20 runs" is the cost of central differences with the compiled one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Literal

from measure import alternated, medians, ratios

import acausal
from acausal import Component, Equations, Real, der, fixed, parameter, variable
from acausal.models.drilling_dynamic import ThickBlock

DRILLED = (
    *("m", "gap", "drill.d", "drill.sigma", "drill.k_c11", "drill.z", "drill.k", "drill.d_c"),
    *("drill.h_min", "force_table.offset"),
)
MASSES, SPRINGS = 40, 8
TOLERANCE = 1e-8
METHODS: tuple[Literal["forward", "adjoint"], ...] = ("forward", "adjoint")
KINDS: dict[str, dict[str, Any]] = {
    "interpreted": {"native": False},
    "default": {},
    "compiled": {"native": True, "solver": "rosenbrock"},
}


class Chain(Component):
    """40 masses in a row on stiffening springs, in groups of five with equal stiffness; a force pulls on the last."""

    m: Real = parameter(default=1.0)
    d: Real = parameter(default=0.1)
    k: Real = parameter(default=100.0, shape=SPRINGS)
    x: Real = variable(default=fixed(0.0), shape=MASSES)
    v: Real = variable(default=fixed(0.0), shape=MASSES)

    def equations(self) -> Equations:
        forces: list[Any] = [1.0]
        for i in reversed(range(MASSES)):
            stretch = self.x[i] - (self.x[i - 1] if i else 0.0)
            speed = self.v[i] - (self.v[i - 1] if i else 0.0)
            forces.append(self.k[i * SPRINGS // MASSES] * stretch + 10.0 * stretch**3 + self.d * speed)
        forces.reverse()
        for i in range(MASSES):
            yield der(self.x[i]) == self.v[i]
            yield self.m * der(self.v[i]) == forces[i + 1] - forces[i]


def measured(name: str, model: Any, parameters: Sequence[str], outputs: Sequence[str], **more: Any) -> None:
    """Print the rows of a model."""
    for kind, own in KINDS.items():
        asked = {"tolerance": TOLERANCE, **more, **own}
        jobs: dict[str, Callable[[], Any]] = {"run": partial(acausal.simulate, model, **asked)}
        for method in METHODS:
            jobs[method] = partial(acausal.sensitivities, model, parameters, outputs, method=method, **asked)
        seconds = alternated(jobs, 5)
        middle = medians(seconds)
        shares = {"run": 1.0, **{method: ratios(seconds, method)["run"] for method in METHODS}}
        if kind == "compiled":
            middle["20 runs"], shares["20 runs"] = 20 * middle["run"], 20.0
        for row, spent in middle.items():
            print(f"{name:12s} {kind:12s} {row:8s} {1e3 * spent:8.1f} ms {shares[row]:6.2f} runs", flush=True)


def main() -> None:
    """Print the table."""
    measured("ThickBlock", acausal.compile(ThickBlock()), DRILLED, ("slide.s", "drill.s_tar"))
    names = ("m", "d", *(f"k[{j}]" for j in range(SPRINGS)))
    measured("40 masses", acausal.compile(Chain()), names, ("x[39]", "v[0]"), stop_time=20.0)


if __name__ == "__main__":
    main()
