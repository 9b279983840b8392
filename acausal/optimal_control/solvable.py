"""`Problem`: an optimal-control problem that can be solved, and used as a controller or an estimator."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from acausal.errors import UsageError
from acausal.optimal_control.optimum.optimum import Optimum
from acausal.optimal_control.problem import StatedProblem
from acausal.optimal_control.program.shooting import Steps
from acausal.optimal_control.receding.controller import Controller
from acausal.optimal_control.receding.estimator import Estimator
from acausal.optimal_control.solve import Choices, solve_problem


class Problem(StatedProblem):
    """An optimal-control problem on a model.

    `problem["drill.s"]` is a variable of the model as a CasADi symbol, for use in constraints and in the objective;
    parameters stand for their values unless `decide` makes them decisions. All quantities are in SI units.

    The states start at the start values of the model, and the declared limits of its inputs hold. Phases follow each
    other in the order of their declaration; without a declaration there is one.

    Parameters
    ----------
    model
        A component, or a compiled model.
    parameters
        Values of parameters by path.
    free_start
        Names of states whose start values are decisions.

    Raises
    ------
    UsageError
        AC010 for an unknown name.
    """

    def solve(
        self,
        *,
        tolerance: float = 1e-8,
        degree: int = 3,
        control: int | None = None,
        accuracy: float | None = None,
        refinements: int = 5,
        smooth: float = 0.0,
        complementarity: bool = False,
        shooting: str | None = None,
        steps: int = 4,
        solver: str = "ipopt",
        options: Mapping[str, Any] | None = None,
    ) -> Optimum:
        """Compute the optimum by Radau collocation and ipopt, or by multiple shooting.

        Parameters
        ----------
        tolerance
            Tolerance of ipopt for the scaled program.
        degree
            Collocation points in each interval (Radau IIA; order 2 degree - 1).
        control
            Degree of the inputs as polynomials in each interval: 0 constant, 1 linear, 2 parabolas, 3 cubics, by
            default 2. The limits are imposed on their Bernstein coefficients, so that they hold between the points as
            well. With `complementarity` the default is 0: a parabola may cross a switch twice between two points.
        accuracy
            Largest permitted error of a state over one interval, relative to its magnitude: intervals in which IDAS
            deviates more are halved, and the problem is solved again. None keeps the mesh.
        refinements
            Maximum number of mesh refinements.
        smooth
            Smooths the kinks of `where`, `maximum`, `minimum`, `abs` that the guess or the solution crosses within a
            phase, for problems in which the order of switches is free: the width relative to the largest value of the
            quantity that changes sign. 0 leaves the model as it is. `stats["bias"]` is the resulting bias of a state,
            the integral of the deviation of its rate relative to its largest magnitude, or the mean deviation of
            another variable in the problem; a note states it as well.
        complementarity
            Relax these branches instead of smoothing them: a selector in [0, 1] per collocation point becomes an
            unknown. It is 0 or 1 according to the sign of the quantity that decides the branch, and takes a value
            between while that stays at zero (sticking friction), as in a simulation. The order of switches is found
            together with the optimum. Switches lie inside intervals, not at their ends: `stats["replay_error"]` is the
            deviation of a simulation with the solution, relative to the largest magnitude of a state, and `accuracy`
            bounds it by halving the intervals that contain a switch.
        shooting, steps
            Use multiple shooting instead of collocation: the step method "rk2", "rk4", "rosenbrock" or "sdirk", and
            the number of steps per interval. Inputs are then constant in an interval, limits hold at its end, and
            results are interpolated between the ends.
        solver
            "ipopt", or "fatrop" as CasADi ships it.
        options
            Further options of the solver.

        Raises
        ------
        OptimizationError
            AC701 for infeasible constraints, AC702 for an unbounded objective, AC703 if ipopt fails, AC704 for events
            inside a phase, AC705 if the guess does not reach the end of a phase, AC706 if a phase leaves the branch on
            which it was solved, AC707 if the mesh is still too coarse after all refinements.
        """
        if accuracy is not None and not accuracy > 0.0:
            raise UsageError("AC053", f"accuracy={accuracy!r} is not positive", help="give a number: accuracy=1e-4")
        self._close_phases()
        step_scheme = Steps(shooting, steps) if shooting is not None else None
        solver_options = dict(options or {})
        control = control if control is not None else 0 if complementarity else 2
        choices = Choices(
            tolerance,
            degree,
            control,
            accuracy,
            refinements,
            smooth,
            complementarity,
            step_scheme,
            solver,
            solver_options,
        )
        return solve_problem(self, choices)

    def controller(
        self,
        *,
        varying: Sequence[str] = (),
        tolerance: float = 1e-6,
        degree: int = 3,
        options: Mapping[str, Any] | None = None,
    ) -> Controller:
        """Make the problem a model predictive controller: its single phase is the horizon, its intervals are samples.

        Parameters
        ----------
        varying
            Names of parameters whose values may change from sample to sample.
        tolerance, degree, options
            As for `solve`.

        Raises
        ------
        UsageError
            AC010 for an unknown parameter, AC053 for several phases, a free duration, or decided parameters.
        """
        self._close_phases()
        return Controller(self, tolerance, degree, varying, dict(options or {}))

    def estimator(
        self,
        measured: Mapping[str, float],
        *,
        deviations: Mapping[str, float] | None = None,
        tolerance: float = 1e-6,
        degree: int = 3,
        options: Mapping[str, Any] | None = None,
    ) -> Estimator:
        """Make the problem a moving-horizon estimator of states and decided parameters.

        Its single phase is the window of past samples, its intervals are the samples; it has no objective.

        Parameters
        ----------
        measured
            Standard deviations of the measurement noise, by the names of the measured variables.
        deviations
            Standard deviations of states at the start of the window, and of the change of decided parameters per
            sample, by name. States and parameters not named are estimated from the measurements alone.
        tolerance, degree, options
            As for `solve`.

        Raises
        ------
        UsageError
            AC010 for an unknown name, AC053 for several phases, a free duration, an objective.
        """
        self._close_phases()
        return Estimator(self, measured, dict(deviations or {}), tolerance, degree, dict(options or {}))
