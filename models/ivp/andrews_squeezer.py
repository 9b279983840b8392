"""Andrews' squeezing mechanism: seven plane bodies, three closed loops, driven through a spring by a motor."""

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
    cos,
    der,
    fixed,
    guess,
    parameter,
    sin,
    sqrt,
    variable,
)

# Initial angles, all of which can be given since they close the loops to the last digit.
ANGLES = (
    -0.0617138900142764496358948458001,
    0.0,
    0.455279819163070380255912382449,
    0.222668390165885884674473185609,
    0.487364979543842550225598953530,
    -0.222668390165885884674473185609,
    1.23054744454982119249735015568,
)


class AndrewsSqueezer(Component):
    """M(q)*der(v) = f(q, v) - G(q)'*lambda, 0 = g(q): a DAE of index 3, as published.

    Source: W. Giles (1978), W. Schiehlen (ed.), Multibody Systems Handbook (1990); E. Hairer, G. Wanner, Solving
    Ordinary Differential Equations II, section VII.7; problem `andrews` of the test set. Names as there.
    """

    m1: Real = parameter(default=0.04325, unit="kg")
    m2: Real = parameter(default=0.00365, unit="kg")
    m3: Real = parameter(default=0.02373, unit="kg")
    m4: Real = parameter(default=0.00706, unit="kg")
    m5: Real = parameter(default=0.07050, unit="kg")
    m6: Real = parameter(default=0.00706, unit="kg")
    m7: Real = parameter(default=0.05498, unit="kg")
    i1: Real = parameter(default=2.194e-6, unit="kg.m2")
    i2: Real = parameter(default=4.410e-7, unit="kg.m2")
    i3: Real = parameter(default=5.255e-6, unit="kg.m2")
    i4: Real = parameter(default=5.667e-7, unit="kg.m2")
    i5: Real = parameter(default=1.169e-5, unit="kg.m2")
    i6: Real = parameter(default=5.667e-7, unit="kg.m2")
    i7: Real = parameter(default=1.912e-5, unit="kg.m2")
    xa: Real = parameter(default=-0.06934, unit="m")
    ya: Real = parameter(default=-0.00227, unit="m")
    xb: Real = parameter(default=-0.03635, unit="m")
    yb: Real = parameter(default=0.03273, unit="m")
    xc: Real = parameter(default=0.014, unit="m")
    yc: Real = parameter(default=0.072, unit="m")
    c0: Real = parameter(default=4530.0, unit="N/m", doc="Stiffness of the spring")
    l0: Real = parameter(default=0.07785, unit="m", doc="Free length of the spring")
    d: Real = parameter(default=0.028, unit="m")
    da: Real = parameter(default=0.0115, unit="m")
    e: Real = parameter(default=0.02, unit="m")
    ea: Real = parameter(default=0.01421, unit="m")
    rr: Real = parameter(default=0.007, unit="m")
    ra: Real = parameter(default=0.00092, unit="m")
    ss: Real = parameter(default=0.035, unit="m")
    sa: Real = parameter(default=0.01874, unit="m")
    sb: Real = parameter(default=0.01043, unit="m")
    sc: Real = parameter(default=0.018, unit="m")
    sd: Real = parameter(default=0.02, unit="m")
    ta: Real = parameter(default=0.02308, unit="m")
    tb: Real = parameter(default=0.00916, unit="m")
    u: Real = parameter(default=0.04, unit="m")
    ua: Real = parameter(default=0.01228, unit="m")
    ub: Real = parameter(default=0.00449, unit="m")
    zf: Real = parameter(default=0.02, unit="m")
    zt: Real = parameter(default=0.04, unit="m")
    fa: Real = parameter(default=0.01421, unit="m")
    mom: Real = parameter(default=0.033, unit="N.m", doc="Torque of the motor")

    beta: Real = variable(default=fixed(ANGLES[0]), unit="rad", doc="Angle of the crank")
    theta: Real = variable(default=fixed(ANGLES[1]), unit="rad")
    gamma: Real = variable(default=fixed(ANGLES[2]), unit="rad")
    phi: Real = variable(default=fixed(ANGLES[3]), unit="rad")
    delta: Real = variable(default=fixed(ANGLES[4]), unit="rad")
    omega: Real = variable(default=fixed(ANGLES[5]), unit="rad")
    eps: Real = variable(default=fixed(ANGLES[6]), unit="rad")
    v: Real = variable(default=fixed((0.0,) * 7), shape=7, unit="rad/s", nominal=1e3, doc="Rates of the angles")
    lam: Real = variable(
        default=guess((100.0, -6.0, 0.0, 0.0, 0.0, 0.0)),
        shape=6,
        unit="N",
        nominal=100.0,
        doc="Forces that close the loops",
    )

    experiment: ClassVar[Experiment] = Experiment(stop_time=0.03, tolerance=1e-8, solver="rosenbrock")
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("beta", "theta"), title="Crank and coupler"),
        Panel(("gamma", "phi", "delta", "omega", "eps"), title="Rockers"),
    )

    def equations(self) -> Equations:
        q = (self.beta, self.theta, self.gamma, self.phi, self.delta, self.omega, self.eps)
        for k, angle in enumerate(q):
            yield der(angle) == self.v[k]
        M, f, G, g = self._masses(), self._forces(), self._slopes(), self._gaps()
        for i in range(7):
            inertia = sum((M[i, j] * der(self.v[j]) for j in range(7) if (i, j) in M), as_expr(0.0))
            closing = sum(G[k, i] * self.lam[k] for k in range(6) if (k, i) in G)
            yield inertia == f[i] - closing
        for gap in g:
            yield gap == 0

    def _masses(self) -> dict[tuple[int, int], Expr]:
        """Entries of M(q) that are not 0."""
        rr, da, zt, u = self.rr, self.da, self.zt, self.u
        ee, zz = self.e - self.ea, self.zf - self.fa
        M = {
            (0, 0): self.m1 * self.ra**2
            + self.m2 * (rr**2 - 2 * da * rr * cos(self.theta) + da**2)
            + self.i1
            + self.i2,
            (0, 1): self.m2 * (da**2 - da * rr * cos(self.theta)) + self.i2,
            (1, 1): self.m2 * da**2 + self.i2,
            (2, 2): self.m3 * (self.sa**2 + self.sb**2) + self.i3,
            (3, 3): self.m4 * ee**2 + self.i4,
            (3, 4): self.m4 * (ee**2 + zt * ee * sin(self.phi)) + self.i4,
            (4, 4): self.m4 * (zt**2 + 2 * zt * ee * sin(self.phi) + ee**2)
            + self.m5 * (self.ta**2 + self.tb**2)
            + self.i4
            + self.i5,
            (5, 5): self.m6 * zz**2 + self.i6,
            (5, 6): self.m6 * (zz**2 - u * zz * sin(self.omega)) + self.i6,
            (6, 6): self.m6 * (zz**2 - 2 * u * zz * sin(self.omega) + u**2)
            + self.m7 * (self.ua**2 + self.ub**2)
            + self.i6
            + self.i7,
        }
        return M | {(j, i): entry for (i, j), entry in M.items()}

    def _forces(self) -> list[Expr]:
        v, gamma = self.v, self.gamma
        ee, zz = self.e - self.ea, self.zf - self.fa
        xd = self.sd * cos(gamma) + self.sc * sin(gamma) + self.xb
        yd = self.sd * sin(gamma) - self.sc * cos(gamma) + self.yb
        length = sqrt((xd - self.xc) ** 2 + (yd - self.yc) ** 2)
        force = -self.c0 * (length - self.l0) / length
        fx, fy = force * (xd - self.xc), force * (yd - self.yc)
        return [
            self.mom - self.m2 * self.da * self.rr * v[1] * (v[1] + 2 * v[0]) * sin(self.theta),
            self.m2 * self.da * self.rr * v[0] ** 2 * sin(self.theta),
            fx * (self.sc * cos(gamma) - self.sd * sin(gamma)) + fy * (self.sd * cos(gamma) + self.sc * sin(gamma)),
            self.m4 * self.zt * ee * v[4] ** 2 * cos(self.phi),
            -self.m4 * self.zt * ee * v[3] * (v[3] + 2 * v[4]) * cos(self.phi),
            -self.m6 * self.u * zz * v[6] ** 2 * cos(self.omega),
            self.m6 * self.u * zz * v[5] * (v[5] + 2 * v[6]) * cos(self.omega),
        ]

    def _gaps(self) -> list[Expr]:
        """g(q): closure of the three loops."""
        x = self.rr * cos(self.beta) - self.d * cos(self.beta + self.theta)
        y = self.rr * sin(self.beta) - self.d * sin(self.beta + self.theta)
        outer, inner = self.phi + self.delta, self.omega + self.eps
        return [
            x - self.ss * sin(self.gamma) - self.xb,
            y + self.ss * cos(self.gamma) - self.yb,
            x - self.e * sin(outer) - self.zt * cos(self.delta) - self.xa,
            y + self.e * cos(outer) - self.zt * sin(self.delta) - self.ya,
            x - self.zf * cos(inner) - self.u * sin(self.eps) - self.xa,
            y - self.zf * sin(inner) + self.u * cos(self.eps) - self.ya,
        ]

    def _slopes(self) -> dict[tuple[int, int], Expr]:
        """Entries of G = dg/dq that are not 0."""
        both = self.beta + self.theta
        outer, inner = self.phi + self.delta, self.omega + self.eps
        x = (-self.rr * sin(self.beta) + self.d * sin(both), self.d * sin(both))
        y = (self.rr * cos(self.beta) - self.d * cos(both), -self.d * cos(both))
        G = {(row, k): (x, y)[row % 2][k] for row in range(6) for k in range(2)}
        return G | {
            (0, 2): -self.ss * cos(self.gamma),
            (1, 2): -self.ss * sin(self.gamma),
            (2, 3): -self.e * cos(outer),
            (2, 4): -self.e * cos(outer) + self.zt * sin(self.delta),
            (3, 3): -self.e * sin(outer),
            (3, 4): -self.e * sin(outer) - self.zt * cos(self.delta),
            (4, 5): self.zf * sin(inner),
            (4, 6): self.zf * sin(inner) - self.u * cos(self.eps),
            (5, 5): -self.zf * cos(inner),
            (5, 6): -self.zf * cos(inner) - self.u * sin(self.eps),
        }
