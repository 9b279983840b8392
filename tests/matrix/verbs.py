"""Everything that can be done with a model, as functions that compare with its solution or raise.

A verb may end in three ways: silently, if what it gave is right; with an `AcausalError` whose code is no internal one,
if it refuses; with an `AssertionError` or anything else, which is a defect.
"""

from __future__ import annotations

import pickle
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

import acausal
from acausal import Component, Result
from tests.matrix.features import Feature

Array = NDArray[np.float64]
Verb = Callable[[Feature], None]
TOLERANCE = 1e-8
ROWS = 50


def run(feature: Feature, model: Any = None, **options: Any) -> Result:
    """A run of a feature's model."""
    wanted: dict[str, Any] = {
        "stop_time": feature.stop,
        "output_interval": feature.stop / ROWS,
        "tolerance": TOLERANCE,
        "inputs": feature.inputs,
    }
    wanted |= options
    given = {name: value for name, value in wanted.items() if value is not None}
    return acausal.simulate(feature.make() if model is None else model, **given)


def away(feature: Feature, times: Array, near: float = 1e-4) -> NDArray[np.bool_]:
    """Which times are not just at a jump of a watched variable."""
    jumps = np.array(feature.jumps(feature.value))
    if not len(jumps):
        return np.ones(len(times), dtype=bool)
    return np.asarray(np.abs(times[:, None] - jumps).min(axis=1) > near * feature.stop)


def close(feature: Feature, times: Array, found: dict[str, Array], tolerance: float, near: float = 1e-4) -> None:
    """Compare values at times with the solution, each in units of the range of its variable."""
    assert len(times) > 1, "there are rows"
    order = np.argsort(times, kind="stable")
    exact = feature.exact(times[order], feature.value)
    span = feature.exact(np.linspace(0.0, feature.stop, 101), feature.value)
    here = away(feature, times[order], near)
    for name, values in found.items():
        want, scale = exact[name], max(float(np.ptp(span[name])), 1e-9)
        off = np.where(here, np.abs(values[order] - want), 0.0) / scale
        assert np.isfinite(off).all(), f"{feature.name}: {name} is not finite"
        k = int(np.argmax(off))
        assert off[k] <= tolerance, (
            f"{feature.name}: {name}({times[order][k]:.6g}) = {values[order][k]:.9g}, must be {want[k]:.9g}"
        )


def right(feature: Feature, result: Result, tolerance: float | None = None, stop: float | None = None) -> None:
    """Every row of a run is right, all rows asked for are there, and so are the events."""
    names = list(feature.exact(np.zeros(1), feature.value))
    stop = feature.stop if stop is None else stop
    assert result.time[0] == 0.0
    assert abs(result.time[-1] - stop) < 1e-9 * stop
    if feature.refused is not None:
        raise AssertionError(f"{feature.name} has to end with {feature.refused[0]}")
    close(feature, result.time, {n: result[n] for n in names if n in result}, tolerance or feature.tolerance)
    # a run of some outputs alone has their events only
    if feature.instants is not None and tolerance is None and all(n in result for n in names):
        found = sorted({e.time for e in result.events})
        wanted = [t for t in feature.instants if t < stop]
        assert len(found) == len(wanted), f"{feature.name}: events at {found}, must be at {wanted}"
        np.testing.assert_allclose(found, wanted, atol=1e-6 * feature.stop)


def simulated(solver: str, native: bool = False) -> Verb:
    def verb(feature: Feature) -> None:
        right(feature, run(feature, solver=solver, native=native))

    return verb


def fixed_step(solver: str) -> Verb:
    def verb(feature: Feature) -> None:
        step = feature.stop / 1000
        result = run(feature, solver=solver, step=step, tolerance=None, output_interval=feature.stop / 50)
        right(feature, result, tolerance=feature.fixed_step)

    return verb


def again(feature: Feature) -> None:
    """A run leaves its component and its compiled model as they were; copies of them and of the result are equal.

    The component twice, what is compiled from it after a run, and a pickled copy of it: the same rows and events.
    `result.at` is right between the rows.
    """
    component = feature.make()
    before = acausal.compile(component)
    first = run(feature, component)
    right(feature, first)
    compiled = acausal.compile(component)
    assert before.states == compiled.states
    assert before.algebraic == compiled.algebraic
    flat = acausal.flatten(component)
    assert flat.name == before.flat.name
    assert len(flat.equations) == len(before.flat.equations)
    others = [run(feature, model) for model in (component, compiled, pickle.loads(pickle.dumps(component)))]
    for other in (*others, pickle.loads(pickle.dumps(first))):
        right(feature, other)
        assert np.array_equal(first.time, other.time), "the second run has other rows"
        assert [e.time for e in first.events] == [e.time for e in other.events]
    times = feature.stop * (np.arange(12) + 0.37) / 12
    times = times[away(feature, times, 1e-3)]
    names = list(feature.exact(np.zeros(1), feature.value))
    close(feature, times, {n: np.asarray(first.at(times, n)) for n in names}, feature.tolerance)


def accuracy(feature: Feature) -> None:
    """What is recommended is as exact as was asked, and as it says; so is a tighter run of its solver.

    Range by range, 3e-5 for 1e-5 was reached by whatever was recommended: most models here are easy.
    """
    asked = 1e-5
    result = run(feature, accuracy=asked, tolerance=None)
    right(feature, result, tolerance=max(3e-5, feature.tolerance))
    said: Any = result.stats["accuracy"]
    tighter = run(feature, solver=said["solver"], tolerance=said["tolerance"] / 10, native=said["native"])
    found, less = mixed_error(feature, result), mixed_error(feature, tighter)
    assert said["error"] <= asked, f"{said['command']} is recommended with {said['error']:.1e} for {asked:g}"
    # between the points of the bench an error may be somewhat larger than at them
    assert found < min(asked, 2 * said["error"]) + _KNOWN, (
        f"{said['command']}: {found:.1e}, {said['error']:.1e} is said"
    )
    assert less < asked + _KNOWN, f"{said['command']} by luck: a tenth of the tolerance has {less:.1e}"


# Error of the solutions of features, and of the references of a bench.
_KNOWN = 1e-10


def mixed_error(feature: Feature, result: Result) -> float:
    """The error that a bench promises: |y - r| / (f + |r|), f being 1 or the largest |r|, whichever is smaller."""
    times = result.time
    here = away(feature, times)
    worst = 0.0
    for name, wanted in feature.exact(times, feature.value).items():
        off = np.abs(result[name] - wanted) / (min(1.0, float(np.abs(wanted).max())) + np.abs(wanted))
        worst = max(worst, float(off[here].max()))
    return worst


def outputs(feature: Feature) -> None:
    """One watched variable alone."""
    name = next(iter(feature.exact(np.zeros(1), feature.value)))
    right(feature, run(feature, outputs=[name]))


def other_interval(feature: Feature) -> None:
    """Results and events do not depend on the rows asked for."""
    for rows in (7.3, 211.0):
        right(feature, run(feature, output_interval=feature.stop / rows))


def other_stop(feature: Feature) -> None:
    stop = 0.77 * feature.stop
    right(feature, run(feature, stop_time=stop, output_interval=stop / 20), stop=stop)


def reordered(feature: Feature) -> None:
    """Declarations and equations the other way round."""
    right(feature, run(feature, turned(feature.make())))


def turned(component: Component) -> Component:
    """The same component, of a class whose declarations and equations stand in reverse order."""
    cls: Any = next(c for c in type(component).__mro__ if "equations" in vars(c))
    space: dict[str, Any] = {"__module__": cls.__module__, "__doc__": cls.__doc__, "__annotations__": {}}
    for name, declaration in reversed(cls._declarations.items()):
        space["__annotations__"][name] = cls.__annotations__[name]
        space[name] = cls._prototypes.get(name, declaration)
    for name, value in vars(cls).items():
        if callable(value) and not name.startswith("_"):
            space[name] = value
    stated = vars(cls)["equations"]

    def equations(self: Any) -> Any:
        yield from reversed(list(stated(self)))

    space["equations"] = equations
    other: Any = type(cls.__name__, cls.__bases__, space)
    return cast("Component", other(**component.__dict__["_given"]))


def step_function(feature: Feature) -> None:
    """Steps of a thousandth of the run; an event late by a step is allowed, a lost one only if a flag says so."""
    names = list(feature.exact(np.zeros(1), feature.value))
    count = 1000
    made = acausal.step_function(acausal.compile(feature.make()), feature.stop / count, "rk4", names)
    x = np.array(made.x.start)
    u = np.array([feature.inputs[port.name] for port in made.u])
    p = np.array(made.p.start)
    found = []
    for _ in range(count):
        new, y = made.function(x, u, p)
        x = np.asarray(new).ravel()
        found.append(np.asarray(y).ravel())
    if feature.refused is not None:
        assert any("assertion" in note for note in made.notes)
        return
    rows, times = np.array(found), feature.stop * np.arange(1, count + 1) / count
    columns = {port.name: rows[:, k] for k, port in enumerate(made.y)}
    if any(columns[flag].any() for flag in columns.keys() - {*names, "step.error"}):
        return  # the step says itself that it is not to be trusted
    close(feature, times, {name: columns[name] for name in names}, feature.fixed_step, near=1.1e-3)


def casadi_functions(feature: Feature) -> None:
    """`ode`, integrated from switch to switch by the classical Runge-Kutta method."""
    names = list(feature.exact(np.zeros(1), feature.value))
    made = acausal.compile(feature.make()).casadi(names)
    if feature.acts or feature.refused:
        assert made.notes, f"{feature.name}: what acts at events is left out without a word"
        return
    p = np.array(made.p.start)
    u = np.array([feature.inputs[port.name] for port in made.u])
    x = np.asarray(made.init(p)[0]).ravel()

    timely = "t" in made.ode.name_in()

    def at(t: float, x: Array) -> dict[str, Any]:
        return dict(made.ode(x=x, u=u, p=p, **({"t": t} if timely else {})))

    def rate(t: float, x: Array) -> Array:
        return np.asarray(at(t, x)["xdot"]).ravel()

    cuts = {float(t) for t in np.asarray(made.instants(p)).ravel() if 0 < t < feature.stop}
    times = sorted(cuts | set(np.linspace(0.0, feature.stop, 1001).tolist()))
    rows = []
    for a, b in pairwise(times):
        # just after a switch and just before the next one
        h, first, last = b - a, a + 1e-9 * (b - a), b - 1e-9 * (b - a)
        try:
            k1 = rate(first, x)
            k2 = rate(a + h / 2, x + h / 2 * k1)
            k3 = rate(a + h / 2, x + h / 2 * k2)
            x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + rate(last, x + h * k3))
            rows.append(np.asarray(at(b, x)["y"]).ravel())
        except RuntimeError:
            break  # documented: `ode` raises it where its Newton iteration does not converge
    columns = {port.name: np.array(rows)[:, k] for k, port in enumerate(made.y)}
    close(feature, np.array(times[1 : len(rows) + 1]), columns, feature.fixed_step)


def linearize(feature: Feature) -> None:
    """Eigenvalues at the start; a model whose `when`s would be lost has to be refused."""
    found = acausal.linearize(feature.make(), inputs=feature.inputs)
    assert not feature.acts, f"{feature.name}: what acts at events is left out without a word"
    assert np.isfinite(found.A).all()
    if feature.poles is not None:
        np.testing.assert_allclose(
            np.sort_complex(found.eigenvalues), np.sort_complex(np.array(feature.poles)), rtol=1e-6, atol=1e-9
        )


def sensitivities(feature: Feature) -> None:
    """Derivatives of the final values, against central differences of the solution."""
    names = list(feature.exact(np.zeros(1), feature.value))
    parameters = [feature.parameter] if feature.parameter else []
    found = acausal.sensitivities(
        feature.make(), parameters, names, stop_time=feature.stop, tolerance=1e-9, inputs=feature.inputs
    )
    assert feature.refused is None
    at = np.array([0.0, feature.stop])
    final = feature.exact(at, feature.value)
    scale = {n: max(float(np.ptp(v)), 1.0) for n, v in final.items()}
    for k, name in enumerate(names):
        assert abs(found.values[k] - final[name][-1]) < 1e-4 * scale[name], f"{name} at the end"
    if parameters:
        h = 1e-5 * feature.value
        ahead, behind = (feature.exact(at, feature.value + s * h) for s in (1, -1))
        for k, name in enumerate(names):
            slope = (ahead[name][-1] - behind[name][-1]) / (2 * h)
            assert abs(found.final[k, 0] - slope) < 1e-3 * (abs(slope) + scale[name] / abs(feature.value)), (
                f"{feature.name}: d {name} / d {feature.parameter} = {found.final[k, 0]:.7g}, must be {slope:.7g}"
            )


def reduce(feature: Feature) -> None:
    name = next(iter(feature.exact(np.zeros(1), feature.value)))
    found = acausal.reduce(feature.make(), [name], compare=False)
    right(feature, run(feature, found.compiled))


def stability(feature: Feature) -> None:
    found = acausal.stability(
        feature.make(), points=3, stop_time=feature.stop, inputs=feature.inputs, check=False, tolerance=1e-6
    )
    if feature.refused is not None:
        assert feature.refused[0] in str(found), "the study says where its run ended, and why"
    if feature.poles is not None:
        at_start = np.sort_complex(np.asarray(found.locals[0].eigenvalues, dtype=complex))
        np.testing.assert_allclose(at_start, np.sort_complex(np.array(feature.poles)), rtol=1e-4, atol=1e-6)


def bench(feature: Feature) -> None:
    """The reference of the bench and what its runs are said to be off."""
    names = list(feature.exact(np.zeros(1), feature.value))
    found = acausal.bench(
        feature.make(),
        solvers=("idas", "rosenbrock"),
        tolerances=(1e-6,),
        steps=(),
        formulations=("torn",),
        variables=names,
        repeat=1,
        native=False,
        stop_time=feature.stop,
        inputs=feature.inputs,
    )
    assert feature.refused is None
    t = found.reference.trajectory
    columns = {n: t.values[:, k] for k, n in enumerate(t.names)}
    close(feature, t.times, columns, max(1e-5, feature.tolerance))
    for made in found.runs:
        assert made.failure or made.error < 1e-2, f"{made.case.series}: {made.error:.1e}"


def threads(feature: Feature) -> None:
    """One component, and one compiled model, in two threads at the same time."""
    for model in (feature.make(), acausal.compile(feature.make())):
        with ThreadPoolExecutor(2) as pool:
            for result in pool.map(lambda _, model=model: run(feature, model), range(2)):
                right(feature, result)


SOLVERS = ("idas", "rosenbrock", "cvodes", "erk")
VERBS: dict[str, Verb] = {
    **{solver: simulated(solver) for solver in SOLVERS},
    **{f"{solver} native": simulated(solver, native=True) for solver in SOLVERS},
    **{f"{solver} fixed step": fixed_step(solver) for solver in ("rk", "rk2", "collocation", "erk", "rosenbrock")},
    "again": again,
    "accuracy": accuracy,
    "outputs": outputs,
    "other interval": other_interval,
    "other stop": other_stop,
    "reordered": reordered,
    "step_function": step_function,
    "casadi": casadi_functions,
    "linearize": linearize,
    "sensitivities": sensitivities,
    "reduce": reduce,
    "stability": stability,
    "bench": bench,
    "threads": threads,
}
