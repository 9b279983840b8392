"""Friction force of a contact as a function of its normal force and its sliding velocity.

A law is a small record, given to a contact as a structural value, as in `laws.py`. Velocities are vectors in the plane
of contact; the force on the sliding body points against its velocity.

`Coulomb` and `Stribeck` do not stick: a body on a slope creeps at the velocity that each law states. `LuGre` holds
under a constant load, `Hybrid` under any load below its limit; its breakaways and stops are located as events.
"""

from __future__ import annotations

from dataclasses import dataclass

from acausal import Expr, as_expr, dot, exp, quantity, sqrt, tanh
from acausal.library.contact.scene.numbers import Number, check, with_units


@dataclass(frozen=True, eq=False)
class FrictionLaw:
    """Friction as a function of the sliding velocity, or of the deflection of a bristle that it bends."""

    has_bristle = False

    def drag(self, speed: Expr) -> Expr:
        """Friction force divided by normal force and velocity [s/m]: the force on the body is -drag F_N v."""
        raise NotImplementedError


@dataclass(frozen=True, eq=False, kw_only=True)
class Coulomb(FrictionLaw):
    """mu F_N tanh(v / v_s): Coulomb friction, regularised around standstill.

    Creep: under a load of the fraction q < 1 of the available friction, a body moves at v_s atanh(q).

    Parameters
    ----------
    mu
        Coefficient of friction [1].
    v_s
        Velocity at which the friction reaches tanh(1) = 76 % of mu F_N [m/s].
    """

    mu: Number
    v_s: Number = 1e-3

    def __post_init__(self) -> None:
        check(self, positive="v_s", least="mu")
        with_units(self, v_s="m/s")

    def drag(self, speed: Expr) -> Expr:
        return self.mu * _saturation(speed, as_expr(self.v_s))


@dataclass(frozen=True, eq=False, kw_only=True)
class Stribeck(FrictionLaw):
    """Friction that falls from `mu_s` near standstill to `mu` when sliding, and grows with `mu_v` v.

    (mu + (mu_s - mu) exp(-(v / v_st)**2)) tanh(v / v_s) + mu_v v. Source: B. Armstrong-Helouvry, P. Dupont, C. Canudas
    de Wit, A survey of models, analysis tools and compensation methods for the control of machines with friction,
    Automatica 30 (1994) 1083-1138, section 2.1.

    Parameters
    ----------
    mu, mu_s
        Coefficients of sliding friction and of breakaway [1].
    v_st
        Stribeck velocity [m/s]; well above `v_s`.
    mu_v
        Viscous friction per normal force [s/m].
    v_s
        Velocity of regularisation [m/s].
    """

    mu: Number
    mu_s: Number
    v_st: Number = 1e-2
    mu_v: Number = 0.0
    v_s: Number = 1e-3

    def __post_init__(self) -> None:
        check(self, positive="v_st v_s", least="mu mu_s mu_v")
        with_units(self, v_st="m/s", mu_v="s/m", v_s="m/s")

    def drag(self, speed: Expr) -> Expr:
        share = speed / as_expr(self.v_st)
        mu = self.mu + (as_expr(self.mu_s) - self.mu) * exp(-share * share)
        return mu * _saturation(speed, as_expr(self.v_s)) + self.mu_v


@dataclass(frozen=True, eq=False, kw_only=True)
class LuGre(FrictionLaw):
    """Friction of elastic bristles, whose deflection is a state: it sticks, breaks away and slides (Stribeck effect).

    der(z) = v - s_0 |v| / g(v) z and force = F_N (s_0 z + s_1 exp(-(v / v_st)**2) der(z) + s_2 v) with
    g(v) = mu + (mu_s - mu) exp(-(v / v_st)**2). The force is per normal force, so that one set of numbers serves any
    load. The damping fades out when sliding; otherwise it would stop a body that lands with a tangential velocity at
    once (H. Olsson, Control systems with friction, Lund 1996, section 3.4). Without contact the bristles relax with
    the time constant `relaxation`.

    Creep: none under a constant load below mu F_N; it holds at z = q / s_0. What a point slips beyond the mean, as in a
    rotation about the normal, bends no bristle: it meets g(v) F_N against its velocity, smoothed below `v_st`.

    Source: C. Canudas de Wit, H. Olsson, K. J. Astrom, P. Lischinsky, A new model for control of systems with friction,
    IEEE Trans. Automatic Control 40 (1995) 419-425; per normal force as in C. Canudas de Wit, P. Tsiotras, Dynamic tire
    friction models for vehicle traction control, 38th IEEE CDC (1999).

    Parameters
    ----------
    mu, mu_s
        Coefficients of sliding friction and of breakaway [1].
    v_st
        Stribeck velocity [m/s].
    s_0, s_1, s_2
        Stiffness [1/m], damping [s/m] and viscosity [s/m] of the bristles, per normal force.
    relaxation
        Time constant with which a free bristle relaxes [s].
    """

    mu: Number
    mu_s: Number
    v_st: Number = 1e-2
    s_0: Number = 1e5
    s_1: Number = 1e2
    s_2: Number = 0.0
    relaxation: Number = 1e-2
    has_bristle = True

    def __post_init__(self) -> None:
        check(self, positive="mu mu_s v_st s_0 relaxation", least="s_1 s_2")
        with_units(self, v_st="m/s", s_0="1/m", s_1="s/m", s_2="s/m", relaxation="s")

    def drag(self, speed: Expr) -> Expr:
        return as_expr(self.s_2)

    def bristle_rate(self, z: Expr, v: Expr) -> Expr:
        """Rate of the deflection `z` [m, vector] at the sliding velocity `v` [m/s, vector], under load."""
        return v - z * (self.s_0 * smooth_speed(v, quantity(1e-12, "m/s")) / self.sliding(v))

    @property
    def turning_speed(self) -> Expr:
        """Velocity relative to the mean below which the friction of turning is smoothed [m/s]."""
        return as_expr(self.v_st)

    def sliding(self, v: Expr) -> Expr:
        """Coefficient of friction when sliding at the velocity `v` [m/s, vector]: g(v)."""
        return self.mu + (as_expr(self.mu_s) - self.mu) * self._slow(v)

    def held(self, z: Expr, z_rate: Expr, v: Expr) -> Expr:
        """Force of the bristles per normal force [1, vector], against the sliding."""
        return z * self.s_0 + z_rate * (self.s_1 * self._slow(v))

    def _slow(self, v: Expr) -> Expr:
        """1 near standstill, 0 when sliding."""
        share = v / as_expr(self.v_st)
        return exp(-dot(share, share))


@dataclass(frozen=True, eq=False, kw_only=True)
class Hybrid(FrictionLaw):
    """Coulomb friction with stiction, in three modes: stuck, sliding slowly, and sliding.

    When stuck, the surfaces are held by a spring and a damper between them, force = F_N (s_0 z + s_1 v) with
    der(z) = v; they break away at the instant at which this force reaches mu_s F_N. When sliding, the friction is
    mu F_N against the velocity. When sliding slowly, below `v_s`, its direction is kept, because a vanishing velocity
    has none. A body comes to rest at the located instant at which its velocity along this direction crosses zero.

    Creep: none. Applying a load of the fraction q of F_N displaces a stuck body once, by q / s_0; a load that is
    applied suddenly may overshoot the limit. Each contact has one spring: what a point slips beyond the mean, as in a
    rotation about the normal, meets mu F_N against its velocity, smoothed below `v_s`, and is not held.

    Source: the modes are those of M. Otter, H. Elmqvist, S. E. Mattsson, Hybrid modeling in Modelica based on the
    synchronous data flow principle, CACSD'99; the spring of a stuck contact as in P. A. Cundall, O. D. L. Strack, A
    discrete numerical model for granular assemblies, Geotechnique 29 (1979) 47-65.

    Parameters
    ----------
    mu, mu_s
        Coefficients of sliding friction and of breakaway [1]; without `mu_s` they are equal.
    s_0, s_1
        Stiffness [1/m] and damping [s/m] of stuck surfaces, per normal force.
    v_s
        Velocity below which sliding is slow [m/s].
    relaxation
        Time constant with which a free spring relaxes, and with which that of a sliding contact follows the
        velocity [s].
    """

    mu: Number
    mu_s: Number | None = None
    s_0: Number = 1e6
    s_1: Number = 2e3
    v_s: Number = 1e-4
    relaxation: Number = 1e-3
    has_bristle = True

    def __post_init__(self) -> None:
        check(self, positive="s_0 v_s relaxation", least="mu s_1" + " mu_s" * (self.mu_s is not None))
        with_units(self, s_0="1/m", s_1="s/m", v_s="m/s", relaxation="s")

    @property
    def turning_speed(self) -> Expr:
        """Velocity relative to the mean below which the friction of turning is smoothed [m/s]."""
        return as_expr(self.v_s)

    def sliding(self, v: Expr) -> Expr:
        """Coefficient of friction when sliding, at any velocity `v` [m/s, vector]."""
        return as_expr(self.mu)

    @property
    def limit(self) -> Expr:
        """Coefficient of friction at breakaway [1]."""
        return as_expr(self.mu if self.mu_s is None else self.mu_s)

    def drag(self, speed: Expr) -> Expr:
        return as_expr(0.0)


def smooth_speed(v: Expr, v_0: Number) -> Expr:
    """Magnitude of a velocity, smoothed below `v_0` so that it is differentiable at standstill."""
    small = as_expr(v_0)
    return sqrt(dot(v, v) + small * small)


def _saturation(speed: Expr, v_s: Expr) -> Expr:
    """tanh(speed / v_s) / speed; `speed` is never zero (`smooth_speed`)."""
    return tanh(speed / v_s) / speed
