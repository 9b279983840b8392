"""Variations over stretches of one regime, in compiled code if available."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from acausal.arrays import Vector
from acausal.export.variation.compiled import Program, program
from acausal.export.variation.element import Back, Element, Interval, Stiffness
from acausal.export.variation.explicit import explicit
from acausal.export.variation.radau import radau
from acausal.export.variation.slopes import Slopes
from acausal.lower.compiled import CompiledModel
from acausal.simulate.native.policy import pays

# Cost of a step in Python, in evaluations of the equations.
_STEP_COST = 300.0


class Variation:
    """Linear maps of stretches of one regime, cached with the model."""

    def __init__(self, compiled: CompiledModel, chosen: list[int]) -> None:
        self.slopes = Slopes(compiled, chosen)
        self._program: Program | None = None
        self._tried: set[bool] = set()
        self._spent = 0.0

    def carry(
        self, interval: Interval, x: Vector, stiffness: Stiffness, native: bool | None, *, parameters: bool = True
    ) -> Iterator[tuple[float, Vector, Vector]]:
        """Yield (time [s], variables (n,), variations (nx, k)) at each end of the interval.

        `x`: variations at its start, shape (nx, k). Everything is scaled by nominal magnitudes. With `parameters` the
        columns are variations by the chosen parameters.
        """
        compiled = self._compiled(native)
        if compiled is not None:
            last = None
            for last in compiled.carry(interval, x, parameters, stiffness):
                yield last
            if last is not None:
                interval, x = _rest(interval, last[0], last[1]), last[2]
        ends = set(interval.ends)
        for element in self._elements(interval, stiffness, x, parameters):
            if element.t in ends:
                yield element.t, element.w, element.x

    def recorded(self, interval: Interval, x: Vector, stiffness: Stiffness, native: bool | None) -> tuple[Vector, Back]:
        """(Variations at the end, as from `carry`; function that pulls rows back from there to the start)."""
        compiled = self._compiled(native)
        found = None if compiled is None else compiled.recorded(interval, x, stiffness)
        if found is not None:
            return found
        elements = list(self._elements(interval, stiffness, x, True))

        def back(rows: Vector) -> tuple[Vector, Vector]:
            total = np.zeros((len(rows), self.slopes.count))
            for element in reversed(elements):
                rows, by_p = element.adjoint(rows)
                total = total + by_p
            return rows, total

        return elements[-1].x, back

    def is_compiled(self, native: bool | None) -> bool:
        """Whether steps are compiled."""
        return self._compiled(native) is not None

    def _elements(self, interval: Interval, stiffness: Stiffness, x: Vector, parameters: bool) -> Iterator[Element]:
        """Steps in Python."""
        slopes = self.slopes
        if interval.ends and not stiffness.stiff and slopes.n == slopes.nx:
            for element in explicit(slopes, interval, stiffness, x, parameters):
                self._spent += _STEP_COST
                interval, x = _rest(interval, element.t, element.w), element.x
                yield element
        if interval.ends:
            for step in radau(slopes, interval, x, parameters):
                self._spent += _STEP_COST
                yield step

    def _compiled(self, native: bool | None) -> Program | None:
        if native is False or self._program is not None:
            return None if native is False else self._program
        allowed = native is True or pays(self._spent, self.slopes.instructions)
        if allowed not in self._tried:
            self._tried.add(allowed)
            self._program = program(self.slopes, allowed)
        return self._program


def _rest(interval: Interval, t: float, w: Vector) -> Interval:
    """The rest of an interval from the point (t, w) on."""
    return replace(interval, start=t, ends=[end for end in interval.ends if end > t], w=w)
