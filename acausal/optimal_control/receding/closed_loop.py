"""A controller on a plant: the model once more, with other parameters, in a run whose inputs it decides on the way."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from acausal.arrays import Vector
from acausal.export.start_point import input_start
from acausal.lower.chebyshev import INPUT_WIDTH
from acausal.lower.compiled import CompiledModel
from acausal.lower.variants.driven import with_driven
from acausal.optimal_control.receding.controller import Controller
from acausal.result.result import Result
from acausal.simulate.arguments import input_vector, parameter_vector
from acausal.simulate.driver.run import Run
from acausal.simulate.events.guards import Cause, Moment
from acausal.simulate.inputs.given import Inputs
from acausal.simulate.inputs.pieces import Pieces, steps
from acausal.simulate.interrupt import interruptible
from acausal.simulate.options import options
from acausal.simulate.record.record import Recorder

Estimate = Callable[[float, Mapping[str, float]], Mapping[str, float]]


@dataclass(frozen=True, eq=False)
class ClosedLoop:
    """What a controlled plant did.

    Attributes
    ----------
    result
        The run of the plant with the inputs that the controller gave on the way, each held for its sample.
    cost
        Processor time of each sample [s], shape (n,); `iterations` those of ipopt.
    """

    result: Result
    cost: Vector
    iterations: Vector


@interruptible
def closed_loop(
    controller: Controller,
    plant: CompiledModel,
    *,
    samples: int,
    parameters: Mapping[str, float] | None = None,
    measure: Sequence[str] = (),
    estimate: Estimate | None = None,
    tolerance: float = 1e-8,
) -> ClosedLoop:
    """Run a controller on a plant from the plant's start.

    The plant is simulated once, by IDAS, with its events, delays and contacts; the run stops at each sample and goes on
    with what the controller says.

    Parameters
    ----------
    plant
        A model with the states and inputs of the controller's.
    parameters
        The plant's own values, which the controller does not know.
    measure, estimate
        At each sample `estimate(time, measured)` gets the named variables of the plant, before what happens at this
        instant and with inputs as they were held up to it, and returns parameters for the controller, those that it
        does not return as in its problem, and states that the controller takes instead of the plant's.

    Raises
    ------
    OptimizationError
        AC703 where the controller finds no inputs.
    UsageError
        AC010 for an unknown variable, AC027 for a plant whose equations do not stay.
    RunError
        Where the plant cannot be simulated; its `result` holds what was.
    """
    plant = plant.unchanging("closed_loop")
    begin = plant.flat.experiment.start_time
    times: Vector = begin + controller.step * np.arange(samples + 1, dtype=np.float64)
    p = parameter_vector(plant, dict(parameters or {}))
    places = tuple(plant.inputs.index(name) for name in controller.inputs)
    first = {n: input_start(plant, s, p) for n, s in zip(plant.inputs, plant.flat.inputs, strict=True)}
    u = input_vector(plant, {n: first[n] for n in controller.inputs}, unchecked=controller.inputs)
    # values that alternate, so that what must not jump is refused: they are not known before the run has come to them
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
    asked = Asked(controller, times, held, len(driven.time_events.relations), tuple(measure), estimate)
    run = Run(driven, chosen, p, Inputs(u, places, tuple(held)), None, sources=(asked,))
    asked.decide(0, run.start())
    return ClosedLoop(run.result(), np.array(asked.cost), np.array(asked.iterations))


@dataclass(eq=False)
class Asked:
    """A controller as a source of stops: asked at each sample, its answer is held up to the next.

    `held` are the inputs as steps at `times`, whose values are filled in; `first` is the place of their numbers.
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

    def limit(self, here: float, until: float, moment: Moment) -> tuple[float, tuple[Cause, ...]]:
        """Samples are among the stops that are known in advance."""
        return until, ()

    def prepare(self, modes: Vector) -> None:
        """The inputs of the sample that the run has come to."""
        numbers = [pieces.numbers[self.sample] for pieces in self.held]
        modes[self.first : self.first + INPUT_WIDTH * len(self.held)] = np.concatenate(numbers)

    def passed(self, record: Recorder, events: Sequence[float], complete: bool) -> bool:
        """Ask for the next inputs where a sample has ended."""
        ahead = self.sample + 1
        near = 1e-9 * self.controller.step
        if complete and ahead < len(self.times) - 1 and record.time >= self.times[ahead] - near:
            self.decide(ahead, record.since(record.count - 1))
        return True

    def decide(self, sample: int, now: Result) -> None:
        """Inputs for a sample, from what the plant has come to."""
        controller = self.controller
        names = dict.fromkeys((*controller.states, *self.measure))
        seen = {name: float(np.ravel(now[name])[-1]) for name in names}
        began = clock.process_time()
        found: dict[str, float] = {}
        if self.estimate is not None:
            found = dict(self.estimate(float(self.times[sample]), {name: seen[name] for name in self.measure}))
        states = {name: found.pop(name, seen[name]) for name in controller.states}
        inputs = controller(states, found)
        self.cost.append(clock.process_time() - began)
        self.iterations.append(controller.iterations)
        for name, pieces in zip(controller.inputs, self.held, strict=True):
            pieces.numbers[sample, 2] = inputs[name]
        self.sample = sample
