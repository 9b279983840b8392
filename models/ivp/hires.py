"""High irradiance response: eight reactions by which light shapes a plant."""

from __future__ import annotations

from typing import ClassVar

from acausal import Component, Equations, Experiment, Panel, Real, der, fixed, variable


class Hires(Component):
    """A stiff reaction chain that ends just after a sharp drop.

    Source: E. Schaefer, J. Math. Biology 2 (1975); problem `hires` of the test set.
    """

    y: Real = variable(shape=8, default=fixed((1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0057)))

    experiment: ClassVar[Experiment] = Experiment(stop_time=321.8122, tolerance=1e-8)
    figure: ClassVar[tuple[Panel, ...]] = (Panel(("y[0]", "y[5]", "y[7]"), title="Concentrations"),)

    def equations(self) -> Equations:
        y = self.y
        bound = 280.0 * y[5] * y[7]
        yield der(y[0]) == -1.71 * y[0] + 0.43 * y[1] + 8.32 * y[2] + 0.0007
        yield der(y[1]) == 1.71 * y[0] - 8.75 * y[1]
        yield der(y[2]) == -10.03 * y[2] + 0.43 * y[3] + 0.035 * y[4]
        yield der(y[3]) == 8.32 * y[1] + 1.71 * y[2] - 1.12 * y[3]
        yield der(y[4]) == -1.745 * y[4] + 0.43 * y[5] + 0.43 * y[6]
        yield der(y[5]) == -bound + 0.69 * y[3] + 1.71 * y[4] - 0.43 * y[5] + 0.69 * y[6]
        yield der(y[6]) == bound - 1.81 * y[6]
        yield der(y[7]) == -bound + 1.81 * y[6]
