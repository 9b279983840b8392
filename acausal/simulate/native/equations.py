"""The equations with parameters as arguments, for compiled code.

An interpreted run has its parameters as numbers in the expressions. A library outlives the run, so its parameters are
arguments. Values that they alone determine are still computed once per run, by a separate function, so that the
right-hand side does no additional work. The split is made by CasADi's `extract_parametric`.

Parameters that are zero in a run are zero in its library, and other zeros need another library: half of a link's
parameters are components of vectors along an axis, and with all their products they make up a third of the equations.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca

from acausal.lower.compiled import CompiledModel
from acausal.lower.variants.implicit import differentiable
from acausal.simulate.native.jacobian import jacobian

CONSTANTS = "constants"
"""Name of the function `(p, u) -> c` in a library: the values that parameters and inputs alone determine."""
HELD = "determined"
"""Name of the function for values that parameters, modes and discrete variables alone determine."""
# Up to this many instructions, C with all instances written out compiles in seconds. It keeps values in registers, and
# runs 1.2 times as fast as columns, which are in memory.
_LARGEST_FLAT = 10_000


def by_patterns(compiled: CompiledModel) -> bool:
    """Whether C is generated with columns rather than with all instances written out, if the model has columns."""
    return bool(compiled.rhs.n_instructions() > _LARGEST_FLAT)


def equations(compiled: CompiledModel, zeros: Sequence[int] = ()) -> tuple[Any, Any]:
    """`(t, x, z, [c, m, d, shift], u) -> (ode, alg, quad, zero)`, scaled as in `Problem`, and `(p, u) -> c`.

    Parameters with indices in `zeros` are zero, whatever p contains.
    """
    form = compiled.mapped(tuple(zeros)) if by_patterns(compiled) else None
    if form is not None:
        return form.dae(compiled.nominal_x[: compiled.n_dynamic], compiled.nominal_z), form.constants
    dae, constants, _ = _written_out(compiled, zeros, is_differentiated=False)
    return dae, constants


def differentiated(compiled: CompiledModel, zeros: Sequence[int] = ()) -> tuple[Any, Any, Any]:
    """The results of `equations`, and a Jacobian as in `jacobian.py`, or None."""
    if compiled.algebraic or not compiled.solution.monotone or by_patterns(compiled):
        return *equations(compiled, zeros), None
    return _written_out(compiled, zeros, is_differentiated=True)


def _written_out(compiled: CompiledModel, zeros: Sequence[int], *, is_differentiated: bool) -> tuple[Any, Any, Any]:
    n, nq, nd = compiled.n_dynamic, compiled.quadratures, compiled.discretes
    scale_x, scale_z = ca.DM(compiled.nominal_x[:n]), ca.DM(compiled.nominal_z)
    t, x, z = ca.SX.sym("t"), ca.SX.sym("x", n), ca.SX.sym("z", len(compiled.algebraic))
    p, u = ca.SX.sym("p", len(compiled.parameters)), ca.SX.sym("u", len(compiled.inputs))
    m, d, shift = ca.SX.sym("m", compiled.rhs.numel_in("m")), ca.SX.sym("d", nd), ca.SX.sym("shift")
    full = ca.vertcat(x * scale_x, ca.SX(nq, 1), d)
    p_with_zeros = ca.SX(p)
    for k in zeros:
        p_with_zeros[k] = 0
    at = t + shift, full, z * scale_z, u, p_with_zeros, m
    ode, alg = (ca.densify(e) for e in compiled.rhs(*at))
    slopes = differentiable(compiled, at) if is_differentiated else None
    for_slopes = [] if slopes is None else [slopes.rates[:n, 0] / scale_x, slopes.values]
    (ode, alg, *for_slopes), symbols, constants = parametric([ode[:n, 0] / scale_x, alg, *for_slopes], p, u)
    none = ca.SX(0, 1)
    inputs = [t, x, z, ca.vertcat(symbols, m, d, shift), ca.SX.sym("none", 0)]
    outputs = ["ode", "alg", "quad", "zero"]
    dae = ca.Function("dae", inputs, [ode, alg, none, none], ["t", "x", "z", "p", "u"], outputs)
    if slopes is None or not slopes.is_shorter:
        return dae, constants, None
    return dae, constants, jacobian(slopes, inputs, *for_slopes)


def parametric(expressions: Sequence[Any], p: Any, u: Any, name: str = CONSTANTS) -> tuple[list[Any], Any, Any]:
    """Replace subexpressions that p and u alone determine by symbols.

    Returns the expressions, the symbols, and the function `(p, u) -> values` of the symbols, called `name`.
    """
    rest, names, values = ca.extract_parametric(list(expressions), ca.vertcat(p, u), {"extract_trivial": True})
    symbols, held = (ca.vertcat(*parts) if parts else ca.SX(0, 1) for parts in (names, values))
    # arguments of a call may refer to symbols that were extracted before
    while names and ca.depends_on(held, symbols):
        held = ca.substitute(held, symbols, held)
    return rest, symbols, ca.Function(name, [p, u], [held], {"cse": True})
