"""Chain of masses of any length: a mechanical benchmark of the compiler."""

from __future__ import annotations

from typing import ClassVar

from acausal import Component, Equations, Experiment, Panel, Real, connect, fixed, parameter, part, structural
from acausal.library.translational import Fixed, Mass, SpringDamper


class MassSpringDamperChain(Component):
    """`n` equal masses in a chain of springs and dampers from a wall; the first one starts displaced.

    Reduced it has 2*n states: m*a[k] = c*(s[k-1] - 2*s[k] + s[k+1]) + d*(v[k-1] - 2*v[k] + v[k+1]).
    """

    n: int = structural(default=10, doc="Number of masses")
    m: Real = parameter(default=1.0, unit="kg", min=0.0, doc="Each mass")
    c: Real = parameter(default=100.0, unit="N/m", min=0.0, doc="Stiffness of each spring")
    d: Real = parameter(default=1.0, unit="N.s/m", min=0.0, doc="Constant of each damper")
    s0: Real = parameter(default=0.1, unit="m", doc="Deflection of the first mass at the start")

    wall: Fixed = part()
    springs: list[SpringDamper] = part()
    masses: list[Mass] = part()

    experiment: ClassVar[Experiment] = Experiment(stop_time=10.0)
    figure: ClassVar[tuple[Panel, ...]] = (Panel(("masses[0].s",), title="Position of the first mass"),)

    def build(self) -> None:
        self.wall = Fixed()
        self.springs = [SpringDamper(c=self.c, d=self.d) for _ in range(self.n)]
        self.masses = [Mass(m=self.m, s=fixed(self.s0 if k == 0 else 0.0), v=0.0) for k in range(self.n)]

    def equations(self) -> Equations:
        yield connect(self.wall.flange, self.springs[0].flange_a)
        for spring, mass in zip(self.springs, self.masses, strict=True):
            yield connect(spring.flange_b, mass.flange_a)
        for mass, spring in zip(self.masses, self.springs[1:], strict=False):
            yield connect(mass.flange_b, spring.flange_a)
