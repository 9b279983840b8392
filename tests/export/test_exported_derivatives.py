"""First and second derivatives of what shipped models export, at random points, against complex steps: never nan."""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray

import acausal
from acausal.cli.arguments.shipped import shipped_models
from acausal.errors import AcausalError
from acausal.lower.casadi_model import CasadiModel
from acausal.lower.compiled import CompiledModel
from tests.expected import fails_with
from tests.export.complex_step import stepped

Vector = NDArray[np.float64]

POINTS, FEWEST = 100, 80
# What was before is no function of one instant (AC035).
REFUSED = {"Delays": "AC035", "RegenerativeTurning": "AC035"}
# contact/test_mpr_derivatives.py has the derivatives of contacts, contact/test_choices.py the refusal of holes (AC027).
ELSEWHERE = {"BoxStack", "HolesSideBySide"}
# Runs of these end with an error or take seconds: points lie around the start.
AT_START = {"GimbalAngles", "PendulumDrift", "PendulumInconsistent", "RingModulator", "Wheelset"}
# Whole matrices take half a minute to build: products with vectors say the same.
LARGE = {"FeketePoints"}
QUICK = {"BouncingBall", "CartPole", "DrillDynamic", "KelvinVoigtImpact", "ThickBlock"}


@dataclass(frozen=True, eq=False)
class Scalars:
    """What a model exports as one column of results by one column of arguments, with modes as numbers.

    `is_timed` says that the last argument is the time.
    """

    column: Any
    results: Any
    starts: Vector
    sizes: Vector
    names: tuple[str, ...]
    is_timed: bool


def exported(compiled: CompiledModel) -> Scalars:
    """The functions `dae` of a model; of one with events, between them, in the modes of the start."""
    try:
        model: CasadiModel = compiled.casadi()
        function, numbers = model.dae, {}
    except AcausalError as error:
        if error.code != "AC608":
            raise
        model = compiled.casadi(events=True)
        assert model.events is not None
        function, numbers = model.events.dae, {"m": model.events.m.start}
    parts = model.x, model.z, model.u, model.p
    lengths = np.cumsum([0, *(len(part) for part in parts)]).tolist()
    column = ca.SX.sym("at", lengths[-1])
    given = dict(zip("xzup", ca.vertsplit(column, lengths), strict=True))
    given |= {name: ca.SX(ca.DM(value)) for name, value in numbers.items()}
    starts = np.concatenate([part.start for part in parts])
    own = 0.01 * np.maximum(np.abs(model.p.start), 1e-7 * np.array(model.p.nominal))
    sizes = np.concatenate([*(part.nominal for part in parts[:3]), own])
    if "t" in function.name_in():
        given["t"] = ca.SX.sym("t")
        column = ca.vertcat(column, given["t"])
        span = compiled.flat.experiment.stop_time - model.start_time
        starts, sizes = np.append(starts, model.start_time), np.append(sizes, 1e-3 * span)
    found = function(**given)
    results = ca.densify(ca.vertcat(*(found[name] for name in function.name_out())))
    names = tuple(port.name for part in parts[:3] for port in part)
    return Scalars(column, results, starts, sizes, names, "t" in given)


def around(compiled: CompiledModel, scalars: Scalars, is_run: bool, random: np.random.Generator) -> Vector:
    """Random points about those of a run, or about the start, up to a tenth of all magnitudes away."""
    n = len(scalars.starts)
    points = np.repeat(scalars.starts[:, None], POINTS, axis=1)
    if is_run:
        run = acausal.simulate(compiled)
        rows = random.integers(0, len(run.time), POINTS)
        for k, name in enumerate(scalars.names):
            if name in run.names:
                points[k] = run[name][rows]
        if scalars.is_timed:
            points[-1] = run.time[rows]
    reach = 10.0 ** random.uniform(-6.0, -1.0, POINTS)
    return np.asarray(points + reach * scalars.sizes[:, None] * random.standard_normal((n, POINTS)))


def directions(points: Vector, sizes: Vector, random: np.random.Generator) -> Vector:
    """Random directions, each entry by the magnitude of its own."""
    return np.asarray(np.maximum(np.abs(points), 1e-3 * sizes[:, None]) * random.standard_normal(points.shape))


def off(own: Vector, judged: Vector, size: Vector) -> float:
    """The largest difference by the larger of the value and what it is made of."""
    scale = np.maximum(np.maximum(np.abs(judged), size), 1e-300)
    return float(np.max(np.abs(own - judged) / scale, initial=0.0))


def made_of(steep: Vector, steps: Vector) -> Vector:
    """Sizes of second derivatives: of the slope that they change, and of what rounding leaves of the largest one.

    Numbers count by the steps they are multiplied with, shape (arguments, n) as theirs.
    """
    share = np.abs(steep * steps)
    return np.asarray(np.maximum(share, 1e-5 * share.max(axis=0)) / np.maximum(np.abs(steps), 1e-300))


def check(name: str) -> None:
    """Jacobian and Hessian, as CasADi makes them of the exported function, times a direction of each point."""
    shipped = next(m for m in shipped_models() if m.name == name)
    compiled = acausal.compile(getattr(importlib.import_module(shipped.module), name)())
    scalars, random = exported(compiled), np.random.default_rng(1)
    points = around(compiled, scalars, name not in AT_START, random)
    along, across = (directions(points, scalars.sizes, random) for _ in range(2))
    at, y = scalars.column, scalars.results
    direction, weights = ca.SX.sym("d", at.numel()), ca.SX.sym("w", y.numel())
    factors = random.standard_normal((y.numel(), POINTS))
    gradient = ca.gradient(ca.dot(weights, y), at)
    if name in LARGE:
        first, second = ca.jtimes(y, at, direction), ca.jtimes(gradient, at, direction)
    else:
        first, second = ca.jacobian(y, at) @ direction, ca.jacobian(gradient, at) @ direction
    slopes, curves = (
        ca.Function("own", [at, weights, direction], [ca.densify(v)]).map(POINTS) for v in (first, second)
    )
    function = ca.Function("values", [at], [y])
    # at other points a root or a logarithm has no value
    kept = np.isfinite(np.array(function.map(POINTS)(points))).all(axis=0)
    assert kept.sum() >= FEWEST
    values, expected = stepped(function, points, along)
    own = np.array(slopes(points, factors, along))
    assert np.isfinite(own[:, kept]).all()
    # what a derivative in a direction is made of, where it is a small difference of large ones
    size = np.abs(values[:, kept])
    assert off(own[:, kept], expected[:, kept], np.maximum(size, 1e-6 * size.max(axis=1, keepdims=True))) < 1e-8
    partial = ca.Function("gradient", [ca.vertcat(at, weights)], [ca.densify(gradient)])
    steep, expected = stepped(partial, np.vstack([points, factors]), np.vstack([across, np.zeros_like(factors)]))
    own = np.array(curves(points, factors, across))
    assert np.isfinite(own[:, kept]).all()
    assert off(own[:, kept], expected[:, kept], made_of(steep, across)[:, kept]) < 1e-6


@pytest.mark.parametrize("name", sorted(QUICK))
def test_derivatives_of_exported_functions(name: str) -> None:
    check(name)


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted({m.name for m in shipped_models()} - QUICK - set(REFUSED) - ELSEWHERE))
def test_derivatives_of_every_exported_function(name: str) -> None:
    check(name)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "code"), sorted(REFUSED.items()))
def test_what_is_not_exported_says_so(name: str, code: str) -> None:
    shipped = next(m for m in shipped_models() if m.name == name)
    with fails_with(AcausalError, code):
        acausal.compile(getattr(importlib.import_module(shipped.module), name)()).casadi(events=True)
