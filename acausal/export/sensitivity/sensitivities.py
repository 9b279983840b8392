"""Derivatives of final values, trajectories and event times with respect to parameters, through all events of a run.

The sequence of events is assumed to be that of the nominal run.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from acausal.arrays import Vector
from acausal.errors import UsageError, listed_names, meant
from acausal.export.forms import SENSITIVITIES, check
from acausal.export.ports import named_outputs
from acausal.export.sensitivity.chain import Chain, Derivatives
from acausal.export.sensitivity.missed import refuse_missed
from acausal.export.sensitivity.two_sided import refuse_two_sided
from acausal.language.component import Component
from acausal.lower.compile import compile
from acausal.lower.compiled import CompiledModel
from acausal.result.result import Result
from acausal.simulate.driver.run import Run
from acausal.simulate.inputs.given import Inputs
from acausal.simulate.options import Options, input_vector, options, parameter_vector

_log = logging.getLogger(__name__)
# The result has a note if derivatives at two tolerances differ, relatively, by more than this many tolerances; ratio of
# the two tolerances; the comparison is made if the known errors exceed this fraction of the first limit.
_APART, _LOOSER, _SUSPECT = 1e3, 3.0, 1 / 3
# Derivatives count as zero if a change of the parameter by its value would change an output by a smaller fraction.
_NOTHING = 1e-30


@dataclass(frozen=True, eq=False)
class Sensitivities:
    """First derivatives of one run.

    Attributes
    ----------
    parameters, outputs
        Names, in the order of columns and rows.
    final
        d output / d parameter at the stop time, shape (outputs, parameters), SI; where `terminate` has ended the
        run, of the values at that instant, which moves.
    values
        The outputs at the stop time.
    event_times
        Instants of the located events [s], shape (events,).
    of_event_times
        d instant / d parameter, shape (events, parameters); nan where several events meet that it moves apart.
    result
        The run itself.
    times, along
        Requested instants [s], shape (times,), and d output / d parameter at each, shape (times, outputs, parameters);
        at an event just after it.
    """

    parameters: tuple[str, ...]
    outputs: tuple[str, ...]
    final: Vector
    values: Vector
    event_times: Vector
    of_event_times: Vector
    result: Result
    times: Vector = field(default_factory=lambda: np.zeros(0))
    along: Vector = field(default_factory=lambda: np.zeros((0, 0, 0)))


def sensitivities(
    model: Component | CompiledModel,
    parameters: Sequence[str],
    outputs: Sequence[str],
    *,
    start_time: float | None = None,
    stop_time: float | None = None,
    tolerance: float = 1e-10,
    solver: str | None = None,
    values: Mapping[str, float] | None = None,
    inputs: Mapping[str, float] | None = None,
    method: Literal["forward", "adjoint"] = "forward",
    times: Sequence[float] | Vector = (),
    native: bool | None = None,
) -> Sensitivities:
    """Differentiate the final values of `outputs` and all event times with respect to `parameters`.

    Parameters
    ----------
    parameters
        Names of free scalar parameters of the compiled model.
    outputs
        Names of variables, as in a `Result`.
    values
        Parameter values of this run, by path, in SI.
    method
        "forward" integrates a column per parameter; "adjoint" then a row per output and event backwards, too.
    times
        Additional instants [s], shape (times,), at which the outputs are differentiated.
    native
        Whether the run and its derivatives use compiled C, as in `simulate`; compiled code is cached on disk.

    Raises
    ------
    UsageError
        AC020 for an unknown or no parameter, AC010 for an unknown output, AC025 for an unknown method, AC044 for
        `times` outside the run.
    ExportError
        AC608 if states are reset together with an impulse; AC615 if a relation is only just crossed or missed, if the
        run rests on a kink with two derivatives, begins on a relation with an effect, or has a rate that jumps without
        an event, and if parameters move an event across the stop time, or move apart events whose order matters.
    AcausalError
        Errors of the run itself.
    """
    if method not in ("forward", "adjoint"):
        raise UsageError("AC025", f"there is no method '{method}'", help="methods: forward, adjoint")
    compiled = model if isinstance(model, CompiledModel) else compile(model, parameters=values)
    wanted, parameters = named_outputs(compiled, outputs), listed_names("parameters", parameters)
    check(compiled, SENSITIVITIES, wanted)
    chosen = _indices_of(compiled, parameters)
    given = {"start_time": start_time, "stop_time": stop_time, "tolerance": tolerance}
    opts = options(compiled.flat.experiment, **given, solver=solver, native=native)
    p = parameter_vector(compiled, (values or {}) if isinstance(model, CompiledModel) else {})

    def chain_of(opts: Options) -> tuple[Chain, Result]:
        run = Run(compiled, opts, p, Inputs(input_vector(compiled, inputs or {})), None, traced=True)
        result = run.result()
        return Chain(run, chosen, wanted, opts.tolerance), result

    chain, result = chain_of(opts)
    refuse_missed(chain)
    refuse_two_sided(chain)
    requested = _checked_times(times, chain)
    found, wrong, of_times = _derived(chain, method, requested)
    if (np.abs(wrong) > _SUSPECT * _APART * tolerance * (np.abs(found) + _least(chain))).any():
        looser, _ = chain_of(replace(opts, tolerance=_LOOSER * tolerance))
        other, *_ = _derived(looser, method, np.minimum(requested, looser.stop))
        result = _with_note(result, chain, found, other)
    located = [k for k in range(len(chain.passages)) if not chain.is_no_event(k)]
    return Sensitivities(
        tuple(parameters),
        tuple(output.name for output in wanted),
        found[0],
        chain.values(),
        np.array([chain.passages[k].time for k in located]),
        of_times[located],
        result,
        requested,
        found[1:],
    )


def _derived(chain: Chain, method: str, times: Vector) -> tuple[Vector, Vector, Vector]:
    """(Derivatives at the end and then at `times` [s], their known errors, derivatives of event times).

    Shapes (1 + times, ny, count), the same, and (n_events, count).
    """
    ended: Derivatives = getattr(chain, method)()
    found, wrong = ended.final[None], ended.wrong[None]
    if len(times):
        along, along_wrong = np.split(chain.trajectory(times, with_errors=True), 2, axis=2)
        found, wrong = np.concatenate([found, along]), np.concatenate([wrong, along_wrong])
    return found, wrong, ended.of_times


def _with_note(result: Result, chain: Chain, found: Vector, other: Vector) -> Result:
    """The run, with a note if its derivatives, shape (instants, ny, count), differ from those at a looser tolerance."""
    size = np.maximum(np.abs(found), np.abs(other)) + _least(chain)
    difference = float((np.abs(found - other) / size).max(initial=0.0))
    if difference <= _APART * chain.tolerance:
        return result
    note = (
        f"derivatives are uncertain: at {_LOOSER:g} times the tolerance they differ by {difference:.1g} of their size, "
        "since slopes are steep or infinite where an event is, or are rounding errors"
    )
    _log.warning("%s", note)
    notes: Any = result.stats.get("notes", ())
    return replace(result, stats={**result.stats, "notes": (*notes, note)})


def _least(chain: Chain) -> Vector:
    """Magnitudes below which derivatives count as zero, shape (ny, count).

    They include derivatives with which a change of the parameter by its value would change an output by less than the
    fraction `_NOTHING`: these may be rounding errors in steep slopes that remain when a derivative has decayed.
    """
    y_x, *_ = chain.output()
    least = 1e-6 * np.abs(y_x) @ chain.scale + 1e-12 * chain.scale.max(axis=0, initial=0.0) + 1e-290
    sizes = np.abs(chain.p[chain.chosen])
    per_output = np.divide(_NOTHING, sizes, out=np.zeros_like(sizes), where=sizes > 0.0)
    return np.asarray(least + np.outer(np.abs(chain.values()), per_output))


def _checked_times(times: Sequence[float] | Vector, chain: Chain) -> Vector:
    """The instants, shape (times,); UsageError AC044 if any is outside the run."""
    requested = np.asarray(times, dtype=float)
    start, stop = chain.passages[0].time, chain.stop
    if len(requested) and not (start <= requested.min() and requested.max() <= stop):
        raise UsageError(
            "AC044",
            f"derivatives are requested from {requested.min():g} to {requested.max():g} s, outside of the run",
            help=f"the run goes from {start:g} to {stop:g} s",
        )
    return requested


def _indices_of(compiled: CompiledModel, parameters: Sequence[str]) -> list[int]:
    """Indices in p of the named parameters; UsageError AC020 for an unknown one, or without any."""
    if not parameters:
        free = ", ".join(compiled.parameters[:6]) or "none"
        raise UsageError("AC020", "there is no parameter to differentiate by", evidence=[f"parameters: {free}"])
    for name in parameters:
        if name not in compiled.parameters:
            evidence = meant(name, list(compiled.parameters))
            raise UsageError("AC020", f"there is no parameter '{name}'", evidence=evidence)
    return [compiled.parameters.index(name) for name in parameters]
