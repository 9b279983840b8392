"""Claim: ThinPlate, 10 s in 10 000 RK2 steps of 1 ms, solves in less than 1 ms compiled.

Beside it stands a plain C loop over the same two states: what the 10 000 steps cost when nothing else is done. The
exported step function (`acausal export step ThinPlate --method rk2`) is timed step by step, by its median. Whole calls
of `simulate`, medians of processor times. What
the forces at 10 001 rows cost beside the same rows in C: `workloads.py`.
"""

from __future__ import annotations

import argparse
import statistics
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any

from measure import report, rounded

import acausal
from acausal.export.step.real_time import real_time
from acausal.export.step.step import step_function
from acausal.models.drilling_kinematic import ThinPlate

LIMIT, STEPS, STEP = 1e-3, 10_000, 1e-3
LOOP = """
#include <stdio.h>
#include <time.h>
static void rates(const double* x, const volatile double* p, double* k) { k[0] = p[0]; k[1] = p[1]; (void) x; }
int main(void) {
  volatile double p[2] = {1.672e-3, 58.30795965}; double x[2], y[2], a[2], b[2]; int i, j, r;
  for (r = 0; r < 21; ++r) {
    struct timespec s, e; clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &s);
    x[0] = x[1] = 0;
    for (i = 0; i < %d; ++i) {
      rates(x, p, a); for (j = 0; j < 2; ++j) y[j] = x[j] + %g * a[j];
      rates(y, p, b); for (j = 0; j < 2; ++j) x[j] += %g / 2 * (a[j] + b[j]);
    }
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &e);
    printf("%%.9g\\n", (e.tv_sec - s.tv_sec) + 1e-9 * (e.tv_nsec - s.tv_nsec));
  }
  printf("%%.15g\\n", x[0]); return 0;
}
"""


def plain_loop() -> tuple[float, float]:
    """Seconds of the loop, the median, and the depth it ends at."""
    with tempfile.TemporaryDirectory() as folder:
        source, binary = Path(folder) / "loop.c", Path(folder) / "loop"
        source.write_text(LOOP % (STEPS, STEP, STEP))
        subprocess.run(["cc", "-O2", "-o", binary, source], check=True)
        *seconds, depth = subprocess.run([binary], capture_output=True, text=True, check=True).stdout.split()
    return statistics.median(map(float, seconds)), float(depth)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeat", type=int, default=21)
    options = parser.parse_args()
    compiled = acausal.compile(ThinPlate())
    run: Any = acausal.simulate(compiled, native=True)
    seconds = []
    for _ in range(options.repeat):
        busy = time.process_time()
        run = acausal.simulate(compiled, native=True)
        seconds.append(time.process_time() - busy)
    whole = statistics.median(seconds)
    loop, depth = plain_loop()
    steps, _ = real_time(step_function(compiled, STEP, "rk2"), STEPS)
    error = abs(float(run.final("drill.s")) - depth)
    report(
        f"ThinPlate at 1 ms RK2, 10 s, compiled: less than {1e3 * LIMIT:g} ms",
        f"a run {1e3 * whole:.2f} ms ({'met' if whole < LIMIT else 'MISSED'}), "
        f"plain C loop {1e3 * loop:.3f} ms, "
        f"exported step function {1e3 * steps.median * STEPS:.2f} ms, clock included",
        rounded(
            {
                "met": whole < LIMIT,
                "whole call": whole,
                "plain C loop": loop,
                "step function": steps.record(),
                "difference of the depths in m": error,
            }
        ),
    )


if __name__ == "__main__":
    main()
