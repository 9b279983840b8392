"""Moving-horizon estimation: states and parameters that best fit the measurements of the last samples.

At each sample the estimate minimizes, over the states at the start of the window and the decided parameters,

    sum ((measured - model) / deviation)**2  +  sum ((start - expected) / deviation)**2 + the same of parameters.

The expected values are the previous estimate of the states at the new start of the window, and of the parameters. The
model holds exactly within the window: there is no process noise.

Source: C. V. Rao, J. B. Rawlings, D. Q. Mayne, IEEE Transactions on Automatic Control 48 (2003) 246-258, here with
a constant arrival cost.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from acausal.arrays import Vector
from acausal.errors import OptimizationError, UsageError, meant
from acausal.optimal_control.guess import initial_guess
from acausal.optimal_control.optimum.arbitrary import undetermined
from acausal.optimal_control.phases import dynamics_of
from acausal.optimal_control.problem import StatedProblem
from acausal.optimal_control.program.polynomials import Basis
from acausal.optimal_control.program.radau import Program, along, transcribe
from acausal.optimal_control.receding.controller import check_autonomous, check_given, is_fixed
from acausal.optimal_control.receding.warm_start import WarmStartedSolver


@dataclass(frozen=True)
class Estimate:
    """Estimated current states and decided parameters, by name."""

    states: dict[str, float]
    parameters: dict[str, float]


class Estimator:
    """Estimator of the current states and parameters from past measurements; each call starts from the last solution.

    Attributes
    ----------
    step
        Sample time [s].
    measured
        Names of the variables measured at the end of each sample.
    """

    def __init__(
        self,
        problem: StatedProblem,
        measured: Mapping[str, float],
        deviations: Mapping[str, float],
        tolerance: float,
        degree: int,
        options: Mapping[str, Any],
    ) -> None:
        _check_window(problem)
        problem = problem.opened()
        q, spec = problem.quantities, problem.specs[0]
        self.problem, self.measured = problem, tuple(measured)
        self.step, self._width = spec.shortest / len(spec.mesh), len(spec.mesh)
        self._decided = [q.parameters.names[place] for place, *_ in q.decided]
        _check_names(problem, measured, deviations, self._decided)
        symbols = [q[name] for name in measured]
        guesses = initial_guess(problem)
        laws = self._laws = dynamics_of(problem, guesses)
        check_autonomous(problem, laws[0].dae)
        program = transcribe(problem, laws, guesses, [spec.mesh], Basis(degree, 0), q.p, past=True)
        residuals, self._answer = _set_objective(program, symbols, measured, deviations)
        self._undetermined = undetermined(program, residuals, self._answer)
        self._program = WarmStartedSolver("estimator", program, tolerance, options)
        self._expected = np.concatenate([q.first, [q.p[place] for place, *_ in q.decided]])
        self._inputs: list[list[float]] = []
        self._measurements: list[list[float]] = []
        self._last_solution: tuple[Vector, Vector] | None = None
        self._shift, self._is_known = 0, False

    @property
    def iterations(self) -> int:
        """Iterations of ipopt in the last call."""
        return self._program.iterations

    @property
    def notes(self) -> tuple[str, ...]:
        """What has been noted: samples that are coarse (in the first full window), early ends of ipopt, and what the
        measurements do not determine (up to the first full window).
        """
        return self._program.notes

    def __call__(self, inputs: Mapping[str, float], measured: Mapping[str, float]) -> Estimate:
        """The estimate at the end of a sample.

        Raises OptimizationError: AC703 if there is no estimate; the next call starts from the last solution again.
        Raises UsageError: AC033 for an input or a measurement that is missing or not finite.

        `inputs`: values of the inputs in the sample, by name.
        `measured`: measured values at its end, by name.
        """
        q = self.problem.quantities
        check_given(inputs, q.u.names, "input")
        check_given(measured, self.measured, "measured value")
        self._inputs.append([inputs[name] for name in q.u.names])
        self._measurements.append([measured[name] for name in self.measured])
        if len(self._measurements) > self._width:
            del self._inputs[0], self._measurements[0]
            self._shift += 1
            if self._last_solution is not None:
                borders, parameters = self._last_solution
                self._expected = np.concatenate([borders[:, min(self._shift, self._width)], parameters])
        here, given = len(self._measurements), self._given()
        found = self._program.solve(given)
        if found is None:
            raise OptimizationError(
                "AC703",
                f"no estimate found for this sample: {self._program.status}",
                evidence=[f"{name} = {measured[name]:.6g}" for name in self.measured[:6]],
                help="keep the last estimate for this sample; limit what is decided: problem.decide(name, min=, max=)",
            )
        self._note_undetermined(np.array(found).ravel(), given, here)
        if here == self._width:
            self._program.check_once(self._laws, given)
        borders, parameters = (np.array(v, dtype=float) for v in self._answer(found, given))
        self._last_solution, self._shift = (borders, parameters.ravel()), 0
        states = q.coordinates.states(borders[:, [here]]).ravel()
        return Estimate(
            dict(zip(q.states.names, states.tolist(), strict=True)),
            dict(zip(self._decided, parameters.ravel().tolist(), strict=True)),
        )

    def _note_undetermined(self, x: Vector, given: Vector, here: int) -> None:
        """Note present states and parameters that the measurements do not determine, up to the first full window."""
        q, columns = self.problem.quantities, self._width + 1
        if self._is_known:
            return
        self._is_known = here == self._width
        names = [name if k == here else "" for name in q.x.names for k in range(columns)] + self._decided
        found = [names[k] for k in self._undetermined(x, given) if names[k]]
        if found:
            seen = "a full window" if self._is_known else "the first samples, before a window is full,"
            self._program.note(
                f"the measurements of {seen} do not determine {', '.join(found)}, whose estimates are arbitrary: give "
                f"deviations={{{found[0]!r}: ...}}, or measure more"
            )

    def _given(self) -> Vector:
        """Parameters of the program as one vector: inputs, measurements, their weights, expected values."""
        missing = self._width - len(self._measurements)
        inputs = np.array([*self._inputs, *[self._inputs[-1]] * missing])
        measurements = np.array([*self._measurements, *[self._measurements[-1]] * missing])
        weights = np.array([1.0] * len(self._measurements) + [0.0] * missing)
        return np.concatenate([inputs.ravel(), measurements.ravel(), weights, self._expected])


def _set_objective(
    program: Program, symbols: list[Any], measured: Mapping[str, float], deviations: Mapping[str, float]
) -> tuple[list[Any], Any]:
    """Set the objective of the program.

    Returns what its squares are of, and the function `(x, p) -> (coordinates at the ends of all samples, decided
    parameters)`.
    """
    nlp, phase, problem = program.nlp, program.phases[0], program.problem
    q, degree, width = problem.quantities, program.basis.degree, len(phase.mesh)
    measurements = ca.reshape(nlp.parameter(width * len(symbols)), len(symbols), width)
    weights, expected = nlp.parameter(width).T, nlp.parameter(len(q.x) + len(q.decided))
    residuals = []
    for k, (symbol, deviation) in enumerate(zip(symbols, measured.values(), strict=True)):
        row = along(program, problem, symbol, phase.inside)[degree - 1 :: degree]
        residuals.append((weights * (ca.reshape(row, 1, -1) - measurements[k, :]) / deviation).T)
    names = [*q.x.names, *(q.parameters.names[place] for place, *_ in q.decided)]
    start = ca.vertcat(phase.x[:, 0], program.w)
    for k, name in enumerate(names):
        if name in deviations:
            residuals.append((start[k] - expected[k]) / deviations[name])
    nlp.objective = ca.sumsqr(ca.vertcat(*residuals))
    return residuals, ca.Function("answer", [nlp.x, nlp.p], [phase.x[:, ::degree], program.w])


def _check_window(problem: StatedProblem) -> None:
    """AC053 for a problem that is no window of past samples."""
    if not is_fixed(problem) or problem.objective is not None:
        raise UsageError(
            "AC053",
            f"{problem!r} is no window for an estimator",
            help="declare one phase with duration=samples * step and intervals=samples, and no objective: it follows "
            "from the measurements",
        )


def _check_names(
    problem: StatedProblem, measured: Mapping[str, float], deviations: Mapping[str, float], decided: list[str]
) -> None:
    """AC010 for unknown names, AC053 for invalid standard deviations or no measurement."""
    known = [*problem.quantities.x.names, *decided]
    for name in deviations:
        if name not in known:
            raise UsageError(
                "AC010",
                f"{name} is neither a state nor a decided parameter of {problem.compiled.name}",
                evidence=meant(name, known),
                help=f"deviations are of {', '.join(known)}; decide a parameter first: problem.decide(name)",
            )
    for name, deviation in {**measured, **deviations}.items():
        if not (np.isfinite(deviation) and deviation > 0.0):
            raise UsageError(
                "AC053", f"a standard deviation of {deviation:g} for {name}", help="give a positive number, in SI units"
            )
    if not measured:
        raise UsageError("AC053", "nothing is measured", help='problem.estimator({"name": standard deviation})')
