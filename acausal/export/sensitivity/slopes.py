"""First derivatives of functions of a model at a point of a run, with algebraic variables eliminated."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar
from weakref import WeakKeyDictionary

import casadi as ca
import numpy as np

from acausal.arrays import Vector
from acausal.export.variation.slopes import memories
from acausal.lower.build import Symbols
from acausal.lower.compiled import CompiledModel
from acausal.simulate.equations.calls.buffered import BufferedFunction
from acausal.simulate.equations.function_cache import functions_of
from acausal.simulate.events.regime import Regime

# Functions by model (compared by identity), kept as long as the model is in use elsewhere.
_CACHE: WeakKeyDictionary[CompiledModel, dict[Any, Any]] = WeakKeyDictionary()
T = TypeVar("T")


class Matrices:
    """A function with matrix outputs, evaluated with little overhead."""

    def __init__(self, function: Any) -> None:
        self._buffered = BufferedFunction(function)
        self._shapes = [function.size_out(k) for k in range(function.n_out())]

    def __call__(self, *arguments: Any) -> list[Vector]:
        """The outputs as arrays of their shapes."""
        return [v.reshape(shape) for v, shape in zip(self._buffered(*arguments), self._shapes, strict=True)]


class Slopes:
    """Derivatives by the `size` carried variables (states, then values of `pre`), chosen parameters, and time."""

    def __init__(self, compiled: CompiledModel, p: Vector, u: Vector, chosen: list[int]) -> None:
        self.compiled, self.p, self.u, self.chosen = compiled, p, u, chosen
        self.nx, self.count = len(compiled.states), len(chosen)
        self.memories = memories(compiled)
        self.size = self.nx + len(self.memories)

    def kept(self, key: Any, make: Callable[[], T]) -> T:
        """The result of `make` for this key, from the cache of the model."""
        cache = _CACHE.setdefault(self.compiled, {})
        if key not in cache:
            cache[key] = make()
        found: T = cache[key]
        return found

    def total(
        self, regime: Regime, key: tuple[Any, ...], function: Any, t: float, moment: Any
    ) -> tuple[Vector, Vector, Vector]:
        """Total derivatives of a function by carried variables (k, size), chosen p (k, count), and t (k,).

        `key` identifies the function among those of a regime.
        """
        regime_key = *key, regime.holds, regime.border, tuple(self.chosen)
        slopes = self.kept(regime_key, lambda: self._slopes(regime, function))
        *partial, by_z, implied_x, implied_p, implied_t, implied_past, implied_z = slopes(
            t, moment.x, moment.z, self.u, self.p, moment.m
        )
        if len(regime.compiled.algebraic):
            inner = by_z @ np.linalg.pinv(implied_z)
            implied = implied_x, implied_p, implied_t, implied_past
            partial = [a - inner @ b for a, b in zip(partial, implied, strict=True)]
        return np.hstack([partial[0], partial[3]]), partial[1], partial[2].ravel()

    def variations_of(
        self, regime: Regime, key: tuple[Any, ...], function: Any, t: float, moment: Any, x: Vector, past: Vector
    ) -> Vector:
        """Variations of a function, shape (k, size + count + 1), from those of the states and of values of `pre`."""
        by_x, by_p, by_t = self.total(regime, key, function, t, moment)
        found = by_x @ np.vstack([x, past])
        found[:, self.size : -1] += by_p
        found[:, -1] += by_t
        return np.asarray(found, dtype=np.float64)

    def _slopes(self, regime: Regime, function: Any) -> Matrices:
        """Partial derivatives of a function and of the algebraic equations by x, the chosen p, t, `pre` and z."""
        s, c = Symbols(self.compiled), regime.compiled
        pieces = []
        for value in (function(*s.inputs), c.rhs(*s.inputs)[1]):
            pieces += [ca.jacobian(value, v) for v in (s.x, s.p[self.chosen], s.t)]
            pieces += [ca.jacobian(value, s.m)[:, self.memories.tolist()], ca.jacobian(value, s.z)]
        return Matrices(ca.Function("slopes", s.inputs, [ca.densify(piece) for piece in pieces]))

    def rate(self, regime: Regime, t: float, moment: Any) -> Vector:
        """The rates of the states at a point, shape (nx,)."""
        return functions_of(regime.compiled).rhs(t, moment.x, moment.z, self.u, self.p, moment.m)[0]
