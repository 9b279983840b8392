"""Answers of the scenes of `acausal.models.stability`, for accuracy.py: closed forms and the reference data's figures.

Scenes without a known end value (the explicit step, the order of the step, the printed power law, the inconsistent
start, the wind-up) are left out.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from acausal.models.ivp.answers import Problem
from acausal.models.stability.attitude import GimbalMatrix, QuaternionDrift
from acausal.models.stability.contact import ExplicitPenalty, HuntCrossleyImpact, KelvinVoigtImpact
from acausal.models.stability.drilling import DrillDynamic, PowerLaw
from acausal.models.stability.nonlinear import ChangePoint, DiodeStart
from acausal.models.stability.oscillators import FastSlow, UndampedOscillator
from acausal.models.stability.pendulum import PendulumDirect, PendulumDrift, PendulumStaticState
from acausal.models.stability.stiff import OrderReduction, Ringing
from acausal.models.stability.switching import FrictionStop, MissedPulse, ZenoBall


def problem(
    model: type[Any], values: dict[str, float], source: str = "exact", digits: int = 14, floor: float = 1.0
) -> Callable[[], Problem]:
    """One scene."""
    return lambda: Problem(model, values, digits, source, floor=floor)


def swung() -> Problem:
    """The pendulum, of whose end only the energy is known: g times the initial height."""
    g = 13.750371636040745654980191559621114395801712
    values = {"energy": g * math.sin(-0.3), "length2": 1.0}
    return Problem(PendulumStaticState, values, 14, "energy")


def fed() -> Problem:
    """The depth after two strokes: the feed is (F/THRUST)^(1/0.79) in the halves in which the force is positive."""
    from scipy.integrate import quad

    from acausal.models.stability.drilling import EDGES, SPEED, THRUST

    half, _ = quad(lambda t: math.sin(2.0 * math.pi * t) ** (1.0 / 0.79), 0.0, 0.5, epsabs=1e-14, epsrel=1e-14)
    s = 2.0 * EDGES * SPEED * (4881.341711 / THRUST) ** (1.0 / 0.79) * half
    return Problem(PowerLaw, {"s": s}, 12, "quadrature", floor=1e-3)


def turned() -> Problem:
    """10 000 rad about (1, 2, 3)."""
    half, axis = 0.5 * 10.0 * 1000.0, np.array([1.0, 2.0, 3.0]) / math.sqrt(14.0)
    values = {"s": math.cos(half)} | {f"q[{k}]": float(axis[k] * math.sin(half)) for k in range(3)}
    return Problem(QuaternionDrift, values, 12, "exact")


def lagged() -> Problem:
    """A ramp of 10 ms to 0.01 at 5 s, and the same with a lag of 1 s."""
    # y = integral of exp(-(10 - s)) x(s) ds
    y = 0.01 - (math.exp(0.01) - 1.0) * math.exp(-5.0)
    return Problem(MissedPulse, {"x": 0.01, "y": y}, 14, "exact", floor=1e-2)


def pressed() -> Problem:
    """Critically damped: s = (1 + w t) exp(-w t) s0, which has decayed to zero."""
    return Problem(ExplicitPenalty, {"s": 0.0}, 14, "exact", floor=1e-5)


def released() -> Problem:
    """The speed after an impact on a spring and damper that only push, zeta = 0.2: v = -exp(-zeta w t) at f = 0."""
    root = math.sqrt(1.0 - 0.2**2)
    phase = math.atan2(2.0 * 0.2 * root, 2.0 * 0.2**2 - 1.0)
    return Problem(KelvinVoigtImpact, {"v": -math.exp(-0.2 / root * phase)}, 14, "exact")


ORIGIN = {f"R[{i},{j}]": float(i == j) for i in range(3) for j in range(3)}
SCENES: dict[str, Callable[[], Problem]] = {
    "drift": problem(PendulumDrift, {"x": 1.0, "y": 0.0, "length2": 1.0}),
    "static-state": swung,
    "index3-direct": problem(PendulumDirect, {"x": 1.0, "y": 0.0, "vx": 0.0, "vy": 0.0}),
    "explicit-penalty": pressed,
    "kv-tension": released,
    "hunt-crossley": problem(HuntCrossleyImpact, {"v": -0.74843493159743415812}),
    "zeno": problem(ZenoBall, {"h": 0.0}),
    "friction-stop": problem(FrictionStop, {"x": 0.25, "v": 0.0}),
    "missed-pulse": lagged,
    "undamped": problem(UndampedOscillator, {"x": 1.0, "v": 0.0, "amplitude": 1.0}, digits=13),
    "fast-slow": problem(FastSlow, {"x": math.cos(10.0)}),
    "diode-start": problem(DiodeStart, {"v": 0.69249037522418502165, "q": 0.69249037522418502165}),
    "change-point": problem(ChangePoint, {"p": 0.0, "q": 4.5 * math.pi}),
    "gimbal": problem(GimbalMatrix, ORIGIN),
    "quaternion-drift": turned,
    "power-law": fed,
    "drill-dynamic": problem(DrillDynamic, {"s": 1.282439797e-2}, "reference data", 9, 1e-2),
    "ringing": problem(Ringing, {"y": math.cos(1.0)}),
    "order-reduction": problem(OrderReduction, {"y": math.sin(1.0)}),
}
EXPLICIT = {
    "kv-tension",
    "hunt-crossley",
    "zeno",
    "friction-stop",
    "missed-pulse",
    "undamped",
    "gimbal",
    "power-law",
}
"""Scenes for which explicit methods are suitable too."""
