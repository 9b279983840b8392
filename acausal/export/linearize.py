"""Linearisation about a point of a trajectory: x' = A x + B u, y = C x + D u, for deviations from that point."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from acausal.arrays import Vector
from acausal.errors import ExportError, UsageError, meant
from acausal.export.forms import LINEAR, check
from acausal.export.kinks import Slopes, slopes_of_both_sides
from acausal.export.minimal.manifold import minimal, on_constraints
from acausal.export.observed import dae_function
from acausal.export.ports import Output, named_outputs
from acausal.export.run_parameters import RunParameters, parameters_of_run
from acausal.export.start_point import input_start
from acausal.language.component import Component
from acausal.lower.compile import compile
from acausal.lower.compiled import CompiledModel
from acausal.result.result import Result
from acausal.simulate.events.iteration import SLIDING
from acausal.simulate.options import input_vector, parameter_vector
from acausal.simulate.record.record import Dense
from acausal.simulate.restructure.joined import renamed
from acausal.simulate.restructure.restructure import lasting_names
from acausal.simulate.start.initialize import Start, consistent, initialize


@dataclass(frozen=True, eq=False)
class Linearization:
    """First-order model about one point, in SI units.

    Attributes
    ----------
    t
        Time of the point [s].
    states, inputs, outputs
        Names, in the order of the matrices' rows and columns.
    A, B, C, D
        Shapes (nx, nx), (nx, nu), (ny, nx), (ny, nu).
    x, u, y
        Values at the point; the matrices act on deviations from them.
    rates
        x' at the point: all zero at an equilibrium.
    notes
        Features that were left out, and states that were interpolated.
    """

    name: str
    t: float
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    A: Vector
    B: Vector
    C: Vector
    D: Vector
    x: Vector
    u: Vector
    y: Vector
    rates: Vector
    notes: tuple[str, ...] = ()

    def __repr__(self) -> str:
        sizes = f"{len(self.states)} states, {len(self.inputs)} inputs, {len(self.outputs)} outputs"
        return f"Linearization({self.name}: {sizes} at t = {self.t:g} s)"

    @property
    def matrices(self) -> tuple[Vector, Vector, Vector, Vector]:
        """(A, B, C, D), shapes as above, for `scipy.signal.StateSpace(*matrices)` and `control.ss(*matrices)`."""
        return self.A, self.B, self.C, self.D

    def to_control(self) -> Any:
        """A `control.StateSpace` of python-control with the names of states, inputs and outputs.

        Raises
        ------
        UsageError
            AC015 without the package control.
        """
        try:
            import control
        except ModuleNotFoundError as error:
            raise UsageError(
                "AC015", "this needs the package control, which is not installed", help="pip install control"
            ) from error
        names = {"states": list(self.states), "inputs": list(self.inputs), "outputs": list(self.outputs)}
        return control.ss(*self.matrices, **names)

    @property
    def eigenvalues(self) -> NDArray[np.complex128]:
        """Eigenvalues of A [1/s], shape (nx,), in ascending order of magnitude."""
        found = np.linalg.eigvals(self.A).astype(complex)
        return found[np.argsort(np.abs(found), kind="stable")]


def linearize(
    model: Component | CompiledModel,
    t: float | None = None,
    x: Mapping[str, float] | None = None,
    *,
    result: Result | None = None,
    inputs: Mapping[str, float] | None = None,
    outputs: Sequence[str] | None = None,
    parameters: Mapping[str, object] | None = None,
) -> Linearization:
    """Linearise a model at its start, at given states, or at an instant of a run.

    Algebraic variables are eliminated by the implicit function theorem. So are dependent states of stabilised
    constraints (closed loops of joints): the states of the result are a set of independent ones, chosen so that the
    others are well-conditioned functions of them at the point. Discrete variables do not count as states: they change
    at events only, and keep the values that they have at the point.

    Parameters
    ----------
    model
        A component or a compiled model.
    t
        Time [s]; None: the start of the model's experiment, or the end of `result`. If a source switches then, values
        after it are used. Without `result` the states are those of the start, since nothing is simulated.
    x
        Values of states and discrete variables by name; other states have the values of the start or of `result`,
        projected onto the constraints.
    result
        A run of this model, from which states, inputs and parameters are taken at time `t`.
    inputs
        Values of the model's own inputs at the point; others have their guess, or 0.
    outputs
        Names of variables for y; None: those declared in the model's class.
    parameters
        Values by path in SI; others are those of `result`.

    Raises
    ------
    UsageError
        AC010 for an unknown output or state, AC011 for a time outside the run, AC033 for an unknown input.
    InitializationError
        The model has no consistent values at the point.
    ExportError
        AC604 where the equations are singular in the algebraic variables or dependent states, rates or outputs have a
        kink or a jump, or the run slides; AC608 if events change what they depend on; AC609 if `x` is off constraints.
    """
    given = parameters or {}
    compiled, of_run = _compiled(model, result, given)
    wanted = named_outputs(compiled, outputs)
    notes = (*check(compiled, LINEAR, wanted), *of_run.notes)
    if t is None:
        t = compiled.flat.experiment.start_time if result is None else float(result.time[-1])
    values = {n: v for n, v in of_run.free.items() if not {n, n.partition("[")[0]} & given.keys()}
    p = parameter_vector(compiled, {**values, **(given if isinstance(model, CompiledModel) else {})})
    u = _inputs(compiled, t, p, result, inputs or {})
    _refuse_sliding(result, t)
    start = _point(compiled, t, p, u, result, x or {}, _lasting(compiled, result))
    coordinates = minimal(compiled, t, start, u, p, np.array(compiled.all_modes(t, start.x, start.z, u, p)).ravel())
    places = [k for k in coordinates.places if k < len(compiled.states) - compiled.discretes]
    names, point = [output.name for output in wanted], (start.x, start.z, u)
    slopes = slopes_of_both_sides(compiled, t, _slopes_of(compiled, wanted, t, p), point, coordinates, names)
    A, B, C, D = slopes.matrices
    # discrete variables come last
    by_coordinates, by_inputs = coordinates.of_coordinates[:, : len(places)], coordinates.of_inputs
    return Linearization(
        compiled.name,
        t,
        tuple(compiled.states[k] for k in places),
        compiled.inputs,
        tuple(names),
        (A @ by_coordinates)[places],
        (B + A @ by_inputs)[places],
        C @ by_coordinates,
        D + C @ by_inputs,
        start.x[places],
        u,
        slopes.y,
        slopes.rates[places],
        (*notes, *_between_rows(t, result), *_perhaps_sliding(result)),
    )


def _compiled(
    model: Component | CompiledModel, result: Result | None, given: Mapping[str, object]
) -> tuple[CompiledModel, RunParameters]:
    """The model with the given parameters, and with those of the run that are bound to others in the model.

    Raises UsageError: AC022 for a compiled model whose bindings the run has replaced.
    """
    compiled = model if isinstance(model, CompiledModel) else compile(model, parameters=given)
    if result is None:
        return compiled, RunParameters({}, {})
    of_run = parameters_of_run(compiled, result, _lasting(compiled, result))
    if of_run.replaced and not isinstance(model, CompiledModel):
        compiled = compile(model, parameters={**of_run.replaced, **given})
        of_run = parameters_of_run(compiled, result, _lasting(compiled, result))
    of_run.refuse_replaced(compiled)
    return compiled, of_run


def _lasting(compiled: CompiledModel, result: Result | None) -> Mapping[str, str]:
    """Beginnings of paths of contacts, and those of the same contacts in the result of a run."""
    return lasting_names(compiled.recipe.model) if compiled.recipe is not None and result is not None else {}


def _refuse_sliding(result: Result | None, t: float) -> None:
    """Raise ExportError AC604 where a run slides: its states are on one side of the switch by rounding or its errors.

    Its rates, a mean of those of both sides, are those of neither, and beyond its surface they jump.
    """
    if result is not None and isinstance(result.dense, Dense) and result.dense.held(t) is not None:
        raise ExportError(
            "AC604",
            f"{result.model} has no linearization at t = {t:g} s: a relation is held at its switch there",
            evidence=_notes_of_sliding(result)[:3],
            cause="rates jump across the switch; in a sliding mode the run has a mean of both",
            help="linearise before or after the sliding mode, or at other states without a run",
        )


def _perhaps_sliding(result: Result | None) -> list[str]:
    """A note if the run has slid, but its result, as one that was read from a file, no longer knows when."""
    found = [] if result is None or isinstance(result.dense, Dense) else _notes_of_sliding(result)
    return [f"the result does not tell whether the run slides at this point: {note}" for note in found[:1]]


def _notes_of_sliding(result: Result) -> list[str]:
    notes: Any = result.stats.get("notes", ())
    return [note for note in notes if SLIDING in note]


def _between_rows(t: float, result: Result | None) -> list[str]:
    """A note if the states at `t` are interpolated: a result read from a file has its rows only, no dense output."""
    if result is None or result.dense is not None or np.isclose(result.time, t, rtol=1e-12, atol=0.0).any():
        return []
    return [f"the states at t = {t:g} s are interpolated between the rows of the result, which has no others"]


def _slopes_of(
    compiled: CompiledModel, wanted: Sequence[Output], t: float, p: Vector
) -> Callable[[Vector, Vector, Vector], Slopes]:
    """Function `(x, z, u) -> Slopes`: the matrices for all states, with algebraic variables eliminated."""
    partial = [f"jac:{f}:{v}" for f in ("ode", "alg", "y") for v in ("x", "z", "u")]
    jacobian = dae_function(compiled, wanted).factory("jacobian", ["t", "x", "z", "u", "p"], ["ode", "y", *partial])
    pairs = [(f, v) for f in ("ode", "y") for v in ("x", "u")]

    def slopes(x: Vector, z: Vector, u: Vector) -> Slopes:
        found = {name: np.array(m) for name, m in zip(jacobian.name_out(), jacobian(t, x, z, u, p), strict=True)}
        dz = _algebraic_slopes(compiled, t, found)
        matrices = tuple(found[f"jac_{f}_{v}"] + found[f"jac_{f}_z"] @ dz[v] for f, v in pairs)
        return Slopes(found["ode"].ravel(), found["y"].ravel(), matrices, dz["x"], dz["u"])

    return slopes


def _inputs(compiled: CompiledModel, t: float, p: Vector, result: Result | None, given: Mapping[str, float]) -> Vector:
    if result is None:
        known = {n: input_start(compiled, s, p) for n, s in zip(compiled.inputs, compiled.flat.inputs, strict=True)}
    else:
        known = {n: float(result.at(t, n)) for n in compiled.inputs}
    return input_vector(compiled, {**known, **given}, unchecked=known.keys() - given.keys())


def _point(
    compiled: CompiledModel,
    t: float,
    p: Vector,
    u: Vector,
    result: Result | None,
    given: Mapping[str, float],
    lasting: Mapping[str, str],
) -> Start:
    """A consistent point with the given states; contacts that the run does not have at `t` have their start values."""
    m = np.array(compiled.modes(t, p)).ravel()
    if result is None:
        start = initialize(compiled, t, p, u, m)
    else:
        names = compiled.states, compiled.algebraic
        x, z = (np.array([_value(result, t, n, lasting) for n in v]) for v in names)
        if lasting and not (np.isfinite(x).all() and np.isfinite(z).all()):
            initial = initialize(compiled, t, p, u, m)
            x, z = np.where(np.isfinite(x), x, initial.x), np.where(np.isfinite(z), z, initial.z)
        start = Start(x, z, ())
    for name, value in given.items():
        if name not in compiled.states:
            raise UsageError(
                "AC010",
                f"'{name}' is not a state of {compiled.name}",
                evidence=meant(name, compiled.states),
                help=f"states: {', '.join(compiled.states)}",
            )
        start.x[compiled.states.index(name)] = value
    start = on_constraints(compiled, t, start, u, p, m, [compiled.states.index(name) for name in given])
    return _consistent_modes(compiled, t, start, p, u)


def _value(result: Result, t: float, name: str, lasting: Mapping[str, str]) -> float:
    """Value of a variable of the run at `t`; nan for a variable of a contact that never occurred."""
    run_name = renamed(name, lasting)
    return float("nan") if run_name != name and run_name not in result else float(result.at(t, run_name))


def _consistent_modes(compiled: CompiledModel, t: float, start: Start, p: Vector, u: Vector) -> Start:
    """Iterate algebraic variables and relations, which depend on each other, until both are consistent."""
    seen: list[bytes] = []
    while True:
        m = np.array(compiled.all_modes(t, start.x, start.z, u, p)).ravel()
        key = m.tobytes()
        if seen and key == seen[-1]:
            return start
        if key in seen:
            raise ExportError(
                "AC604",
                f"{compiled.name} has no linearization at t = {t:g} s: its relations contradict each other there",
                cause="each of several modes leads to another one",
                help="linearise slightly before or after it, or at other states",
            )
        seen.append(key)
        start = consistent(compiled, t, start, p, u, m)


def _algebraic_slopes(compiled: CompiledModel, t: float, found: Mapping[str, Vector]) -> dict[str, Vector]:
    """dz/dx, shape (nz, nx), and dz/du, shape (nz, nu), from d(alg) = 0; ExportError AC604 where singular."""
    by_z = found["jac_alg_z"]
    try:
        return {v: np.asarray(-np.linalg.solve(by_z, found[f"jac_alg_{v}"]), dtype=float) for v in ("x", "u")}
    except np.linalg.LinAlgError:
        raise ExportError(
            "AC604",
            f"{compiled.name} has no linearization at t = {t:g} s: its algebraic variables are not determined there",
            evidence=[f"they are {', '.join(compiled.algebraic[:6])}"],
            cause="a kink or a singular position exactly at this point",
            help="linearise slightly before or after it, or at other states",
        ) from None
