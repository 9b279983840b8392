"""Callbacks with which CasADi evaluates rates and their Jacobian by columns (`acausal.simulate.native.columns`)."""

from __future__ import annotations

import ctypes
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from acausal.simulate.native.columns import tangents, translation
from acausal.simulate.native.program import address

# The Jacobian is computed by columns if it takes this many derivatives per instruction of the rates.
_WORK_RATIO = 5


class BufferCallback(ca.Callback):
    """A callback with the arguments of `function`, for one thread, as all calls use the same memory.

    `results` are the sparsities of its outputs by name.
    """

    def __init__(self, name: str, function: Any, results: Mapping[str, Any]) -> None:
        ca.Callback.__init__(self)
        self._function, self._names, self._sparsities = function, list(results), list(results.values())
        self._arguments = [np.zeros(function.nnz_in(k)) for k in range(function.n_in())]
        self._results = [np.zeros(sparsity.nnz()) for sparsity in self._sparsities]
        self._given, self._wanted = _addresses(self._arguments), _addresses(self._results)
        self.construct(name, {})

    def get_n_in(self) -> int:
        return int(self._function.n_in())

    def get_n_out(self) -> int:
        return len(self._names)

    def get_sparsity_in(self, i: int) -> Any:
        return self._function.sparsity_in(i)

    def get_sparsity_out(self, i: int) -> Any:
        return self._sparsities[i]

    def get_name_in(self, i: int) -> str:
        return str(self._function.name_in(i))

    def get_name_out(self, i: int) -> str:
        return self._names[i]

    def has_eval_buffer(self) -> bool:
        return True

    def eval_buffer(self, arg: Sequence[Any], res: Sequence[Any]) -> int:
        """Evaluate on CasADi's memory."""
        for memory, given in zip(self._arguments, arg, strict=True):
            if memory.size:
                memory[:] = 0.0 if given is None else np.frombuffer(given)
        status = self._run()
        for memory, wanted in zip(self._results, res, strict=True):
            if memory.size and wanted is not None:
                np.frombuffer(wanted)[:] = memory
        return status

    @abstractmethod
    def _run(self) -> int:
        """Evaluate `_arguments` into `_results`; returns 0, or another status for a failure."""


class InColumns(BufferCallback):
    """A function that is evaluated by columns."""

    def __init__(self, function: Any, library: Any, program: translation.Program) -> None:
        super().__init__(function.name(), function, outputs(function))
        self._call, self._program, self._alive = library.acausal_columns, ctypes.byref(program), program

    def _run(self) -> int:
        status: int = self._call(self._program, self._given, self._wanted)
        return status


class JacobianInColumns(BufferCallback):
    """`jacF` of an integrator of an ODE: the Jacobian of the rates, and empty blocks for algebraic variables."""

    def __init__(self, function: Any, library: Any, found: tangents.Jacobian, program: translation.Program) -> None:
        n = function.numel_in("x")
        shapes = {"jac_alg_x": (0, n), "jac_ode_z": (n, 0), "jac_alg_z": (0, 0)}
        blocks = {"jac_ode_x": found.sparsity, **{name: ca.Sparsity(*shape) for name, shape in shapes.items()}}
        super().__init__("jacF", function, blocks)
        self._library, self._alive = library, found
        self._program, self._tangents = ctypes.byref(program), ctypes.byref(found.tangents)
        self._none = (ctypes.c_void_p * function.n_out())()

    def _run(self) -> int:
        status: int = self._library.acausal_columns(self._program, self._given, self._none)
        self._library.acausal_tangents(self._tangents, ctypes.c_void_p(self._wanted[0]))
        return status


def outputs(function: Any) -> dict[str, Any]:
    """Sparsity of each output of a function, by name."""
    return {function.name_out(k): function.sparsity_out(k) for k in range(function.n_out())}


@dataclass(frozen=True, eq=False)
class Derived:
    """The functions that an integrator derives from its equations, by columns; None for CasADi's own Jacobian."""

    rates: InColumns
    jacobian: JacobianInColumns | None


def in_columns(function: Any) -> InColumns | None:
    """The function by columns; None if that does not pay off, or without a compiler."""
    library = translation.library()
    program = None if library is None else translation.program(function)
    return None if program is None else InColumns(function, library, program)


def derived(rates: Any) -> Derived | None:
    """The rates `(t, x, z, p, u) -> (ode, alg)` of an ODE and their Jacobian by columns; None as for `in_columns`."""
    library = translation.library()
    program = None if library is None else translation.program(rates)
    if program is None:
        return None
    jacobian_program = tangents.jacobian(program, rates.index_in("x"), rates.numel_out("ode"), rates.numel_in("x"))
    pays = jacobian_program.work >= _WORK_RATIO * len(program.read.codes)
    jacobian = JacobianInColumns(rates, library, jacobian_program, program) if pays else None
    return Derived(InColumns(rates, library, program), jacobian)


def _addresses(arrays: Sequence[Any]) -> Any:
    return (ctypes.c_void_p * (len(arrays) + 1))(*(address(a) if a.size else None for a in arrays))
