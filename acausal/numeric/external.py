"""CasADi functions of the external functions of the language, called on scalars in row-major order."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from acausal.errors import DeclarationError, Span
from acausal.language.expressions.expression import Shape, shape_text
from acausal.language.expressions.external import External
from acausal.language.expressions.lookup import Lookup
from acausal.recent import once_per_owner

# Classes of CasADi functions that are expressions and numbers.
_SELF_CONTAINED = frozenset(("SXFunction", "MXFunction", "Map", "Switch", "LinearInterpolant", "BSplineInterpolant"))


@once_per_owner
def function(external: External) -> Any:
    """The CasADi Function of an external function, or of its partial derivatives.

    Raises
    ------
    DeclarationError
        AC163 when the factory raises, or does not return a function with the declared inputs and outputs.
    """
    if isinstance(external, Lookup):
        return _make_lookup(external)
    return _make_declared(external) if external.primal is None else _make_jacobian(external.primal)


def is_self_contained(function: Any) -> bool:
    """Whether a CasADi function contains all that it computes: it calls neither Python nor a library.

    Then its serialisation determines its values, and C can be generated that needs nothing else.
    """
    return {f.class_name() for f in (function, *function.find_functions())} <= _SELF_CONTAINED


def call(external: External, operands: Sequence[Any]) -> list[Any]:
    """SX of every scalar output for SX operands."""
    results = function(external).call(list(_matrices(external.inputs, ca.vertcat(*operands))), False, False)
    column = ca.vertcat(*map(_rows, results))
    return [column[k] for k in range(column.numel())]


def evaluate(external: External, operands: Sequence[Any]) -> NDArray[np.float64]:
    """Values of every scalar output, shape (n_outputs, K); each operand is a number or an array of shape (K,)."""
    points = np.broadcast_arrays(*(np.atleast_1d(np.asarray(a, dtype=float)) for a in operands))
    f = function(external)
    outputs = []
    for column in np.stack(points, axis=1):
        results = f.call(list(_matrices(external.inputs, ca.DM(column))))
        outputs.append(np.concatenate([np.asarray(r.full()).ravel() for r in results]))
    return np.stack(outputs, axis=1)


def _matrices(shapes: Sequence[Shape], column: Any) -> Iterator[Any]:
    """The inputs as matrices, from one column of scalars in row-major order."""
    first = 0
    for shape in shapes:
        rows, columns = (*shape, 1, 1)[:2]
        yield ca.reshape(column[first : first + rows * columns], columns, rows).T
        first += rows * columns


def _rows(matrix: Any) -> Any:
    """Entries row by row, as a column."""
    return ca.vec(ca.densify(matrix).T)


def _make_declared(external: External) -> Any:
    """The function that the factory returns, if it has the declared shapes."""
    code = getattr(external.factory, "__code__", None)
    where = () if code is None else (Span(code.co_filename, code.co_firstlineno),)
    try:
        f = external.factory()
    except Exception as error:
        fact = f"the factory of {external.name} raised {type(error).__name__}: {error}"
        raise DeclarationError("AC163", fact, where=where) from error
    if not isinstance(f, ca.Function):
        raise DeclarationError(
            "AC163",
            f"the factory of {external.name} returns a {type(f).__name__}",
            where=where,
            help="it returns a casadi.Function: x = casadi.SX.sym('x'); return casadi.Function('f', [x], [x**2])",
        )
    shapes_made = [[f.size_in(k) for k in range(f.n_in())], [f.size_out(k) for k in range(f.n_out())]]
    shapes_declared = [[(*s, 1, 1)[:2] for s in shapes] for shapes in (external.inputs, external.outputs)]
    if shapes_made != shapes_declared:
        raise DeclarationError(
            "AC163",
            f"the factory of {external.name} makes a function that differs from its declaration",
            where=where,
            evidence=[
                f"declared: {', '.join(map(shape_text, external.inputs))} -> "
                + ", ".join(map(shape_text, external.outputs)),
                f"made:     {f}",
            ],
            help="one input or output of the CasADi Function for each shape, vectors as columns",
        )
    return f


def _make_lookup(external: Lookup) -> Any:
    """Table lookup: binary search for the segment, then Horner's scheme.

    The function is never inlined, so that the table is stored once, however often it is used.
    """
    u = ca.MX.sym("u")
    segment = ca.low(ca.DM(external.breaks), u, {"lookup_mode": "binary"})
    columns = [ca.MX(ca.DM(c)) for c in zip(*external.coefficients, strict=True)]
    if len(columns) == 1:
        # CasADi would treat a step function as independent of u, because it has no derivative, and drop arguments such
        # as the time on which only steps depend. A slope of zero avoids this, and it propagates a u that is nan.
        columns.append(ca.MX(ca.DM([0.0] * len(external.coefficients))))
    s = u - ca.MX(ca.DM(external.breaks))[segment]
    y = columns[-1][segment]
    for column in columns[-2::-1]:
        y = column[segment] + s * y
    return ca.Function(external.name, [u], [y], ["u"], ["y"], {"never_inline": True})


def _make_jacobian(primal: External) -> Any:
    """Partial derivatives of all scalar outputs by all scalar inputs, both in row-major order."""
    inputs = [ca.SX.sym(f"i{k}", *(*s, 1, 1)[:2]) for k, s in enumerate(primal.inputs)]
    results = function(primal).call(inputs, False, False)
    # CasADi orders the inputs column by column; reorder the derivatives row by row.
    jacobian = ca.jacobian(ca.vertcat(*map(_rows, results)), ca.veccat(*inputs))
    order = _rows_first(primal.inputs)
    return ca.Function(f"d_{primal.name}", inputs, [ca.densify(jacobian[:, order])])


def _rows_first(shapes: Sequence[Shape]) -> list[int]:
    """Column-major index of each entry of the inputs, in row-major order."""
    column_major: list[int] = []
    for shape in shapes:
        size = int(np.prod(shape))
        grid = np.arange(len(column_major), len(column_major) + size)
        column_major += grid.reshape(shape, order="F").ravel().tolist()
    return column_major
