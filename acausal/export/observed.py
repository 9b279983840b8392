"""Equations and outputs of a model as CasADi functions of a point."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca

from acausal.export.casadi.finite import finite
from acausal.export.ports import Output
from acausal.lower.build import Symbols
from acausal.lower.compiled import CompiledModel


def dae_function(compiled: CompiledModel, outputs: Sequence[Output]) -> Any:
    """Function `(t, x, z, u, p) -> (ode, alg, y)`; its modes follow from the point.

    Its derivatives are finite wherever its values are, see `finite`.
    """
    s = Symbols(compiled)
    y = observed_function(compiled, outputs)
    arguments = [s.t, s.x, s.z, s.u, s.p]
    modes = compiled.all_modes(*arguments)
    results = [*compiled.rhs(*arguments, modes), y(*arguments, modes)]
    names = ["t", "x", "z", "u", "p"], ["ode", "alg", "y"]
    return finite(ca.Function("dae", arguments, [ca.densify(v) for v in results], *names))


def observed_function(compiled: CompiledModel, outputs: Sequence[Output]) -> Any:
    """Function `(t, x, z, u, p, m) -> y`: the outputs, with given modes m."""
    s = Symbols(compiled)
    image = compiled.solution.structure.reduced.image
    builder = s.builder(compiled)
    nodes = [image[output.scalar] for output in outputs]
    builder.define(_definitions(compiled, nodes), compiled.rewritten)
    observed = builder.lower(builder.replaced(nodes))
    return ca.Function("y", s.inputs, [ca.vertcat(*observed) if observed else ca.SX(0, 1)])


def _definitions(compiled: CompiledModel, nodes: Sequence[int]) -> list[tuple[int, int]]:
    """The definitions that `nodes` need, in evaluation order."""
    pool = compiled.solution.structure.reduced.pool
    needed = pool.variables_behind(nodes, dict(compiled.solution.definitions))
    return [d for d in compiled.solution.definitions if d[0] in needed]
