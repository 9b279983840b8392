"""Claim: thrust and depth of a guided drill need a model of one axis only; more detail costs time and adds nothing.

The scene of section 3.2 of the founding paper (`ThickBlock`, 40 s) at four levels of detail, each as composed and as
`acausal reduce` leaves it for the outputs depth and thrust:

- kinematic: the feed is planned from force and rotation for a steady cut, the forces follow from it;
- one axis: written by hand, `OneAxisDrilling`;
- 3D: bodies, joints, frames, `ThickBlock`;
- 3D contact scene: drill, block and bench are convex bodies whose contacts are found by MPR.

Cost is the least processor time of a run up to these two outputs. Errors are the largest differences from the scene of
bodies and joints at a tolerance of 1e-11, after the first 0.6 s in which the drill bounces on the block.
"""

from __future__ import annotations

import argparse
import gc
import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from measure import report, rounded

import acausal
from acausal import Component, Equations, Experiment, Real, connect, fixed, parameter, part, sin
from acausal.library.blocks import Gain, TimeTable
from acausal.library.contact import Box, ContactBody, ContactScene
from acausal.library.drilling import DrillBody, KinematicDrillingForce, Workpiece, WorkpieceBody
from acausal.library.multibody import Body, Prismatic, Revolute, World
from acausal.library.rotational import Speed as RotationalSpeed
from acausal.library.translational import Force
from acausal.library.translational import Speed as TranslationalSpeed
from acausal.models.drilling_dynamic import FORCE, SPEED, ThickBlock
from acausal.models.drilling_one_axis import OneAxisDrilling
from acausal.result.result import Result

CLOSE = 1.1  # largest ratio of the cost of the reduced 3D scene to that of the one written by hand
LOW, HIGH = 1.6, 40.0  # thrust is compared between these times, after the drill has bounced at its first touch
IDENTITY = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
AXIS = (0.0, 0.0, 1.0)


class PlannedDrilling(Component):
    """The scene with the feed that a steady cut at full diameter would have: equations (16) and (17) of the paper."""

    k_feed: Real = parameter(default=1.0, unit="1", doc="Fraction of the planned feed")

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


class SceneBlock(Component):
    """The same motion in a contact scene, which finds the contacts of the drill by MPR.

    The bench below the block is part of the scene too; the drill does not reach it.
    """

    world: World = part()
    slide: Prismatic = part()
    spindle: Revolute = part()
    body: Body = part()
    scene: ContactScene = part()
    force_table: TimeTable = part()
    force: Force = part()
    speed_table: TimeTable = part()
    turns_to_radians: Gain = part()
    speed: RotationalSpeed = part()

    experiment = Experiment(stop_time=40.0, tolerance=1e-8, solver="idas")

    def build(self) -> None:
        self.world = World(g=0.0)
        self.slide = Prismatic(n=AXIS, s=fixed(-1e-3), v=fixed(0.0))
        self.spindle = Revolute(n=AXIS, phi=fixed(0.0))
        self.body = Body(m=5.0)
        block, bench = Box((0.1, 0.1, 0.05)), Box((0.3, 0.3, 0.02))
        self.scene = ContactScene(
            bodies=(
                DrillBody(name="drill", wanders=False, reach=((0.0, 0.0, -0.01), (0.0, 0.0, 0.05))),
                WorkpieceBody(name="block", shape=block, pose=((0.0, 0.0, 0.025), IDENTITY), at_rest=True),
                ContactBody(name="bench", shape=bench, pose=((0.0, 0.0, 0.2), IDENTITY), at_rest=True),
            )
        )
        self.force_table, self.speed_table = TimeTable(table=FORCE), TimeTable(table=SPEED)
        self.force, self.speed = Force(), RotationalSpeed()
        self.turns_to_radians = Gain(k=2.0 * math.pi)

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.slide.frame_a)
        yield connect(self.slide.frame_b, self.spindle.frame_a)
        yield connect(self.spindle.frame_b, self.body.frame_a)
        yield connect(self.body.frame_a, self.scene.frame("drill"))
        yield connect(self.force_table.y, self.force.u)
        yield connect(self.force.flange, self.slide.axis)
        yield connect(self.speed_table.y, self.turns_to_radians.u)
        yield connect(self.turns_to_radians.y, self.speed.w_ref)
        yield connect(self.speed.flange, self.spindle.axis)


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
    Level("3D contact scene", SceneBlock(), ("scene.contacts[0].s", "scene.contacts[0].F_f")),
)


def job(compiled: Any, outputs: tuple[str, str], everything: bool) -> Callable[[], Result]:
    """A job that runs the model and reads its outputs, or all of its signals."""

    def run() -> Result:
        result = acausal.simulate(compiled, native=False, output_interval=0.1)
        _ = result.matrix if everything else [result[name] for name in outputs]
        return result

    return run


def errors(level: Level, result: Result, truth: Result) -> dict[str, float]:
    """Largest errors of depth [mm] and thrust [N], the latter also relative to the largest thrust."""
    times = 0.1 * np.arange(1, 400)  # stored rows: nothing is integrated again
    late = (times > LOW) & (times < HIGH)
    found = {}
    for quantity, name, scale in (("depth_mm", level.outputs[0], 1e3), ("thrust_N", level.outputs[1], 1.0)):
        reference = "drill.s" if quantity == "depth_mm" else "drill.F_f"
        # The depth is also defined before contact; the planned motion starts at the face.
        a, b = (np.asarray(r.at(times, n)) for r, n in ((result, name), (truth, reference)))
        if quantity == "depth_mm":
            a, b = np.maximum(a, 0.0), np.maximum(b, 0.0)
        found[quantity] = float(scale * np.abs(a - b)[late].max())
    return found


def fastest(jobs: dict[str, Callable[[], Result]], repetitions: int) -> dict[str, float]:
    """Minimum processor time of each job, run in turn, which other load on the machine hardly affects."""
    best = dict.fromkeys(jobs, math.inf)
    for repetition in range(repetitions + 1):
        for name, work in jobs.items():
            gc.collect()
            began = time.process_time()
            work()
            if repetition:
                best[name] = min(best[name], time.process_time() - began)
    return best


def measured(repetitions: int) -> tuple[list[dict[str, Any]], float]:
    """One row for each level, and the ratio of the reduced 3D scene to the one by hand."""
    compiled: dict[str, Any] = {}
    jobs: dict[str, Callable[[], Result]] = {}
    for level in LEVELS:
        for form, options in (("full", {}), ("reduced", {"outputs": level.outputs, "freeze": ["zeros"]})):
            key = f"{level.name}, {form}"
            compiled[key] = acausal.compile(level.model, **options)
            jobs[key] = job(compiled[key], level.outputs, form == "full")
    seconds = fastest(jobs, repetitions)
    truth = acausal.simulate(compiled["3D, reduced"], tolerance=1e-11, native=False, output_interval=0.1)
    rows = []
    for level in LEVELS:
        for form in ("full", "reduced"):
            key = f"{level.name}, {form}"
            c = compiled[key]
            rows.append(
                {
                    "level": level.name,
                    "form": form,
                    "milliseconds": 1e3 * seconds[key],
                    "states": len(c.states),
                    "algebraic": len(c.algebraic),
                    "equations": len(c.flat.equations) if form == "full" else len(c.solution.definitions),
                    "operations": int(c.rhs.n_instructions()),
                    **errors(level, jobs[key](), truth),
                }
            )
    pair = {name: jobs[name] for name in ("3D, reduced", "one axis, full")}
    seconds = fastest(pair, 4 * repetitions)
    return rows, seconds["3D, reduced"] / seconds["one axis, full"]


def draw(rows: list[dict[str, Any]], file: Path) -> None:
    """Cost by level, and the errors of depth and thrust against cost."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12.0, 4.4), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(1, 3)
    names = list(dict.fromkeys(r["level"] for r in rows))
    for k, form in enumerate(_FORMS):
        own = [r for r in rows if r["form"] == form]
        places = np.arange(len(own)) + 0.4 * (k - 0.5)
        bars = axes[0].bar(places, [r["milliseconds"] for r in own], 0.38, color=_COLORS[form], label=_FORMS[form])
        labels = [f"{r['states']}\n{r['equations']}" for r in own]
        axes[0].bar_label(bars, labels, fontsize=8, padding=2)
    axes[0].set_xticks(range(len(names)), [n.replace("3D ", "3D\n") for n in names])
    axes[0].set_ylim(0.0, 1.45 * max(r["milliseconds"] for r in rows))
    axes[0].set_ylabel("processor time of a run of 40 s [ms]")
    axes[0].set_title("Cost; on the bars: states, equations", loc="left", fontsize=10)
    axes[0].legend(fontsize=8, loc="upper left", frameon=False)
    for ax, key, label in ((axes[1], "depth_mm", "depth [mm]"), (axes[2], "thrust_N", "thrust [N]")):
        for marker, name in zip("osD^", names, strict=False):
            for r in (r for r in rows if r["level"] == name):
                color = _COLORS[r["form"]]
                face = color if r["form"] == "reduced" else "none"
                legend = name if r["form"] == "reduced" else None
                ax.plot(
                    r["milliseconds"], r[key], marker, ms=8, mec=color, mfc=face, mew=1.4, label=legend, clip_on=False
                )
        ax.set_yscale("log")
        ax.set_xlim(0.0, 1.1 * max(r["milliseconds"] for r in rows))
        ax.set_xlabel("processor time of a run [ms]")
        ax.set_ylabel(f"largest error of the {label}")
        ax.grid(True, which="major", lw=0.4)
        ax.margins(y=0.15)
        ax.legend(fontsize=8, title="reduced: filled", title_fontsize=8)
    axes[1].set_title("Error of the depth against cost", loc="left", fontsize=10)
    axes[2].set_title("Error of the thrust against cost", loc="left", fontsize=10)
    file.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(file, dpi=130)


_COLORS = {"full": "C1", "reduced": "C0"}
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
