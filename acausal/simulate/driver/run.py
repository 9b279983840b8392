"""One run and everything that belongs to it: solver, start values, agenda, dynamics, record, and the result."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from weakref import WeakKeyDictionary

import numpy as np

from acausal.analyse.delays import refuse_delays
from acausal.arrays import Vector
from acausal.errors import IntegrationError, RunError
from acausal.flatten.parameters import doubtful_values
from acausal.lower.compiled import CompiledModel
from acausal.lower.subsystems.split import Subsystem, subsystems
from acausal.lower.variants.watched import LOCATABLE, UNWATCHED, UNWATCHED_STEPS, with_watched
from acausal.numeric.samples import STABILISATION_RATE
from acausal.result.result import Result
from acausal.simulate.clock import seconds
from acausal.simulate.delay.memory import Memory, check_undelayed
from acausal.simulate.delay.start import begin, opened
from acausal.simulate.driver.agenda import Agenda, Schedule, Source, known_instants, schedule
from acausal.simulate.driver.driver import Driver
from acausal.simulate.driver.hybrid import Hybrid
from acausal.simulate.driver.independent import IndependentSystems, Member
from acausal.simulate.driver.loop_memory import LoopMemory
from acausal.simulate.driver.missed.missed_events import MissedEvents
from acausal.simulate.driver.smooth import Smooth
from acausal.simulate.equations.function_cache import functions_of, truths
from acausal.simulate.equations.kinks import NONE, Kinks, kinks
from acausal.simulate.equations.problem import Problem
from acausal.simulate.events.errors import Endless
from acausal.simulate.events.regime import Regime
from acausal.simulate.inputs.given import Inputs
from acausal.simulate.interrupt import Interruptible
from acausal.simulate.options import Options
from acausal.simulate.record.boundaries import event_log
from acausal.simulate.record.checks import corners, refuse_fractions, refuse_jumps, refuse_leaps
from acausal.simulate.record.divisors.poles import refuse_poles
from acausal.simulate.record.meeting.branches import crossed_branches, looks
from acausal.simulate.record.meeting.singular import singular_positions
from acausal.simulate.record.record import Dense, Recorder, make_result
from acausal.simulate.record.sizes import unresolved
from acausal.simulate.record.undefined import undefined_relations
from acausal.simulate.record.violations import violations
from acausal.simulate.rounding import MANY, STRETCH, STRETCHES, attainable, remark
from acausal.simulate.solvers import Solver, choose, tolerance_fraction
from acausal.simulate.solvers.segment import Piece, Segment, Tolerances
from acausal.simulate.start.initialize import Start, consistent, initialize
from acausal.simulate.step_limit.coarse import coarse_steps
from acausal.simulate.step_limit.externals import note_on_externals
from acausal.simulate.step_limit.limit import StepLimit

Progress = Callable[[float, float], None]
_log = logging.getLogger(__name__)
# How far points may be from the constraints with fixed steps, and at the tightest tolerances.
_MOVED_FIXED, _MOVED_LEAST = 1e-2, 1e-9
# With more segments, independent systems are integrated together: each of them would restart at every stop.
_MOST_STOPS = 50


_UNSEARCHED = (
    "stretches from t = {:.6g} s on take too many steps to be searched for what steep functions (exp, tanh, atan, high "
    "powers) do between them: a pulse within one step may be missed; compare with a run with a max_step"
)


_DOUBTFUL: WeakKeyDictionary[CompiledModel, tuple[bytes, tuple[str, ...]]] = WeakKeyDictionary()


def doubtful_parameters(compiled: CompiledModel, p: Vector) -> tuple[str, ...]:
    """Notes on doubtful parameters; kept for those of the last run, because models may have hundreds of contacts."""
    known = _DOUBTFUL.get(compiled)
    if known is None or known[0] != p.tobytes():
        known = _DOUBTFUL[compiled] = p.tobytes(), doubtful_values(compiled.flat, p.tolist())
    return known[1]


@dataclass
class Run:
    """A run in progress.

    `given`: States to start with instead of the start conditions.
    `outputs`: Times of rows [s] instead of those of the grid.
    `opening`: Whether `initial()` is true at the start.
    `traced`: Whether all events are kept.
    `sources`: What stops the run besides its time events and delays.
    `why`: Reported instead of the reason for which the solver was chosen.
    `watches`: Whether kinks at which rates may become active are located; not in a run that would fail because of it.
    `searches`: Whether rows are searched for what steep functions do between them; not if all steps are bounded.
    `problem`: The equations with the numbers of this run.
    `tables`: The stops that long tables of time require.
    `tolerances`: Those of the solver, a fraction of those of the run.
    `unsearched`: The starts of stretches with too many steps to be searched [s].
    `hidden`: Instants of rows that the result leaves out [s].
    """

    compiled: CompiledModel
    options: Options
    p: Vector
    inputs: Inputs
    progress: Progress | None
    force: bool = False
    given: Start | None = None
    outputs: Vector | None = None
    opening: bool = True
    traced: bool = False
    sources: tuple[Source, ...] = ()
    why: str = ""
    watches: bool = True
    searches: bool = True
    solver: Solver = field(init=False)
    problem: Problem = field(init=False)
    tables: Kinks = field(init=False)
    tolerances: Tolerances = field(init=False)
    timings: dict[str, float] = field(default_factory=dict)
    interrupt: Interruptible = field(default_factory=Interruptible)
    unsearched: list[float] = field(default_factory=list)
    hidden: Vector = field(default_factory=lambda: np.zeros(0))
    recorder: Recorder | None = None
    stopped: Segment | None = None
    dynamics: Smooth | Hybrid | IndependentSystems | None = None
    _next_check: float = STRETCHES * STRETCH

    @property
    def u(self) -> Vector:
        """Constant inputs, shape (nu,); inputs over time are modes."""
        return self.inputs.u

    @property
    def hybrid(self) -> Hybrid | None:
        """The dynamics of the model as one system with events; None if it has no events."""
        one = self.dynamics.one if isinstance(self.dynamics, IndependentSystems) else self.dynamics
        return one if isinstance(one, Hybrid) else None

    @property
    def independent(self) -> IndependentSystems | None:
        """The dynamics of systems that share no equation; None if the model is integrated as one system."""
        return self.dynamics if isinstance(self.dynamics, IndependentSystems) else None

    def result(self) -> Result:
        """Run; if the run fails while kinks are located, once more without, because they are no events.

        Raises RunError, whose `result` holds what was computed.
        """
        plain = self.compiled
        try:
            return self._result()
        except (Endless, IntegrationError):
            if self.sources or self.compiled is plain:  # sources cannot be restarted
                raise
            self.compiled, self.watches, self.timings, self.interrupt = plain, False, {}, Interruptible()
            self.unsearched.clear()
            return self._result()

    def _result(self) -> Result:
        opts = self.options
        if self.compiled.flat.undelayed:
            check_undelayed(self.compiled, self.p)
        self.solver, reason = choose(self.compiled, opts.solver, opts.step, len(self.inputs.breaks))
        self.why = self.why or reason
        notes: tuple[str, ...] = ()
        if not self.solver.fixed_step and opts.step is None:  # no fixed step misses what becomes active
            bounded, tables, operations = "" if self.watches else UNWATCHED, "", self.compiled.operations
            if self.watches and operations & LOCATABLE:
                self.compiled, bounded, tables = with_watched(self.compiled, opts.tolerance, branches=self.traced)
            is_blind = "call" in operations and opts.max_step is None and not bounded
            unseen = note_on_externals(self.compiled) if is_blind else ""
            notes = tuple(note for note in (bounded, tables, unseen) if note)
            if bounded:  # error control sees what becomes active within a bounded step
                longest = opts.span / UNWATCHED_STEPS
                opts = self.options = replace(opts, max_step=min(opts.max_step or longest, longest))
                self.searches = False  # the note says what may be missed under this bound
        self.problem = Problem(self.compiled, self.p, self.u, opts.native)
        self.tables = self._tables()
        bends = self.solver.multistep and self.tables.are_dense
        self.tolerances = opts.tolerances.scaled(tolerance_fraction(self.compiled, self.solver, opts.tolerance, bends))
        began = seconds()
        instants = self.instants()
        m = self.modes(instants[0], instants[1])
        refuse_jumps(self.compiled, instants.tolist(), self.modes, self.p)
        memory = self.memory_of_delays() if self.compiled.delays else None
        start = (
            self.start_values(m)
            if memory is None
            else opened(memory, self.problem, opts.start_time, self.start_values, m)
        )
        doubtful = doubtful_parameters(self.compiled, self.p)
        start = replace(start, notes=(*start.notes, *doubtful, *notes))
        for note in start.notes:
            _log.warning("%s: %s", self.compiled.name, note)
        self.timings["initialize"] = seconds() - began
        self.stabilise(start, m)
        recorder = self.recorder = Recorder(self.compiled, self.p, self.u, self.most_moved())
        limit = None if opts.step is None or self.force else StepLimit(self.problem, self.solver.name, opts)
        if limit is not None:
            limit.check_start(opts.start_time, start.x, start.z, m)
        driver = self.driver(recorder, instants, start, m, memory)
        began = seconds()
        try:
            with self.interrupt:
                flag = "initial" if self.opening else None
                if memory is None:
                    driver.dynamics.begin(opts.start_time, start, m, flag)
                else:
                    begin(memory, driver.dynamics, opts.start_time, start, m, flag)
                driver.go()
                refuse_leaps(recorder, opts.tolerances)
                refuse_poles(self.problem, recorder, opts.tolerances)
                refuse_fractions(recorder)
                broken = violations(recorder, self.p, self.u, opts.tolerances)
        except (RunError, KeyboardInterrupt) as error:
            self.stopped = driver.stopped
            if not recorder.segments:
                raise
            error.result = self.assembled(recorder, start.notes)  # type: ignore[union-attr]
            if limit is not None and isinstance(error, IntegrationError):
                limit.check_run(recorder, error.result, self.equations_at)
            raise
        finally:
            self.timings["integrate"] = seconds() - began
        long = memory is None and self.independent is None and recorder.counters.get("steps", 0.0) >= MANY
        notes = self.rounding_notes(recorder, opts.stop_time) if long else ()
        unknown = (*self._doubts(recorder), *broken)
        for note in unknown:
            _log.warning("%s: %s", self.compiled.name, note)
        result = self.assembled(recorder, (*start.notes, *notes, *unknown, *corners(recorder)))
        if limit is not None:
            limit.check_run(recorder, result, self.equations_at)
        return result

    def _doubts(self, recorder: Recorder) -> tuple[str, ...]:
        """Notes on what the recorded rows do not resolve, or leave open."""
        step = self.options.step
        if step is None:
            unknown = unresolved(recorder, self.p, self.u, self.options.tolerances)
        else:
            unknown = coarse_steps(self.problem, recorder, self.rows_again, step)
        meeting = crossed_branches(self.problem, recorder, self.rows_again, step, self.solver.algebraic)
        singular = singular_positions(recorder) or meeting
        return (*unknown, *singular, *undefined_relations(recorder, self.p, self.u))

    def start(self) -> Result:
        """The start of the run as a result of one row, before any event there."""
        opts = self.options
        m = self.modes(*known_instants(self.compiled, self.p, self.inputs, opts.start_time, opts.stop_time)[:2])
        start = self.start_values(m)
        self.stabilise(start, m)
        recorder = Recorder(self.compiled, self.p, self.u)
        recorder.begin(opts.start_time, start.x, start.z, m)
        return make_result(recorder, (), {}, None)

    def _tables(self) -> Kinks:
        """Stops and longest steps that long tables of time require of a solver with step control."""
        opts = self.options
        if self.solver.fixed_step or opts.step is not None or "table" not in self.compiled.operations:
            return NONE
        return kinks(self.compiled, self.p, opts.tolerance, opts.start_time, opts.stop_time)

    def instants(self) -> Vector:
        """Start, time events, samples, breaks of inputs and kinks of tables, and stop [s]."""
        opts = self.options
        # steps of a solver that interpolates end at outputs; nothing is known of one from outside
        all_ = None if getattr(self.solver, "interpolates", False) else self.tables.instants
        cuts = self.tables.cuts if self.solver.multistep else all_
        return known_instants(self.compiled, self.p, self.inputs, opts.start_time, opts.stop_time, cuts)

    def driver(self, recorder: Recorder, instants: Vector, start: Start, m: Vector, memory: Memory | None) -> Driver:
        """The driver at the start of the run."""
        opts, problem, solver = self.options, self.problem, self.solver
        grid = opts.grid() if self.outputs is None else self.outputs
        if self.outputs is None:
            self.hidden = looks(self.compiled, self.p, opts, self.solver.fixed_step)
        more = [self.hidden] if self.solver.multistep else [self.hidden, self.tables.instants]
        if any(map(len, more)):
            grid = np.unique(np.concatenate([grid, *more]))
        bounds = self.tables if self.solver.multistep else NONE
        known = schedule(self.compiled, self.p, self.inputs, instants, grid, bounds, opts.max_step)
        template = self.segment(float(instants[0]), known.times, start.x, start.z, m)
        sources: tuple[Source, ...] = self.sources if memory is None else (memory, *self.sources)
        report = None if self.progress is None else self.report
        if self.compiled.state_events or self.traced or memory is not None:
            explore = self.under
            integrate = explore if memory is None else memory.recorded(explore, solver.multistep)

            def whole() -> Hybrid:
                parts = integrate, explore, self.tolerances, template, opts.span, self.traced
                missed = self.missed_events(self.compiled, solver)
                return Hybrid(problem, solver, recorder, *parts, missed, None if memory is None else memory.jumped)

            members = self.members(known, template) if memory is None else []
            if members:
                self.dynamics = IndependentSystems(problem, recorder, members, whole, self.interrupt.check, report)
            else:
                self.dynamics = whole()
        else:
            self.dynamics = Smooth(problem, solver, recorder, self.integrate, template, opts.span, report)
        agenda = Agenda(known, sources, opts.span)
        return Driver(agenda, self.dynamics, recorder, solver.name, report, self.interrupt.check)

    def members(self, known: Schedule, template: Segment) -> list[Member]:
        """The systems of the model that share no equation; none if it is integrated as one system."""
        opts = self.options
        if self.solver.fixed_step or opts.step is not None or self.traced or len(self.tables.instants):
            return []
        if known.segments > _MOST_STOPS:
            return []
        memories: dict[int, LoopMemory] = {}
        return [self.member(part, template, memories) for part in subsystems(self.compiled)]

    def member(self, part: Subsystem, template: Segment, memories: dict[int, LoopMemory]) -> Member:
        """One of these systems, with a solver that suits its size."""
        opts, model, none = self.options, part.model, np.zeros(0)
        problem = Problem(model, part.p(self.p, self.u), none, opts.native)
        solver, self.why = choose(model, opts.solver, None)
        tolerances = opts.tolerances.scaled(tolerance_fraction(model, solver, opts.tolerance))
        recorder = Recorder(model, problem.p, none, self.most_moved())
        base = replace(template, x=template.x[part.states], z=none, p=template.p[part.modes], tolerances=tolerances)

        def under(regime: Regime, segment: Segment) -> Piece:
            return self.integrate(regime.problem, segment, solver)

        if model.state_events:
            parts = under, under, tolerances, base, opts.span
            search = self.missed_events(model, solver)
            hybrid = Hybrid(problem, solver, recorder, *parts, missed_events=search, memories=memories)
            return Member(part, problem, solver, recorder, hybrid, opts.span)
        smooth = Smooth(problem, solver, recorder, partial(self.integrate, solver=solver), base, opts.span)
        return Member(part, problem, solver, recorder, smooth, opts.span)

    def under(self, regime: Regime, segment: Segment) -> Piece:
        """Integrate under any regime; RuntimeError if the solver cannot continue."""
        return self.integrate(regime.problem, segment)

    def integrate(self, problem: Problem, segment: Segment, solver: Solver | None = None) -> Piece:
        """Call the solver, with the search for missed events; KeyboardInterrupt if it failed because of Ctrl-C."""
        try:
            solver_used = solver or self.solver
            search = self.missed_events(problem.compiled, solver_used)
            piece = solver_used.integrate(problem, segment) if search is None else search(problem, segment)
        except RuntimeError:
            self.interrupt.check()
            raise
        if piece.stopped:
            self.interrupt.check()
        return piece

    def missed_events(self, compiled: CompiledModel, solver: Solver) -> MissedEvents | None:
        """The search for events that a solver misses; None for equations without steep functions."""
        if not self.searches or not compiled.is_steep:
            return None
        return MissedEvents(solver.integrate, self.unsearched.append)

    def segment(self, here: float, times: Vector, x: Vector, z: Vector, m: Vector) -> Segment:
        """A segment for a solver: from `here` over the output times `times`."""
        return Segment(here, times, x, z, m, self.tolerances, self.options.step, self.options.max_step)

    def report(self, t: float) -> None:
        """Report the progress of the run."""
        if self.progress is not None:
            self.progress((t - self.options.start_time) / self.options.span, t)
            self.warn_of_rounding(t)

    def warn_of_rounding(self, t: float) -> None:
        """Warn as soon as a run turns out to be long because rounding errors determine its steps.

        Checked again whenever the number of steps has doubled, because the noise may begin later.
        """
        assert self.recorder is not None, "a run under way records"
        steps = self.recorder.counters.get("steps", 0.0)
        done = (t - self.options.start_time) / self.options.span
        if not 0.0 < done < 1.0 or steps < self._next_check or steps / done < MANY:
            return
        if self.compiled.delays or self.independent is not None:
            return
        self._next_check = 2.0 * steps
        for note in self.rounding_notes(self.recorder, t):
            _log.warning("%s: at t = %g s: %s", self.compiled.name, t, note)
            self._next_check = math.inf

    def modes(self, a: float, b: float) -> Vector:
        """Modes of the time events, and coefficients of inputs over time, between two instants."""
        middle = 0.5 * (a + b)
        m: Vector = functions_of(self.compiled).modes(middle, self.p)[0]
        return np.asarray(self.inputs.into(self.compiled, m[None, :], np.array([middle]))[0])

    def start_values(self, m: Vector) -> Start:
        """The start values: the states that were given, or the solution of the start conditions."""
        t = self.options.start_time
        if self.given is None:
            return initialize(self.compiled, t, self.p, self.u, m)
        if self.compiled.state_events:
            first = len(m) - len(self.compiled.state_events.relations)
            m[first:] = truths(self.compiled, t, self.given.x, self.given.z, self.u, self.p, m)
        return consistent(self.compiled, t, self.given, self.p, self.u, m)

    def memory_of_delays(self) -> Memory:
        """The memory of the past of a model with delays."""
        if self.given is not None:
            help_ = "give the model without contacts that change its structure"
            refuse_delays(self.compiled.flat, "a run in pieces of different structure", help_)
        return Memory(self.compiled, self.p, self.u, self.tolerances, self.options.span)

    def stabilise(self, start: Start, m: Vector) -> None:
        """Choose the rate of stabilised constraints by the model's own time scale at the start, unless it was given."""
        structure = self.compiled.solution.structure
        if structure.rate is None or not structure.invariants or self.p[-1] != STABILISATION_RATE:
            return
        ode = np.array(self.compiled.rhs(self.options.start_time, start.x, start.z, self.u, self.p, m)[0]).ravel()
        fastest = float(np.max(np.abs(ode) / (np.abs(start.x) + self.compiled.nominal_x)))
        self.p[-1] = max(2.0 * fastest, 10.0 / self.options.span)

    def most_moved(self) -> float:
        """How far recorded points may be from the constraints: ten tolerances if they control the steps."""
        is_fixed = self.solver.fixed_step or self.options.step is not None
        return _MOVED_FIXED if is_fixed else self.options.tolerances.scaled(10.0, _MOVED_LEAST).relative

    def equations_at(self, t: float) -> CompiledModel:
        """The model that is integrated just after a time, with the relations held there."""
        events = self.independent or self.hybrid
        return self.compiled if events is None else events.regime_at(t).compiled

    def again(self, recorder: Recorder, row: int, times: Vector) -> tuple[Piece, Vector]:
        """Integrate again from a recorded row; the solution and its modes at `times`. RuntimeError if that fails."""
        here, x, z, m = recorder.point(row)
        if self.independent is not None and here < self.independent.joined:
            return self.independent.again(here, (x, m), times)
        segment = self.segment(here, times, x, z, m)
        segment = replace(segment, max_step=self.tables.longest(here, float(times[-1]), segment.max_step))
        if self.hybrid is None:
            return self.integrate(self.problem, segment), m
        regime = self.hybrid.regime_at(here)
        piece = self.integrate(regime.problem, segment)
        return piece, regime.modes(times, piece.x, piece.z, m)

    def rows_again(self, row: int, times: Vector) -> tuple[Vector, ...]:
        """Times, states, algebraic variables and modes integrated again from a row; RuntimeError where that fails."""
        assert self.recorder is not None, "a run that is over has rows"
        piece, m = self.again(self.recorder, row, times)
        return times, piece.x, piece.z, np.tile(m[:, None], (1, len(times))) if m.ndim == 1 else m

    def rounding_notes(self, recorder: Recorder, reached: float) -> tuple[str, ...]:
        """A note on a run of many steps up to `reached` [s] if its tolerance is below the attainable accuracy."""
        opts, steps = self.options, recorder.counters.get("steps", 0.0)
        if self.solver.fixed_step or opts.step is not None or len(self.inputs.breaks):
            return ()
        stretches, span = [], min(reached, recorder.time) - opts.start_time
        for t in opts.start_time + span * (np.arange(STRETCHES) + 0.5) / STRETCHES:
            here, *at = recorder.point(recorder.before(float(t)))
            stretches.append(self.segment(here, np.array([here + STRETCH * span / steps]), *at))

        def again(segment: Segment) -> Piece:
            problem = self.problem if self.hybrid is None else self.hybrid.regime_at(segment.start).problem
            return self.solver.integrate(problem, segment)

        return remark(attainable(again, stretches), steps, self.solver.name, opts.tolerances)

    def assembled(self, recorder: Recorder, notes: tuple[str, ...]) -> Result:
        """The result of all that was recorded."""
        looked_at = np.concatenate([self.tables.instants, self.hidden])
        if len(looked_at):
            grid = self.options.grid() if self.outputs is None else self.outputs
            recorder.hide_at(looked_at, np.append(grid, self.inputs.breaks))
        known = functions_of(self.compiled).instants(self.p)[0]
        events = event_log(recorder.boundaries, known, self.inputs, self.tables.instants)
        hybrid, independent, native = self.hybrid, self.independent, self.problem.native
        later_notes = (
            independent.notes if independent is not None else tuple(hybrid.notes) if hybrid is not None else ()
        )
        if self.unsearched:
            later_notes = (*later_notes, _UNSEARCHED.format(min(self.unsearched)))
        solvers = [m.solver.name for m in independent.members] if independent is not None else [self.solver.name]
        used = [native, *(m.problem.native for m in independent.members)] if independent is not None else [native]
        stats = {
            "solver": ", ".join(dict.fromkeys(solvers)),
            "reason": self.why,
            **({"subsystems": len(solvers)} if independent is not None else {}),
            "tolerance": self.options.tolerance,
            "states": self.compiled.n_dynamic,
            "quadratures": self.compiled.quadratures,
            "algebraic": len(self.compiled.algebraic),
            **recorder.counters,
            "segments": recorder.segments,
            "native": any(n.used for n in used),
            "outputs": self.compiled.requested_outputs,
            "notes": tuple(
                dict.fromkeys((*self.compiled.flat.notes, *notes, *later_notes, *used[-1].notes(solvers[-1])))
            ),
            **({"terminated": hybrid.terminated} if hybrid is not None and hybrid.terminated is not None else {}),
            **({"events": len(events.boundaries)} if events.boundaries else {}),
            "time": {**self.compiled.timings, **self.timings},
        }
        dense = Dense(recorder, lambda row, at: self.again(recorder, row, at), self.equations_at)
        return make_result(recorder, events, stats, dense)
