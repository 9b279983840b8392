"""Model predictive control: the program of a problem built once, and solved at every sample from where it ended."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from acausal.arrays import Vector
from acausal.errors import OptimizationError, UsageError
from acausal.optimal_control.guess import guessed
from acausal.optimal_control.phases import dynamics_of
from acausal.optimal_control.problem import StatedProblem
from acausal.optimal_control.program.polynomials import Basis
from acausal.optimal_control.program.radau import transcribed
from acausal.optimal_control.receding.warm import Warm


class Controller:
    """Inputs for the next sample from the states now; each call begins from the answer of the last.

    Inputs are constant in a sample. Parameters that were said to vary may differ from call to call, as an estimator
    finds them.

    Attributes
    ----------
    step
        The sample [s].
    states
        Names of the states, in the order in which they are given.
    inputs
        Names of the inputs that it decides.
    """

    def __init__(
        self, problem: StatedProblem, tolerance: float, degree: int, varying: Sequence[str], options: Mapping[str, Any]
    ) -> None:
        check_horizon(problem)
        problem = problem.opened()
        q = problem.quantities
        self.problem = problem
        self.states = q.states.names
        spec = problem.specs[0]
        self.step = spec.shortest / len(spec.mesh)
        guesses = guessed(problem)
        laws = dynamics_of(problem, guesses)
        check_autonomous(problem, laws[0].dae)
        self._varying = [q.parameters.position(name) for name in varying]
        self._check_circles()
        program = transcribed(problem, laws, guesses, [spec.mesh], Basis(degree, 0), q.p, self._varying)
        self._program = Warm("controller", program.nlp, tolerance, options)
        self._first = ca.Function("inputs", [program.nlp.x], [program.phases[0].u[:, 0]])
        self.inputs = q.u.names

    @property
    def iterations(self) -> int:
        """Of the last call."""
        return self._program.iterations

    def __call__(self, states: Mapping[str, float] | ArrayLike, parameters: Mapping[str, float] | None = None) -> Any:
        """Values of the inputs by name, to be held for a sample.

        Raises OptimizationError: AC703 where no answer was found from these states; the next call begins from the last
        answer again.

        `states`: By name, or all in the order of `self.states`.
        `parameters`: Values that differ from those of the problem, by name.
        """
        x = [states[n] for n in self.states] if isinstance(states, Mapping) else np.asarray(states, dtype=float)
        q = self.problem.quantities
        p = q.p if not parameters else self._given(parameters)
        c = q.coordinates.of(np.reshape(x, (-1, 1))).ravel()
        found = self._program.solve(np.concatenate([p[self._varying], c]))
        if found is None:
            raise OptimizationError(
                "AC703",
                f"no inputs found for the next sample: {self._program.status}",
                evidence=[f"{n} = {v:.6g}" for n, v in list(zip(self.states, np.ravel(x), strict=True))[:6]],
                help="hold the last inputs for this sample; limits on measured quantities may have to be soft",
            )
        return dict(zip(self.inputs, np.array(self._first(found)).ravel().tolist(), strict=True))

    def _given(self, parameters: Mapping[str, float]) -> Vector:
        q = self.problem.quantities
        known = {q.parameters.names[k] for k in self._varying}
        for name in parameters:
            if name not in known:
                raise UsageError(
                    "AC053",
                    f"{name} does not vary from sample to sample in this controller",
                    help=f"problem.controller(varying=[..., {name!r}])",
                )
        p = q.p.copy()
        for name, value in parameters.items():
            p[q.parameters.position(name)] = value
        return p

    def _check_circles(self) -> None:
        q = self.problem.quantities
        bound = [q.parameters.names[k] for k in self._varying if k in q.coordinates.bound]
        if bound:
            raise UsageError(
                "AC053",
                f"{bound[0]} cannot change from sample to sample: the angle that replaces states depends on it",
                help="declare the angle in the model, with the constraint solved for x and y",
            )


def check_horizon(problem: StatedProblem, past: bool = False) -> None:
    """Refuse a problem that is no window of samples: of the future, or of the past, where parameters are estimated."""
    spec = problem.specs[0]
    fixed = len(problem.specs) == 1 and spec.shortest == spec.longest and spec.switch is None
    if past and (not fixed or problem.objective is not None):
        raise UsageError(
            "AC053",
            f"{problem!r} is no window to estimate in",
            help="one phase with duration=samples * step and intervals=samples, and no objective: that is made of "
            "what is measured",
        )
    if not past and (problem.objective is None or not fixed or problem.quantities.decided):
        raise UsageError(
            "AC053",
            f"{problem!r} is no horizon",
            help="one phase with duration=samples * step and intervals=samples, an objective, and parameters that are "
            "given at each sample instead of decided",
        )


def check_autonomous(problem: StatedProblem, dae: Any) -> None:
    """Refuse a model with a clock of its own."""
    compiled = problem.quantities.compiled
    if compiled.time_events.relations or any(dae.jac_sparsity(k, 0).nnz() for k in range(3)):
        raise UsageError(
            "AC053",
            f"{compiled.name} depends on the time, which no sample knows",
            help="make its source an input or a parameter that varies: acausal.free(model, name)",
        )
