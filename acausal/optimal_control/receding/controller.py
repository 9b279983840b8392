"""Model predictive control: the program is built once, and solved at every sample from the last solution."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from acausal.arrays import Vector
from acausal.errors import OptimizationError, UsageError
from acausal.optimal_control.guess import initial_guess
from acausal.optimal_control.phases import dynamics_of
from acausal.optimal_control.problem import StatedProblem
from acausal.optimal_control.program.points import key, symbols_in
from acausal.optimal_control.program.polynomials import Basis
from acausal.optimal_control.program.radau import transcribe
from acausal.optimal_control.receding.warm_start import WarmStartedSolver
from acausal.simulate.options import parameter_vector


class Controller:
    """Inputs for the next sample from the current states; each call starts from the last solution.

    Inputs are constant in a sample. The parameters `varying` may change from call to call, as from an estimator.

    Attributes
    ----------
    step
        Sample time [s].
    states
        Names of the states, in the order of a call.
    inputs
        Names of the controlled inputs.
    """

    def __init__(
        self, problem: StatedProblem, tolerance: float, degree: int, varying: Sequence[str], options: Mapping[str, Any]
    ) -> None:
        q = problem.quantities
        self._varying = [q.parameters.position(name) for name in varying]
        _check_horizon(problem, self._varying)
        problem = problem.opened()
        q = problem.quantities
        self.problem = problem
        self.states = q.states.names
        spec = problem.specs[0]
        self.step = spec.shortest / len(spec.mesh)
        guesses = initial_guess(problem)
        laws = self._laws = dynamics_of(problem, guesses)
        check_autonomous(problem, laws[0].dae)
        self._check_circles()
        program = transcribe(problem, laws, guesses, [spec.mesh], Basis(degree, 0), q.p, self._varying)
        self._program = WarmStartedSolver("controller", program, tolerance, options)
        self._first = ca.Function("inputs", [program.nlp.x], [program.phases[0].u[:, 0]])
        self.inputs = q.u.names

    @property
    def iterations(self) -> int:
        """Iterations of ipopt in the last call."""
        return self._program.iterations

    @property
    def notes(self) -> tuple[str, ...]:
        """What has been noted: samples that are coarse (the first call looks), and early ends of ipopt."""
        return self._program.notes

    def __call__(self, states: Mapping[str, float] | ArrayLike, parameters: Mapping[str, float] | None = None) -> Any:
        """Values of the inputs by name, to be held for a sample.

        Raises OptimizationError: AC703 if there is no solution; the next call starts from the last solution again.
        Raises UsageError: AC033 for a state that is missing or not finite, and for a parameter outside its limits,
        AC053 for one that is not one of `varying`, AC023 and AC029 for its value.
        Raises DeclarationError: AC136 and AC139 for a value outside its limits, or that contradicts others.

        `states`: values by name, or all in the order of `self.states`, shape (nx,).
        `parameters`: values that differ from those of the problem, by name.
        """
        if not isinstance(states, Mapping):
            values = np.ravel(np.asarray(states, dtype=float)).tolist()
            if len(values) != len(self.states):
                fact = f"{len(values)} values for {len(self.states)} states"
                raise UsageError("AC033", fact, help=f"give {', '.join(self.states)} in this order, or by name")
            states = dict(zip(self.states, values, strict=True))
        check_given(states, self.states, "state")
        x = [states[n] for n in self.states]
        q = self.problem.quantities
        p = q.p if not parameters else self._given(parameters)
        c = q.coordinates.of(np.reshape(x, (-1, 1))).ravel()
        given = np.concatenate([p[self._varying], c])
        found = self._program.solve(given)
        if found is None:
            raise OptimizationError(
                "AC703",
                f"no inputs found for the next sample: {self._program.status}",
                evidence=[f"{n} = {v:.6g}" for n, v in list(zip(self.states, x, strict=True))[:6]],
                help="keep the last inputs for this sample; limits on measured quantities may have to be soft",
            )
        self._program.check_once(self._laws, given)
        return dict(zip(self.inputs, np.array(self._first(found)).ravel().tolist(), strict=True))

    def _given(self, parameters: Mapping[str, float]) -> Vector:
        """All parameters with these values, shape (np,)."""
        q = self.problem.quantities
        known = {q.parameters.names[k] for k in self._varying}
        for name in parameters:
            if name not in known:
                raise UsageError(
                    "AC053",
                    f"{name} does not vary from sample to sample in this controller",
                    help=f"problem.controller(varying=[..., {name!r}])",
                )
        p, checked = q.p.copy(), parameter_vector(q.model, parameters)
        places = [q.parameters.position(name) for name in parameters]
        p[places] = checked[places]
        for place, lower, upper, _ in q.decided:
            if not lower <= p[place] <= upper:
                fact = f"{q.parameters.names[place]} is {p[place]:g}, outside of its limits {lower:g} ... {upper:g}"
                raise UsageError("AC033", fact, help="they are those of problem.decide")
        return p

    def _check_circles(self) -> None:
        """AC053 for varying parameters on which the angle coordinates of circular constraints depend."""
        q = self.problem.quantities
        bound = [q.parameters.names[k] for k in self._varying if k in q.coordinates.bound]
        if bound:
            raise UsageError(
                "AC053",
                f"{bound[0]} cannot change from sample to sample: the angle that replaces states depends on it",
                help="declare the angle in the model, with the constraint solved for x and y",
            )


def check_given(given: Mapping[str, float], names: Sequence[str], kind: str) -> None:
    """AC033 for missing or not finite values: one nan would invalidate all that follows."""
    for name in names:
        if name not in given or isinstance(given[name], str) or not np.isfinite(given[name]):
            value = f"is {given[name]}" if name in given else "is missing"
            raise UsageError(
                "AC033", f"the {kind} {name} {value}", help=f"each sample has all of {', '.join(names)}, in SI units"
            )


def is_fixed(problem: StatedProblem) -> bool:
    """Whether a problem has one phase of fixed duration."""
    spec = problem.specs[0]
    return len(problem.specs) == 1 and spec.shortest == spec.longest and spec.switch is None


def _check_horizon(problem: StatedProblem, varying: Sequence[int]) -> None:
    """AC053 for a problem that is not a horizon of samples with these varying parameters."""
    q = problem.quantities
    decided = {place for place, *_ in q.decided}
    if problem.objective is None or not is_fixed(problem) or not decided.issubset(varying):
        raise UsageError(
            "AC053",
            f"{problem!r} is no horizon",
            help="declare one phase with duration=samples * step and intervals=samples, an objective, and parameters "
            "that are given at each sample instead of decided",
        )
    if problem.free_start:
        raise UsageError(
            "AC053",
            f"the start of {q.x.names[problem.free_start[0]]} is no decision: each sample gives all states",
            help="leave out free_start=",
        )
    used = [n for n in (q.parameters.names[k] for k in varying if k not in decided) if q.is_used(n)]
    if used:
        raise UsageError(
            "AC053",
            f"{used[0]} is to vary, but has already been used as a number in this problem",
            help=f"{used[0].rpartition('.')[2]} = problem.decide({used[0]!r}) before it is used: each sample gives it",
        )


def check_autonomous(problem: StatedProblem, dae: Any) -> None:
    """AC053 for a model, an objective or a constraint that depends on time."""
    compiled, time = problem.quantities.compiled, key(problem.quantities.time)
    stated = [*(v.expression for v in problem.values), *(c.expression for c in problem.constraints)]
    found = [str(e) for e in stated if time in symbols_in(e)]
    if compiled.time_events.relations or any(dae.jac_sparsity(k, 0).nnz() for k in range(3)):
        found.append(compiled.name)
    if found:
        raise UsageError(
            "AC053",
            f"{found[0]} depends on the time, which is not passed at a sample",
            help="make its source an input or a varying parameter: acausal.free(model, name)",
        )
