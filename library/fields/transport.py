"""Transport of a substance along a channel: diffusion, advection and reaction."""

from __future__ import annotations

from acausal import Component, Equations, Expr, Real, assert_, concatenate, der, parameter, structural, variable, where
from acausal.errors import DeclarationError
from acausal.library.fields.interfaces import ConcentrationPort

SCHEMES = ("upwind", "van_leer")


class PartialChannel(Component):
    """Channel with a production rate `r`, defined by subclasses: dc/dt = -d(v*c - D*dc/dx)/dx + r.

    Diffusion is of second order in the width of a cell. The concentration advected through a face is that of the
    upstream cell ("upwind": first order, it adds v*dx/2 to D), or is extrapolated to the face with van Leer's slope,
    the harmonic mean of the slopes on both sides, or zero where they differ in sign ("van_leer": second order where the
    profile is smooth, without new extrema). The velocity may have either sign.

    An open port is a closed wall. At a free end (`free_a`, `free_b`) the profile leaves without a gradient, and the
    port only shows the concentration there; inflow at a free end has the concentration of the last cell. Without
    diffusion, an end without inflow must be free or connected: otherwise the concentration there is undetermined
    (AC203). A run ends with AC503 if a component connected to a free end exchanges substance with it.
    Sources: S. V. Patankar (1980), chapter 5; B. van Leer, J. Comput. Phys. 14 (1974) 361.

    Raises
    ------
    DeclarationError
        AC195 for another scheme.
    """

    n: int = structural(default=50, doc="Number of cells")
    scheme: str = structural(default="upwind", doc="upwind or van_leer")
    free_a: bool = structural(default=False, doc="Whether the profile leaves at port_a without a gradient")
    free_b: bool = structural(default=False, doc="Whether the profile leaves at port_b without a gradient")
    length: Real = parameter(unit="m", default=1.0, min=0.0, doc="Length")
    A: Real = parameter(unit="m2", default=1e-4, min=0.0, doc="Cross section")
    D: Real = parameter(unit="m2/s", default=0.0, min=0.0, doc="Diffusion coefficient")
    v: Real = parameter(unit="m/s", default=0.0, doc="Velocity, positive from port_a to port_b")
    c_start: Real = parameter(
        shape=lambda self: self.n, unit="mol/m3", default=0.0, doc="Concentrations of the cells at the start"
    )
    c: Real = variable(
        shape=lambda self: self.n, unit="mol/m3", prefer_state=True, doc="Mean concentrations of the cells"
    )
    r: Real = variable(shape=lambda self: self.n, unit="mol/(m3.s)", doc="Rates of production in the cells")

    port_a: ConcentrationPort = ConcentrationPort()
    port_b: ConcentrationPort = ConcentrationPort()

    def build(self) -> None:
        if self.scheme not in SCHEMES:
            raise DeclarationError(
                "AC195", f"there is no scheme '{self.scheme}'", help=f"schemes: {', '.join(SCHEMES)}"
            )

    def initial_equations(self) -> Equations:
        yield self.c == self.c_start

    def equations(self) -> Equations:
        dx, c = self.length / self.n, self.c
        # Fluxes through half a cell, into the channel at each end.
        at_a = self.v * where(self.v > 0.0, self.port_a.c, c[0]) + 2.0 * self.D * (self.port_a.c - c[0]) / dx
        at_b = -self.v * where(self.v > 0.0, c[-1], self.port_b.c) + 2.0 * self.D * (self.port_b.c - c[-1]) / dx
        if self.free_a:
            at_a = self.v * c[0]
            yield from _free_end(self.port_a, c[0])
        else:
            yield self.port_a.n_flow == self.A * at_a
        if self.free_b:
            at_b = -self.v * c[-1]
            yield from _free_end(self.port_b, c[-1])
        else:
            yield self.port_b.n_flow == self.A * at_b
        flux = concatenate(at_a, *((self._inner(dx),) if self.n > 1 else ()), -at_b)
        yield der(c) == (flux[:-1] - flux[1:]) / dx + self.r

    def _inner(self, dx: Expr) -> Expr:
        """Molar fluxes through the n - 1 faces between cells."""
        left, right = self.c[:-1], self.c[1:]
        rise = right - left
        if self.scheme == "van_leer" and self.n > 2:
            # For the cells between two others; those at the ends have zero slope.
            half = _slope(rise[:-1], rise[1:]) / 2.0
            left = concatenate(left[0], left[1:] + half)
            right = concatenate(right[:-1] - half, right[-1])
        return self.v * where(self.v > 0.0, left, right) - self.D * rise / dx


def _free_end(port: ConcentrationPort, c: Expr) -> Equations:
    """The port shows the concentration c [mol/m3] of the last cell; a flow through it would violate the balance."""
    yield port.c == c
    flows = port.n_flow * port.n_flow > 0.0
    yield assert_(~flows, "substance flows through the port of a free end: leave it open, or let the end not be free")


def _slope(a: Expr, b: Expr) -> Expr:
    """Harmonic means of two differences of equal sign, else zero: a kink, which the error control handles."""
    alike = a * b > 0.0
    return where(alike, 2.0 * a * b / where(alike, a + b, 1.0, smooth=True), 0.0, smooth=True)


class Channel(PartialChannel):
    """Channel without reaction."""

    def equations(self) -> Equations:
        yield self.r == 0.0


class LogisticChannel(PartialChannel):
    """Channel in which a substance grows logistically (Fisher): r = k*c*(1 - c/c_max).

    A front into c = 0 approaches the speed 2*sqrt(k*D). Source: R. A. Fisher, Annals of Eugenics 7 (1937) 355.
    """

    k: Real = parameter(unit="1/s", default=1.0, min=0.0, doc="Rate of growth")
    c_max: Real = parameter(unit="mol/m3", default=1.0, min=0.0, doc="Concentration at which growth stops")

    def equations(self) -> Equations:
        yield self.r == self.k * self.c * (1.0 - self.c / self.c_max)
