"""Comparison of runs of the full and the reduced model: times, errors of outputs, lags of quasi-static states."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from functools import partial
from typing import Any

import casadi as ca
import numpy as np

from acausal.arrays import Vector
from acausal.errors import AcausalError, UsageError
from acausal.lower.build import Symbols
from acausal.lower.compiled import CompiledModel
from acausal.result.result import Result
from acausal.simulate.run import simulate
from acausal.study.repeated import unheard

_ROUNDING = 1e-13


@dataclass(frozen=True)
class OutputError:
    """Largest difference of an output, absolute and relative to its largest magnitude, with its time [s]."""

    name: str
    absolute: float
    relative: float
    time: float


@dataclass(frozen=True)
class Comparison:
    """Times and errors of runs of both models."""

    seconds: Mapping[str, float]  # shortest time of a run including its outputs, "full" and "reduced"
    integrate: Mapping[str, float]  # the integration alone
    steps: Mapping[str, float]  # steps of the solver, if it counts them
    compile: Mapping[str, float]  # compile times [s]
    errors: tuple[OutputError, ...]  # of every output
    # Lag of quasi-static states, estimated from the reduced run alone; None without such states.
    estimate: Mapping[str, Any] | None
    failed: str | None  # reason why there is no comparison, else None

    def speed(self) -> dict[str, Any]:
        """Times and their ratios, for JSON."""
        gained = None if self.failed else self.seconds["full"] / self.seconds["reduced"]
        return {
            "seconds": dict(self.seconds),
            "integrate": dict(self.integrate),
            "steps": dict(self.steps),
            "compile": dict(self.compile),
            "gained": gained,
        }

    def lines(self) -> Iterator[str]:
        """Lines of the comparison as text."""
        if self.failed:
            yield f"  no comparison: {self.failed}"
        else:
            full, reduced = (1e3 * self.seconds[k] for k in ("full", "reduced"))
            ratio = f"{full / reduced:.2f} times as fast"
            yield f"  run up to its outputs: {full:.3g} ms full, {reduced:.3g} ms reduced: {ratio}"
            steps = {k: v for k, v in self.steps.items() if v}
            if len(steps) == 2:
                yield f"  steps: {steps['full']:.0f} full, {steps['reduced']:.0f} reduced"
            for e in self.errors:
                yield f"  error of {e.name}: {e.absolute:.2g}, {e.relative:.1g} of its largest value"
        if self.estimate:
            lags = self.estimate["states"]
            for name, value in lags.items():
                if value is not None:
                    yield f"  {name} is ahead by up to {value:.2g} (estimated)"
            if unknown := [name for name, value in lags.items() if value is None]:
                yield f"  no estimate for {', '.join(unknown)}: add them to the outputs to get one"
            slowest = self.estimate["slowest"]
            if slowest > 0:
                yield f"  the modes left out have time constants of at most {slowest:.2g} s"
            else:
                yield "  a mode left out grows: the full model does not approach this quasi-static limit"


def compare_runs(
    full: CompiledModel,
    reduced: CompiledModel,
    outputs: Sequence[str],
    repeat: int,
    options: Mapping[str, Any],
    runs: Mapping[str, Callable[..., Result]] | None = None,
    called: Callable[[str], str] = str,
) -> Comparison:
    """Run both models alternately, so that both see the same load of the machine.

    `runs` replaces the functions that run "full" and "reduced"; `called` maps an output to its name in the full result.
    """
    compile_times = {"full": sum(full.timings.values()), "reduced": sum(reduced.timings.values())}
    runs = runs or {"full": partial(simulate, full), "reduced": partial(simulate, reduced)}
    names = {"full": [called(name) for name in outputs], "reduced": list(outputs)}
    seconds: dict[str, list[float]] = {"full": [], "reduced": []}
    integration: dict[str, list[float]] = {"full": [], "reduced": []}
    results: dict[str, Result] = {}
    options = {"native": False, **options}
    try:
        for k in range(1 + max(1, repeat)):  # the first is a warm-up
            for name, run in runs.items():
                with unheard() if k else nullcontext():
                    start = clock.perf_counter()
                    results[name] = run(**options)
                    for output in names[name]:
                        _ = results[name][output]
                    seconds[name].append(clock.perf_counter() - start)
                times: Mapping[str, float] = results[name].stats["time"]  # type: ignore[assignment]
                integration[name].append(times["integrate"])
    except AcausalError as error:
        if isinstance(error, UsageError) and not results:
            raise  # a wrong option
        which = "full" if "reduced" in results or "full" not in results else "reduced"
        failed = f"the {which} model did not run: {error.fact}"
        return Comparison({}, {}, {}, compile_times, (), None, failed)
    return Comparison(
        seconds={name: min(values[1:]) for name, values in seconds.items()},
        integrate={name: min(values[1:]) for name, values in integration.items()},
        steps={name: float(r.stats.get("steps", 0.0)) for name, r in results.items()},  # type: ignore[arg-type]
        compile=compile_times,
        errors=tuple(error_of(results["full"], results["reduced"], name, called(name)) for name in outputs),
        estimate=lag(full, reduced, results["reduced"]),
        failed=None,
    )


def error_of(full: Result, reduced: Result, name: str, called: str | None = None) -> OutputError:
    """The largest difference of one output at common times; `called` is its name in the full result.

    Events that both runs have at the same time, such as samples, are compared before and after; a time at which only
    one of them has an event is left out. Everything is nan without a common time.
    """
    times = _comparable_times(full, reduced)
    if not len(times):
        return OutputError(name, np.nan, np.nan, np.nan)
    a, b = (
        np.concatenate([r[n][np.searchsorted(r.time, times)], r[n][np.searchsorted(r.time, times, "right") - 1]])
        for r, n in ((full, called or name), (reduced, name))
    )
    # nan in both is no difference; nan in the full result under another name is a contact that does not exist there
    absent = np.isnan(a) & (np.isnan(b) | (called is not None and called != name))
    difference = np.where(absent, 0.0, np.abs(a - b))
    k = int(np.argmax(difference))
    worst, size = float(difference[k]), float(np.nanmax(np.abs(a), initial=0.0))
    # an output that is zero up to rounding errors has no relative error
    relative = worst / size if size > _ROUNDING else worst
    return OutputError(name, worst, relative, float(times[k % len(times)]))


def _comparable_times(one: Result, other: Result) -> Vector:
    """Times that occur once in both results, or as an event in both, shape (n,)."""
    (values, count), (others, count_of_other) = (np.unique(r.time, return_counts=True) for r in (one, other))
    common, i, k = np.intersect1d(values, others, assume_unique=True, return_indices=True)
    return np.asarray(common[(count[i] > 1) == (count_of_other[k] > 1)])


_MOST_POINTS = 400


def lag(full: CompiledModel, reduced: CompiledModel, result: Result) -> dict[str, Any] | None:
    """Largest lag of every fast state by name, and the slowest of their time constants [s]; None without fast states.

    Lags are None if the reduced run lacks a variable needed to compute them. The time constant is -1 if a mode grows.
    Modes are evaluated at up to 400 points of the run. The lag after an event, as large as the jump of the limit, is
    not included. With x' = f(x, y) and J = df/dx, a state lags behind its limit x0(y) by J^-1 dx0/dt, to first order in
    the slowest time constant of its modes, -1 / max Re eig(J).

    Source: P. Kokotovic, H. Khalil, J. O'Reilly, Singular Perturbation Methods in Control (1986), chapter 1.
    """
    selection = reduced.selection
    fast = [item.name for item in selection.dropped if item.kind == "quasi-static"] if selection is not None else []
    rows = [k for k, name in enumerate(full.states) if name in fast]
    if not rows:
        return None
    names = [*full.states, *full.algebraic]
    count = len(result.time)
    points = np.unique(np.linspace(0, count - 1, min(count, _MOST_POINTS)).astype(int))
    values = np.array([_value(result, name) for name in names])
    x, z = values[: len(full.states)], values[len(full.states) :]
    rates = _rates(result.time, x[rows])
    jacobian = _jacobian(full, rows)
    p = np.array(full.parameter_values)
    u = np.array([_value(result, name) for name in full.inputs]).reshape(len(full.inputs), count)
    # variables on which no output depends are not in the reduced result
    present = np.array([name in result for name in names[: len(full.states)]])
    needed = np.array(ca.DM(jacobian.jac_sparsity(0, 1), 1.0)).any(axis=0)
    is_computable = bool(present[rows].all() and not (needed & ~present).any())
    worst = np.zeros(len(rows))
    slowest = 0.0
    for k in points:
        t = float(result.time[k])
        m = np.array(full.all_modes(t, x[:, k], z[:, k], u[:, k], p)).ravel()
        J = np.array(jacobian(t, x[:, k], z[:, k], u[:, k], p, m))
        if not np.isfinite(J).all() or np.linalg.cond(J) > 1e14:
            continue
        worst = np.maximum(worst, np.abs(np.linalg.solve(J, rates[:, k])))
        decay = -float(np.max(np.linalg.eigvals(J).real))
        slowest = -1.0 if decay <= 0.0 or slowest < 0.0 else max(slowest, 1.0 / decay)
    lags = {full.states[r]: float(w) if is_computable else None for r, w in zip(rows, worst, strict=True)}
    return {"states": lags, "slowest": slowest}


def _value(result: Result, name: str) -> Vector:
    """A trajectory, shape (n,); zero for variables that were left out because no output depends on them."""
    return np.asarray(result[name]) if name in result else np.zeros(len(result.time))


def _rates(time: Vector, values: Vector) -> Vector:
    """Forward difference quotients of trajectories, shape (rows, n); 0 across events."""
    steps = np.diff(time)
    slopes = np.zeros_like(values)
    inside = steps > 0.0
    between = np.zeros((len(values), len(steps)))
    between[:, inside] = np.diff(values)[:, inside] / steps[inside]
    slopes[:, :-1] = between
    slopes[:, -1] = between[:, -1] if len(steps) else 0.0
    return slopes


def _jacobian(full: CompiledModel, rows: list[int]) -> Any:
    """`(t, x, z, u, p, m) -> d(rates of fast states)/d(fast states)`, with algebraic variables eliminated."""
    s = Symbols(full)
    ode, alg = full.rhs(*s.inputs)
    f = ode[rows]
    J = ca.jacobian(f, s.x)[:, rows]
    if len(full.algebraic):
        gx = ca.jacobian(alg, s.x)[:, rows]
        J = J - ca.mtimes(ca.jacobian(f, s.z), ca.solve(ca.densify(ca.jacobian(alg, s.z)), ca.densify(gx)))
    return ca.Function("fast", s.inputs, [ca.densify(J)])
