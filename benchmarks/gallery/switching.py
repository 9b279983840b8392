"""Exhibits of right-hand sides that switch, and of a linkage at its change point."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

import acausal
from acausal.models.stability.nonlinear import ChangePoint
from acausal.models.stability.switching import BangBang, FrictionStop, MissedPulse, ZenoBall
from gallery.methods import Case, Exhibit, fixed, rk4, scipy_run

REST = 4.0637127688715781401


def exhibits() -> Iterator[Exhibit]:
    """All of them."""
    yield zeno()
    yield friction()
    yield pulse()
    yield bang_bang()
    yield change_point()


def zeno() -> Exhibit:
    g, e = 9.81, 0.8
    t, v, times = math.sqrt(2.0 / g), e * math.sqrt(2.0 * g), []
    for _ in range(5000):
        times.append(t)
        ahead = t + 2.0 * v / g
        v *= e
        if ahead <= t:
            break
        t = ahead
    naive = np.array(times)
    text = f"{len(naive)} restarts, and t = {naive[-1]:.6f} s is not passed"
    gaps = np.maximum(REST - naive, 1e-17)
    cases = [Case("restart at every impact", text, True, (np.arange(1.0, len(naive) + 1), gaps))]
    result = acausal.simulate(ZenoBall())
    events = np.array([event.time for event in result.events])
    text = f"{len(events)} events, then at rest: h(5) = {float(result.final('h')):.0e}"
    curve = (np.arange(1.0, len(events) + 1), np.maximum(REST - events, 1e-17))
    cases.append(Case("acausal, rosenbrock 1e-8", text, False, curve))
    return Exhibit(
        "zeno", "Bouncing ball, infinitely many impacts", "ZenoBall",
        "Infinitely many impacts occur before t = 4.0637 s.",
        cases, x="number of the impact", y="time left to the accumulation point [s]", log="xy",
        done="When impacts change the velocity by less than the tolerance, the body comes to rest.",
    )  # fmt: skip


def friction() -> Exhibit:
    cases = []
    for width in (1e-2, 1e-3):
        run = scipy_run(lambda t, x, w=width: [x[1], 3 - 5 * np.tanh(x[1] / w)], (0, 100), [0.0, 1.0], "BDF", 1e-8)
        text = f"creeps to x(100) = {run.x[0][-1]:.4f}"
        cases.append(Case(f"BDF, tanh(v/{width:g})", text, True, (run.t, run.x[0])))
    run = scipy_run(lambda t, x: [x[1], 3 - 5 * np.sign(x[1])], (0, 100), [0.0, 1.0], "RK45", 1e-8)
    cases.append(Case("RK45 1e-8, sign(v)", run.failure or f"{run.steps} steps", bool(run.failure)))
    result = acausal.simulate(FrictionStop())
    text = f"x(100) - 0.25 = {float(result.final('x')) - 0.25:.0e}, {result.stats['steps']:.0f} steps"
    cases.append(Case("acausal, rosenbrock 1e-8", text, False, (result.time, result["x"])))
    return Exhibit(
        "friction-stop", "Coulomb friction, sticking", "FrictionStop",
        "sign(v) makes the body stick. Solvers chatter on it, and a smooth substitute creeps.",
        cases, y="position x [1]",
        done="The body sticks: the run slides along the switch until the force leaves the friction cone.",
    )  # fmt: skip


def pulse() -> Exhibit:
    def rhs(t: float, x: np.ndarray) -> list[float]:
        return [1.0 if 5.0 <= t < 5.01 else 0.0]

    cases = []
    for method in ("RK45", "DOP853", "BDF", "Radau"):
        run = scipy_run(rhs, (0.0, 10.0), [0.0], method, 1e-6)
        missed = abs(run.x[0][-1] - 0.01) > 1e-4
        cases.append(
            Case(f"{method} 1e-6", f"x(10) = {run.x[0][-1]:g} after {run.steps} steps", missed, (run.t, run.x[0]))
        )
    result = acausal.simulate(MissedPulse())
    off = float(result.final("x")) - 0.01
    cases.append(Case("acausal, erk 1e-6", f"x(10) - 0.01 = {off:.0e}", False, (result.time, result["x"])))
    return Exhibit(
        "missed-pulse", "Pulse shorter than the step", "MissedPulse",
        "A pulse of 10 ms in 10 s falls between two steps.",
        cases, y="x, the integral of the pulse [1]",
        done="Sources announce their switching times, and the run stops exactly there.",
    )  # fmt: skip


def bang_bang() -> Exhibit:
    end = 40.0 * math.sqrt(2.0)

    def rhs(t: float, x: np.ndarray) -> list[float]:
        return [x[1], -float(np.sign(x[0]))]

    def energy(x: np.ndarray) -> np.ndarray:
        return np.maximum(np.abs(0.5 * x[1] ** 2 + np.abs(x[0]) - 1.0), 1e-17)

    cases = []
    for h in (1e-2, 1e-3):
        run = fixed(rk4(rhs), [1.0, 0.0], end / round(end / h), round(end / h))
        error = math.hypot(run.x[0][-1] - 1.0, run.x[1][-1])
        every = max(1, len(run.t) // 400)
        cases.append(Case(f"RK4, h = {h:g}", f"error {error:.1e}", True, (run.t[::every], energy(run.x)[::every])))
    run = scipy_run(rhs, (0.0, end), [1.0, 0.0], "DOP853", 1e-6)
    error = math.hypot(run.x[0][-1] - 1.0, run.x[1][-1])
    cases.append(Case("DOP853 1e-6", f"error {error:.1e}, {run.steps} steps", True, (run.t, energy(run.x))))
    result = acausal.simulate(BangBang())
    x = np.vstack([result["x"], result["v"]])
    error = math.hypot(x[0][-1] - 1.0, x[1][-1])
    text = f"error {error:.0e}, {len(result.events)} events, {result.stats['steps']:.0f} steps"
    cases.append(Case("acausal, erk 1e-8", text, error > 1e-10, (result.time, energy(x))))
    return Exhibit(
        "bang-bang", "Discontinuous right-hand side", "BangBang",
        "Across an unknown switch a method of any order has order 1.",
        cases, y="error of the energy [1]", log="y",
        done="The run locates the switch and integrates each branch smoothly.",
    )  # fmt: skip


def change_point() -> Exhibit:
    th = np.arange(0.5 * math.pi, 4.5 * math.pi, 0.01)
    cases = []
    for predictor in (False, True):
        p, q = 0.0, 0.5 * math.pi
        before, rows = (p, q), []
        for angle in th:
            guess = (2 * p - before[0], 2 * q - before[1]) if predictor and rows else (p, q)
            before = (p, q)
            p, q = newton(angle, *guess)
            rows.append(p)
        worst = float(np.max(np.abs(rows)))
        name = "Newton from a velocity predictor" if predictor else "Newton from the last position"
        text = "stays on its branch" if worst < 1e-6 else f"folds over: |p| up to {worst:.2f} rad"
        cases.append(Case(name, text, worst > 1e-6, (np.rad2deg(th), np.array(rows))))
    result = acausal.simulate(ChangePoint())
    worst = float(np.max(np.abs(result["p"])))
    text = "stays on its branch" if worst < 1e-6 else f"folds over: |p| up to {worst:.2f} rad"
    cases.append(Case("acausal, rosenbrock 1e-8", text, worst > 1e-6, (np.rad2deg(result["th"]), result["p"])))
    done = "The run follows the positions with the velocity in steps that are small enough, whatever the output grid."
    return Exhibit(
        "change-point", "Parallelogram through its change point", "ChangePoint",
        "Where all bars are aligned, the linkage can fold into its other assembly mode.",
        cases, x="crank angle [deg]", y="coupler angle p [rad]", done=done,
    )  # fmt: skip


def newton(th: float, p: float, q: float) -> tuple[float, float]:
    """The linkage at crank angle `th` by Newton's method from (p, q)."""
    for _ in range(60):
        r = np.array([math.cos(th) + 2 * math.cos(p) - math.cos(q) - 2.0, math.sin(th) + 2 * math.sin(p) - math.sin(q)])
        slope = np.array([[-2 * math.sin(p), math.sin(q)], [2 * math.cos(p), -math.cos(q)]])
        if np.max(np.abs(r)) < 1e-13:
            break
        step = np.linalg.lstsq(slope, r, rcond=1e-12)[0]
        p, q = p - float(step[0]), q - float(step[1])
    return p, q
