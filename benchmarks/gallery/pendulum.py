"""Exhibits of the planar pendulum."""

from __future__ import annotations

from collections.abc import Iterator

import casadi as ca
import numpy as np

import acausal
from acausal.errors import InitializationError
from acausal.models.stability.pendulum import (
    GRAVITY,
    PendulumDirect,
    PendulumDrift,
    PendulumInconsistent,
    PendulumStaticState,
)
from gallery.methods import Case, Exhibit, idas, quiet, scipy_run


def exhibits() -> Iterator[Exhibit]:
    """Drift, a fixed state, the index-3 form, an inconsistent start."""
    yield drift()
    yield static_state()
    yield index3()
    yield inconsistent()


def acceleration_level() -> dict[str, object]:
    """The pendulum with the tension from the second derivative of its constraint."""
    x = ca.SX.sym("x", 4)
    tension = (x[2] ** 2 + x[3] ** 2 - GRAVITY * x[1]) / (x[0] ** 2 + x[1] ** 2)
    return {"x": x, "ode": ca.vertcat(x[2], x[3], -tension * x[0], -tension * x[1] - GRAVITY)}


def length_error(x: np.ndarray) -> np.ndarray:
    return np.maximum(np.abs(x[0] ** 2 + x[1] ** 2 - 1.0), 1e-17)


def drift() -> Exhibit:
    grid = np.linspace(0.0, 200.0, 401)[1:]
    cases = []
    for rtol in (1e-6, 1e-8):
        run = idas(acceleration_level(), [1, 0, 0, 0], grid, rtol)
        error = length_error(run.x)
        text = f"length off by {error[run.t <= 100].max():.1e} at 100 s, {error.max():.1e} at 200 s"
        cases.append(Case(f"IDAS {rtol:.0e}, constraint differentiated twice", text, True, (run.t, error)))
    result = acausal.simulate(PendulumDrift(), solver="idas", tolerance=1e-6, stop_time=200.0, output_interval=0.5)
    error = np.maximum(np.abs(result["length2"] - 1.0), 1e-17)
    text = f"integrated {result.stats['drift']:.1e}, recorded {error.max():.1e}"
    cases.append(Case("acausal, idas 1e-6", text, False, (result.time, error)))
    return Exhibit(
        "drift", "Constraint drift after index reduction", "PendulumDrift",
        "After two differentiations of the constraint only an ODE remains, and the length of the rod drifts.",
        cases, y="|x² + y² - 1| [1]", log="y",
        done="Stabilisation keeps all levels of the constraint, and every recorded point is projected onto them.",
    )  # fmt: skip


def static_state() -> Exhibit:
    def rhs(t: float, q: np.ndarray) -> list[float]:
        y, v = q
        x2 = 1.0 - y * y
        speed2 = v * v / x2
        return [v, -(speed2 - GRAVITY * y) * y - GRAVITY]

    cases = []
    for method in ("Radau", "DOP853"):
        run = scipy_run(rhs, (0.0, 3.0), [-np.sin(0.3), 0.0], method, 1e-8)
        rows = np.isfinite(run.x).all(axis=0) & (np.abs(run.x[0]) <= 1.0)
        where = f"x = {np.sqrt(max(0.0, 1 - run.x[0][rows][-1] ** 2)):.1e} there" if rows.any() else ""
        stays = run.failure or "never changes side"
        curve = (run.t[rows], np.sqrt(1.0 - run.x[0][rows] ** 2)) if rows.any() else None
        cases.append(Case(f"{method} 1e-8 on (y, vy)", f"{stays}; {where}".rstrip("; "), True, curve))
    result = acausal.simulate(PendulumStaticState(), solver="erk", stop_time=3.0)
    at = float(result.at(0.47079423603649512667, "x"))
    text = f"swings through: x = {at:.1e} at t = 0.47079423603649512667 s"
    cases.append(Case("acausal, erk 1e-8", text, False, (result.time, result["x"])))
    return Exhibit(
        "static-state", "Fixed choice of states", "PendulumStaticState",
        "With the states (y, vy) and x = sqrt(1 - y²), the integration cannot pass the lowest point.",
        cases, y="position x [1]",
        done="No fixed choice is safe, so the solver integrates x, y and their rates together.",
    )  # fmt: skip


def index3() -> Exhibit:
    x, lam = ca.SX.sym("x", 4), ca.SX.sym("lam")
    ode = ca.vertcat(x[2], x[3], -lam * x[0], -lam * x[1] - GRAVITY)
    dae = {"x": x, "z": lam, "ode": ode, "alg": x[0] ** 2 + x[1] ** 2 - 1.0}
    grid = np.linspace(0.0, 2.0, 201)[1:]
    cases = []
    for rtol in (1e-4, 1e-6):
        for ic in (True, False):
            run = idas(dae, [1, 0, 0, 0], grid, rtol, calc_ic=ic, max_num_steps=20_000)
            name = f"IDAS {rtol:.0e} on the DAE as written" + ("" if ic else ", without IDACalcIC")
            cases.append(
                Case(name, run.failure or "passes", bool(run.failure), (run.t, run.x[0]) if len(run.t) else None)
            )
    result = acausal.simulate(PendulumDirect())
    text = f"x(2) - 1 = {float(result.final('x')) - 1:.1e}"
    cases.append(Case("acausal, rosenbrock 1e-8", text, False, (result.time, result["x"])))
    return Exhibit(
        "index3-direct", "Direct integration of the index-3 form", "PendulumDirect",
        "A BDF code with x² + y² = 1 as its algebraic equation fails at the start or soon after.",
        cases, y="position x [1]",
        done="The compiler finds the constraint, differentiates it, and names it in the verdict.",
    )  # fmt: skip


def inconsistent() -> Exhibit:
    grid = np.linspace(0.0, 4.0, 201)[1:]
    run = idas(acceleration_level(), [1, 0, 0.1, 0], grid, 1e-8)
    length = np.sqrt(run.x[0] ** 2 + run.x[1] ** 2)
    cases = [Case("IDAS 1e-8, radial speed 0.1", f"length {length[-1]:.3g} after 4 s", True, (run.t, length))]
    v = ca.SX.sym("v")
    q = ca.SX.sym("q")
    alg = (5.0 - v) / 1000.0 - 1e-14 * (ca.exp(v / 0.02585) - 1.0)
    for start in (0.7, 5.0):
        with quiet():
            one = ca.integrator("diode", "idas", {"x": q, "z": v, "ode": v, "alg": alg}, 0.0, 1.0, {"calc_ic": True})
            try:
                value = float(one(x0=0.0, z0=start)["zf"])
                good = abs(value - 0.69249037522418502) < 1e-6
                cases.append(Case(f"IDACalcIC on the diode from {start} V", f"{value:.8g} V", not good))
            except RuntimeError:
                cases.append(Case(f"IDACalcIC on the diode from {start} V", "fails", True))
    try:
        acausal.simulate(PendulumInconsistent(x0=1.0, vx0=0.1))
        text = "ran"
    except InitializationError as error:
        text = f"refused, {error.code}: {error.fact.split(': ', 1)[1]}"
    cases.append(Case("acausal, radial speed 0.1", text, text == "ran"))
    from acausal.models.stability.nonlinear import DiodeStart

    worst = max(
        abs(float(acausal.simulate(DiodeStart(v=acausal.guess(g))).final("v")) - 0.69249037522418502165)
        for g in (0.0, 0.6, 0.7, 1.0, 5.0)
    )
    cases.append(Case("acausal, the diode from 0, 0.6, 0.7, 1, 5 V", f"within {worst:.0e} V from all", worst > 1e-6))
    return Exhibit(
        "inconsistent", "Inconsistent start", "PendulumInconsistent",
        "A start that violates the derivative of the constraint runs without a message; a poor guess stops the run.",
        cases, y="length of the rod [1]",
        done="The start is a system of its own: contradicting conditions are named, and poor guesses converge.",
    )  # fmt: skip
