"""Iterations that end early, as CasADi Functions: without a callback, and generated as C.

CasADi has no `while`. A chain of calls, each inside the branch of the one before, stops where the state says that it is
done; a plain unrolled loop would pay for all iterations every time.
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
        # Index 0 goes on, anything else ends.
        ended = ca.if_else(state[going] > 0, 0, 1)
        chain = ca.Function(f"{name}_chain_{k}", [state, data], [switch(ended, state, data)], _CALL)
    return chain


def frozen(name: str, inputs: list[Any], output: Any) -> Any:
    """A Function that stays one call in SX graphs and whose derivatives are zero."""
    plain = ca.Function(f"{name}_value", inputs, [output])
    arguments = [ca.MX.sym(f"i{k}", plain.sparsity_in(k)) for k in range(plain.n_in())]
    nothing = [ca.MX(plain.numel_out(0), plain.numel_in(k)) for k in range(plain.n_in())]
    names = [f"i{k}" for k in range(plain.n_in())]
    derivative = ca.Function(
        f"jac_{name}",
        [*arguments, ca.MX.sym("out", plain.sparsity_out(0))],
        nothing,
        [*names, "out_o"],
        [f"jac_o_{n}" for n in names],
    )
    return ca.Function(name, arguments, [plain(*arguments)], names, ["o"], {**_CALL, "custom_jacobian": derivative})


_CALL = {"never_inline": True}
