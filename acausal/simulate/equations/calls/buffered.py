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

# So many points are worth a function of their own, one for each power of two up to a block.
_FEW, _BLOCK = 8, 1024
# So many rows are worth one that goes by columns: 10 us an operation to make it, 3 ns saved on each in every row.
_WORTH = 3 * _BLOCK
# Numbers that are kept as memory for the arguments of one block.
_SMALL = 100_000


class _Memory(threading.local):
    """Arguments and results of one function in one thread: runs of a model share its functions."""

    def __init__(self, function: Any) -> None:
        self.buffer, self.run = function.buffer()
        self.inputs = [np.zeros(function.numel_in(k)) for k in range(function.n_in())]
        # to copy nothing takes as long as to copy something, and most models have no inputs
        self.filled = [(k, a) for k, a in enumerate(self.inputs) if a.size]
        self.outputs: list[Any] = [np.zeros(function.size_out(k), order="F") for k in range(function.n_out())]
        self.shown = [a[:, 0] if a.shape[1] == 1 else a for a in self.outputs]
        self.blocks: dict[tuple[int, tuple[int, ...]], _Block] = {}
        for k, a in enumerate(self.inputs):
            self.buffer.set_arg(k, a.data)
        for k, a in enumerate(self.outputs):
            self.buffer.set_res(k, a.reshape(-1, order="F").data)


class _Block:
    """Arguments of a function at so many instants, in one thread."""

    def __init__(self, function: Any, key: tuple[int, tuple[int, ...]], is_by_columns: bool) -> None:
        padded, common = key
        self.function, self.is_by_columns = function, is_by_columns  # the buffer does not keep it alive
        self._padded = padded
        self._order: Literal["C", "F"] = "F" if is_by_columns else "C"
        self._buffer, self._run = function.buffer()
        self._inputs: list[Any] = []
        for k in range(function.n_in()):
            count = function.numel_in(k)
            place = np.zeros(count if k in common else (padded, count // padded), order=self._order)
            if count:
                self._buffer.set_arg(k, place.reshape(-1, order=self._order).data)
            self._inputs.append(place)

    def __call__(self, n: int, size: int, arguments: Sequence[Vector]) -> Vector | None:
        """The first output of this size at n instants; None where the function fails."""
        for place, value in zip(self._inputs, arguments, strict=True):
            if value.ndim == 2:
                place[:n], place[n:] = value, value[-1]
            elif place.size:
                place[:] = value
        found = np.zeros((self._padded, size), order=self._order)
        self._buffer.set_res(0, found.reshape(-1, order=self._order).data)
        self._run()
        return None if self._buffer.ret() else found[:n]


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
        if len(arguments) != len(memory.inputs):
            raise TypeError(f"{self.function.name()} has {len(memory.inputs)} arguments, not {len(arguments)}")
        for k, place in memory.filled:
            place[:] = arguments[k]
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
            return self.few(n, size, arguments)
        if n > _BLOCK:
            starts = range(0, n, _BLOCK)
            return np.vstack([self.many(*(a[k : k + _BLOCK] if a.ndim == 2 else a for a in arguments)) for k in starts])
        padded = 1 << (n - 1).bit_length()
        key = padded, tuple(k for k, a in enumerate(arguments) if a.ndim == 1)
        self._asked[key] = self._asked.get(key, 0) + padded
        if self._asked[key] > _WORTH and key not in self._columns:
            self._columns[key] = by_columns(self.function, *key)
        found = self._block(key)(n, size, arguments)
        # which of them has failed is not told
        return self.few(n, size, arguments) if found is None else found

    def few(self, n: int, size: int, arguments: Sequence[Vector]) -> Vector:
        """The first output at n instants, one after the other."""
        memory, found = self._memory, np.zeros((n, size))
        if not size:
            return found
        varying = [(place, value) for place, value in zip(memory.inputs, arguments, strict=True) if value.ndim == 2]
        for place, value in zip(memory.inputs, arguments, strict=True):
            if value.ndim == 1:
                place[:] = value
        here = memory.outputs[0].reshape(-1, order="F")
        for k in range(n):
            for place, value in varying:
                place[:] = value[k]
            memory.run()
            found[k] = np.nan if memory.buffer.ret() else here
        return found

    def _block(self, key: tuple[int, tuple[int, ...]]) -> _Block:
        """The function at so many instants with memory of this thread, which is kept where that is little."""
        columns = self._columns.get(key)
        found = self._memory.blocks.get(key)
        if found is None or found.is_by_columns != (columns is not None):
            found = _Block(self._mapped(*key) if columns is None else columns, key, columns is not None)
            if key[0] * sum(a.size for a in self._memory.inputs) <= _SMALL:
                self._memory.blocks[key] = found
        return found

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


def rows(function: Any, arguments: Sequence[Vector]) -> Vector:
    """The first output of a function that is called this once, as of `BufferedFunction.many`."""
    once, n = BufferedFunction(function), max((len(a) for a in arguments if a.ndim == 2), default=1)
    return once.few(n, once.function.numel_out(0), arguments)


def _dense(function: Any) -> Any:
    """The same function with dense outputs."""
    if all(function.nnz_out(k) == function.numel_out(k) for k in range(function.n_out())):
        return function
    inputs = [ca.MX.sym(f"a{k}", function.sparsity_in(k)) for k in range(function.n_in())]
    return ca.Function(function.name(), inputs, [ca.densify(v) for v in function.call(inputs)])
