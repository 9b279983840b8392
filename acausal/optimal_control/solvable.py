"""`Problem`: what is stated, and what can be asked of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from acausal.optimal_control.optimum.optimum import Optimum
from acausal.optimal_control.problem import StatedProblem
from acausal.optimal_control.program.shooting import Steps
from acausal.optimal_control.receding.controller import Controller
from acausal.optimal_control.receding.estimator import Estimator
from acausal.optimal_control.solve import Choices, solved


class Problem(StatedProblem):
    """An optimal-control problem on a model.

    `problem["drill.s"]` is a variable of the model as a CasADi symbol, for use in constraints and in the objective;
    parameters stand for their values unless `decide` makes them decisions. All quantities are in SI units.

    The states begin at the start values of the model, the declared limits of its inputs hold. Phases follow each other
    in the order in which they are declared; a problem without any declared has one.

    Parameters
    ----------
    model
        A component, or what `compile` made of it.
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
        """The optimum, by Radau collocation and ipopt, or by multiple shooting.

        Parameters
        ----------
        tolerance
            Of ipopt, on the scaled program.
        degree
            Collocation points in each interval (Radau IIA; order 2 degree - 1).
        control
            Degree of the inputs as polynomials in each interval: 0 constant, 1 straight, 2 parabolas, by default 2.
            Their Bernstein coefficients keep the limits, so that they hold between the points, too. With
            `complementarity` by default 0: between two points a parabola may pass a switch and come back unseen.
        accuracy
            Largest error of a state over one interval, by its magnitude, that the mesh may leave: intervals in which
            IDAS goes elsewhere are halved, and the problem is solved again. None leaves the mesh as it is.
        refinements
            How often at most.
        smooth
            Rounds the kinks of `where`, `maximum`, `minimum`, `abs` that the guess or the answer passes within a phase,
            where their order is free: widths by the largest value of what changes its sign. 0 leaves the model as it
            is. `stats["bias"]` is how far that leads a state away, the integral of what its rate is off by, by its
            largest magnitude; a note says it, too.
        complementarity
            Instead of rounding, the answers of these branches become unknowns: at each collocation point a branch is
            taken or not by the sign of what decides it, and where that rests at zero (friction that sticks) something
            between, as in a run. The order of switches is found with the optimum. Switches lie in intervals, not at
            their borders: `stats["replay_error"]` is how far a run of the model with the answer ends up elsewhere, by
            the largest magnitude of a state, and `accuracy` bounds it by halving the intervals that hold a switch.
        shooting, steps
            Instead of collocation, a method of the exported steps, "rk2", "rk4", "rosenbrock" or "sdirk", and its steps
            in each interval. Inputs are then constant in an interval, limits hold at its end, and between the borders
            results are interpolated.
        solver
            "ipopt", or "fatrop" as CasADi ships it.
        options
            Further options of the solver.

        Raises
        ------
        OptimizationError
            AC701 for demands that contradict each other, AC702 where there is no smallest value, AC703 when ipopt gives
            up, AC704 for events that no phase ends with, AC705 when the guess does not get to the end of a phase,
            AC707 when the mesh is still too coarse after all refinements.
        """
        self._begun()
        bridge = Steps(shooting, steps) if shooting is not None else None
        more = dict(options or {})
        control = control if control is not None else 0 if complementarity else 2
        how = Choices(tolerance, degree, control, accuracy, refinements, smooth, complementarity, bridge, solver, more)
        return solved(self, how)

    def controller(
        self,
        *,
        varying: Sequence[str] = (),
        tolerance: float = 1e-6,
        degree: int = 3,
        options: Mapping[str, Any] | None = None,
    ) -> Controller:
        """The problem as a predictive controller: its one phase is the horizon, its intervals are the samples.

        Parameters
        ----------
        varying
            Names of parameters that may have other values at each sample.
        tolerance, degree, options
            As for `solve`.

        Raises
        ------
        UsageError
            AC010 for an unknown parameter, AC053 for several phases, a free duration, or decided parameters.
        """
        self._begun()
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
        """The problem as a moving-horizon estimator of states and decided parameters.

        Its one phase is the window that is looked back on, its intervals are the samples; there is no objective.

        Parameters
        ----------
        measured
            Standard deviation of the noise by the name of each measured variable.
        deviations
            By the name of a state, how far it may be off where the window begins; by that of a decided parameter, how
            far it may change in a sample. What is not named is found from the measurements alone.
        tolerance, degree, options
            As for `solve`.

        Raises
        ------
        UsageError
            AC010 for an unknown name, AC053 for several phases, a free duration, an objective.
        """
        self._begun()
        return Estimator(self, measured, dict(deviations or {}), tolerance, degree, dict(options or {}))
