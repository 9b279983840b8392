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

from collections.abc import Iterable

import numpy as np

from acausal.errors import StructureError
from acausal.lower.analyse import Structure
from acausal.lower.elimination import eliminate
from acausal.lower.evaluate import gradients
from acausal.lower.linear import LinearForm
from acausal.lower.reduce import ReducedSystem
from acausal.lower.samples import COUNT
from acausal.structure import Block


class HiddenConstraint(StructureError):
    """The message for those who do not go on; `equations` are flat equations with the nodes that can replace them."""

    equations: dict[int, int]


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
        return error  # nothing, or a number that would have to be zero
    hidden = HiddenConstraint(
        error.code, error.fact, where=error.where, evidence=error.evidence, cause=error.cause, help=error.help
    )
    hidden.equations = {structure.reduced.equation[r]: _in_flat(structure.reduced, rest) for r, rest in rests.items()}
    return hidden


def _rests(structure: Structure, rows: Iterable[int], unknowns: set[int]) -> dict[int, int]:
    """What is left of linear equations in which the unknowns cancel when others are added, by row."""
    form = LinearForm(structure.reduced.pool, unknowns)
    linear = [(r, x) for r in rows if (x := form.of(structure.residuals[r])) is not None and x[1]]
    done = eliminate(structure.points, [x[1] for _, x in linear], [x[0] for _, x in linear])
    return {linear[i][0]: rest for i, rest in done.empty}


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
    return found - states - set(reduced.inputs)


def _in_flat(reduced: ReducedSystem, node: int) -> int:
    """A node of the reduced system in the pool of the flat one."""
    old, new = reduced.pool, reduced.flat.pool
    done: dict[int, int] = {}
    for number in old.reachable([node]):
        op, *operands = old.nodes[number]
        if op == "var":
            done[number] = new.var(_scalar(reduced, operands[0]))
        elif op in ("const", "par", "time"):
            done[number] = new.intern(old.nodes[number])
        else:
            done[number] = new.make(op, *[done[c] for c in operands])
    return done[node]


def _scalar(reduced: ReducedSystem, variable: int) -> int:
    if variable < len(reduced.scalar):
        return reduced.scalar[variable]
    return reduced.flat.pool.derivative(_scalar(reduced, reduced.pool.integral_of[variable]))
