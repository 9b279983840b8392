"""The compiled model: CasADi functions with documented signatures, and what their entries mean."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from acausal.analyse.blocks.solve import Solution
from acausal.analyse.delays import PADE, WIDTH, Delays, refuse_delays
from acausal.analyse.start import StartProblem
from acausal.analyse.state_events import StateEvents
from acausal.analyse.time_events import TimeEvents
from acausal.flatten.flat import FlatSystem
from acausal.flatten.reduced import nominal
from acausal.language.component import Component
from acausal.lower.build import Builder
from acausal.lower.casadi_model import CasadiModel
from acausal.lower.chebyshev import INPUT_WIDTH, polynomial
from acausal.lower.columns.mapped import Mapped, mapped
from acausal.lower.event_functions import EventFunctions
from acausal.numeric.samples import STABILISATION_RATE
from acausal.providers import provided
from acausal.reduce.confine import changing, refuse_unsteady
from acausal.reduce.select import Selection

Vector = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Recipe:
    """What a model was compiled from, for one whose structure changes while it runs."""

    model: Component
    parameters: Mapping[str, object]
    formulation: str = "torn"
    freeze: tuple[str, ...] = ()
    quasi_static: tuple[str, ...] = ()
    cache: bool = True


@dataclass(frozen=True, eq=False)
class CompiledModel:
    """A model ready to run; made by `acausal.compile`, never changed.

    Sizes: `nx` states (`n_dynamic` of the coupled system, then `quadratures` integrals of time that act on nothing,
    then `discretes` variables that change at events only), `nz` algebraic variables, `nu` inputs, `np` free parameters,
    `nm` modes of events; the numbers of delayed signals and of inputs over time are among them.

    Attributes
    ----------
    solution
        The symbolic stage it was lowered from; `solution.structure.reduced.flat` is the flat system.
    rhs
        `(t, x[nx], z[nz], u[nu], p[np], m[nm]) -> (ode[nx], alg[nz])`, SX, smooth in each mode.
    instants
        `(p) -> times[nm]` at which the modes change.
    modes
        `(t, p) -> m[nm]`, 0 or 1: relations of time, then all others (`mode_nodes`), undecided as 0.
    selection
        What was left out of the model, and why; None for the full model.
    timings
        Seconds per stage of the compilation.
    driven
        Places in u of the inputs that are functions of time: polynomials in each stretch of a run, whose numbers are
        modes. What u holds there is not used (`acausal.lower.driven`).
    recipe
        What `simulate` compiles again and again while the structure of the model changes; None where it never does.
    varied
        Whether `rhs` says something else than `solution`: a regime (`simulate/events/regime.py`).
    """

    name: str
    solution: Solution
    state_variables: tuple[int, ...]
    quadratures: int
    discretes: int
    start: StartProblem
    time_events: TimeEvents
    rhs: Any
    modes: Any
    instants: Any
    state_events: StateEvents = field(default_factory=StateEvents)
    delays: Delays = field(default_factory=Delays)
    selection: Selection | None = None
    recipe: Recipe | None = None
    driven: tuple[int, ...] = ()
    timings: dict[str, float] = field(default_factory=dict)
    varied: bool = False

    def __repr__(self) -> str:
        return (
            f"CompiledModel({self.name}: {len(self.continuous)} states, {len(self.algebraic)} algebraic, "
            f"{len(self.parameters)} parameters, {len(self.flat.equations)} flat equations)"
        )

    def _repr_html_(self) -> str:
        shown: str = provided("compiled_html")(self)
        return shown

    def __getstate__(self) -> dict[str, Any]:
        """The fields: functions that were made from them are made again where they are asked for."""
        return {f.name: self.__dict__[f.name] for f in fields(self)}

    def unchanging(self, what: str) -> CompiledModel:
        """The model with all that may ever be in its equations, for `what` needs equations that stay.

        Raises
        ------
        UsageError
            AC027 when no such equations hold for a whole run: drills that leave several holes.
        """
        if self.recipe is None:
            return self
        whole = {path: part.whole() for path, part in changing(self.recipe.model).items()}
        refuse_unsteady(self.name, whole, f"{what} needs equations that stay")
        return replace(self, recipe=None)

    @property
    def flat(self) -> FlatSystem:
        """The flat system the model was compiled from."""
        return self.solution.structure.reduced.flat

    @property
    def asked(self) -> tuple[str, ...]:
        """The outputs that a reduced model was reduced to; empty for a full one."""
        return (self.selection.outputs or ()) if self.selection is not None else ()

    @cached_property
    def states(self) -> tuple[str, ...]:
        """Names of the states, in the order of x."""
        return tuple(map(self.solution.structure.reduced.name, self.state_variables))

    @cached_property
    def algebraic(self) -> tuple[str, ...]:
        """Names of the algebraic variables, in the order of z."""
        return tuple(map(self.solution.structure.reduced.name, self.solution.algebraic))

    @cached_property
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs, in the order of u."""
        return tuple(map(self.flat.scalar_name, self.flat.inputs))

    @property
    def continuous(self) -> tuple[str, ...]:
        """Names of the states that vary between events: discrete variables, the last of x, are none of them."""
        return self.states[: len(self.states) - self.discretes]

    @property
    def n_dynamic(self) -> int:
        """Number of states of the coupled system."""
        return len(self.state_variables) - self.quadratures - self.discretes

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the free parameters, in the order of p; the rate of stabilised constraints is the last."""
        extra = ("stabilisation.rate",) if self.solution.structure.rate is not None else ()
        return (*self.flat.parameter_names, *extra)

    @property
    def parameter_values(self) -> tuple[float, ...]:
        """Values of the free parameters as declared in the model."""
        extra = (STABILISATION_RATE,) if self.solution.structure.rate is not None else ()
        return (*self.flat.parameter_values, *extra)

    def nominal(self, variables: Sequence[int]) -> Vector:
        """Declared nominal magnitudes of reduced variables."""
        return np.array([nominal(self.solution.structure.reduced, v) for v in variables], dtype=float)

    @cached_property
    def nominal_x(self) -> Vector:
        """Nominal magnitudes of the states, shape (nx,)."""
        return self.nominal(self.state_variables)

    @cached_property
    def nominal_z(self) -> Vector:
        """Nominal magnitudes of the algebraic variables, shape (nz,)."""
        return self.nominal(self.solution.algebraic)

    def mapped(self, zeros: tuple[int, ...] = ()) -> Mapped | None:
        """The same equations with each pattern of repeated components once; None where that does not pay.

        `zeros` are the places of parameters that are zero, whatever p holds.
        """
        if zeros not in self._mapped:
            self._mapped[zeros] = mapped(self, frozenset(zeros))
        return self._mapped[zeros]

    @cached_property
    def _mapped(self) -> dict[tuple[int, ...], Mapped | None]:
        return {}

    @cached_property
    def columns(self) -> tuple[int, ...]:
        """Nodes whose trajectories a result holds: states, algebraic, inputs, then everything observed."""
        reduced = self.solution.structure.reduced
        pool = reduced.pool
        found: dict[int, None] = {}
        order = [*self.state_variables, *self.solution.algebraic, *reduced.inputs]
        for v in [*order, *(v for v, _ in self.solution.definitions)]:
            found[pool.var(v)] = None
        for scalar, node in enumerate(reduced.image):
            op, *rest = pool.nodes[node]
            if op == "neg":
                op = pool.nodes[rest[0]][0]
            if scalar not in reduced.left_out and op not in ("var", "const") and pool.variables_in(node):
                found[node] = None
        return tuple(found)

    @cached_property
    def observe(self) -> Any:
        """`(t, x, z, u, p, m) -> y[len(columns)]`: every trajectory of the model at one instant."""
        return self._observe(blend=False)

    @cached_property
    def blended_observe(self) -> Any:
        """`observe` for modes between 0 and 1."""
        return self._observe(blend=True)

    def _observe(self, blend: bool) -> Any:
        symbols = Symbols(self)
        builder = symbols.builder(self)
        builder.blend = blend
        builder.define(self.solution.definitions, self.rewritten)
        y = builder.column([builder.replaced(n) for n in self.columns])
        return ca.Function("observe", symbols.inputs, [ca.densify(y)], _INPUTS, ["y"])

    @cached_property
    def blended(self) -> Any:
        """`rhs` for modes between 0 and 1: `where` is then a mean of its two values (sliding modes)."""
        ode, alg = ([self.solution.structure.derivative(x) for x in self.state_variables], self.solution.residuals)
        symbols = Symbols(self)
        builder = symbols.builder(self)
        builder.blend = True
        builder.define(self.solution.definitions, self.rewritten)
        pool = self.solution.structure.reduced.pool
        parts = [builder.column([pool.var(v) for v in ode]), builder.column([builder.replaced(r) for r in alg])]
        return ca.Function("blended", symbols.inputs, parts, _INPUTS, ["ode", "alg"])

    @cached_property
    def guess(self) -> Any:
        """`(p) -> (x[nx], z[nz])`: declared starts and guesses; 0 where nothing is declared."""
        p = ca.SX.sym("p", len(self.parameters))
        builder = Builder(self.solution.structure.reduced.pool, ca.SX(0), p, {})
        declared = {**self.start.guesses, **self.start.direct}
        x, z = (
            _column([builder.lower([declared[v]])[0] if v in declared else ca.SX(0) for v in variables])
            for variables in (self.state_variables, self.solution.algebraic)
        )
        return ca.Function("guess", [p], [x, z], ["p"], ["x", "z"])

    @cached_property
    def conditions(self) -> Any:
        """`(t, x, z, u, p, m) -> (used, surplus)`: residuals of the start conditions; see `StartProblem`."""
        symbols = Symbols(self)
        builder = symbols.builder(self)
        builder.define(self.solution.definitions, self.rewritten)
        parts = [
            _column(builder.lower([builder.replaced(c.node) for c in group]))
            for group in (self.start.conditions, self.start.surplus)
        ]
        return ca.Function("conditions", symbols.inputs, parts, _INPUTS, ["used", "surplus"])

    @property
    def mode_nodes(self) -> tuple[int, ...]:
        """Nodes behind the modes, in the order of m."""
        events = self.state_events
        return (*self.time_events.relations, *events.samples, *events.memories, *events.flags, *events.relations)

    @cached_property
    def rewritten(self) -> dict[int, int]:
        """Nodes that jump or have a kink, by branches on modes."""
        return {**self.time_events.rewritten, **self.state_events.rewritten}

    @property
    def mode_places(self) -> tuple[int, ...]:
        """Places of `mode_nodes` in m; the numbers of inputs and delays come behind the relations of time."""
        timely, gap = len(self.time_events.relations), len(self.driven) * INPUT_WIDTH + self.delays.size
        return tuple(k if k < timely else k + gap for k in range(len(self.mode_nodes)))

    @property
    def n_timely(self) -> int:
        """Number of modes that are known before a stretch: relations of time, inputs over time, and delays."""
        return len(self.time_events.relations) + len(self.driven) * INPUT_WIDTH + self.delays.size

    @property
    def n_modes(self) -> int:
        """Number of modes."""
        return len(self.mode_nodes) + len(self.driven) * INPUT_WIDTH + self.delays.size

    @cached_property
    def all_modes(self) -> Any:
        """`(t, x, z, u, p) -> m[nm]`: all relations as they hold at a point, for use outside a run.

        Samples, `initial()` and `terminal()` are false there, and `pre(d)` is d.

        Raises
        ------
        UsageError
            AC035 for a model with delays, which depends on the past.
        """
        refuse_delays(self.flat, "a point without a past", PADE)
        symbols = Symbols(self)
        builder = symbols.builder(self)
        builder.done = {n: ca.SX(0) for n in (*self.state_events.samples, *self.state_events.flags)}
        builder.define(self.solution.definitions, self.rewritten)
        m = _column(builder.lower(self.mode_nodes))
        return ca.Function("all_modes", symbols.inputs[:-1], [m], _INPUTS[:-1], ["m"])

    @cached_property
    def events(self) -> EventFunctions:
        """What the event iteration asks for."""
        return EventFunctions(self)

    @cached_property
    def delay_signals(self) -> Any:
        """`(t, x, z, u, p, m) -> [sources, delays]`: what is to be remembered, how long ago each delay reads [s]."""
        return self._delay_signals(blend=False)

    @cached_property
    def blended_delay_signals(self) -> Any:
        """The same for modes between 0 and 1, of sliding modes."""
        return self._delay_signals(blend=True)

    def _delay_signals(self, blend: bool) -> Any:
        symbols = Symbols(self)
        builder = symbols.builder(self)
        builder.blend = blend
        builder.define(self.solution.definitions, self.rewritten)
        column = ca.vertcat(*builder.lower([builder.replaced(n) for n in self.delays.roots]))
        return ca.Function("signals", symbols.inputs, [ca.densify(column)], ["t", "x", "z", "u", "p", "m"], ["y"])

    @cached_property
    def homotopy(self) -> Any:
        """`(t, x, z, u, p, m, s) -> (used, alg)`: the start system from simplified (s = 0) to actual (s = 1).

        None when the model says `homotopy(...)` nowhere.
        """
        pool = self.solution.structure.reduced.pool
        conditions = [c.node for c in self.start.conditions]
        roots = [*conditions, *self.solution.residuals, *(n for _, n in self.solution.definitions)]
        if not any(pool.nodes[n][0] == "homotopy" for n in pool.reachable(roots)):
            return None
        symbols = Symbols(self)
        builder = symbols.builder(self)
        builder.homotopy = ca.SX.sym("s")
        builder.define(self.solution.definitions, self.rewritten)
        used, alg = (
            _column(builder.lower([builder.replaced(n) for n in group]))
            for group in (conditions, self.solution.residuals)
        )
        return ca.Function(
            "homotopy", [*symbols.inputs, builder.homotopy], [used, alg], [*_INPUTS, "s"], ["used", "alg"]
        )

    @cached_property
    def constraints(self) -> Any:
        """`(t, x, z, u, p, m) -> (g, dg/dx)`: stabilised constraints, all levels, and their Jacobian."""
        symbols = Symbols(self)
        builder = symbols.builder(self)
        builder.define(self.solution.definitions, self.rewritten)
        g = _column(builder.lower([builder.replaced(n) for _, n in self.solution.structure.invariants]))
        return ca.Function("constraints", symbols.inputs, [g, ca.jacobian(g, symbols.x)], _INPUTS, ["g", "J"])

    @cached_property
    def constants(self) -> Any:
        """`(p) -> c`: values of all images that depend on parameters only, in the order of `constant_nodes`."""
        p = ca.SX.sym("p", len(self.parameters))
        builder = Builder(self.solution.structure.reduced.pool, ca.SX(0), p, {})
        return ca.Function("constants", [p], [_column(builder.lower(self.constant_nodes))], ["p"], ["c"])

    @cached_property
    def constant_nodes(self) -> tuple[int, ...]:
        """Distinct images that depend on parameters only."""
        reduced = self.solution.structure.reduced
        pool = reduced.pool
        found: dict[int, None] = {}
        for node in reduced.image:
            op, *rest = pool.nodes[node]
            if op == "neg":
                op = pool.nodes[rest[0]][0]
            if op != "var" and node not in found and not pool.variables_in(node):
                found[node] = None
        return tuple(found)

    def casadi(
        self,
        outputs: Sequence[str] | None = None,
        *,
        parameters: Sequence[str] | None = None,
        minimal: bool = False,
        events: bool = False,
    ) -> CasadiModel:
        """The model as CasADi functions for optimal control, with names, units and limits of every entry.

        `outputs` names what y holds; None means what is declared in the model's own class. `parameters` names what p
        holds; None means all. `minimal` asks for as many states as degrees of freedom, `events` for what happens at
        events. See `acausal.export.functions.casadi_model` and docs/casadi.md.
        """
        made: CasadiModel = provided("casadi_model")(
            self, outputs, parameters=parameters, minimal=minimal, events=events
        )
        return made


_INPUTS = ["t", "x", "z", "u", "p", "m"]


class Symbols:
    """One set of SX symbols for the arguments (t, x, z, u, p, m)."""

    def __init__(self, compiled: CompiledModel) -> None:
        self.t = ca.SX.sym("t")
        self.x = ca.SX.sym("x", len(compiled.states))
        self.z = ca.SX.sym("z", len(compiled.algebraic))
        self.u = ca.SX.sym("u", len(compiled.inputs))
        self.p = ca.SX.sym("p", len(compiled.parameters))
        self.m = ca.SX.sym("m", compiled.n_modes)

    @property
    def inputs(self) -> list[Any]:
        """In the order of every function's arguments."""
        return [self.t, self.x, self.z, self.u, self.p, self.m]

    def builder(self, compiled: CompiledModel) -> DefiningBuilder:
        """A builder that knows states, algebraic variables, inputs and modes."""
        solution = compiled.solution
        modes = {n: self.m[k] for k, n in zip(compiled.mode_places, compiled.mode_nodes, strict=True)}
        builder = DefiningBuilder(solution.structure.reduced.pool, self.t, self.p, modes)
        first, delays = compiled.n_timely - compiled.delays.size, range(len(compiled.delays.items))
        builder.windows = [self.m[first + WIDTH * k : first + WIDTH * (k + 1)] for k in delays]
        for symbols, variables in (
            (self.x, compiled.state_variables),
            (self.z, solution.algebraic),
            (self.given(compiled), solution.structure.reduced.inputs),
        ):
            builder.know(variables, symbols)
        return builder

    def given(self, compiled: CompiledModel) -> Any:
        """Inputs as the equations see them: constants of u, and polynomials in time."""
        u, first = ca.SX(self.u), len(compiled.time_events.relations)
        for k, place in enumerate(compiled.driven):
            u[place] = polynomial(self.m[first + k * INPUT_WIDTH : first + (k + 1) * INPUT_WIDTH], self.t)
        return u


class DefiningBuilder(Builder):
    """A builder that also evaluates definitions."""

    def define(self, definitions: Sequence[tuple[int, int]], rewritten: dict[int, int]) -> None:
        """Take definitions as known; relations and kinks in time are replaced by their modes."""
        self.rewritten = rewritten
        for variable, node in definitions:
            self.definitions[variable] = self.replaced(node)

    def replaced(self, node: int) -> int:
        """The node with its kinks in time replaced by branches on modes."""
        if not self.rewritten:
            return node
        done = self._replaced
        self.pool.rewrite([node], self.pool.var, done)
        return done[node]

    @cached_property
    def _replaced(self) -> dict[int, int]:
        return dict(self.rewritten)


def _column(entries: list[Any]) -> Any:
    return ca.vertcat(*entries) if entries else ca.SX(0, 1)
