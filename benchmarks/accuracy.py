"""Claim: with the solver that `auto` selects, every problem ends within ten tolerances of its answer, 1e-4 to 1e-10.

End errors divided by the tolerance for the published initial value problems (`acausal.models.ivp`), those of
accuracy_problems.py, the stability scenes and the examples of the Modelica Standard Library, with every suitable
solver. Writes docs/accuracy.md; cells found in the file of `--kept` are not computed again, so that an interrupted run
can be continued.

    python benchmarks/accuracy.py [--problems kepler,hires] [--seconds 10] [--kept FILE] [--output docs/accuracy.md]
"""

from __future__ import annotations

import argparse
import json
import math
import signal
import sys
import threading
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # the models of the examples are in the tests

from accuracy_chart import PICTURE, draw
from accuracy_msl import FOLDER, MODELS, example
from accuracy_problems import OWN, SLOPES
from accuracy_scenes import EXPLICIT, SCENES

import acausal
from acausal.errors import AcausalError
from acausal.models.ivp.answers import PROBLEMS, Problem
from acausal.simulate.solvers import choose

ROOT = Path(__file__).resolve().parents[1]
SOLVERS = ("rosenbrock", "idas", "cvodes", "erk")
TOLERANCES = (1e-4, 1e-6, 1e-8, 1e-10)
MOST = 10.0
INTERVALS = 10
"""Number of outputs: one-step methods end a step at each, so that 500 of them would hide their step size control."""

Cells = dict[str, dict[str, Any]]


@dataclass(frozen=True)
class Asked:
    """A problem, its stop time [s], and the reference value of each error."""

    problem: Problem
    stop: float
    scales: Mapping[str, float]


def asked(name: str) -> Asked:
    """A published problem, or one from the three other files."""
    if name in MODELS:
        return Asked(*example(name))
    problem = PROBLEMS[name] if name in PROBLEMS else (OWN | SCENES)[name]()
    scales = {path: problem.floor + abs(value) for path, value in problem.values.items()}
    return Asked(problem, problem.model().experiment.stop_time, scales)


def solvers(name: str, problem: Problem) -> tuple[str, ...]:
    """Solvers that are suitable for the problem."""
    explicit = ("erk",) if not problem.stiff or name in SLOPES | EXPLICIT else ()
    return ("rosenbrock", "idas", *(() if name in MODELS else ("cvodes",)), *explicit)


def everything() -> tuple[str, ...]:
    """All names; the examples only if their data are present."""
    return (*PROBLEMS, *OWN, *SCENES, *(MODELS if FOLDER.is_dir() else ()))


def measure(compiled: Any, wanted: Asked, solver: str, tolerance: float, seconds: float) -> Any:
    """End error divided by tolerance and number of steps, or the reason why there is no result."""
    timer = threading.Timer(seconds, signal.raise_signal, (signal.SIGINT,))
    timer.start()
    try:
        result = acausal.simulate(
            compiled,
            solver=solver,
            tolerance=tolerance,
            stop_time=wanted.stop,
            output_interval=wanted.stop / INTERVALS,
        )
    except KeyboardInterrupt:
        return {"failure": f"> {seconds:.0f} s"}
    except AcausalError as error:
        return {"failure": str(error.code)}
    finally:
        timer.cancel()
        timer.join()
    errors = [abs(float(result.final(p)) - r) / wanted.scales[p] for p, r in wanted.problem.values.items()]
    return {"error": max(errors) / tolerance, "steps": float(str(result.stats.get("steps", 0.0)))}


def fill(names: Sequence[str], seconds: float, file: Path) -> Cells:
    """All cells; the file is written after each."""
    cells: Cells = json.loads(file.read_text()) if file.is_file() else {}
    for name in names:
        wanted = asked(name)
        problem = wanted.problem
        compiled = acausal.compile(problem.model())
        row = cells.setdefault(name, {"cells": {}})
        row |= {
            "default": choose(compiled, "auto", None)[0].name,
            "states": compiled.n_dynamic,
            "algebraic": len(compiled.algebraic),
            "source": problem.source,
            "digits": problem.digits,
        }
        for solver in solvers(name, problem):
            for tolerance in TOLERANCES:
                key = f"{solver} {tolerance:g}"
                if key not in row["cells"]:
                    row["cells"][key] = measure(compiled, wanted, solver, tolerance, seconds)
                    file.write_text(json.dumps(cells, indent=1))
    return {name: cells[name] for name in names}


def shown(cell: Mapping[str, Any], digits: int, tolerance: float) -> str:
    """Text of a cell: errors below the accuracy of the answer as bounds, or not at all if that exceeds ten."""
    if "failure" in cell:
        return str(cell["failure"])
    known = 10.0**-digits / tolerance
    error = max(float(cell["error"]), known)
    if known >= MOST and error <= MOST * known:
        return "-"
    if not math.isfinite(error):
        return "not finite"
    return (
        "< 0.01"
        if error < 0.01
        else f"{error:.2f}"
        if error < 1.0
        else f"{error:.2g}"
        if error < 10
        else f"{error:.0f}"
    )


def is_missed(row: Mapping[str, Any], tolerance: float) -> bool:
    """Whether the default solver failed, or its error exceeds both ten tolerances and the accuracy of the answer."""
    cell = row["cells"][f"{row['default']} {tolerance:g}"]
    return not float(cell.get("error", math.inf)) <= max(MOST, 10.0 ** (1 - row["digits"]) / tolerance)


def lines(name: str, row: Mapping[str, Any]) -> list[str]:
    """The rows of one problem, that of the default in bold type."""
    used = [s for s in SOLVERS if f"{s} {TOLERANCES[0]:g}" in row["cells"]]
    text = []
    for k, solver in enumerate(used):
        found = [shown(row["cells"][f"{solver} {t:g}"], row["digits"], t) for t in TOLERANCES]
        if solver == row["default"]:
            found = [f"**{f}**" for f in found]
            solver = f"**{solver}**"
        head = (name, f"{row['states']} + {row['algebraic']}") if not k else ("", "")
        text.append(f"| {' | '.join((*head, solver, *found))} |")
    return text


def page(cells: Cells) -> str:
    """The whole page."""
    missed = [f"{n} at {t:g}" for n, row in cells.items() for t in TOLERANCES if is_missed(row, t)]
    sources = [f"- {name}: {row['source']}" for name, row in cells.items()]
    return "\n".join(
        [
            "# End errors over tolerance",
            "",
            "How large is the error at the end of a run, compared with the tolerance that you ask for? With the",
            "default solver it is at most ten tolerances on every problem of this table; the table lists the other",
            "solvers, too. `benchmarks/accuracy.py` writes this page; do not edit.",
            "",
            "- Each number is the end error divided by the tolerance: max |y - r| / (f + |r|) over the components of",
            "  the reference answer r, with the f of [ivp-table.md](ivp-table.md), or f = 1 for problems that are",
            "  not there.",
            "- Bold: the solver that `auto` selects.",
            "- Unknowns: states + iterated variables.",
            '- AC...: the code of the error that ended the run. "> 20 s": the run was stopped.',
            "- A dash: the answer is known only to ten tolerances or worse, and the error is within that.",
            f"- Runs have {INTERVALS} outputs. Scenes are those of [stability-gallery.md](stability-gallery.md).",
            "- Errors of examples of the Modelica Library (MSL) are relative to the range of each signal.",
            "",
            "**How `auto` selects.** Up to a hundred unknowns, and for every ODE with events, it takes `rosenbrock`, a",
            "method of order 5 that factorises its matrix in every step. It takes `idas` for larger models without",
            "events, and for models with both iterated variables and events. BDF is inaccurate where errors are not",
            "damped: orbits, oscillations, ringing circuits.",
            "",
            "**Fraction of the tolerance.** In a run without events, local errors add up from the first instant to the",
            "last, so a solver gets a hundredth of the tolerance for them; otherwise it gets a tenth",
            "(`tolerance_fraction` in `acausal/simulate/solvers/`).",
            "",
            "Default solver above ten tolerances, or without a result: " + (", ".join(missed) or "none") + ".",
            "",
            "![End errors over tolerance of all problems, by tolerance and solver](images/accuracy.png)",
            "",
            "| problem | unknowns | solver | 1e-4 | 1e-6 | 1e-8 | 1e-10 |",
            "|---|---|---|---|---|---|---|",
            *(line for name, row in cells.items() for line in lines(name, row)),
            "",
            "## Answers",
            "",
            *sources,
        ]
    )


def main(arguments: Iterable[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--problems", default=",".join(everything()), help="names, separated by commas")
    parser.add_argument("--seconds", type=float, default=10.0, help="after which a run is stopped")
    parser.add_argument("--kept", type=Path, default=ROOT / "accuracy.json", help="where cells are kept")
    parser.add_argument("--output", type=Path, default=ROOT / "docs" / "accuracy.md")
    options = parser.parse_args(None if arguments is None else list(arguments))
    cells = fill(options.problems.split(","), options.seconds, options.kept)
    options.output.write_text(page(cells) + "\n")
    draw(options.output)
    print(f"written: {options.output}, {PICTURE}")


if __name__ == "__main__":
    main()
