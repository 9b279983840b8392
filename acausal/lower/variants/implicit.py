"""Equations of which monotone blocks have the derivatives of the implicit function theorem.

The unknown of a monotone block is solved for by Newton steps, written out. The derivatives of all of them are those of
one more step from the solution, which is a symbol here, as is the slope of the block: a fifth of the operations.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import casadi as ca

from acausal.lower.compiled import CompiledModel


class Differentiable(NamedTuple):
    """Rates and residuals with the derivatives of the model; `symbols` in them stand for `values`, columns of SX."""

    rates: Any
    residuals: Any
    symbols: Any
    values: Any

    @property
    def is_shorter(self) -> bool:
        """Whether the derivatives are shorter than those of the equations of the model."""
        return bool(self.symbols.numel())

    def jacobian(self, value: Any, by: Any) -> Any:
        """The Jacobian, without the symbols, of a value that depends on them as the equations do."""
        found = ca.jacobian(value, by)
        return ca.SX(found.sparsity(), ca.substitute(found.nz[:], self.symbols, self.values))


def differentiable(compiled: CompiledModel, at: Sequence[Any]) -> Differentiable:
    """The equations at `at`, the SX arguments (t, x, z, u, p, m) of the model."""
    rates, residuals = compiled.rhs(*at)
    nothing, searched = ca.SX(0, 1), compiled.solution.monotone
    if not searched or compiled.varied:
        return Differentiable(rates, residuals, nothing, nothing)
    t, x, z, *rest = at
    nz, solution, slope = len(compiled.algebraic), ca.SX.sym("v", len(searched)), ca.SX.sym("g", len(searched))

    def opened(v: Any) -> tuple[Any, Any, Any]:
        ode, alg = compiled.opened.rhs(t, x, ca.vertcat(z, v), *rest)
        return ode, alg[:nz], alg[nz:]

    by_solution = ca.jacobian(opened(solution)[2], solution)
    if not by_solution.sparsity().is_tril():
        return Differentiable(rates, residuals, nothing, nothing)
    stepped = ca.SX(solution)
    for k in range(len(searched)):  # later blocks depend on earlier ones
        stepped[k] -= opened(stepped)[2][k] / slope[k]
    ode, alg, _ = opened(stepped)
    found = compiled.searched(*at)
    numbers = ca.vertcat(found, ca.substitute(ca.diag(by_solution), solution, found))
    return Differentiable(ode, alg, ca.vertcat(solution, slope), numbers)
