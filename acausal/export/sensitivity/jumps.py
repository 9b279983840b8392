"""Rates that jump where no event is: `no_event` says that it does no harm, and a derivative passes over it.

`no_event(sign(x))` is integrated by a solver whose steps become short there, and its instant moves with the parameters:
that part of a derivative would be missing. What is only continuous there, as `x*sign(x)`, does no harm. Between two
rows of a run in which such a relation changes the instant is looked for, and its two sides.
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
from acausal.flatten.text import to_text
from acausal.lower.compiled import CompiledModel
from acausal.lower.symbols import Symbols
from acausal.simulate.equations.calls.quick import Narrow
from acausal.simulate.events.guards import Moment

_STEPS = frozenset(("sign", "floor", "ceil"))
_HALVINGS = 60
# Both sides are looked at so far from the instant, in distances of rows; a jump is there at both, and no rounding.
_FAR, _CLOSE, _SHRINKS, _ROUNDING = 1e-6, 1e-9, 0.5, 1e-7
# A jump by which states go elsewhere by less than this share until the next row is none.
_NOTHING = 1e-14
_WIDTH = 60


@dataclass(frozen=True, eq=False)
class _Sides:
    """Differences of the sides of relations, and arguments of steps, below `no_event`; which of these are steps."""

    function: Narrow
    steps: NDArray[np.bool_]
    texts: tuple[str, ...]

    def levels(self, values: Vector) -> Vector:
        """What changes only where something may jump; shape of the values."""
        return np.where(self.steps, np.floor(values) + np.ceil(values), np.sign(values))


def refuse_jumps(chain: Chain) -> None:
    """Raise ExportError AC615 where a rate of the run jumps without an event."""
    sides = chain.slopes.kept("jumps", lambda: _made(chain.compiled))
    if sides is None:
        return
    times, x, z, m = chain.hybrid.recorder.rows()
    levels = sides.levels(sides.function.many(times[:, None], x.T, z.T, chain.u, chain.p, m.T))
    changed = (levels[1:] != levels[:-1]) & (np.diff(times) > 0.0)[:, None]
    for row, k in np.argwhere(changed).tolist():
        t = _jump(chain, sides, k, tuple(times[row : row + 2].tolist()), x[:, row : row + 2], z[:, row])
        if t is not None:
            raise ExportError(
                "AC615",
                f"sensitivities do not take {chain.compiled.name}: at t = {t:.9g} s a rate jumps without an event",
                evidence=[f"below no_event: {sides.texts[k]}"],
                cause="the instant of the jump moves with the parameters, and nothing locates it",
                help="say it without no_event",
            )


def _jump(chain: Chain, sides: _Sides, k: int, ends: tuple[float, float], x: Vector, z: Vector) -> float | None:
    """Where rates jump between two rows as number k changes; None where they do not."""
    start, end = ends
    gap = end - start
    stretch = next(s for s in map(chain.stretch, reversed(range(len(chain.passages)))) if s.start <= start)
    rates = [
        gap * chain.slopes.rate(stretch.regime, t, Moment(x[:, j], z, stretch.m, stretch.regime))
        for j, t in enumerate(ends)
    ]

    def at(s: float) -> Moment:
        rise = x[:, 1] - x[:, 0]
        bend = (1.0 - s) * (rates[0] - rise) - s * (rates[1] - rise)
        found = Moment(x[:, 0] + s * rise + s * (1.0 - s) * bend, z, stretch.m, stretch.regime)
        return chain.hybrid.iteration.consistent(start + s * gap, found)

    def level(s: float) -> float:
        here = at(s)
        values = sides.function.many(
            np.array([[start + s * gap]]), here.x[None], here.z[None], chain.u, chain.p, here.m[None]
        )
        return float(sides.levels(values)[0, k])

    low, high, before = 0.0, 1.0, level(0.0)
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if level(middle) == before else (low, middle)
    apart = []
    for share in (_FAR, _CLOSE):
        pair = [min(max(low + sign * share, 0.0), 1.0) for sign in (-1.0, 1.0)]
        left, right = (chain.slopes.rate(stretch.regime, start + s * gap, at(s)) for s in pair)
        apart.append(np.abs(right - left))
        size = np.abs(left) + np.abs(right)
    states = np.maximum(np.abs(x).max(axis=1), chain.compiled.nominal_x)
    jumps = (apart[1] > _ROUNDING * size) & (apart[1] > _SHRINKS * apart[0]) & (gap * apart[1] > _NOTHING * states)
    return start + low * gap if jumps.any() else None


def _made(compiled: CompiledModel) -> _Sides | None:
    """Those on which rates depend; None without any."""
    solution = compiled.solution
    reduced = solution.structure.reduced
    pool, moving = reduced.pool, Moving(reduced.pool, discrete_variables(reduced))
    roots = [*(n for v, n in solution.definitions if v in solution.needed), *solution.residuals]
    below = [pool.nodes[n][1] for n in pool.reachable(roots) if pool.nodes[n][0] == "noevent"]
    # a jump that a mode tells is one of the saltations
    told = {*compiled.rewritten, *compiled.mode_nodes}
    found = [n for n in pool.reachable(below, told) if pool.nodes[n][0] in RELATIONS | _STEPS and moving(n)]
    if not found:
        return None
    symbols = Symbols(compiled)
    builder = symbols.defined(compiled)
    values = []
    for n in found:
        both = [builder.lower([builder.replaced(operand)])[0] for operand in pool.nodes[n][1:]]
        values.append(both[0] - both[1] if len(both) == 2 else both[0])

    def name_of(kind: str, k: int) -> str:
        return reduced.name(k) if kind == "var" else compiled.parameters[k]

    texts = tuple(to_text(pool, n, name_of, _WIDTH) for n in found)
    steps = np.array([pool.nodes[n][0] in ("floor", "ceil") for n in found])
    return _Sides(Narrow("sides", symbols.inputs, ca.densify(ca.vertcat(*values))), steps, texts)
