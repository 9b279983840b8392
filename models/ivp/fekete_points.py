"""Fekete points: charges on a sphere that settle at a minimum of their potential."""

from __future__ import annotations

import math
from typing import ClassVar

from acausal import (
    Component,
    Equations,
    Experiment,
    Panel,
    Real,
    as_expr,
    der,
    dot,
    fixed,
    guess,
    parameter,
    part,
    structural,
    variable,
)

Vector = tuple[float, float, float]


def start(count: int = 20) -> list[Vector]:
    """Start positions of the source, four rings of 3, 7, 6 and 4 points, each of shape (3,)."""
    rings = [
        *((2 * math.pi * i / 3 + math.pi / 13, 3 * math.pi / 8) for i in range(1, 4)),
        *((2 * math.pi * (i - 3) / 7 + math.pi / 29, math.pi / 8) for i in range(4, 11)),
        *((2 * math.pi * (i - 10) / 6 + math.pi / 7, -2 * math.pi / 15) for i in range(11, 17)),
        *((2 * math.pi * (i - 17) / 4 + math.pi / 17, -3 * math.pi / 10) for i in range(17, 21)),
    ]
    return [(math.cos(a) * math.cos(b), math.sin(a) * math.cos(b), math.sin(b)) for a, b in rings[:count]]


class Particle(Component):
    """A unit charge on the unit sphere; the constraint and its derivative are both kept (stabilised index 2)."""

    alpha: Real = parameter(default=0.5, doc="Damping")
    p: Real = variable(shape=3, doc="Position")
    q: Real = variable(default=fixed((0.0, 0.0, 0.0)), shape=3, doc="Velocity")
    lam: Real = variable(default=guess(-4.0), doc="Force that keeps it on the sphere")
    mu: Real = variable(default=guess(0.0), doc="Multiplier of the velocity constraint; 0 in an exact solution")
    force: Real = variable(shape=3, doc="Repulsion of the others")

    def equations(self) -> Equations:
        yield der(self.p) == self.q + 2 * self.mu * self.p
        yield der(self.q) == -self.alpha * self.q + 2 * self.lam * self.p + self.force
        yield dot(self.p, self.p) - 1 == 0
        yield 2 * dot(self.p, self.q) == 0


class FeketePoints(Component):
    """Twenty particles that repel each other with 1/distance.

    Source: problem `fekete` of the test set (C. Bendtsen; P. Pardalos, An open global optimization problem on the unit
    sphere, J. Global Optim. 6 (1995)).
    """

    count: int = structural(default=20, doc="Number of particles")
    particles: list[Particle] = part()

    experiment: ClassVar[Experiment] = Experiment(stop_time=1000.0, tolerance=1e-8, solver="idas")
    figure: ClassVar[tuple[Panel, ...]] = (Panel(("particles[0].p[0]", "particles[0].p[1]", "particles[0].p[2]")),)

    def build(self) -> None:
        self.particles = [Particle(p=fixed(p)) for p in start(self.count)]

    def equations(self) -> Equations:
        for i, here in enumerate(self.particles):
            total = as_expr((0.0, 0.0, 0.0))
            for j, there in enumerate(self.particles):
                if i == j:
                    continue
                gap = here.p - there.p
                push = gap / dot(gap, gap)
                total = total + push
            yield here.force == total
