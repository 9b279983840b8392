"""Claim: a question about thrust and depth of a drill on its guide needs one axis; more detail costs and adds nothing.

The scene of section 3.2 of the founding paper (`ThickBlock`, 40 s) at four levels of detail, each as composed and as
`acausal reduce` leaves it for the outputs depth and thrust:

- kinematic: the feed is planned from force and rotation for a steady cut, the forces follow from it;
- one axis: written by hand, `OneAxisDrilling`;
- 3D: bodies, joints, frames, `ThickBlock`;
- 3D with contact: the block is any convex body, and MPR looks for the overlap.

Cost is the best time of a run up to these two outputs. Errors are the largest differences from the level of most
detail at a tolerance of 1e-11; of the thrust outside of the first 0.5 s in which the drill hits the block.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from measure import alternated, report, rounded

import acausal
from acausal import Component, Equations, Experiment, Real, connect, fixed, parameter, part, sin
from acausal.library.blocks import Gain, TimeTable
from acausal.library.contact.shapes import Box
from acausal.library.drilling import DrillingForce, KinematicDrillingForce, Workpiece
from acausal.library.drilling.geometry_convex import ConvexLevel
from acausal.library.multibody import Prismatic, Revolute, World
from acausal.library.rotational import Speed as RotationalSpeed
from acausal.library.translational import Speed as TranslationalSpeed
from acausal.models.drilling_dynamic import FORCE, SPEED, ThickBlock
from acausal.models.drilling_one_axis import OneAxisDrilling
from acausal.result import Result

CLOSE = 1.1  # the reduced 3D scene may cost so many times the one written by hand
LOW, HIGH = 1.6, 40.0  # thrust is compared between these times: the drill bounces when it first touches
IDENTITY = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
AXIS = (0.0, 0.0, 1.0)


class PlannedDrilling(Component):
    """The scene with the feed that a steady cut at full diameter would have: equations (16) and (17) of the paper."""

    k_feed: Real = parameter(default=1.0, unit="1", doc="Share of the planned feed")

    world: World = part()
    slide: Prismatic = part()
    spindle: Revolute = part()
    drill: KinematicDrillingForce = part()
    workpiece: Workpiece = part()
    force_table: TimeTable = part()
    speed_table: TimeTable = part()
    turns_to_radians: Gain = part()
    feed: TranslationalSpeed = part()
    speed: RotationalSpeed = part()

    experiment = Experiment(stop_time=40.0, tolerance=1e-8, solver="idas")

    def build(self) -> None:
        self.world = World(g=0.0)
        self.slide = Prismatic(n=AXIS, s=fixed(0.0))
        self.spindle = Revolute(n=AXIS, phi=fixed(0.0))
        self.workpiece = Workpiece(t=0.05)
        self.drill = KinematicDrillingForce(
            t=self.workpiece.t, width=self.workpiece.width, height=self.workpiece.height, axis_a=AXIS
        )
        self.force_table = TimeTable(table=FORCE)
        self.speed_table = TimeTable(table=SPEED)
        self.turns_to_radians = Gain(k=2.0 * math.pi)
        d = self.drill
        share = self.force_table.y / (d.feed_force_factor * d.d / 2 * d.z_E * d.k_c11 * 1e-3)
        f_z = 1e-3 * (share * sin(d.sigma / 2) ** d.z) ** (1 / (1 - d.z))
        self.feed = TranslationalSpeed(v_ref=self.k_feed * d.z_E * f_z * self.speed_table.y)
        self.speed = RotationalSpeed()

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.slide.frame_a, self.workpiece.frame_a)
        yield connect(self.slide.frame_b, self.spindle.frame_a)
        yield connect(self.spindle.frame_b, self.drill.frame_a)
        yield connect(self.workpiece.frame_b, self.drill.frame_w)
        yield connect(self.feed.flange, self.slide.axis)
        yield connect(self.speed_table.y, self.turns_to_radians.u)
        yield connect(self.turns_to_radians.y, self.speed.w_ref)
        yield connect(self.speed.flange, self.spindle.axis)


class ConvexBlock(ThickBlock):
    """The same scene with a convex body as block, and MPR to find where it overlaps the drill."""

    def build(self) -> None:
        super().build()
        block = ConvexLevel(Box((0.1, 0.1, 0.05)), pose=((0.0, 0.0, 0.025), IDENTITY), name="the block")
        self.drill = DrillingForce(level=block, t=self.workpiece.t, axis_a=AXIS, k=1e8, d_c=2e4)


@dataclass(frozen=True, eq=False)
class Level:
    """A model and the names of its depth and thrust."""

    name: str
    model: Component
    outputs: tuple[str, str]


LEVELS = (
    Level("kinematic", PlannedDrilling(), ("drill.s", "drill.F_f")),
    Level("one axis", OneAxisDrilling(), ("s", "F_f")),
    Level("3D", ThickBlock(), ("drill.s", "drill.F_f")),
    Level("3D with MPR", ConvexBlock(), ("drill.s", "drill.F_f")),
)


def job(compiled: Any, outputs: tuple[str, str], everything: bool) -> Callable[[], Result]:
    """A run up to its outputs, or up to everything that the model can tell."""

    def run() -> Result:
        result = acausal.simulate(compiled, native=False, output_interval=0.1)
        _ = result.matrix if everything else [result[name] for name in outputs]
        return result

    return run


def errors(level: Level, result: Result, truth: Result) -> dict[str, float]:
    """Largest errors of depth [mm] and thrust [N]; the share of the largest thrust."""
    times = 0.1 * np.arange(1, 400)  # stored rows: nothing is integrated again
    late = (times > LOW) & (times < HIGH)
    found = {}
    for quantity, name, scale in (("depth_mm", level.outputs[0], 1e3), ("thrust_N", level.outputs[1], 1.0)):
        reference = "drill.s" if quantity == "depth_mm" else "drill.F_f"
        # A drill in the air has a depth too; the planned one starts at the face.
        a, b = (np.asarray(r.at(times, n)) for r, n in ((result, name), (truth, reference)))
        if quantity == "depth_mm":
            a, b = np.maximum(a, 0.0), np.maximum(b, 0.0)
        found[quantity] = float(scale * np.abs(a - b)[late].max())
    return found


def measured(repetitions: int) -> tuple[list[dict[str, Any]], float]:
    """One row for each level, and the ratio of the reduced 3D scene to the one by hand."""
    compiled: dict[str, Any] = {}
    jobs: dict[str, Callable[[], Result]] = {}
    for level in LEVELS:
        for form, options in (("full", {}), ("reduced", {"outputs": level.outputs, "freeze": ["zeros"]})):
            key = f"{level.name}, {form}"
            compiled[key] = acausal.compile(level.model, **options)
            jobs[key] = job(compiled[key], level.outputs, form == "full")
    seconds = alternated(jobs, repetitions)
    truth = acausal.simulate(compiled["3D with MPR, reduced"], tolerance=1e-11, native=False, output_interval=0.1)
    rows = []
    for level in LEVELS:
        for form in ("full", "reduced"):
            key = f"{level.name}, {form}"
            c = compiled[key]
            rows.append(
                {
                    "level": level.name,
                    "form": form,
                    "milliseconds": 1e3 * min(seconds[key]),
                    "states": len(c.states),
                    "algebraic": len(c.algebraic),
                    "equations": len(c.flat.equations) if form == "full" else len(c.solution.definitions),
                    "operations": int(c.rhs.n_instructions()),
                    **errors(level, jobs[key](), truth),
                }
            )
    return rows, min(seconds["3D, reduced"]) / min(seconds["one axis, full"])


def draw(rows: list[dict[str, Any]], file: Path) -> None:
    """Cost by level, and the errors of depth and thrust against cost."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 4.2), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(1, 3)
    names = list(dict.fromkeys(r["level"] for r in rows))
    colors = {"full": "C1", "reduced": "C0"}
    for k, form in enumerate(("full", "reduced")):
        own = [r for r in rows if r["form"] == form]
        places = np.arange(len(own)) + 0.38 * (k - 0.5)
        bars = axes[0].bar(places, [r["milliseconds"] for r in own], 0.36, color=colors[form], label=_FORMS[form])
        axes[0].bar_label(bars, [f"{r['states']} | {r['equations']}" for r in own], fontsize=7, padding=2)
        for ax, key in ((axes[1], "depth_mm"), (axes[2], "thrust_N")):
            ax.plot([r["milliseconds"] for r in own], [r[key] for r in own], "o-", color=colors[form], lw=0.8)
    axes[0].set_xticks(range(len(names)), [n.replace(" with", "\nwith") for n in names])
    axes[0].set_yscale("log")
    axes[0].set_ylim(top=3.0 * max(r["milliseconds"] for r in rows))
    axes[0].set_ylabel("time of a run of 40 s, ms")
    axes[0].set_title("cost, with states | equations", loc="left", fontsize=10)
    axes[0].legend(fontsize=8, loc="upper left")
    for ax, key, label in (
        (axes[1], "depth_mm", "largest error of the depth, mm"),
        (axes[2], "thrust_N", "of the thrust, N"),
    ):
        for r in rows:
            if r["form"] == "reduced":
                ax.annotate(r["level"], (r["milliseconds"], r[key]), (5, 6), textcoords="offset points", fontsize=8)
        ax.set_xscale("log")
        ax.set_yscale("log")
        ax.set_xlabel("time of a run, ms")
        ax.set_ylabel(f"largest error of the {label}")
        ax.grid(True, which="major", lw=0.4)
        ax.margins(0.25, 0.15)
    axes[1].set_title("error of the depth against cost", loc="left", fontsize=10)
    axes[2].set_title("error of the thrust against cost", loc="left", fontsize=10)
    file.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(file, dpi=130)


_FORMS = {"full": "as composed, all signals", "reduced": "acausal reduce, depth and thrust"}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0] if __doc__ else None)
    parser.add_argument("--repetitions", type=int, default=10, help="of each job")
    parser.add_argument("--figure", type=Path, default=None, help="picture to draw, for example docs/images/ladder.png")
    args = parser.parse_args()
    rows, ratio = measured(args.repetitions)
    if args.figure is not None:
        draw(rows, args.figure)
    table = {(r["level"], r["form"]): r for r in rows}
    report(
        "thrust and depth of a drill on its guide need one axis; acausal reduce finds it in the 3D scene",
        f"the 3D scene, reduced, costs {ratio:.2f} times the one axis by hand (limit {CLOSE}: "
        f"{'met' if ratio <= CLOSE else 'MISSED'}), with {table['3D', 'reduced']['states']} states as there",
        rounded({"met": ratio <= CLOSE, "ratio": ratio, "levels": rows, "repetitions": args.repetitions}),
    )


if __name__ == "__main__":
    main()
