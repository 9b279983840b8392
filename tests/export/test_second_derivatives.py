"""First and second derivatives of what shipped models export: numbers at the start and around it, never nan."""

from __future__ import annotations

import importlib

import casadi as ca
import numpy as np
import pytest

import acausal
from acausal.cli.shipped import shipped_models
from acausal.errors import AcausalError

# Second derivatives of these take half a minute and more to build.
LARGE = {"BoxStack", "FeketePoints", "HolesSideBySide"}
# What events change is no function of one instant, nor what was before (AC608, AC035).
REFUSED = ("AC608", "AC035")


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted({m.name for m in shipped_models()} - LARGE))
def test_derivatives_are_numbers(name: str) -> None:
    """By states, algebraic variables, inputs and parameters, at points at which the functions are numbers."""
    shipped = next(m for m in shipped_models() if m.name == name)
    model = getattr(importlib.import_module(shipped.module), name)()
    try:
        exported = acausal.compile(model).casadi()
    except AcausalError as error:
        if error.code not in REFUSED:
            raise
        return
    parts = exported.x, exported.z, exported.u, exported.p
    lengths = np.cumsum([0, *(len(part) for part in parts)]).tolist()
    at = ca.MX.sym("at", lengths[-1])
    given = dict(zip("xzup", ca.vertsplit(at, lengths), strict=True))
    if "t" in exported.dae.name_in():
        given["t"] = ca.MX(exported.start_time)
    results = exported.dae(**given)
    found = ca.vertcat(*(results[name] for name in exported.dae.name_out()))
    weights = ca.MX.sym("weights", found.numel())
    gradient = ca.gradient(ca.dot(weights, found), at)
    function = ca.Function("f", [at, weights], [found, ca.jacobian(found, at), ca.jacobian(gradient, at)])
    start = np.concatenate([part.start for part in parts])
    sizes = np.concatenate([*(part.nominal for part in parts[:3]), np.zeros(len(parts[3]))])
    random, used = np.random.default_rng(1), 0
    for reach in (0.0, 1e-3, 0.1):
        point = start + reach * sizes * random.standard_normal(len(start))
        values, *derivatives = function(point, random.standard_normal(found.numel()))
        if values.is_regular():
            used += 1
            assert [d.is_regular() for d in derivatives] == [True, True]
    assert used
