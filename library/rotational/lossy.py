"""Gear with losses in its teeth and bearings. Names as in Modelica.Mechanics.Rotational.Components.LossyGear.

Source: C. Pelchen, C. Schweiger, M. Otter, Modeling and simulating the efficiency of gearboxes and of planetary
gearboxes, 2nd International Modelica Conference, Oberpfaffenhofen (2002).
"""

from __future__ import annotations

from typing import ClassVar

from acausal import (
    Equations,
    Expr,
    Real,
    after_reset,
    boolean,
    der,
    equals,
    fabs,
    infinitesimal,
    initial,
    integer,
    parameter,
    pre,
    quantity,
    structural,
    unitless,
    variable,
    where,
)
from acausal.errors import DeclarationError
from acausal.library.blocks.dry_friction import reach, within
from acausal.library.blocks.tables import Points, table
from acausal.library.rotational.interfaces import PartialTwoFlanges

Losses = tuple[tuple[float, float, float, float, float], ...]


class LossyGear(PartialTwoFlanges):
    """Gear without inertia that loses torque to the friction of its teeth and bearings; it can be self-locking.

    `flange_a.phi = ratio*flange_b.phi` and `flange_b.tau = -ratio*(flange_a.tau - tauLoss)`. With x = flange_a.tau, the
    lost torque of forward motion is `(1 - eta_mf1)*x + tau_bf1` if flange_a drives (x > 0), and
    `(1 - 1/eta_mf2)*x + tau_bf2` if flange_b does. For backward motion the two cases are exchanged, and the bearing
    friction has the opposite sign. At standstill it is the torque between these limits that keeps the gear at rest.
    """

    BACKWARD: ClassVar[int] = -1
    STUCK: ClassVar[int] = 0
    FORWARD: ClassVar[int] = 1
    UNKNOWN: ClassVar[int] = 3

    ratio: Real = parameter(unit="1", doc="Speed of flange_a divided by that of flange_b")
    lossTable: Losses = structural(
        doc="Rows (|w_a| [rad/s], eta_mf1, eta_mf2, |tau_bf1| [N.m], |tau_bf2| [N.m]), efficiencies in (0, 1]"
    )
    phi_a: Real = variable(unit="rad", doc="Angle of flange_a")
    w_a: Real = variable(unit="rad/s", doc="Angular velocity of flange_a")
    a_a: Real = variable(unit="rad/s2", doc="Angular acceleration of flange_a")
    tauLoss: Real = variable(unit="N.m", doc="Lost torque, at flange_a")
    tauLossMax: Real = variable(unit="N.m", doc="Lost torque of forward motion")
    tauLossMin: Real = variable(unit="N.m", doc="Lost torque of backward motion")
    loss_power: Real = variable(unit="W", doc="Power turned into heat")
    sa: Real = variable(unit="1", doc="Path: a torque [N.m] while stuck, else an acceleration [rad/s2] beyond the loss")
    startForward: Real = boolean(doc="w_a = 0, and forward motion begins")
    startBackward: Real = boolean(doc="w_a = 0, and backward motion begins")
    locked: Real = boolean(doc="w_a = 0, and nothing moves")
    mode: Real = integer(default=3, doc="-1 backward, 0 stuck, 1 forward, 3 not known yet")

    def build(self) -> None:
        for row in self.lossTable:
            if len(row) != 5 or not (0.0 < row[1] <= 1.0 and 0.0 < row[2] <= 1.0 and row[3] >= 0.0 and row[4] >= 0.0):
                raise DeclarationError(
                    "AC130",
                    f"lossTable: {row} is not a row of losses",
                    help="give |w|, two efficiencies above 0 and at most 1, and two torques that are not negative",
                )
        if all(row[1:] == (1.0, 1.0, 0.0, 0.0) for row in self.lossTable):
            raise DeclarationError(
                "AC130",
                "lossTable holds no losses",
                cause="without losses the gear cannot be held at standstill",
                help="use IdealGear",
            )

    def equations(self) -> Equations:
        x, w = self.flange_a.tau, self.w_a
        forward, backward, stuck = (equals(pre(self.mode), m) for m in (self.FORWARD, self.BACKWARD, self.STUCK))
        eta1, eta2 = self._loss(1), self._loss(2)
        bearing1, bearing2 = (quantity(1.0, "N.m") * self._loss(column) for column in (3, 4))
        ends = [reach(self._points(column), high=1.0) for column in (1, 2)]
        ends += [reach(self._points(column)) for column in (3, 4)]
        yield from within(w, min(ends))
        yield self.phi_a == self.flange_a.phi
        yield self.phi_a == self.ratio * self.flange_b.phi
        yield w == der(self.phi_a)
        yield self.a_a == der(w)
        yield self.flange_b.tau == -self.ratio * (x - self.tauLoss)
        driven, driving = (1.0 - eta1) * x, (1.0 - 1.0 / eta2) * x
        yield self.tauLossMax == where(x >= 0.0, driven + bearing1, driving + bearing2)
        yield self.tauLossMin == where(x >= 0.0, driving - bearing2, driven - bearing1)

        sa = unitless(self.sa)  # a torque or an acceleration
        anew = initial() | after_reset()
        path = where(stuck & ~anew, sa, 0.5 * (self.tauLossMax + self.tauLossMin))
        positive = where(forward | self.startForward | anew, unitless(w), -1.0) > 0.0
        negative = where(backward | self.startBackward | anew, unitless(w), 1.0) < 0.0
        # The direction changes only via standstill: the path parameter of a wrong direction may exceed the loss of the
        # other, so that the two would alternate and never reach the locked mode between them.
        breaks_forward = stuck & ~pre(self.startBackward) & (path > self.tauLossMax)
        breaks_backward = stuck & ~pre(self.startForward) & (path < self.tauLossMin)
        yield self.startForward == (breaks_forward | anew & positive)
        yield self.startBackward == (breaks_backward | anew & negative)
        yield self.locked == ~(forward | self.startForward | backward | self.startBackward)
        moving = where(forward | self.startForward, self.tauLossMax, self.tauLossMin)
        yield self.tauLoss == where(self.locked, sa, moving)
        yield self.a_a == where(self.locked, infinitesimal() * sa, sa - unitless(self.tauLoss))
        yield self.mode == where(
            (forward | self.startForward) & positive,
            self.FORWARD,
            where((backward | self.startBackward) & negative, self.BACKWARD, self.STUCK),
        )
        yield self.loss_power == self.tauLoss * w

    def _loss(self, column: int) -> Expr:
        """A column of the table at the present speed."""
        return table(self._points(column), fabs(self.w_a), located=False)

    def _points(self, column: int) -> Points:
        return tuple((row[0], row[column]) for row in self.lossTable)
