"""Claim: the published initial value problems, as published, are solved within ten times the tolerance 1e-8.

Every problem of `acausal.models.ivp` with every solver at three tolerances: digits of the end values, steps, calls of
the right-hand side, seconds; for comparison, IDAS on equations written by hand for CasADi (`baseline_idas.json` of the
reference data, if present). Writes docs/ivp-table.md.

    python benchmarks/ivp_table.py [--problems robertson,e5] [--repetitions 3] [--output docs/ivp-table.md]
"""

from __future__ import annotations

import argparse
import json
import math
import os
import platform
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import acausal
from acausal.errors import AcausalError
from acausal.models.ivp.answers import PROBLEMS, Problem
from acausal.simulate.solvers import choose

ROOT = Path(__file__).resolve().parents[1]
TOLERANCES = (1e-4, 1e-6, 1e-8)
HEAD = "| solver | tolerance | mescd | scd | steps | right-hand sides | solve ms |\n|---|---|---|---|---|---|---|"


@dataclass(frozen=True)
class Run:
    """One line of a table; `failure` is the reason if there are no numbers."""

    solver: str
    tolerance: str
    mescd: float | None = None
    scd: float | None = None
    steps: float | None = None
    calls: float | None = None
    seconds: float | None = None
    failure: str = ""

    def line(self) -> str:
        """As a row of a Markdown table."""
        if self.failure:
            return f"| {self.solver} | {self.tolerance} | failed: {self.failure} | | | | |"
        milliseconds = None if self.seconds is None else 1e3 * self.seconds
        numbers = (digits(self.mescd), digits(self.scd), whole(self.steps), whole(self.calls), short(milliseconds))
        return f"| {self.solver} | {self.tolerance} | {' | '.join(numbers)} |"


def digits(value: float | None) -> str:
    """Decimal digits to two places."""
    return "-" if value is None or not math.isfinite(value) else f"{value:.2f}"


def whole(value: float | None) -> str:
    """A count."""
    return "-" if value is None else f"{value:.0f}"


def short(value: float | None) -> str:
    """A time to two figures, without an exponent."""
    return "-" if value is None else f"{value:.0f}" if value >= 10 else f"{value:.2g}"


def solvers(problem: Problem) -> tuple[str, ...]:
    """Solvers that are suitable for the problem."""
    return ("idas", "rosenbrock", "cvodes") if problem.stiff else ("idas", "rosenbrock", "cvodes", "erk")


def seconds_of(result: acausal.Result) -> float:
    """Time of the integration, without compiling and start values."""
    times: Any = result.stats["time"]
    return float(times["integrate"])


def solve(compiled: Any, problem: Problem, solver: str, tolerance: float, repetitions: int) -> Run:
    """The best of several runs, or a single long one; the end is the only output."""
    stop = problem.model.experiment.stop_time
    best = math.inf
    for _ in range(repetitions):
        try:
            result = acausal.simulate(compiled, solver=solver, tolerance=tolerance, output_interval=stop)
        except AcausalError as error:
            return Run(solver, f"{tolerance:g}", failure=str(error).splitlines()[0].split(": ", 1)[-1])
        best = min(best, seconds_of(result))
        if best > 1.0:
            break
    return Run(
        solver,
        f"{tolerance:g}",
        problem.digits_reached(result.final),
        problem.relative_digits(result.final),
        float(str(result.stats.get("steps", 0))),
        float(str(result.stats.get("rhs_evaluations", 0))),
        best,
    )


def baseline(name: str) -> list[Run]:
    """Runs of IDAS on equations written by hand, if there are any."""
    folder = Path(os.environ.get("ACAUSAL_REFERENCE", ROOT.parent / "shared" / "reference"))
    file = folder / "ivp" / "baseline_idas.json"
    if not file.is_file():
        return []
    runs = []
    for row in json.loads(file.read_text())["rows"]:
        title = row["problem"]
        if not title.startswith(name):
            continue
        words = title[len(name) :].strip(" ,()").split(";")[0]
        masked = row["algebraic_variables_left_out_of_error_test"] == "yes"
        label = ", ".join(
            ["by hand", *([words] if words else []), *(["algebraic ones not controlled"] if masked else [])]
        )
        runs += [
            Run(label, r["rtol"].replace("e-", "e-0"), r["mescd"], r["scd"], r["steps"], None, r["solve_ms"] / 1e3)
            for r in row["runs"]
            if float(r["rtol"]) in TOLERANCES
        ]
    return runs


@dataclass(frozen=True)
class Section:
    """Everything about one problem."""

    name: str
    problem: Problem
    compiled: Any
    compile_seconds: float
    runs: tuple[Run, ...]

    def chosen(self) -> Run:
        """The run at 1e-8 with the solver that `auto` selects."""
        solver = choose(self.compiled, "auto", None)[0].name
        return next(r for r in self.runs if r.solver == solver and r.tolerance == "1e-08")

    def text(self) -> str:
        """The section of the page."""
        flat, states = len(self.compiled.flat.equations), len(self.compiled.states)
        lines = [
            f"## {self.name}",
            "",
            f"Index {self.problem.index}, {flat} equations. {states} states and {len(self.compiled.algebraic)} iterated"
            f" variables after compiling, in {1e3 * self.compile_seconds:.0f} ms. End values: {self.problem.source}.",
            "",
            HEAD,
            *(r.line() for r in self.runs),
            "",
        ]
        return "\n".join(lines)


def measure(name: str, repetitions: int) -> Section:
    """Compile once, then all solvers and tolerances."""
    problem = PROBLEMS[name]
    began = time.perf_counter()
    compiled = acausal.compile(problem.model())
    seconds = time.perf_counter() - began
    runs = [solve(compiled, problem, s, t, repetitions) for s in solvers(problem) for t in TOLERANCES]
    return Section(name, problem, compiled, seconds, (*runs, *baseline(name)))


def page(sections: Sequence[Section]) -> str:
    """The whole page."""
    import casadi

    return "\n".join(
        [
            "# Published initial value problems",
            "",
            "These are published test problems for stiff equations and DAEs. The models (`models/ivp/`) state the",
            "equations of the sources without reduction by hand: the compiler does index reduction, state selection",
            "and stabilisation. `benchmarks/ivp_table.py` writes this page; do not edit.",
            "",
            "- mescd: correct digits, -log10 max |y - r| / (f + |r|) over the relevant components, with f = 1 as in",
            "  the published tables, 1e-6 for robertson, 0 for e5 and charge_pump. scd is the same with f = 0.",
            "  Digits beyond the trusted digits of the reference do not count.",
            "- tolerance: the user's. Absolute tolerances are a thousandth of it times the nominal value.",
            "- solve ms: the best of several runs with output at the end only. It includes the creation of the",
            "  integrator; the compile time stands beside each problem.",
            "- by hand: IDAS through CasADi on equations reduced and written by hand, solve only, without nominal",
            "  values.",
            "",
            f"Python {platform.python_version()}, CasADi {casadi.CasadiMeta.version()}, {platform.machine()}, "
            f"{os.cpu_count()} processors busy with other work: errors and steps count, times only roughly.",
            "",
            "## At 1e-8 with the solver that `auto` takes",
            "",
            "| problem | index | solver | mescd | goal 7 | steps | solve ms | IDAS by hand: mescd | steps | ms |",
            "|---|---|---|---|---|---|---|---|---|---|",
            *(summary(s) for s in sections),
            "",
            *(s.text() for s in sections),
        ]
    )


def summary(section: Section) -> str:
    """One row of the first table."""
    run = section.chosen()
    by_hand = [r for r in section.runs if r.solver.startswith("by hand") and float(r.tolerance) == 1e-8]
    best = max(by_hand, key=lambda r: r.mescd or r.scd or 0.0, default=None)
    other = ("-", "-", "-")
    if best is not None:
        reached = digits(best.mescd) if best.mescd is not None else f"{digits(best.scd)} (scd)"
        other = (reached, whole(best.steps), short(1e3 * (best.seconds or 0.0)))
    if run.failure:
        return (
            f"| {section.name} | {section.problem.index} | {run.solver} | failed | no | - | - | {' | '.join(other)} |"
        )
    met = "met" if (run.mescd or 0.0) >= 7.0 else "missed"
    numbers = (digits(run.mescd), met, whole(run.steps), short(1e3 * (run.seconds or 0.0)), *other)
    return f"| {section.name} | {section.problem.index} | {run.solver} | {' | '.join(numbers)} |"


def main(arguments: Iterable[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--problems", default=",".join(PROBLEMS), help="names, separated by commas")
    parser.add_argument("--repetitions", type=int, default=3)
    parser.add_argument("--output", type=Path, default=ROOT / "docs" / "ivp-table.md")
    options = parser.parse_args(None if arguments is None else list(arguments))
    sections = []
    for name in options.problems.split(","):
        sections.append(measure(name, options.repetitions))
        print(summary(sections[-1]), flush=True)
    options.output.write_text(page(sections) + "\n")
    print(f"written: {options.output}")


if __name__ == "__main__":
    main()
