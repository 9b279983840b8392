"""Detection of rates that jump without an event, below `no_event`, where derivatives would be wrong.

A solver integrates `no_event(sign(x))` with short steps at the jump, whose instant moves with the parameters: that part
of a derivative would be missing. A function that is continuous there, such as `x*sign(x)`, is differentiable enough.
Between two rows of a run in which such a relation changes, the instant is located and its two sides are compared.
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
from acausal.lower.build import Symbols
from acausal.lower.compiled import CompiledModel
from acausal.simulate.equations.calls.buffered import NarrowFunction
from acausal.simulate.events.guards import Moment

_STEPS = frozenset(("sign", "floor", "ceil"))
_HALVINGS = 60
# Distances from the instant, in row intervals, at which sides are compared; a true jump shows at both.
_FAR, _CLOSE, _SHRINKS, _ROUNDING = 1e-6, 1e-9, 0.5, 1e-7
# Relative change of states until the next row below which a jump is ignored.
_NOTHING = 1e-14
_WIDTH = 60


@dataclass(frozen=True, eq=False)
class _Sides:
    """Functions below `no_event` that may jump: differences of the sides of relations, and arguments of `steps`."""

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
    """Time [s] at which rates jump between two rows, when level k changes; None if they do not.

    `x`: states of both rows, shape (nx, 2); `z`: algebraic variables of the first, shape (nz,).
    """
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
    differences = []
    for share in (_FAR, _CLOSE):
        # beyond the rows, too: at a touch on a row, both distances would end there, and a steep force look like a jump
        left, right = (chain.slopes.rate(stretch.regime, start + s * gap, at(s)) for s in (low - share, low + share))
        differences.append(np.abs(right - left))
        size = np.abs(left) + np.abs(right)
    states = np.maximum(np.abs(x).max(axis=1), chain.compiled.nominal_x)
    jumps = (
        (differences[1] > _ROUNDING * size)
        & (differences[1] > _SHRINKS * differences[0])
        & (gap * differences[1] > _NOTHING * states)
    )
    return start + low * gap if jumps.any() else None


def _build(compiled: CompiledModel) -> _Sides | None:
    """The functions that may jump on which rates depend; None without any."""
    solution = compiled.solution
    reduced = solution.structure.reduced
    pool, moving = reduced.pool, Moving(reduced.pool, discrete_variables(reduced))
    roots = [*(n for v, n in solution.definitions if v in solution.needed), *solution.residuals]
    below = [pool.nodes[n][1] for n in pool.reachable(roots) if pool.nodes[n][0] == "noevent"]
    # a jump with a mode is an event, and has a saltation
    with_modes = {*compiled.rewritten, *compiled.mode_nodes}
    found = [n for n in pool.reachable(below, with_modes) if pool.nodes[n][0] in RELATIONS | _STEPS and moving(n)]
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
    return _Sides(NarrowFunction("sides", symbols.inputs, ca.densify(ca.vertcat(*values))), steps, texts)
