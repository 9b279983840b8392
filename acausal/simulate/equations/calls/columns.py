"""A function of one instant as operations on columns of many.

CasADi's interpreter takes 4 ns for an operation on a number, most of it to find out which one it is. On a column of a
thousand numbers it finds out once. The operations are the same, in the same order, so results are equal to the last
bit: 10 001 rows of a signal of 55 operations take 0.2 ms instead of 2.9.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca

MOST_OPERATIONS = 20_000
"""More take longer to write out than is gained in the rows of most runs."""


def by_columns(function: Any, n: int, common: Sequence[int]) -> Any | None:
    """The first output, shape (n, size), at n instants; None where operations are no plain ones.

    Arguments have shape (n, size), those at the places `common` are one column for all instants.
    """
    if not function.is_a("SXFunction") or function.n_instructions() > MOST_OPERATIONS:
        return None
    sizes = [function.numel_in(k) for k in range(function.n_in())]
    inputs = [ca.MX.sym(f"a{k}", *((size, 1) if k in common else (n, size))) for k, size in enumerate(sizes)]
    entries = [ca.vertsplit(v) if k in common else ca.horzsplit(v) for k, v in enumerate(inputs)]
    values: dict[int, Any] = {}
    found: list[Any] = [ca.MX.zeros(n)] * function.numel_out(0)
    for k in range(function.n_instructions()):
        operation, own = function.instruction_id(k), function.instruction_input(k)
        (place, *rest) = function.instruction_output(k)
        if operation == ca.OP_INPUT:
            values[place] = entries[own[0]][own[1]]
        elif operation == ca.OP_CONST:
            values[place] = ca.MX(function.instruction_constant(k))
        elif operation == ca.OP_OUTPUT:
            if place == 0:
                value = values[own[0]]
                found[rest[0]] = ca.repmat(value, n, 1) if value.numel() == 1 else value
        elif operation == ca.OP_CALL:  # of a table, or of another external function
            return None
        elif len(own) == 1:
            values[place] = ca.MX.unary(operation, values[own[0]])
        elif len(own) == 2:
            values[place] = ca.MX.binary(operation, values[own[0]], values[own[1]])
        else:
            return None
    return ca.Function("columns", inputs, [ca.densify(ca.horzcat(*found))])
