"""Claim: the cost of many bodies is that of their contacts: growth below 1.2, 256 balls or 16 boxes below 1 s.

Balls are dropped on a plane side by side, each with its own spin and speed and without declared contacts; boxes are
released on top of each other and settle (`BoxStack`). A second run reuses the results of the first compilation. Growth
is the exponent of the time of a second run between two sizes, as a function of the pairs in the equations.

    python benchmarks/many_contacts.py
    python benchmarks/many_contacts.py --balls 16 64 --boxes 4
"""

from __future__ import annotations

import argparse
import math
import resource
import time
from typing import Any, ClassVar

from measure import report, rounded

import acausal
from acausal import Component, Equations, Experiment, connect, fixed, part, structural
from acausal.library.contact import ContactBody, ContactScene, Coulomb, HalfSpace, HuntCrossley, Sphere, Surfaces
from acausal.library.multibody import Body, World
from acausal.models.contact_scenes import BoxStack

GROWTH = 1.2
SECONDS = {("balls", 256): 1.0, ("boxes", 16): 1.0}


class Balls(Component):
    """Balls side by side over the ground, dropped from different heights, moving and spinning."""

    n: int = structural(default=16, doc="Number of balls")

    world: World = part()
    balls: list[Body] = part()
    scene: ContactScene = part()

    experiment: ClassVar[Experiment] = Experiment(stop_time=0.5, tolerance=1e-6)

    def build(self) -> None:
        radius, m = 0.05, 1.0
        self.world = World(n=(0.0, 0.0, -1.0))
        wide = math.ceil(math.sqrt(self.n))
        inertia = 0.4 * m * radius**2
        self.balls = [
            Body(
                m=m,
                I_11=inertia,
                I_22=inertia,
                I_33=inertia,
                r_0=fixed((0.3 * (k % wide), 0.3 * (k // wide), radius + 0.02 + 0.02 * (k % 5))),
                v_0=fixed((0.1 * math.sin(k), 0.1 * math.cos(k), 0.0)),
                Q=fixed((0.0, 0.0, 0.0, 1.0)),
                w_a=fixed((1.0 + math.sin(2.0 * k), 2.0 * math.cos(k), 0.0)),
            )
            for k in range(self.n)
        ]
        ground = ContactBody(name="ground", shape=HalfSpace(), at_rest=True)
        bodies = (ground, *(ContactBody(name=f"ball{k}", shape=Sphere(radius)) for k in range(self.n)))
        law = HuntCrossley(k=1e5, n=1.5, e=0.7, v_0=0.5)
        self.scene = ContactScene(bodies=bodies, surfaces=Surfaces(law=law, friction=Coulomb(mu=0.3)), skin=0.05)

    def equations(self) -> Equations:
        for k, ball in enumerate(self.balls):
            yield connect(ball.frame_a, self.scene.frame(f"ball{k}"))


def _seconds(job: Any) -> tuple[float, Any]:
    began = time.process_time()
    made = job()
    return time.process_time() - began, made


def measured(model: Component) -> dict[str, Any]:
    """Seconds of a first and a second run, and of a run of the compiled model."""
    first, _ = _seconds(lambda: acausal.simulate(model))
    second, result = _seconds(lambda: acausal.simulate(model))
    stats: Any = result.stats
    return {
        "first": first,
        "second": second,
        "steps": stats["steps"],
        "pieces": stats.get("pieces", 1),
        "structures": stats.get("structures", 1),
        "pairs": sum(name.endswith(".F_N") for name in result.names),
        "solver": stats["solver"],
        "time": stats["time"],
        "peak_MB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
    }


def growth(rows: list[dict[str, Any]]) -> float:
    """Exponent of the time of a second run as a function of the contacts, between the last two sizes."""
    one, two = rows[-2:]
    return math.log(two["second"] / one["second"]) / math.log(two["pairs"] / one["pairs"])


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--balls", type=int, nargs="*", default=[1, 4, 16, 64, 256, 1024])
    parser.add_argument("--boxes", type=int, nargs="*", default=[2, 4, 8, 16])
    given = parser.parse_args()
    rows: dict[str, list[dict[str, Any]]] = {}
    for name, kind, sizes in (("balls", Balls, given.balls), ("boxes", BoxStack, given.boxes)):
        rows[name] = [{"n": n, **measured(kind(n=n))} for n in sizes]
    exponents = {name: growth(found) for name, found in rows.items() if len(found) > 1}
    told = [f"{r['n']} {name} {r['second']:.2f} s" for name, found in rows.items() for r in found]
    told += [f"growth of {name} {x:.2f}" for name, x in exponents.items()]
    seconds = {(name, r["n"]): r["second"] for name, found in rows.items() for r in found}
    # A goal is judged only if its size was run.
    met = {f"growth of {name}": x < GROWTH for name, x in exponents.items()}
    met |= {f"{n} {name}": seconds[name, n] < most for (name, n), most in SECONDS.items() if (name, n) in seconds}
    report((__doc__ or "").split("\n")[0], ", ".join(told), rounded({"met": met, "growth": exponents, **rows}))


if __name__ == "__main__":
    main()
