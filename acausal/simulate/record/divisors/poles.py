"""Refuses runs that went past a pole of a rate.

The integral of 1/x over zero is infinite. Most solvers stop there for want of ever smaller steps, but where a run goes
on from an event that rounding has placed behind the pole, or rounding lets a step end there, its values are arbitrary.
The rows of a run show where a divisor changes its sign (`acausal.analyse.domains.poles`); the rates on the way there
show whether it is a pole: sin(x)/x has none, and the integral of 1/sqrt(x) is finite.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from acausal.analyse.domains.poles import divisors
from acausal.analyse.events.state_events import discrete_variables
from acausal.analyse.events.steep import Moving
from acausal.arrays import Vector
from acausal.diagnose.words import component_of, listed, made_at
from acausal.errors import IntegrationError
from acausal.lower.build import Symbols
from acausal.lower.compiled import CompiledModel
from acausal.lower.diagonal_blocks import varying_linear_blocks
from acausal.recent import once_per_owner
from acausal.simulate.equations.calls.buffered import NarrowFunction
from acausal.simulate.equations.function_cache import functions_of
from acausal.simulate.equations.problem import Problem
from acausal.simulate.record.algebraic import corrected
from acausal.simulate.record.divisors.blocks import Blocks, Rows
from acausal.simulate.record.record import Recorder
from acausal.simulate.solvers.segment import Tolerances

# Rates are compared at these fractions of the way from a pole to the nearest row. They grow by the ratio of two of them
# if it is of the first order; by less than this fraction of that if their integral is finite.
_FRACTIONS, _LEAST_GROWTH = (1e-3, 1e-5, 1e-7), 0.9
# Rows nearer than this fraction of the run belong to one event. A divisor that changes its sign between them passes
# zero there if it is this small, relative to its values before and after; else it jumps.
_TOGETHER, _SMALL = 1e-9, 1e-6
_HALVINGS = 60
# A divisor that falls to this fraction from one row to the next is zero.
_ZERO = 1e-12


@dataclass(frozen=True, eq=False)
class _Divisors:
    """Divisors that vary, and linear blocks of algebraic equations, which divide by their determinants.

    `texts`: What each of them is, in words.
    """

    texts: tuple[str, ...]
    quotients: NarrowFunction | None
    blocks: Blocks | None

    def at(self, problem: Problem, rows: Rows) -> Vector:
        """Their values at n rows, shape (n, divisors); determinants are divided by their largest ones."""
        (t, x, z, m), found = rows, [np.zeros((len(rows[0]), 0))]
        if self.quotients is not None:
            found.append(self.quotients.many(t[:, None], x.T, z.T, problem.u, problem.p, m.T))
        if self.blocks is not None:
            signs, sizes = self.blocks.determinants(problem, rows)
            with np.errstate(invalid="ignore"):  # all zero
                found.append((signs * np.exp(sizes - sizes.max(axis=1, keepdims=True))).T)
        return np.hstack(found)


@dataclass(frozen=True, eq=False)
class _Row:
    """One row of a run."""

    t: float
    x: Vector
    z: Vector
    m: Vector

    @classmethod
    def of(cls, recorder: Recorder, k: int) -> _Row:
        """A recorded row."""
        return cls(*recorder.point(k))

    def towards(self, other: _Row, fraction: float) -> _Row:
        """A point on the straight line to another row, with the modes of that one."""
        return _Row(
            self.t + fraction * (other.t - self.t),
            self.x + fraction * (other.x - self.x),
            self.z + fraction * (other.z - self.z),
            other.m,
        )


def may_have_poles(compiled: CompiledModel, p: Vector) -> bool:
    """Whether the equations have divisors that may pass zero."""
    return _known(compiled, p) is not None


def refuse_poles(problem: Problem, recorder: Recorder, tolerances: Tolerances) -> None:
    """Refuse a run in which a state went past a pole of its rate; the rows up to there remain.

    Raises IntegrationError: AC404 with the first such pole.
    """
    found = _known(recorder.compiled, recorder.p)
    if found is None or recorder.count < 2:
        return
    rows = recorder.rows()
    times, values = rows[0], found.at(problem, rows)
    vanish = np.abs(values[1:]) <= _ZERO * np.abs(values[:-1])
    crossed = np.argwhere(((values[:-1] < 0.0) != (values[1:] < 0.0)) | vanish)
    for row, column in crossed.tolist():
        middle = _zero(found, problem, column, *(_Row.of(recorder, k) for k in (row, row + 1)))
        sides = _sides(times, values[:, column], row, middle.t)
        for side in (_Row.of(recorder, k) for k in sides):
            state = _growing(problem, tolerances, middle, side)
            if state is not None:
                recorder.cut(row)
                raise _pole(recorder.compiled, found.texts[column], state, middle.t)


def _sides(times: Vector, values: Vector, row: int, t: float) -> tuple[int, ...]:
    """The nearest rows before and after the zero at `t` of a divisor behind a row; none if it jumps there."""
    near = _TOGETHER * (times[-1] - times[0])
    before = int(np.searchsorted(times, t - near)) - 1
    after = int(np.searchsorted(times, t + near, side="right"))
    sides = tuple(k for k in (before, after) if 0 <= k < len(times))
    largest = max(abs(values[row]), abs(values[row + 1]))
    jumps = times[row + 1] - times[row] <= near and largest > _SMALL * np.abs(values[list(sides)]).min()
    return () if jumps else sides


def _zero(found: _Divisors, problem: Problem, column: int, before: _Row, after: _Row) -> _Row:
    """Where a divisor is zero on the straight line between two rows."""
    low, high = 0.0, 1.0
    sign = found.at(problem, _columns([before]))[0, column] < 0.0
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        is_before = (found.at(problem, _columns([before.towards(after, middle)]))[0, column] < 0.0) == sign
        low, high = (middle, high) if is_before else (low, middle)
    return before.towards(after, 0.5 * (low + high))


def _columns(rows: list[_Row]) -> Rows:
    return np.array([r.t for r in rows]), *(np.column_stack([getattr(r, k) for r in rows]) for k in "xzm")


def _growing(problem: Problem, tolerances: Tolerances, middle: _Row, side: _Row) -> int | None:
    """The state whose rate has a pole at `middle`, as far as this side of it shows; None if there is none."""
    compiled, n = problem.compiled, problem.n_dynamic
    points = [middle.towards(side, fraction) for fraction in _FRACTIONS]
    times, x, z, m = _columns(points)
    numbers = problem.u, problem.p
    try:
        z = corrected(compiled, times, x, z, *numbers, side.m, tolerances)
    except RuntimeError:
        return None
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        rates = np.abs(functions_of(compiled).rhs.many(times[:, None], x.T, z.T, *numbers, m.T)[:, :n])
        ratios = np.array(_FRACTIONS[:-1]) / np.array(_FRACTIONS[1:])
        grows = (rates[1:] > _LEAST_GROWTH * ratios[:, None] * rates[:-1]).all(axis=0)
        moved = rates[-1] * _FRACTIONS[-1] * abs(side.t - middle.t)
    least = tolerances.of(np.zeros(n), compiled.nominal_x[:n])  # of a state that may have gone far past the pole
    states: NDArray[np.intp] = np.flatnonzero(grows & (moved > least))
    return int(states[0]) if len(states) else None


def _pole(compiled: CompiledModel, divisor: str, state: int, t: float) -> IntegrationError:
    name = compiled.states[state]
    return IntegrationError(
        "AC404",
        f"{compiled.name}: {name} has no finite value after t = {t:.9g} s, where its rate has a pole",
        where=made_at(compiled.flat, component_of(compiled.flat, name)),
        evidence=[f"{divisor} passes zero there"],
        cause="the integral of the rate up to there is infinite, so that the values after it were arbitrary",
        help="limit the divisor, or the quotient on both sides; or end the run earlier",
    )


def _known(compiled: CompiledModel, p: Vector) -> _Divisors | None:
    return _divisors(compiled.common, np.sign(p).astype(np.int8).tobytes())


@once_per_owner
def _divisors(compiled: CompiledModel, signs: bytes) -> _Divisors | None:
    """Those of a model that owns its functions (`common`); None if there are none, or nothing moves."""
    solution = compiled.solution
    reduced = solution.structure.reduced
    definitions = [d for d in solution.definitions if d[0] in solution.needed]
    moving = Moving(reduced.pool, discrete_variables(reduced))
    both = solution.residuals, reduced.residuals
    found = divisors(reduced.pool, definitions, *both, np.frombuffer(signs, np.int8).tolist(), moving)
    symbols, nodes = Symbols(compiled), (*found.factors, *found.angles)
    texts = [f"the divisor {reduced.text(n)}" for n in found.factors]
    texts += [f"the divisor cos({reduced.text(n)})" for n in found.angles]
    quotients = None
    if nodes:
        builder, count = symbols.defined(compiled), len(found.factors)
        values = ca.vertsplit(builder.column(builder.replaced(nodes)))
        column = ca.densify(ca.vertcat(*values[:count], *map(ca.cos, values[count:])))
        quotients = NarrowFunction("divisors", symbols.inputs, column)
    slope = ca.jacobian(compiled.rhs(*symbols.inputs)[1], symbols.z)
    places = varying_linear_blocks(slope, symbols.z, ca.vertcat(symbols.t, symbols.x))
    for _, unknowns in places:
        texts.append(f"the determinant of the equations for {listed([compiled.algebraic[k] for k in unknowns], 4)}")
    blocks = Blocks.of(compiled, symbols, slope, places)
    return _Divisors(tuple(texts), quotients, blocks) if texts and compiled.n_dynamic else None
