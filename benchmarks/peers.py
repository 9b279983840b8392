"""Claim: at equal accuracy acausal is faster than SciPy, scikit-sundae, numbalsoda, rumoca and jaxonomy, and takes at
most 1.2 times CasADi by hand with the same solver.

Four problems (peer_problems.py). Every side is tuned by its tolerance: of each method, the fastest run counts whose end
values are within the accuracy, by the mixed error with f as in `acausal bench`. Then the sides run in turn at these
settings, and medians of processor time are compared. Times are those of whole calls, including start values, recording
and Python overhead on all sides, but without compilation and first calls. Python right-hand sides use NumPy in the
usual way; jaxonomy and rumoca compile theirs, numbalsoda's are compiled by Numba (peer_numba.py). The hand-written
CasADi system has the same equations and the same solvers, interpreted, with its integrator made beforehand.

    pip install .[benchmark]
    python benchmarks/peers.py [--accuracy 1e-6] [--only Pleiades] [--figure peers.png]
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from measure import alternated, medians, report, rounded
from peer_problems import Problem, problems

import acausal

TOLERANCES = tuple(10.0**-k for k in range(3, 12))
Solve = Callable[[], Any]
Runs = Iterator[tuple[str, float, Solve]]


def ours(problem: Problem) -> Runs:
    """Solvers of acausal, compiled to C."""
    compiled = acausal.compile(problem.model)
    for solver in ("rosenbrock", "idas") if problem.stiff else ("erk", "rosenbrock", "idas"):
        for tolerance in TOLERANCES:

            def run(solver: str = solver, tolerance: float = tolerance) -> Any:
                found = acausal.simulate(
                    compiled,
                    solver=solver,
                    tolerance=tolerance,
                    native=True,
                    stop_time=problem.stop,
                    output_interval=problem.stop,
                )
                columns = [found.signals[name] for name in problem.states]
                return np.array([c.sign * found.matrix[-1, c.column] for c in columns])

            yield solver, tolerance, run


def by_hand(problem: Problem) -> Runs:
    """The solvers that acausal uses, on the equations as CasADi expressions."""
    import casadi as ca

    class Arrays:
        """The NumPy functions that the right-hand sides use, implemented with CasADi."""

        ones = staticmethod(lambda n: ca.SX.ones(n))
        stack = concatenate = staticmethod(lambda parts: ca.vertcat(*parts))

    y = ca.SX.sym("y", len(problem.start))
    rates = problem.rates(y, Arrays) if "Pleiades" not in problem.name else _pleiades(ca, y)
    slope = np.array(ca.Function("f", [y], [rates])(problem.start)).ravel().tolist()
    for solver in ("rosenbrock", "idas") if problem.stiff else ("erk", "rosenbrock", "idas"):
        for tolerance in TOLERANCES:
            options: dict[str, Any] = {"reltol": tolerance, "max_num_steps": 10**6}
            scale = np.array(problem.smallest)
            if solver == "idas":
                options |= {"abstolv": (tolerance * scale).tolist(), "init_xdot": slope, "calc_ic": False}
                dae, start = {"x": y, "ode": rates}, np.array(problem.start)
            else:  # one absolute tolerance: of scaled variables
                options |= {"abstol": tolerance}
                dae, start = {"x": y, "ode": ca.substitute(rates, y, y * scale) / scale}, problem.start / scale
            made = ca.integrator("by_hand", solver, dae, 0.0, problem.stop, options)
            size = np.ones(len(scale)) if solver == "idas" else scale

            def run(made: Any = made, start: Any = start, size: Any = size) -> Any:
                return np.array(made(x0=start)["xf"]).ravel() * size

            yield f"CasADi {solver}", tolerance, run


def _pleiades(ca: Any, y: Any) -> Any:
    x, z = y[:7], y[7:14]
    rates = [y[14:28], ca.SX.zeros(7), ca.SX.zeros(7)]
    for i in range(7):
        for j in (j for j in range(7) if j != i):
            cubed = ((x[i] - x[j]) ** 2 + (z[i] - z[j]) ** 2) ** 1.5
            rates[1][i] += (j + 1) * (x[j] - x[i]) / cubed
            rates[2][i] += (j + 1) * (z[j] - z[i]) / cubed
    return ca.vertcat(*rates)


def scipy(problem: Problem) -> Runs:
    """solve_ivp with a NumPy right-hand side."""
    from scipy.integrate import solve_ivp

    def rates(t: float, y: Any) -> Any:
        return problem.rates(y, np)

    for method in ("Radau", "BDF", "LSODA") if problem.stiff else ("DOP853", "LSODA"):
        for tolerance in TOLERANCES:

            def run(method: str = method, tolerance: float = tolerance) -> Any:
                absolute = tolerance * np.array(problem.smallest)
                span = (0.0, problem.stop)
                found = solve_ivp(rates, span, problem.start, method=method, rtol=max(tolerance, 1e-12), atol=absolute)
                return found.y[:, -1]

            yield f"SciPy {method}", tolerance, run


def sundae(problem: Problem) -> Runs:
    """scikit-sundae's CVODE and IDA."""
    from sksundae.cvode import CVODE
    from sksundae.ida import IDA

    def rates(t: float, y: Any, out: Any) -> None:
        out[:] = problem.rates(y, np)

    def residual(t: float, y: Any, yp: Any, out: Any) -> None:
        out[:] = yp - problem.rates(y, np)

    start = np.array(problem.start)
    for tolerance in TOLERANCES:
        absolute = tolerance * np.array(problem.smallest)
        options = {"rtol": tolerance, "atol": absolute, "max_num_steps": 10**6}

        def cvode(options: Any = options) -> Any:
            method = "BDF" if problem.stiff else "Adams"
            return CVODE(rates, method=method, **options).solve(np.array([0.0, problem.stop]), start).y[-1]

        def ida(options: Any = options) -> Any:
            slope = problem.rates(start, np)
            return IDA(residual, **options).solve(np.array([0.0, problem.stop]), start, slope).y[-1]

        yield "scikit-sundae CVODE", tolerance, cvode
        yield "scikit-sundae IDA", tolerance, ida


def numbalsoda(problem: Problem) -> Runs:
    """LSODA, or DOP853, on a right-hand side compiled by Numba."""
    import numbalsoda as library
    from peer_numba import compiled_rates

    address = compiled_rates(problem.name).address
    start, span = np.array(problem.start), np.array([0.0, problem.stop])
    for method in ("lsoda",) if problem.stiff else ("lsoda", "dop853"):
        solve = getattr(library, method)
        for tolerance in TOLERANCES:

            def run(tolerance: float = tolerance, solve: Any = solve) -> Any:
                found, done = solve(address, start, span, rtol=tolerance, atol=tolerance * min(problem.smallest))
                if not done:
                    raise RuntimeError("not solved")
                return found[-1]

            yield f"numbalsoda {method}", tolerance, run


def rumoca(problem: Problem) -> Runs:
    """Modelica text, its own solvers."""
    import rumoca as library

    model = library.Session().loads(problem.modelica, model=problem.modelica.split()[1])
    names = [state.name for state in model.states]
    if len(names) != len(problem.start):  # an array
        names = [f"{names[0]}[{k + 1}]" for k in range(len(problem.start))]
    for solver in ("bdf", "rk-like"):
        for tolerance in TOLERANCES:
            config = library.SimConfig(
                solver=solver, rtol=tolerance, atol=tolerance * min(problem.smallest), max_wall_seconds=20
            )

            def run(config: Any = config) -> Any:
                found = model.simulate((0.0, problem.stop), dt=problem.stop, config=config)
                return np.asarray(found.to_numpy(names))[:, -1]

            yield f"rumoca {solver}", tolerance, run


def jaxonomy(problem: Problem) -> Runs:
    """A leaf system with a JAX right-hand side; its first call compiles."""
    import jax.numpy as jnp
    import jaxonomy as library

    class System(library.LeafSystem):
        def __init__(self) -> None:
            super().__init__(name="system")
            self.declare_continuous_state(
                default_value=jnp.array(problem.start), ode=lambda t, s, *u, **p: problem.rates(s.continuous_state, jnp)
            )
            self.declare_continuous_state_output(name="y")

    system = System()
    context = system.create_context()
    for method in ("bdf",) if problem.stiff else ("dopri5",):
        for tolerance in TOLERANCES[:8]:
            options = library.SimulatorOptions(
                ode_solver_method=method, rtol=tolerance, atol=tolerance * min(problem.smallest), math_backend="jax"
            )

            def run(options: Any = options) -> Any:
                found = library.simulate(system, context, (0.0, problem.stop), options=options)
                return np.asarray(found.context.continuous_state)

            yield f"jaxonomy {method}", tolerance, run


SIDES = {
    "acausal": ours,
    "CasADi by hand": by_hand,
    "SciPy": scipy,
    "scikit-sundae": sundae,
    "numbalsoda": numbalsoda,
    "rumoca": rumoca,
    "jaxonomy": jaxonomy,
}


def tuned(runs: Runs, exact: Any, floor: Any, accuracy: float) -> tuple[dict[str, dict[str, Any]], dict[str, str]]:
    """The loosest setting of each method that reaches the accuracy, or the reason why there is none.

    A method is abandoned if a run takes more than 20 s.
    """
    found: dict[str, dict[str, Any]] = {}
    reasons: dict[str, str] = {}
    slow: set[str] = set()
    for name, tolerance, run in runs:
        if name in found or name in slow:
            continue
        busy = time.process_time()
        try:
            values = run()
        except Exception as error_of_peer:
            reasons[name] = str(error_of_peer).splitlines()[0][:80]
            continue
        busy = time.process_time() - busy
        error = float((np.abs(values - exact) / (floor + np.abs(exact))).max())
        if error <= accuracy:
            found[name] = {"tolerance": tolerance, "error": error, "first call": busy, "run": run}
        else:
            reasons[name] = f"error {error:.1e} at {tolerance:.0e}"
        if busy > 20.0:
            slow.add(name)
    return found, reasons


def measured(problem: Problem, accuracy: float, repeat: int) -> dict[str, Any]:
    """All sides on one problem."""
    compiled = acausal.compile(problem.model)
    run = acausal.simulate(compiled, solver="rosenbrock", tolerance=1e-12, stop_time=problem.stop, native=True)
    exact = np.array([float(run.final(name)) for name in problem.states])
    # f of the mixed error, as in acausal bench: the magnitude of a variable, from a thousandth of its nominal one to 1
    floor = np.clip(np.abs(exact), problem.smallest, 1.0)
    row: dict[str, Any] = {}
    methods: dict[str, dict[str, dict[str, Any]]] = {}
    for side, runs in SIDES.items():
        try:
            methods[side], reasons = tuned(runs(problem), exact, floor, accuracy)
        except ImportError as error:
            reasons = {side: f"not installed: {error.name}"}
        except Exception as error:
            reasons = {side: f"{type(error).__name__}: {str(error).splitlines()[0][:100]}"}
        if not methods.get(side):
            row[side] = {"failure": "; ".join(f"{name}: {why}" for name, why in reasons.items())}
    for side, found in methods.items():  # a method that takes seconds is not repeated if another one is faster
        quickest = min((m["first call"] for m in found.values()), default=0.0)
        methods[side] = {name: m for name, m in found.items() if m["first call"] <= max(quickest, 1.0)}
    jobs = {f"{side}: {name}": m.pop("run") for side, found in methods.items() for name, m in found.items()}
    seconds = medians(alternated(jobs, repeat))
    for side, found in methods.items():
        each = {name: seconds[f"{side}: {name}"] for name in found}
        if each:
            best = min(each, key=lambda name, each=each: each[name])  # type: ignore[misc]
            row[side] = {"setting": best, "seconds": each[best], **found[best], "each": each}
    for side, figures in row.items():
        print(problem.name, side, rounded(figures), flush=True)
    return row


def drawn(rows: dict[str, dict[str, Any]], accuracy: float, file: Path) -> None:
    """Times by problem, a bar for each side."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 4.2), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    for k, side in enumerate(SIDES):
        places = [p + 0.12 * (k - 3) for p, row in enumerate(rows.values()) if "seconds" in row[side]]
        axes.bar(
            places, [1e3 * row[side]["seconds"] for row in rows.values() if "seconds" in row[side]], 0.11, label=side
        )
    axes.set_yscale("log")
    axes.set_xticks(range(len(rows)), list(rows))
    axes.set_ylabel(f"Solve time at an error of {accuracy:g} [ms]")
    axes.grid(True, axis="y", color="0.9")
    axes.set_axisbelow(True)
    axes.legend(frameon=False, fontsize=8, ncols=3)
    figure.savefig(file, dpi=150)


def _solvers(side: dict[str, Any]) -> dict[str, float]:
    return {name.removeprefix("CasADi "): seconds for name, seconds in side.get("each", {}).items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--accuracy", type=float, default=1e-6)
    parser.add_argument("--only", default="", help="beginning of a problem's name")
    parser.add_argument("--repeat", type=int, default=5)
    parser.add_argument("--figure", type=Path)
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    chosen = [p for p in problems() if p.name.startswith(options.only)]
    rows = {p.name: measured(p, options.accuracy, options.repeat) for p in chosen}
    if options.figure:
        drawn(rows, options.accuracy, options.figure)
    factors = {
        name: {s: r["seconds"] / row["acausal"]["seconds"] for s, r in row.items() if s != "acausal" and "seconds" in r}
        for name, row in rows.items()
        if "seconds" in row["acausal"]
    }
    same = {
        name: {
            s: row["acausal"]["each"][s] / t
            for s, t in _solvers(row["CasADi by hand"]).items()
            if s in _solvers(row["acausal"])
        }
        for name, row in rows.items()
    }
    line = "; ".join(f"{name}: " + ", ".join(f"{s} {f:.2g}" for s, f in row.items()) for name, row in factors.items())
    report(
        "at equal accuracy faster than peers",
        f"times ours: {line}",
        rounded({"rows": rows, "times ours": factors, "ours / CasADi by hand with the same solver": same}),
    )


if __name__ == "__main__":
    main()
