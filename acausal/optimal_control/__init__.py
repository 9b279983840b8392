"""Optimal control of compiled models: problems that read like the mathematics, Radau collocation, ipopt.

    problem = Problem(Slider())
    problem.subject_to("u", min=-1.0, max=1.0)
    problem.subject_to(problem.end("mass.s") == 1.0)
    problem.subject_to(problem.end("mass.v") == 0.0)
    problem.minimize(problem.duration)
    best = problem.solve()

See docs/optimal-control.md.
"""

from acausal.optimal_control.optimum.optimum import Multiplier as Multiplier
from acausal.optimal_control.optimum.optimum import Optimum as Optimum
from acausal.optimal_control.problem import Phase as Phase
from acausal.optimal_control.receding.closed_loop import ClosedLoop as ClosedLoop
from acausal.optimal_control.receding.closed_loop import closed_loop as closed_loop
from acausal.optimal_control.receding.controller import Controller as Controller
from acausal.optimal_control.receding.estimator import Estimate as Estimate
from acausal.optimal_control.receding.estimator import Estimator as Estimator
from acausal.optimal_control.solvable import Problem as Problem
