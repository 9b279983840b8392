"""A function evaluated by columns (`acausal.simulate.native.columns`), as CasADi calls it."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from acausal.simulate.native import columns
from acausal.simulate.native.program import address


class InColumns(ca.Callback):
    """The same function, for one thread: its values are in one memory."""

    def __init__(self, function: Any, run: Any, program: columns.Program) -> None:
        ca.Callback.__init__(self)
        self._function, self._run, self._program = function, run, ctypes.byref(program)
        self._kept = program
        self._arguments = [np.zeros(function.nnz_in(k)) for k in range(function.n_in())]
        self._results = [np.zeros(function.nnz_out(k)) for k in range(function.n_out())]
        self._given, self._wanted = _addresses(self._arguments), _addresses(self._results)
        self.construct(function.name(), {})

    def get_n_in(self) -> int:
        return int(self._function.n_in())

    def get_n_out(self) -> int:
        return int(self._function.n_out())

    def get_sparsity_in(self, i: int) -> Any:
        return self._function.sparsity_in(i)

    def get_sparsity_out(self, i: int) -> Any:
        return self._function.sparsity_out(i)

    def get_name_in(self, i: int) -> str:
        return str(self._function.name_in(i))

    def get_name_out(self, i: int) -> str:
        return str(self._function.name_out(i))

    def has_eval_buffer(self) -> bool:
        return True

    def eval_buffer(self, arg: Sequence[Any], res: Sequence[Any]) -> int:
        """CasADi's call, on its memory."""
        for own, given in zip(self._arguments, arg, strict=True):
            if own.size:
                own[:] = 0.0 if given is None else np.frombuffer(given)
        status: int = self._run(self._program, self._given, self._wanted)
        for own, wanted in zip(self._results, res, strict=True):
            if own.size and wanted is not None:
                np.frombuffer(wanted)[:] = own
        return status


def in_columns(function: Any) -> InColumns | None:
    """The function by columns; None where that does not pay, or where there is no compiler."""
    run = columns.library()
    program = None if run is None else columns.program(function)
    return None if program is None else InColumns(function, run, program)


def _addresses(arrays: Sequence[Any]) -> Any:
    return (ctypes.c_void_p * (len(arrays) + 1))(*(address(a) if a.size else None for a in arrays))
