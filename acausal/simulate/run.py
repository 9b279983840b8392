"""`simulate`: runs a component or a compiled model, and returns its result."""

from __future__ import annotations

import logging
import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any, cast

from acausal.arrays import Vector
from acausal.errors import InitializationError, IntegrationError, RunError, UsageError
from acausal.flatten.instances.instances import changing
from acausal.flatten.parameters import given_values, unheard_parameters
from acausal.language.choices import Choice
from acausal.language.component import Component
from acausal.lower.compile import compile
from acausal.lower.compiled import CompiledModel
from acausal.lower.lowered import Recipe
from acausal.lower.variants.started import discrete_starts, with_driven, with_starts
from acausal.providers import provided
from acausal.result.result import Result
from acausal.simulate.driver.agenda import Source
from acausal.simulate.driver.run import Progress, Run
from acausal.simulate.inputs.given import Inputs, given_inputs
from acausal.simulate.interrupt import interruptible
from acausal.simulate.options import Options, options, parameter_vector
from acausal.simulate.record.divisors.pivots import without_lost_pivots
from acausal.simulate.restructure.restructure import Pieces, RunPiece
from acausal.simulate.review import reviews
from acausal.simulate.start.initialize import Start

_log = logging.getLogger(__name__)
# Attempts at a run, each with other pivots or another solver.
_MOST_ATTEMPTS = 4


@interruptible
def simulate(
    model: Component | CompiledModel,
    *,
    start_time: float | None = None,
    stop_time: float | None = None,
    output_interval: float | None = None,
    tolerance: float | None = None,
    accuracy: float | None = None,
    solver: str | None = None,
    step: float | None = None,
    max_step: float | None = None,
    parameters: Mapping[str, object] | None = None,
    inputs: Mapping[str, Any] | None = None,
    start: Mapping[str, object] | None = None,
    outputs: Sequence[str] | None = None,
    native: bool | None = None,
    force: bool = False,
    progress: Progress | None = None,
) -> Result:
    """Simulate a model.

    Parameters
    ----------
    model
        A component, or a model from `compile` (which is not compiled again).
    start_time, stop_time, output_interval, step
        Seconds; None takes them from the model's `experiment`. The default interval gives 500 intervals.
    tolerance
        Relative tolerance of the result; absolute tolerances are a thousandth of it times the nominal magnitude.
    accuracy
        Wanted accuracy of the result instead of a tolerance. A bench of the model (`acausal.bench`, which takes many
        runs) first finds the cheapest solver and tolerance that reach it. A given solver is kept.
    solver
        "auto", "idas", "rosenbrock", "cvodes", "erk", "collocation", "rk" or "rk2".
    max_step
        Bound on the steps [s] of a solver that chooses them; if shorter than a pulse, none steps over that pulse.
    parameters
        Values by path, as numbers in SI or strings with a unit ("1 N/cm"). They never recompile a compiled model.
    inputs
        The model's own inputs by name, and those that `free` has made. A number, with or without unit ("20 degC"), is
        constant. A function of time in s, a `TimeSeries`, `(times, values)`, rows `(time, value)`, "file.csv:column", a
        pandas Series and a `Result` (its signal of that name, or `(result, name)`) are followed within a tenth of the
        tolerance, relative to the mean size of their variation (docs/inputs.md). Inputs with a default may be left out.
    start
        Start values of variables by path, in SI or with a unit. They replace the declared ones and hold like `fixed`.
    outputs
        Names of variables: only the equations on which these depend are simulated (see `compile(model, outputs=...)`).
        Only for components; components whose contacts change the structure are simulated completely.
    native
        True compiles the equations to C, False interprets them. None uses compiled code if there is some, and compiles
        if the run is long (docs/devdocs/native.md). Without a C compiler everything is interpreted, with equal results.
    force
        True runs even with a fixed step that is too large to be stable, which is otherwise refused (AC405).
    progress
        Called with the completed fraction and the time reached [s].

    Raises
    ------
    AcausalError
        `RunError.result` holds the rows computed before a failure.
    KeyboardInterrupt
        Its attribute `result` holds the rows computed before the interrupt.
    """
    times = {"start_time": start_time, "stop_time": stop_time, "output_interval": output_interval, "step": step}
    given: dict[str, Any] = {**times, "max_step": max_step, "tolerance": tolerance, "solver": solver, "native": native}
    recipe = _recipe(model, parameters)
    if recipe is not None and accuracy is None:
        opts = options(type(recipe.model).experiment, **given)
        joined = Pieces(recipe, opts, recipe.parameters, _piece(inputs, start, opts, force), progress).result()
        return _with_remarks(joined, opts.notes)
    compiled = _compiled(model, parameters, outputs if recipe is None else None, is_fixed=recipe is None)
    compiled = with_starts(compiled, start) if start else compiled
    values = parameters if isinstance(model, CompiledModel) else None
    if accuracy is not None:
        rest = {"parameters": values, "inputs": inputs, "force": force}
        return cast(Result, provided("simulated_to_accuracy")(compiled, accuracy, given, rest, progress))
    opts = options(compiled.flat.experiment, **given)
    with _naming_infinite(compiled, values or {}):
        result = _result(compiled, opts, values or {}, inputs or {}, progress, force)
    return _with_remarks(result, opts.notes + _remarks(compiled, result, values or {}, start or {}))


@contextmanager
def _naming_infinite(compiled: CompiledModel, parameters: Mapping[str, object]) -> Iterator[None]:
    """Name infinite parameters in errors of a run."""
    try:
        yield
    except (RunError, InitializationError) as error:
        error.evidence = (*error.evidence, *_infinite(compiled, parameter_vector(compiled, parameters), str(error)))
        raise


def _infinite(compiled: CompiledModel, p: Vector, known: str) -> list[str]:
    """Parameters in `p`, shape (np,), that are infinite without being declared so, and not in the message `known`."""
    declared = {f.path: f.declaration.default for f in compiled.flat.parameters}
    values = zip(compiled.parameters, p.tolist(), strict=True)
    infinite = [name for name, v in values if math.isinf(v) and declared.get(name) != v and f"{name} = " not in known]
    return [f"infinite: {', '.join(infinite[:4])}"] * bool(infinite)


def _remarks(
    compiled: CompiledModel, result: Result, values: Mapping[str, object], start: Mapping[str, object]
) -> list[str]:
    """Notes on parameters and starts that were given for a run, and those of components that review it."""
    remarks = list(unheard_parameters(compiled.flat, values) if values else ())
    remarks += _start_remarks(result, discrete_starts(compiled, start) if start else {})
    if reviewing := compiled.flat.reviewing:
        remarks += reviews(reviewing, result, {v.path: v.first for v in compiled.flat.variables})
    return remarks


def _start_remarks(result: Result, starts: Mapping[str, float]) -> list[str]:
    """Notes on discrete variables that do not begin with their given start values.

    A start value of a continuous variable is a condition that must hold (AC302). A start value of a discrete variable
    is its value *before* the start, and its equations and `when` clauses determine the value at the start.
    """
    return [
        f"{name} was given the start {value:g}, and begins with {result[name][0]:g}, as its equations or an event at "
        "the start determine"
        for name, value in starts.items()
        if name in result and len(result.time) and result[name][0] != value
    ]


def _with_remarks(result: Result, remarks: Sequence[str]) -> Result:
    """Add notes to the result, and write them to the log."""
    if not remarks:
        return result
    for remark in remarks:
        _log.warning("%s: %s", result.model, remark)
    notes: Any = result.stats.get("notes", ())
    return replace(result, stats={**result.stats, "notes": (*notes, *remarks)})


def _result(
    compiled: CompiledModel,
    chosen: Options,
    parameters: Mapping[str, object],
    inputs: Mapping[str, Any],
    progress: Progress | None,
    force: bool,
) -> Result:
    """Run a compiled model.

    A run that fails because a pivot vanishes is repeated with other pivots. A run that fails with the solver that
    `auto` chose is repeated with IDAS.

    Raises UsageError: AC029 for parameters for which the model would be compiled to other states or pivots.
    """
    p = parameter_vector(compiled, parameters)
    given = given_inputs(compiled, inputs, chosen.start_time, chosen.stop_time, chosen.tolerances)
    first_failure: tuple[float, IntegrationError] | None = None
    tried = ""
    for attempts_left in reversed(range(_MOST_ATTEMPTS)):
        driven = with_driven(compiled, given.places) if given.places else compiled
        run = Run(driven, chosen, p.copy(), given, progress, force)
        if first_failure is not None:
            run.why = f"{tried}, which fits its size and structure, stopped at t = {first_failure[0]:g} s"
        try:
            return run.result()
        except IntegrationError as error:
            if run.stopped is not None and first_failure is not None and first_failure[0] >= run.stopped.start:
                raise first_failure[1] from None  # IDAS came no farther
            if not attempts_left or run.recorder is None or run.stopped is None:
                raise
            with_other_pivots = without_lost_pivots(run.recorder, run.stopped)
            if with_other_pivots is not None:
                _log.debug("%s: a divisor vanishes at t = %g s; restarted", compiled.name, run.stopped.start)
                compiled = with_other_pivots
                continue
            # A derivative that is undefined at one point, like that of fabs at 0, does not harm the corrector of IDAS,
            # which iterates to convergence. A Rosenbrock method relies on it as the Jacobian, and rejects every step.
            if chosen.solver != "auto" or run.solver.name not in ("rosenbrock", "erk"):
                raise
            tried = run.solver.name
            chosen, first_failure = replace(chosen, solver="idas"), (run.stopped.start, error)
    raise AssertionError("the last attempt returns or raises")


def _recipe(model: Component | CompiledModel, parameters: Mapping[str, object] | None) -> Recipe | None:
    """Return the recipe of a model whose structure changes during a run; None for all others."""
    if isinstance(model, CompiledModel):
        if model.recipe is None:
            return None
        if parameters:
            parameter_vector(model, parameters)  # refuses invalid ones
        return replace(model.recipe, parameters={**model.recipe.parameters, **(parameters or {})})
    return Recipe(model, given_values(parameters)) if changing(model) else None


def _compiled(
    model: Component | CompiledModel,
    parameters: Mapping[str, object] | None,
    outputs: Sequence[str] | None,
    is_fixed: bool,
) -> CompiledModel:
    """Compile the model; raises UsageError AC018 for outputs of a model that is already compiled.

    `is_fixed` says that no component changes its structure during a run, so that there is no structure to choose.
    """
    if not isinstance(model, CompiledModel):
        choices: dict[str, Choice] | None = {} if is_fixed and outputs is None else None
        return compile(model, parameters=parameters, outputs=outputs, choices=choices)
    if outputs is not None:
        raise UsageError(
            "AC018", "a compiled model has its outputs already", help="give them to compile(model, outputs=[...])"
        )
    return model


def _piece(
    inputs: Mapping[str, Any] | None,
    starts: Mapping[str, object] | None,
    whole: Options,
    force: bool,
) -> RunPiece:
    """Return the function that runs one piece of a run with changing structure; `whole` are the options of the run."""
    inputs_of: dict[tuple[str, ...], Inputs] = {}

    def run(
        compiled: CompiledModel,
        opts: Options,
        start: Start | None,
        outputs: Vector,
        opening: bool,
        sources: tuple[Source, ...],
        report: Progress | None,
    ) -> Result:
        if compiled.inputs not in inputs_of:
            span = whole.start_time, whole.stop_time
            inputs_of[compiled.inputs] = given_inputs(compiled, inputs or {}, *span, whole.tolerances)
        given, p = inputs_of[compiled.inputs], parameter_vector(compiled, {})
        if start is None:
            compiled = with_starts(compiled, starts or {})
        driven = with_driven(compiled, given.places) if given.places else compiled
        piece = Run(driven, opts, p, given, report, force, start, outputs, opening, sources=sources)
        return piece.start() if start is None else piece.result()

    return run
