"""Steady states: equilibria, and trim points with prescribed outputs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from acausal.arrays import Vector
from acausal.errors import ExportError, UsageError, meant
from acausal.export.forms import LINEAR, check
from acausal.export.observed import dae_function
from acausal.export.ports import Output, named_outputs
from acausal.export.start_point import input_start
from acausal.flatten.parameters import entries
from acausal.language.component import Component
from acausal.lower.compile import compile
from acausal.lower.compiled import CompiledModel
from acausal.simulate.options import input_vector, parameter_vector
from acausal.simulate.start.initialize import initialize

# Tolerance of the scaled residual: rates are scaled by the nominal magnitude of their state per duration of the
# experiment, outputs by their prescribed values.
_ZERO = 1e-8
# Relative singular value of the scaled Jacobian below which a direction counts as undetermined.
_RANK = 1e-9
_MOST_EVALUATIONS = 200
_ATTEMPTS = 5


@dataclass(frozen=True, eq=False)
class OperatingPoint:
    """A steady state, values by name in SI units.

    Attributes
    ----------
    t
        Time at which the model's sources were evaluated [s].
    states, algebraic, inputs, outputs
        `states` and `inputs` can be passed to `linearize(model, t, x=states, inputs=inputs)`.
    notes
        Values that are not unique, and were chosen as close to the start as possible.
    """

    name: str
    t: float
    states: Mapping[str, float]
    algebraic: Mapping[str, float]
    inputs: Mapping[str, float]
    outputs: Mapping[str, float]
    notes: tuple[str, ...] = ()

    def __repr__(self) -> str:
        return f"OperatingPoint({self.name}: {len(self.states)} states, {len(self.inputs)} inputs)"


def operating_point(
    model: Component | CompiledModel,
    *,
    t: float | None = None,
    inputs: Mapping[str, float] | None = None,
    outputs: Mapping[str, float] | None = None,
    free: Sequence[str] = (),
    guess: Mapping[str, float] | None = None,
    parameters: Mapping[str, object] | None = None,
) -> OperatingPoint:
    """Find states at which all rates are zero, by a trust-region Gauss-Newton method from the model's start.

    Discrete variables, which change at events only, are not unknowns: they keep the values of the start or of `guess`.

    Parameters
    ----------
    t
        Time at which sources are evaluated [s]; the start of the model's experiment by default.
    inputs
        Values of inputs; others have their start values.
    outputs
        Prescribed values of variables, by name; usually as many as there are free inputs.
    free
        Inputs to determine, within their limits.
    guess
        Values of states, and of free inputs, from which the search begins.

    Raises
    ------
    UsageError
        AC010 for unknown states, outputs or free inputs, AC023 for outputs of another shape, AC033 for unknown inputs.
    ExportError
        AC611 when there is no steady state near the start, with the remaining rates; AC608 when events change the
        rates.
    InitializationError
        The start problem of the model has no solution.
    """
    compiled = model if isinstance(model, CompiledModel) else compile(model, parameters=parameters)
    wanted = named_outputs(compiled, list(outputs) if outputs else None)
    notes = check(compiled, LINEAR, wanted)
    when = compiled.flat.experiment.start_time if t is None else t
    p = parameter_vector(compiled, (parameters or {}) if isinstance(model, CompiledModel) else {})
    known = {n: input_start(compiled, s, p) for n, s in zip(compiled.inputs, compiled.flat.inputs, strict=True)}
    u = input_vector(compiled, {**known, **(inputs or {})}, unchecked=known.keys() - (inputs or {}).keys())
    places = [_place(compiled, name, compiled.inputs, "input") for name in free]
    start = initialize(compiled, when, p, u, np.array(compiled.modes(when, p)).ravel())
    for name, value in (guess or {}).items():
        if name in free:
            u[compiled.inputs.index(name)] = value
        else:
            start.x[_place(compiled, name, compiled.states, "state")] = value
    first, prescribed = np.concatenate([start.x, start.z, u[places]]), _prescribed_values(compiled, outputs or {})
    search = _Search(compiled, wanted, prescribed, when, p, u, places, first)
    solution = search.solve()
    if solution is None:
        raise _no_steady_state(compiled, search)
    nx = len(start.x)
    names = [*compiled.states, *compiled.algebraic, *free]
    return OperatingPoint(
        compiled.name,
        when,
        dict(zip(compiled.states, solution[:nx].tolist(), strict=True)),
        dict(zip(compiled.algebraic, solution[nx : nx + len(start.z)].tolist(), strict=True)),
        dict(zip(compiled.inputs, search.inputs(solution).tolist(), strict=True)),
        dict(zip((o.name for o in wanted), search.at(solution)["y"].ravel().tolist(), strict=True)),
        (*notes, *_undetermined(search.jacobian(search.reduced(solution)), [names[k] for k in search.unknown])),
    )


def _prescribed_values(compiled: CompiledModel, outputs: Mapping[str, float]) -> Vector:
    """Prescribed values of all entries of the outputs, shape (n,), in the order of `named_outputs`."""
    prescribed: list[float] = []
    for name, value in outputs.items():
        first, *others = named_outputs(compiled, [name])
        prescribed += entries(name, (1 + len(others),) if others else (), value, first.declaration.unit)
    return np.array(prescribed)


class _Search:
    """Least-squares problem: rates, residuals and deviations of outputs as functions of (x, z, free inputs).

    The unknowns w, shape (n,), are the entries of (x, z, free inputs) at the indices `unknown`: all but the discrete
    variables.
    """

    def __init__(
        self,
        compiled: CompiledModel,
        wanted: Sequence[Output],
        prescribed: Vector,
        when: float,
        p: Vector,
        u: Vector,
        places: Sequence[int],
        first: Vector,
    ) -> None:
        self.compiled, self.prescribed, self.when = compiled, prescribed, when
        self.p, self.u, self.places = p, u, list(places)
        self.first, nx = first, len(compiled.states)
        self.unknown = np.array([k for k in range(len(first)) if not nx - compiled.discretes <= k < nx], dtype=int)
        self.functions = ["ode", "alg", "y"] if prescribed.size else ["ode", "alg"]
        slopes = [f"jac:{f}:{v}" for f in self.functions for v in ("x", "z", "u")]
        dae = dae_function(compiled, wanted)
        self.function = dae.factory("point", ["t", "x", "z", "u", "p"], ["ode", "alg", "y", *slopes])
        experiment = compiled.flat.experiment
        span = experiment.stop_time - experiment.start_time
        x, z = compiled.nominal_x, compiled.nominal_z
        self.scale = np.concatenate([x, z, np.maximum(1.0, np.abs(u[self.places]))])
        self.size = np.concatenate([x / span, np.ones(len(z)), np.maximum(np.abs(prescribed), 1e-3)])
        self.names = [
            *(f"der({n})" for n in compiled.states),
            *(f"equation of {n}" for n in compiled.algebraic),
            *(o.name for o in wanted if prescribed.size),
        ]
        self.best_residual = np.zeros(0)

    def inputs(self, here: Vector) -> Vector:
        """All inputs, shape (nu,), with the free ones from the point `here`, shape (nx + nz + n_free,)."""
        u = self.u.copy()
        u[self.places] = here[len(here) - len(self.places) :]
        return u

    def at(self, here: Vector) -> dict[str, Vector]:
        """Rates, residuals, outputs and their derivatives at the point `here`, by name."""
        nx, nz = len(self.compiled.states), len(self.compiled.algebraic)
        values = self.function(self.when, here[:nx], here[nx : nx + nz], self.inputs(here), self.p)
        return {name: np.array(v) for name, v in zip(self.function.name_out(), values, strict=True)}

    def reduced(self, here: Vector) -> Vector:
        """The scaled unknowns of the point `here`, shape (nx + nz + n_free,)."""
        unknowns: Vector = (here / self.scale)[self.unknown]
        return unknowns

    def point(self, w: Vector) -> Vector:
        """The point, shape (nx + nz + n_free,), of scaled unknowns."""
        here = self.first.copy()
        here[self.unknown] = np.asarray(w) * self.scale[self.unknown]
        return here

    def residual(self, w: Vector) -> Vector:
        """Scaled residual, shape (nx + nz + n_outputs,), at scaled unknowns."""
        found = self.at(self.point(w))
        deviation: Vector = found["y"].ravel() - self.prescribed if self.prescribed.size else np.zeros(0)
        residual: Vector = np.concatenate([found["ode"].ravel(), found["alg"].ravel(), deviation]) / self.size
        return residual

    def jacobian(self, w: Vector) -> Vector:
        """Jacobian of `residual`, shape (nx + nz + n_outputs, n)."""
        found = self.at(self.point(w))
        rows = [
            np.hstack([found[f"jac_{f}_x"], found[f"jac_{f}_z"], found[f"jac_{f}_u"][:, self.places]])
            for f in self.functions
        ]
        scaled: Vector = (np.vstack(rows) * self.scale / self.size[:, None])[:, self.unknown]
        return scaled

    def solve(self) -> Vector | None:
        """The steady state, shape (nx + nz + n_free,), or None.

        Later attempts start from randomly displaced points, because the first one may be a stationary point of the sum
        of squares.
        """
        from scipy.optimize import least_squares

        compiled = self.compiled
        declared = [compiled.flat.declaration(compiled.flat.inputs[k]) for k in self.places]
        open_ended = np.full(len(self.first) - len(declared), np.inf)
        low = self.reduced(np.concatenate([-open_ended, [d.min for d in declared]]))
        high = self.reduced(np.concatenate([open_ended, [d.max for d in declared]]))
        rng = np.random.default_rng(0)
        for attempt in range(_ATTEMPTS):
            displacement = 0.2 * attempt * rng.uniform(-1.0, 1.0, len(low))
            first = np.clip(self.reduced(self.first) + displacement, low, high)
            if not np.isfinite(self.residual(first)).all():
                continue
            options = {"ftol": 1e-15, "xtol": 1e-15, "gtol": 1e-15, "max_nfev": _MOST_EVALUATIONS}
            slope: Any = self.jacobian
            found = least_squares(self.residual, first, slope, bounds=(low, high), **options)
            if not self.best_residual.size or np.abs(found.fun).max() < np.abs(self.best_residual).max():
                self.best_residual = np.asarray(found.fun)
            if np.abs(found.fun).max() <= _ZERO:
                return self.point(found.x)
        return None


def _place(compiled: CompiledModel, name: str, known: Sequence[str], kind: str) -> int:
    if name in known:
        return list(known).index(name)
    raise UsageError(
        "AC010",
        f"'{name}' is not {'an' if kind == 'input' else 'a'} {kind} of {compiled.name}",
        evidence=meant(name, list(known)),
        help=f"it has: {', '.join(known[:8]) or 'none'}",
    )


def _no_steady_state(compiled: CompiledModel, search: _Search) -> ExportError:
    worst = np.argsort(-np.abs(search.best_residual))[:4]
    values = search.best_residual * search.size if search.best_residual.size else search.best_residual
    return ExportError(
        "AC611",
        f"{compiled.name} has no steady state near its start",
        evidence=[f"{search.names[k]} remains off by {values[k]:.4g}" for k in worst],
        cause="a part has to move, too few inputs are free, or their limits are too narrow",
        help="give free=[...] inputs and as many outputs={...}, or another guess={...}",
    )


def _undetermined(jacobian: Vector, names: Sequence[str]) -> list[str]:
    """Notes on variables that the equations leave undetermined, from the null space of the Jacobian."""
    _, size, right = np.linalg.svd(jacobian)
    rank = int((size > _RANK * max(float(size.max(initial=0.0)), 1e-300)).sum())
    free = np.abs(right[rank:]).max(axis=0, initial=0.0)
    loose = [name for name, component in zip(names, free.tolist(), strict=True) if component > 0.1]
    return (
        [f"not unique: {', '.join(loose[:6])} are arbitrary; the values nearest to the start are used"] if loose else []
    )
