"""Calls of whole integrators in compiled C, with output times, tolerances and parameters as arguments.

The library is called directly, as a CasADi external function would have a fixed number of output times.
"""

from __future__ import annotations

import ctypes
import threading
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from acausal.arrays import Vector
from acausal.simulate.interrupt import Interrupted
from acausal.simulate.native.source import ENTRY

INTERRUPTED = 100
"""Status of a program that was ended by Ctrl-C."""
# Messages for CasADi's casadi_ivp_flag_t, with the keywords of SUNDIALS that `failure.integration_error` recognises.
_FAILURES = {
    1: "TOO_MUCH_WORK: more steps than allowed within an output interval",
    2: "ERR_FAIL: the step became too small",
    3: "the algebraic variables could not be made consistent",
    4: "the equations could not be evaluated: not finite",
}


class RunStructure(ctypes.Structure):
    """`struct acausal_run` of source.py."""

    _fields_ = (
        ("grid", ctypes.c_void_p),
        ("n", ctypes.c_longlong),
        ("reltol", ctypes.c_double),
        ("abstol", ctypes.c_double),
        ("step", ctypes.c_double),
        ("first", ctypes.c_double),
        ("past", ctypes.c_double),
        *((name, ctypes.c_longlong) for name in ("steps", "rejected", "rhs", "jac", "reached", "second")),
        *((name, ctypes.c_void_p) for name in ("enter", "signals", "clear", "leave", "last")),
        ("last_time", ctypes.c_double),
        *((name, ctypes.c_double) for name in ("last_end", "stop")),
        *((name, ctypes.c_void_p) for name in ("sample", "sampler", "sampled", "owners")),
        *((name, ctypes.c_longlong) for name in ("columns", "functions", "doubts")),
        ("held", ctypes.c_void_p),
        ("is_blind", ctypes.c_longlong),
        *((name, ctypes.c_void_p) for name in ("distances", "noises")),
        ("longest", ctypes.c_double),
        ("rates", ctypes.c_void_p),
        ("looked", ctypes.c_double),
        *((name, ctypes.c_longlong) for name in ("slopes", "is_dip", "away", "most")),
    )


class Program:
    """A compiled integrator for any number of output times; it is thread-safe."""

    def __init__(self, path: Path, nx: int, nz: int) -> None:
        """Load the library; raises OSError or AttributeError if it is no such program."""
        self.nx, self.nz = nx, nz
        library = ctypes.CDLL(str(path))
        self.call = getattr(library, ENTRY)
        self.sizes = _sizes(library, ENTRY)

    def __call__(
        self,
        x0: Vector,
        z0: Vector,
        p: Vector,
        grid: Vector,
        reltol: float,
        abstol: float,
        step: float,
        first: float = 0.0,
        *,
        partial: bool = False,
        most: int = 0,
    ) -> tuple[Vector, Vector, dict[str, Any]]:
        """Return states, shape (n, nx), and algebraic variables, shape (n, nz), on the grid from 0, and statistics.

        `first` is the length of the first step, 0 to have it estimated, and `most` the largest number of steps from row
        to row, 0 for that of the library. With `partial`, an integration that fails returns the rows before that, and
        the statistics have an entry "stopped" with the message.

        Raises RuntimeError: the integration cannot continue; the message says why.
        Raises Interrupted: on Ctrl-C, with the rows computed so far.
        """
        x, z = np.empty((len(grid), self.nx)), np.empty((len(grid), self.nz))
        run = _prepared(grid, reltol, abstol, step, first)
        run.most = most
        run_address = ctypes.addressof(run)
        inputs = [np.ascontiguousarray(v, dtype=float) for v in (x0, z0, p)]
        arg = _pointers(self.sizes[0], [*(address(v) for v in inputs), run_address])
        res = _pointers(self.sizes[1], [address(x), address(z)])
        iw, w = np.empty(self.sizes[2] + 1, dtype=np.int64), np.empty(self.sizes[3] + 1)
        status = self.call(arg, res, ctypes.c_void_p(address(iw)), ctypes.c_void_p(address(w)), 0)
        if status == INTERRUPTED:
            raise Interrupted(x[: run.reached], z[: run.reached])
        stats = {"n_steps": run.steps, "n_rhs": run.rhs, "n_jac": run.jac, "n_reject": run.rejected}
        stopped = {} if not status else {"stopped": _FAILURES.get(status, f"status {status}")}
        if stopped and not (partial and run.reached):
            raise RuntimeError(stopped["stopped"])
        return x[: run.reached], z[: run.reached], {name: float(n) for name, n in stats.items()} | stopped


class HeunProgram:
    """Heun's method with fixed steps, compiled."""

    def __init__(self, path: Path, nx: int) -> None:
        """Load the library; raises OSError or AttributeError if it is no such program."""
        self.nx = nx
        library = ctypes.CDLL(str(path))
        self.call = library.acausal_heun
        self.sizes = _sizes(library, "heun")

    def __call__(self, x0: Vector, p: Vector, spans: Vector, step: float) -> tuple[Vector, int]:
        """Return states after each of the `spans`, shape (nx, n), with steps of at most `step`, and the step count."""
        x = np.empty((len(spans), self.nx))
        run = _prepared(spans, 0.0, 0.0, step)
        start, parameters = (np.ascontiguousarray(v, dtype=float) for v in (x0, p))
        arg, res = _pointers(self.sizes[0], []), _pointers(self.sizes[1], [])
        iw, w = np.empty(self.sizes[2] + 1, dtype=np.int64), np.empty(self.sizes[3] + 2 * self.nx + 1)
        pointer = ctypes.c_void_p
        status = self.call(
            pointer(address(start)),
            pointer(address(parameters)),
            pointer(address(x)),
            ctypes.c_longlong(self.nx),
            arg,
            res,
            pointer(address(iw)),
            pointer(address(w)),
            ctypes.byref(run),
        )
        if status == INTERRUPTED:
            raise Interrupted(x[: run.reached])
        _check(status)
        return x.T, int(run.steps)


def _prepared(grid: Vector, reltol: float, abstol: float, step: float, first: float = 0.0) -> Any:
    grid = np.ascontiguousarray(grid, dtype=float)
    run = RunStructure(grid=address(grid), n=len(grid), reltol=reltol, abstol=abstol, step=step, first=first)
    run.kept = grid  # keeps the array alive
    prepare(run)
    return run


def prepare(run: RunStructure) -> None:
    """Let a program check for Ctrl-C."""
    # Python runs its signal handlers in the main thread only
    if threading.current_thread() is threading.main_thread():
        for field, function in _signals().items():
            setattr(run, field, function)


@cache
def _signals() -> dict[str, int | None]:
    """Addresses of the functions that a program calls to check for Ctrl-C."""
    api = ctypes.pythonapi
    functions = {
        "enter": api.PyGILState_Ensure,
        "signals": api.PyErr_CheckSignals,
        "clear": api.PyErr_Clear,
        "leave": api.PyGILState_Release,
    }
    return {field: ctypes.cast(function, ctypes.c_void_p).value for field, function in functions.items()}


def _check(status: int) -> None:
    if status:
        raise RuntimeError(_FAILURES.get(status, f"status {status}"))


def _sizes(library: Any, name: str) -> tuple[int, int, int, int]:
    """Lengths of the work arrays arg, res, iw, w."""
    sizes = [ctypes.c_longlong() for _ in range(4)]
    getattr(library, f"{name}_work")(*(ctypes.byref(size) for size in sizes))
    return sizes[0].value, sizes[1].value, sizes[2].value, sizes[3].value


def _pointers(count: int, addresses: list[int]) -> Any:
    array = (ctypes.c_void_p * (count + 1))()
    for k, address in enumerate(addresses):
        array[k] = address
    return array


_NOTHING = ctypes.create_string_buffer(8)
"""What the address of an empty array points to."""


def address(array: NDArray[Any]) -> int:
    """Address of the data of an array; by its buffer, which takes a quarter of the time of `array.ctypes.data`."""
    if not array.size:
        return ctypes.addressof(_NOTHING)
    buffer: Any = array  # as arrays are, which NumPy's types do not say
    if array.flags.carray:
        return ctypes.addressof(ctypes.c_char.from_buffer(buffer))
    return int(array.__array_interface__["data"][0])


@dataclass(frozen=True, eq=False)
class Placed:
    """Arrays that compiled code reads or writes, with their addresses, which are determined once."""

    arrays: Mapping[str, NDArray[Any]]

    @cached_property
    def at(self) -> dict[str, int]:
        """Addresses by name."""
        return {name: address(array) for name, array in self.arrays.items()}
