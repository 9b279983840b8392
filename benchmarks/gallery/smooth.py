"""Exhibits of oscillations, stiff components, attitude, and the lost invariant."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import casadi as ca
import numpy as np

import acausal
from acausal.models.ivp.e5 import E5
from acausal.models.stability.attitude import GimbalMatrix, QuaternionDrift
from acausal.models.stability.oscillators import FastSlow, UndampedOscillator
from acausal.models.stability.stiff import OrderReduction, Ringing
from gallery.methods import Case, Exhibit, fixed, idas, scipy_run


def exhibits() -> Iterator[Exhibit]:
    """All of them."""
    yield undamped()
    yield fast_slow()
    yield ringing()
    yield order_reduction()
    yield gimbal()
    yield quaternion()
    yield invariant()


def undamped() -> Exhibit:
    x = ca.SX.sym("x", 2)
    grid = np.linspace(0.0, 2000.0 * math.pi, 401)[1:]
    cases = []
    for order in (1, 2, 3, 5):
        run = idas({"x": x, "ode": ca.vertcat(x[1], -x[0])}, [1, 0], grid, 1e-6, max_multistep_order=order)
        amplitude = np.hypot(*run.x)
        text = run.failure or f"amplitude {np.hypot(*run.x)[-1]:.3g} after 1000 periods, {run.steps} steps"
        cases.append(
            Case(
                f"IDAS 1e-6, order {order} at most", text, abs(amplitude[-1] - 1) > 1e-3, (run.t, np.abs(amplitude - 1))
            )
        )
    result = acausal.simulate(UndampedOscillator())
    text = f"amplitude {float(result.final('amplitude')):.5f}, {result.stats['steps']:.0f} steps"
    cases.append(Case("acausal, erk 1e-6", text, False, (result.time, np.abs(result["amplitude"] - 1))))
    return Exhibit(
        "undamped", "Undamped oscillator with BDF", "UndampedOscillator",
        "BDF of order 1, 2 and 5 damps the oscillation; order 3 amplifies it.",
        cases, y="|amplitude - 1| [1]", log="y", limits=(1e-8, 3.0),
        done="The verdict predicts the factor of every order from the characteristic equation, and recommends `erk`.",
    )  # fmt: skip


def fast_slow() -> Exhibit:
    w = 1e4
    x, t = ca.SX.sym("x", 2), ca.SX.sym("t")
    ode = ca.vertcat(x[1], -(w**2) * (x[0] - ca.cos(t)) - ca.cos(t))
    ends = np.array([0.05, 0.1, 0.2, 0.5, 1.0])
    cases = []
    for order in (5, 2):
        counts = [
            idas({"t": t, "x": x, "ode": ode}, [1, 0], np.array([b]), 1e-6, max_multistep_order=order).steps
            for b in ends
        ]
        text = f"{counts[-1]} steps for 1 s"
        cases.append(Case(f"IDAS 1e-6, order {order} at most", text, True, (ends, np.array(counts, dtype=float))))
    counts = [
        scipy_run(
            lambda t, q: [q[1], -(w**2) * (q[0] - np.cos(t)) - np.cos(t)], (0.0, b), [1.0, 0.0], "DOP853", 1e-6
        ).steps
        for b in ends
    ]
    cases.append(Case("DOP853 1e-6", f"{counts[-1]} steps for 1 s", True, (ends, np.array(counts, dtype=float))))
    ours = [acausal.simulate(FastSlow(), stop_time=float(b)) for b in ends]
    steps = np.array([float(r.stats["steps"]) for r in ours])  # type: ignore[arg-type]
    whole = acausal.simulate(FastSlow())
    error = np.max(np.abs(whole["x"] - np.cos(whole.time)))
    text = f"{steps[-1]:.0f} steps for 1 s; 10 s: {whole.stats['steps']:.0f} steps, error {error:.0e}"
    cases.append(Case("acausal, rosenbrock 1e-6", text, False, (ends, steps)))
    return Exhibit(
        "fast-slow", "Fast undamped mode around a slow solution", "FastSlow",
        "The solution is cos t. A mode 10 000 times faster dictates the steps of explicit methods and of BDF.",
        cases, x="length of the run [s]", y="number of steps", log="xy",
        done="The verdict finds the mode that the solution does not follow. An L-stable one-step method damps it.",
    )  # fmt: skip


def ringing() -> Exhibit:
    rate = 1e6

    def trapezoid(t: float, y: np.ndarray, h: float) -> np.ndarray:
        f = -rate * (y - math.cos(t)) - math.sin(t)
        return (y + h / 2 * (f + rate * math.cos(t + h) - math.sin(t + h))) / (1 + h / 2 * rate)

    def midpoint(t: float, y: np.ndarray, h: float) -> np.ndarray:
        m = t + h / 2
        return (y * (1 - h / 2 * rate) + h * (rate * math.cos(m) - math.sin(m))) / (1 + h / 2 * rate)

    cases = []
    for name, step in (("trapezoidal rule", trapezoid), ("implicit midpoint", midpoint)):
        run = fixed(step, [2.0], 0.01, 100)
        left = abs(run.x[0][-1] - math.cos(1.0))
        cases.append(Case(f"{name}, h = 0.01", f"{100 * left:.0f} % of the start error left", True, (run.t, run.x[0])))
    result = acausal.simulate(Ringing())
    error = abs(float(result.final("y")) - math.cos(1.0))
    text = f"error {error:.0e}, {result.stats['steps']:.0f} steps"
    cases.append(Case("acausal, rosenbrock 1e-6", text, False, (result.time, result["y"])))
    return Exhibit(
        "ringing", "Trapezoidal ringing", "Ringing",
        "A-stability is not enough: with R = -0.9996 the start error alternates almost undamped.",
        cases, y="y [1]",
        done="Use L-stable methods. The verdict states how much of a fast error is left after one step.",
    )  # fmt: skip


def collocation(nodes: list[float], step: float) -> float:
    """End value at t = 1 of y' = -1e6 (y - sin t) + cos t by collocation at these nodes."""
    s, lam = len(nodes), -1e6
    c = np.array(nodes)
    powers = np.arange(1, s + 1)
    # A from integrals of the Lagrange polynomials, b likewise
    vander = c[:, None] ** (powers - 1)[None, :]
    a = (c[:, None] ** powers / powers) @ np.linalg.inv(vander)
    b = (1.0 / powers) @ np.linalg.inv(vander)
    y, t = 0.0, 0.0
    for _ in range(round(1.0 / step)):
        force = -lam * np.sin(t + c * step) + np.cos(t + c * step)
        slopes = np.linalg.solve(np.eye(s) - step * lam * a, lam * y + force)
        y, t = y + step * float(b @ slopes), t + step
    return y


def order_reduction() -> Exhibit:
    root = math.sqrt(6.0)
    families: dict[str, tuple[int, Callable[[float], float]]] = {
        "Gauss, 2 stages": (4, lambda h: collocation([0.5 - math.sqrt(3) / 6, 0.5 + math.sqrt(3) / 6], h)),
        "Lobatto IIIA, 3 stages": (4, lambda h: collocation([0.0, 0.5, 1.0], h)),
        "Radau IIA, 3 stages": (5, lambda h: collocation([(4 - root) / 10, (4 + root) / 10, 1.0], h)),
    }
    steps = np.array([0.1, 0.05, 0.025, 0.0125])
    cases = []
    for name, (order, end) in families.items():
        errors = np.array([abs(end(h) - math.sin(1.0)) for h in steps])
        seen = math.log2(errors[0] / errors[1])
        text = f"observed order {seen:.1f} instead of {order}, error {errors[0]:.1e} at h = 0.1"
        cases.append(Case(name, text, errors[0] > 1e-9, (steps, np.maximum(errors, 1e-17))))
    ours = []
    for h in steps:
        result = acausal.simulate(OrderReduction(), solver="rosenbrock", step=float(h), output_interval=float(h))
        ours.append(abs(float(result.final("y")) - math.sin(1.0)))
    errors = np.maximum(np.array(ours), 1e-17)
    text = f"observed order {math.log2(errors[0] / errors[1]):.1f}, error {errors[0]:.1e} at h = 0.1"
    cases.append(Case("acausal, rosenbrock with fixed steps", text, False, (steps, errors)))
    return Exhibit(
        "order-reduction", "Order reduction on a stiff scalar problem", "OrderReduction",
        "On a stiff component methods lose their order. Methods that are not stiffly accurate lose accuracy, too.",
        cases, x="step [s]", y="error of y(1 s) [1]", log="xy",
        done="`rosenbrock` and `collocation` are stiffly accurate.",
    )  # fmt: skip


def gimbal() -> Exhibit:
    w = math.pi / math.sqrt(2.0)

    def rhs(t: float, q: np.ndarray) -> list[float]:
        _, b, c = q
        return [w * np.cos(c) / np.cos(b), w * np.sin(c), w - w * np.cos(c) * np.tan(b)]

    cases = []
    for method in ("DOP853", "Radau"):
        run = scipy_run(rhs, (0.0, 2.0), [0.0, 0.0, 0.0], method, 1e-10)
        text = run.failure or f"passes with {run.steps} steps"
        cases.append(Case(f"{method} 1e-10 on Cardan angles", text, bool(run.failure), (run.t, np.rad2deg(run.x[1]))))
    result = acausal.simulate(GimbalMatrix())
    middle = np.rad2deg(np.arcsin(np.clip(result["R[0,2]"], -1.0, 1.0)))
    end = np.array([[float(result.final(f"R[{i},{j}]")) for j in range(3)] for i in range(3)])
    error = np.max(np.abs(end - np.eye(3)))
    text = f"attitude off by {error:.0e}, {result.stats['steps']:.0f} steps"
    cases.append(Case("acausal, erk 1e-8 on the matrix", text, False, (result.time, middle)))
    return Exhibit(
        "gimbal", "Cardan angles through 90 degrees", "GimbalMatrix",
        "At 90 degrees the rates of two angles become infinite.",
        cases, y="middle angle [deg]", done="Frames carry rotation matrices; the verdict on the angles is `singular`.",
    )  # fmt: skip


def quaternion() -> Exhibit:
    q = ca.SX.sym("q", 4)
    a, b, c = (10.0 / math.sqrt(14.0) * k for k in (1.0, 2.0, 3.0))
    s, x, y, z = q[0], q[1], q[2], q[3]
    ode = 0.5 * ca.vertcat(
        -(a * x + b * y + c * z), a * s + c * y - b * z, b * s + a * z - c * x, c * s + b * x - a * y
    )
    grid = np.linspace(0.0, 1000.0, 201)[1:]
    cases = []
    for rtol in (1e-4, 1e-6):
        run = idas({"x": q, "ode": ode}, [1, 0, 0, 0], grid, rtol)
        error = np.maximum(np.abs(np.linalg.norm(run.x, axis=0) - 1.0), 1e-17)
        cases.append(Case(f"IDAS {rtol:.0e}", f"norm off by {error[-1]:.1e} after 1000 s", True, (run.t, error)))
    result = acausal.simulate(QuaternionDrift())
    norm = np.sqrt(sum(result[name] ** 2 for name in ("s", "q[0]", "q[1]", "q[2]")))
    error = np.maximum(np.abs(norm - 1.0), 1e-17)
    text = f"integrated {result.stats['drift']:.0e}, recorded {error.max():.0e}"
    cases.append(Case("acausal, erk 1e-6", text, False, (result.time, error)))
    return Exhibit(
        "quaternion-drift", "Quaternion norm", "QuaternionDrift",
        "The norm of an integrated quaternion drifts like any amplitude.",
        cases, y="||q| - 1| [1]", log="y",
        done="|q| = 1 is a constraint of the model, which is stabilised and projected.",
    )  # fmt: skip


def invariant() -> Exhibit:
    exact = 8.86123352e-23
    y = ca.SX.sym("y", 4)
    q = y
    A, B, C, M = 7.89e-10, 1.1e7, 1.13e3, 1e6
    ode = ca.vertcat(
        -A * q[0] - B * q[0] * q[2],
        A * q[0] - M * C * q[1] * q[2],
        A * q[0] - B * q[0] * q[2] - M * C * q[1] * q[2] + C * q[3],
        B * q[0] * q[2] - C * q[3],
    )
    grid = np.geomspace(1e-3, 1e13, 61)
    cases = []
    for rtol in (1e-6, 1e-8):
        run = idas({"x": y, "ode": ode}, [1.76e-3, 0, 0, 0], grid, rtol, abstol=1e-18 * rtol, first_time=1e-6)
        if len(run.t):
            end = run.x[1][-1]
            text = run.failure or f"y2 = {end:.3g} instead of {exact:.4g}"
            curve = (run.t, np.maximum(np.abs(run.x[1]), 1e-60))
            cases.append(Case(f"IDAS {rtol:.0e} on all four balances", text, abs(end / exact - 1) > 1e-3, curve))
        else:
            cases.append(Case(f"IDAS {rtol:.0e} on all four balances", run.failure, True))
    result = acausal.simulate(E5())
    shown = grid[grid >= 1.0][::3]
    found = [float(result.at(float(t), "y2")) for t in shown]
    off = abs(float(result.final("y2")) / exact - 1.0)
    text = f"y2 = {float(result.final('y2')):.6g}, off by {off:.0e}"
    cases.append(Case("acausal, rosenbrock 1e-8", text, False, (shown, np.array(found))))
    return Exhibit(
        "invariant", "Invariant lost to rounding", "E5",
        "y2 - y3 - y4 = 0, and y2 - y3 is below the rounding error of the integrated variables.",
        cases, y="y2 [1]", log="xy", limits=(1e-26, 1e-8),
        done="The compiler finds the linear invariant and computes y2 from it instead of integrating it.",
    )  # fmt: skip
