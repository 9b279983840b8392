"""Equations of one regime with their derivatives, for variables scaled by their nominal magnitudes."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from acausal.arrays import Vector
from acausal.lower.compiled import CompiledModel
from acausal.lower.variants.implicit import differentiable
from acausal.simulate.equations.calls.buffered import BufferedFunction

_DENSE = 30  # number of variables up to which dense matrices are faster than sparse ones


def memories(compiled: CompiledModel) -> NDArray[np.int64]:
    """Indices of the values of `pre` among the modes, shape (n_memories,)."""
    events = compiled.state_events
    first = compiled.n_timely + len(events.samples)
    return np.arange(first, first + len(events.memories))


def _fewest(value: Any, w: Any, p: Any) -> Any:
    """Derivatives of `value` by `w` and `p`: CasADi's choice of direction for each or for both, if that is shorter."""
    apart, together = ca.horzcat(ca.jacobian(value, w), ca.jacobian(value, p)), ca.jacobian(value, ca.vertcat(w, p))
    return min((apart, together), key=lambda slopes: ca.n_nodes(ca.densify(slopes.nz[:])))


class Slopes:
    """Functions `value(t, w, c, m)` and `slopes(t, w, c, m) -> (value, entries)`.

    w, shape (n,), are the scaled variables; c, shape (nu + np,), is (u, p). The value is (rates, residuals).

    The entries are the nonzeros of its derivatives by w and by the chosen parameters, an (n, n + count) matrix in
    compressed columns, with the `rows` and `columns` of the entries and the `starts` of the columns.

    Values of `pre` that the equations read depend on parameters as states do: they are treated as states with rate
    zero, after the others. `held` are their indices among the modes.
    """

    def __init__(self, compiled: CompiledModel, chosen: list[int]) -> None:
        own_memories = memories(compiled).tolist()
        read = {k for out in (0, 1) for k in compiled.rhs.jac_sparsity(out, 5).get_triplet()[1] if own_memories}
        self.held = [k for k in own_memories if k in read]
        own, nz = len(compiled.states), len(compiled.algebraic)
        nx = own + len(self.held)
        self.nx, self.n, self.count = nx, nx + nz, len(chosen)
        self.scale = np.concatenate([compiled.nominal_x, np.ones(len(self.held)), compiled.nominal_z])
        t, w, modes = ca.SX.sym("t"), ca.SX.sym("w", self.n), ca.SX.sym("m", compiled.n_modes)
        u, p = ca.SX.sym("u", len(compiled.inputs)), ca.SX.sym("p", len(compiled.parameters))
        x, past, z = ca.vertsplit(w * ca.DM(self.scale), [0, own, nx, self.n])
        m = ca.SX(modes)
        m[self.held] = past

        def equations(ode: Any, alg: Any) -> Any:
            return ca.densify(ca.vertcat(ode / ca.DM(compiled.nominal_x), ca.SX.zeros(nx - own, 1), alg))

        value, arguments = equations(*compiled.rhs(t, x, z, u, p, m)), [t, w, ca.vertcat(u, p), modes]
        ode, alg, symbols, numbers = differentiable(compiled, [t, x, z, u, p, m])
        slopes = _fewest(equations(ode, alg), w, p[chosen])
        pattern = slopes.sparsity()
        entries: Any = ca.substitute(ca.vec(ca.densify(slopes.nz[:])), symbols, numbers)
        self.value: Any = ca.Function("value", arguments, [value])
        self.slopes = ca.Function("slopes", arguments, list(ca.cse([value, entries])))
        self.starts = np.array(pattern.colind(), dtype=np.int64)
        self.rows = np.array(pattern.row(), dtype=np.int64)
        self.columns = np.repeat(np.arange(self.n + self.count), np.diff(self.starts))
        self.is_small = self.n <= _DENSE
        self._mapped: dict[int, BufferedFunction] = {}

    @cached_property
    def buffered(self) -> BufferedFunction:
        """`value`, evaluated with little overhead."""
        return BufferedFunction(self.value)

    def at(self, t: float, w: Vector, c: Vector, m: Vector) -> tuple[Vector, Vector]:
        """Value, shape (n,), and entries, shape (n_entries,), at a point; `w`, `c`, `m` as in the class."""
        value, entries = self._own(t, w, c, m)
        return value, entries

    def many(self, t: Vector, w: Vector, c: Vector, m: Vector) -> tuple[Vector, Vector]:
        """Values, shape (k, n), and entries, shape (k, n_entries), at k points; a function is cached for each k.

        `t`: shape (k,); `w`: shape (k, n); `c` and `m` are common to all points.
        """
        k = len(t)
        if k not in self._mapped:
            self._mapped[k] = BufferedFunction(self.slopes.map("stages", "serial", k, [2, 3], []))
        values, entries = self._mapped[k](t, w.ravel(), c, m)
        return values.T, entries.reshape(-1, k).T

    def dense(self, entries: Vector) -> Vector:
        """Derivatives as full matrices, shape (k, n, n + count), from entries, shape (k, n_entries)."""
        found = np.zeros((len(entries), self.n, self.n + self.count))
        found[:, self.rows, self.columns] = entries
        return found

    @cached_property
    def _own(self) -> BufferedFunction:
        return BufferedFunction(self.slopes)

    @cached_property
    def instructions(self) -> int:
        """Number of instructions of both functions."""
        own: Any = self.slopes.n_instructions() + self.value.n_instructions()
        return int(own)
