"""Shafts joined by clutches: stuck and sliding in every combination."""

from __future__ import annotations

from typing import ClassVar

from acausal import Component, Equations, Experiment, Panel, Real, connect, parameter, part, structural
from acausal.library.blocks import Sine, Step
from acausal.library.rotational import Clutch, Inertia, Torque


class ThreeClutchDrive(Component):
    """Four inertias in a row, coupled by three clutches that engage one after the other.

    Modelica.Mechanics.Rotational.Examples.CoupledClutches: the first clutch is pressed in a slow wave, the second from
    0.4 s, the third from 0.9 s on, while a torque of 5 Hz drives the first inertia.
    """

    J1: Inertia = part()
    J2: Inertia = part()
    J3: Inertia = part()
    J4: Inertia = part()
    clutch1: Clutch = part()
    clutch2: Clutch = part()
    clutch3: Clutch = part()
    torque: Torque = part()
    sin1: Sine = part()
    sin2: Sine = part()
    step1: Step = part()
    step2: Step = part()

    experiment: ClassVar[Experiment] = Experiment(stop_time=1.5, tolerance=1e-8)
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("J1.w", "J2.w", "J3.w", "J4.w"), title="Speeds"),
        Panel(("clutch1.tau", "clutch2.tau", "clutch3.tau"), title="Torques of the clutches"),
        Panel(("clutch1.mode", "clutch2.mode", "clutch3.mode"), title="Modes: -1, 1 sliding, 0 stuck, 2 free"),
    )

    def build(self) -> None:
        self.J1 = Inertia(J=1.0, phi=0.0, w=10.0)
        self.J2, self.J3, self.J4 = (Inertia(J=1.0, phi=0.0, w=0.0) for _ in range(3))
        self.clutch1, self.clutch2, self.clutch3 = (Clutch(peak=1.1, fn_max=20.0) for _ in range(3))
        self.torque = Torque()
        self.sin1 = Sine(amplitude=10.0, f=5.0)
        self.sin2 = Sine(amplitude=1.0, f=0.2, phase=1.57)
        self.step1, self.step2 = Step(start_time=0.4), Step(start_time=0.9)

    def equations(self) -> Equations:
        yield connect(self.torque.flange, self.J1.flange_a)
        yield connect(self.J1.flange_b, self.clutch1.flange_a)
        yield connect(self.clutch1.flange_b, self.J2.flange_a)
        yield connect(self.J2.flange_b, self.clutch2.flange_a)
        yield connect(self.clutch2.flange_b, self.J3.flange_a)
        yield connect(self.J3.flange_b, self.clutch3.flange_a)
        yield connect(self.clutch3.flange_b, self.J4.flange_a)
        yield connect(self.sin1.y, self.torque.u)
        yield connect(self.sin2.y, self.clutch1.f_normalized)
        yield connect(self.step1.y, self.clutch2.f_normalized)
        yield connect(self.step2.y, self.clutch3.f_normalized)


class ClutchChain(Component):
    """`n` engaged clutches between `n + 1` inertias at rest; a sinusoidal torque acts on the first.

    Each clutch is pressed less than the one before, so that it cannot transmit the torque that the inertias beyond it
    need: they break loose one after the other, from the far end on, and stick again when the torque reverses.
    """

    n: int = structural(default=10, doc="Number of clutches")
    J: Real = parameter(default=0.1, unit="kg.m2", min=0.0, doc="Moment of inertia of each body")
    fn_max: Real = parameter(default=2.0, unit="N", min=0.0, doc="Normal force of the first clutch")
    amplitude: Real = parameter(default=5.0, unit="N.m", doc="Amplitude of the torque")
    f: Real = parameter(default=1.0, unit="Hz", doc="Frequency of the torque")
    inertias: list[Inertia] = part()
    clutches: list[Clutch] = part()
    torque: Torque = part()
    sine: Sine = part()

    experiment: ClassVar[Experiment] = Experiment(stop_time=2.0, tolerance=1e-8)
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("inertias[0].w", "inertias[1].w", "inertias[2].w", "inertias[5].w"), title="Speeds"),
        Panel(("clutches[0].mode", "clutches[1].mode", "clutches[4].mode"), title="Modes"),
    )

    def build(self) -> None:
        self.inertias = [Inertia(J=self.J, phi=0.0, w=0.0) for _ in range(self.n + 1)]
        shares = [(1.0 - k / self.n) ** 2 for k in range(self.n)]
        self.clutches = [Clutch(fn_max=self.fn_max * share, f_normalized=1.0) for share in shares]
        self.torque = Torque()
        self.sine = Sine(amplitude=self.amplitude, f=self.f)

    def equations(self) -> Equations:
        yield connect(self.sine.y, self.torque.u)
        yield connect(self.torque.flange, self.inertias[0].flange_a)
        for left, clutch, right in zip(self.inertias, self.clutches, self.inertias[1:], strict=False):
            yield connect(left.flange_b, clutch.flange_a)
            yield connect(clutch.flange_b, right.flange_a)
