"""Compiled steps (`steps.c`) with the functions of one regime, called through ctypes."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from acausal.arrays import Vector
from acausal.export.variation.control import STREAK
from acausal.export.variation.element import LEAST, Back, Interval, Stiffness
from acausal.export.variation.radau import step_too_small, tolerance_of
from acausal.export.variation.slopes import Slopes
from acausal.export.variation.tables import STAGES, in_c
from acausal.numeric.external import is_self_contained
from acausal.simulate.native import cache as libraries
from acausal.simulate.native import source
from acausal.simulate.native.cache import made
from acausal.simulate.native.program import address

_DONE, _FULL, _STIFF, _LOST = range(4)
_HEAD = 3
_FILES = "shared", "radau", "explicit", "steps"
# Number of steps recorded in one array.
_RECORDED = 1024


class Structure(ctypes.Structure):
    """`struct variation` of shared.c."""

    _fields_ = (
        *((name, ctypes.c_longlong) for name in ("n", "nx", "parameters", "columns", "entries", "largest")),
        *((name, ctypes.c_longlong) for name in ("stiff", "suspects", "cleared", "guessed", "capacity", "steps")),
        *((name, ctypes.c_longlong) for name in ("refused", "due", "noted", "streak", "patience")),
        *((name, ctypes.c_double) for name in ("t", "end", "h", "before", "tolerance", "radau_tolerance", "least")),
        *(
            (name, ctypes.c_double)
            for name in ("shortest", "loose", "start", "noise", "probed", "probed_ratio", "steady")
        ),
        *((name, ctypes.c_void_p) for name in ("starts", "rows", "constant", "modes")),
        *((name, ctypes.c_void_p) for name in ("w", "x", "stages", "record", "total", "peak", "scale")),
    )


class Program:
    """The compiled steps of one regime."""

    def __init__(self, path: Path, slopes: Slopes) -> None:
        """Load the library; OSError or AttributeError if it is not such a program."""
        library = ctypes.CDLL(str(path))
        self._forward, self._back = library.acausal_vary, library.acausal_vary_back
        self.slopes = slopes

    def carry(
        self, interval: Interval, x: Vector, parameters: bool, stiffness: Stiffness
    ) -> Iterator[tuple[float, Vector, Vector]]:
        """As `Variation.carry`, with the same shapes; ends early if the model is stiff and has too many variables."""
        arguments = self._structure(interval, stiffness, x.shape[1], parameters)
        arguments.begin(x)
        for end in interval.ends:
            if not self._step_to(arguments, end, stiffness):
                return
            yield end, arguments.w.copy(), arguments.x.copy()

    def recorded(self, interval: Interval, x: Vector, stiffness: Stiffness) -> tuple[Vector, Back] | None:
        """As `Variation.recorded`, with the same shapes; None where `carry` would end early."""
        arguments = self._structure(interval, stiffness, x.shape[1], True)
        arguments.begin(x)
        records: list[tuple[Vector, int]] = []
        for end in interval.ends:
            while arguments.fields.t < end:
                record = np.empty((_RECORDED, _HEAD + STAGES * self.slopes.n))
                fields = arguments.fields
                fields.record, fields.capacity, fields.steps = address(record), _RECORDED, 0
                if not self._step_to(arguments, end, stiffness):
                    return None
                records.append((record[: arguments.fields.steps].copy(), arguments.fields.steps))

        def back(rows: Vector) -> tuple[Vector, Vector]:
            arguments.resize(len(rows))
            arguments.x[:] = rows.T
            for record, steps in reversed(records):
                arguments.fields.record, arguments.fields.steps = address(record), steps
                if self._back(ctypes.byref(arguments.fields)) != _DONE:
                    raise step_too_small(interval.start)
            return arguments.x.T.copy(), arguments.total.T.copy()

        return arguments.x.copy(), back

    def _step_to(self, arguments: _Arguments, end: float, stiffness: Stiffness) -> bool:
        """Step to an instant, or until the record is full; False if compiled code cannot continue."""
        arguments.fields.end = end
        status = self._forward(ctypes.byref(arguments.fields))
        stiffness.stiff = bool(arguments.fields.stiff)
        arguments.report()
        if status not in (_DONE, _FULL, _STIFF):
            raise step_too_small(arguments.fields.t)
        return bool(status != _STIFF)

    def _structure(self, interval: Interval, stiffness: Stiffness, columns: int, parameters: bool) -> _Arguments:
        return _Arguments(self.slopes, interval, stiffness, columns, parameters)


class _Arguments:
    """The C structure of one stretch, and the arrays that it points to."""

    def __init__(
        self, slopes: Slopes, interval: Interval, stiffness: Stiffness, columns: int, parameters: bool
    ) -> None:
        self.slopes, self.accuracy = slopes, interval.accuracy
        self.w, self.stages = interval.w.copy(), np.zeros(STAGES * slopes.n)
        self.numbers = tuple(np.ascontiguousarray(v, dtype=float) for v in interval.numbers)
        self.fields = Structure(
            n=slopes.n,
            nx=slopes.nx,
            parameters=slopes.count if parameters else 0,
            entries=len(slopes.rows),
            largest=slopes.n if slopes.is_small else 0,  # stiff steps have dense matrices
            stiff=int(stiffness.stiff or slopes.n > slopes.nx),
            t=interval.start,
            due=2,
            patience=STREAK,
            start=interval.start,
            tolerance=interval.tolerance,
            radau_tolerance=tolerance_of(interval.tolerance),
            least=LEAST * (interval.ends[-1] - interval.start),
            starts=address(slopes.starts),
            rows=address(slopes.rows),
            constant=address(self.numbers[0]),
            modes=address(self.numbers[1]),
            w=address(self.w),
            stages=address(self.stages),
        )
        self.resize(columns)

    def begin(self, x: Vector) -> None:
        """Set the variations at the start, shape (nx, k)."""
        self.x[:] = x
        self.peak = np.abs(self.x)
        self.fields.peak = address(self.peak)
        if self.accuracy is not None:
            self.scale = np.zeros(self.x.shape)
            self.scale[:, : self.slopes.count] = self.accuracy.scale
            self.fields.scale, self.fields.shortest = address(self.scale), self.accuracy.shortest
            self.fields.loose = self.accuracy.loose

    def report(self) -> None:
        """Report the largest values, and whether errors have been noted, to `accuracy`."""
        if self.accuracy is not None:
            self.accuracy.noted |= bool(self.fields.noted)
            self.accuracy.largest = np.maximum(self.accuracy.largest, self.peak[:, : self.slopes.count])

    def resize(self, columns: int) -> None:
        """Allocate this number of columns of variations, filled with zeros."""
        self.x, self.total = np.zeros((self.slopes.nx, columns)), np.zeros((self.slopes.count, columns))
        self.fields.columns, self.fields.x, self.fields.total = columns, address(self.x), address(self.total)


def program(slopes: Slopes, allowed: bool) -> Program | None:
    """The compiled steps from the cache, or compiled now if `allowed`; None if neither is possible."""
    if slopes.n > slopes.nx and not slopes.is_small:
        return None
    if not allowed and libraries.is_empty():
        return None
    functions: tuple[Any, Any] = slopes.value, slopes.slopes
    if not is_self_contained(slopes.value):
        return None
    key = libraries.key("variation", _steps(), *(f.serialize() for f in functions))

    def text() -> str:
        return source.functions(*functions) + _steps()

    found: Program | None = made(key, text if allowed else None, lambda path: Program(path, slopes))
    return found


@cache
def _steps() -> str:
    here = Path(__file__)
    return in_c() + "".join(here.with_name(f"{name}.c").read_text(encoding="utf-8") for name in _FILES)
