"""Claim: ThickBlock, 40 s, at an error of 1e-8 m: no slower than a hand-written C right-hand side driven by CVODE.

`thick_block_by_hand.c` is a typical program by hand: three states, the line force by Newton's method inside the
right-hand side, restarts at the corners of the profiles, SUNDIALS' CVODE with a dense Jacobian. Both sides are tuned by
their tolerance; for each, the fastest setting counts whose depths at 1.5, 6, 10, 20, 30 and 40 s are within 1e-8 m of
the C program at 1e-12. Neither has an algebraic variable: (20) is solved inside the equations. It is compared with
compiled rosenbrock and with IDAS. Times are medians of processor times; for acausal, of the whole call and of its
compiled part.

    apt-get install libsundials-dev        # the C library with its headers
    python benchmarks/thick_block_vs_cvode.py
"""

from __future__ import annotations

import argparse
import math
import statistics
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from measure import report, rounded

import acausal
from acausal.models.drilling_dynamic import ThickBlock
from acausal.simulate.native.event_loop import EventLoopProgram
from acausal.simulate.native.program import Program

SOURCE = Path(__file__).with_name("thick_block_by_hand.c")
LIBRARIES = ("cvode", "nvecserial", "sunlinsoldense", "sunmatrixdense")
CHECKS = (1.5, 6.0, 10.0, 20.0, 30.0, 40.0)
ACCURACY, IDAS_LIMIT = 1e-8, 0.05


def by_hand(binary: Path, tolerance: float, repeat: int) -> tuple[float, Any, dict[str, float]]:
    """Seconds, depths at the checks, counts."""
    run = subprocess.run([binary, repr(tolerance), str(repeat)], capture_output=True, text=True, check=False)
    if run.returncode:
        return math.inf, np.full(len(CHECKS), np.inf), {}
    numbers = list(map(float, run.stdout.split()))
    return numbers[0], np.array(numbers[3::2]), {"steps": numbers[1], "rhs_evaluations": numbers[2]}


@contextmanager
def inside_c() -> Iterator[list[float]]:
    """Processor seconds spent in compiled integrators."""
    spent = [0.0]

    def timed(original: Callable[..., Any]) -> Callable[..., Any]:
        def run(*arguments: Any) -> Any:
            began = time.process_time()
            try:
                return original(*arguments)
            finally:
                spent[0] += time.process_time() - began

        return run

    with (
        patch.object(Program, "__call__", timed(Program.__call__)),
        patch.object(EventLoopProgram, "run", timed(EventLoopProgram.run)),
    ):
        yield spent


def ours(compiled: Any, solver: str, tolerance: float, repeat: int) -> tuple[Any, dict[str, float]]:
    """Depths at the checks, and medians of several runs."""
    compiled_part, whole = [], []
    with inside_c() as spent:
        run = acausal.simulate(compiled, solver=solver, tolerance=tolerance, native=True, output_interval=0.5)
        for _ in range(repeat):
            spent[0], busy = 0.0, time.process_time()
            run = acausal.simulate(compiled, solver=solver, tolerance=tolerance, native=True, output_interval=0.5)
            whole.append(time.process_time() - busy)
            compiled_part.append(spent[0])
    middle = {"seconds": statistics.median(whole), "in C": statistics.median(compiled_part)}
    return np.array([run.at(t, "drill.s") for t in CHECKS]), {**middle, "steps": float(str(run.stats["steps"]))}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeat", type=int, default=20)
    options = parser.parse_args()
    compiled = acausal.compile(ThickBlock())
    with tempfile.TemporaryDirectory() as folder:
        binary = Path(folder) / "thick_block"
        flags = [f"-lsundials_{name}" for name in LIBRARIES]
        subprocess.run(["cc", "-O3", "-o", binary, SOURCE, *flags, "-lm"], check=True)
        exact = by_hand(binary, 1e-12, 1)[1]
        theirs = []
        for tolerance in (3e-6, 1e-6, 5e-7, 3e-7, 2e-7, 1e-7, 3e-8, 1e-8):
            seconds, depths, counts = by_hand(binary, tolerance, options.repeat)
            error = float(np.abs(depths - exact).max())
            theirs.append({"tolerance": tolerance, "seconds": seconds, "error": error, **counts})
    rows: dict[str, list[dict[str, float]]] = {"rosenbrock": [], "idas": []}
    for solver, tolerances in (
        ("rosenbrock", (3e-3, 1e-3, 3e-4, 1e-4, 3e-5, 1e-5, 1e-6)),
        ("idas", (1e-5, 3e-6, 1e-6, 1e-7, 1e-8)),
    ):
        for tolerance in tolerances:
            depths, costs = ours(compiled, solver, tolerance, options.repeat)
            rows[solver].append({"tolerance": tolerance, "error": float(np.abs(depths - exact).max()), **costs})
    hand = min((r for r in theirs if r["error"] <= ACCURACY), key=lambda r: r["seconds"])
    best = {
        s: min((r for r in rs if r["error"] <= ACCURACY), key=lambda r: r["seconds"], default=None)
        for s, rs in rows.items()
    }
    found = best["rosenbrock"] or {"seconds": math.inf, "in C": math.inf, "error": math.inf}
    idas = best["idas"] or {"seconds": math.inf, "error": math.inf}
    report(
        "ThickBlock at 1e-8 m is no slower than a hand-written C right-hand side driven by CVODE; IDAS below 50 ms",
        f"CVODE by hand {1e3 * hand['seconds']:.2f} ms ({hand['error']:.0e} m); "
        f"rosenbrock {1e3 * found['seconds']:.2f} ms, "
        f"of which compiled {1e3 * found['in C']:.2f} ms ({found['error']:.0e} m): "
        f"{'met' if found['seconds'] <= hand['seconds'] else 'MISSED'}; idas {1e3 * idas['seconds']:.1f} ms "
        f"({idas['error']:.0e} m): {'met' if idas['seconds'] < IDAS_LIMIT else 'MISSED'}",
        rounded({"by hand": theirs, **rows}),
    )


if __name__ == "__main__":
    main()
