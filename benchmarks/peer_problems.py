"""Four problems written out for peers: right-hand sides for NumPy or JAX, CasADi expressions, Modelica text."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import acausal
from acausal.models.ivp.pleiades import Pleiades
from acausal.models.ivp.robertson import Robertson
from acausal.models.ivp.vanderpol import VanDerPol
from acausal.models.rc_ladder import RCLadder

SECTIONS = 100


@dataclass(frozen=True)
class Problem:
    """`rates(y, xp)` is the right-hand side with the array module `xp` (numpy, jax.numpy or casadi's stand-in below).

    `states` are the paths of acausal in the order of y; `smallest` are the absolute tolerances per relative one.
    """

    name: str
    model: acausal.Component
    states: tuple[str, ...]
    start: tuple[float, ...]
    stop: float
    smallest: tuple[float, ...]
    rates: Callable[[Any, Any], Any]
    modelica: str
    stiff: bool


def vanderpol(y: Any, xp: Any) -> Any:
    """mu = 1000."""
    return xp.stack([y[1], 1000.0 * (1 - y[0] ** 2) * y[1] - y[0]])


def robertson(y: Any, xp: Any) -> Any:
    """Three reactions."""
    slow, fast, fastest = 0.04 * y[0], 1e4 * y[1] * y[2], 3e7 * y[1] ** 2
    return xp.stack([fast - slow, slow - fast - fastest, fastest])


def ladder(y: Any, xp: Any) -> Any:
    """1 V at the near end, R = C = 1."""
    before = xp.concatenate([xp.ones(1), y[:-1]])
    after = xp.concatenate([y[1:], y[-1:]])
    return before - 2 * y + after


def pleiades(y: Any, xp: Any) -> Any:
    """Seven bodies in the plane with masses 1 ... 7; y holds positions x, y and velocities u, v."""
    masses = xp.arange(1.0, 8.0)
    x, z = y[:7], y[7:14]
    dx, dz = x[None, :] - x[:, None], z[None, :] - z[:, None]
    cubed = (dx**2 + dz**2) ** 1.5
    pull = masses[None, :] / xp.where(cubed == 0, xp.ones_like(cubed), cubed)
    return xp.concatenate([y[14:], (pull * dx).sum(axis=1), (pull * dz).sum(axis=1)])


def _modelica(name: str, declarations: str, equations: str) -> str:
    return f"model {name}\n{declarations}\nequation\n{equations}\nend {name};\n"


def problems() -> tuple[Problem, ...]:
    """All of them."""
    n = SECTIONS
    bodies = range(7)
    x0, y0 = (3.0, 3.0, -1.0, -3.0, 2.0, -2.0, 2.0), (3.0, -3.0, 2.0, 0.0, 0.0, -4.0, 4.0)
    u0, v0 = (0.0, 0.0, 0.0, 0.0, 0.0, 1.75, -1.5), (0.0, 0.0, 0.0, -1.25, 1.0, 0.0, 0.0)
    text = "\n".join(
        f"  Real {letter}{k + 1}(start={values[k]}, fixed=true);"
        for letter, values in (("x", x0), ("y", y0), ("u", u0), ("v", v0))
        for k in bodies
    )
    motion = []
    for i in range(1, 8):
        others = [j for j in range(1, 8) if j != i]
        for a, b in (("x", "u"), ("y", "v")):
            terms = " + ".join(f"{j}*({a}{j} - {a}{i})/((x{i} - x{j})^2 + (y{i} - y{j})^2)^1.5" for j in others)
            motion += [f"  der({a}{i}) = {b}{i};", f"  der({b}{i}) = {terms};"]
    return (
        Problem(
            "VanDerPol",
            VanDerPol(),
            ("y1", "y2"),
            (2.0, 0.0),
            2000.0,
            (1e-3, 1e-6),
            vanderpol,
            _modelica(
                "VanDerPol",
                "  Real y1(start=2, fixed=true);\n  Real y2(start=0, fixed=true);",
                "  der(y1) = y2;\n  der(y2) = 1000*(1 - y1^2)*y2 - y1;",
            ),
            True,
        ),
        Problem(
            "Robertson, 1e4 s",
            Robertson(),
            ("y1", "y2", "y3"),
            (1.0, 0.0, 0.0),
            1e4,
            (1e-3, 1e-8, 1e-3),
            robertson,
            _modelica(
                "Robertson",
                "  Real y1(start=1, fixed=true);\n  Real y2(start=0, fixed=true);\n  Real y3(start=0, fixed=true);",
                "  der(y1) = -0.04*y1 + 1e4*y2*y3;\n  der(y2) = 0.04*y1 - 1e4*y2*y3 - 3e7*y2^2;\n  der(y3) = 3e7*y2^2;",
            ),
            True,
        ),
        Problem(
            f"RC ladder, {n} sections",
            RCLadder(n=n),
            tuple(f"capacitors[{k}].v" for k in range(n)),
            (0.0,) * n,
            100.0,
            (1e-3,) * n,
            ladder,
            _modelica(
                "Ladder",
                f"  Real v[{n}](each start=0, each fixed=true);",
                f"  der(v[1]) = 1 - 2*v[1] + v[2];\n  for k in 2:{n - 1} loop\n"
                f"    der(v[k]) = v[k-1] - 2*v[k] + v[k+1];\n  end for;\n  der(v[{n}]) = v[{n - 1}] - v[{n}];",
            ),
            True,
        ),
        Problem(
            "Pleiades",
            Pleiades(),
            tuple(f"{letter}[{k}]" for letter in "xyuv" for k in bodies),
            (*x0, *y0, *u0, *v0),
            3.0,
            (1e-3,) * 28,
            pleiades,
            _modelica("Pleiades", text, "\n".join(motion)),
            False,
        ),
    )
