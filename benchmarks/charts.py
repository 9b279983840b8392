"""Claim: the best solver depends on the model and the accuracy, and `acausal bench` shows it.

Draws the work-precision charts of docs/speed-and-accuracy.md, writes their data beside them, and the page itself.

    python benchmarks/charts.py [--only ThickBlock,Andrews] [--repeat 5] [--time-limit 10]
    python benchmarks/charts.py --redraw        charts and page again from the data beside them, without a measurement
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scenes import BouncingBall, SpatialChain

import acausal
from acausal.errors import AcausalError
from acausal.models.drilling_dynamic import ThickBlock
from acausal.models.drilling_kinematic import ThinPlate
from acausal.models.ivp.andrews_squeezer import AndrewsSqueezer
from acausal.models.rc_ladder import RCLadder
from acausal.study.bench.accuracy.distance import Distance
from acausal.study.bench.accuracy.reference import Reference
from acausal.study.bench.accuracy.trajectory import Trajectory
from acausal.study.bench.case import Case
from acausal.study.bench.chart import bench_chart
from acausal.study.bench.report import Bench
from acausal.study.bench.run import COUNTERS, Run, generic

DOCS = Path(__file__).resolve().parents[1] / "docs"
IMAGES = DOCS / "images"
PAGE = DOCS / "speed-and-accuracy.md"
ACCURACIES = (1e-3, 1e-6, 1e-8, 1e-10)


@dataclass(frozen=True)
class Scene:
    """One chart: the model, its options and a remark on the result."""

    name: str
    title: str
    model: acausal.Component
    remark: str
    options: dict[str, Any]

    @property
    def file(self) -> str:
        return f"bench-{self.name.lower()}"


def scenes() -> tuple[Scene, ...]:
    """The six scenes."""
    return (
        Scene(
            "ThinPlate",
            "ThinPlate: drilling at given feed, 10 s",
            ThinPlate(),
            "The states grow linearly, so every method is exact up to rounding. The chart shows overhead.",
            {},
        ),
        Scene(
            "ThickBlock",
            "ThickBlock: drilling with given force, 40 s, stiff contact",
            ThickBlock(),
            "The model is stiff: explicit methods need steps below 0.2 ms.",
            {
                "solvers": ("idas", "rosenbrock", "cvodes", "rk2"),
                "tolerances": (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8),
                "steps": (1e-2, 1e-3),
            },
        ),
        Scene(
            "Chain",
            "Spatial chain of 4 damped links, 10 s",
            SpatialChain(n=4),
            "The model is smooth and hardly stiff: the explicit method of order five wins.",
            {"tolerances": (1e-3, 1e-5, 1e-7, 1e-9), "formulations": ("torn",)},
        ),
        Scene(
            "RCLadder",
            "RC ladder of 1000 sections, 1 s",
            RCLadder(n=1000),
            "The model has 1000 states but is not stiff over this second: the explicit method wins at all accuracies.",
            {
                "solvers": ("idas", "cvodes", "erk"),
                "tolerances": (1e-3, 1e-5, 1e-7, 1e-9),
                "formulations": ("torn",),
                "steps": (1e-2, 1e-3),
            },
        ),
        Scene(
            "BouncingBall",
            "Bouncing ball, 8 bounces in 5 s",
            BouncingBall(),
            "Between bounces the motion is a parabola. The error is that of locating the bounces.",
            {},
        ),
        Scene(
            "Andrews",
            "Andrews' squeezing mechanism, 0.03 s, three closed loops",
            AndrewsSqueezer(),
            "The published form has index 3. The compiler stabilises the loops and projects recorded points onto them.",
            {},
        ),
    )


def drawn(scene: Scene, repeat: int, limit: float) -> Bench:
    """Bench, chart and data of a scene."""
    found = acausal.bench(
        scene.model,
        repeat=repeat,
        time_limit=limit,
        progress=lambda text: print(text, file=sys.stderr),
        **scene.options,
    )
    draw(scene, found)
    (IMAGES / f"{scene.file}.json").write_text(
        json.dumps(plain({**found.record(), "best": best(found)}), indent=0) + "\n"
    )
    return found


def draw(scene: Scene, found: Bench) -> None:
    trusted = f"reference: {found.reference.source}, {found.reference.trusted_digits:.1f} digits trusted"
    bench_chart(found, IMAGES / f"{scene.file}.png", title=f"{scene.title}\n{trusted}")


def read(data: dict[str, Any]) -> Bench:
    """The bench that was written as `data`, as far as its chart needs it."""
    told = data["reference"]
    none = Trajectory(np.zeros(0), (), np.zeros((0, 0)))
    reference = Reference(none, np.zeros(0), told["trusted_digits"], told["source"])
    head = {name: data[name] for name in ("model", "start_time", "stop_time", "repeat", "times", "machine")}
    runs = tuple(run(row) for row in data["runs"])
    return Bench(runs=runs, reference=reference, components=tuple(data["components"]), **head)


def run(row: dict[str, Any]) -> Run:
    case = Case(row["solver"], row["formulation"], row["tolerance"], row["step"])
    if row["failed"]:
        return Run(case, row["failure"])
    found = Distance(
        end=row["end_error"],
        series=row["error"],
        scd=row["scd"],
        mescd=row["mescd"],
        absolute=row["absolute_error"],
        worst=row["worst"],
        phase=row["phase_error"],
    )
    counters = {name: row[name] for name in COUNTERS if row[name] is not None}
    solve = row["solve_time"] if row["solve_time"] is not None else math.nan
    return Run(case, "", found, solve, counters=counters, constraint_drift=row["constraint_drift"])


def best(found: Bench) -> list[dict[str, Any]]:
    """The cheapest run of each accuracy."""
    rows = []
    for accuracy in ACCURACIES:
        try:
            rows.append(found.recommend(accuracy).record())
        except AcausalError as error:
            rows.append({"accuracy": accuracy, "failure": error.fact})
    return rows


def plain(value: Any) -> Any:
    """Numbers to four digits, without nan, which JSON does not have."""
    if isinstance(value, dict):
        return {k: plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [plain(v) for v in value]
    if isinstance(value, float):
        return float(f"{value:.4g}") if value == value and abs(value) < 1e300 else None
    return value


def section(scene: Scene, data: dict[str, Any]) -> str:
    """The section of the page about one scene."""
    lines = [f"## {scene.title}", "", scene.remark, "", f"![{scene.title}](images/{scene.file}.png)", ""]
    lines += ["| accuracy | cheapest | error | solve ms | with start ms |", "|---|---|---|---|---|"]
    for row in data["best"]:
        if "failure" in row:
            lines.append(f"| {row['accuracy']:g} | {row['failure']} | | | |")
            continue
        knob = f"step {row['step']:.3g} s" if row["step"] else f"tolerance {row['tolerance']:g}"
        form = "" if row["formulation"] == "torn" else f", {row['formulation']}"
        cost = f"{1e3 * row['solve_time']:.3g} | {1e3 * row['cost']:.3g}"
        lines.append(f"| {row['accuracy']:g} | {row['solver']}, {knob}{form} | {row['error']:.1e} | {cost} |")
    failures: dict[str, dict[str, None]] = {}
    for r in data["runs"]:
        if r["failed"]:
            failures.setdefault(generic(r["failure"]), {})[r["series"]] = None
    times, machine = data["times"], data["machine"]
    compiled = ", ".join(
        f"{k.removeprefix('compile ')} {1e3 * v:.0f} ms" for k, v in times.items() if "compile" in k and v
    )
    native = ", ".join(
        f"{k.removeprefix('native ')} {v:.1f} s" for k, v in times.items() if "native" in k and v and v > 0.2
    )
    lines += ["", f"Compile times: {compiled}" + (f"; C code: {native}." if native else ".")]
    if failures:
        told = "; ".join(f"{why} ({'; '.join(who)})" for why, who in failures.items())
        lines += ["", f"Failed: {told}."]
    lines += ["", f"Times are the best of {data['repeat']}; {machine['cores']} cores, load {machine['load']}.", ""]
    return "\n".join(lines)


def page(everything: tuple[Scene, ...]) -> str:
    """The whole page, from the data on disk."""
    import casadi

    head = f"""# Speed against accuracy

Which solver is fastest for a wanted accuracy depends on the model. To see it for yours:

    acausal bench MODEL --recommend --accuracy 1e-6 -o chart.png

This page shows such charts for six models. `python benchmarks/charts.py` writes it; do not edit.

- **Error**: the largest mixed error |y - r| / (f + |r|) of all states at 200 points of the run, with f as in
  [devdocs/bench.md](devdocs/bench.md). Two different solvers produce the reference r. Digits that they do not share are
  not trusted (grey area).
- **Solve time**: processor time, the best of several runs, each in its own process after a warm-up, compiled to C where
  a solver supports it (`idas`, `cvodes`: right-hand sides; `rosenbrock`, `erk`, `rk2`: everything). The column "with
  start" adds the creation of integrators and the computation of start values.
- **Symbols**: hollow squares are fixed steps, dashed lines `dae`, dotted lines `projected`. Crosses on the upper edge
  are failures, numbered as in the list beside the panels.
- Other programs shared the two cores: trust ratios, not milliseconds. Compile times are
  elapsed times. CasADi {casadi.CasadiMeta.version()}.

"""
    parts = []
    for scene in everything:
        file = IMAGES / f"{scene.file}.json"
        if file.is_file():
            parts.append(section(scene, json.loads(file.read_text())))
    return head + "\n".join(parts)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="", help="names of scenes, separated by commas")
    parser.add_argument("--repeat", type=int, default=5)
    parser.add_argument("--time-limit", type=float, default=10.0, help="of a single run [s]")
    parser.add_argument("--redraw", action="store_true", help="draw the data on disk instead of measuring")
    options = parser.parse_args()
    everything = scenes()
    wanted = options.only.split(",") if options.only else [s.name for s in everything]
    for scene in everything:
        if scene.name in wanted and options.redraw:
            draw(scene, read(json.loads((IMAGES / f"{scene.file}.json").read_text())))
        elif scene.name in wanted:
            found = drawn(scene, options.repeat, options.time_limit)
            print(json.dumps({"scene": scene.name, "best": plain(best(found)), "times": plain(dict(found.times))}))
    PAGE.write_text(page(everything))
    print(f"written: {PAGE.relative_to(DOCS.parent)}")


if __name__ == "__main__":
    main()
