"""Hidden constraints, which several equations imply together once their unknowns cancel.

Two capacitors in parallel state `C1.v == p.v - n.v` and `C2.v == p.v - n.v`. Structurally the two equations determine
the two potentials, but together they state C1.v == C2.v. Such a constraint is what remains of a block of equations when
its unknowns cancel. It replaces one of the equations it was derived from, which changes no solution, and the analysis
is repeated.

Modelica tools eliminate equations with integer factors beforehand for the same purpose (Otter and Elmqvist,
"Transformation of Differential Algebraic Array Equations to Index One Form", Modelica Conference 2017, section 3). Here
models without hidden constraints cost nothing, and factors may be parameters.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TypeVar

import numpy as np

from acausal.analyse.analyse import Structure
from acausal.analyse.blocks.elimination import eliminate
from acausal.analyse.blocks.linear import Linear, LinearForm
from acausal.analyse.combined import Combined, holding_combinations, transferred, with_combinations
from acausal.analyse.invariants import Row, add_terms, combined, null_combinations
from acausal.errors import StructureError
from acausal.flatten.pool import LEAVES
from acausal.flatten.reduced import ReducedSystem
from acausal.flatten.terms import SUMS
from acausal.numeric.evaluate import gradients
from acausal.numeric.samples import COUNT
from acausal.structure import Block


class HiddenConstraint(StructureError):
    """A singular block with hidden constraints: `equations` maps flat equations to the nodes that can replace them."""

    equations: dict[int, int]

    def add(self, other: StructureError) -> None:
        """Add the hidden constraints of another block, except for equations that are already replaced."""
        if isinstance(other, HiddenConstraint):
            self.equations = other.equations | self.equations


class HiddenCombination(StructureError):
    """A singular block whose nonlinear equations, `rows` of the reduced system, share combinations of unknowns."""

    structure: Structure
    rows: list[int]

    def add(self, other: StructureError) -> None:
        """Add the equations of another block."""
        if isinstance(other, HiddenCombination):
            self.rows += other.rows

    def combined(self) -> Combined:
        """The flat system with variables for the combinations."""
        return with_combinations(self.structure, self.rows, _highest(self.structure.reduced))


_Hidden = TypeVar("_Hidden", HiddenConstraint, HiddenCombination)


def hidden_constraint(structure: Structure, block: Block, error: StructureError) -> StructureError:
    """The error for a block of dependent equations: `error`, extended by its hidden constraints if there are any.

    They are sought among the equations of the block, or among all original equations if the block contains
    differentiated ones.
    """
    count = len(structure.reduced.residuals)
    if all(r < count for r in block.rows):
        rests = _remainders(structure, block.rows, set(block.columns))
    else:
        rests = _remainders(structure, range(count), _highest(structure.reduced))
        if not rests:
            rests = _differentiated_remainder(structure, block)
    if not rests or not all(structure.reduced.pool.variables_in(rest) for rest in rests.values()):
        # no constraint, or only a constant that must be zero: terms may still share combinations of unknowns
        sources = {structure.flat_equation(r) for r in block.rows}
        rows = [r for r, e in enumerate(structure.reduced.equation) if e in sources]
        rows = holding_combinations(structure, rows, _highest(structure.reduced))
        if not rows:
            return error
        combination = _as(HiddenCombination, error)
        combination.structure, combination.rows = structure, rows
        return combination
    hidden = _as(HiddenConstraint, error)
    hidden.equations = {structure.reduced.equation[r]: _in_flat(structure.reduced, rest) for r, rest in rests.items()}
    return hidden


def _as(kind: type[_Hidden], error: StructureError) -> _Hidden:
    return kind(error.code, error.fact, where=error.where, evidence=error.evidence, cause=error.cause, help=error.help)


def _remainders(structure: Structure, rows: Iterable[int], unknowns: set[int]) -> dict[int, int]:
    """Remainders of combinations of equations in which the unknowns cancel, by the row that each can replace.

    Nonlinear terms cancel as a whole, as in `y1 == q(u1 - u2)` and `y2 == -q(u1 - u2)`. Combinations with constant
    factors are tried first, because sums of currents cancel exactly, whereas expressions of parameters may not.
    """
    rows = list(rows)
    exact = _exact_remainders(structure, rows, unknowns)
    if exact:
        return exact
    form = LinearForm(structure.reduced.pool, unknowns)
    sums = [(r, x) for r in rows if (x := _sum(form, structure.residuals[r]))[1]]
    done = eliminate(structure.points, [x[1] for _, x in sums], [x[0] for _, x in sums])
    return {sums[i][0]: rest for i, rest in done.empty} or _substitution_remainders(structure, rows, unknowns)


def _substitution_remainders(structure: Structure, rows: Sequence[int], unknowns: set[int]) -> dict[int, int]:
    """Remainders of nonlinear equations after the linear ones have been solved for unknowns and substituted, by row.

    Example: `v == a - b` and `q == C (a - b) (1 + (a - b)**2)` contain the same difference of the unknowns.
    """
    pool = structure.reduced.pool
    substitution: dict[int, int] = {}

    def image(node: int) -> int:
        done: dict[int, int] = {}
        for number in pool.reachable([node]):
            op, *operands = pool.nodes[number]
            if op == "var":
                done[number] = substitution.get(operands[0], number)
            elif op in LEAVES:
                done[number] = number
            else:
                made = pool.make(op, *[done[c] for c in operands])
                done[number] = pool.collected(made) if op in SUMS else made
        return done[node]

    form, remainders = LinearForm(pool, unknowns), dict[int, int]()
    # an equation without unknowns is no hidden constraint
    rows = [r for r in rows if pool.variables_in(structure.residuals[r]) & unknowns]
    for r in sorted(rows, key=lambda r: form.of(structure.residuals[r]) is None):
        remainder = image(structure.residuals[r])
        if not pool.variables_in(remainder) & unknowns:
            remainders[r] = remainder
            continue
        linear = form.of(remainder)
        if linear is None:
            continue
        numbers = {v: pool.value(c) for v, c in linear[1].items()}
        pivot = next((v for v, c in numbers.items() if c in (1.0, -1.0)), None)
        if pivot is not None:
            solved = pool.neg(
                pool.mul(linear[1][pivot], pool.sub(remainder, pool.mul(linear[1][pivot], pool.var(pivot))))
            )
            substitution[pivot] = pool.collected(solved)
            substitution.update({v: image(node) for v, node in substitution.items()})
    return remainders


def _exact_remainders(structure: Structure, rows: Iterable[int], unknowns: set[int]) -> dict[int, int]:
    """Remainders of combinations with constant factors, found in exact arithmetic, by row."""
    pool = structure.reduced.pool
    rows_of_terms: dict[int, Row] = {}
    for r in rows:
        rows_of_terms[r] = {}
        add_terms(pool, structure.residuals[r], 1, rows_of_terms[r])
    terms_of_unknowns = {
        r: {n: w for n, w in row.items() if pool.variables_in(n) & unknowns} for r, row in rows_of_terms.items()
    }
    remainders = {}
    for combination in null_combinations({r: row for r, row in terms_of_unknowns.items() if row}):
        rest = combined([(w, rows_of_terms[r]) for r, w in combination.items()])
        remainders[next(iter(combination))] = pool.sum(pool.mul(pool.const(float(w)), n) for n, w in rest.items())
    return remainders


def _sum(form: LinearForm, root: int) -> Linear:
    """(Rest, coefficients) with respect to the unknowns and to nonlinear terms; the key of a term is -1 - node."""
    pool = form.pool
    rest, total = pool.zero, dict[int, int]()
    stack = [(root, pool.one)]
    while stack:
        number, factor = stack.pop()
        linear = form.of(number)
        if linear is None:
            op, *args = pool.nodes[number]
            if op in SUMS:
                stack += [(args[0], factor), (args[1], factor if op == "add" else pool.neg(factor))]
                continue
            if op == "neg":
                stack.append((args[0], pool.neg(factor)))
                continue
            substitution = [x is not None and not x[1] for x in map(form.of, args)]
            if op == "mul" and any(substitution):
                stack.append((args[substitution[0]], pool.mul(factor, args[not substitution[0]])))
                continue
            if op == "div" and substitution[1]:
                stack.append((args[0], pool.div(factor, args[1])))
                continue
            linear = pool.zero, {-1 - number: pool.one}
        rest = pool.add(rest, pool.mul(factor, linear[0]))
        for v, c in linear[1].items():
            total[v] = pool.add(total.get(v, pool.zero), pool.mul(factor, c))
    return rest, {v: c for v, c in total.items() if c != pool.zero}


def _differentiated_remainder(structure: Structure, block: Block) -> dict[int, int]:
    """A hidden constraint of a block with differentiated equations, by the undifferentiated one that it replaces.

    The derivative of `x + t y = q(t)` and `x' + t y' + 2 y = p(t)` have the same left-hand side in x' and y'. Their
    remainder can replace any undifferentiated equation that contributes to it, because differentiated ones follow from
    their constraints.
    """
    count = len(structure.reduced.residuals)
    rests = list(_remainders(structure, block.rows, set(block.columns)).values())
    column_of = {v: k for k, v in enumerate(block.columns)}
    jacobian = np.zeros((len(block.rows), len(column_of)))
    residuals = [structure.residuals[r] for r in block.rows]
    for i, row in enumerate(gradients(structure.reduced.pool, residuals, block.columns, structure.points.leaves)):
        for v, slope in row.items():
            jacobian[i, column_of[v]] = np.broadcast_to(slope, (COUNT,))[1]
    if len(rests) != 1 or not np.isfinite(jacobian).all():
        return {}
    left, sizes, _ = np.linalg.svd(jacobian)
    if len(sizes) > 1 and sizes[-2] <= 1e-9 * sizes[0]:
        return {}
    contributions = {r: abs(left[i, -1]) for i, r in enumerate(block.rows) if r < count}
    best = max(contributions, key=contributions.__getitem__, default=None)
    return {} if best is None or contributions[best] < 1e-6 else {best: rests[0]}


def _highest(reduced: ReducedSystem) -> set[int]:
    """Variables of the undifferentiated equations except states and inputs."""
    pool = reduced.pool
    variables = pool.variables_in(*reduced.residuals)
    states = {pool.integral_of[v] for v in variables if v in pool.integral_of}
    return set(variables - states - set(reduced.inputs))


def _in_flat(reduced: ReducedSystem, node: int) -> int:
    """A node of the reduced system in the pool of the flat one."""
    pool = reduced.flat.pool

    def scalar(variable: int) -> int:
        if variable < len(reduced.scalar):
            return reduced.scalar[variable]
        return pool.derivative(scalar(reduced.pool.integral_of[variable]))

    return transferred(reduced.pool, node, pool, scalar)
