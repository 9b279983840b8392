"""Claim: a stiff field by the method of lines costs at most 1.5 times a hand-written CasADi system in the same IDAS.

The medical problem of Akzo Nobel (E. Hairer, G. Wanner, Solving Ordinary Differential Equations II; Bari test set:
medakzo): diffusion of an antibody into a tissue, two species on n cells, declared one behind the other, u[0..n-1] and
v[0..n-1], as two vector equations. The hand-written side has the same equations as SX with interleaved states, u[0],
v[0], u[1] ..., the best order for a band matrix; it keeps its integrators. Errors are those of the last row relative to
a run at a hundredth of the tolerance.
"""

from __future__ import annotations

import argparse
from time import process_time
from typing import Any

import casadi as ca
import numpy as np
from measure import alternated, medians, ratios, report, rounded

import acausal
from acausal import (
    Component,
    Equations,
    Real,
    as_expr,
    concatenate,
    der,
    fixed,
    parameter,
    quantity,
    time,
    variable,
    where,
)

ALLOWED, END, SWITCH, C = 1.5, 10.0, 5.0, 4.0


def coefficients(n: int) -> tuple[np.ndarray, np.ndarray, float]:
    """Coefficients of the second and the first derivative, and the width of a cell."""
    dz = 1.0 / n
    z = dz * (np.arange(n) + 1)
    return (z - 1.0) ** 4 / C**2, 2.0 * (z - 1.0) ** 3 / C**2, dz


def model(n: int) -> Component:
    alpha, beta, dz = coefficients(n)

    class MedicalAkzoNobel(Component):
        k: Real = parameter(default=100.0)
        u: Real = variable(shape=n, default=fixed(0.0))
        v: Real = variable(shape=n, default=fixed(1.0))
        phi: Real = variable()

        def equations(self) -> Equations:
            yield self.phi == where(time < quantity(SWITCH, "s"), 2.0, 0.0)
            left, right = concatenate(self.phi, self.u[:-1]), concatenate(self.u[1:], self.u[-1])
            bent, slope = (left - 2.0 * self.u + right) / dz**2, (right - left) / (2.0 * dz)
            reaction = self.k * self.u * self.v
            yield der(self.u) == as_expr(alpha) * bent + as_expr(beta) * slope - reaction
            yield der(self.v) == -reaction

    return MedicalAkzoNobel()


def by_hand(n: int, tolerance: float) -> Any:
    """A function that integrates the hand-written system and returns the final u."""
    alpha, beta, dz = coefficients(n)
    u, v, phi = ca.SX.sym("u", n), ca.SX.sym("v", n), ca.SX.sym("phi")
    left, right = ca.vertcat(phi, u[:-1]), ca.vertcat(u[1:], u[-1])
    reaction = 100.0 * u * v
    du = alpha * (left - 2.0 * u + right) / dz**2 + beta * (right - left) / (2.0 * dz) - reaction
    x, f = (ca.vec(ca.horzcat(a, b).T) for a, b in ((u, v), (du, -reaction)))
    options = {"reltol": tolerance, "abstol": 1e-3 * tolerance, "linear_solver": "qr"}
    integrate = ca.integrator("field", "idas", {"x": x, "p": phi, "ode": f}, 0.0, np.linspace(0.02, 5.0, 250), options)
    start = np.column_stack([np.zeros(n), np.ones(n)]).ravel()

    def run() -> np.ndarray:
        middle: Any = integrate(x0=start, p=2.0)["xf"][:, -1]
        end: Any = integrate(x0=middle, p=0.0)["xf"][:, -1]
        return np.array(end).ravel()[0::2]

    return run


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cells", type=int, nargs="*", default=[400, 2000])
    parser.add_argument("--repeat", type=int, default=7)
    parser.add_argument("--tolerance", type=float, default=1e-6)
    options = parser.parse_args()
    rows = {}
    acausal.compile(model(4))
    for n in options.cells:
        began = process_time()
        compiled = acausal.compile(model(n))
        compiling = process_time() - began

        def run(tolerance: float = options.tolerance, compiled: Any = compiled) -> np.ndarray:
            result = acausal.simulate(compiled, stop_time=END, tolerance=tolerance, output_interval=0.02)
            return np.asarray(result.final("u"))

        # With the local error tolerance that acausal uses, and with that given by the user.
        hands = {share: by_hand(n, share * options.tolerance) for share in (1.0, 0.01)}
        exact = run(1e-2 * options.tolerance)
        jobs = {"acausal": run, **{f"hand at {share:g}": job for share, job in hands.items()}}
        errors = {name: float(np.abs(job() - exact).max()) for name, job in jobs.items()}
        seconds = alternated(jobs, options.repeat)
        rows[n] = {
            "compiling": compiling,
            "seconds": medians(seconds),
            "ratio": ratios(seconds, "acausal"),
            "errors": errors,
        }
    worst = max(row["ratio"]["hand at 0.01"] for row in rows.values())
    told = "; ".join(
        f"{n} cells compiled in {row['compiling']:.2f} s, run in {1e3 * row['seconds']['acausal']:.0f} ms, "
        + ", ".join(f"{r:.2f} of {name}" for name, r in row["ratio"].items())
        for n, row in rows.items()
    )
    report(
        f"a stiff field within {ALLOWED} of CasADi by hand at its accuracy",
        told,
        rounded({"met": worst <= ALLOWED, "cells": rows}),
    )


if __name__ == "__main__":
    main()
