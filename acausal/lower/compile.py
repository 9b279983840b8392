"""Compilation of a component to a `CompiledModel`: the pipeline as an explicit list of stages.

If the structure of a model may change during a run, the equations with every possible structure are compiled only when
they are first used: a scene of 64 balls has 2080 pairs, of which a run needs and compiles 64 at a time
(`acausal.simulate.restructure`).
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import casadi as ca

from acausal.analyse.aliases import reduce
from acausal.analyse.analyse import analyse
from acausal.analyse.blocks.solve import Solution, solve
from acausal.analyse.delays import find_delays, refuse_delays
from acausal.analyse.events.located_kinks import LocatedKinks
from acausal.analyse.events.state_events import discrete_variables, find_state_events
from acausal.analyse.events.steep import Moving, steep
from acausal.analyse.events.time_events import TimeEvents, find_time_events
from acausal.analyse.hidden import HiddenCombination, HiddenConstraint
from acausal.analyse.invariants import use_invariants
from acausal.analyse.start import Dependence, start_problem
from acausal.collector import collector_paused
from acausal.errors import InternalError, StructureError, UsageError, listed_names
from acausal.flatten.flat import FlatSystem
from acausal.flatten.flatten import flatten
from acausal.flatten.instances.instances import changing
from acausal.flatten.parameters import given_values
from acausal.language.choices import Choice
from acausal.language.component import Component
from acausal.lower.build import Builder, Symbols
from acausal.lower.cache.cache import recall, remember, signature
from acausal.lower.compiled import CompiledModel, _column
from acausal.lower.events.functions import just_after
from acausal.lower.events.impulses import impulses_of
from acausal.lower.lowered import Recipe
from acausal.numeric.samples import Visited
from acausal.reduce.confine import confined
from acausal.reduce.freeze import freeze as fold_parameters
from acausal.reduce.select import Dropped, select

_MOST_ROUNDS = 20
_NO_KINKS = LocatedKinks()


def compile(
    model: Component,
    *,
    parameters: Mapping[str, object] | None = None,
    formulation: str = "torn",
    cache: bool = True,
    outputs: Sequence[str] | None = None,
    freeze: Sequence[str] = (),
    quasi_static: Sequence[str] = (),
    choices: Mapping[str, Choice] | None = None,
) -> CompiledModel:
    """Compile a component: its equations, reduced, ordered and lowered to CasADi functions.

    Parameters
    ----------
    model
        The outermost component.
    parameters
        Values by path in SI; here they may also replace parameters that the model binds to others.
    formulation
        "torn" (default) or "dae": see `acausal.analyse.blocks.solve.solve`. "projected" is torn without a choice of
        states: every constraint of higher index keeps all its variables as states and is stabilised, and recorded
        points are projected onto it; the other formulations do so only where no choice of states is safe.
    cache
        Reuse a model that was compiled earlier with the same structure, even with other values of parameters; `timings`
        then has an entry "recall". A reduced model is reused only for the same outputs and values.
    outputs
        Names of variables; the model is then the smallest one that computes these. Besides them only parameters and
        intermediate variables can be read. `acausal.reduce` reports the parts that were left out.
    freeze
        Parameters, components or patterns whose values become constants, "zeros" for all that are zero. Such a model is
        faster, but these values cannot be changed without compiling it again.
    quasi_static
        States, or components with all their states, replaced by their quasi-static limit, so that stiff modes lose
        their dynamics. Unlike all other options this is an approximation, whose error `acausal.reduce` estimates and
        measures.
    choices
        Structure of each component that can have several, by path, as in `acausal.flatten`. Without it the model has
        all contacts that are possible at any time. Its equations are compiled when they are first used; `simulate` does
        not need them, as it switches between structures during the run.

    Raises
    ------
    UsageError
        AC024 for an unknown formulation, AC010, AC018, AC020 or AC026 for wrong names in `outputs`,
        `freeze` and `quasi_static`.
    AcausalError
        The first error of the model, with its place in the source.
    """
    if formulation not in ("torn", "dae", "projected"):
        raise UsageError("AC024", f"there is no formulation '{formulation}'", help="formulations: torn, dae, projected")
    frozen, quasi = listed_names("freeze", freeze), listed_names("quasi_static", quasi_static)
    recipe = Recipe(model, given_values(parameters), formulation, frozen, quasi, cache)
    parts = changing(model) if choices is None and outputs is None else {}
    if not parts:
        return _compile(recipe, outputs, choices)
    # Compile the structure with which a run begins: this raises the errors of the model, and the run finds it cached.
    _compile(recipe, None, {path: part.least(False) for path, part in parts.items()})
    return DeferredModel.of(recipe, lambda: _compile(recipe, None, None))


def _compile(recipe: Recipe, outputs: Sequence[str] | None, choices: Mapping[str, Choice] | None) -> CompiledModel:
    """The compiled model, from the cache if possible."""
    model, parameters, formulation = recipe.model, recipe.parameters, recipe.formulation
    freeze, quasi_static = recipe.freeze, recipe.quasi_static
    clock = _Clock()

    def flattened(chosen: Mapping[str, Choice] | None) -> FlatSystem:
        flat = flatten(model, parameters, chosen)
        return fold_parameters(flat, freeze) if freeze else flat

    def needed(poses: Sequence[str], chosen: Mapping[str, Choice]) -> Solution:
        return select(solved(flattened(chosen), formulation), poses, (), formulation)[0]

    with collector_paused():
        confined_parts: tuple[Dropped, ...] = ()
        if outputs is not None and choices is None:
            choices, confined_parts = confined(model, needed)
            clock.lap("confine")
        flat = flattened(choices)
        clock.lap("flatten")
        is_reduced_model = outputs is not None or bool(freeze) or bool(quasi_static)
        if is_reduced_model:
            refuse_delays(flat, "a reduced model", "compile it whole: without outputs, freeze and quasi_static")
        requested = None if outputs is None else listed_names("outputs", outputs)
        reduction_options = (requested, freeze, quasi_static) if is_reduced_model else None
        key = signature(flat, formulation, reduction_options) if recipe.cache else None
        cached = recall(key, flat) if key is not None else None
        if cached is not None:
            clock.lap("recall")
            cached.timings.update(clock.laps)
            return cached
        solution = solved(flat, formulation, clock=clock)
        selection = None
        if is_reduced_model:
            solution, selection = select(solution, requested, quasi_static, formulation)
            selection = replace(selection, dropped=(*confined_parts, *selection.dropped))
            clock.lap("select")
        compiled = replace(lower(solution), selection=selection)
        clock.lap("lower")
    compiled.timings.update(clock.laps)
    if key is not None:
        remember(key, compiled)
    return compiled


def refined(compiled: CompiledModel, visited: Visited) -> CompiledModel:
    """The model compiled again with points of a run among the sample points, for use after a pivot vanished there.

    Only for models without `outputs`, `freeze` and `quasi_static`.
    """
    return lower(solved(compiled.flat, compiled.solution.formulation, visited=visited))


def solved(
    flat: FlatSystem,
    formulation: str = "torn",
    hidden: dict[int, int] | None = None,
    clock: _Clock | None = None,
    visited: Visited | None = None,
) -> Solution:
    """Reduce, analyse and solve; repeated until these passes discover no more hidden constraints.

    `hidden` receives the hidden constraints: the flat equation that each replaces, and its residual, a node of the flat
    pool.
    """
    hidden = {} if hidden is None else hidden
    clock = _Clock() if clock is None else clock
    first_error: StructureError | None = None
    for _ in range(_MOST_ROUNDS):
        try:
            reduced = use_invariants(reduce(flat, hidden))
            clock.lap("reduce")
            structure = analyse(reduced, formulation == "projected", visited)
            clock.lap("analyse")
            solution = solve(structure, formulation)
            clock.lap("solve")
            return solution
        except HiddenConstraint as found:
            first_error = first_error or found
            hidden |= found.equations
        except HiddenCombination as found:
            first_error = first_error or found
            # The rewritten equations already contain the constraints found so far.
            combined = found.combined()
            hidden = {k: combined.image[node] for k, node in hidden.items() if k not in combined.rewritten}
            flat = combined.flat
        except StructureError as error:
            raise first_error or error from None  # the first error is closer to the source
    raise first_error or InternalError("AC906", f"{flat.name}: there is no end to its hidden constraints")


def lower(solution: Solution, driven: tuple[int, ...] = (), kinks_to_locate: LocatedKinks = _NO_KINKS) -> CompiledModel:
    """Lower a solution to CasADi functions; observed variables are lowered on first use.

    `driven` are the indices in u of inputs that are functions of time; relations of `kinks_to_locate` become modes in
    addition to those of the equations.
    """
    reduced = solution.structure.reduced
    delays = find_delays(solution)
    roots = [n for _, n in solution.definitions] + list(solution.residuals) + delays.roots
    events = find_time_events(reduced.pool, roots)
    states, quadratures, discretes = _states_in_order(solution)
    shell = CompiledModel(
        reduced.flat.name, solution, states, quadratures, discretes, start_problem(solution), events, None, None, None
    )
    shell = replace(
        shell, state_events=find_state_events(solution, states, events, kinks_to_locate), delays=delays, driven=driven
    )
    compiled = with_functions(shell)
    if compiled.state_events.clauses:
        impulses_of(compiled, Symbols(compiled))  # raises AC210 now instead of at the first event
    return compiled


def with_functions(shell: CompiledModel) -> CompiledModel:
    """Complete a model with its right-hand side, its modes of time, and the instants at which these change."""
    solution = shell.solution
    symbols = Symbols(shell)
    builder = symbols.builder(shell)
    builder.define([d for d in solution.definitions if d[0] in solution.needed], shell.rewritten)
    ode = builder.column(solution.structure.rates(shell.state_variables))
    alg = builder.lower(builder.replaced(solution.residuals))
    names = ["t", "x", "z", "u", "p", "m"]
    rhs = ca.Function("rhs", symbols.inputs, [ode, _column(alg)], names, ["ode", "alg"])
    modes, instants = _event_functions(shell, shell.time_events)
    return replace(shell, rhs=rhs, modes=modes, instants=instants)


def _states_in_order(solution: Solution) -> tuple[tuple[int, ...], int, int]:
    """States of the coupled system, then quadratures, then discrete variables; and the numbers of the latter two.

    Quadratures are integrals of functions of time that nothing depends on. Discrete variables change at events only and
    are constants for a solver, because a boolean that has been integrated is no longer exactly 0 or 1.

    Integrals of other states are not treated as quadratures, because these are integrated with the order that suits the
    states (IDAS took 1e5 steps of order 1 for the angle of an evenly accelerated shaft, and 30 with the angle as a
    state). Neither are integrals of steep functions, because bursts of these between two instants are searched for in
    the solution of the states.
    """
    dependence = Dependence(solution)
    reduced = solution.structure.reduced
    integrated = [n for v, n in solution.definitions if v in solution.needed]
    used = dependence.pool.variables_in(*integrated, *solution.residuals)
    used |= dependence.pool.variables_behind(reduced.event_nodes, dict(solution.definitions))
    used |= {solution.structure.derivative(x) for x in solution.structure.states}
    discrete = discrete_variables(reduced)

    def is_quadrature(x: int) -> bool:
        rate = dependence.pool.var(solution.structure.derivative(x))
        if x in used or dependence.of(rate) - set(dependence.inputs):
            return False
        nodes = dependence.nodes_behind(rate)
        return not steep(dependence.pool, solution.structure.points, nodes, Moving(dependence.pool, discrete)).arguments

    states = tuple(x for x in solution.structure.states if x not in discrete)
    discretes = tuple(x for x in solution.structure.states if x in discrete)
    quadratures = [x for x in states if is_quadrature(x)]
    if len(quadratures) == len(states):
        quadratures = []
    return (*(x for x in states if x not in quadratures), *quadratures, *discretes), len(quadratures), len(discretes)


def _event_functions(shell: CompiledModel, events: TimeEvents) -> tuple[Any, Any]:
    """The functions `modes` and `instants` of a model."""
    t, p = ca.SX.sym("t"), ca.SX.sym("p", len(shell.parameters))
    builder = Builder(shell.solution.structure.reduced.pool, t, p, {})
    other_modes = ca.SX(shell.n_modes - len(events.relations), 1)
    m = ca.vertcat(just_after(builder, events), other_modes) if events.relations else other_modes
    modes = ca.Function("modes", [t, p], [ca.densify(m)], ["t", "p"], ["m"])
    instants = ca.Function("instants", [p], [_column(builder.lower(events.instants))], ["p"], ["t"])
    return modes, instants


class _Clock:
    """Processing time of each stage [s]."""

    def __init__(self) -> None:
        self.laps: dict[str, float] = {}
        self._last = time.perf_counter()

    def lap(self, name: str) -> None:
        now = time.perf_counter()
        self.laps[name] = self.laps.get(name, 0.0) + now - self._last
        self._last = now


# Attributes that a deferred model has before its equations are compiled.
_AVAILABLE_BEFORE = frozenset(("recipe", "is_made", "__class__", "__dict__", "__hash__", "__weakref__"))
_MAKE, _LOCK = "_make", "_lock"


class DeferredModel(CompiledModel):
    """A compiled model that is compiled at the first access to any attribute except its recipe."""

    @classmethod
    def of(cls, recipe: Recipe, make: Callable[[], CompiledModel]) -> CompiledModel:
        """A model with this recipe, whose other attributes `make` computes on first access."""
        model = cls.__new__(cls)
        model.__dict__.update({"recipe": recipe, _MAKE: make, _LOCK: threading.Lock()})
        return model

    @property
    def is_made(self) -> bool:
        """Whether the equations have been compiled."""
        return _MAKE not in self.__dict__

    def __getattribute__(self, name: str) -> Any:
        if name not in _AVAILABLE_BEFORE:
            attributes = object.__getattribute__(self, "__dict__")
            if _MAKE in attributes:
                _fill(attributes)
        return object.__getattribute__(self, name)


def _fill(attributes: dict[str, Any]) -> None:
    """Replace the function `make` by the attributes of the model that it returns."""
    with attributes[_LOCK]:
        make = attributes.get(_MAKE)
        if make is None:  # another thread was faster
            return
        model = make()
        attributes.update({name: value for name, value in model.__dict__.items() if name != "recipe"})
        del attributes[_MAKE]
