"""CasADi functions called through preallocated memory.

A call with arrays takes 20 to 30 us, most of it for wrapping matrices; through `Function.buffer()` it takes 1 us. At
events and in short runs such calls dominate.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from typing import Any, Literal, Protocol

import casadi as ca
import numpy as np

from acausal.arrays import Vector
from acausal.simulate.equations.calls.columns import by_columns

# From this many points on a function is built that evaluates them all, for each power of two up to a block.
_FEWEST_POINTS, _BLOCK = 8, 1024
# From this many rows on the function is built by columns: that takes 10 us per operation, and saves 3 ns on each in
# every row.
_FEWEST_ROWS = 3 * _BLOCK
# Largest memory for the arguments of one block that is kept, in numbers.
_LARGEST_KEPT = 100_000


class _Memory(threading.local):
    """Arguments and results of one function in one thread, as concurrent runs of a model share its functions."""

    def __init__(self, function: Any) -> None:
        self.buffer, self.run = function.buffer()
        self.inputs = [np.zeros(function.numel_in(k)) for k in range(function.n_in())]
        # copying an empty argument takes time too, and most models have no inputs
        self.filled = [(k, a) for k, a in enumerate(self.inputs) if a.size]
        self.outputs: list[Any] = [np.zeros(function.size_out(k), order="F") for k in range(function.n_out())]
        self.shown = [a[:, 0] if a.shape[1] == 1 else a for a in self.outputs]
        self.blocks: dict[tuple[int, tuple[int, ...]], _Block] = {}
        for k, a in enumerate(self.inputs):
            self.buffer.set_arg(k, a.data)
        for k, a in enumerate(self.outputs):
            self.buffer.set_res(k, a.reshape(-1, order="F").data)


class _Block:
    """Memory for the arguments of a function at a fixed number of instants, in one thread."""

    def __init__(self, function: Any, key: tuple[int, tuple[int, ...]], is_by_columns: bool) -> None:
        padded, common = key
        self.function, self.is_by_columns = function, is_by_columns  # the buffer does not keep it alive
        self._padded = padded
        self._order: Literal["C", "F"] = "F" if is_by_columns else "C"
        self._buffer, self._run = function.buffer()
        self._inputs: list[Any] = []
        for k in range(function.n_in()):
            count = function.numel_in(k)
            memory = np.zeros(count if k in common else (padded, count // padded), order=self._order)
            if count:
                self._buffer.set_arg(k, memory.reshape(-1, order=self._order).data)
            self._inputs.append(memory)

    def __call__(self, n: int, size: int, arguments: Sequence[Vector]) -> Vector | None:
        """The first output at n instants, shape (n, size); None if the function fails."""
        for memory, value in zip(self._inputs, arguments, strict=True):
            if value.ndim == 2:
                memory[:n], memory[n:] = value, value[-1]
            elif memory.size:
                memory[:] = value
        values = np.zeros((self._padded, size), order=self._order)
        self._buffer.set_res(0, values.reshape(-1, order=self._order).data)
        self._run()
        return None if self._buffer.ret() else values[:n]


class BufferedFunction:
    """A function of dense arguments, called through buffers.

    Outputs are new arrays, matrices of shape (rows, columns) in column-major order. They are nan if the function fails.
    """

    def __init__(self, function: Any) -> None:
        self.function = _dense(function)  # the buffer does not keep it alive
        self._memory = _Memory(self.function)
        self._map_functions: dict[tuple[int, tuple[int, ...]], Any] = {}
        self._column_functions: dict[tuple[int, tuple[int, ...]], Any] = {}
        self._evaluated: dict[tuple[int, tuple[int, ...]], int] = {}

    def __call__(self, *arguments: Any) -> list[Vector]:
        memory = self._memory
        if len(arguments) != len(memory.inputs):
            raise TypeError(f"{self.function.name()} has {len(memory.inputs)} arguments, not {len(arguments)}")
        for k, place in memory.filled:
            place[:] = arguments[k]
        memory.run()
        if memory.buffer.ret():  # such as a singular system inside: the outputs are those of an earlier call
            return [np.full(a.shape, np.nan) for a in memory.shown]
        return [a.copy() for a in memory.shown]

    def many(self, *arguments: Vector) -> Vector:
        """The first output at n instants, shape (n, size); each argument has shape (n, size), or (size,) if common.

        It is nan at instants where the function fails.
        """
        n = max((len(a) for a in arguments if a.ndim == 2), default=1)
        size = self.function.numel_out(0)
        if n < _FEWEST_POINTS or not size:
            return self.few(n, size, arguments)
        if n > _BLOCK:
            starts = range(0, n, _BLOCK)
            return np.vstack([self.many(*(a[k : k + _BLOCK] if a.ndim == 2 else a for a in arguments)) for k in starts])
        padded = 1 << (n - 1).bit_length()
        key = padded, tuple(k for k, a in enumerate(arguments) if a.ndim == 1)
        self._evaluated[key] = self._evaluated.get(key, 0) + padded
        if self._evaluated[key] > _FEWEST_ROWS and key not in self._column_functions:
            self._column_functions[key] = by_columns(self.function, *key)
        values = self._block(key)(n, size, arguments)
        # a failed block does not say which of the instants failed
        return self.few(n, size, arguments) if values is None else values

    def few(self, n: int, size: int, arguments: Sequence[Vector]) -> Vector:
        """The first output at n instants, computed one by one."""
        memory, outputs = self._memory, np.zeros((n, size))
        if not size:
            return outputs
        varying = [(buffer, value) for buffer, value in zip(memory.inputs, arguments, strict=True) if value.ndim == 2]
        for buffer, value in zip(memory.inputs, arguments, strict=True):
            if value.ndim == 1:
                buffer[:] = value
        output = memory.outputs[0].reshape(-1, order="F")
        for k in range(n):
            for buffer, value in varying:
                buffer[:] = value[k]
            memory.run()
            outputs[k] = np.nan if memory.buffer.ret() else output
        return outputs

    def _block(self, key: tuple[int, tuple[int, ...]]) -> _Block:
        """The function for a block of instants with memory of this thread, which is kept if it is small."""
        columns = self._column_functions.get(key)
        block = self._memory.blocks.get(key)
        if block is None or block.is_by_columns != (columns is not None):
            block = _Block(self._mapped(*key) if columns is None else columns, key, columns is not None)
            if key[0] * sum(a.size for a in self._memory.inputs) <= _LARGEST_KEPT:
                self._memory.blocks[key] = block
        return block

    def _mapped(self, padded: int, common: tuple[int, ...]) -> Any:
        """The function mapped to a block of instants, with its first output only."""
        key = padded, common
        if key not in self._map_functions:
            mapped: Any = self.function.map("many", "serial", padded, list(common), [])
            self._map_functions[key] = ca.Function("first", mapped.mx_in(), mapped.call(mapped.mx_in())[:1])
        return self._map_functions[key]


class Columns(Protocol):
    """An argument of which only `argument[..., indices]` is used: an array, or columns that are not joined yet."""

    def __getitem__(self, key: Any, /) -> Any: ...


class NarrowFunction:
    """Expressions at many instants that depend on few entries of large arguments; only these entries are copied."""

    def __init__(self, name: str, inputs: Sequence[Any], values: Any) -> None:
        """Build for `values`, a dense column in the symbols `inputs`."""
        self._needed = [np.unique(ca.jacobian_sparsity(values, v).get_col()).astype(np.int64) for v in inputs]
        narrow = [v[needed.tolist()] for v, needed in zip(inputs, self._needed, strict=True)]
        self._buffered = BufferedFunction(ca.Function(name, narrow, [values]))

    def many(self, *arguments: Columns) -> Vector:
        """See `BufferedFunction.many`."""
        return self._buffered.many(*(a[..., needed] for a, needed in zip(arguments, self._needed, strict=True)))


def rows(function: Any, arguments: Sequence[Vector]) -> Vector:
    """`BufferedFunction.many` for a function that is called only once."""
    once, n = BufferedFunction(function), max((len(a) for a in arguments if a.ndim == 2), default=1)
    return once.few(n, once.function.numel_out(0), arguments)


def _dense(function: Any) -> Any:
    """The function with dense outputs."""
    if all(function.nnz_out(k) == function.numel_out(k) for k in range(function.n_out())):
        return function
    inputs = [ca.MX.sym(f"a{k}", function.sparsity_in(k)) for k in range(function.n_in())]
    return ca.Function(function.name(), inputs, [ca.densify(v) for v in function.call(inputs)])
