"""Claim: the equations found for a spatial chain cost at most 1.2 times an articulated-body algorithm by hand.

`SpatialChain` of scenes.py is compared with Featherstone's recursion written for CasADi, link by link, with sparse 6x6
matrices and all parameters as numbers (R. Featherstone, Rigid Body Dynamics Algorithms, 2008, table 7.1). Both
right-hand sides are compiled to C in the same way and must agree. With the same integrator, run times have the same
ratio.

    python benchmarks/chain_by_hand.py --n 2,4,8,16,32,64
"""

from __future__ import annotations

import argparse
import time
from typing import Any

import casadi as ca
import numpy as np
from chains_vs_robotics import GRAVITY
from measure import report, rounded
from scenes import AXES, DAMPING, INERTIA, LENGTH, MASS, SpatialChain

import acausal
from acausal.simulate.native.cache import native
from acausal.study.bench.measure import processor_clock


def skew(v: Any) -> Any:
    """Matrix of the cross product."""
    return ca.sparsify(ca.vertcat(ca.horzcat(0, -v[2], v[1]), ca.horzcat(v[2], 0, -v[0]), ca.horzcat(-v[1], v[0], 0)))


def crossing(v: Any) -> Any:
    """Matrix of the cross product of motions."""
    w = skew(v[:3])
    return ca.vertcat(ca.horzcat(w, ca.SX(3, 3)), ca.horzcat(skew(v[3:]), w))


def _transform(k: int, angle: Any) -> tuple[Any, Any]:
    """Motions of link k - 1 to link k, and the axis of the joint."""
    c, s = ca.cos(angle), ca.sin(angle)
    axis = ca.SX(6, 1)
    if AXES[k % 2][2]:
        turn = ca.vertcat(ca.horzcat(c, s, 0), ca.horzcat(-s, c, 0), ca.horzcat(0, 0, 1))
        axis[2] = 1
    else:
        turn = ca.vertcat(ca.horzcat(c, 0, -s), ca.horzcat(0, 1, 0), ca.horzcat(s, 0, c))
        axis[1] = 1
    turn = ca.sparsify(turn)
    arm = skew(ca.SX([LENGTH if k else 0.0, 0.0, 0.0]))
    return ca.sparsify(ca.vertcat(ca.horzcat(turn, ca.SX(3, 3)), ca.horzcat(-turn @ arm, turn))), axis


def articulated_body(n: int) -> Any:
    """`(t, [q, v]) -> d/dt`, SX."""
    q, v = ca.SX.sym("q", n), ca.SX.sym("v", n)
    to_centre = skew(ca.SX([LENGTH / 2, 0.0, 0.0]))
    top = ca.horzcat(ca.diag(ca.SX(INERTIA)) + MASS * to_centre @ to_centre.T, MASS * to_centre)
    inertia = ca.sparsify(ca.vertcat(top, ca.horzcat(MASS * to_centre.T, MASS * ca.SX.eye(3))))
    X, S, bias, IA, pA = [], [], [], [], []
    velocity = ca.SX(6, 1)
    for k in range(n):
        x, s = _transform(k, q[k])
        velocity = x @ velocity + s * v[k]
        X.append(x)
        S.append(s)
        bias.append(crossing(velocity) @ (s * v[k]))
        IA.append(inertia)
        pA.append(-crossing(velocity).T @ (inertia @ velocity))
    U, D, u = [None] * n, [None] * n, [None] * n
    for k in reversed(range(n)):
        U[k] = IA[k] @ S[k]
        D[k] = S[k].T @ U[k]
        u[k] = -DAMPING * v[k] - S[k].T @ pA[k]
        if k:
            Ia = IA[k] - U[k] @ U[k].T / D[k]
            IA[k - 1] = IA[k - 1] + X[k].T @ Ia @ X[k]
            pA[k - 1] = pA[k - 1] + X[k].T @ (pA[k] + Ia @ bias[k] + U[k] * (u[k] / D[k]))
    acceleration = ca.vertcat(0, 0, 0, -GRAVITY, 0, 0)
    rates = []
    for k in range(n):
        acceleration = X[k] @ acceleration + bias[k]
        rates.append((u[k] - U[k].T @ acceleration) / D[k])
        acceleration = acceleration + S[k] * rates[-1]
    return ca.Function("by_hand", [ca.SX.sym("t"), ca.vertcat(q, v)], [ca.vertcat(v, *rates)])


def microseconds(function: Any, x: Any) -> float:
    """Time of one evaluation, the minimum of several rounds."""
    memory, evaluate = function.buffer()
    t, out = np.zeros(1), np.zeros(len(x))
    memory.set_arg(0, memoryview(t))
    memory.set_arg(1, memoryview(x))
    memory.set_res(0, memoryview(out))
    best = np.inf
    for _ in range(9):
        began = time.process_time()
        for _ in range(2000):
            evaluate()
        best = min(best, time.process_time() - began)
    return 1e6 * best / 2000


def measured(n: int) -> dict[str, Any]:
    """Measurements of both sides for one length."""
    began = time.process_time()
    compiled = acausal.compile(SpatialChain(n=n), cache=False)
    making = time.process_time() - began
    t, x = ca.SX.sym("t"), ca.SX.sym("x", 2 * n)
    ode, _ = compiled.rhs(t, x, [], [], compiled.parameter_values, [])
    ours, other = ca.Function("ours", [t, x], [ode]), articulated_body(n)
    names = [f"joints[{k}].{name}" for name in ("phi", "w") for k in range(n)]
    place = [compiled.states.index(name) for name in names]
    point = np.random.default_rng(1).standard_normal(2 * n)
    mine = np.zeros(2 * n)
    mine[place] = point
    expected = np.array(other(0.0, point)).ravel()
    difference = np.abs(np.array(ours(0.0, mine)).ravel()[place] - expected).max() / np.abs(expected).max()
    times = [microseconds(native(f) or f, y) for f, y in ((ours, mine), (other, point))]
    return {
        "n": n,
        "compile [s]": making,
        "operations per link": {"acausal": ours.n_instructions() / n, "by hand": other.n_instructions() / n},
        "evaluation [us]": dict(zip(("acausal", "by hand"), times, strict=True)),
        "ratio": times[0] / times[1],
        "relative difference": float(difference),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--n", default="2,4,8,16,32,64")
    options = parser.parse_args()
    processor_clock()
    rows = [measured(int(n)) for n in options.n.split(",")]
    worst = max(row["ratio"] for row in rows)
    line = f"{'met' if worst <= 1.2 else 'MISSED'}: at most {worst:.3g} times the evaluation by hand"
    report("spatial chains cost at most 1.2 times an articulated-body algorithm by hand", line, rounded({"rows": rows}))


if __name__ == "__main__":
    main()
