"""Claim: a spatial chain composed of joints and bodies is ahead of pinocchio and of MuJoCo at equal accuracy.

`SpatialChain` of scenes.py, n links on damped hinges, 10 s. Every side is tuned: acausal by tolerance of `erk`
(compiled), pinocchio (its articulated-body algorithm) by tolerance of SciPy's DOP853 and LSODA and of scikit-sundae's
CVODE (Adams), MuJoCo by the step of its RK4. Of each method, the loosest setting counts whose end is within the
accuracy of a reference (acausal and pinocchio at 1e-11, which have to agree). At these settings all run in turn; times
are medians of processor times of whole calls, ours with start values and recording. Compiling is apart.

    pip install .[benchmark]
    python benchmarks/chains_vs_robotics.py --n 2,4,8,16,32,64 --accuracy 1e-6
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from measure import alternated, drawn_lines, medians, report, rounded
from scenes import ANGLE, AXES, DAMPING, INERTIA, LENGTH, MASS, SpatialChain

import acausal

STOP, GRAVITY, ROUNDS, LONGEST = 10.0, 9.80665, 5, 60.0
TOLERANCES = tuple(10.0**-k for k in range(3, 12))
# End values.
Solve = Callable[[], Any]


def pinocchio_rates(n: int, damping: float = DAMPING) -> Callable[[float, Any], Any]:
    """`(t, [q, v]) -> d/dt` by pinocchio's articulated-body algorithm."""
    import pinocchio as pin

    model = pin.Model()
    model.gravity.linear = np.array([GRAVITY, 0.0, 0.0])
    parent, place = 0, pin.SE3.Identity()
    body = pin.Inertia(MASS, np.array([LENGTH / 2, 0.0, 0.0]), np.diag(INERTIA))
    for k in range(n):
        parent = model.addJoint(parent, _joint(pin, AXES[k % 2]), place, f"joint{k}")
        model.appendBodyToJoint(parent, body, pin.SE3.Identity())
        place = pin.SE3(np.eye(3), np.array([LENGTH, 0.0, 0.0]))
    data, aba = model.createData(), pin.aba

    def rates(t: float, y: Any) -> Any:
        q, v = y[:n], y[n:]
        return np.concatenate([v, aba(model, data, q, v, -damping * v)])

    return rates


def _joint(pin: Any, axis: tuple[float, float, float]) -> Any:
    return pin.JointModelRZ() if axis[2] else pin.JointModelRY()


def with_pinocchio(n: int, damping: float = DAMPING) -> Iterator[tuple[str, Solve]]:
    """Its best integrators at all tolerances."""
    from scipy.integrate import solve_ivp
    from sksundae.cvode import CVODE

    rates, start = pinocchio_rates(n, damping), np.concatenate([np.full(n, ANGLE), np.zeros(n)])
    for tolerance in TOLERANCES:
        for method in ("DOP853", "LSODA"):

            def scipy_run(method: str = method, tolerance: float = tolerance) -> Any:
                return solve_ivp(rates, (0.0, STOP), start, method=method, rtol=tolerance, atol=1e-3 * tolerance).y[
                    :, -1
                ]

            yield f"{method} {tolerance:.0e}", scipy_run

        def right(t: float, y: Any, out: Any) -> None:
            out[:] = rates(t, y)

        def sundials(tolerance: float = tolerance) -> Any:
            solver = CVODE(right, method="Adams", rtol=tolerance, atol=1e-3 * tolerance, max_num_steps=10**6)
            return solver.solve(np.array([0.0, STOP]), start).y[-1]

        yield f"CVODE {tolerance:.0e}", sundials


def with_mujoco(n: int, damping: float = DAMPING) -> Iterator[tuple[str, Solve]]:
    """Its RK4 with steps that are halved."""
    import mujoco

    opening, closing = "", ""
    for k in range(n):
        opening += (
            f'<body pos="{LENGTH if k else 0} 0 0"><joint type="hinge" axis="{" ".join(map(str, AXES[k % 2]))}" '
            f'damping="{damping}"/><inertial pos="{LENGTH / 2} 0 0" mass="{MASS}" '
            f'diaginertia="{" ".join(map(str, INERTIA))}"/>'
        )
        closing += "</body>"
    head = f'<mujoco><option gravity="{GRAVITY} 0 0" integrator="RK4"><flag contact="disable"/></option><worldbody>'
    model = mujoco.MjModel.from_xml_string(head + opening + closing + "</worldbody></mujoco>")
    data = mujoco.MjData(model)
    for k in range(9):
        step = 0.02 / 2**k

        def run(step: float = step) -> Any:
            model.opt.timestep = step
            mujoco.mj_resetData(model, data)
            data.qpos[:] = ANGLE
            mujoco.mj_step(model, data, round(STOP / step))
            return np.concatenate([data.qpos, data.qvel])

        yield f"RK4 {step:.2g} s", run


def with_acausal(compiled: Any, n: int) -> Iterator[tuple[str, Solve]]:
    """`erk`, compiled to C, output at the end only."""
    names = [f"joints[{k}].phi" for k in range(n)] + [f"joints[{k}].w" for k in range(n)]
    places = [compiled.states.index(name) for name in names]
    for tolerance in TOLERANCES:

        def run(tolerance: float = tolerance) -> Any:
            found = acausal.simulate(compiled, solver="erk", tolerance=tolerance, native=True, output_interval=STOP)
            columns = [found.signals[compiled.states[p]] for p in places]
            return np.array([c.sign * found.matrix[-1, c.column] for c in columns])

        yield f"erk {tolerance:.0e}", run


def tuned(runs: Iterator[tuple[str, Solve]], exact: Any, accuracy: float) -> dict[str, tuple[Solve, float]]:
    """Of each method the loosest setting that reaches the accuracy, and its error of angles and speeds."""
    found: dict[str, tuple[Solve, float]] = {}
    done: set[str] = set()
    for name, run in runs:
        method = name.split()[0]
        if method in done:
            continue
        busy = time.process_time()
        error = float(np.abs(run() - exact).max())
        if error <= accuracy:
            found[name] = run, error
        if error <= accuracy or time.process_time() - busy > LONGEST:
            done.add(method)  # tighter settings only cost more
    return found


def fastest(found: dict[str, tuple[Solve, float]], seconds: dict[str, float]) -> dict[str, Any]:
    """The method of a side that took the least time."""
    if not found:
        return {"failure": "none reached the accuracy"}
    name = min(found, key=lambda name: seconds[name])
    return {"setting": name, "seconds": seconds[name], "error": found[name][1]}


def measured(n: int, accuracy: float, damping: float) -> dict[str, Any]:
    """All sides for one length."""
    began = time.perf_counter()
    compiled = acausal.compile(SpatialChain(n=n, d=damping))
    making = time.perf_counter() - began
    ours = list(with_acausal(compiled, n))
    began = time.perf_counter()
    exact = ours[-1][1]()
    native = time.perf_counter() - began
    judge = with_pinocchio(n, damping)
    other = next(run for name, run in judge if name == f"DOP853 {1e-10:.0e}")()
    agreement = float(np.abs(exact - other).max())
    sides = {
        "acausal": tuned(iter(ours), exact, accuracy),
        "pinocchio": tuned(with_pinocchio(n, damping), exact, accuracy),
        "MuJoCo": tuned(with_mujoco(n, damping), exact, accuracy),
    }
    seconds = medians(alternated({name: run for side in sides.values() for name, (run, _) in side.items()}, ROUNDS))
    return {
        "n": n,
        "operations": int(compiled.rhs.n_instructions()),
        "reference: acausal and pinocchio agree to": agreement,
        "compile": making,
        "to C and first run": native,
        **{side: fastest(found, seconds) for side, found in sides.items()},
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--n", default="2,4,8,16,32,64")
    parser.add_argument("--accuracy", type=float, default=1e-6, help="of angles [rad] and speeds [rad/s] at 10 s")
    parser.add_argument("--damping", type=float, default=DAMPING, help="of each hinge [N.m.s/rad]")
    parser.add_argument("--figure", type=Path, help="picture to draw: .png or .svg")
    options = parser.parse_args()
    rows = []
    for n in map(int, options.n.split(",")):
        rows.append(measured(n, options.accuracy, options.damping))
        times = {k: rows[-1][k].get("seconds") for k in ("acausal", "pinocchio", "MuJoCo")}
        print(n, rounded(times), flush=True)
    sides = ("acausal", "pinocchio", "MuJoCo")
    if options.figure:
        lines = {side: [(r["n"], 1e3 * r[side]["seconds"]) for r in rows if "seconds" in r[side]] for side in sides}
        drawn_lines(options.figure, lines, "Links", f"Processor time of a 10 s run,\nerror {options.accuracy:g} [ms]")
    ratios = {
        r["n"]: {s: r[s].get("seconds", math.inf) / r["acausal"].get("seconds", math.inf) for s in sides[1:]}
        for r in rows
    }
    ahead = all(value > 1 for row in ratios.values() for value in row.values())
    report(
        "compiled spatial chains are ahead of pinocchio and MuJoCo at equal accuracy",
        f"{'met' if ahead else 'MISSED'}: "
        + "; ".join(
            f"n={n}: pinocchio {row['pinocchio']:.2g}, MuJoCo {row['MuJoCo']:.2g} times our time"
            for n, row in ratios.items()
        ),
        rounded(
            {
                "met": ahead,
                "accuracy": options.accuracy,
                "damping": options.damping,
                "rows": rows,
                "times ours": {str(k): v for k, v in ratios.items()},
            }
        ),
    )


if __name__ == "__main__":
    main()
