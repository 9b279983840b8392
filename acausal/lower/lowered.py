"""Data of a compiled model: its symbolic solution, its right-hand side, and the entries of its vectors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any

import numpy as np

from acausal.analyse.blocks.solve import Solution
from acausal.analyse.delays import Delays
from acausal.analyse.events.state_events import StateEvents, discrete_variables
from acausal.analyse.events.steep import Moving, Steep, steep
from acausal.analyse.events.time_events import TimeEvents
from acausal.analyse.start import StartProblem
from acausal.arrays import Vector
from acausal.flatten.flat import FlatSystem
from acausal.flatten.reduced import nominal
from acausal.language.component import Component
from acausal.language.expressions.external import Call
from acausal.language.expressions.lookup import Lookup
from acausal.lower.chebyshev import INPUT_WIDTH
from acausal.numeric.samples import STABILISATION_RATE
from acausal.reduce.select import Selection


@dataclass(frozen=True, eq=False)
class Recipe:
    """Arguments of `compile`, kept by a model whose structure may change during a run."""

    model: Component
    parameters: Mapping[str, object]
    formulation: str = "torn"
    freeze: tuple[str, ...] = ()
    quasi_static: tuple[str, ...] = ()
    cache: bool = True


@dataclass(frozen=True, eq=False)
class Lowered:
    """The data of a `CompiledModel`, from which its functions are made.

    Sizes: `nx` states (`n_dynamic` of the coupled system, then `quadratures`, integrals of functions of time that
    nothing depends on, then `discretes`, variables that change at events only), `nz` algebraic variables, `nu` inputs,
    `np` free parameters, `nm` modes, which include the coefficients of delayed signals and of inputs over time.
    """

    name: str
    solution: Solution  # the previous, symbolic stage; `solution.structure.reduced.flat` is the flat system
    state_variables: tuple[int, ...]
    quadratures: int
    discretes: int
    start: StartProblem
    time_events: TimeEvents
    rhs: Any  # `(t, x[nx], z[nz], u[nu], p[np], m[nm]) -> (ode[nx], alg[nz])`, SX, smooth in each mode
    modes: Any  # `(t, p) -> m[nm]`, 0 or 1: relations of time; all others (`mode_nodes`) are 0
    instants: Any  # `(p) -> times[nm]` at which the modes change
    state_events: StateEvents = field(default_factory=StateEvents)
    delays: Delays = field(default_factory=Delays)
    selection: Selection | None = None  # variables left out of the model, and why; None for the full model
    # Used by `simulate` to compile again when the structure of the model changes; None if it never does.
    recipe: Recipe | None = None
    # Indices in u of the inputs that are functions of time: polynomials over each stretch of a run, whose coefficients
    # are modes. The values of u there are not used (`acausal.lower.variants.started`).
    driven: tuple[int, ...] = ()
    timings: dict[str, float] = field(default_factory=dict)  # seconds per stage of the compilation
    # Steep functions of a subsystem, for which there are no sample points of its own; None: `narrow` finds them.
    steep: Steep | None = None
    varied: bool = False  # whether `rhs` differs from `solution`: a regime (`simulate/events/regime.py`)

    def __getstate__(self) -> dict[str, Any]:
        """Pickle the fields only; cached functions are rebuilt on demand."""
        return {f.name: self.__dict__[f.name] for f in fields(self)}

    @cached_property
    def narrow(self) -> Steep:
        """Steep functions in the equations, whose values may burst between two steps of a solver."""
        if self.steep is not None:
            return self.steep
        solution = self.solution
        pool = solution.structure.reduced.pool
        roots = [*(n for v, n in solution.definitions if v in solution.needed), *solution.residuals]
        moving = Moving(pool, discrete_variables(solution.structure.reduced))
        return steep(pool, solution.structure.points, pool.reachable(roots), moving)

    @cached_property
    def operations(self) -> frozenset[str]:
        """Names of the operations that the equations may contain, "table" for a lookup, "call" for external functions.

        A run skips searches for operations that are absent here.
        """
        all_operations = {node[0] for node in self.solution.structure.reduced.pool.nodes}
        calls = {op for op in all_operations if isinstance(op, Call)}
        return frozenset(
            all_operations - calls | {"table" if isinstance(op.external, Lookup) else "call" for op in calls}
        )

    @property
    def flat(self) -> FlatSystem:
        """The flat system the model was compiled from."""
        return self.solution.structure.reduced.flat

    @property
    def requested_outputs(self) -> tuple[str, ...]:
        """The outputs for which a reduced model was compiled; empty for a full model."""
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
        """Names of the states that vary between events: all but the discrete variables, which are last in x."""
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
        """Declared nominal magnitudes of reduced variables, shape (len(variables),)."""
        return np.array([nominal(self.solution.structure.reduced, v) for v in variables], dtype=float)

    @cached_property
    def nominal_x(self) -> Vector:
        """Nominal magnitudes of the states, shape (nx,)."""
        return self.nominal(self.state_variables)

    @cached_property
    def nominal_z(self) -> Vector:
        """Nominal magnitudes of the algebraic variables, shape (nz,)."""
        return self.nominal(self.solution.algebraic)

    @cached_property
    def columns(self) -> tuple[int, ...]:
        """Nodes whose trajectories a result stores: states, algebraic variables, inputs, then observed variables."""
        reduced = self.solution.structure.reduced
        pool = reduced.pool
        order = [*self.state_variables, *self.solution.algebraic, *reduced.inputs]
        ordered = dict.fromkeys(pool.vars([*order, *(v for v, _ in self.solution.definitions)]))
        for scalar, node in enumerate(reduced.image):
            op, *rest = pool.nodes[node]
            if op == "neg":
                op = pool.nodes[rest[0]][0]
            if scalar not in reduced.left_out and op not in ("var", "const") and pool.variables_in(node):
                ordered[node] = None
        return tuple(ordered)

    @property
    def mode_nodes(self) -> tuple[int, ...]:
        """Nodes of the modes, in the order of m; the coefficients of inputs and delays have none."""
        events = self.state_events
        return (*self.time_events.relations, *events.samples, *events.memories, *events.flags, *events.relations)

    @cached_property
    def rewritten(self) -> dict[int, int]:
        """Maps nodes that jump or have a kink to branches on modes."""
        return {**self.time_events.rewritten, **self.state_events.rewritten}

    @property
    def mode_places(self) -> tuple[int, ...]:
        """Indices of `mode_nodes` in m; the coefficients of inputs and delays follow the relations of time."""
        timely, gap = len(self.time_events.relations), len(self.driven) * INPUT_WIDTH + self.delays.size
        return tuple(k if k < timely else k + gap for k in range(len(self.mode_nodes)))

    @property
    def n_timely(self) -> int:
        """Number of leading modes that are known before a stretch: relations of time, then coefficients."""
        return len(self.time_events.relations) + len(self.driven) * INPUT_WIDTH + self.delays.size

    @property
    def n_modes(self) -> int:
        """Number of modes."""
        return len(self.mode_nodes) + len(self.driven) * INPUT_WIDTH + self.delays.size

    @cached_property
    def constant_nodes(self) -> tuple[int, ...]:
        """Distinct nodes of flat scalars that depend on parameters only."""
        reduced = self.solution.structure.reduced
        pool = reduced.pool
        distinct: dict[int, None] = {}
        for node in reduced.image:
            op, *rest = pool.nodes[node]
            if op == "neg":
                op = pool.nodes[rest[0]][0]
            if op != "var" and node not in distinct and not pool.variables_in(node):
                distinct[node] = None
        return tuple(distinct)
