"""Detection of rates that jump without an event, inside `no_event`, where derivatives would be wrong.

A solver integrates `no_event(sign(x))` with short steps at the jump, whose instant moves with the parameters. The
contribution of this motion to a derivative would be missing. A function that is continuous there, such as `x*sign(x)`,
causes no error. If such a relation changes between two rows of a run, the instant is located and its two sides are
compared.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from acausal.analyse.events.state_events import discrete_variables
from acausal.analyse.events.steep import Moving
from acausal.arrays import Vector
from acausal.errors import ExportError
from acausal.export.sensitivity.chain import Chain
from acausal.flatten.pool import RELATIONS
from acausal.lower.build import Symbols
from acausal.lower.compiled import CompiledModel
from acausal.simulate.equations.calls.buffered import NarrowFunction
from acausal.simulate.events.guards import Moment

_STEPS = frozenset(("sign", "floor", "ceil"))
_HALVINGS = 40  # to a thousandth of the distances below
# Sides are compared at two distances from the instant, in row intervals. A jump does not shrink with the distance (by
# more than the given ratio), and is larger than rounding errors (relative to the rates).
_FAR, _CLOSE, _SHRINKS, _ROUNDING = 1e-6, 1e-9, 0.5, 1e-7
# A jump is ignored if it changes states by less than this fraction until the next row.
_NOTHING = 1e-14
_WIDTH = 60


@dataclass(frozen=True, eq=False)
class _Sides:
    """Functions inside `no_event` that may jump: differences of both sides of relations, and arguments of `steps`.

    `steps` marks the arguments of floor and ceil.
    """

    function: NarrowFunction
    steps: NDArray[np.bool_]
    texts: tuple[str, ...]

    def levels(self, values: Vector) -> Vector:
        """Piecewise constant levels that change only at possible jumps; shape (n, k) as `values`."""
        return np.where(self.steps, np.floor(values) + np.ceil(values), np.sign(values))


def refuse_jumps(chain: Chain) -> None:
    """Raise ExportError AC615 where a rate of the run jumps without an event."""
    sides = chain.slopes.kept("jumps", lambda: _build(chain.compiled))
    if sides is None:
        return
    times, x, z, m = chain.hybrid.recorder.rows()
    levels = sides.levels(sides.function.many(times[:, None], x.T, z.T, chain.u, chain.p, m.T))
    changed = (levels[1:] != levels[:-1]) & (np.diff(times) > 0.0)[:, None]
    found = np.argwhere(changed)
    if not len(found):
        return
    rows, places = found.T
    crossings = _Crossings(chain, times, x, z, rows)
    for i, s in enumerate(crossings.located(sides, places).tolist()):
        if crossings.jumps(i, s):
            raise ExportError(
                "AC615",
                f"sensitivities do not take {chain.compiled.name}: at t = {crossings.instant(i, s):.9g} s a rate jumps "
                "without an event",
                evidence=[f"inside no_event: {sides.texts[places[i]]}"],
                cause="the instant of the jump moves with the parameters, and nothing locates it",
                help="state it without no_event",
            )


class _Crossings:
    """The run between n pairs of rows, by cubics; positions `s` in an interval go from 0 to 1."""

    def __init__(self, chain: Chain, times: Vector, x: Vector, z: Vector, rows: NDArray[np.int64]) -> None:
        """From times (k,), states (nx, k) and algebraic variables (nz, k) of a run, at `rows`, (n,), and the next."""
        self._chain, self._start, self._gap = chain, times[rows], times[rows + 1] - times[rows]
        starts = np.array([passage.time for passage in chain.passages])
        stretches = [chain.stretch(k) for k in range(len(starts))]
        self._of = [stretches[k] for k in (np.searchsorted(starts, self._start, side="right") - 1).tolist()]
        self._x, self._z = np.stack([x[:, rows].T, x[:, rows + 1].T]), z[:, rows].T
        self._rates = np.stack(
            [
                [
                    gap * chain.slopes.rate(own.regime, t, Moment(there, beside, own.m, own.regime))
                    for own, t, gap, there, beside in zip(self._of, ends, self._gap, states, self._z, strict=True)
                ]
                for ends, states in zip((self._start, times[rows + 1]), self._x, strict=True)
            ]
        )

    def instant(self, i: int, s: float) -> float:
        """Time [s] of a position in interval i."""
        return float(self._start[i] + s * self._gap[i])

    def located(self, sides: _Sides, places: NDArray[np.int64]) -> Vector:
        """Positions, shape (n,), at which the levels first change: in interval i, the level with index `places[i]`.

        All intervals are bisected together.
        """
        n = len(places)
        u, p, m = self._chain.u, self._chain.p, np.array([own.m for own in self._of])

        def level(s: Vector) -> Vector:
            x = self._states(s)
            z = self._z if not self._z.size else np.array([self._at(i, v).z for i, v in enumerate(s.tolist())])
            values = sides.function.many((self._start + s * self._gap)[:, None], x, z, u, p, m)
            return np.asarray(sides.levels(values)[np.arange(n), places])

        low, high, before = np.zeros(n), np.ones(n), level(np.zeros(n))
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            is_before = level(middle) == before
            low, high = np.where(is_before, middle, low), np.where(is_before, high, middle)
        return low

    def jumps(self, i: int, s: float) -> bool:
        """Whether rates jump at a position in interval i."""
        gap = self._gap[i]
        states = np.maximum(np.abs(self._x[:, i]).max(axis=0), self._chain.compiled.nominal_x)
        close, size = self._difference(i, s, _CLOSE)
        found = (close > _ROUNDING * size) & (gap * close > _NOTHING * states)
        return bool(found.any() and (found & (close > _SHRINKS * self._difference(i, s, _FAR)[0])).any())

    def _difference(self, i: int, s: float, distance: float) -> tuple[Vector, Vector]:
        """Difference of the rates at both sides of a position in interval i, and their size, shapes (nx,)."""
        # do not limit positions to the interval: at a touch on a row, both distances would end on the row, and a steep
        # force would look like a jump
        left, right = (
            self._chain.slopes.rate(self._of[i].regime, self.instant(i, position), self._at(i, position))
            for position in (s - distance, s + distance)
        )
        return np.abs(right - left), np.abs(left) + np.abs(right)

    def _states(self, s: Vector | float, of: int | slice = slice(None)) -> Vector:
        """States at one position in each interval, shapes (n,) and (n, nx), or in one of them, (nx,)."""
        at, (low, high), rates = np.asarray(s)[..., None], self._x[:, of], self._rates[:, of]
        rise = high - low
        bend = (1.0 - at) * (rates[0] - rise) - at * (rates[1] - rise)
        return np.asarray(low + at * rise + at * (1.0 - at) * bend)

    def _at(self, i: int, s: float) -> Moment:
        """The run at a position in interval i, with consistent algebraic variables."""
        stretch = self._of[i]
        here = Moment(self._states(s, i), self._z[i], stretch.m, stretch.regime)
        return self._chain.hybrid.iteration.consistent(self.instant(i, s), here)


def _build(compiled: CompiledModel) -> _Sides | None:
    """The functions that may jump and on which rates depend; None if there are none."""
    solution = compiled.solution
    reduced = solution.structure.reduced
    pool, moving = reduced.pool, Moving(reduced.pool, discrete_variables(reduced))
    roots = [*(n for v, n in solution.definitions if v in solution.needed), *solution.residuals]
    below = [pool.nodes[n][1] for n in pool.reachable(roots) if pool.nodes[n][0] == "noevent"]
    # a jump that belongs to a mode is an event, with a saltation
    with_modes = {*compiled.rewritten, *compiled.mode_nodes}
    found = [n for n in pool.reachable(below, with_modes) if pool.nodes[n][0] in RELATIONS | _STEPS and moving(n)]
    if not found:
        return None
    symbols = Symbols(compiled)
    builder = symbols.defined(compiled)
    values = []
    for n in found:
        operands = builder.lower(builder.replaced(pool.nodes[n][1:]))
        values.append(operands[0] - operands[1] if len(operands) == 2 else operands[0])
    texts = tuple(reduced.text(n, _WIDTH) for n in found)
    steps = np.array([pool.nodes[n][0] in ("floor", "ceil") for n in found])
    return _Sides(NarrowFunction("sides", symbols.inputs, ca.densify(ca.vertcat(*values))), steps, texts)
