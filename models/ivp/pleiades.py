"""Seven stars that attract each other in the plane."""

from __future__ import annotations

from typing import ClassVar

from acausal import Component, Equations, Experiment, Panel, Real, der, fixed, parameter, sqrt, variable

COUNT = 7


class Pleiades(Component):
    """Celestial mechanics with close encounters, not stiff: a test of step size control.

    Source: E. Hairer, S. P. Norsett, G. Wanner, Solving Ordinary Differential Equations I, section II.10; problem
    `plei` of the test set.
    """

    m: Real = parameter(default=tuple(float(i + 1) for i in range(COUNT)), shape=COUNT, doc="Masses")
    x: Real = variable(default=fixed((3.0, 3.0, -1.0, -3.0, 2.0, -2.0, 2.0)), shape=COUNT)
    y: Real = variable(default=fixed((3.0, -3.0, 2.0, 0.0, 0.0, -4.0, 4.0)), shape=COUNT)
    u: Real = variable(default=fixed((0.0, 0.0, 0.0, 0.0, 0.0, 1.75, -1.5)), shape=COUNT)
    v: Real = variable(default=fixed((0.0, 0.0, 0.0, -1.25, 1.0, 0.0, 0.0)), shape=COUNT)

    experiment: ClassVar[Experiment] = Experiment(stop_time=3.0, tolerance=1e-8, solver="erk")
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(tuple(f"y[{i}]" for i in range(COUNT)), title="Orbits", against="x[0]"),
    )

    def equations(self) -> Equations:
        x, y = self.x, self.y
        yield der(x) == self.u
        yield der(y) == self.v
        for i in range(COUNT):
            others = [j for j in range(COUNT) if j != i]
            cubed = {j: sqrt((x[i] - x[j]) ** 2 + (y[i] - y[j]) ** 2) ** 3 for j in others}
            yield der(self.u[i]) == sum(self.m[j] * (x[j] - x[i]) / cubed[j] for j in others)
            yield der(self.v[i]) == sum(self.m[j] * (y[j] - y[i]) / cubed[j] for j in others)
