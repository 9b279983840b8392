"""Rates and their Jacobian by columns (`acausal.simulate.native.columns`, `tangents`), as CasADi calls them."""

from __future__ import annotations

import ctypes
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from acausal.simulate.native import columns, tangents
from acausal.simulate.native.program import address

# Derivatives that are computed for one instruction of the rates, from which on a Jacobian is most of the work.
_SHARE = 5


class OnMemory(ca.Callback):
    """A function of the arguments of another one, for one thread: its values are in one memory.

    `results` has the sparsity of each output by name.
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
        """CasADi's call, on its memory."""
        for own, given in zip(self._arguments, arg, strict=True):
            if own.size:
                own[:] = 0.0 if given is None else np.frombuffer(given)
        status = self._run()
        for own, wanted in zip(self._results, res, strict=True):
            if own.size and wanted is not None:
                np.frombuffer(wanted)[:] = own
        return status

    @abstractmethod
    def _run(self) -> int:
        """Evaluate what is in `_arguments` into `_results`; 0, or what CasADi takes for a failure."""


class InColumns(OnMemory):
    """The same function."""

    def __init__(self, function: Any, library: Any, program: columns.Program) -> None:
        super().__init__(function.name(), function, outputs(function))
        self._call, self._program, self._kept = library.acausal_columns, ctypes.byref(program), program

    def _run(self) -> int:
        status: int = self._call(self._program, self._given, self._wanted)
        return status


class JacobianInColumns(OnMemory):
    """`jacF` of an integrator of an ODE: derivatives of its rates by the states, and blocks without entries."""

    def __init__(self, function: Any, library: Any, found: tangents.Jacobian, program: columns.Program) -> None:
        n = function.numel_in("x")
        shapes = {"jac_alg_x": (0, n), "jac_ode_z": (n, 0), "jac_alg_z": (0, 0)}
        blocks = {"jac_ode_x": found.sparsity, **{name: ca.Sparsity(*shape) for name, shape in shapes.items()}}
        super().__init__("jacF", function, blocks)
        self._library, self._kept = library, found
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
    """What an integrator derives from its equations, by columns; without a Jacobian where CasADi's is as good."""

    rates: InColumns
    jacobian: JacobianInColumns | None


def in_columns(function: Any) -> InColumns | None:
    """The function by columns; None where that does not pay, or where there is no compiler."""
    library = columns.library()
    program = None if library is None else columns.program(function)
    return None if program is None else InColumns(function, library, program)


def derived(rates: Any) -> Derived | None:
    """The rates `(t, x, z, p, u) -> (ode, alg)` of an ODE, and their Jacobian; None as for `in_columns`."""
    library = columns.library()
    program = None if library is None else columns.program(rates)
    if program is None:
        return None
    found = tangents.jacobian(program, rates.index_in("x"), rates.numel_out("ode"), rates.numel_in("x"))
    pays = found.work >= _SHARE * len(program.read.codes)
    jacobian = JacobianInColumns(rates, library, found, program) if pays else None
    return Derived(InColumns(rates, library, program), jacobian)


def _addresses(arrays: Sequence[Any]) -> Any:
    return (ctypes.c_void_p * (len(arrays) + 1))(*(address(a) if a.size else None for a in arrays))
