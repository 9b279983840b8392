"""Claim: equations of repeated components by patterns run no slower, and C of large models is made in seconds.

Compares a model with every instance in its equations (`flat`) with the same model by patterns, as operations on columns
(`columns`): evaluations of right-hand side and Jacobian, the creation of an IDAS integrator, a whole run with each
solver, and C of a whole integrator (size, seconds of the C compiler, a run with it). `--prototype` compares the forms
on a ladder written by hand: flat, columns, and `Function.map` of one small function.

Times are seconds of processor time, the fastest of several repetitions in turn.
"""

from __future__ import annotations

import argparse
import gc
import os
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from importlib import import_module
from typing import Any

import numpy as np

SIZES = {"ladder": (300, 1000, 10_000), "chain": (100, 400, 5000)}
QUICK = {"ladder": (300, 1000), "chain": (400,)}
FORMS = ("flat", "columns")


def fastest(jobs: Mapping[str, Callable[[], Any]], repetitions: int) -> dict[str, float]:
    """Processor seconds of each job, one of each in turn."""
    found: dict[str, float] = {}
    for _ in range(repetitions):
        for name, job in jobs.items():
            gc.collect()
            began = time.process_time()
            job()
            spent = time.process_time() - began
            found[name] = min(found.get(name, spent), spent)
    return found


def times(function: Any, arguments: list[Any], count: int) -> Callable[[], None]:
    """A job of `count` calls without Python overhead."""
    buffer, run = function.buffer()
    held = [np.array(a, dtype=float).ravel() for a in arguments]
    held += [np.zeros(max(1, function.nnz_out(k))) for k in range(function.n_out())]
    for k, a in enumerate(held):
        if a.size and k < len(arguments):
            buffer.set_arg(k, a.data)
        elif k >= len(arguments):
            buffer.set_res(k - len(arguments), a.data)

    def calls() -> None:
        for _ in range(count):
            run()

    calls.alive = function, buffer, held  # type: ignore[attr-defined]  # `run` keeps none of them
    return calls


def evaluated(dae: Mapping[str, Any], repetitions: int) -> None:
    """Print times of evaluations of oracles `(t, x, z, p, u)`, and of the creation of their integrators."""
    import casadi as ca

    made = {
        n: lambda f=f: ca.integrator("i", "idas", f, 0.0, [1.0], {"linear_solver": "csparse"}) for n, f in dae.items()
    }
    slopes = {n: made[n]().get_function("jacF") for n in dae}
    rng, count = np.random.default_rng(0), 50
    for what, functions, scale in (("right-hand side", dae, count), ("Jacobian", slopes, count)):
        jobs = {}
        for name, f in functions.items():
            jobs[name] = times(f, [rng.uniform(0.5, 1.0, f.numel_in(k)) for k in range(f.n_in())], scale)
        line(what, {n: v / scale * 1e6 for n, v in fastest(jobs, repetitions).items()}, "us")
    line("making IDAS", {n: v * 1e3 for n, v in fastest(made, repetitions).items()}, "ms")


def line(what: str, values: Mapping[str, float], unit: str) -> None:
    print(f"  {what:24}" + "".join(f"{name} {v:9.2f} {unit}  " for name, v in values.items()), flush=True)


def forms(compiled: Any) -> dict[str, Any]:
    """The model lowered in each form, as separate objects because caches belong to the object."""
    flat = replace(compiled)
    flat.__dict__["mapped"] = lambda zeros=(): None
    return {"flat": flat, "columns": compiled}


def measured(family: str, n: int, solvers: list[str], repetitions: int, native: bool) -> None:
    """Print all figures of one size."""
    import acausal
    from acausal.models.mass_chain import MassSpringDamperChain
    from acausal.models.rc_ladder import RCLadder
    from acausal.simulate.equations.scaled import ScaledEquations

    compiled = acausal.compile({"ladder": RCLadder, "chain": MassSpringDamperChain}[family](n=n), cache=False)
    p = np.array(compiled.parameter_values)
    zeros = tuple(np.flatnonzero(p == 0.0).tolist())
    began = time.process_time()
    form = compiled.mapped(zeros)
    spent = time.process_time() - began
    print(f"{family} {n}: {compiled.rhs.n_instructions()} instructions, ", end="")
    print(f"{form.operations if form else 'no'} operations on columns, found in {spent:.2f} s")
    if form is None:
        return
    models = forms(compiled)
    values = p, np.zeros(0)
    evaluated({name: ScaledEquations(model, zeros, values).dae for name, model in models.items()}, repetitions)
    for solver in solvers:
        jobs = {name: partial(run, models, name, solver, False) for name in FORMS}
        line(f"run, {solver}", {k: v * 1e3 for k, v in fastest(jobs, repetitions).items()}, "ms")
        if native and solver in ("rosenbrock", "erk"):
            compiled_c(models, solver, repetitions)


def run(models: Mapping[str, Any], form: str, solver: str, native: bool) -> Any:
    """One run of a form; the number in the key of a library distinguishes the forms."""
    import acausal

    cache, equations = (import_module(f"acausal.simulate.native.{m}") for m in ("cache", "equations"))
    cache._FORMAT, equations._LARGEST_FLAT = f"benchmark {form}", 0
    return acausal.simulate(models[form], solver=solver, native=native)


def compiled_c(models: Mapping[str, Any], solver: str, repetitions: int) -> None:
    """Print size and time of the C of both forms, and of runs with it."""
    cache = import_module("acausal.simulate.native.cache")
    build, sizes, seconds = cache.build, {}, {}

    def watched(key: str, source: str) -> Any:
        before = os.times().children_user
        found = build(key, source)
        sizes[form], seconds[form] = len(source) / 1e3, os.times().children_user - before
        return found

    def again(form: str) -> None:
        assert run(models, form, solver, True).stats["native"]

    cache.build = watched
    for form in FORMS:
        again(form)
    cache.build = build
    line(f"C, {solver}", sizes, "kB")
    line("   C compiler", seconds, "s ")
    runs = fastest({form: partial(again, form) for form in FORMS}, repetitions)
    line("   run of it", {form: v * 1e3 for form, v in runs.items()}, "ms")


def prototype(n: int) -> dict[str, Any]:
    """C*dv[k]/dt = (v[k-1] - 2*v[k] + v[k+1])/R by hand in three forms."""
    import casadi as ca

    def oracle(kind: Any, rate: Callable[[Any, Any], Any]) -> Any:
        x, p, none = kind.sym("x", n), kind.sym("p", 3), kind(0, 1)
        inputs = [kind.sym("t"), x, kind.sym("z", 0), p, kind.sym("u", 0)]
        return ca.Function(
            "dae", inputs, [rate(x, p), none, none, none], ["t", "x", "z", "p", "u"], ["ode", "alg", "quad", "zero"]
        )

    before, behind = [n + 2, *range(n - 1)], [*range(1, n), n - 1]
    v, q = ca.SX.sym("v", 3), ca.SX.sym("q", 3)
    one = ca.Function("one", [v, q], [((v[0] - v[1]) / q[0] - (v[1] - v[2]) / q[0]) / q[1]])
    neighbours = np.array([before, range(n), behind]).T.ravel().tolist()

    def columns(x: Any, p: Any) -> Any:
        known = ca.vertcat(x, p)
        return ((known[before] - x) / p[0] - (x - known[behind]) / p[0]) / p[1]

    def mapped(x: Any, p: Any) -> Any:
        known = ca.vertcat(x, p)
        all_of_them: Any = one.map("all", "serial", n, [1], [])
        return all_of_them(ca.reshape(known[neighbours], 3, n), p).T

    return {
        "flat": oracle(ca.SX, columns),
        "columns": oracle(ca.MX, columns),
        "map": oracle(ca.MX, mapped),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--quick", action="store_true", help="leave out the largest models")
    parser.add_argument("--prototype", action="store_true", help="only the forms of a ladder by hand")
    parser.add_argument("--case", nargs=2, metavar=("FAMILY", "N"), help="one size")
    parser.add_argument("--solvers", nargs="*", default=["idas", "erk", "rosenbrock"])
    parser.add_argument("--no-c", action="store_true", help="leave out compiled runs")
    parser.add_argument("--repetitions", type=int, default=5)
    given = parser.parse_args()
    if given.prototype:
        for n in (1000, 10_000):
            print(f"ladder {n} by hand")
            evaluated(prototype(n), given.repetitions)
        return
    sizes = QUICK if given.quick else SIZES
    cases = [(f, n) for f, all_n in sizes.items() for n in all_n] if given.case is None else [given.case]
    with tempfile.TemporaryDirectory() as folder:
        os.environ["ACAUSAL_CACHE"] = folder
        for family, n in cases:
            measured(family, int(n), given.solvers, given.repetitions, not given.no_c)


if __name__ == "__main__":
    main()
