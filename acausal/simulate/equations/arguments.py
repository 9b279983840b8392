"""Arguments of steep functions in the equations of a model, as one function of its variables."""

from __future__ import annotations

from dataclasses import dataclass
from weakref import WeakKeyDictionary

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from acausal.analyse.events.steep import STEPS
from acausal.arrays import Vector
from acausal.lower.compiled import CompiledModel
from acausal.lower.symbols import Symbols
from acausal.simulate.equations.calls.quick import Narrow

# Functions that change by less than this factor, or of which less than this share of a step changes, are not steep.
_MILD, _ROUNDING = 2.0, 1e-16


@dataclass(frozen=True, eq=False)
class Arguments:
    """Arguments of k steep functions, their kinds (`acausal.analyse.events.steep`), and then their middles.

    `owners` are the arguments that these columns belong to, first each to itself.
    """

    function: Narrow
    kinds: tuple[str | float, ...]
    owners: NDArray[np.int64]

    def at(self, times: Vector, x: Vector, z: Vector, u: Vector, p: Vector, m: Vector) -> Vector:
        """All of them at n instants; states and algebraic variables have shapes (nx, n) and (nz, n)."""
        return self.function.many(times[:, None], x.T, z.T, u, p, m)

    def are_steep(self, values: Vector) -> NDArray[np.bool_]:
        """Whether these columns belong to functions that are steep where their arguments go; shape of the columns.

        Arguments may go as far beyond their values at the n instants as they go from any of them to the next.
        """
        own = values[:, : len(self.kinds)]
        beyond = np.abs(np.diff(own, axis=0)).max(axis=0, initial=0.0)
        ends = np.stack([own.min(axis=0) - beyond, own.max(axis=0) + beyond])
        heights = self.heights(ends)
        is_step = np.array([kind in STEPS for kind in self.kinds])
        heights = np.where(is_step, np.maximum(heights, _ROUNDING), heights)
        change = heights.max(axis=0) / _MILD > heights.min(axis=0)
        is_power = np.array([not isinstance(kind, str) for kind in self.kinds])
        through = is_power & (ends[0] <= 0.0) & (ends[1] >= 0.0)
        return np.asarray((change.any(axis=0) | through)[self.owners])

    def heights(self, values: Vector) -> Vector:
        """What the functions are above both of their ends at such values; shape (n, 2, k)."""
        found = np.zeros((len(values), 2, len(self.kinds)))
        for j, kind in enumerate(self.kinds):
            own = values[:, j]
            with np.errstate(all="ignore"):
                if kind == "tanh":
                    found[:, :, j] = np.stack([1.0 / (1.0 + np.exp(-2.0 * s * own)) for s in (1.0, -1.0)], axis=1)
                elif kind == "atan":
                    found[:, :, j] = np.stack([0.5 + np.arctan(s * own) / np.pi for s in (1.0, -1.0)], axis=1)
                elif kind == "exp":
                    found[:, 0, j] = np.exp(own)
                else:
                    found[:, 0, j] = np.abs(own) ** float(kind)
        return np.nan_to_num(found)


_MADE: WeakKeyDictionary[CompiledModel, Arguments | None] = WeakKeyDictionary()


def arguments(compiled: CompiledModel) -> Arguments | None:
    """Those of a model; None where no rate depends on such a function."""
    compiled = compiled.common
    if compiled not in _MADE:
        _MADE[compiled] = _made(compiled)
    return _MADE[compiled]


def _made(compiled: CompiledModel) -> Arguments | None:
    found = compiled.narrow
    if not found.arguments:
        return None
    symbols = Symbols(compiled)
    builder = symbols.defined(compiled)
    nodes = *found.arguments, *(w for w, _ in found.middles)
    column = builder.column([builder.replaced(n) for n in nodes])
    owners = [*range(len(found.arguments)), *(place for _, place in found.middles)]
    return Arguments(Narrow("arguments", symbols.inputs, ca.densify(column)), found.kinds, np.array(owners))
