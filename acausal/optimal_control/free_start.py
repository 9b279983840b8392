"""Free start values: what follows from them must be free as well, and stay on the constraints of the model."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from acausal.errors import AcausalError, UsageError, calling_span
from acausal.export.start_point import start_point
from acausal.lower.build import Symbols
from acausal.lower.variants.started import with_starts
from acausal.optimal_control.quantities import Quantities

# By this fraction of its magnitude a start value is moved; others follow if they move by more than a thousandth of it.
_STEP, _FOLLOWS = 1e-3, 1e-3


def refuse_dependents(q: Quantities, free: Sequence[int]) -> None:
    """AC053 for free start values, by their places in q.x, from which those of other states follow.

    The program would keep them: an equation of the start, or a loop of joints, would not hold.
    """
    if all(v in q.model.start.direct for v in q.model.state_variables):
        return
    for k in free:
        name, size = q.x.names[k], max(abs(float(q.first[k])), q.x[k].nominal)
        if name not in q.states.names:  # an angle, from which states follow
            continue
        try:
            moved = start_point(with_starts(q.model, {name: float(q.first[k]) + _STEP * size}), q.p)
        except AcausalError:
            continue
        if set(moved.notes) - set(q.begin.notes):  # the others determine this one
            continue
        change = np.abs(q.coordinates.of(moved.x[:, None]).ravel() - q.first) / np.maximum(abs(q.first), q.x.nominal)
        others = [q.x.names[j] for j in np.flatnonzero(change > _FOLLOWS * _STEP) if j not in free]
        if others:
            raise UsageError(
                "AC053",
                f"{', '.join(others)} at the start follow from {name}, which is free: they would keep their values",
                where=calling_span(),
                help=f"free_start={[q.x.names[j] for j in free] + others}, and state equations of the start once more: "
                "problem.subject_to(problem.start(a) == 2 * problem.start(b)); loops of joints stay closed",
            )


def start_residual(q: Quantities, free: Sequence[int]) -> Any:
    """Function `(t, x, z, u, p) -> g`: constraints of the model that free start values may violate; None without."""
    if not free or q.coordinates.complete or not q.compiled.solution.structure.invariants:
        return None
    arguments = Symbols(q.compiled).inputs[:-1]
    g = q.compiled.constraints(*arguments, q.compiled.all_modes(*arguments))[0]
    residual = q.coordinates.inside(ca.Function("constraints", arguments, [ca.densify(g)]))
    rows, columns = np.array(residual.jac_sparsity(0, 1).get_triplet())
    rows = np.unique(rows[np.isin(columns, list(free))]).tolist()
    point = [ca.SX.sym(residual.name_in(k), residual.numel_in(k)) for k in range(5)]
    return ca.Function("constraints", point, [residual(*point)[rows]]) if rows else None
