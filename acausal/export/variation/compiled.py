"""The same steps in compiled code, `steps.c`, for the functions of one regime."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from acausal.arrays import Vector
from acausal.export.variation.element import LEAST, Temper, Way
from acausal.export.variation.radau import lost, tolerance_of
from acausal.export.variation.slopes import Slopes
from acausal.export.variation.tables import STAGES, in_c
from acausal.simulate.native import cache as libraries
from acausal.simulate.native import source
from acausal.simulate.native.functions import made
from acausal.simulate.native.program import address

_DONE, _FULL, _STIFF, _LOST = range(4)
_HEAD = 3
# Steps whose record is one array.
_MOST = 1024


class Structure(ctypes.Structure):
    """`struct variation` of steps.c."""

    _fields_ = (
        *((name, ctypes.c_longlong) for name in ("n", "nx", "parameters", "columns", "entries", "largest")),
        *((name, ctypes.c_longlong) for name in ("stiff", "suspects", "cleared", "guessed", "capacity", "steps")),
        *((name, ctypes.c_double) for name in ("t", "end", "h", "before", "tolerance", "radau_tolerance", "least")),
        *((name, ctypes.c_void_p) for name in ("starts", "rows", "constant", "modes")),
        *((name, ctypes.c_void_p) for name in ("w", "x", "stages", "record", "total")),
    )


class Program:
    """The compiled steps of one regime."""

    def __init__(self, path: Path, slopes: Slopes) -> None:
        """Load the library; OSError or AttributeError when it is not one of ours."""
        library = ctypes.CDLL(str(path))
        self._onwards, self._back = library.acausal_vary, library.acausal_vary_back
        self.slopes = slopes

    def carry(self, way: Way, x: Vector, parameters: bool, temper: Temper) -> Iterator[tuple[float, Vector, Vector]]:
        """See `Variation.carry`; it ends early where steps are stiff and too many variables for compiled ones."""
        own = self._structure(way, temper, x.shape[1], parameters)
        own.x[:] = x
        for end in way.ends:
            if not self._to(own, end, temper):
                return
            yield end, own.w.copy(), own.x.copy()

    def back(self, way: Way, rows: Vector, temper: Temper) -> tuple[Vector, Vector] | None:
        """See `Variation.back`; None where `carry` would end early."""
        own = self._structure(way, temper, 0, True)
        records: list[tuple[Vector, int]] = []
        for end in way.ends:
            while own.fields.t < end:
                record = np.empty((_MOST, _HEAD + STAGES * self.slopes.n))
                own.fields.record, own.fields.capacity, own.fields.steps = address(record), _MOST, 0
                if not self._to(own, end, temper):
                    return None
                records.append((record, own.fields.steps))
        own.resize(len(rows))
        own.x[:] = rows.T
        for record, steps in reversed(records):
            own.fields.record, own.fields.steps = address(record), steps
            if self._back(ctypes.byref(own.fields)) != _DONE:
                raise lost(way.start)
        return own.x.T.copy(), own.total.T.copy()

    def _to(self, own: _Own, end: float, temper: Temper) -> bool:
        """On to an instant, or until the record is full; whether steps are still those of compiled code."""
        own.fields.end = end
        status = self._onwards(ctypes.byref(own.fields))
        temper.stiff = bool(own.fields.stiff)
        if status not in (_DONE, _FULL, _STIFF):
            raise lost(own.fields.t)
        return bool(status != _STIFF)

    def _structure(self, way: Way, temper: Temper, columns: int, parameters: bool) -> _Own:
        return _Own(self.slopes, way, temper, columns, parameters)


class _Own:
    """The structure of one stretch, and the arrays it points to."""

    def __init__(self, slopes: Slopes, way: Way, temper: Temper, columns: int, parameters: bool) -> None:
        self.slopes = slopes
        self.w, self.stages = way.w.copy(), np.zeros(STAGES * slopes.n)
        self.numbers = tuple(np.ascontiguousarray(v, dtype=float) for v in way.numbers)
        self.fields = Structure(
            n=slopes.n,
            nx=slopes.nx,
            parameters=slopes.count if parameters else 0,
            entries=len(slopes.rows),
            largest=slopes.n if slopes.is_small else 0,  # stiff steps have dense matrices
            stiff=int(temper.stiff or slopes.n > slopes.nx),
            t=way.start,
            tolerance=way.tolerance,
            radau_tolerance=tolerance_of(way.tolerance),
            least=LEAST * (way.ends[-1] - way.start),
            starts=address(slopes.starts),
            rows=address(slopes.rows),
            constant=address(self.numbers[0]),
            modes=address(self.numbers[1]),
            w=address(self.w),
            stages=address(self.stages),
        )
        self.resize(columns)

    def resize(self, columns: int) -> None:
        """So many columns of variations, nothing in them."""
        self.x, self.total = np.zeros((self.slopes.nx, columns)), np.zeros((self.slopes.count, columns))
        self.fields.columns, self.fields.x, self.fields.total = columns, address(self.x), address(self.total)


def program(slopes: Slopes, allowed: bool) -> Program | None:
    """The compiled steps, from disk, or made where that is allowed; None where they cannot be had."""
    if slopes.n > slopes.nx and not slopes.is_small:
        return None
    if not allowed and libraries.is_empty():
        return None
    functions: tuple[Any, Any] = slopes.value, slopes.slopes
    key = libraries.key("variation", _steps(), *(f.serialize() for f in functions))

    def text() -> str:
        return source.functions(*functions) + _steps()

    found: Program | None = made(key, text if allowed else None, lambda path: Program(path, slopes))
    return found


@cache
def _steps() -> str:
    return in_c() + Path(__file__).with_name("steps.c").read_text(encoding="utf-8")
