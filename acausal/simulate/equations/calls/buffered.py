"""CasADi functions called through preallocated memory.

A call with arrays costs 20 to 30 us, most of it for wrapping matrices; through `Function.buffer()` it is 1 us. At
events and around short runs that is most of the time.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from typing import Any, Literal, Protocol

import casadi as ca
import numpy as np

from acausal.arrays import Vector
from acausal.simulate.equations.calls.columns import by_columns
from acausal.simulate.equations.calls.raw import rows

# So many points are worth a function of their own, one for each power of two up to a block.
_FEW, _BLOCK = 8, 1024
# So many rows are worth one that goes by columns: 10 us an operation to make it, 3 ns saved on each in every row.
_WORTH = 3 * _BLOCK


class _Memory(threading.local):
    """Arguments and results of one function in one thread: runs of a model share its functions."""

    def __init__(self, function: Any) -> None:
        self.buffer, self.run = function.buffer()
        self.inputs = [np.zeros(function.numel_in(k)) for k in range(function.n_in())]
        self.outputs: list[Any] = [np.zeros(function.size_out(k), order="F") for k in range(function.n_out())]
        self.shown = [a[:, 0] if a.shape[1] == 1 else a for a in self.outputs]
        for k, a in enumerate(self.inputs):
            self.buffer.set_arg(k, a.data)
        for k, a in enumerate(self.outputs):
            self.buffer.set_res(k, a.reshape(-1, order="F").data)


class BufferedFunction:
    """A function of dense arguments; outputs are fresh arrays, column-major matrices as (rows, columns).

    They are nan where the function fails.
    """

    def __init__(self, function: Any) -> None:
        self.function = _dense(function)  # the buffer does not keep it alive
        self._memory = _Memory(self.function)
        self._many: dict[tuple[int, tuple[int, ...]], Any] = {}
        self._columns: dict[tuple[int, tuple[int, ...]], Any] = {}
        self._asked: dict[tuple[int, tuple[int, ...]], int] = {}

    def __call__(self, *arguments: Any) -> list[Vector]:
        memory = self._memory
        for place, value in zip(memory.inputs, arguments, strict=True):
            place[:] = value
        memory.run()
        if memory.buffer.ret():  # a singular system inside: the outputs are those of another call
            return [np.full(a.shape, np.nan) for a in memory.shown]
        return [a.copy() for a in memory.shown]

    def many(self, *arguments: Vector) -> Vector:
        """The first output at n instants, shape (n, size); arguments have shape (n, their size), or (their size,).

        It is nan where the function fails.
        """
        n = max((len(a) for a in arguments if a.ndim == 2), default=1)
        size = self.function.numel_out(0)
        if n < _FEW or not size:
            return rows(self.function, arguments)
        if n > _BLOCK:
            starts = range(0, n, _BLOCK)
            return np.vstack([self.many(*(a[k : k + _BLOCK] if a.ndim == 2 else a for a in arguments)) for k in starts])
        padded = 1 << (n - 1).bit_length()
        key = padded, tuple(k for k, a in enumerate(arguments) if a.ndim == 1)
        self._asked[key] = self._asked.get(key, 0) + padded
        if self._asked[key] > _WORTH and key not in self._columns:
            self._columns[key] = by_columns(self.function, *key)
        columns = self._columns.get(key)
        order: Literal["C", "F"] = "C" if columns is None else "F"
        buffer, run = (self._mapped(*key) if columns is None else columns).buffer()
        held = []
        for place, value in enumerate(arguments):
            if value.size:
                whole_rows = np.array(value)
                if value.ndim == 2:
                    whole_rows = np.empty((padded, value.shape[1]), order=order)
                    whole_rows[:n], whole_rows[n:] = value, value[-1]
                held.append(whole_rows.reshape(-1, order=order))
                buffer.set_arg(place, held[-1].data)
        found = np.zeros((padded, size), order=order)
        buffer.set_res(0, found.reshape(-1, order=order).data)
        run()
        # which of them has failed is not told
        return rows(self.function, arguments) if buffer.ret() else found[:n]

    def _mapped(self, padded: int, common: tuple[int, ...]) -> Any:
        """The function at so many instants, one after the other."""
        key = padded, common
        if key not in self._many:
            whole: Any = self.function.map("many", "serial", padded, list(common), [])
            self._many[key] = ca.Function("first", whole.mx_in(), whole.call(whole.mx_in())[:1])
        return self._many[key]


class Columns(Protocol):
    """What is needed of an argument, `argument[..., places]`: an array, or one that is not brought together yet."""

    def __getitem__(self, key: Any, /) -> Any: ...


class NarrowFunction:
    """Expressions of few entries of large arguments at many instants: what they do not need is not handed over."""

    def __init__(self, name: str, inputs: Sequence[Any], values: Any) -> None:
        """For `values`, a dense column, in symbols of `inputs`."""
        self._needed = [np.unique(ca.jacobian_sparsity(values, v).get_col()).astype(np.int64) for v in inputs]
        narrow = [v[needed.tolist()] for v, needed in zip(inputs, self._needed, strict=True)]
        self._buffered = BufferedFunction(ca.Function(name, narrow, [values]))

    def many(self, *arguments: Columns) -> Vector:
        """See `BufferedFunction.many`."""
        return self._buffered.many(*(a[..., needed] for a, needed in zip(arguments, self._needed, strict=True)))


def _dense(function: Any) -> Any:
    """The same function with dense outputs."""
    if all(function.nnz_out(k) == function.numel_out(k) for k in range(function.n_out())):
        return function
    inputs = [ca.MX.sym(f"a{k}", function.sparsity_in(k)) for k in range(function.n_in())]
    return ca.Function(function.name(), inputs, [ca.densify(v) for v in function.call(inputs)])
