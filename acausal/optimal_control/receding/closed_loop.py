"""Closed-loop simulation: a predictive controller on a plant, which may have other parameters than its model."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from acausal.arrays import Vector
from acausal.errors import UsageError, meant
from acausal.export.start_point import input_start
from acausal.language.component import Component
from acausal.lower.chebyshev import INPUT_WIDTH
from acausal.lower.compile import compile
from acausal.lower.compiled import CompiledModel
from acausal.lower.variants.started import with_driven
from acausal.optimal_control.receding.controller import Controller
from acausal.result.result import Result
from acausal.simulate.driver.run import Run
from acausal.simulate.events.guards import Cause, Moment
from acausal.simulate.inputs.given import Inputs
from acausal.simulate.inputs.pieces import Pieces, steps
from acausal.simulate.interrupt import interruptible
from acausal.simulate.options import input_vector, options, parameter_vector
from acausal.simulate.record.record import Recorder

Estimate = Callable[[float, Mapping[str, float]], Mapping[str, float]]


@dataclass(frozen=True, eq=False)
class ClosedLoop:
    """Result of a closed-loop simulation.

    Attributes
    ----------
    result
        Run of the plant with the inputs of the controller, constant in each sample.
    cost
        Processor time of the controller in each sample [s], shape (samples,).
    iterations
        Iterations of ipopt in each sample, shape (samples,).
    notes
        Notes of the controller.
    """

    result: Result
    cost: Vector
    iterations: Vector
    notes: tuple[str, ...] = ()


@interruptible
def closed_loop(
    controller: Controller,
    plant: Component | CompiledModel,
    *,
    samples: int,
    parameters: Mapping[str, float] | None = None,
    measure: Sequence[str] = (),
    estimate: Estimate | None = None,
    tolerance: float = 1e-8,
) -> ClosedLoop:
    """Simulate a controller on a plant, from the start values of the plant.

    The plant is simulated in one run by IDAS, with its events, delays and contacts. The run stops at each sample, and
    continues with the inputs of the controller.

    Parameters
    ----------
    plant
        A component or a compiled model, with the states and inputs of that of the controller.
    parameters
        Parameters of the plant, unknown to the controller.
    measure, estimate
        At each sample `estimate(time, measured)` gets the named variables of the plant, before the events at this
        instant and with the inputs of the sample that ends. It returns values of parameters of the controller, and
        states that replace those of the plant. Other parameters are as in the problem of the controller.

    Raises
    ------
    OptimizationError
        AC703 if the controller finds no inputs.
    UsageError
        AC010 for an unknown variable, AC027 for a plant whose equations change during a run, AC053 without a sample.
    RunError
        If the simulation of the plant fails; its `result` is the run up to then.
    """
    plant = (plant if isinstance(plant, CompiledModel) else compile(plant)).unchanging("closed_loop")
    if samples < 1 or samples != int(samples):
        raise UsageError("AC053", f"a closed loop of {samples} samples", help="give a whole number: samples=80")
    for name in controller.inputs:
        if name not in plant.inputs:
            raise UsageError(
                "AC010",
                f"{plant.name} has no input {name}, which the controller gives",
                evidence=meant(name, plant.inputs),
                help=f"its inputs: {', '.join(plant.inputs) or 'none'}",
            )
    begin = plant.flat.experiment.start_time
    times: Vector = begin + controller.step * np.arange(samples + 1, dtype=np.float64)
    p = parameter_vector(plant, dict(parameters or {}))
    places = tuple(plant.inputs.index(name) for name in controller.inputs)
    first = {n: input_start(plant, s, p) for n, s in zip(plant.inputs, plant.flat.inputs, strict=True)}
    u = input_vector(plant, {n: first[n] for n in controller.inputs}, unchecked=controller.inputs)
    # the inputs are not known yet: placeholder values alternate, so that models whose inputs must not jump are refused
    held = [steps(times, u[k] + (1.0 + abs(u[k])) * (np.arange(samples) % 2)) for k in places]
    u[list(places)] = 0.0
    driven = with_driven(plant, places)
    chosen = options(
        plant.flat.experiment,
        start_time=begin,
        stop_time=float(times[-1]),
        output_interval=controller.step / 10,
        tolerance=tolerance,
        solver="idas",
    )
    sampled = SampledController(controller, times, held, len(driven.time_events.relations), tuple(measure), estimate)
    run = Run(driven, chosen, p, Inputs(u, places, tuple(held)), None, sources=(sampled,))
    sampled.decide(0, run.start())
    return ClosedLoop(run.result(), np.array(sampled.cost), np.array(sampled.iterations), controller.notes)


@dataclass(eq=False)
class SampledController:
    """A controller as a source of stops: called at each sample, its inputs are held until the next.

    `held` are the inputs as step functions at `times` [s], shape (samples + 1,), whose values are filled in. `first` is
    the index of their coefficients among the modes.
    """

    controller: Controller
    times: Vector
    held: Sequence[Pieces]
    first: int
    measure: Sequence[str]
    estimate: Estimate | None

    def __post_init__(self) -> None:
        self.sample = -1
        self.cost: list[float] = []
        self.iterations: list[int] = []

    def next_stop(self, here: float, until: float, moment: Moment) -> tuple[float, tuple[Cause, ...]]:
        """No further stop, because samples are stops known in advance."""
        return until, ()

    def set_modes(self, modes: Vector) -> None:
        """Write the inputs of the current sample into the modes, shape (n_modes,)."""
        numbers = [pieces.numbers[self.sample] for pieces in self.held]
        modes[self.first : self.first + INPUT_WIDTH * len(self.held)] = np.concatenate(numbers)

    def accepts(self, record: Recorder, events: Sequence[float], complete: bool) -> bool:
        """Call the controller at the end of a sample."""
        ahead = self.sample + 1
        near = 1e-9 * self.controller.step
        if complete and ahead < len(self.times) - 1 and record.time >= self.times[ahead] - near:
            self.decide(ahead, record.since(record.count - 1))
        return True

    def decide(self, sample: int, now: Result) -> None:
        """Compute the inputs for a sample from the current state of the plant."""
        controller = self.controller
        names = dict.fromkeys((*controller.states, *self.measure))
        values = {name: float(np.ravel(now[name])[-1]) for name in names}
        start = clock.process_time()
        found: dict[str, float] = {}
        if self.estimate is not None:
            found = dict(self.estimate(float(self.times[sample]), {name: values[name] for name in self.measure}))
        states = {name: found.pop(name, values[name]) for name in controller.states}
        inputs = controller(states, found)
        self.cost.append(clock.process_time() - start)
        self.iterations.append(controller.iterations)
        for name, pieces in zip(controller.inputs, self.held, strict=True):
            pieces.numbers[sample, 2] = inputs[name]
        self.sample = sample
