"""Constraints that several equations state together: they come to light when their unknowns cancel.

Two capacitors side by side say `C1.v == p.v - n.v` and `C2.v == p.v - n.v`. Index reduction looks at the structure,
where the two equations are good for the two potentials; but what they say is C1.v == C2.v. Such a constraint is what is
left of a block of equations when its unknowns cancel. It takes the place of one of the equations it was made of, which
changes no solution, and the analysis begins anew.

Modelica tools eliminate equations with integer factors beforehand for the same purpose (Otter and Elmqvist,
"Transformation of Differential Algebraic Array Equations to Index One Form", Modelica Conference 2017, section 3). Here
models without hidden constraints pay nothing, and factors may be parameters.
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
    """The message for those who do not go on; `equations` are flat equations with the nodes that can replace them."""

    equations: dict[int, int]

    def add(self, other: StructureError) -> None:
        """Take over what another block hides, but for equations that this one replaces already."""
        if isinstance(other, HiddenConstraint):
            self.equations = other.equations | self.equations


class HiddenCombination(StructureError):
    """The same where nonlinear equations hold unknowns in combinations: which of the reduced system's equations."""

    structure: Structure
    rows: list[int]

    def add(self, other: StructureError) -> None:
        """Take over the equations of another block."""
        if isinstance(other, HiddenCombination):
            self.rows += other.rows

    def combined(self) -> Combined:
        """The system that names the combinations."""
        return with_combinations(self.structure, self.rows, _highest(self.structure.reduced))


_Hidden = TypeVar("_Hidden", HiddenConstraint, HiddenCombination)


def hidden_constraint(structure: Structure, block: Block, error: StructureError) -> StructureError:
    """What to raise for a block whose equations depend on each other: `error`, with the constraints it hides if any.

    Looked for among the equations of the block; when they are differentiated ones, among all equations as they were.
    """
    count = len(structure.reduced.residuals)
    if all(r < count for r in block.rows):
        rests = _rests(structure, block.rows, set(block.columns))
    else:
        rests = _rests(structure, range(count), _highest(structure.reduced))
        if not rests:
            rests = _differentiated(structure, block)
    if not rests or not all(structure.reduced.pool.variables_in(rest) for rest in rests.values()):
        # nothing, or a number that would have to be zero: their terms may still share combinations of unknowns
        sources = {structure.flat_equation(r) for r in block.rows}
        own = [r for r, e in enumerate(structure.reduced.equation) if e in sources]
        own = holding_combinations(structure, own, _highest(structure.reduced))
        if not own:
            return error
        named = _as(HiddenCombination, error)
        named.structure, named.rows = structure, own
        return named
    hidden = _as(HiddenConstraint, error)
    hidden.equations = {structure.reduced.equation[r]: _in_flat(structure.reduced, rest) for r, rest in rests.items()}
    return hidden


def _as(kind: type[_Hidden], error: StructureError) -> _Hidden:
    return kind(error.code, error.fact, where=error.where, evidence=error.evidence, cause=error.cause, help=error.help)


def _rests(structure: Structure, rows: Iterable[int], unknowns: set[int]) -> dict[int, int]:
    """What is left of equations in which the unknowns cancel when others are added, by row.

    Terms that are not linear in the unknowns cancel as a whole: `y1 == q(u1 - u2)` and `y2 == -q(u1 - u2)`. What
    cancels by numbers alone is looked for first: sums of currents do so exactly, expressions of parameters may not.
    """
    rows = list(rows)
    found = _sums(structure, rows, unknowns)
    if found:
        return found
    form = LinearForm(structure.reduced.pool, unknowns)
    sums = [(r, x) for r in rows if (x := _sum(form, structure.residuals[r]))[1]]
    done = eliminate(structure.points, [x[1] for _, x in sums], [x[0] for _, x in sums])
    return {sums[i][0]: rest for i, rest in done.empty} or _substituted(structure, rows, unknowns)


def _substituted(structure: Structure, rows: Sequence[int], unknowns: set[int]) -> dict[int, int]:
    """What is left of nonlinear equations when linear ones tell all that they know of the unknowns, by row.

    `v == a - b` and `q == C (a - b) (1 + (a - b)**2)`: the unknowns stand in both as one difference.
    """
    pool = structure.reduced.pool
    known: dict[int, int] = {}

    def image(node: int) -> int:
        done: dict[int, int] = {}
        for number in pool.reachable([node]):
            op, *operands = pool.nodes[number]
            if op == "var":
                done[number] = known.get(operands[0], number)
            elif op in LEAVES:
                done[number] = number
            else:
                made = pool.make(op, *[done[c] for c in operands])
                done[number] = pool.collected(made) if op in SUMS else made
        return done[node]

    form, found = LinearForm(pool, unknowns), dict[int, int]()
    # an equation without unknowns is a constraint that everybody sees
    rows = [r for r in rows if pool.variables_in(structure.residuals[r]) & unknowns]
    for r in sorted(rows, key=lambda r: form.of(structure.residuals[r]) is None):
        left = image(structure.residuals[r])
        if not pool.variables_in(left) & unknowns:
            found[r] = left
            continue
        linear = form.of(left)
        if linear is None:
            continue
        numbers = {v: pool.value(c) for v, c in linear[1].items()}
        pivot = next((v for v, c in numbers.items() if c in (1.0, -1.0)), None)
        if pivot is not None:
            own = pool.neg(pool.mul(linear[1][pivot], pool.sub(left, pool.mul(linear[1][pivot], pool.var(pivot)))))
            known[pivot] = pool.collected(own)
            known.update({v: image(node) for v, node in known.items()})
    return found


def _sums(structure: Structure, rows: Iterable[int], unknowns: set[int]) -> dict[int, int]:
    """The same for combinations with constant factors, exactly."""
    pool = structure.reduced.pool
    own: dict[int, Row] = {}
    for r in rows:
        own[r] = {}
        add_terms(pool, structure.residuals[r], 1, own[r])
    inside = {r: {n: w for n, w in row.items() if pool.variables_in(n) & unknowns} for r, row in own.items()}
    found = {}
    for combination in null_combinations({r: row for r, row in inside.items() if row}):
        rest = combined([(w, own[r]) for r, w in combination.items()])
        found[next(iter(combination))] = pool.sum(pool.mul(pool.const(float(w)), n) for n, w in rest.items())
    return found


def _sum(form: LinearForm, root: int) -> Linear:
    """Rest and coefficients of the unknowns, and of terms that are not linear in them: -1 - k for node k."""
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
            known = [x is not None and not x[1] for x in map(form.of, args)]
            if op == "mul" and any(known):
                stack.append((args[known[0]], pool.mul(factor, args[not known[0]])))
                continue
            if op == "div" and known[1]:
                stack.append((args[0], pool.div(factor, args[1])))
                continue
            linear = pool.zero, {-1 - number: pool.one}
        rest = pool.add(rest, pool.mul(factor, linear[0]))
        for v, c in linear[1].items():
            total[v] = pool.add(total.get(v, pool.zero), pool.mul(factor, c))
    return rest, {v: c for v, c in total.items() if c != pool.zero}


def _differentiated(structure: Structure, block: Block) -> dict[int, int]:
    """A constraint that is left of equations of which some are derivatives, in place of one that is not.

    `x + t y = q(t)` differentiated and `x' + t y' + 2 y = p(t)` have the same left side in x' and y'. What is left may
    stand for any equation with a share in it: the derivatives follow from the constraints they were taken of.
    """
    count = len(structure.reduced.residuals)
    rests = list(_rests(structure, block.rows, set(block.columns)).values())
    place = {v: k for k, v in enumerate(block.columns)}
    jacobian = np.zeros((len(block.rows), len(place)))
    residuals = [structure.residuals[r] for r in block.rows]
    for i, row in enumerate(gradients(structure.reduced.pool, residuals, block.columns, structure.points.leaves)):
        for v, slope in row.items():
            jacobian[i, place[v]] = np.broadcast_to(slope, (COUNT,))[1]
    if len(rests) != 1 or not np.isfinite(jacobian).all():
        return {}
    left, sizes, _ = np.linalg.svd(jacobian)
    if len(sizes) > 1 and sizes[-2] <= 1e-9 * sizes[0]:
        return {}
    shares = {r: abs(left[i, -1]) for i, r in enumerate(block.rows) if r < count}
    best = max(shares, key=shares.__getitem__, default=None)
    return {} if best is None or shares[best] < 1e-6 else {best: rests[0]}


def _highest(reduced: ReducedSystem) -> set[int]:
    """Variables of the undifferentiated equations without states and inputs."""
    pool = reduced.pool
    found = pool.variables_in(*reduced.residuals)
    states = {pool.integral_of[v] for v in found if v in pool.integral_of}
    return set(found - states - set(reduced.inputs))


def _in_flat(reduced: ReducedSystem, node: int) -> int:
    """A node of the reduced system in the pool of the flat one."""
    pool = reduced.flat.pool

    def scalar(variable: int) -> int:
        if variable < len(reduced.scalar):
            return reduced.scalar[variable]
        return pool.derivative(scalar(reduced.pool.integral_of[variable]))

    return transferred(reduced.pool, node, pool, scalar)
