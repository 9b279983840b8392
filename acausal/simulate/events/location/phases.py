"""What guards make of smooth states: phases of sines and arguments of steep functions, which have to be sampled.

States are resolved by the steps of a solver, but not what a guard makes of them: `sin(w*t) > 0.9` turns any number of
times, and `exp(-((x - 1)/w)**2) > 0.5` comes and goes, while all states rest or grow evenly. Polynomials through mesh
points far apart look smooth. The arguments themselves are as smooth as the states: their change from one mesh point to
the next, and that of the function within the bounds of its argument, tell where mesh points are too far apart.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any
from weakref import WeakKeyDictionary

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from acausal.arrays import Truth, Vector
from acausal.flatten.pool import Pool
from acausal.lower.build import Symbols
from acausal.lower.compiled import CompiledModel
from acausal.simulate.equations.calls.buffered import NarrowFunction
from acausal.simulate.events.guards import Moment
from acausal.simulate.events.location.between import lower_bounds
from acausal.simulate.solvers.segment import Piece, Segment

# The largest change of a phase between two mesh points [rad]. With 32 points in each period, the parabolas through them
# show a peak that exceeds its threshold by 2e-5 of its height; with eight, 4 of 50 were lost that exceed it by 1e-3.
_LARGEST_ADVANCE = np.pi / 16
# The same where rates depend on the phase: the error control resolves it, unless its part of the rates is small.
# Compiled loops bound their steps by an eighth of a period (event_loop.c).
_RESOLVED_ADVANCE = np.pi
# The largest logarithmic change of a steep function between two mesh points, the same where rates depend on it, whose
# steps are short where it changes, and the factor of what lies beyond both points.
_LARGEST_CHANGE, _RESOLVED_CHANGE, _TURNS = 0.5, 1.0, 10.0
# Where exponentials and steps have ended; the least size of a denominator, relative to its largest; and any.
_FADED, _STEPPED, _LEAST, _FAR = 40.0, 20.0, 1e-12, 1e100
# The fraction of the largest distance of mesh points that is aimed at, and the shortest interval that is divided, in
# distances of instants that coincide.
_WITHIN, _FEW = 0.7, 16.0
_PERIODIC = frozenset(("sin", "cos", "tan"))
_MONOTONE = frozenset(("exp", "tanh", "atan"))
_EXTREMES = frozenset(("min", "max"))
_STEEP = {"exp": 0, "tanh": 0, "atan": 0, "cosh": 0, "sinh": 0, "pow": 0, "div": 1}


@dataclass(frozen=True, eq=False)
class Arguments:
    """Arguments in the guards of a model: phases, and those of steep functions.

    `function`, `column`: (t, x, z, u, p, m) -> arguments, shape (n,).
    `operations`: For each its function: that of a phase [rad], or the name of a steep function.
    `resolved`: For each whether rates depend on it.
    """

    function: NarrowFunction
    column: Any
    operations: tuple[str, ...]
    resolved: tuple[bool, ...]

    @cached_property
    def is_phase(self) -> Truth:
        """Whether each is a phase."""
        return np.array([op in _PERIODIC for op in self.operations])

    @cached_property
    def limits(self) -> Vector:
        """The largest changes between two mesh points: of phases [rad], and of the logarithms of steep functions."""
        resolved = np.array(self.resolved)
        of_phases = np.where(resolved, _RESOLVED_ADVANCE, _LARGEST_ADVANCE)
        return np.where(self.is_phase, of_phases, np.where(resolved, _RESOLVED_CHANGE, _LARGEST_CHANGE))


_MADE: WeakKeyDictionary[CompiledModel, Arguments | None] = WeakKeyDictionary()


def phases(compiled: CompiledModel) -> Arguments | None:
    """The phases and steep arguments of the guards of a model; None if there are none that vary."""
    if compiled not in _MADE:
        _MADE[compiled] = _made(compiled)
    return _MADE[compiled]


def _made(compiled: CompiledModel) -> Arguments | None:
    symbols = Symbols(compiled)
    builder = symbols.defined(compiled)
    pool, relations = builder.pool, set(compiled.state_events.relations)
    rates = compiled.solution.structure.rates(compiled.state_variables)
    definitions = dict(compiled.solution.definitions)
    # what rates depend on is resolved by the error control of the solver
    resolved = _behind(pool, compiled, [*rates, *compiled.solution.residuals], relations)
    found: dict[tuple[int, str], bool] = {}
    for n in sorted(_behind(pool, compiled, relations, set())):
        op, *operands = pool.nodes[n]
        if op in _PERIODIC or (op in _STEEP and not _is_low_power(pool, op, operands)):
            argument = operands[_STEEP.get(op, 0)]
            for a in [argument] if op in _PERIODIC else _beneath_extremes(pool, argument, definitions):
                found[a, op] = found.get((a, op), True) and n in resolved
    if not found:
        return None
    column = ca.densify(builder.column(builder.replaced([n for n, _ in found])))
    t, x, z = symbols.inputs[:3]
    varying = ca.vertcat(t, x[: compiled.n_dynamic], z)
    varies = [k for k in range(column.numel()) if ca.depends_on(column[k], varying)]
    if not varies:
        return None
    chosen = [(op, is_resolved) for (_, op), is_resolved in found.items()]
    operations, are_resolved = zip(*(chosen[k] for k in varies), strict=True)
    narrow = NarrowFunction("phases", symbols.inputs, column[varies])
    return Arguments(narrow, ca.Function("arguments", symbols.inputs, [column[varies]]), operations, are_resolved)


def must_be_searched(compiled: CompiledModel) -> bool:
    """Whether guards have arguments on which no rate depends, which steps of a compiled loop do not resolve."""
    known = phases(compiled)
    return known is not None and not all(known.resolved)


def turning_rate(compiled: CompiledModel, t: Any, x: Any, others: Sequence[Any]) -> Any:
    """The largest rate of the phases of guards [rad/s] along the solution of an ODE, at (t, x, *others) in SX."""
    known = phases(compiled)
    if known is None:
        return ca.SX(0)
    column, n = known.column(t, x, *others), compiled.n_dynamic
    column = column[[k for k, op in enumerate(known.operations) if op in _PERIODIC]]
    rates = ca.densify(compiled.rhs(t, x, *others)[0])[:n]
    along = ca.jtimes(column, ca.vertcat(t, x[:n]), ca.vertcat(1, rates))
    return ca.mmax(ca.fabs(along)) if along.numel() else ca.SX(0)


def _is_low_power(pool: Pool, op: str, operands: list[int]) -> bool:
    """Whether a node is a square, a cube, or another power below the eighth, which parabolas show."""
    exponent = pool.nodes[operands[1]] if op == "pow" else ("", 0.0)
    return exponent[0] == "const" and float(exponent[1]) in range(1, 8)


def _beneath_extremes(pool: Pool, argument: int, definitions: dict[int, int]) -> list[int]:
    """An argument, or the operands of `minimum` and `maximum` in it, which hide where it turns.

    The compiler bounds exponents, too (`acausal.analyse.events.underflow`): between mesh points on both sides of a
    pulse, `maximum(-v**2, -300)` is constant.
    """
    found, pending, seen = list[int](), [argument], set[int]()
    while pending:
        here = pending.pop()
        if here in seen:
            continue
        seen.add(here)
        op, *operands = pool.nodes[here]
        if op in _EXTREMES:
            pending += operands
        elif op == "var" and operands[0] in definitions:
            pending.append(definitions[operands[0]])
        else:
            found.append(here)
    return found


def _behind(pool: Pool, compiled: CompiledModel, roots: Iterable[int], barriers: set[int]) -> set[int]:
    """Nodes on which these roots depend, through definitions, but not through `barriers`."""
    definitions, pending, seen = dict(compiled.solution.definitions), list(roots), set[int]()
    while pending:
        fresh = set(pool.reachable(pending, barriers)) - seen
        seen |= fresh
        variables = (pool.nodes[n][1] for n in fresh if pool.nodes[n][0] == "var")
        behind = {definitions[v] for v in variables if v in definitions}
        pending = list(behind - seen - barriers)
    return seen


def first_swing(
    moment: Moment, segment: Segment, times: Vector, piece: Piece, rows: NDArray[np.int64], until: int, shortest: float
) -> tuple[int | None, float]:
    """The first of some intervals in which a phase advances too far, or a steep function changes too much, or None.

    And a better distance of mesh points if a phase does [s], inf else: what is steep is so for a moment.

    `times`: The start of the segment and n mesh points, shape (n + 1,), which are the `rows` of a piece, shape (n,).
    `until`, `shortest`: The first `until` intervals count, unless they are nearly as short as `shortest` [s].
    """
    problem = moment.regime.problem
    found = phases(problem.compiled)
    if found is None or not until:
        return None, np.inf
    x, z = (np.column_stack([v, w[:, rows[:until]]]) for v, w in ((segment.x, piece.x), (segment.z, piece.z)))
    values = found.function.many(times[: until + 1, None], x.T, z.T, problem.u, problem.p, moment.m)
    widths = np.diff(times[: until + 1])
    is_phase, limits = found.is_phase, found.limits
    advance = (np.abs(np.diff(values[:, is_phase], axis=0)) / limits[is_phase]).max(axis=1, initial=0.0)
    change = np.zeros(until)
    if not is_phase.all():
        steep = [op for op in found.operations if op not in _PERIODIC]
        change = (_changes(times[: until + 1], values[:, ~is_phase], steep) / limits[~is_phase]).max(axis=1)
    swung = np.flatnonzero(((advance > 1.0) | (change > 1.0)) & (widths > _FEW * shortest))
    if not len(swung):
        return None, np.inf
    k = int(swung[0])
    return k, _WITHIN * float(widths[k] / advance[k]) if advance[k] > 1.0 else np.inf


def _changes(times: Vector, arguments: Vector, operations: list[str]) -> Vector:
    """The largest logarithmic changes of k steep functions in each of n intervals, shape (n, k), from their arguments.

    What it may rise or fall beyond both ends counts more: a pulse is there, if anywhere.
    """
    arguments = np.nan_to_num(np.clip(arguments, -_FAR, _FAR))
    low, high = lower_bounds(times, arguments), -lower_bounds(times, -arguments)
    change = np.zeros(low.shape)
    for k, op in enumerate(operations):
        both = np.stack([arguments[:-1, k], arguments[1:, k]])
        least, most = np.fmin(low[:, k], both.min(axis=0)), np.fmax(high[:, k], both.max(axis=0))
        if op not in _MONOTONE:
            passes_zero, both = np.sign(least) * np.sign(most) < 0.0, np.abs(both)
            least, most = np.where(passes_zero, 0.0, np.fmin(np.abs(least), np.abs(most))), np.fmax(-least, most)
        nearest = max(_LEAST * float(both.max()), 1e-300)
        levels = [_level(op, v, nearest) for v in (least, both.min(axis=0), both.max(axis=0), most)]
        turn = np.fmax(levels[1] - levels[0], levels[3] - levels[2])
        change[:, k] = np.fmax(levels[3] - levels[0], _TURNS * turn)
    return change


def _level(op: str, argument: Vector, least: float) -> Vector:
    """The logarithm of a function, or of what a step has left to its end, where it matters; grows with `argument`.

    Functions that are not monotone are given magnitudes, of which `least` counts as zero.
    """
    if op == "exp":
        return np.maximum(argument, -_FADED)
    if op == "tanh":
        return np.clip(argument, -_STEPPED, _STEPPED)
    if op == "atan":
        return np.arcsinh(argument)
    if op in ("cosh", "sinh"):
        return np.clip(argument, 1.0, _FADED)
    return np.minimum(np.log(np.maximum(argument, least)), _FADED)
