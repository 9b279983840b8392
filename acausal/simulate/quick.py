"""CasADi functions called through preallocated memory.

A call with arrays costs 20 to 30 us, most of it for wrapping matrices; through `Function.buffer()` it is 1 us. At
events that is most of the time.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]


class Quick:
    """A function of dense arguments; outputs are fresh arrays, column-major matrices as (rows, columns)."""

    def __init__(self, function: Any) -> None:
        self.function = function  # the buffer does not keep it alive
        self._buffer, self._run = function.buffer()
        self._inputs = [np.zeros(function.numel_in(k)) for k in range(function.n_in())]
        self._outputs: list[Any] = [np.zeros(function.size_out(k), order="F") for k in range(function.n_out())]
        for k in range(function.n_out()):
            if function.nnz_out(k) != function.numel_out(k):
                raise ValueError(f"{function.name()}: output {k} is not dense")
        for k, a in enumerate(self._inputs):
            self._buffer.set_arg(k, a.data)
        for k, a in enumerate(self._outputs):
            self._buffer.set_res(k, a.reshape(-1, order="F").data)

    def __call__(self, *arguments: Any) -> list[Vector]:
        for memory, value in zip(self._inputs, arguments, strict=True):
            memory[:] = value
        self._run()
        return [a[:, 0].copy() if a.shape[1] == 1 else a.copy() for a in self._outputs]
