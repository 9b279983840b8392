"""Exhibits of contact and drilling."""

from __future__ import annotations

import math
from collections.abc import Iterator

import casadi as ca
import numpy as np

import acausal
from acausal.errors import AcausalError
from acausal.models.stability.contact import ExplicitPenalty, HuntCrossleyImpact, KelvinVoigtImpact
from acausal.models.stability.drilling import EDGES, SPEED, THRUST, DrillDynamic, PowerLaw, WindUp
from gallery.methods import Case, Exhibit, fixed, idas, rk2, rk4, scipy_run

DEPTH = 1.282259563e-2
"""s(10) for k = 1e8, m = 10, zeta = 1 [m], from IDAS at 1e-12 in segments."""


def exhibits() -> Iterator[Exhibit]:
    """Explicit steps, two laws of impact, and the drill."""
    yield penalty()
    yield tension()
    yield hunt_crossley()
    yield drill_dynamic()
    yield absolute_tolerance()
    yield wind_up()
    yield power_law()


def penalty() -> Exhibit:
    k, m = 1e8, 10.0
    d = 2.0 * math.sqrt(k * m)

    def rhs(t: float, x: np.ndarray) -> list[float]:
        return [x[1], -(k * x[0] + d * x[1]) / m]

    cases = []
    for name, method, h in (("RK2", rk2, 1e-3), ("RK4", rk4, 1e-3), ("RK2", rk2, 0.9 * 2.0 / math.sqrt(k / m))):
        run = fixed(method(rhs), [1e-5, 0.0], h, 25)
        last = abs(run.x[0][-1])
        text = f"|s| = {last:.1e} m after {run.steps} steps"
        cases.append(
            Case(f"{name}, h = {1e3 * h:.3g} ms", text, last > 1e-5, (run.t, np.maximum(np.abs(run.x[0]), 1e-12)))
        )
    try:
        acausal.simulate(ExplicitPenalty(), solver="rk2", step=1e-3)
    except AcausalError as error:
        cases.append(Case("acausal, rk2, --step 1ms", f"refused, {error.code}: {error.fact}", False))
    result = acausal.simulate(ExplicitPenalty(), solver="rosenbrock", stop_time=0.016)
    curve = result.time, np.maximum(np.abs(result["s"]), 1e-12)
    cases.append(Case("acausal, rosenbrock 1e-6", f"{result.stats['steps']:.0f} steps", False, curve))
    return Exhibit(
        "explicit-penalty", "Explicit steps on a stiff contact", "ExplicitPenalty",
        "The stiffness of a contact, not the motion, limits explicit steps.",
        cases, y="|s| [m]", log="y", limits=(1e-12, 1e6),
        done="The largest stable step is known before the run. A larger one is refused with the number and states.",
    )  # fmt: skip


def tension() -> Exhibit:
    k, m, zeta = 1e5, 1.0, 0.2
    d = 2.0 * zeta * math.sqrt(k * m)
    run = scipy_run(
        lambda t, x: [x[1], -(k * x[0] + d * x[1]) / m], (0.0, 0.012), [0.0, 1.0], "DOP853", 1e-10, max_step=1e-5
    )
    inside = (run.x[0] >= 0.0) | (run.t < 1e-9)
    end = int(np.argmin(inside)) if not inside.all() else len(run.t)
    force = (k * run.x[0] + d * run.x[1])[:end]
    cases = [
        Case(
            "DOP853, plain spring and damper",
            f"pulls with {force.min():.1f} N before release",
            True,
            (run.t[:end] * 1e3, force),
        )
    ]
    result = acausal.simulate(KelvinVoigtImpact(zeta=zeta))
    rows = (result.time >= 1e-3) & (result.time <= 0.0115)
    text = f"least force {result['f'].min():.0f} N, restitution {-float(result.final('v')):.6f} (exact 0.571740)"
    curve = (1e3 * (result.time[rows] - 1e-3), result["f"][rows])
    cases.append(Case("acausal, rosenbrock 1e-8", text, False, curve))
    return Exhibit(
        "kv-tension", "Adhesion of the Kelvin-Voigt contact", "KelvinVoigtImpact",
        "The plain Kelvin-Voigt law pulls at the end of the contact, and its force jumps at touch.",
        cases, x="time after touch [ms]", y="force [N]",
        done="The contact only pushes, and touch and release are events.",
    )  # fmt: skip


def hunt_crossley() -> Exhibit:
    exact = 0.74843493159743415812
    k, a = 1e5, 0.5

    def rhs(t: float, x: np.ndarray) -> list[float]:
        return [x[1], -k * x[0] * (1.0 + a * x[1]) if x[0] > 0.0 else 0.0]

    cases = []
    for method in ("RK45", "DOP853", "BDF"):
        run = scipy_run(rhs, (0.0, 0.02), [-1e-3, 1.0], method, 1e-8)
        error = abs(-run.x[1][-1] - exact)
        cases.append(Case(f"{method} 1e-8", f"rebound off by {error:.0e}", error > 1e-6, (run.t * 1e3, run.x[1])))
    result = acausal.simulate(HuntCrossleyImpact())
    error = abs(-float(result.final("v")) - exact)
    cases.append(Case("acausal, erk 1e-8", f"rebound off by {error:.0e}", False, (result.time * 1e3, result["v"])))
    return Exhibit(
        "hunt-crossley", "Hunt-Crossley restitution", "HuntCrossleyImpact",
        "The force is continuous at touch, so no method fails. The verdict must not warn.",
        cases, x="time [ms]", y="velocity [m/s]", done="The verdict is `smooth`, an explicit method.",
    )  # fmt: skip


def load(t: float) -> float:
    """Force on the drill [N]."""
    full = 4881.341711
    if t < 1.0:
        return 50.0 + (full - 50.0) * t
    return full if t < 8.0 else max(full + (20.0 - full) * (t - 8.0) / 0.5, 20.0) if t < 8.5 else 20.0


def drill(k: float, m: float, zeta: float, limited: bool = True) -> object:
    """The right-hand side of the drill by hand."""
    d = 2.0 * zeta * math.sqrt(k * m)

    def rhs(t: float, x: np.ndarray) -> list[float]:
        s, v, s_tar = x
        force = k * (s - s_tar) + d * v
        if limited:
            force = max(0.0, force) if s > s_tar else 0.0
        feed = (max(force, 0.0) / THRUST) ** (1.0 / 0.79)
        return [v, (load(t) - force) / m, EDGES * SPEED * feed]

    return rhs


def drill_dynamic() -> Exhibit:
    rhs = drill(1e8, 10.0, 1.0)
    cases = []
    for name, method in (("RK2", rk2), ("RK4", rk4)):
        run = fixed(method(rhs), [0.0, 0.0, 0.0], 1e-3, 10_000)  # type: ignore[arg-type]
        off = run.x[0][-1] - DEPTH
        cases.append(Case(f"{name}, h = 1 ms", f"s(10) off by {off:.1e} m", True, (run.t[::20], 1e3 * run.x[0][::20])))
    result = acausal.simulate(DrillDynamic(k=1e8))
    off = float(result.final("s")) - DEPTH
    text = f"s(10) off by {off:.0e} m, {result.stats['steps']:.0f} steps"
    cases.append(Case("acausal, rosenbrock 1e-8", text, False, (result.time, 1e3 * result["s"])))
    return Exhibit(
        "drill-dynamic", "Dynamic drilling, compliant contact (k = 1e8 N/m)", "DrillDynamic",
        "With explicit steps of a millisecond the drill leaves the workpiece.",
        cases, y="depth [mm]", limits=(-40.0, 40.0),
        done="The method is L-stable. Fixed steps above the limit are refused.",
    )  # fmt: skip


def absolute_tolerance() -> Exhibit:
    exact = 1.284243480e-2
    k, m, d = 1e6, 10.0, 2.0 * math.sqrt(1e6 * 10.0)
    x, t, u = ca.SX.sym("x", 3), ca.SX.sym("t"), ca.SX.sym("u", 2)
    force = ca.if_else(x[0] > x[2], ca.fmax(0.0, k * (x[0] - x[2]) + d * x[1]), 0.0)
    ode = ca.vertcat(x[1], (u[0] + u[1] * t - force) / m, EDGES * SPEED * (force / THRUST) ** (1.0 / 0.79))
    full = 4881.341711
    parts = ((1.0, 50.0, full - 50.0), (7.0, full, 0.0), (0.5, full, (20.0 - full) / 0.5), (1.5, 20.0, 0.0))
    sizes, errors = np.geomspace(1e-9, 1e-4, 6), []
    for atol in sizes:
        here = [0.0, 0.0, 0.0]
        for span, start, slope in parts:
            dae = {"t": t, "x": x, "ode": ca.substitute(ode, u, ca.DM([start, slope]))}
            run = idas(dae, here, np.array([span]), 1e-4, abstol=float(atol))
            here = run.x[:, -1].tolist()
        errors.append(abs(here[0] - exact))
    curve = (sizes, np.array(errors))
    text = ", ".join(f"{e:.1e} m at {a:.0e}" for a, e in zip(sizes, errors, strict=True) if a >= 1e-6 or a < 1e-8)
    cases = [Case("IDAS 1e-4, one atol for metres and metres per second", f"s(10) off by {text}", True, curve)]
    result = acausal.simulate(DrillDynamic(k=1e6), tolerance=1e-4)
    error = abs(float(result.final("s")) - exact)
    line = (sizes, np.full(len(sizes), error))
    cases.append(Case("acausal, rosenbrock 1e-4", f"s(10) off by {error:.1e} m", False, line))
    return Exhibit(
        "abstol", "One absolute tolerance for all units", "DrillDynamic",
        "An absolute tolerance of 1e-6 is strict for volts and loose for metres.",
        cases, x="absolute tolerance for all states [m, m/s]", y="error of s(10) [m]", log="xy",
        done="Absolute tolerances follow the nominal value of each variable.",
    )  # fmt: skip


def wind_up() -> Exhibit:
    d = 2.0 * math.sqrt(1e7 * 10.0)

    def rhs(t: float, x: np.ndarray) -> list[float]:
        feed = (max(d * 0.05, 0.0) / THRUST) ** (1.0 / 0.79)
        return [0.05, EDGES * SPEED * feed]

    run = scipy_run(rhs, (0.0, 0.1), [-5e-3, 0.0], "RK45", 1e-8)
    text = f"{1e3 * run.x[1][-1] / 0.1:.4f} mm/s of feed in the air"
    cases = [Case("RK45, spring and damper not limited to contact", text, True, (1e3 * run.t, 1e6 * run.x[1]))]
    result = acausal.simulate(WindUp())
    rows = result.time <= 0.1
    largest = float(np.max(np.abs(result["s_tar"][result["s"] < -1e-9][:20])))
    text = f"s_tar = {largest:.0e} m in the air"
    cases.append(Case("acausal, rosenbrock 1e-8", text, False, (1e3 * result.time[rows], 1e6 * result["s_tar"][rows])))
    return Exhibit(
        "wind-up", "Wind-up of the target depth in free air", "WindUp",
        "At 50 mm/s the damper alone moves the target depth before there is contact.",
        cases, x="time [ms]", y="target depth [µm]", done="There is no force without contact, and touch is an event.",
    )  # fmt: skip


def power_law() -> Exhibit:
    feed = np.geomspace(1e-12, 1e-3, 60)
    slope = THRUST * 0.79 * feed**-0.21
    text = f"slope {slope[0]:.1e} N/m at 1 pm, infinite at 0, NaN below"
    cases = [Case("F = K f^(1-z) as printed", text, True, (feed * 1e3, slope))]
    compiled = acausal.compile(PowerLaw())
    dae = compiled.casadi(outputs=["f"]).dae
    ode = dae.factory("slope", ["t", "x", "z", "u", "p"], ["jac:y:p"])
    p = np.array(compiled.parameter_values, dtype=float)
    column = compiled.parameters.index("force")
    found = []
    for f in feed:
        # the force at which the feed is f; d f / d F by the chain rule over the amplitude of the force
        p[column] = THRUST * f**0.79
        found.append(1.0 / float(np.array(ode(0.25, [0.0], [], [], p))[0, column]))
    p[column] = 0.0
    at_zero = float(np.array(ode(0.25, [0.0], [], [], p))[0, column])
    p[column] = -4881.0
    below = float(np.array(ode(0.25, [0.0], [], [], p))[0, column])
    text = f"df/dF = {at_zero:g} at 0, {below:g} below: finite everywhere"
    cases.append(Case("acausal, f = (F/K)^(1/(1-z)), 1/(df/dF)", text, False, (feed * 1e3, np.array(found))))
    return Exhibit(
        "power-law", "Power law of the drilling force at zero feed", "PowerLaw",
        "The law as printed has an infinite slope at zero feed.",
        cases, x="feed per edge [mm]", y="dF/df [N/m]", log="xy",
        done="The law is inverted: the feed is a function of the force, and the force only pushes.",
    )  # fmt: skip
