"""Random cascades of what a fixed step may not resolve: kinks, contacts, fast and stiff parts, events, algebraic loops.

Each part reads signals of parts before it, decays or keeps its energy, and has states of like magnitude (a speed is
divided by its frequency), so it hardly enlarges earlier errors: those of a run are the sum of those of its steps.
"""

from __future__ import annotations

import random
from typing import Any

import acausal


class Cascade:
    """Text of a random model, part by part."""

    def __init__(self, seed: int) -> None:
        self.draw = random.Random(seed)
        self.variables: list[str] = []
        self.equations: list[str] = []
        self.signals = [f"sin({self.draw.uniform(1, 12):.4f} * time)"]
        parts = (oscillator, lag, kink, contact, switch, jump, sampled, algebraic, friction, root)
        for k in range(self.draw.randint(2, 5)):
            self.draw.choice(parts)(self, f"x{k}", f"y{k}")

    def signal(self) -> str:
        """The last signal, or one before it."""
        return self.draw.choice(self.signals) if self.draw.random() < 0.4 else self.signals[-1]

    def level(self) -> str:
        """A number that many signals pass."""
        return f"{self.draw.uniform(-0.5, 0.5):.3f}"

    def state(self, name: str, start: float = 0.0, *, is_signal: bool = True) -> None:
        """Declare a state."""
        self.variables.append(f"    {name}: Real = variable(default=fixed({start:.3f}))")
        if is_signal:
            self.signals.append(f"self.{name}")

    def text(self) -> str:
        """The class `Model`."""
        stated = "\n".join(f"        yield {e}" for e in self.equations)
        declared = "\n".join(self.variables)
        return f"class Model(Component):\n{declared}\n\n    def equations(self) -> Equations:\n{stated}\n"


def oscillator(c: Cascade, x: str, y: str) -> None:
    w, d = 10 ** c.draw.uniform(0, 2.7), c.draw.choice([0.0, 0.01, 0.1, 0.7, 2.0])
    force = c.signal()
    c.state(y, is_signal=False)
    c.state(x, c.draw.uniform(-1, 1))
    c.equations.append(f"der(self.{x}) == {w:.4f} * self.{y}")
    c.equations.append(f"der(self.{y}) == -{w:.4f} * (self.{x} + {2 * d} * self.{y}) + {min(w, 20):.4f} * ({force})")


def lag(c: Cascade, x: str, y: str) -> None:
    source = c.signal()
    c.state(x, c.draw.uniform(-1, 1))
    c.equations.append(f"der(self.{x}) == {10 ** c.draw.uniform(0, 4):.4f} * ({source} - self.{x})")


def kink(c: Cascade, x: str, y: str) -> None:
    source = c.signal()
    bent = c.draw.choice([f"abs({source})", f"minimum({source}, {c.level()})", f"maximum({source}, {c.level()})"])
    c.state(x)
    c.equations.append(f"der(self.{x}) == {bent} - 0.5 * self.{x}")


def contact(c: Cascade, x: str, y: str) -> None:
    """A mass that falls onto a spring, as an event or as a kink."""
    w, d = 10 ** c.draw.uniform(1, 3), c.draw.choice([0.0, 0.1, 0.5])
    is_event = c.draw.random() < 0.5
    c.state(x, c.draw.uniform(0.01, 0.3))
    c.state(y, c.draw.uniform(-1, 0), is_signal=False)
    law = f"-{w * w:.4f} * self.{x} - {2 * d * w:.4f} * self.{y}"
    pushed = f"where(self.{x} < 0.0, {law}, 0.0)" if is_event else f"maximum(-{w * w:.4f} * self.{x}, 0.0)"
    c.equations.append(f"der(self.{x}) == self.{y}")
    c.equations.append(f"der(self.{y}) == {pushed} - 9.81")


def switch(c: Cascade, x: str, y: str) -> None:
    source = c.signal()
    c.state(x)
    c.equations.append(f"der(self.{x}) == where({source} > {c.level()}, 1.0, -0.5)")


def jump(c: Cascade, x: str, y: str) -> None:
    source = c.signal()
    c.state(x, 1.0)
    c.equations.append(f"der(self.{x}) == -0.3 * self.{x} + 0.2 * ({source})")
    c.equations.append(f"when({source} > {c.level()}, reset(self.{x}, -0.6 * pre(self.{x})))")


def sampled(c: Cascade, x: str, y: str) -> None:
    c.equations.append(f"when(sample(0.0, 0.05), reset(self.{x}, 0.5 * pre(self.{x}) + {c.signal()}))")
    c.variables.append(f"    {x}: Real = discrete()")
    c.signals.append(f"self.{x}")


def algebraic(c: Cascade, x: str, y: str) -> None:
    c.equations.append(f"self.{x} + 0.3 * self.{x} ** 3 == {c.signal()}")
    c.variables.append(f"    {x}: Real = variable()")
    c.state(y)
    c.equations.append(f"der(self.{y}) == self.{x} - self.{y}")


def friction(c: Cascade, x: str, y: str) -> None:
    force = c.signal()
    c.state(x)
    steep = 10 ** c.draw.uniform(0, 3)
    c.equations.append(f"der(self.{x}) == 8.0 * ({force}) - 3.0 * tanh({steep:.3f} * self.{x})")


def root(c: Cascade, x: str, y: str) -> None:
    source = c.signal()
    c.state(x)
    c.equations.append(f"der(self.{x}) == sqrt(abs({source})) - self.{x}")


def built(seed: int) -> Any:
    """The component of a seed."""
    space: dict[str, Any] = {"__name__": "random_model"} | {n: getattr(acausal, n) for n in dir(acausal)}
    exec(compile(Cascade(seed).text(), "<random model>", "exec"), space)
    return space["Model"]()
