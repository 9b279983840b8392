"""Functions that all runs of a compiled model share, built at first use and kept as long as the model."""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import cached_property
from typing import Any
from weakref import WeakKeyDictionary, ref

import casadi as ca
import numpy as np

from acausal.analyse.events.time_events import TimeTable, time_tables
from acausal.arrays import Truth, Vector
from acausal.flatten.pool import LEAVES
from acausal.lower.build import DefiningBuilder, Symbols
from acausal.lower.compiled import CompiledModel
from acausal.simulate.equations.calls.buffered import BufferedFunction, Columns, NarrowFunction
from acausal.simulate.equations.shares import Shares
from acausal.simulate.native.equations import parametric
from acausal.simulate.start.newton import Newton
from acausal.simulate.start.open_start import OpenStart

# In models with more definitions, only the rates at a start are checked for finite values.
_MOST_DEFINITIONS_CHECKED = 3000
# Most functions of single signals in the cache, and the lock for building one: a builder is not thread-safe.
_MOST_OBSERVED = 256
_SWITCHED = frozenset(("where", "sign"))
_OBSERVING_LOCK = threading.Lock()


class Observing:
    """Some trajectories at many instants; values in them that parameters alone determine are computed once."""

    def __init__(self, s: Symbols, y: Any) -> None:
        (rest,), held, constants = parametric([y], s.p, s.u)
        self._constants = BufferedFunction(constants)
        self._rows = NarrowFunction("observing", [s.t, s.x, s.z, held, s.m], ca.densify(rest))

    def many(self, t: Vector, x: Columns, z: Vector, u: Vector, p: Vector, m: Vector) -> Vector:
        """See `BufferedFunction.many`."""
        return self._rows.many(t, x, z, self._constants(p, u)[0], m)


def _buffered(function: Callable[[CompiledModel], Any]) -> cached_property[BufferedFunction]:
    """A property with a function of the model, buffered for fast calls at first use."""
    return cached_property(lambda cache: BufferedFunction(function(cache.compiled)))


class FunctionCache:
    """Functions of one model, with the arguments `(t, x, z, u, p, m)` unless stated otherwise."""

    rhs = _buffered(lambda model: model.rhs)  # `-> (ode, alg)`
    observe = _buffered(lambda model: model.observe)  # `-> every trajectory at one instant`
    reactions = _buffered(lambda model: model.events.reactions)  # see `EventFunctions.reactions`
    round = _buffered(lambda model: model.events.round)  # see `acausal.lower.events.round.Round`
    distances = _buffered(lambda model: model.events.distances)  # `-> distance`, one per relation
    # `-> distances` with the sign of their modes, positive while these hold
    watch = _buffered(lambda model: model.events.watch)
    rates = _buffered(lambda model: model.events.rates)  # see `guard_rates`
    conditions = _buffered(lambda model: model.conditions)  # `-> (used, surplus)`
    guess = _buffered(lambda model: model.guess)  # `(p) -> (x, z)` as declared
    constants = _buffered(lambda model: model.constants)  # `(p) -> c`, in the order of `constant_nodes`
    instants = _buffered(lambda model: model.instants)  # `(p) -> times of the relations of time`
    modes = _buffered(lambda model: model.modes)  # `(t, p) -> m`

    def __init__(self, compiled: CompiledModel) -> None:
        self._model = ref(compiled)  # the cache must not keep the model alive
        self._newton: dict[tuple[int, ...], Newton | None] = {}
        self._observers: dict[bool, tuple[Symbols, DefiningBuilder]] = {}
        self._observed: dict[tuple[tuple[int, ...], bool], Observing] = {}

    @property
    def compiled(self) -> CompiledModel:
        """The compiled model."""
        model = self._model()
        assert model is not None, "callers hold the model"
        return model

    def are_finite(self, t: float, x: Vector, z: Vector, u: Vector, p: Vector, m: Vector) -> bool:
        """Whether all variables have finite values at a point.

        In large models only the rates are checked: building the function of all variables costs more than the run.
        """
        if not all(np.isfinite(part).all() for part in self.rhs(t, x, z, u, p, m)):
            return False
        if len(self.compiled.solution.definitions) > _MOST_DEFINITIONS_CHECKED:
            return True
        return bool(np.isfinite(self.observe(t, x, z, u, p, m)[0]).all() and np.isfinite(self.constants(p)[0]).all())

    def observing(self, columns: tuple[int, ...], blend: bool) -> Observing:
        """Function of the trajectories with these indices in `columns` of the model; `blend` for modes between 0 and 1.

        The builder is kept, so that expressions lowered for one signal are reused for the next.
        """
        with _OBSERVING_LOCK:
            if (columns, blend) not in self._observed:
                if blend not in self._observers:
                    symbols = Symbols(self.compiled)
                    self._observers[blend] = symbols, symbols.defined(self.compiled, blend)
                symbols, builder = self._observers[blend]
                y = builder.column(builder.replaced(self.compiled.columns[k] for k in columns))
                while len(self._observed) >= _MOST_OBSERVED:
                    del self._observed[next(iter(self._observed))]
                self._observed[columns, blend] = Observing(symbols, ca.densify(y))
            return self._observed[columns, blend]

    @cached_property
    def reaches(self) -> Truth:
        """Whether each relation holds where its sides are equal, shape (relations,)."""
        nodes = self.compiled.solution.structure.reduced.pool.nodes
        return np.array([nodes[n][0] in ("le", "ge") for n in self.compiled.state_events.relations], dtype=bool)

    @cached_property
    def opening(self) -> Vector:
        """1 for each condition of a clause that contains `initial()`, otherwise 0; shape (conditions,)."""
        pool = self.compiled.solution.structure.reduced.pool
        conditions = self.compiled.state_events.conditions
        contains_initial = [any(pool.nodes[n][0] == "initial" for n in pool.reachable([c])) for c in conditions]
        return np.array(contains_initial, dtype=float)

    @cached_property
    def time_tables(self) -> tuple[TimeTable, ...]:
        """Long tables of time on which an integrated variable or an event depends."""
        solution = self.compiled.solution
        has_events = bool(self.compiled.state_events)
        definitions = [n for v, n in solution.definitions if has_events or v in solution.needed]
        pool = solution.structure.reduced.pool
        return time_tables(pool, [*definitions, *solution.residuals], dict(solution.definitions))

    def quadrature_rates(self, times: Vector, u: Vector, p: Vector, m: Vector, d: Vector) -> Vector:
        """Rates of the quadratures at n instants, shape (nq, n), divided by their nominal magnitudes.

        `m` and `d` have a row for each instant, or a single one for all.
        """
        return self._quadrature_rates.many(times[:, None], u, p, m, d).T

    @cached_property
    def _quadrature_rates(self) -> BufferedFunction:
        return BufferedFunction(self.quadrature_function)

    @cached_property
    def quadrature_function(self) -> Any:
        """`(t, u, p, m, d) -> rates` of the quadratures, divided by their nominal magnitudes."""
        compiled = self.compiled
        s = Symbols(compiled)
        n, nq, nd = compiled.n_dynamic, compiled.quadratures, compiled.discretes
        d = ca.SX.sym("d", nd)
        rates = compiled.rhs(s.t, ca.vertcat(ca.SX(n + nq, 1), d), s.z, s.u, s.p, s.m)[0][n : n + nq]
        scaled = ca.densify(rates / ca.DM(compiled.nominal_x[n : n + nq]))
        return ca.Function("quadrature_function", [s.t, s.u, s.p, s.m, d], [scaled])

    @cached_property
    def shares(self) -> Shares | None:
        """Statically undetermined loads; None if the model can have none."""
        return Shares.of(self.compiled)

    @cached_property
    def switched(self) -> tuple[int, ...]:
        """Expressions of time that switch and are differentiated, but are no derivatives themselves: nodes of the pool.

        Only the outermost ones: sign(t) jumps, but sign(t) * t does not.
        """
        pool = self.compiled.solution.structure.reduced.pool
        if not any(pool.nodes[n][0] in _SWITCHED for n in pool._slopes):
            return ()
        rates = set(pool.reachable(pool._slopes.values()))
        timely = {n for n in pool._slopes if n not in rates and pool.nodes[n][0] not in LEAVES}
        timely = {n for n in timely if not pool.variables_in(n)}
        below = {n for number in timely for n in pool.nodes[number][1:]}
        return tuple(
            sorted(n for n in timely - below if any(pool.nodes[k][0] in _SWITCHED for k in pool.reachable([n])))
        )

    @cached_property
    def switches(self) -> BufferedFunction:
        """`(t, p, m) -> values of the expressions `switched``."""
        s = Symbols(self.compiled)
        builder = s.builder(self.compiled)
        builder.define([], self.compiled.rewritten)
        column = ca.vertcat(*builder.lower(builder.replaced(self.switched)))
        return BufferedFunction(ca.Function("switched", [s.t, s.p, s.m], [ca.densify(column)]))

    @cached_property
    def open_start(self) -> OpenStart | None:
        """Start values that the start conditions leave open or overdetermine; None if there are none."""
        return OpenStart.of(self.compiled)

    def newton(self, free: tuple[int, ...] = ()) -> Newton | None:
        """Newton's method for the algebraic variables and the states `free`; None if it is not applicable."""
        if free not in self._newton:
            self._newton[free] = Newton.of(self.compiled, free)
        return self._newton[free]


_CACHES: WeakKeyDictionary[CompiledModel, FunctionCache] = WeakKeyDictionary()


def functions_of(compiled: CompiledModel) -> FunctionCache:
    """The functions cached for a model, which is identified by identity; the cache does not keep it alive."""
    compiled = compiled.common
    functions = _CACHES.get(compiled)
    if functions is None:
        functions = _CACHES[compiled] = FunctionCache(compiled)
    return functions


def truths(compiled: CompiledModel, t: float, x: Vector, z: Vector, u: Vector, p: Vector, m: Vector) -> Vector:
    """The truth of each relation, 0 or 1, with algebraic variables `z` and modes `m` of the other relations."""
    (distance,) = functions_of(compiled).distances(t, x, z, u, p, m)
    reaches = functions_of(compiled).reaches
    return np.asarray((distance > 0) | ((distance == 0) & reaches), dtype=float)
