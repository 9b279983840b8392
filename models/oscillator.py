"""Damped oscillator: the first model to read."""

from __future__ import annotations

from typing import ClassVar

from acausal import Component, Equations, Experiment, Panel, Real, connect, fixed, parameter, part
from acausal.library.translational import Damper, Fixed, Mass, Spring


class Oscillator(Component):
    """Mass on a spring and a damper, released at rest.

    The motion is the textbook one: s = s0*exp(-z*t)*(cos(w*t) + z/w*sin(w*t)) with z = d/(2*m) and
    w = sqrt(c/m - z**2).
    """

    m: Real = parameter(default=1.0, unit="kg", min=0.0, doc="Mass")
    c: Real = parameter(default=100.0, unit="N/m", min=0.0, doc="Stiffness of the spring")
    d: Real = parameter(default=1.0, unit="N.s/m", min=0.0, doc="Damping constant")
    s0: Real = parameter(default=0.1, unit="m", doc="Position at release")

    wall: Fixed = part()
    spring: Spring = part()
    damper: Damper = part()
    mass: Mass = part()

    experiment: ClassVar[Experiment] = Experiment(stop_time=5.0)
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("mass.s",), title="Position"),
        Panel(("spring.f", "damper.f"), title="Forces"),
    )

    def build(self) -> None:
        self.wall = Fixed()
        self.spring = Spring(c=self.c)
        self.damper = Damper(d=self.d)
        self.mass = Mass(m=self.m, s=fixed(self.s0), v=0.0)

    def equations(self) -> Equations:
        yield connect(self.wall.flange, self.spring.flange_a, self.damper.flange_a)
        yield connect(self.spring.flange_b, self.damper.flange_b, self.mass.flange_a)
