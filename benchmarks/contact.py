"""Claims of the contact library, measured.

1. The scene `ThickBlock` with a convex workpiece, MPR in its equations, takes at most three times as long as with
   the analytic plate, and ends at the same depth; a collision library called through Python takes much longer.
2. A thousand workpieces, one drill: a run takes at most 1.3 times what it takes with one workpiece.

    python benchmarks/contact.py                      all, and the picture docs/images/contact.png
    python benchmarks/contact.py --repetitions 3      quicker
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from measure import alternated, medians, report, rounded

import acausal
from acausal import Equations, External, der, quantity
from acausal.library.contact import Box
from acausal.library.drilling import ConvexLevel, DrillingForce
from acausal.library.drilling.geometry import PartialDrillGeometry
from acausal.library.multibody.orientation import IDENTITY
from acausal.models.contact_scenes import HolesSideBySide
from acausal.models.drilling_dynamic import ThickBlock

UP = (0.0, 0.0, 1.0)
LEVELS, MANY = 3.0, 1.3
COUNTS = (1, 10, 100, 1000)


class ConvexBlock(ThickBlock):
    """`ThickBlock` with the block as a convex body."""

    def build(self) -> None:
        super().build()
        level = ConvexLevel(Box((0.1, 0.1, 0.05)), ((0.0, 0.0, 0.025), IDENTITY), "block")
        self.drill = DrillingForce(level=level, t=0.05, axis_a=UP, k=1e8, d_c=2e4)


class CallbackGeometry(PartialDrillGeometry):
    """Depth by coal (the library formerly called hpp-fcl), called through a Python callback.

    Only for a drill perpendicular to a face, less deep than half the block: there the penetration depth is the depth
    along the axis.
    """

    def equations(self) -> Equations:
        yield self.s == _coal_depth(self.tip)
        yield self.s_exit == self.s - quantity(50.0, "mm")
        yield self.v == der(self.s)


class CallbackForce(DrillingForce):
    """The drilling force on this geometry."""

    def build(self) -> None:
        super().build()
        self.geometry = CallbackGeometry(axis_a=self.axis_a, d=self.d, sigma=self.sigma, length=self.length)


class CallbackBlock(ThickBlock):
    """`ThickBlock` with the depth from a Python callback."""

    def build(self) -> None:
        super().build()
        self.drill = CallbackForce(t=0.05, axis_a=UP, k=1e8, d_c=2e4)


_kept: list[Any] = []  # CasADi does not own its callbacks


class _Callback(ca.Callback):  # type: ignore[misc]
    """A function of the tip in Python; with `known`, its value is an argument too, as CasADi requires for Jacobians."""

    def __init__(self, name: str, columns: int, known: bool, value: Callable[[Any], Any]) -> None:
        ca.Callback.__init__(self)
        self.columns, self.known, self.value = columns, known, value
        self.construct(name, {})

    def get_n_in(self) -> int:
        return 2 if self.known else 1

    def get_n_out(self) -> int:
        return 1

    def get_sparsity_in(self, i: int) -> Any:
        return ca.Sparsity.dense(3 if i == 0 else 1, 1)

    def get_sparsity_out(self, i: int) -> Any:
        return ca.Sparsity.dense(1, self.columns)

    def eval(self, arguments: Sequence[Any]) -> list[Any]:
        return [ca.DM(self.value(arguments[0]))]

    def has_jacobian(self) -> bool:
        return True


class _Slope(_Callback):
    """The normal of the contact as the derivative of the depth."""

    def __init__(self) -> None:
        super().__init__("coal_slope", 3, True, lambda tip: np.array(_coal_contact(tip)[1]).reshape(1, 3))

    def get_jacobian(self, name: str, names_in: Any, names_out: Any, options: Any) -> Any:
        # Zero, as for a flat face: the library provides no second derivatives.
        given = [ca.MX.sym("tip", 3), ca.MX.sym("depth"), ca.MX.sym("slope", 1, 3)]
        return ca.Function(name, given, [ca.MX(3, 3), ca.MX(3, 1)], names_in, names_out, options)


class _Depth(_Callback):
    def __init__(self) -> None:
        super().__init__("coal_depth", 1, False, lambda tip: _coal_contact(tip)[0])

    def get_jacobian(self, name: str, names_in: Any, names_out: Any, options: Any) -> Any:
        slope = _Slope()
        _kept.append(slope)
        return slope


def _coal_contact(tip: Any) -> tuple[float, Any]:
    """Depth [m] and normal of the cone of the drill in the block, by coal."""
    import coal

    cone, block, at, request = _coal_bodies()
    # The tip of coal's cone is at +z, so the centre of the cone lies behind it.
    place = coal.Transform3s()
    place.setRotation(np.diag([1.0, -1.0, -1.0]))
    place.setTranslation(np.array(tip).ravel() - np.array([0.0, 0.0, cone.halfLength]))
    result = coal.CollisionResult()
    if coal.collide(cone, place, block, at, request, result):
        found = result.getContact(0)
        return -found.penetration_depth, found.normal
    apart = coal.DistanceResult()
    return -coal.distance(cone, place, block, at, coal.DistanceRequest(), apart), apart.normal


@cache
def _coal_bodies() -> tuple[Any, Any, Any, Any]:
    """Cone, block, pose of the block, and the collision request."""
    import coal

    at, request = coal.Transform3s(), coal.CollisionRequest()
    at.setTranslation(np.array([0.0, 0.0, 0.025]))
    request.num_max_contacts = 1
    return coal.Cone(0.008, 0.008 / np.tan(np.radians(59.0))), coal.Box(0.1, 0.1, 0.05), at, request


def _coal_function() -> Any:
    """`(tip) -> depth` [m], with its derivative by the normal of the contact."""
    made = _Depth()
    _kept.append(made)
    tip = ca.MX.sym("tip", 3)
    return ca.Function("depth", [tip], [made(tip)], {"never_inline": True})


_coal_depth = External("coal_depth", _coal_function, inputs=((3,),), outputs=((),), units=("m",))


def levels(repetitions: int) -> dict[str, Any]:
    """Processor seconds of a run of `ThickBlock` for each level of the geometry, and the differences of the results.

    Interpreted, and compiled to C (`_c`); a callback cannot be compiled.
    """
    models: dict[str, Any] = {"plate": ThickBlock(), "convex": ConvexBlock()}
    try:
        import coal  # noqa: F401

        models["callback"] = CallbackBlock()
    except ImportError:
        pass
    compiled = {name: acausal.compile(model) for name, model in models.items()}
    results: dict[str, Any] = {}
    names = [*compiled, "plate_c", "convex_c"]
    spent: dict[str, list[float]] = {name: [] for name in names}

    def job(name: str) -> Any:
        def run() -> None:
            began = time.process_time()
            results[name] = acausal.simulate(compiled[name.removesuffix("_c")], native=name.endswith("_c"))
            spent[name].append(time.process_time() - began)

        return run

    alternated({name: job(name) for name in names}, repetitions)
    seconds = medians({name: times[1:] for name, times in spent.items()})
    plate = results["plate"]
    grid = np.linspace(0.0, 40.0, 81)
    far = {n: float(np.abs(r.at(grid, "drill.s") - plate.at(grid, "drill.s")).max()) for n, r in results.items()}
    ratio = {name: seconds[name] / seconds["plate_c" if name.endswith("_c") else "plate"] for name in seconds}
    return {"seconds": seconds, "ratio": ratio, "difference_m": far, "limit": LEVELS}


def many(repetitions: int) -> dict[str, Any]:
    """Processor seconds of a second run for one drill among increasingly many plates, none of them excluded before."""
    spent: dict[str, list[float]] = {str(n): [] for n in COUNTS}
    pairs: dict[str, Any] = {}
    models = {str(n): HolesSideBySide(n=n) for n in COUNTS}

    def job(name: str) -> Any:
        def run() -> None:
            began = time.process_time()
            result = acausal.simulate(models[name], native=False)
            spent[name].append(time.process_time() - began)
            report: Any = result.stats["reports"]
            pairs[name] = {"steps": result.stats["steps"], "kept": report["scene"].count("drill - plate")}

        return run

    alternated({name: job(name) for name in models}, repetitions)
    seconds = medians({name: times[1:] for name, times in spent.items()})
    ratio = {name: seconds[name] / seconds["1"] for name in seconds}
    return {"seconds": seconds, "ratio": ratio, "pairs": pairs, "limit": MANY}


def draw(first: dict[str, Any], second: dict[str, Any], file: Path) -> None:
    """Both claims as one picture."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, (left, right) = plt.subplots(1, 2, figsize=(11.5, 4), layout="constrained")
    labels = {
        "plate": "analytic plate",
        "convex": "convex box, MPR\nin the equations",
        "convex_c": "the same,\nboth as C",
        "callback": "coal by\nPython callback",
    }
    names = [name for name in labels if name in first["ratio"]]
    bars = left.bar([labels[n] for n in names], [first["ratio"][n] for n in names], color="#0072b2")
    told = [f"{s:.1f} s" if s >= 1.0 else f"{1e3 * s:.0f} ms" for s in (first["seconds"][n] for n in names)]
    left.bar_label(bars, told, label_type="center", color="white")
    left.set(yscale="log", ylim=(0.3, 200))
    left.axhline(LEVELS, color="#d55e00", linestyle="--", label=f"limit for MPR: {LEVELS:g}")
    left.set(ylabel="Processor time of a run, plate = 1", title="ThickBlock: 40 s of drilling, IDAS at 1e-8")
    left.legend()
    counts = [int(n) for n in second["ratio"]]
    right.semilogx(counts, list(second["ratio"].values()), "o-", color="#0072b2", label="a second run")
    right.axhline(MANY, color="#d55e00", linestyle="--", label=f"limit: {MANY:g}")
    right.set(
        xlabel="Workpieces in the scene",
        ylabel="Processor time, one workpiece = 1",
        title="One drill, three holes",
        ylim=(0, 2),
    )
    right.legend()
    left.grid(axis="y", alpha=0.3)
    right.grid(alpha=0.3)
    left.set_axisbelow(True)
    figure.savefig(file, dpi=110)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--repetitions", type=int, default=7)
    parser.add_argument("--file", type=Path, default=Path("docs/images/contact.png"))
    given = parser.parse_args()
    first, second = levels(given.repetitions), many(max(1, given.repetitions // 2))
    draw(first, second, given.file)
    verdict = all(
        (first["ratio"]["convex"] <= LEVELS, first["difference_m"]["convex"] <= 1e-7, second["ratio"]["1000"] <= MANY)
    )
    ratios = ", ".join(f"{n} {r:.2f}" for n, r in first["ratio"].items())
    line = f"ThickBlock by level: {ratios}; 1000 workpieces: {second['ratio']['1000']:.2f} times one"
    line += ": holds" if verdict else ": does not hold"
    report(__doc__.split("\n")[0], line, rounded({"levels": first, "many": second}))


if __name__ == "__main__":
    main()
