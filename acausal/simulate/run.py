"""One run: start values, segments between time events, the solver, the result."""

from __future__ import annotations

import logging
import time as clock
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from acausal.errors import IntegrationError, RunError, UsageError
from acausal.language.component import Component
from acausal.language.experiment import Experiment
from acausal.lower.compile import compile
from acausal.lower.compiled import CompiledModel
from acausal.lower.delays import refuse_delays
from acausal.lower.samples import STABILISATION_RATE
from acausal.result import Result
from acausal.simulate.arguments import input_vector, parameter_vector
from acausal.simulate.course import Course, Place, plan
from acausal.simulate.delay.crossing import begin, cross, opened
from acausal.simulate.delay.memory import Memory, check_undelayed
from acausal.simulate.event_log import event_log
from acausal.simulate.failure import integration_error
from acausal.simulate.flight import Flight, Landing, can_fly
from acausal.simulate.guards import Tolerances
from acausal.simulate.hybrid import Hybrid
from acausal.simulate.initialize import Start, consistent, initialize
from acausal.simulate.interrupt import Interruptible
from acausal.simulate.kept import kept
from acausal.simulate.options import Options, options
from acausal.simulate.patience import salvage
from acausal.simulate.problem import Problem
from acausal.simulate.project import projected
from acausal.simulate.record import Recorder, make_result
from acausal.simulate.regime import Regime
from acausal.simulate.restructure import Pieces, RunPiece, variable_parts
from acausal.simulate.sampling import sample_times
from acausal.simulate.solvers import Solver, choose
from acausal.simulate.solvers.base import TOLERANCE_SHARE, Piece, Segment, pace, program
from acausal.simulate.step_limit import StepLimit
from acausal.simulate.truth import truths

Vector = NDArray[np.float64]
Progress = Callable[[float, float], None]
_log = logging.getLogger(__name__)
# Steps times variables that take about a second.
_LONG = 1e6


def simulate(
    model: Component | CompiledModel,
    *,
    start_time: float | None = None,
    stop_time: float | None = None,
    output_interval: float | None = None,
    tolerance: float | None = None,
    accuracy: float | None = None,
    solver: str | None = None,
    step: float | None = None,
    parameters: Mapping[str, float] | None = None,
    inputs: Mapping[str, float] | None = None,
    outputs: Sequence[str] | None = None,
    native: bool | None = None,
    force: bool = False,
    progress: Progress | None = None,
) -> Result:
    """Simulate a model.

    Parameters
    ----------
    model
        A component, or what `compile` made of it (then nothing is compiled again).
    start_time, stop_time, output_interval, step
        Seconds; None takes them from the model's `experiment`. The default interval gives 500 intervals.
    tolerance
        Relative tolerance of the solver; absolute ones are a thousandth of it times the nominal magnitude.
    accuracy
        Wanted accuracy of the result instead of a tolerance: solver and tolerance are then the cheapest that reach it,
        which a bench of the model finds first (`acausal.bench`; that takes many runs). A given solver is kept.
    solver
        "auto", "idas", "rosenbrock", "cvodes", "erk", "collocation", "rk" or "rk2".
    parameters
        Values by path, in SI; they never recompile a compiled model.
    inputs
        Constant values of the model's own inputs.
    outputs
        Names of variables: only what these depend on is simulated, as `compile(model, outputs=...)` says. For a
        component; one whose contacts change its structure runs whole.
    native
        True compiles the equations to C, False interprets them; None uses what is compiled already, and compiles when
        a run is long (docs/devdocs/native.md). Without a C compiler everything is interpreted; results are the same.
    force
        True runs a fixed step that is too large to be stable too; otherwise it is refused (AC405).
    progress
        Called with the fraction done and the time reached.

    Raises
    ------
    AcausalError
        `RunError.result` holds what was computed before a failure.
    KeyboardInterrupt
        With a `result` attribute that holds what was computed.
    """
    wanted = partial(
        options,
        start_time=start_time,
        stop_time=stop_time,
        output_interval=output_interval,
        tolerance=tolerance,
        solver=solver,
        step=step,
        native=native,
    )
    if isinstance(model, Component) and accuracy is None and variable_parts(model):
        chosen = wanted(getattr(type(model), "experiment", Experiment()))
        return Pieces(model, chosen, parameters, _piece(inputs, force), progress).result()
    compiled = _compiled(model, parameters, outputs)
    if accuracy is not None:
        from acausal.study.bench.accurate import simulated

        own = parameters if isinstance(model, CompiledModel) else None
        run: dict[str, object] = {"start_time": start_time, "stop_time": stop_time, "parameters": own, "inputs": inputs}
        run |= {"native": native, "force": force}
        return simulated(compiled, accuracy, solver, tolerance, step, run, output_interval, progress)
    chosen = wanted(compiled.flat.experiment)
    given = parameters if isinstance(model, CompiledModel) else None
    p = parameter_vector(compiled, given or {})
    u = input_vector(compiled, inputs or {})
    return Run(compiled, chosen, p, u, progress, force).result()


def _compiled(
    model: Component | CompiledModel, parameters: Mapping[str, float] | None, outputs: Sequence[str] | None
) -> CompiledModel:
    """The model compiled; AC018 for outputs of one that has its own already."""
    if not isinstance(model, CompiledModel):
        return compile(model, parameters=parameters, outputs=outputs)
    if outputs is not None:
        raise UsageError(
            "AC018", "a compiled model has its outputs already", help="give them to compile(model, outputs=[...])"
        )
    return model


def _piece(inputs: Mapping[str, float] | None, force: bool) -> RunPiece:
    """How one piece of a run of changing structure is run."""

    def run(compiled: CompiledModel, opts: Options, start: Start | None, outputs: Vector, opening: bool) -> Result:
        p, u = parameter_vector(compiled, {}), input_vector(compiled, inputs or {})
        return Run(compiled, opts, p, u, None, force, given=start, outputs=outputs, opening=opening).result()

    return run


@dataclass
class Run:
    """The run while it is under way."""

    compiled: CompiledModel
    options: Options
    p: Vector
    u: Vector
    progress: Progress | None
    force: bool = False
    given: Start | None = None
    outputs: Vector | None = None
    opening: bool = True
    traced: bool = False
    timings: dict[str, float] = field(default_factory=dict)
    interrupt: Interruptible = field(default_factory=Interruptible)
    hybrid: Hybrid | None = None
    pace: float = 0.0
    memory: Memory | None = None

    def result(self) -> Result:
        opts = self.options
        check_undelayed(self.compiled, self.p)
        solver, reason = choose(self.compiled, opts.solver, opts.step)
        began = clock.perf_counter()
        instants = self.instants()
        boundaries = [opts.start_time, *instants, opts.stop_time]
        m = self.modes(boundaries[0], boundaries[1])
        problem = Problem(self.compiled, self.p, self.u, opts.native)
        start = self.begun(m) if not self.compiled.delays else self.remembering(problem, m)
        for note in start.notes:
            _log.warning("%s: %s", self.compiled.name, note)
        self.timings["initialize"] = clock.perf_counter() - began
        self.stabilise(start, m)
        recorder = Recorder(self.compiled, self.p, self.u)
        limit = StepLimit(problem, solver.name, opts, self.force)
        limit.check_start(opts.start_time, start.x, start.z, m)
        if self.compiled.state_events or self.traced or self.memory is not None:
            plain = self.plain(solver) if self.memory is None else self.memory.recorded(self.plain(solver), solver.name)
            self.hybrid = Hybrid(problem, solver, recorder, plain, self.tolerances, opts.span, self.traced)
        began = clock.perf_counter()
        grid = opts.grid() if self.outputs is None else self.outputs
        try:
            with self.interrupt:
                if self.hybrid is not None:
                    flag = "initial" if self.opening else None
                    if self.memory is None:
                        self.hybrid.begin(opts.start_time, start, m, flag=flag)
                    else:
                        begin(self.memory, self.hybrid, opts.start_time, start, m, flag)
                    self.pass_events(self.hybrid, solver, plan(self.compiled, self.p, np.array(boundaries), grid))
                else:
                    done, start = self.flown(problem, solver, recorder, start, np.array(boundaries), grid)
                    for a, b in pairwise(boundaries[done:]):
                        start = self.segment(problem, solver, recorder, start, a, b, grid)
        except (RunError, KeyboardInterrupt) as error:
            if not recorder.segments:
                raise
            error.result = self.finish(problem, recorder, solver, reason, start.notes)  # type: ignore[union-attr]
            if isinstance(error, IntegrationError):
                limit.check_run(recorder, error.result)
            raise
        finally:
            self.timings["integrate"] = clock.perf_counter() - began
        result = self.finish(problem, recorder, solver, reason, start.notes)
        limit.check_run(recorder, result)
        return result

    @property
    def tolerances(self) -> Tolerances:
        """What the solvers get."""
        tolerance = TOLERANCE_SHARE * self.options.tolerance
        return Tolerances(tolerance, tolerance * self.options.absolute_factor)

    def plain(self, solver: Solver) -> Callable[[Regime, Segment], Piece]:
        """The solver under any regime; RuntimeError when it cannot go on."""
        return lambda regime, segment: self.patient(regime.problem, solver)(segment)

    def begun(self, m: Vector) -> Start:
        """Where the run starts: at the states it was given, or where the start conditions say."""
        t = self.options.start_time
        if self.given is None:
            return initialize(self.compiled, t, self.p, self.u, m)
        if self.compiled.state_events:
            first = len(m) - len(self.compiled.state_events.relations)
            m[first:] = truths(self.compiled, t, self.given.x, self.given.z, self.u, self.p, m)
        return consistent(self.compiled, t, self.given, self.p, self.u, m)

    def remembering(self, problem: Problem, m: Vector) -> Start:
        """The start of a run of a model with delays."""
        if self.given is not None:
            help_ = "give the model without contacts that change its structure"
            refuse_delays(self.compiled.flat, "a run in pieces of different structure", help_)
        self.memory = Memory(self.compiled, self.p, self.u, self.tolerances, self.options.span)
        return opened(self.memory, problem, self.options.start_time, self.begun, m)

    def stabilise(self, start: Start, m: Vector) -> None:
        """Choose the rate of stabilised constraints by the model's own time scale at the start, unless it was given."""
        if self.compiled.solution.structure.rate is None or self.p[-1] != STABILISATION_RATE:
            return
        ode = np.array(self.compiled.rhs(self.options.start_time, start.x, start.z, self.u, self.p, m)[0]).ravel()
        fastest = float(np.max(np.abs(ode) / (np.abs(start.x) + self.compiled.nominal_x)))
        span = self.options.stop_time - self.options.start_time
        self.p[-1] = max(2.0 * fastest, 10.0 / span)

    def finish(
        self, problem: Problem, recorder: Recorder, solver: Solver, reason: str, notes: tuple[str, ...]
    ) -> Result:
        stats = {
            "solver": solver.name,
            "reason": reason,
            "tolerance": self.options.tolerance,
            "states": self.compiled.n_dynamic,
            "quadratures": self.compiled.quadratures,
            "algebraic": len(self.compiled.algebraic),
            **recorder.counters,
            "segments": recorder.segments,
            "native": bool(problem.native.used),
            "outputs": self.compiled.asked,
            "notes": (*self.compiled.flat.notes, *notes, *(self.hybrid.notes if self.hybrid else ())),
            **({"terminated": self.hybrid.terminated} if self.hybrid and self.hybrid.terminated is not None else {}),
            **({"events": len(recorder.boundaries)} if recorder.boundaries else {}),
            "time": {**self.compiled.timings, **self.timings},
        }
        events = event_log(recorder.boundaries, kept(self.compiled).instants(self.p)[0])
        return make_result(recorder, events, stats, self.dense(problem, solver, recorder))

    def instants(self) -> list[float]:
        """Time events inside the run, ascending, each once."""
        span = self.options.stop_time - self.options.start_time
        samples = sample_times(self.compiled, self.p, self.options.start_time, self.options.stop_time)
        found = np.unique(np.append(kept(self.compiled).instants(self.p)[0], samples))
        inside = [
            float(t)
            for t in found
            if np.isfinite(t)
            and t > self.options.start_time + 1e-13 * span
            and t < self.options.stop_time - 1e-13 * span
        ]
        return [t for k, t in enumerate(inside) if k == 0 or t - inside[k - 1] > 1e-13 * span]

    def modes(self, a: float, b: float) -> Vector:
        """Modes of the time events between two instants."""
        return kept(self.compiled).modes(0.5 * (a + b), self.p)[0]

    def pass_events(self, hybrid: Hybrid, solver: Solver, course: Course) -> None:
        """The whole run of a model with events."""
        template = self.stretch(
            float(course.instants[0]), course.times, Start(hybrid.reached.x, hybrid.reached.z, ()), hybrid.reached.m
        )
        recorder = hybrid.recorder
        try:
            if self.memory is None:
                hybrid.run(course, template, self.report)
            else:
                cross(self.memory, hybrid, course, template, self.report)
        except RuntimeError as error:
            self.interrupt.check()
            moment, here = hybrid.reached, recorder.time if recorder.segments else template.start
            times = course.outputs(min(int(np.searchsorted(course.instants, here, "right")), course.segments) - 1)
            reached = replace(template, start=here, times=times[times > here], x=moment.x, z=moment.z, p=moment.m)
            raise integration_error(moment.regime.problem, solver.name, reached, str(error)) from None
        samples = course.samples[-1] if hybrid.terminated is None else 0.0 * course.samples[-1]
        hybrid.end(recorder.time, samples)

    def flown(
        self, problem: Problem, solver: Solver, recorder: Recorder, start: Start, instants: Vector, grid: Vector
    ) -> tuple[int, Start]:
        """The segments that compiled code has passed by itself, from the first on, and the values at their end."""
        # one segment is faster as it is, and can be passed in parts
        if len(instants) < 3 or not can_fly(problem, solver):
            return 0, start
        course = plan(self.compiled, self.p, instants, grid)
        template = self.stretch(float(instants[0]), course.times, start, self.modes(instants[0], instants[1]))
        library = program(problem, solver, template)
        if library is None:
            return 0, start
        flight = Flight(problem, recorder, course, template, self.options.span)
        recorder.begin(template.start, start.x, start.z, template.p)
        landing = Landing(Place(0, template.start, True, True), start.x, template.p)
        share = None if self.progress is None else max(1, course.segments // 50)
        while landing.place.segment < course.segments:
            found = flight.go(library, landing, share)
            if found is None:
                break
            landing = found
            self.report(recorder.time)
        if landing.place.entered:  # what compiled code could not pass begins again
            recorder.withdraw()
        return landing.place.segment, replace(start, x=landing.x)

    def segment(
        self,
        problem: Problem,
        solver: Solver,
        recorder: Recorder,
        start: Start,
        a: float,
        b: float,
        grid: Vector,
    ) -> Start:
        """Integrate from a to b and record; returns the values at b."""
        m = self.modes(a, b)
        span = b - a
        times = np.append(grid[(grid > a + 1e-12 * span) & (grid < b - 1e-12 * span)], b)
        start = consistent(self.compiled, a, start, self.p, self.u, m)
        recorder.begin(a, start.x, start.z, m)
        for part in self.parts(times, recorder):
            segment = replace(self.stretch(float(recorder.time), part, start, m), first=self.pace)
            piece = self.integrate(problem, solver, recorder, segment, m)
            self.pace = pace(segment.start, float(part[-1]), piece.counters)
            piece = recorder.add(part[-piece.x.shape[1] :], piece, m)
            start = Start(piece.x[:, -1], piece.z[:, -1], start.notes)
            self.report(float(part[-1]))
        return start

    def report(self, t: float) -> None:
        """Say how far the run is."""
        if self.progress is not None:
            self.progress((t - self.options.start_time) / self.options.span, t)

    def stretch(self, here: float, times: Vector, start: Start, m: Vector) -> Segment:
        """The segment from `here` over the output times `times`."""
        return Segment(
            start=here,
            times=times,
            x=start.x,
            z=start.z,
            p=m,
            tolerance=TOLERANCE_SHARE * self.options.tolerance,
            absolute=TOLERANCE_SHARE * self.options.tolerance * self.options.absolute_factor,
            step=self.options.step,
            max_step=self.options.max_step,
        )

    def parts(self, times: Vector, recorder: Recorder) -> Iterator[Vector]:
        """Output times in chunks, after each of which progress is reported and the run can be stopped.

        One without progress; with it, the first fiftieth tells whether there is reason for more: each chunk restarts
        the solver, at the cost of steps and of accuracy. Steps are counted, not seconds, so that a run gives the same
        result every time.
        """
        if self.progress is None or len(times) < 100:
            yield times
            return
        before = recorder.counters.get("steps", 0.0)
        few = len(times) // 50
        yield times[:few]
        steps = 50.0 * (recorder.counters.get("steps", 0.0) - before)
        work = steps * (10 + len(self.compiled.states) + len(self.compiled.algebraic)) / _LONG
        yield from np.array_split(times[few:], int(np.clip(12 * work, 12, 50)) if work > 1.0 else 1)

    def integrate(self, problem: Problem, solver: Solver, recorder: Recorder, segment: Segment, m: Vector) -> Piece:
        integrate = self.patient(problem, solver)
        try:
            return integrate(segment)
        except RuntimeError as error:
            _log.debug("%s: %s", solver.name, error)
            reached, last = salvage(integrate, segment, lambda times, piece: recorder.add(times, piece, m))
            if last is not None:
                return last  # in smaller pieces it went through
            raise integration_error(problem, solver.name, reached, str(error)) from None

    def patient(self, problem: Problem, solver: Solver) -> Callable[[Segment], Piece]:
        """The solver on this problem; Ctrl-C is not taken for a failure of its."""

        def integrate(segment: Segment) -> Piece:
            try:
                return solver.integrate(problem, segment)
            except RuntimeError:
                self.interrupt.check()
                raise

        return integrate

    def dense(self, problem: Problem, solver: Solver, recorder: Recorder) -> Callable[[float], Vector]:
        """Values at any time: integrated again from the stored point before it."""

        def row(t: float) -> Vector:
            k = recorder.before(t)
            start, x, z, m = recorder.point(k)
            regime = self.hybrid.regime_at(start) if self.hybrid is not None else None
            segment = Segment(
                start=start,
                times=np.array([t]),
                x=x,
                z=z,
                p=m,
                tolerance=TOLERANCE_SHARE * self.options.tolerance,
                absolute=TOLERANCE_SHARE * self.options.tolerance * self.options.absolute_factor,
                step=self.options.step,
                max_step=self.options.max_step,
            )
            piece = solver.integrate(problem if regime is None else regime.problem, segment)
            if regime is not None:
                m = regime.modes(segment.times, piece.x, piece.z, m)
            on = projected(self.compiled, segment.times, piece.x, piece.z, self.u, self.p, m)
            return np.asarray(recorder.observe(segment.times, on, piece.z, m if m.ndim == 2 else m[:, None])[0])

        return row
