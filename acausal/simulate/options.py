"""The options of a run, the grid of its output times, and the values of its parameters and inputs."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from acausal.arrays import Vector
from acausal.errors import UsageError, meant
from acausal.flatten.flat import suffixes
from acausal.flatten.parameters import check_limit, check_values, entries, given_values
from acausal.language.declarations.experiment import Experiment
from acausal.lower.cache.cache import choices_hold_for
from acausal.lower.cache.divisors import LOST, shrunken_divisor
from acausal.lower.compiled import CompiledModel
from acausal.numeric.evaluate import values
from acausal.simulate.multiples import multiples
from acausal.simulate.solvers.segment import Tolerances

# Below this tolerance the rounding of sixteen digits exceeds the allowed error of a step: no step would be accepted.
_FINEST_TOLERANCE = 1e-14
# Solvers without step control, and "auto", which chooses one of them if there is a step.
_FIXED_STEP = ("auto", "rk", "rk2", "collocation")
# Solvers that always choose their steps, and cannot take fixed ones.
_ADAPTIVE = ("idas", "cvodes")


@dataclass(frozen=True)
class Options:
    """The options of a run: times [s], relative tolerance, name of the solver or "auto", fixed step [s].

    Absolute tolerances are `absolute_factor * tolerance * nominal`, per variable. `native`: True compiles the equations
    to C, False interprets them, None decides.
    """

    start_time: float
    stop_time: float
    output_interval: float
    tolerance: float
    solver: str
    step: float | None
    max_step: float | None = None
    absolute_factor: float = 1e-3
    native: bool | None = None

    @property
    def tolerances(self) -> Tolerances:
        """Tolerances for the end errors of the run; solvers get a fraction of them."""
        return Tolerances(self.tolerance, self.absolute_factor)

    @property
    def span(self) -> float:
        """Length of the run [s]."""
        return self.stop_time - self.start_time

    @property
    def notes(self) -> list[str]:
        """A note on a run whose times are rounded to more than its tolerance leaves of its length, or of a step."""
        rounding = float(np.spacing(abs(self.start_time)))
        length = self.span if self.step is None else min(self.step, self.span)
        if rounding <= self.tolerance * length:
            return []
        return [
            f"times of this run are rounded to {rounding:.1g} s, because it begins at {self.start_time:.9g} s: what "
            "takes place in shorter times is lost, and events are off by that; begin near 0, and shift what depends on "
            "time"
        ]

    def grid(self) -> NDArray[np.float64]:
        """Output times [s]: multiples of the interval from the start, and the stop time."""
        count = math.floor((self.stop_time - self.start_time) / self.output_interval * (1 + 1e-12) + 1e-9)
        times = multiples(self.start_time, self.output_interval, np.arange(count + 1))
        if self.stop_time - times[-1] > 1e-9 * self.output_interval:
            return np.append(times, self.stop_time)
        times[-1] = self.stop_time
        return times


def options(
    experiment: Experiment,
    *,
    start_time: float | None = None,
    stop_time: float | None = None,
    output_interval: float | None = None,
    tolerance: float | None = None,
    solver: str | None = None,
    step: float | None = None,
    max_step: float | None = None,
    native: bool | None = None,
) -> Options:
    """Build the options from a model's experiment and the values that the caller overrides.

    Raises UsageError: AC030 if times, tolerance or steps are invalid, AC038 for a step given to a solver that chooses
    its own, and for a `max_step` beside a fixed step.
    """
    start = experiment.start_time if start_time is None else _number("start_time", start_time)
    stop = experiment.stop_time if stop_time is None else _number("stop_time", stop_time)
    # The experiment's fixed step is ignored if the solver always controls its steps, or if one that can do so is given
    # together with a tolerance.
    adaptive = solver in _ADAPTIVE or (tolerance is not None and solver is not None and solver not in _FIXED_STEP)
    declared_step = None if adaptive else experiment.step
    interval = output_interval if output_interval is not None else experiment.output_interval
    method = experiment.solver if solver is None else solver
    fixed_step = declared_step if step is None else _number("step", step)
    spacing = (stop - start) / 500 if interval is None else _number("output_interval", interval)
    if output_interval is None and method in _FIXED_STEP and fixed_step is not None and spacing < fixed_step < math.inf:
        # These methods only give values at the ends of their steps: default rows must not make the steps shorter.
        spacing = min(fixed_step, max(stop - start, spacing))
    chosen = Options(
        start_time=start,
        stop_time=stop,
        output_interval=spacing,
        tolerance=experiment.tolerance if tolerance is None else _number("tolerance", tolerance),
        solver=method,
        step=fixed_step,
        max_step=experiment.max_step if max_step is None else _number("max_step", max_step),
        native=native,
    )
    checks = (
        (math.isfinite(start), f"start_time {start:g} s is not a finite time"),
        (math.isfinite(stop), f"stop_time {stop:g} s is not a finite time"),
        (
            stop > start,
            f"stop_time {stop:g} s is not after start_time {start:g} s",
        ),
        (chosen.output_interval > 0, f"output_interval {chosen.output_interval:g} s is not positive"),
        (
            chosen.output_interval * 2e7 > stop - start,
            f"output_interval {chosen.output_interval:g} s gives too many rows",
        ),
        (0 < chosen.tolerance < 1, f"tolerance {chosen.tolerance:g} is not between 0 and 1"),
        (
            chosen.tolerance >= _FINEST_TOLERANCE,
            f"tolerance {chosen.tolerance:g} is below 1e-14, the limit of numbers with 16 digits",
        ),
        (chosen.step is None or chosen.step > 0, f"step {chosen.step} s is not positive"),
        (chosen.max_step is None or chosen.max_step > 0, f"max_step {chosen.max_step} s is not positive"),
    )
    for holds, fact in checks:
        if not holds:
            raise UsageError("AC030", fact)
    if chosen.solver in _ADAPTIVE and chosen.step is not None:
        raise UsageError(
            "AC038",
            f"solver '{chosen.solver}' chooses its steps itself: a step of {chosen.step:g} s would change nothing",
            help="leave the step out and give a tolerance; rk2, rk, collocation, erk and rosenbrock take fixed steps",
        )
    if max_step is not None and chosen.step is not None:
        raise UsageError(
            "AC038",
            f"steps of {chosen.step:g} s are fixed: a max_step of {max_step:g} s would change nothing",
            help="leave one of them out",
        )
    # it bounds nothing, so that a note on what long steps may miss is still due
    is_idle = chosen.max_step is not None and chosen.max_step >= chosen.span
    return replace(chosen, max_step=None) if is_idle else chosen


def _number(name: str, value: object) -> float:
    try:
        return float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError) as error:
        raise UsageError(
            "AC030", f"{name} = {value!r} is not a number", help="one number, in s or without unit"
        ) from error


def parameter_vector(compiled: CompiledModel, given: Mapping[str, object]) -> Vector:
    """Values of the free parameters, shape (np,), with the given ones replaced.

    Raises UsageError: AC020 for an unknown name, AC022 for a parameter that depends on others in this compiled model,
    AC023 for a value that is no number or has another shape, AC029 for values for which the model would be compiled to
    other states or pivots.
    Raises DeclarationError: AC136 for a value outside its limits, AC139 for values that contradict each other.
    """
    p = np.array(compiled.parameter_values, dtype=float)
    if not given:  # saves the dictionaries below, as large models have thousands of names
        return p
    index = {name: k for k, name in enumerate(compiled.parameters)}
    declared = {f.path: f for f in compiled.flat.parameters}
    # an entry replaces that of its whole array, in any order, as in `compile`
    for path, value in sorted(given_values(given).items(), key=lambda item: item[0] not in declared):
        exact = declared.get(path)
        names = [path + s for s in suffixes(exact.declaration.shape)] if exact is not None else [path]
        fixed = [n for n in names if n in compiled.flat.frozen]
        if fixed:
            raise UsageError(
                "AC022",
                f"{fixed[0]} was frozen when this model was compiled",
                help="compile again without it in freeze, or with its new value",
            )
        if exact is not None and not exact.free:
            raise UsageError(
                "AC022",
                f"{path} follows from other parameters in this compiled model",
                help=f"set those, or compile again: acausal.compile(model, parameters={{{path!r}: ...}})",
            )
        if names[0] not in index:
            raise UsageError(
                "AC020",
                f"there is no parameter '{path}'",
                evidence=meant(path, list(index)),
            )
        declaring = declared.get(path if exact is not None else path.rpartition("[")[0])
        shape = exact.declaration.shape if exact is not None else ()
        numbers = entries(path, shape, value, declaring.declaration.unit if declaring else "")
        for name, number in zip(names, numbers, strict=True):
            if declaring is not None:
                check_limit(declaring.path, name.removeprefix(declaring.path), declaring.declaration, number)
            p[index[name]] = number
    check_values(compiled.flat, p.tolist())
    _check_choices(compiled, p.tolist())
    return p


def _check_choices(compiled: CompiledModel, values: list[float]) -> None:
    """Raise UsageError AC029 unless what was decided by the values at compile time also holds for these."""
    fact, evidence, cause = "", "", "whether a constraint determines its variables depends on the values of parameters"
    if not choices_hold_for(compiled, values):
        fact, evidence = "other states", f"its states: {', '.join(compiled.states[:6])}"
    elif shrunk := shrunken_divisor(compiled, values, LOST):
        fact, evidence, cause = "other pivots", shrunk, "a quotient by a rounding error has no digits"
    if fact:
        raise UsageError(
            "AC029",
            f"{compiled.name} has {fact} with these parameters than those it was compiled with",
            evidence=[evidence],
            cause=cause,
            help="compile it with these values: acausal.compile(model, parameters={...})",
        )


def input_vector(compiled: CompiledModel, given: Mapping[str, float], unchecked: Collection[str] = ()) -> Vector:
    """Values of the model's inputs, shape (nu,); those that are not given have their declared defaults.

    `unchecked` are inputs whose numbers here are only placeholders.

    Raises UsageError: AC033 if an input is missing, unknown or no finite number.
    Raises DeclarationError: AC136 for a value outside the limits of its input.
    """
    if not isinstance(given, Mapping):
        raise UsageError("AC033", f"inputs is a {type(given).__name__}", help="a dictionary: inputs={'u': 0.0}")
    unknown = [n for n in given if n not in compiled.inputs]
    scalars = dict(zip(compiled.inputs, compiled.flat.inputs, strict=True))
    missing = [n for n in compiled.inputs if n not in given and scalars[n] not in compiled.flat.starts]
    if unknown or missing:
        example = (missing or [*compiled.inputs, "u"])[0]
        fact, cause = f"there is no input '{unknown[0]}'" if unknown else f"input {missing[0]} has no value", None
        if unknown and any(v.path == unknown[0] for v in compiled.flat.variables):
            fact = f"{unknown[0]} is not an input, but a variable to which the model gives a value"
            cause = "an equation, a connection, or a default that is not a single number: true or false, or a vector"
            if any(name.startswith(f"{unknown[0]}[") for name in compiled.inputs):
                fact, cause = f"{unknown[0]} is a vector, and each of its elements an input", None
        raise UsageError(
            "AC033",
            fact,
            evidence=[f"inputs of {compiled.name}: {', '.join(compiled.inputs) or 'none'}"],
            cause=cause,
            help=f"inputs={{'{example}': 0.0}}, or --input {example}=0; or bind it in the model",
        )
    u = np.zeros(len(compiled.inputs))
    for k, name in enumerate(compiled.inputs):
        try:
            u[k] = given[name] if name in given else declared_input(compiled, scalars[name])
        except (TypeError, ValueError):
            u[k] = np.nan
        if not np.isfinite(u[k]):
            help = "one constant here; functions of time and data go with simulate(tolerance=...)"
            raise UsageError("AC033", f"input {name} = {given[name]!r} is not a finite number", help=help)
        if name not in unchecked:
            check_limit(name, "", compiled.flat.declaration(scalars[name]), float(u[k]))
    return u


def declared_input(compiled: CompiledModel, scalar: int) -> float:
    """Declared default of an input, evaluated with the declared parameters; 0 if there is none."""
    start = compiled.flat.starts.get(scalar)
    if start is None:
        return 0.0
    leaves = {"par": compiled.parameter_values.__getitem__, "time": lambda _: compiled.flat.experiment.start_time}
    return float(values(compiled.flat.pool, [start.node], leaves)[start.node])
