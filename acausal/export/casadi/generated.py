"""Functions as CasADi can write them as C: rootfinders by `fast_newton`, which is the one that generates.

A rootfinder is found in the graph of an MX function, and its call replaced by one of another rootfinder for the same
residuals. Functions that are called are treated the same. Nothing else changes: the numbers are those of the original
to the tolerance of Newton's method, which here takes full steps.
"""

from __future__ import annotations

import math
from typing import Any

import casadi as ca

from acausal.export.casadi.parts import NEWTON

# Another step of Newton's method, in units of nominal magnitudes, that says that the last one was none to be trusted.
_SETTLED = 1e-7
_OPTIONS = {k: NEWTON[k] for k in ("abstol", "abstolStep", "max_iter", "error_on_fail")}


def generated(function: Any, known: dict[int, Any] | None = None) -> Any:
    """The same function without rootfinders that do not generate; itself where there is none.

    `known` keeps replacements, so that a function that is called several times stays one.
    """
    known = {} if known is None else known
    if not _holds_rootfinder(function):
        return function
    key = function.__hash__()
    if key not in known:
        known[key] = _replaced(function, known)
    return known[key]


def _replaced(function: Any, known: dict[int, Any]) -> Any:
    if function.class_name() == "Newton":
        return _checked(function)
    arguments = function.mx_in()
    found = function.call(arguments, True, False)
    while (old := _output(found)) is not None:
        call = old.dep(0)
        inner = generated(call.which_function(), known)
        new = inner.call([call.dep(k) for k in range(call.n_dep())], False, True)
        found = ca.graph_substitute(found, [old], [new[old.which_output()]])
    inputs, outputs = ([name(k) for k in range(n)] for name, n in _names(function))
    return ca.Function(function.name(), arguments, found, inputs, outputs)


def _checked(function: Any) -> Any:
    """`fast_newton` for the same residuals: nan where another step would not be small, for its C does not say so."""
    residual = function.oracle()
    root = ca.rootfinder(f"{function.name()}_c", "fast_newton", residual, _OPTIONS)
    start, q = (ca.MX.sym(function.name_in(k), function.sparsity_in(k)) for k in range(2))
    z, w = ca.SX.sym("z", start.numel()), ca.SX.sym("q", q.numel())
    r = residual(z, w)
    linear: Any = ca.Function("linear", [z, w], [ca.jacobian(r, z), ca.densify(r)])
    found = root(start, q)
    slope, defect = linear(found, q)
    further = ca.solve(slope, defect, "qr")
    settled = ca.norm_inf(further) <= _SETTLED * (1 + ca.norm_inf(found))
    value = ca.if_else(settled, found, math.nan)
    names = [function.name_in(0), function.name_in(1)], [function.name_out(0)]
    return ca.Function(function.name(), [start, q], [value], *names)


def _names(function: Any) -> list[tuple[Any, int]]:
    return [(function.name_in, function.n_in()), (function.name_out, function.n_out())]


def _holds_rootfinder(function: Any) -> bool:
    if function.class_name() == "Newton":
        return True
    return function.is_a("MXFunction") and any(map(_holds_rootfinder, function.find_functions(0)))


def _output(roots: list[Any]) -> Any:
    """A result of a call below these expressions whose function holds a rootfinder to be replaced."""
    seen: set[int] = set()
    stack = list(roots)
    while stack:
        node = stack.pop()
        if node.__hash__() in seen:
            continue
        seen.add(node.__hash__())
        if node.is_output() and node.dep(0).is_call() and _holds_rootfinder(node.dep(0).which_function()):
            return node
        stack.extend(node.dep(k) for k in range(node.n_dep()))
    return None
