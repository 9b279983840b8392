"""End errors of the default on problems that no rule of it was measured with: all below ten tolerances.

Solutions in closed form. DETEST: W. H. Enright, J. D. Pryce, ACM Transactions on Mathematical Software 13 (1987)
1-27; the orbit of R. F. Arenstorf, and the problems of Kaps and of Brasey and Hairer: E. Hairer, G. Wanner, Solving
Ordinary Differential Equations I, II.0, and II, VI.3 and VII.5.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.special import ellipj

import acausal
from acausal import Component, Equations, Real, cos, der, discrete, fixed, guess, pre, reset, sin, time, variable, when

Exact = Callable[[float], dict[str, float]]
PROBLEMS: dict[str, tuple[type[Component], float, Exact]] = {}


def ends(stop: float, exact: Exact) -> Callable[[type[Component]], type[Component]]:
    """Enter a model with where its run stops, and its solution."""

    def entered(model: type[Component]) -> type[Component]:
        PROBLEMS[model.__name__] = model, stop, exact
        return model

    return entered


def rigid_body(t: float) -> dict[str, float]:
    sn, cn, dn, _ = ellipj(t, 0.51)
    return {"y1": float(sn), "y2": float(cn), "y3": float(dn)}


@ends(20.0, rigid_body)
class DetestB5(Component):
    y1: Real = variable(default=fixed(0.0))
    y2: Real = variable(default=fixed(1.0))
    y3: Real = variable(default=fixed(1.0))

    def equations(self) -> Equations:
        yield der(self.y1) == self.y2 * self.y3
        yield der(self.y2) == -self.y1 * self.y3
        yield der(self.y3) == -0.51 * self.y1 * self.y2


def orbit(t: float) -> dict[str, float]:
    """Kepler's equation by Newton's method."""
    u = t
    for _ in range(100):
        u -= (u - 0.9 * math.sin(u) - t) / (1.0 - 0.9 * math.cos(u))
    return {"x": math.cos(u) - 0.9, "y": math.sqrt(0.19) * math.sin(u)}


@ends(20.0, orbit)
class DetestD5(Component):
    x: Real = variable(default=fixed(0.1))
    y: Real = variable(default=fixed(0.0))
    u: Real = variable(default=fixed(0.0))
    v: Real = variable(default=fixed(math.sqrt(19.0)))

    def equations(self) -> Equations:
        cube = (self.x**2 + self.y**2) ** 1.5
        yield der(self.x) == self.u
        yield der(self.y) == self.v
        yield der(self.u) == -self.x / cube
        yield der(self.v) == -self.y / cube


@ends(17.0652165601579625588917206249, lambda t: {"x": 0.994, "y": 0.0})
class Arenstorf(Component):
    """One period: the moon is passed at a distance of 0.006, where errors grow."""

    x: Real = variable(default=fixed(0.994))
    y: Real = variable(default=fixed(0.0))
    u: Real = variable(default=fixed(0.0))
    v: Real = variable(default=fixed(-2.00158510637908252240537862224))

    def equations(self) -> Equations:
        moon = 0.012277471
        earth = 1.0 - moon
        a = ((self.x + moon) ** 2 + self.y**2) ** 1.5
        b = ((self.x - earth) ** 2 + self.y**2) ** 1.5
        yield der(self.x) == self.u
        yield der(self.y) == self.v
        yield der(self.u) == self.x + 2 * self.v - earth * (self.x + moon) / a - moon * (self.x - earth) / b
        yield der(self.v) == self.y - 2 * self.u - earth * self.y / a - moon * self.y / b


@ends(10.0, lambda t: {"y1": math.exp(-2.0 * t), "y2": math.exp(-t)})
class Kaps(Component):
    y1: Real = variable(default=fixed(1.0))
    y2: Real = variable(default=fixed(1.0))

    def equations(self) -> Equations:
        yield der(self.y1) == -(1e6 + 2.0) * self.y1 + 1e6 * self.y2**2
        yield der(self.y2) == self.y1 - self.y2 - self.y2**2


@ends(1.5, lambda t: {"y1": math.exp(t), "y2": math.exp(-2.0 * t), "z": math.exp(2.0 * t)})
class BraseyHairer(Component):
    """Index 2, and z stands in it as a square and a product."""

    y1: Real = variable(default=fixed(1.0))
    y2: Real = variable(default=guess(1.0))
    z: Real = variable(default=guess(1.0))

    def equations(self) -> Equations:
        yield der(self.y1) == self.y1 * self.y2**2 * self.z**2
        yield der(self.y2) == self.y1**2 * self.y2**2 - 3.0 * self.y2**2 * self.z
        yield self.y1**2 * self.y2 == 1.0


@ends(10.0, lambda t: {"y": math.sin(t), "z": math.cos(t)})
class Implicit(Component):
    """Index 1: a cubic equation for the rate."""

    y: Real = variable(default=fixed(0.0))
    z: Real = variable(default=guess(1.0))

    def equations(self) -> Equations:
        yield der(self.y) == self.z
        yield self.z**3 + self.z + 0.1 * self.y == cos(time) ** 3 + cos(time) + 0.1 * sin(time)


@ends(5.0, lambda t: {"x": math.cos(t * t / 2.0), "y": math.sin(t * t / 2.0)})
class Spun(Component):
    """Index 3: a mass on a circle with one force along it, that turns it ever faster: the angle is t^2/2."""

    x: Real = variable(default=fixed(1.0))
    y: Real = variable(default=guess(0.0))
    u: Real = variable()
    v: Real = variable()
    pull: Real = variable()

    def equations(self) -> Equations:
        yield der(self.x) == self.u
        yield der(self.y) == self.v
        yield der(self.u) == -self.y - self.pull * self.x
        yield der(self.v) == self.x - self.pull * self.y
        yield self.x**2 + self.y**2 == 1.0

    def initial_equations(self) -> Equations:
        yield self.v == 0.0


@ends(50.0, lambda t: {"x": 2.0 * float(ellipj(math.sqrt(5.0) * t, 0.4)[1])})
class Duffing(Component):
    """x'' = -x - x^3 from x = 2: 2 cn(sqrt(5) t | 4/10)."""

    x: Real = variable(default=fixed(2.0))
    v: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == self.v
        yield der(self.v) == -self.x - self.x**3


def struck(t: float) -> dict[str, float]:
    """-cos t from one turning point to the wall at 2 pi/3, and back."""
    phase = t % (4.0 * math.pi / 3.0)
    return {"x": -math.cos(min(phase, 4.0 * math.pi / 3.0 - phase))}


@ends(30.0, struck)
class Struck(Component):
    x: Real = variable(default=fixed(-1.0))
    v: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == self.v
        yield der(self.v) == -self.x
        yield when(self.x > 0.5, reset(self.v, -pre(self.v)))


def relayed(t: float) -> dict[str, float]:
    """Up to 0.8 first, then between 0.2 and 0.8, each way in log(4)."""
    phase = (t - math.log(5.0)) % (2.0 * math.log(4.0))
    return {"y": 0.8 * math.exp(-phase) if phase < math.log(4.0) else 1.0 - 3.2 * math.exp(-phase)}


@ends(40.0, relayed)
class Relay(Component):
    y: Real = variable(default=fixed(0.0))
    u: Real = discrete(default=1.0)

    def equations(self) -> Equations:
        yield der(self.y) == self.u - self.y
        yield when(self.y > 0.8, reset(self.u, 0.0))
        yield when(self.y < 0.2, reset(self.u, 1.0))


CHAIN = np.array([[-1.0, 1.0, 0.0], [0.0, -1e4, 50.0], [0.0, 0.0, -0.1]])


@ends(20.0, lambda t: {f"y[{k}]": float(v) for k, v in enumerate(expm(CHAIN * t).sum(axis=1))})
class StiffChain(Component):
    y: Real = variable(shape=3, default=fixed(1.0))

    def equations(self) -> Equations:
        yield der(self.y[0]) == self.y[1] - self.y[0]
        yield der(self.y[1]) == 50.0 * self.y[2] - 1e4 * self.y[1]
        yield der(self.y[2]) == -0.1 * self.y[2]


@pytest.mark.parametrize("name", PROBLEMS)
def test_the_default_ends_within_ten_tolerances(name: str) -> None:
    model, stop, exact = PROBLEMS[name]
    for tolerance in (1e-4, 1e-6, 1e-8, 1e-10):
        result = acausal.simulate(model(), stop_time=stop, tolerance=tolerance)
        off = max(abs(float(result.final(n)) - v) / (1.0 + abs(v)) for n, v in exact(stop).items())
        assert off < 10.0 * tolerance
