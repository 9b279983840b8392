"""Claim: compiled C makes runs 1.2 (multistep) to ten times (one-step methods) faster, with the same results.

For each model and solver: the integration interpreted and compiled, in turn; the cost of making the library, and of
finding it again on disk (a hit); and the largest difference of the two results, relative to the largest value of each
state. Times are processor times, including the C compiler. This is the source of the numbers in docs/devdocs/native.md.
"""

from __future__ import annotations

import argparse
import os
import statistics
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from measure import alternated, medians, report, rounded

import acausal
from acausal.lower.compiled import CompiledModel
from acausal.models.drilling_dynamic import ThickBlock
from acausal.models.drilling_kinematic import ThinPlate
from acausal.models.mass_chain import MassSpringDamperChain
from acausal.simulate.native import policy
from acausal.study.bench.measure import processor_clock

HITS = 7


def cases(longest: int) -> Iterator[tuple[str, Any, tuple[tuple[str, dict[str, Any]], ...]]]:
    """(name, model, solvers with their options)."""
    fine = {"tolerance": 1e-8}
    yield "ThickBlock", ThickBlock(), (("idas", fine), ("rosenbrock", fine))
    yield "ThinPlate", ThinPlate(), (("rk2", {"step": 1e-3}),)
    for n in (n for n in (10, 100, 400) if n <= longest):
        # Multistep methods interpret large models anyway.
        solvers = ("erk", "rosenbrock", *(("idas", "cvodes") if n < 200 else ()))
        yield f"chain of {n}", MassSpringDamperChain(n=n), tuple((solver, {}) for solver in solvers)


@contextmanager
def time_of_libraries() -> Iterator[list[float]]:
    """Seconds spent in making or finding each library."""
    original, seconds = policy.Native._made, []

    def timed(*arguments: Any) -> Any:
        began = sum(os.times()[:4])
        found = original(*arguments)
        seconds.append(sum(os.times()[:4]) - began)
        return found

    policy.Native._made = timed  # type: ignore[method-assign]
    try:
        yield seconds
    finally:
        policy.Native._made = original  # type: ignore[method-assign]


def measured(compiled: CompiledModel, solver: str, options: dict[str, Any], repetitions: int) -> dict[str, Any]:
    """Everything about one model and solver."""
    integrations: dict[bool, list[float]] = {True: [], False: []}

    def run(native: bool) -> acausal.Result:
        found = acausal.simulate(compiled, solver=solver, native=native, **options)
        integrations[native].append(found.stats["time"]["integrate"])  # type: ignore[index]
        return found

    with time_of_libraries() as libraries:
        there = run(True)
        for _ in range(HITS):
            policy._MEMORIES.clear()  # as in a new process; the run is one of a variant of the model
            run(True)
    here = run(False)
    for seconds in integrations.values():
        seconds.clear()
    alternated({"native": lambda: run(True), "interpreted": lambda: run(False)}, repetitions)
    middle = medians({"native": integrations[True], "interpreted": integrations[False]})
    return {
        "interpreted": middle["interpreted"],
        "native": middle["native"],
        "ratio": middle["interpreted"] / middle["native"],
        "fastest": {"interpreted": min(integrations[False]), "native": min(integrations[True])},
        "compile": libraries[0],
        "hit": statistics.median(libraries[1:]),
        "difference": max(float(np.abs(there[n] - here[n]).max() / np.abs(here[n]).max()) for n in compiled.states),
        "steps": there.stats["steps"],
        "instructions": compiled.rhs.n_instructions(),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0] if __doc__ else None)
    parser.add_argument("--repetitions", type=int, default=11)
    parser.add_argument("--longest", type=int, default=400, help="masses of the longest chain")
    args = parser.parse_args()
    processor_clock()
    found: dict[str, dict[str, Any]] = {}
    with tempfile.TemporaryDirectory() as folder:
        os.environ["ACAUSAL_CACHE"] = folder
        for name, model, solvers in cases(args.longest):
            compiled = acausal.compile(model)
            for solver, options in solvers:
                found[f"{name}, {solver}"] = measured(compiled, solver, options, args.repetitions)
    lines = ["interpreted     native   ratio  compile      hit  difference"]
    for name, one in found.items():
        lines.append(
            f"{1e3 * one['interpreted']:8.2f} ms {1e3 * one['native']:7.2f} ms {one['ratio']:6.1f} "
            f"{one['compile']:6.2f} s {1e3 * one['hit']:5.1f} ms {one['difference']:10.1e}  {name}"
        )
    record = {"cases": found, "repetitions": args.repetitions}
    report("compiled C, the same numbers faster", "\n".join(lines), rounded(record))


if __name__ == "__main__":
    main()
