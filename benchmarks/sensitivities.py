"""Derivatives of a run beside runs: ThickBlock, ten parameters, 1e-8, all in one process.

    python benchmarks/sensitivities.py

Times are the least of three after a first one. "run" is the run that is differentiated, with its default solver,
"compiled run" the fastest there is, and "20 runs" are what central differences cost with it.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import acausal
from acausal.models.drilling_dynamic import ThickBlock

PARAMETERS = (
    *("m", "gap", "drill.d", "drill.sigma", "drill.k_c11", "drill.z", "drill.k", "drill.d_c"),
    *("drill.h_min", "force_table.offset"),
)
OUTPUTS = ("slide.s", "drill.s_tar")
TOLERANCE = 1e-8


def least(call: Callable[[], object]) -> float:
    """Seconds."""
    call()
    found = []
    for _ in range(3):
        began = time.perf_counter()
        call()
        found.append(time.perf_counter() - began)
    return min(found)


def main() -> None:
    """Print the table."""
    model = acausal.compile(ThickBlock())
    compiled = least(lambda: acausal.simulate(model, tolerance=TOLERANCE, solver="rosenbrock", native=True))
    rows = {
        "compiled run": compiled,
        "run": least(lambda: acausal.simulate(model, tolerance=TOLERANCE, solver="idas", native=False)),
        "forward": least(lambda: acausal.sensitivities(model, PARAMETERS, OUTPUTS, tolerance=TOLERANCE)),
        "adjoint": least(
            lambda: acausal.sensitivities(model, PARAMETERS, OUTPUTS, tolerance=TOLERANCE, method="adjoint")
        ),
        "20 runs": 20 * compiled,
    }
    for name, seconds in rows.items():
        print(
            f"{name:14s} {1e3 * seconds:8.1f} ms {seconds / rows['run']:6.2f} runs {seconds / compiled:6.1f} compiled"
        )


if __name__ == "__main__":
    main()
