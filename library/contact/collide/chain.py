"""Iterations with early termination as CasADi Functions, without a callback, so that C code can be generated.

CasADi has no `while`. A chain of calls, each inside a branch of the previous one, stops as soon as the state says that
the iteration has finished; a plain unrolled loop would always run all iterations.
"""

from __future__ import annotations

from typing import Any

import casadi as ca


def repeat(step: Any, going: int, most: int) -> Any:
    """`(state, data) -> state`: `step` applied while the entry `going` of the state is positive, at most `most` times.

    `step` is a Function `(state, data) -> state`.
    """
    name = step.name()
    state, data = ca.MX.sym("state", step.size1_in(0)), ca.MX.sym("data", step.size1_in(1))
    same = ca.Function(f"{name}_end", [state, data], [state])
    chain = same
    for k in range(most):
        inner = ca.Function(f"{name}_{k}", [state, data], [chain(step(state, data), data)], _CALL)
        switch = ca.Function.conditional(f"{name}_switch_{k}", [inner], same)
        # Case 0 continues, any other ends the iteration.
        ended = ca.if_else(state[going] > 0, 0, 1)
        chain = ca.Function(f"{name}_chain_{k}", [state, data], [switch(ended, state, data)], _CALL)
    return chain


def frozen(name: str, function: Any) -> Any:
    """A Function of the same inputs and output that stays one call in SX graphs and has zero derivatives.

    The derivative of `floor` is zero, so that nothing of `function` is differentiated; the inputs lose no more than
    rounding errors. SX calls misread derivatives that have no entries at all (CasADi 3.8 returns garbage without an
    error), hence a term that survives differentiation of any order and is too small to change anything.
    """
    arguments = [ca.MX.sym(f"i{k}", function.sparsity_in(k)) for k in range(function.n_in())]
    value = function(*(ca.floor(a * _FINE) / _FINE for a in arguments))
    trace = _NOTHING * ca.sin(sum((ca.sum1(ca.vec(a)) for a in arguments), ca.MX(0)))
    return ca.Function(name, arguments, [value + trace], _CALL)


_FINE = 2.0**51
_NOTHING = 1e-200

_CALL = {"never_inline": True}
