"""Normal force of a compliant contact as a function of its depth and the rate of the depth. Contacts never pull.

A law is a small record, given to a contact as a structural value. Its numbers may be parameters of the component that
makes it (`KelvinVoigt(k=self.k, d=self.d)`): these stay symbolic, so that changing them does not recompile the model.

Depth [m] is positive where the bodies overlap; the rate [m/s] is positive while they approach.
"""

from __future__ import annotations

from dataclasses import dataclass

from acausal import Expr, as_expr, maximum, where
from acausal.library.contact.scene.numbers import Number, check, with_units


@dataclass(frozen=True, eq=False)
class NormalLaw:
    """Base of the normal laws: the force, and the part of its work that is stored."""

    def force(self, depth: Expr, rate: Expr) -> Expr:
        """Normal force [N], zero without overlap, never negative."""
        raise NotImplementedError

    def elastic(self, depth: Expr) -> Expr:
        """The elastic part of the force [N], for a depth of either sign."""
        raise NotImplementedError

    def damping(self, depth: Expr, rate: Expr) -> Expr:
        """The part of the force that depends on the rate [N]."""
        raise NotImplementedError

    def energy(self, depth: Expr) -> Expr:
        """Stored energy [J]: the integral of `elastic` from zero to the depth."""
        raise NotImplementedError


@dataclass(frozen=True, eq=False)
class KelvinVoigt(NormalLaw):
    """Spring and damper side by side, without adhesion: max(0, k depth + d rate) while the bodies overlap.

    The damper makes the force jump at first touch; where the force would become negative, it is zero although the
    bodies still overlap.

    Parameters
    ----------
    k
        Stiffness [N/m].
    d
        Damping [N.s/m].
    """

    k: Number
    d: Number = 0.0

    def __post_init__(self) -> None:
        check(self, positive="k", least="d")
        with_units(self, k="N/m", d="N.s/m")

    def force(self, depth: Expr, rate: Expr) -> Expr:
        pressed = self.elastic(depth) + self.damping(depth, rate)
        # Relations rather than `maximum`, so that the jump at touch and the release are located as events.
        return where((depth > 0) & (pressed > 0), pressed, 0.0)

    def elastic(self, depth: Expr) -> Expr:
        return self.k * maximum(depth, 0.0)

    def damping(self, depth: Expr, rate: Expr) -> Expr:
        return self.d * rate

    def energy(self, depth: Expr) -> Expr:
        pressed = maximum(depth, 0.0)
        return self.k / 2 * pressed * pressed


@dataclass(frozen=True, eq=False, kw_only=True)
class PartialPowerLaw(NormalLaw):
    """k depth_1 (depth / depth_1)**n max(0, 1 + a rate): no jump at touch, no adhesion.

    Subclasses define the damping `a`. For a ball of radius r on a plane, Hertz gives n = 1.5 and k = 4/3 E* sqrt(r)
    with `depth_1` = 1 m.

    Parameters
    ----------
    k
        Force at `depth_1` divided by `depth_1` [N/m]. With `depth_1` = 1 m, its value is that usually given in N/m**n.
    n
        Exponent, not below 1 [1].
    depth_1
        Depth that `k` refers to [m].

    Source: K. H. Hunt, F. R. E. Crossley, Coefficient of restitution interpreted as damping in vibroimpact, J. Applied
    Mechanics 42 (1975) 440-445, equation 8.
    """

    k: Number
    n: float = 1.5
    depth_1: Number = 1.0

    def __post_init__(self) -> None:
        check(self, positive="k n depth_1")
        with_units(self, k="N/m", depth_1="m")

    @property
    def rate_factor(self) -> Expr:
        """The damping `a`: damping force divided by rate and elastic force [s/m]."""
        raise NotImplementedError

    def force(self, depth: Expr, rate: Expr) -> Expr:
        # The force is continuous and needs no event; many bodies at rest on each other would cause many.
        return maximum(self.elastic(depth) + self.damping(depth, rate), 0.0)

    def elastic(self, depth: Expr) -> Expr:
        share = maximum(depth, 0.0) / self.depth_1
        return self.k * self.depth_1 * (share if self.n == 1.0 else share**self.n)

    def damping(self, depth: Expr, rate: Expr) -> Expr:
        return self.elastic(depth) * (self.rate_factor * rate)

    def energy(self, depth: Expr) -> Expr:
        return self.elastic(depth) * maximum(depth, 0.0) / (self.n + 1.0)


@dataclass(frozen=True, eq=False, kw_only=True)
class DampedPowerLaw(PartialPowerLaw):
    """Power law whose damping `a` [s/m] is given directly."""

    a: Number = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        check(self, least="a")
        with_units(self, a="s/m")

    @property
    def rate_factor(self) -> Expr:
        return as_expr(self.a)


@dataclass(frozen=True, eq=False, kw_only=True)
class PartialImpactLaw(PartialPowerLaw):
    """Power law whose damping follows from a restitution `e` [1] at an impact speed `v_0` [m/s]."""

    e: Number
    v_0: Number

    def __post_init__(self) -> None:
        super().__post_init__()
        check(self, positive="v_0", share="e")
        with_units(self, v_0="m/s")


@dataclass(frozen=True, eq=False, kw_only=True)
class HuntCrossley(PartialImpactLaw):
    """Power law with a = 1.5 (1 - e) / v_0, for e near 1."""

    @property
    def rate_factor(self) -> Expr:
        return 1.5 * (1 - as_expr(self.e)) / as_expr(self.v_0)


@dataclass(frozen=True, eq=False, kw_only=True)
class LankaraniNikravesh(PartialImpactLaw):
    """Power law with a = 0.75 (1 - e**2) / v_0, for e near 1.

    Source: H. M. Lankarani, P. E. Nikravesh, A contact force model with hysteresis damping for impact analysis of
    multibody systems, J. Mechanical Design 112 (1990) 369-376.
    """

    @property
    def rate_factor(self) -> Expr:
        e = as_expr(self.e)
        return 0.75 * (1 - e * e) / as_expr(self.v_0)


@dataclass(frozen=True, eq=False, kw_only=True)
class Flores(PartialImpactLaw):
    """Power law with a = 8 (1 - e) / (5 e v_0), for soft impacts too.

    Source: P. Flores, M. Machado, M. T. Silva, J. M. Martins, On the continuous contact force models for soft
    materials in multibody dynamics, Multibody System Dynamics 25 (2011) 357-375.
    """

    @property
    def rate_factor(self) -> Expr:
        e = as_expr(self.e)
        return 8 * (1 - e) / (5 * e * as_expr(self.v_0))
