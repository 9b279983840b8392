"""`simulate`: a component or a compiled model, and how it shall be run, to a result."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from acausal.arrays import Vector
from acausal.errors import IntegrationError, UsageError
from acausal.flatten.instances.instances import changing
from acausal.flatten.parameters import unheard_parameters
from acausal.language.choices import Choice
from acausal.language.component import Component
from acausal.lower.cache.cache import choices_hold_for
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
from acausal.simulate.record.pivots import without_lost_pivots
from acausal.simulate.restructure.restructure import Pieces, RunPiece
from acausal.simulate.start.initialize import Start

_log = logging.getLogger(__name__)
# Times that a run is made, each time with other pivots.
_MOST_FORMS = 4


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
        A component, or what `compile` made of it (then nothing is compiled again).
    start_time, stop_time, output_interval, step
        Seconds; None takes them from the model's `experiment`. The default interval gives 500 intervals.
    tolerance
        Relative tolerance of the solver; absolute ones are a thousandth of it times the nominal magnitude.
    accuracy
        Wanted accuracy of the result instead of a tolerance: solver and tolerance are then the cheapest that reach it,
        which a bench of the model finds first (`acausal.bench`; that takes many runs). A given solver is kept.
    solver
        "auto", "idas", "rosenbrock", "cvodes", "erk", "collocation", "rk" or "rk2".
    max_step
        No step of a solver that chooses them is longer [s]: of what comes and goes in less it must see something.
    parameters
        Values by path, numbers in SI or texts with a unit ("1 N/cm"); they never recompile a compiled model.
    inputs
        The model's own inputs by name, and those that `free` has made. A number, with or without unit ("20 degC"), is
        constant. A function of time in s, a `TimeSeries`, `(times, values)`, rows `(time, value)`, "file.csv:column", a
        pandas Series and a `Result` (its signal of that name, or `(result, name)`) are followed within a tenth of the
        tolerance, relative to the mean size of their variation (docs/inputs.md). Inputs with a default may be left out.
    start
        Start values of variables by path, in SI or with a unit, instead of the declared ones: they hold as `fixed`
        does.
    outputs
        Names of variables: only what these depend on is simulated, as `compile(model, outputs=...)` says. For a
        component; one whose contacts change its structure runs whole.
    native
        True compiles the equations to C, False interprets them; None uses what is compiled already, and compiles when
        a run is long (docs/devdocs/native.md). Without a C compiler everything is interpreted; results are the same.
    force
        True runs with a fixed step even where it is too large to be stable, which is refused otherwise (AC405).
    progress
        Called with the fraction done and the time reached.

    Raises
    ------
    AcausalError
        `RunError.result` holds what was computed before a failure.
    KeyboardInterrupt
        With a `result` attribute that holds what was computed.
    """
    times = {"start_time": start_time, "stop_time": stop_time, "output_interval": output_interval, "step": step}
    asked: dict[str, Any] = {**times, "max_step": max_step, "tolerance": tolerance, "solver": solver, "native": native}
    recipe = _recipe(model, parameters)
    if recipe is not None and accuracy is None:
        chosen = options(type(recipe.model).experiment, **asked)
        return Pieces(recipe, chosen, recipe.parameters, _piece(inputs, start, chosen, force), progress).result()
    compiled = _compiled(model, parameters, outputs if recipe is None else None, is_fixed=recipe is None)
    compiled = with_starts(compiled, start) if start else compiled
    own = parameters if isinstance(model, CompiledModel) else None
    if accuracy is not None:
        more = {"parameters": own, "inputs": inputs, "force": force}
        made: Result = provided("simulated_to_accuracy")(compiled, accuracy, asked, more, progress)
        return made
    result = _result(compiled, options(compiled.flat.experiment, **asked), own or {}, inputs or {}, progress, force)
    remarks = unheard_parameters(compiled.flat, own) if own else ()
    return _with_remarks(result, (*remarks, *_start_remarks(result, discrete_starts(compiled, start) if start else {})))


def _start_remarks(result: Result, starts: Mapping[str, float]) -> list[str]:
    """Notes on discrete variables that do not begin with the values that they were given.

    Those of continuous variables hold like conditions (AC302). That of a discrete variable is its value *before* the
    start, and its equations and clauses decide what follows from it.
    """
    return [
        f"{name} was given the start {value:g}, and begins with {result[name][0]:g}: its equations or an event at the "
        "start say so"
        for name, value in starts.items()
        if name in result and len(result.time) and result[name][0] != value
    ]


def _with_remarks(result: Result, remarks: Sequence[str]) -> Result:
    """The result with more notes, which the log tells too."""
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
    """The run; where it fails because a pivot is lost, again with others, and where `auto` chose wrong, with IDAS.

    Raises UsageError: AC029 for parameters for which the chosen states are no longer good.
    """
    p = parameter_vector(compiled, parameters)
    if parameters:
        _check_choices(compiled, p)
    given = given_inputs(compiled, inputs, chosen.start_time, chosen.stop_time, chosen.tolerances)
    failed: tuple[float, IntegrationError] | None = None
    tried = ""
    for left in reversed(range(_MOST_FORMS)):
        driven = with_driven(compiled, given.places) if given.places else compiled
        run = Run(driven, chosen, p.copy(), given, progress, force)
        if failed is not None:
            run.why = f"{tried}, which fits its size and structure, stopped at t = {failed[0]:g} s"
        try:
            return run.result()
        except IntegrationError as error:
            if run.stopped is not None and failed is not None and failed[0] >= run.stopped.start:
                raise failed[1] from None  # the other solver came no farther
            if not left or run.recorder is None or run.stopped is None:
                raise
            other = without_lost_pivots(run.recorder, run.stopped)
            if other is not None:
                _log.debug("%s: a divisor vanishes at t = %g s; begun again", compiled.name, run.stopped.start)
                compiled = other
                continue
            # a slope that is undefined in one point, as that of fabs at 0, is nothing to a corrector that goes on
            # until it has converged; a Rosenbrock step takes it for the Jacobian and is never small enough
            if chosen.solver != "auto" or run.solver.name not in ("rosenbrock", "erk"):
                raise
            tried = run.solver.name
            chosen, failed = replace(chosen, solver="idas"), (run.stopped.start, error)
    raise AssertionError("the last attempt returns or raises")


def _recipe(model: Component | CompiledModel, parameters: Mapping[str, object] | None) -> Recipe | None:
    """What a model whose structure changes while it runs is compiled from; None for all others."""
    if isinstance(model, CompiledModel):
        if model.recipe is None:
            return None
        if parameters:
            parameter_vector(model, parameters)  # refuses what is wrong with them
        return replace(model.recipe, parameters={**model.recipe.parameters, **(parameters or {})})
    return Recipe(model, dict(parameters or {})) if changing(model) else None


def _check_choices(compiled: CompiledModel, p: Vector) -> None:
    if not choices_hold_for(compiled, p.tolist()):
        raise UsageError(
            "AC029",
            f"{compiled.name} has other states with these parameters than those it was compiled with",
            evidence=[f"its states: {', '.join(compiled.states[:6])}"],
            cause="a constraint determines its variables with some values of its parameters, and not with others",
            help="compile it with these values: acausal.compile(model, parameters={...})",
        )


def _compiled(
    model: Component | CompiledModel,
    parameters: Mapping[str, object] | None,
    outputs: Sequence[str] | None,
    is_fixed: bool,
) -> CompiledModel:
    """The model compiled; AC018 for outputs of one that has its own already.

    `is_fixed`: no component changes its structure during a run, so that there is nothing to choose.
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
    """How one piece of a run of changing structure is run; `whole` are the options of all of it."""
    known: dict[tuple[str, ...], Inputs] = {}

    def run(
        compiled: CompiledModel,
        opts: Options,
        start: Start | None,
        outputs: Vector,
        opening: bool,
        sources: tuple[Source, ...],
        report: Progress | None,
    ) -> Result:
        if compiled.inputs not in known:
            span = whole.start_time, whole.stop_time
            known[compiled.inputs] = given_inputs(compiled, inputs or {}, *span, whole.tolerances)
        given, p = known[compiled.inputs], parameter_vector(compiled, {})
        if start is None:
            compiled = with_starts(compiled, starts or {})
        driven = with_driven(compiled, given.places) if given.places else compiled
        made = Run(driven, opts, p, given, report, force, start, outputs, opening, sources=sources)
        return made.start() if start is None else made.result()

    return run
