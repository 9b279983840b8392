"""Jacobians of equations with monotone blocks, in the place of those that CasADi derives for an integrator.

CasADi differentiates all Newton steps of a block. The derivatives of one step from the solution are the same
(`acausal/lower/variants/implicit.py`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca

from acausal.lower.variants.implicit import Differentiable

_NAME = "jacobian"
CALL = (
    r"(case IVP_EVAL_JAC:\n(?:.*\n)*?.*if \()casadi_f\d+(\(sarg, sres, iw, w, 0\)\))",
    rf"\g<1>{_NAME}\g<2>",
)
"""The call of the Jacobian in a generated integrator, and the call that replaces it; see `_INTEGRATOR` of source.py."""


def jacobian(slopes: Differentiable, inputs: Sequence[Any], rates: Any, values: Any) -> Any:
    """The function `(t, x, z, p, u) -> (jac_ode_x, jac_ode_t)` of an ODE with these `rates`, which contain symbols.

    `values` are those of the symbols of `slopes`.
    """
    t, x, *_ = inputs
    own = slopes._replace(values=values)
    return ca.Function(
        _NAME,
        list(inputs),
        [own.jacobian(rates, x), own.jacobian(rates, t)],
        ["t", "x", "z", "p", "u"],
        ["jac_ode_x", "jac_ode_t"],
        {"cse": True},
    )


def as_derived(own: Any, derived: Any) -> Any:
    """`own` with the signature and the sparsities of the function `derived` by CasADi; None if it has more entries."""
    inputs = own.sx_in()
    found = dict(zip(own.name_out(), own.call(inputs), strict=True))
    results = []
    for name in derived.name_out():
        pattern = derived.sparsity_out(name)
        result = found.pop(name, ca.SX(*pattern.shape))
        if not result.sparsity().is_subset(pattern):
            return None
        results.append(ca.project(result, pattern))
    return None if found else ca.Function(_NAME, inputs, results, own.name_in(), derived.name_out(), {"cse": True})
