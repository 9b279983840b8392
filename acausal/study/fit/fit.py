"""Least-squares estimation of parameters from runs, with confidence intervals.

Gauss-Newton in a trust region (scipy's `least_squares`). Derivatives are those of the runs
(`acausal/export/sensitivity/`) if these take compiled steps or none, else finite differences of runs, which also work
with delays, varying inputs and contacts. The search ends by the relative offset criterion, when a step would be small
compared with the confidence intervals. Every signal is weighted by the standard deviation of its noise; if that is
unknown it is estimated from the residuals of a first fit, and the fit is repeated (Bates and Watts, Nonlinear
Regression Analysis and Its Applications, 1988, sections 2.2.3 and 4).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from acausal.arrays import Vector
from acausal.errors import RunError, UsageError, listed_names, meant
from acausal.flatten.parameters import entries
from acausal.language.component import Component
from acausal.lower.compile import compile
from acausal.lower.compiled import CompiledModel
from acausal.providers import provided
from acausal.result.result import Result
from acausal.study.fit.dataset import Dataset
from acausal.study.fit.judge import Judgement, Unknowns, judge
from acausal.study.fit.trial import Trial, TrialRun, trial_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure


# Relative step of finite differences, and tolerance of the runs at which these are accurate to 1e-4.
_STEP = 1e-4
_TOLERANCE = 1e-8
# A fit ends when the sum of squares and the parameters change by less than this fraction: the first fit, with guessed
# weights, and the last one, whose parameters are then within a few hundredths of their standard deviation.
_ROUGH = 1e-3
_FINE = 1e-6
_MOST_STEPS = 100
# Relative offset at which the first and the last fit end: the part of the residuals that a further step would remove,
# in standard deviations. It limits the change of each parameter, in standard deviations of the parameter.
_OFFSET_ROUGH, _OFFSET = 0.1, 0.01
# A search has stalled if the next step would remove more than this many standard deviations, and change a parameter by
# more than this fraction. Then it begins again, as long as that lowers the sum of squares by a hundredth.
_STALLED, _STALLED_STEP, _MOST_SEARCHES = 1.0, 1e-2, 4
# Relative distance from a guess at which the search has ended to points that are tried because it may be a maximum.
_BESIDE = 0.1
# Columns of derivatives that agree to this relative accuracy differ by rounding only.
_SAME = 1e-3
# Number of points whose runs are cached.
_MOST_CACHED = 4


@dataclass(frozen=True, eq=False)
class Fit:
    """Best fit of n parameters to measurements.

    Attributes
    ----------
    model
        Name of the model.
    names, units, guess, value
        Paths of the parameters, their units, start values and estimates, in SI; shape (n,).
    std, interval
        Standard deviations, shape (n,), and 95 % confidence intervals, shape (n, 2), by Student's distribution and the
        linearised model; infinite for parameters that the data do not determine.
    covariance, correlation
        Shape (n, n).
    rms, noise
        Root mean square of the residuals by signal, in its unit, and the standard deviation by which they are weighted;
        for data sets with different `sigma`, the root of its mean square.
    rows, runs, gradients
        Number of compared values, of simulations, and of simulations differentiated by all parameters at once.
    results
        One run with the estimated parameters for each data set.
    notes
        Limits of the estimates: parameters that the data do not determine, correlated residuals, values at a limit; and
        columns that were left out.
    """

    model: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    guess: Vector
    value: Vector
    std: Vector
    interval: Vector
    covariance: Vector
    correlation: Vector
    rms: Mapping[str, float]
    noise: Mapping[str, float]
    rows: int
    runs: int
    gradients: int
    results: tuple[Result, ...]
    trials: tuple[Trial, ...] = field(repr=False)
    notes: tuple[str, ...] = ()

    @property
    def parameters(self) -> dict[str, float]:
        """The estimates by path, for `simulate(parameters=...)`."""
        return dict(zip(self.names, self.value.tolist(), strict=True))

    def plot(self, file: str | None = None) -> Figure:
        """Plot measured points over simulated lines, with residuals below, one column of panels per signal."""
        drawn: Figure = provided("fit_picture")(self, file)
        return drawn


def fit(
    model: Component | CompiledModel,
    data: Any,
    free: Sequence[str] | Mapping[str, tuple[float | str, float | str]],
    *,
    parameters: Mapping[str, object] | None = None,
    inputs: Mapping[str, Any] | None = None,
    start: Mapping[str, object] | None = None,
    tolerance: float | None = None,
    solver: str | None = None,
    native: bool | None = None,
    progress: Callable[[str], None] | None = None,
) -> Fit:
    """Fit parameters of a model to measurements.

    Parameters
    ----------
    model
        A component, or a compiled model.
    data
        A `Dataset`, or its `data` alone; a list for several experiments, which share the parameters.
    free
        Paths of the scalar, non-structural parameters to estimate; as a mapping, with lower and upper limits in SI, or
        as text with a unit. The search starts at the model's values, or at those in `parameters`.
    parameters, inputs, start
        As in `simulate`, for all experiments; those of a data set have priority.
    tolerance
        Tolerance of the runs; by default that of the model, but at most 1e-8, because derivatives may be differences.
    progress
        Called with a sentence after each step of the search.

    Raises
    ------
    UsageError
        AC055 for data that do not fit the model, AC056 for parameters that cannot be free, AC057 for more parameters
        than values.
    AcausalError
        Errors of the first run; if a later one fails, the search takes a shorter step.
    """
    compiled = model if isinstance(model, CompiledModel) else compile(model, parameters=parameters)
    values = parameters if isinstance(model, CompiledModel) else None
    sets = [d if isinstance(d, Dataset) else Dataset(d) for d in (data if isinstance(data, list | tuple) else [data])]
    unknown = _make_unknowns(compiled, free, values or {})
    _check_sets(sets, unknown.names)
    wanted = {"tolerance": tolerance or min(compiled.flat.experiment.tolerance, _TOLERANCE), "solver": solver}
    wanted |= {"native": native}
    common = Dataset(None, inputs or {}, start or {}, values or {})
    trials = tuple(trial_of(compiled, d, k, common, unknown.guess_by_name, wanted) for k, d in enumerate(sets))
    search = _Search(trials, unknown, progress)
    if search.rows <= len(unknown.names):
        raise UsageError("AC057", f"{search.rows} measured values cannot determine {len(unknown.names)} parameters")
    return search.solve(compiled)


def _make_unknowns(
    compiled: CompiledModel,
    free: Sequence[str] | Mapping[str, tuple[float | str, float | str]],
    given: Mapping[str, object],
) -> Unknowns:
    names = listed_names("free", free)
    if not names:
        raise UsageError("AC056", "no parameter is free", help="free=['drill.k_c11', 'drill.z']")
    declared = {p.path: p for p in compiled.flat.parameters}
    present = dict(zip(compiled.parameters, compiled.parameter_values, strict=True))
    units, rows = [], []
    for name in names:
        base = declared.get(name) or declared.get(name.rpartition("[")[0])
        if base is None or name not in present:
            raise _unfit(compiled, name, base is not None, list(present))
        low, high = base.declaration.min, base.declaration.max
        if isinstance(free, Mapping):
            requested = entries(name, (2,), free[name], base.declaration.unit)
            low, high = max(low, requested[0]), min(high, requested[1])
        guess = entries(name, (), given.get(name, present[name]), base.declaration.unit)[0]
        if not low <= guess <= high or low >= high:
            fact = f"{name} starts at {guess:g}, which is not between its limits {low:g} and {high:g}"
            if low >= high:
                fact = f"no value of {name} lies between its limits {low:g} and {high:g}"
            raise UsageError(
                "AC056", fact, help=f"give it another start value or other limits: parameters={{'{name}': ...}}"
            )
        units.append(base.declaration.unit)
        rows.append((guess, low, high))
    return Unknowns(names, tuple(units), *np.array(rows, dtype=np.float64).T)


def _check_sets(sets: Sequence[Dataset], free: tuple[str, ...]) -> None:
    """Raise UsageError AC056 if a data set has its own value of a free parameter, which all data sets share."""
    for name in (n for d in sets for n in d.parameters):
        if name in free or any(f.startswith(f"{name}[") for f in free):
            raise UsageError(
                "AC056",
                f"{name} is free, with one value for all experiments, but a data set gives it a value of its own",
                help="leave it out of the data set, or out of `free`; give its start value in `parameters`",
            )


def _unfit(compiled: CompiledModel, name: str, known: bool, free: list[str]) -> UsageError:
    return UsageError(
        "AC056",
        f"{name} follows from other parameters of {compiled.name}" if known else f"there is no parameter '{name}'",
        evidence=meant(name, free),
        help="free those, or give it a start value of its own, which replaces the binding"
        if known
        else "acausal info lists all parameters",
    )


class _Converged(Exception):
    """Ends the search at `q`, shape (n,), by the relative offset criterion."""

    def __init__(self, q: Vector) -> None:
        super().__init__()
        self.q = q


@dataclass
class _Search:
    """State of the search: scaled parameters q, shape (n,), and concatenated residuals of all trials, shape (rows,)."""

    trials: tuple[Trial, ...]
    unknown: Unknowns
    progress: Callable[[str], None] | None
    runs: int = 0
    noise: Mapping[str, float] = field(default_factory=dict)
    known_residuals: dict[bytes, Vector | None] = field(default_factory=dict)
    kept: dict[bytes, list[TrialRun]] = field(default_factory=dict)
    slopes: dict[bytes, Vector] = field(default_factory=dict)
    gradients: int = 0
    is_noise_known: bool = False

    @property
    def rows(self) -> int:
        """Number of measured values."""
        return sum(len(s.values) for t in self.trials for s in t.signals)

    def residuals(self, q: Vector) -> Vector | None:
        """Simulated minus measured values in SI, shape (rows,); None if a run fails."""
        key = q.tobytes()
        if key not in self.known_residuals:
            runs = self._run(q)
            self.known_residuals[key] = (
                None
                if runs is None
                else np.concatenate([t.residuals(r) for t, r in zip(self.trials, runs, strict=True)])
            )
            if runs is not None:
                self.kept[key] = runs
                while len(self.kept) > _MOST_CACHED:
                    del self.kept[next(iter(self.kept))]
        return self.known_residuals[key]

    def _run(self, q: Vector) -> list[TrialRun] | None:
        """One run of each data set; None if one fails."""
        runs = []
        try:
            for trial in self.trials:
                self.runs += 1
                runs.append(trial.trial_run(self.values(q)))
        except RunError:
            return None
        return runs

    def values(self, q: Vector) -> dict[str, float]:
        """The parameters by name, in SI."""
        return dict(zip(self.unknown.names, (q * self.unknown.scale).tolist(), strict=True))

    def results(self, q: Vector) -> tuple[Result, ...]:
        """The runs with these parameters, from the cache or repeated."""
        runs = self.kept.get(q.tobytes()) or self._run(q) or []
        return tuple(r.result for r in runs)

    def derivatives(self, q: Vector) -> Vector:
        """Derivatives of the residuals by the scaled parameters, shape (rows, n)."""
        key = q.tobytes()
        if key not in self.slopes:
            found = self._exact_derivatives(q)
            self.slopes = {key: self._differences(q) if found is None else found}
        return self.slopes[key]

    def _exact_derivatives(self, q: Vector) -> Vector | None:
        """Derivatives of the runs, shape (rows, n); None unless all runs can be differentiated."""
        self.residuals(q)
        parts = []
        for trial, trial_run in zip(self.trials, self.kept.get(q.tobytes(), []), strict=False):
            part = trial.derivatives(trial_run)
            if part is None:
                return None
            parts.append(part)
        if not parts:
            return None
        self.gradients += len(parts)
        return np.asarray(np.concatenate(parts) * self.unknown.scale)

    def _differences(self, q: Vector) -> Vector:
        """Finite differences of runs by each parameter, shape (rows, n)."""
        here = self.residuals(q)
        columns = []
        high = self.unknown.high / self.unknown.scale
        for k in range(len(q)):
            step = _STEP * max(abs(q[k]), _STEP)
            for signed in (step, -step) if q[k] + step <= high[k] else (-step,):
                moved = q.copy()
                moved[k] += signed
                runs = self._run(moved)
                if here is not None and runs is not None:
                    there = np.concatenate([t.residuals(r) for t, r in zip(self.trials, runs, strict=True)])
                    columns.append((there - here) / signed)
                    break
            else:
                name = self.unknown.names[k]
                raise UsageError("AC056", f"no run near {name} = {q[k] * self.unknown.scale[k]:.6g} succeeds")
        return np.column_stack(columns)

    def offset(self, q: Vector, rest: Vector, slope: Vector) -> float:
        """Relative offset: weighted residuals removed by a Gauss-Newton step, in standard deviations; inf at a limit.

        `rest`: weighted residuals, shape (rows,); `slope`: their derivatives, shape (rows, n).
        """
        step = self._step(q, rest, slope)
        if step is None:
            return np.inf
        square = 1.0 if self.is_noise_known else float(rest @ rest) / (len(rest) - len(q))
        return float(np.linalg.norm(slope @ step) / np.sqrt(square)) if square > 0.0 else 0.0

    def _step(self, q: Vector, rest: Vector, slope: Vector) -> Vector | None:
        """The Gauss-Newton step, shape (n,); None if it leaves the limits, or is not defined."""
        size = np.linalg.norm(slope, axis=0)
        if not size.any() or not np.isfinite(slope).all():
            return None
        size[size == 0.0] = 1.0
        step: Vector = np.linalg.lstsq(slope / size, -rest, rcond=_SAME)[0] / size
        low, high = self.unknown.low / self.unknown.scale, self.unknown.high / self.unknown.scale
        return step if ((q + step > low) & (q + step < high)).all() else None

    def _has_stalled(self, q: Vector, weights: Vector) -> bool:
        """Whether a search that ended at `q`, shape (n,), is far from a minimum, as the next step would be large.

        Where a parameter has next to no effect at the start, the trust region is scaled by that, and then far too small
        where it has one.
        """
        rest, slope = weights * self._residuals_of_success(q), weights[:, None] * self.derivatives(q)
        step = self._step(q, rest, slope)
        if step is None or self.offset(q, rest, slope) <= _STALLED:
            return False
        return bool((np.abs(step) > _STALLED_STEP * np.maximum(np.abs(q), _STALLED_STEP)).any())

    def _lower_beside(self, q: Vector) -> Vector | None:
        """A point beside `q`, shape (n,), at which the sum of squares is lower; None if there is none.

        Where a guess happens to be at a maximum or a saddle, the derivatives are those of a minimum.
        """
        weights, low, high = (
            self.weights(),
            self.unknown.low / self.unknown.scale,
            self.unknown.high / self.unknown.scale,
        )
        least, best = float(np.sum((weights * self._residuals_of_success(q)) ** 2)), None
        for k in range(len(q)):
            for sign in (1.0, -1.0):
                beside = q.copy()
                beside[k] = np.clip(q[k] + sign * _BESIDE * max(abs(q[k]), 1.0), low[k], high[k])
                found = self.residuals(beside)
                if found is not None and float(np.sum((weights * found) ** 2)) < (1.0 - _FINE) * least:
                    least, best = float(np.sum((weights * found) ** 2)), beside
        return best

    def weights(self) -> Vector:
        """Reciprocal standard deviation of the noise of each value, shape (rows,); `sigma` of its data set if given."""
        sizes = ((len(s.values), t.sigma.get(s.name) or self.noise[s.name]) for t in self.trials for s in t.signals)
        return np.concatenate([np.full(n, 1.0 / size) for n, size in sizes])

    def by_signal(self, values: Vector, is_unknown: bool = False) -> dict[str, Vector]:
        """Split `values`, shape (rows,), by signal, over all trials or, with `is_unknown`, those without its sigma."""
        found: dict[str, list[Vector]] = {}
        first = 0
        for t in self.trials:
            for s in t.signals:
                if not (is_unknown and s.name in t.sigma):
                    found.setdefault(s.name, []).append(values[first : first + len(s.values)])
                first += len(s.values)
        return {name: np.concatenate(parts) for name, parts in found.items()}

    def least(self, q: Vector, enough: float) -> Vector:
        """Parameters of the least weighted squares, shape (n,), from `q` on, to the relative change `enough`."""
        from scipy.optimize import least_squares

        weights = self.weights()

        def weighted(q: Vector) -> Vector:
            found = self.residuals(np.asarray(q))
            if self.progress is not None:
                size = "a run fails" if found is None else f"rms {np.sqrt(np.mean((weights * found) ** 2)):.4g}"
                self.progress(f"{self.runs} runs: {size}")
            # nan makes least_squares shorten the step
            return np.full(self.rows, np.nan) if found is None else weights * found

        def slope(q: Vector) -> Vector:
            q = np.asarray(q)
            found: Vector = weights[:, None] * self.derivatives(q)
            if self.offset(q, weights * self._residuals_of_success(q), found) <= (
                _OFFSET_ROUGH if enough == _ROUGH else _OFFSET
            ):
                raise _Converged(q.copy())
            return found

        low, high = self.unknown.low / self.unknown.scale, self.unknown.high / self.unknown.scale
        disabled: Any = None
        jac: Any = slope
        for _ in range(_MOST_SEARCHES):
            before = weighted(q)
            try:
                solution = least_squares(
                    weighted,
                    q,
                    jac,
                    bounds=(low, high),
                    x_scale="jac",
                    ftol=enough if enough == _ROUGH else enough / max(1.0, self.rows / 1000.0),
                    xtol=enough,
                    gtol=disabled,
                    max_nfev=_MOST_STEPS,
                )
            except _Converged as converged:
                return converged.q
            q = np.asarray(solution.x)
            is_lower = not 2.0 * solution.cost > 0.99 * float(before @ before)
            if solution.nfev >= _MOST_STEPS or not is_lower or not self._has_stalled(q, weights):
                break
        return q

    def solve(self, compiled: CompiledModel) -> Fit:
        """Fit twice, the second time with the noise estimated by the first."""
        q = self.unknown.guess / self.unknown.scale
        measured = self.by_signal(np.concatenate([s.values for t in self.trials for s in t.signals]), True)
        spread = {n: float(np.ptp(v)) or float(np.abs(v).max()) or 1.0 for n, v in measured.items()}
        self.noise = spread
        self.is_noise_known = not measured
        # a single signal without sigma needs no weight
        single = (
            self.is_noise_known or len({(s.name, t.sigma.get(s.name)) for t in self.trials for s in t.signals}) == 1
        )
        first, q = q, self.least(q, _FINE if single else _ROUGH)
        if np.allclose(first, q, _ROUGH, _ROUGH) and (lower := self._lower_beside(q)) is not None:
            q = self.least(lower, _FINE if single else _ROUGH)
        for last in () if single else (False, True):
            left = self.by_signal(self._residuals_of_success(q), True)
            self.noise = {n: max(float(np.sqrt(np.mean(r**2))), _TOLERANCE * spread[n]) for n, r in left.items()}
            q = self.least(q, _FINE) if not last else q
        rest = self._residuals_of_success(q)
        parts = self.by_signal(rest)
        data = self.by_signal(np.concatenate([s.values for t in self.trials for s in t.signals]))
        judgement: Judgement = judge(
            self.weights() * rest,
            self.weights()[:, None] * self.derivatives(q),
            q,
            self.unknown,
            {name: rows.astype(np.intp) for name, rows in self.by_signal(np.arange(float(self.rows)), True).items()},
            {name: (part, float(np.abs(data[name]).max())) for name, part in parts.items()},
        )
        unknown = self.unknown
        results = self.results(q)
        return Fit(
            compiled.name,
            unknown.names,
            unknown.units,
            unknown.guess,
            q * unknown.scale,
            judgement.std,
            judgement.interval,
            judgement.covariance,
            judgement.correlation,
            {n: float(np.sqrt(np.mean(r**2))) for n, r in parts.items()},
            {n: float(np.sqrt(np.mean(w**-2.0))) for n, w in self.by_signal(self.weights()).items()},
            self.rows,
            self.runs,
            self.gradients,
            results,
            self.trials,
            (*judgement.notes, *(note for trial in self.trials for note in trial.notes)),
        )

    def _residuals_of_success(self, q: Vector) -> Vector:
        found = self.residuals(q)
        if found is None:  # cannot occur: the first run raises its own error, and the search never ends at a failed one
            raise AssertionError("the search ended where runs fail")
        return found
