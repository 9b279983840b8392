"""Models whose consistent points are known, with starts for any of their variables, declared in any order."""

from __future__ import annotations

import math
import random
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from acausal import Component, Equations, Real, connect, cos, der, part, sin, variable
from acausal.library.electrical import Capacitor, ConstantVoltage, Ground, Inductor, Resistor

Vector = NDArray[np.float64]
Element = tuple[str, float, int, int]
"""Kind, value, and the two nodes; node 0 is the ground."""

_KINDS: dict[str, tuple[type[Component], str]] = {
    "R": (Resistor, "R"),
    "C": (Capacitor, "C"),
    "L": (Inductor, "L"),
    "V": (ConstantVoltage, "V"),
}


def random_circuit(r: random.Random) -> list[Element]:
    """A tree of elements on two to four nodes, up to four more, and a source; loops of capacitors may occur."""
    count = r.randint(2, 4)
    found = [(r.choice("RRCCL"), round(r.uniform(0.5, 3.0), 2), a, r.randrange(a)) for a in range(1, count + 1)]
    for _ in range(r.randint(1, 4)):
        a, b = r.sample(range(count + 1), 2)
        found.append((r.choice("RRCCLL"), round(r.uniform(0.5, 3.0), 2), a, b))
    a, b = r.sample(range(count + 1), 2)
    return [*found, ("V", round(r.uniform(-3.0, 3.0), 2), a, b)]


def circuit(elements: Sequence[Element], order: Sequence[int], starts: Mapping[str, Any]) -> Component:
    """A model of the elements e0, e1, ... made in this order, with starts such as `e1.v`."""
    names = [f"e{k}" for k in order]

    def build(self: Any) -> None:
        self.ground = Ground()
        for k in order:
            kind, value, _, _ = elements[k]
            cls, parameter = _KINDS[kind]
            own = {path.split(".")[1]: s for path, s in starts.items() if path.split(".")[0] == f"e{k}"}
            setattr(self, f"e{k}", cls(**{parameter: value, **own}))

    def equations(self: Any) -> Equations:
        nodes: dict[int, list[Any]] = {0: [self.ground.p]}
        for k in order:
            for node, pin in zip(elements[k][2:], "pn", strict=True):
                nodes.setdefault(node, []).append(getattr(getattr(self, f"e{k}"), pin))
        for pins in nodes.values():
            if len(pins) > 1:
                yield connect(*pins)

    types = {name: _KINDS[elements[k][0]][0] for name, k in zip(names, order, strict=True)}
    own = {"__annotations__": {"ground": Ground, **types}, "build": build, "equations": equations}
    made: type[Component] = type("Circuit", (Component,), {**own, "ground": part(), **{name: part() for name in names}})
    return made()


LENGTHS = 1.0, 0.7
SIGNALS = ("phi1", "phi2", "x1", "y1", "x2", "y2", "w1", "w2", "vx1", "vy1", "vx2", "vy2", "E", "r")


def pendulum_point(phi1: float, phi2: float, w1: float, w2: float) -> dict[str, float]:
    """All variables of a double pendulum of 1 and 2 kg from its angles and rates."""
    a, b = LENGTHS
    x1, y1 = a * math.sin(phi1), -a * math.cos(phi1)
    x2, y2 = x1 + b * math.sin(phi2), y1 - b * math.cos(phi2)
    vx1, vy1 = a * math.cos(phi1) * w1, a * math.sin(phi1) * w1
    vx2, vy2 = vx1 + b * math.cos(phi2) * w2, vy1 + b * math.sin(phi2) * w2
    energy = 0.5 * (vx1**2 + vy1**2) + vx2**2 + vy2**2 + 9.81 * (y1 + 2.0 * y2)
    values = phi1, phi2, x1, y1, x2, y2, w1, w2, vx1, vy1, vx2, vy2, energy, x2**2 + y2**2
    return dict(zip(SIGNALS, values, strict=True))


def pendulum(order: Sequence[str], starts: Mapping[str, Any]) -> Component:
    """The double pendulum with its variables declared in this order."""

    def equations(self: Any) -> Equations:
        a, b = LENGTHS
        s = self
        yield s.w1 == der(s.phi1)
        yield s.w2 == der(s.phi2)
        yield s.x1 == a * sin(s.phi1)
        yield s.y1 == -a * cos(s.phi1)
        yield s.x2 == s.x1 + b * sin(s.phi2)
        yield s.y2 == s.y1 - b * cos(s.phi2)
        for way in ("x1", "y1", "x2", "y2"):
            yield getattr(s, f"v{way}") == der(getattr(s, way))
        yield der(s.vx1) == -s.f1 * sin(s.phi1) + s.f2 * sin(s.phi2)
        yield der(s.vy1) == s.f1 * cos(s.phi1) - s.f2 * cos(s.phi2) - 9.81
        yield 2.0 * der(s.vx2) == -s.f2 * sin(s.phi2)
        yield 2.0 * der(s.vy2) == s.f2 * cos(s.phi2) - 2.0 * 9.81
        yield s.E == 0.5 * (s.vx1**2 + s.vy1**2) + s.vx2**2 + s.vy2**2 + 9.81 * (s.y1 + 2.0 * s.y2)
        yield s.r == s.x2**2 + s.y2**2

    own: dict[str, Any] = {"__annotations__": dict.fromkeys(order, Real), "equations": equations}
    declared = {n: variable(default=starts[n]) if n in starts else variable() for n in order}
    return type("Pendulum", (Component,), {**own, **declared})()  # type: ignore[no-any-return]
