"""Variations over stretches of one regime, in compiled code where there is some."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from acausal.export.variation.compiled import Program, program
from acausal.export.variation.element import Element, Temper, Way
from acausal.export.variation.explicit import explicit
from acausal.export.variation.radau import radau
from acausal.export.variation.slopes import Slopes
from acausal.lower.compiled import CompiledModel
from acausal.simulate.native.policy import pays

Vector = NDArray[np.float64]
# A step in Python takes as long as so many evaluations of equations.
_STEP = 300.0


class Variation:
    """The linear maps of stretches of one regime; kept with the model."""

    def __init__(self, compiled: CompiledModel, chosen: list[int]) -> None:
        self.slopes = Slopes(compiled, chosen)
        self._program: Program | None = None
        self._tried: set[bool] = set()
        self._spent = 0.0

    def carry(
        self, way: Way, x: Vector, temper: Temper, native: bool | None, *, parameters: bool = True
    ) -> Iterator[tuple[float, Vector, Vector]]:
        """At each end of a way the time, the variables, and the variations of the states; `x` are those at its start.

        All are by nominal magnitudes. With `parameters` the columns are directions of the chosen parameters.
        """
        compiled = self._compiled(native)
        if compiled is not None:
            for t, w, there in compiled.carry(way, x, parameters, temper):
                way, x = _rest(way, t, w), there
                yield t, w, there
        ends = set(way.ends)
        for element in self._elements(way, temper):
            x = element.forward(x, parameters)
            if element.t in ends:
                yield element.t, element.w, x

    def back(self, way: Way, rows: Vector, temper: Temper, native: bool | None) -> tuple[Vector, Vector]:
        """Derivatives by the states at the start and by parameters, of what has `rows`, (k, nx), at the end."""
        compiled = self._compiled(native)
        found = None if compiled is None else compiled.back(way, rows, temper)
        if found is not None:
            return found
        total = np.zeros((len(rows), self.slopes.count))
        for element in reversed(list(self._elements(way, temper))):
            rows, by_p = element.adjoint(rows)
            total = total + by_p
        return rows, total

    def is_compiled(self, native: bool | None) -> bool:
        """Whether steps are those of compiled code."""
        return self._compiled(native) is not None

    def _elements(self, way: Way, temper: Temper) -> Iterator[Element]:
        """The steps in Python."""
        slopes = self.slopes
        if way.ends and not temper.stiff and slopes.n == slopes.nx:
            for element in explicit(slopes, way, temper):
                self._spent += _STEP
                way = _rest(way, element.t, element.w)
                yield element
        if way.ends:
            for step in radau(slopes, way):
                self._spent += _STEP
                yield step

    def _compiled(self, native: bool | None) -> Program | None:
        if native is False or self._program is not None:
            return None if native is False else self._program
        allowed = native is True or pays(self._spent, self.slopes.instructions)
        if allowed not in self._tried:
            self._tried.add(allowed)
            self._program = program(self.slopes, allowed)
        return self._program


def _rest(way: Way, t: float, w: Vector) -> Way:
    """What is left of a way from one of its points on."""
    return Way(t, [end for end in way.ends if end > t], w, way.numbers, way.tolerance)
