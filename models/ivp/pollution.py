"""Chemistry of air pollution: 20 species, 25 reactions."""

from __future__ import annotations

from typing import ClassVar

from acausal import Component, Equations, Experiment, Panel, Real, der, fixed, parameter, variable

RATE_CONSTANTS = (
    0.35, 26.6, 1.23e4, 8.6e-4, 8.2e-4, 1.5e4, 1.3e-4, 2.4e4, 1.65e4, 9e3, 0.022, 1.2e4, 1.88,
    1.63e4, 4.8e6, 3.5e-4, 0.0175, 1e8, 4.44e11, 1240.0, 2.1, 5.78, 0.0474, 1780.0, 3.12,
)  # fmt: skip
START = (0.0, 0.2, 0.0, 0.04, 0.0, 0.0, 0.1, 0.3, 0.01, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.007, 0.0, 0.0, 0.0)


class Pollution(Component):
    """The chemical part of the air pollution model of RIVM.

    Source: J. G. Verwer, SIAM J. Sci. Comput. 15 (1994); problem `pollu` of the test set. Concentrations in ppm,
    rates in ppm/min. Numbers start at 0 here: `y[0]` is y1 of the source.
    """

    k: Real = parameter(default=RATE_CONSTANTS, shape=25, doc="Rate constants")
    y: Real = variable(default=fixed(START), shape=20, nominal=1e-3, doc="Concentrations")
    r: Real = variable(shape=25, doc="Reaction rates")

    experiment: ClassVar[Experiment] = Experiment(stop_time=60.0, tolerance=1e-8, solver="rosenbrock")
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("y[0]", "y[1]", "y[6]", "y[7]"), title="Large concentrations"),
        Panel(("y[9]", "y[10]", "y[13]"), title="Small concentrations"),
    )

    def equations(self) -> Equations:
        yield from self._rates()
        yield from self._balances()

    def _rates(self) -> Equations:
        y = self.y
        factors = (
            y[0], y[1] * y[3], y[4] * y[1], y[6], y[6], y[6] * y[5], y[8], y[8] * y[5], y[10] * y[1], y[10] * y[0],
            y[12], y[9] * y[1], y[13], y[0] * y[5], y[2], y[3], y[3], y[15], y[15], y[16] * y[5],
            y[18], y[18], y[0] * y[3], y[18] * y[0], y[19],
        )  # fmt: skip
        for i, factor in enumerate(factors):
            yield self.r[i] == self.k[i] * factor

    def _balances(self) -> Equations:
        r1, r2, r3, r4, r5, r6, r7, r8, r9, r10, r11, r12, r13 = (self.r[i] for i in range(13))
        r14, r15, r16, r17, r18, r19, r20, r21, r22, r23, r24, r25 = (self.r[i] for i in range(13, 25))
        yield der(self.y[0]) == -r1 - r10 - r14 - r23 - r24 + r2 + r3 + r9 + r11 + r12 + r22 + r25
        yield der(self.y[1]) == -r2 - r3 - r9 - r12 + r1 + r21
        yield der(self.y[2]) == -r15 + r1 + r17 + r19 + r22
        yield der(self.y[3]) == -r2 - r16 - r17 - r23 + r15
        yield der(self.y[4]) == -r3 + 2 * r4 + r6 + r7 + r13 + r20
        yield der(self.y[5]) == -r6 - r8 - r14 - r20 + r3 + 2 * r18
        yield der(self.y[6]) == -r4 - r5 - r6 + r13
        yield der(self.y[7]) == r4 + r5 + r6 + r7
        yield der(self.y[8]) == -r7 - r8
        yield der(self.y[9]) == -r12 + r7 + r9
        yield der(self.y[10]) == -r9 - r10 + r8 + r11
        yield der(self.y[11]) == r9
        yield der(self.y[12]) == -r11 + r10
        yield der(self.y[13]) == -r13 + r12
        yield der(self.y[14]) == r14
        yield der(self.y[15]) == -r18 - r19 + r16
        yield der(self.y[16]) == -r20
        yield der(self.y[17]) == r20
        yield der(self.y[18]) == -r21 - r22 - r24 + r23 + r25
        yield der(self.y[19]) == -r25 + r24
