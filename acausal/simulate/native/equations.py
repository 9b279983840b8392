"""The equations with free parameters, as compiled code needs them.

An interpreted run has its parameters as numbers in the expressions. A library outlives the run: there they are
arguments, but what they alone determine is still computed once per run, by a function of its own, so that the
right-hand side does not do more work. Source of the split: CasADi's `extract_parametric`.

Parameters that are zero in a run are zero in its library, and other values mean another library: half of a link's
parameters are components of vectors along an axis, which with all their products are worth a third of the equations.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca

from acausal.lower.compiled import CompiledModel

CONSTANTS = "constants"
"""Name of the function `(p, u) -> c` in a library: all that parameters and inputs alone determine."""
HELD = "determined"
"""Name of the function of what parameters, modes and discrete variables alone determine."""
# Instructions up to which C of every instance is compiled in seconds; it keeps values in registers, and runs 1.2 times
# as fast as columns, which are in memory.
_LARGEST_FLAT = 10_000


def by_patterns(compiled: CompiledModel) -> bool:
    """Whether C is made of columns rather than of every instance, where the model has any."""
    return bool(compiled.rhs.n_instructions() > _LARGEST_FLAT)


def equations(compiled: CompiledModel, zeros: Sequence[int] = ()) -> tuple[Any, Any]:
    """`(t, x, z, [c, m, d, shift], u) -> (ode, alg, quad, zero)`, scaled as in `Problem`, and `(p, u) -> c`.

    `zeros` are the indices of parameters that are zero, whatever p holds.
    """
    form = compiled.mapped(tuple(zeros)) if by_patterns(compiled) else None
    if form is not None:
        return form.dae(compiled.nominal_x[: compiled.n_dynamic], compiled.nominal_z), form.constants
    n, nq, nd = compiled.n_dynamic, compiled.quadratures, compiled.discretes
    scale_x, scale_z = ca.DM(compiled.nominal_x[:n]), ca.DM(compiled.nominal_z)
    t, x, z = ca.SX.sym("t"), ca.SX.sym("x", n), ca.SX.sym("z", len(compiled.algebraic))
    p, u = ca.SX.sym("p", len(compiled.parameters)), ca.SX.sym("u", len(compiled.inputs))
    m, d, shift = ca.SX.sym("m", compiled.rhs.numel_in("m")), ca.SX.sym("d", nd), ca.SX.sym("shift")
    full = ca.vertcat(x * scale_x, ca.SX(nq, 1), d)
    some = ca.SX(p)
    for k in zeros:
        some[k] = 0
    ode, alg = (ca.densify(e) for e in compiled.rhs(t + shift, full, z * scale_z, u, some, m))
    (ode, alg), symbols, constants = parametric([ode[:n] / scale_x, alg], p, u)
    none = ca.SX(0, 1)
    dae = ca.Function(
        "dae",
        [t, x, z, ca.vertcat(symbols, m, d, shift), ca.SX.sym("none", 0)],
        [ode, alg, none, none],
        ["t", "x", "z", "p", "u"],
        ["ode", "alg", "quad", "zero"],
    )
    return dae, constants


def parametric(expressions: Sequence[Any], p: Any, u: Any, name: str = CONSTANTS) -> tuple[list[Any], Any, Any]:
    """Expressions in which symbols stand for what p and u alone determine; the symbols; and `(p, u) -> values`.

    `name`: Of that function.
    """
    rest, names, values = ca.extract_parametric(list(expressions), ca.vertcat(p, u), {"extract_trivial": True})
    symbols, held = (ca.vertcat(*parts) if parts else ca.SX(0, 1) for parts in (names, values))
    # What goes into a call may refer to what was extracted before.
    while names and ca.depends_on(held, symbols):
        held = ca.substitute(held, symbols, held)
    return rest, symbols, ca.Function(name, [p, u], [held], {"cse": True})
