"""A drill of given motion has no memory of its hole: the run says so where it is drawn back."""

from __future__ import annotations

import pytest

import acausal
from acausal import Component, Equations, connect, fixed, part, quantity, sin, structural, time
from acausal.library.drilling import KinematicDrillingForce, Workpiece
from acausal.library.multibody import Prismatic, Revolute, World
from acausal.library.rotational import Speed as TurningSpeed
from acausal.library.translational import Speed
from acausal.models.drilling_kinematic import ThinPlate

AXIS = (0.0, 0.0, 1.0)


class Given(Component):
    """A drill that turns and moves 2 mm/s into a plate, steadily or to and fro with 1 rad/s."""

    returns: bool = structural()
    world: World = World(g=0.0)
    slide: Prismatic = Prismatic(n=AXIS, s=fixed(-1e-3))
    spindle: Revolute = Revolute(n=AXIS, phi=fixed(0.0))
    drill: KinematicDrillingForce = part()
    workpiece: Workpiece = part()
    feed: Speed = part()
    turning: TurningSpeed = TurningSpeed(w_ref=60.0)

    def build(self) -> None:
        rate = quantity(2e-3, "m/s")
        self.workpiece = Workpiece(t=0.05)
        self.drill = KinematicDrillingForce(t=self.workpiece.t)
        self.feed = Speed(v_ref=rate * sin(quantity(1.0, "1/s") * time) if self.returns else rate * 1.0)

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.slide.frame_a, self.workpiece.frame_a)
        yield connect(self.slide.frame_b, self.spindle.frame_a)
        yield connect(self.spindle.frame_b, self.drill.frame_a)
        yield connect(self.workpiece.frame_b, self.drill.frame_w)
        yield connect(self.feed.flange, self.slide.axis)
        yield connect(self.turning.flange, self.spindle.axis)


def test_a_retreat_is_noted_and_a_steady_feed_is_not() -> None:
    """v = 2 mm/s sin(t) turns back at pi."""
    run = acausal.simulate(Given(returns=True), stop_time=4.0)
    (note,) = [n for n in run.stats["notes"] if "AC193" in n]  # type: ignore[attr-defined]
    assert note.startswith("t = 3.14159")
    assert float(note.split()[2]) == pytest.approx(3.1415927, abs=1e-5)
    run = acausal.simulate(Given(returns=False), stop_time=4.0)
    assert not [n for n in run.stats.get("notes", ()) if "AC193" in n]  # type: ignore[attr-defined]


@pytest.mark.parametrize(("n", "is_told"), [(9.28, False), (0.1, False), (0.0, True)])
def test_a_drill_that_is_fed_without_turning_is_noted(n: float, is_told: bool) -> None:
    # 1.672 mm/s at 0.1 1/s is a feed of 16.7 mm on a drill of 20 mm
    run = acausal.simulate(ThinPlate(n=n), parameters={"drill.d": 0.02})
    assert any("AC197" in note for note in run.stats.get("notes", ())) == is_told  # type: ignore[attr-defined]
