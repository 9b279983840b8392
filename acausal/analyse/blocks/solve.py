"""Symbolic solution of the blocks: every unknown becomes an expression, or is left to the solver.

Definitions are pool nodes in evaluation order. The remaining unknowns are the algebraic variables `z` of a
semi-explicit DAE, with as many residuals.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal, NamedTuple

from acausal.analyse.analyse import Structure
from acausal.analyse.blocks.elimination import Eliminated, eliminate, safety
from acausal.analyse.blocks.linear import LinearForm, linear_in
from acausal.analyse.blocks.monotone import causal, newton
from acausal.analyse.blocks.pivots import may_lose_digits
from acausal.analyse.hidden import HiddenCombination, HiddenConstraint, hidden_constraint
from acausal.diagnose.null_space.dependence import check_rank, dependent, special_values
from acausal.errors import StructureError
from acausal.structure import Block, Incidence, tear

BlockKind = Literal["explicit", "linear", "monotone", "torn", "dae"]


class BlockReport(NamedTuple):
    """One block: all unknowns, the iterated ones, and its kind."""

    unknowns: tuple[int, ...]
    iterated: tuple[int, ...]
    kind: BlockKind


@dataclass(frozen=True)
class Monotone:
    """A variable that is solved for inside the equations: its residual, and the start value `low` of the iteration."""

    variable: int
    residual: int
    low: float


@dataclass(frozen=True, eq=False)
class Solution:
    """Expressions for all unknowns."""

    structure: Structure
    # (variable, node) in evaluation order; nodes may refer to states, inputs, `algebraic` and earlier definitions.
    definitions: tuple[tuple[int, int], ...]
    # The unknowns left to the DAE solver, and as many nodes that must be zero.
    algebraic: tuple[int, ...]
    residuals: tuple[int, ...]
    # Variables on which the rates of the states or the residuals depend; all others are observed.
    needed: frozenset[int]
    blocks: tuple[BlockReport, ...]
    formulation: str = "torn"  # as requested
    monotone: tuple[Monotone, ...] = ()  # variables whose definitions are unrolled Newton iterations
    divisors: tuple[int, ...] = ()  # pivots that may lose digits for other values of parameters

    def __repr__(self) -> str:
        observed = len(self.definitions) + len(self.algebraic) - len(self.needed)
        return (
            f"Solution({self.structure.reduced.flat.name}: {len(self.structure.states)} states, "
            f"{len(self.algebraic)} iterated, {len(self.definitions)} explicit, {max(observed, 0)} observed)"
        )


def solve(structure: Structure, formulation: str = "torn") -> Solution:
    """Solve the blocks.

    Parameters
    ----------
    formulation
        "torn" solves blocks symbolically as far as possible. "dae" leaves all unknowns of every block with more than
        one unknown to the DAE solver, with their original equations, except in blocks with a variable declared
        monotone. A model without states is always torn.

    Raises
    ------
    StructureError
        AC204 when the equations of a linear block depend on each other.
    """
    # Without states there is no DAE solver: Newton's method alone solves the blocks, and tearing helps it.
    work = _Work(structure, formulation == "dae" and bool(structure.states))
    for block in structure.blocks:
        work.solve_or_postpone(block)
    if work.hidden is not None:
        raise work.hidden
    return Solution(
        structure=structure,
        definitions=tuple(work.definitions),
        algebraic=tuple(work.algebraic),
        residuals=tuple(work.residuals),
        needed=needed(structure, work.definitions, work.residuals),
        blocks=tuple(work.reports),
        formulation=formulation,
        monotone=tuple(work.monotone),
        divisors=tuple(dict.fromkeys(work.divisors)),
    )


class _Work:
    def __init__(self, structure: Structure, keep_blocks: bool) -> None:
        self.structure = structure
        self.pool = structure.reduced.pool
        self.points = structure.points
        self.keep_blocks = keep_blocks
        self.rates = {structure.derivative(x) for x in structure.states}
        # By flat scalar, because any of several connected variables may carry the declaration.
        self.lower_limits = {
            v.first + k: v.declaration.monotone_above
            for v in structure.reduced.flat.variables
            if v.declaration.monotone_above is not None
            for k in range(v.size)
        }
        self.definitions: list[tuple[int, int]] = []
        self.algebraic: list[int] = []
        self.residuals: list[int] = []
        self.reports: list[BlockReport] = []
        self.monotone: list[Monotone] = []
        self.divisors: list[int] = []
        # Hidden constraints of the blocks examined so far.
        self.hidden: HiddenConstraint | HiddenCombination | None = None
        self.postponed: set[int] = set()  # unknowns of blocks that were postponed

    def define(self, variable: int, node: int) -> None:
        self.definitions.append((variable, node))
        self.points.define(variable, node)

    def solve_or_postpone(self, block: Block) -> None:
        """Solve a block; postpone blocks with hidden constraints, and those that depend on them, to the next analysis.

        A ladder of sixty sections has a hidden constraint in each section. All are collected before the analysis is
        repeated, once instead of sixty times.
        """
        if self.postponed and self.postponed & self.pool.variables_in(
            *(self.structure.residuals[r] for r in block.rows)
        ):
            self.postponed.update(block.columns)
            return
        try:
            self.block(block)
        except StructureError as error:
            if self.hidden is not None:
                self.hidden.add(error)
            elif isinstance(error, HiddenConstraint | HiddenCombination):
                self.hidden = error
            else:
                raise
            self.postponed.update(block.columns)

    def block(self, block: Block) -> None:
        if len(block.columns) == 1:
            self._single(block.rows[0], block.columns[0])
        elif self.keep_blocks:
            self._whole(block)
        else:
            self._multiple(block)

    def _single(self, row: int, variable: int) -> None:
        pool = self.pool
        residual = self.structure.residuals[row]
        linear = linear_in(pool, residual, variable)
        if linear is not None:
            coefficient = linear[1].get(variable, pool.zero)
            if coefficient == pool.zero:
                raise self._dependent([row], Block((row,), (variable,)), linear[0])
            if safety(self.points, coefficient) is not None:
                self.define(variable, pool.div(pool.neg(linear[0]), coefficient))
                if may_lose_digits(pool, coefficient, lone=True):
                    self.divisors.append(coefficient)
                self.reports.append(BlockReport((variable,), (), "explicit"))
                return
        self._check_rank([row], [variable])
        if self._solve_monotone((variable,), [residual]):
            return
        self.algebraic.append(variable)
        self.residuals.append(residual)
        self.reports.append(BlockReport((variable,), (variable,), "torn"))

    def _whole(self, block: Block) -> None:
        """Leave a block to the DAE solver, unless a variable in it is declared monotone."""
        self._check_rank(block.rows, block.columns)
        if self._solve_monotone(block.columns, [self.structure.residuals[r] for r in block.rows]):
            return
        self.algebraic += block.columns
        self.residuals += [self.structure.residuals[r] for r in block.rows]
        self.reports.append(BlockReport(block.columns, block.columns, "dae"))

    def _multiple(self, block: Block) -> None:
        form = LinearForm(self.pool, set(block.columns))
        linear = [form.of(self.structure.residuals[r]) for r in block.rows]
        if all(x is not None for x in linear):
            forms = [x for x in linear if x is not None]
            differentiated = [i for i, r in enumerate(block.rows) if r in self.structure.integral]
            done = eliminate(self.points, [x[1] for x in forms], [x[0] for x in forms], differentiated, self.rates)
            self._linear(block, done)
        else:
            self._torn(block)

    def _linear(self, block: Block, done: Eliminated) -> None:
        if done.empty:
            rows = [block.rows[i] for i, _ in done.empty]
            error = self._dependent(rows, block, done.empty[0][1])
            raise hidden_constraint(self.structure, block, error)
        if done.left_variables:
            self._check_rank(block.rows, block.columns)
        self.algebraic += done.left_variables
        self.residuals += done.left_residuals
        self.divisors += done.divisors
        for variable, node in done.solved:
            self.define(variable, node)
        self.reports.append(BlockReport(block.columns, done.left_variables, "linear"))

    def _torn(self, block: Block) -> None:
        """Tear a nonlinear block; a row can be solved for a column in which it is linear with a safe coefficient."""
        self._check_rank(block.rows, block.columns)
        column_of = {v: k for k, v in enumerate(block.columns)}
        residuals = [self.structure.residuals[r] for r in block.rows]
        if self._solve_monotone(block.columns, residuals):
            return
        rows = [sorted(column_of[v] for v in self.pool.variables_in(r) if v in column_of) for r in residuals]
        incidence = Incidence.from_rows(rows, len(column_of))
        cache: dict[tuple[int, int], bool] = {}

        def solvable(i: int, k: int) -> bool:
            if (i, k) not in cache:
                cache[i, k] = self._coefficient(residuals[i], block.columns[k]) is not None
            return cache[i, k]

        torn = tear(incidence, solvable)
        iterated = [block.columns[k] for k in torn.torn]
        self.algebraic += iterated
        for i, k in torn.sequence:
            variable = block.columns[k]
            form = linear_in(self.pool, residuals[i], variable)
            assert form is not None, "tearing solves rows only for columns in which they are linear"
            self.define(variable, self.pool.div(self.pool.neg(form[0]), form[1][variable]))
            if may_lose_digits(self.pool, form[1][variable], lone=False):
                self.divisors.append(form[1][variable])
        self.residuals += [residuals[i] for i in torn.residual]
        self.reports.append(BlockReport(block.columns, tuple(iterated), "torn"))

    def _solve_monotone(self, unknowns: Sequence[int], residuals: Sequence[int]) -> bool:
        """Solve a nonlinear block inside the equations if one of its unknowns is declared monotone."""
        for variable in unknowns:
            low = self._monotone_above(variable)
            causal_form = None if low is None else causal(self.pool, residuals, unknowns, variable)
            if low is None or causal_form is None:
                continue
            definitions, rest = causal_form
            node = newton(self.points, rest, definitions, variable, low)
            if node is not None:
                self.define(variable, node)
                for other, meaning in definitions:
                    self.define(other, meaning)
                self.reports.append(BlockReport(tuple(unknowns), (), "monotone"))
                self.monotone.append(Monotone(variable, rest, low))
                return True
        return False

    def _monotone_above(self, variable: int) -> float | None:
        reduced = self.structure.reduced
        same_sign = (s for s in reduced.aliases.get(variable, ()) if reduced.image[s] == self.pool.var(variable))
        return next((self.lower_limits[s] for s in same_sign if s in self.lower_limits), None)

    def _coefficient(self, residual: int, variable: int) -> int | None:
        form = linear_in(self.pool, residual, variable)
        if form is None or variable not in form[1]:
            return None
        coefficient = form[1][variable]
        rank = safety(self.points, coefficient)
        return coefficient if rank is not None and rank < 3 else None

    def _check_rank(self, rows: Sequence[int], unknowns: Sequence[int]) -> None:
        residuals = [self.structure.residuals[r] for r in rows]
        flat_rows = [self.structure.flat_equation(r) for r in rows]
        try:
            check_rank(self.structure.reduced, self.points, residuals, unknowns, flat_rows)
        except StructureError as error:
            raise hidden_constraint(self.structure, Block(tuple(rows), tuple(unknowns)), error) from None

    def _dependent(self, rows: Sequence[int], block: Block, rest: int) -> StructureError:
        reduced = self.structure.reduced
        flat_rows = [self.structure.flat_equation(r) for r in rows]
        variables = sorted(self.pool.variables_in(rest))
        residuals = [self.structure.residuals[r] for r in block.rows]
        special = partial(special_values, reduced, self.points, residuals, block.columns)
        return dependent(reduced, flat_rows, block.columns, float(self.points.of(rest)[0]), variables, special)


def opened(solution: Solution) -> Solution:
    """The solution with the variables of monotone blocks as algebraic variables, after the iterated ones."""
    searched = {m.variable for m in solution.monotone}
    definitions = tuple(d for d in solution.definitions if d[0] not in searched)
    residuals = (*solution.residuals, *(m.residual for m in solution.monotone))
    return replace(
        solution,
        definitions=definitions,
        algebraic=(*solution.algebraic, *(m.variable for m in solution.monotone)),
        residuals=residuals,
        needed=needed(solution.structure, definitions, residuals),
        monotone=(),
    )


def needed(structure: Structure, definitions: Sequence[tuple[int, int]], residuals: Sequence[int]) -> frozenset[int]:
    """Variables that the rates of the states and the residuals depend on."""
    pool = structure.reduced.pool
    roots = [*structure.rates(structure.states), *residuals]
    return frozenset(pool.variables_behind(roots, dict(definitions)))
