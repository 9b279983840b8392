"""A railway wheelset that hunts on straight track."""

from __future__ import annotations

from typing import ClassVar

from acausal import (
    Component,
    Equations,
    Experiment,
    Expr,
    Panel,
    Real,
    as_expr,
    atan,
    cos,
    der,
    fabs,
    fixed,
    guess,
    parameter,
    part,
    sign,
    signal_input,
    sin,
    sqrt,
    structural,
    tan,
    tanh,
    variable,
    where,
)

FORCE = 1e4
"""Scale of the source for the normal forces: lam = 1 is 10 kN."""


class Contact(Component):
    """Contact point and creep force of one wheel, a cone, on its rail, a circular arc.

    Creep forces after A. Jaschinski, DLR-FB 90-06 (1990): smooth, saturated by tanh. The inputs are the pose and the
    rates of the wheelset; all units SI.
    """

    side: int = structural(doc="1 for the left wheel (xi > 0), -1 for the right one (xi < 0)")
    V: Real = parameter(default=30.0, doc="Speed")
    RN0: Real = parameter(default=0.1, doc="Nominal radius of the wheel")
    MU: Real = parameter(default=0.12, doc="Friction coefficient")
    E: Real = parameter(default=1.3537956, doc="Coefficient of the contact ellipse")
    GG: Real = parameter(default=0.7115218, doc="Coefficient of the contact ellipse")
    SIGMA: Real = parameter(default=0.28, doc="Poisson's ratio")
    GM: Real = parameter(default=7.92e10, doc="Shear modulus")
    C11: Real = parameter(default=4.72772197, doc="Kalker's coefficient")
    C22: Real = parameter(default=4.27526987, doc="Kalker's coefficient")
    C23: Real = parameter(default=1.97203505, doc="Kalker's coefficient")
    DELTA0: Real = parameter(default=0.0262, doc="Angle of the cone")
    AR: Real = parameter(default=0.1506, doc="Half the distance of the wheels")
    RS: Real = parameter(default=0.06, doc="Radius of the rail's head")
    pi: Real = parameter(default=3.1415926, doc="As in the source; the end values depend on it")

    x: Real = signal_input()
    theta: Real = signal_input()
    phi: Real = signal_input()
    rate: Real = signal_input(shape=5, doc="Rates of x, y, z, theta, phi")
    beta: Real = signal_input(doc="Deviation of the spin from V/RN0")

    psi: Real = variable(nominal=1e-3, doc="Angle of the contact point on the wheel")
    xi: Real = variable(nominal=0.1, doc="Position of the contact point along the axle")
    N: Real = variable(nominal=100.0, doc="Normal force")
    T: Real = variable(shape=3, nominal=10.0, doc="Creep force in the frame of the track")
    Q: Real = variable(shape=5, doc="Row of the constraint Jacobian")
    R: Real = variable(nominal=0.1, doc="Radius of the wheel at the contact point")
    G1: Real = variable(nominal=0.1, doc="Slope of the rail at the contact point")
    G2: Real = variable(nominal=10.0, doc="Curvature term of the rail")
    delta: Real = variable(nominal=0.1, doc="Angle of the contact plane")

    def equations(self) -> Equations:
        st, ct, sp, cp = sin(self.theta), cos(self.theta), sin(self.phi), cos(self.phi)
        ss, cs = sin(self.psi), cos(self.psi)
        R, xi, G1 = self.R, self.xi, self.G1
        R1 = -sign(xi) * tan(self.DELTA0)
        yield R == self.RN0 + tan(self.DELTA0) * (self.AR - fabs(xi))
        place = self.x + xi * ct * cp + R * (ct * sp * cs - st * ss)
        offset = fabs(place) - self.AR - sin(self.DELTA0) * self.RS
        height = sqrt(self.RS**2 - offset**2)
        yield G1 == -sign(place) * offset / height
        yield self.G2 == -(self.RS**2) / height**3
        # The normals of wheel and rail are parallel: two equations for psi and xi.
        yield G1 * (R1 * sp + cp * cs) + R1 * ct * cp - ct * sp * cs + st * ss == 0
        yield R1 * st * cp - st * sp * cs - ct * ss == 0
        yield self.delta == atan(((R1 * cp - sp * cs) * ct + ss * st) / (-self.side * (R1 * sp + cs * cp)))
        row: tuple[Expr | float, ...] = (
            G1,
            -1.0,
            0.0,
            G1 * (R * (-ct * ss - cs * sp * st) - cp * st * xi),
            -cs * R * sp - cp * xi + G1 * (cp * cs * ct * R - ct * sp * xi),
        )
        for k, entry in enumerate(row):
            yield self.Q[k] == entry
        yield from self._creep(R1)

    def _creep(self, R1: Expr) -> Equations:
        sd, cd = sin(self.delta), cos(self.delta)
        st, ct = sin(self.theta / cd), cos(self.theta / cd)
        nu_x, nu_y, spin = self._creepages(st, ct, sd, cd)
        curvature = 0.5 / (self.R * sqrt(1 + R1**2)) - 0.5 * self.G2 / (1 + self.G1**2) ** 1.5
        size = 3 * fabs(self.N) * (1 - self.SIGMA) * self.E / (2 * self.pi * curvature * self.GM * sqrt(self.GG))
        c = size ** (1 / 3)
        most = self.MU * self.N
        tx = -most * tanh(self.GM * c**2 * self.C11 * nu_x / most)
        ty = -most * tanh((self.GM * c**2 * self.C22 * nu_y + self.GM * c**3 * self.C23 * spin) / most)
        square = tx**2 + ty**2
        share = where(square > most**2, fabs(most) / sqrt(square), 1.0, smooth=True)
        yield self.T[0] == share * (st * tx + ct * cd * ty)
        yield self.T[1] == share * self.side * sd * ty
        yield self.T[2] == share * (ct * tx - st * cd * ty)

    def _creepages(self, st: Expr, ct: Expr, sd: Expr, cd: Expr) -> tuple[Expr, Expr, Expr]:
        """Relative velocities at the contact point divided by the rolling velocity."""
        sp, cp, ss, cs = sin(self.phi), cos(self.phi), sin(self.psi), cos(self.psi)
        R, xi = self.R, self.xi
        vx, vy, vz, vtheta, vphi = self.rate
        turn = self.V / self.RN0 + self.beta
        w1 = -turn * R * (st * cs + ct * sp * ss) + vx
        w1 = w1 - vtheta * (R * (st * sp * cs + ct * ss) + xi * st * cp) - vphi * ct * (xi * sp - R * cp * cs)
        w2 = turn * R * cp * ss + vy + vphi * (xi * cp + R * sp * cs)
        w3 = -turn * R * (ct * cs - st * sp * ss) + self.V + vz
        w3 = w3 - vtheta * (xi * ct * cp + R * (ct * sp * cs - st * ss)) + vphi * st * (xi * sp - R * cp * cs)
        rolling = 0.5 * sqrt((w1 - 2 * vx) ** 2 + (w2 - 2 * vy) ** 2 + (w3 - 2 * vz - 2 * self.V) ** 2)
        return (
            (st * w1 + ct * w3) / rolling,
            (ct * cd * w1 + self.side * sd * w2 - st * cd * w3) / rolling,
            (-self.side * sd * turn + cd * vtheta) / rolling,
        )


class Wheelset(Component):
    """Newton-Euler equations with two contacts stated at velocity level: an implicit DAE of index 2.

    Source: B. Simeon, C. Fuehrer, P. Rentrop, Introduction to differential-algebraic equations in vehicle system
    dynamics, Surv. Math. Ind. 1 (1991); problem `wheel` of the test set. Terms for curved track are zero here and left
    out. The mass matrix depends on phi; freezing it changes the end values by up to 3 %.
    """

    MR: Real = parameter(default=16.08, doc="Mass of the wheelset")
    G: Real = parameter(default=9.81, doc="Gravity")
    LI1: Real = parameter(default=0.0605, doc="Moment of inertia about the axle")
    LI2: Real = parameter(default=0.366, doc="Moment of inertia across the axle")
    MA: Real = parameter(default=0.0, doc="Mass of the car body it carries")
    XL: Real = parameter(default=0.19, doc="Half the distance of the springs")
    CX: Real = parameter(default=6400.0, doc="Stiffness across the track")
    CZ: Real = parameter(default=6400.0, doc="Stiffness along the track")
    x: Real = variable(default=fixed(0.14941e-2), nominal=1e-2)
    y: Real = variable(default=fixed(0.40089e-6), nominal=1e-5)
    z: Real = variable(default=fixed(0.11241e-5), nominal=1e-4)
    theta: Real = variable(default=fixed(-0.28573e-3), nominal=1e-2)
    phi: Real = variable(default=fixed(0.26459e-3), nominal=1e-3)
    vx: Real = variable(default=fixed(0.0), nominal=1e-1)
    vy: Real = variable(default=fixed(0.0), nominal=1e-3)
    vz: Real = variable(default=fixed(0.0), nominal=1e-2)
    vtheta: Real = variable(default=fixed(0.0), nominal=1e-1)
    vphi: Real = variable(default=fixed(0.0), nominal=1e-1)
    beta: Real = variable(default=fixed(0.0), nominal=1e-1, doc="Deviation of the spin from V/RN0")
    lam1: Real = variable(default=guess(-8.3593e-3), nominal=1e-2, doc="Contact force, left, in 10 kN")
    lam2: Real = variable(default=guess(-7.4144e-3), nominal=1e-2, doc="Contact force, right, in 10 kN")
    left: Contact = part()
    right: Contact = part()

    experiment: ClassVar[Experiment] = Experiment(stop_time=10.0, tolerance=1e-8, solver="rosenbrock")
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("x",), title="Lateral position"),
        Panel(("theta",), title="Yaw angle"),
    )

    def build(self) -> None:
        self.left = self._contact(1, psi=7.5634406395172940e-6, xi=0.1490635714733819)
        self.right = self._contact(-1, psi=-7.4122380357667139e-6, xi=-0.1521364296121248)

    def _contact(self, side: int, psi: float, xi: float) -> Contact:
        return Contact(
            side=side,
            x=self.x,
            theta=self.theta,
            phi=self.phi,
            rate=(self.vx, self.vy, self.vz, self.vtheta, self.vphi),
            beta=self.beta,
            psi=guess(psi),
            xi=guess(xi),
            N=guess(80.0),
        )

    def equations(self) -> Equations:
        v = (self.vx, self.vy, self.vz, self.vtheta, self.vphi)
        for q, rate in zip((self.x, self.y, self.z, self.theta, self.phi), v, strict=True):
            yield der(q) == rate
        e1, e2 = FORCE * self.lam1, FORCE * self.lam2
        QL, QR, TL, TR = self.left.Q, self.right.Q, self.left.T, self.right.T
        yield from self._normal_forces(QL[0] * e1 + QR[0] * e2, QL[1] * e1 + QR[1] * e2)
        yield self.MR * der(self.vx) == TL[0] + TR[0] + QL[0] * e1 + QR[0] * e2 - 2 * self.CX * self.x
        yield self.MR * der(self.vy) == TL[1] + TR[1] + QL[1] * e1 + QR[1] * e2 - (self.MR + self.MA) * self.G
        yield self.MR * der(self.vz) == TL[2] + TR[2] + QL[2] * e1 + QR[2] * e2 - 2 * self.CZ * self.z
        yield from self._turning(QL[3] * e1 + QR[3] * e2, QL[4] * e1 + QR[4] * e2)
        yield sum((QL[k] * v[k] for k in range(5)), as_expr(0.0)) == 0
        yield sum((QR[k] * v[k] for k in range(5)), as_expr(0.0)) == 0

    def _normal_forces(self, w1: Expr, w2: Expr) -> Equations:
        sl, cl, sr, cr = (f(c.delta) for c in (self.left, self.right) for f in (sin, cos))
        determinant = -sl * cr - sr * cl
        yield self.left.N == (cr * w1 - sr * w2) / determinant
        yield self.right.N == (-cl * w1 - sl * w2) / determinant

    def _turning(self, constraint_theta: Expr, constraint_phi: Expr) -> Equations:
        sp, cp = sin(self.phi), cos(self.phi)
        turn = self.left.V / self.left.RN0 + self.beta
        wt, wp = self.vtheta, self.vphi
        spring = -2 * self.XL**2 * self.CZ * self.theta
        arms = [self._arms(c) for c in (self.left, self.right)]
        gyroscopic = self.LI1 * turn + (self.LI1 - self.LI2) * wt * sp
        yield self.LI2 * (der(wt) * cp - wt * wp * sp) == (
            -gyroscopic * wp + arms[0][0] + arms[1][0] + cp * spring + constraint_theta
        )
        yield self.LI2 * der(wp) == gyroscopic * wt * cp + arms[0][1] + arms[1][1] + constraint_phi
        yield self.LI1 * (der(self.beta) + der(wt) * sp + wt * wp * cp) == arms[0][2] + arms[1][2] + sp * spring

    def _arms(self, c: Contact) -> tuple[Expr, Expr, Expr]:
        """Torques of the creep force of one contact about the three axes."""
        st, ct, sp, cp = sin(self.theta), cos(self.theta), sin(self.phi), cos(self.phi)
        ss, cs = sin(c.psi), cos(c.psi)
        R, xi, T = c.R, c.xi, c.T
        yaw = -(xi * st + R * ss * ct * cp) * T[0] - R * ss * sp * T[1] + (-xi * ct + R * ss * st * cp) * T[2]
        roll = -(xi * ct * sp - R * cs * ct * cp) * T[0] + (xi * cp + R * cs * sp) * T[1]
        roll = roll + (xi * st * sp - R * cs * st * cp) * T[2]
        pitch = -R * (cs * st + ss * ct * sp) * T[0] + R * ss * cp * T[1] - R * (cs * ct - ss * st * sp) * T[2]
        return yaw, roll, pitch
