"""Pool expressions to CasADi SX: one CasADi operation per shared node."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any

import casadi as ca

from acausal.flatten.pool import Pool

_BUILD: dict[str, Callable[..., Any]] = {
    "add": lambda a, b: a + b,
    "sub": lambda a, b: a - b,
    "mul": lambda a, b: a * b,
    "div": lambda a, b: a / b,
    "neg": lambda a: -a,
    "pow": lambda a, b: a**b,
    "min": ca.fmin,
    "max": ca.fmax,
    "atan2": ca.atan2,
    "lt": lambda a, b: a < b,
    "le": lambda a, b: a <= b,
    "gt": lambda a, b: a > b,
    "ge": lambda a, b: a >= b,
    "and": ca.logic_and,
    "or": ca.logic_or,
    "not": ca.logic_not,
    "where": ca.if_else,
    **{
        n: getattr(ca, n)
        for n in "sin cos tan asin acos atan sinh cosh tanh exp log sqrt fabs sign floor ceil".split()
    },
}


class Builder:
    """Lowers nodes of one pool on demand; `symbols` holds what is known of variables, parameters, modes and time."""

    def __init__(self, pool: Pool, time: Any, parameters: Any, modes: Mapping[int, Any]) -> None:
        self.pool = pool
        self.time = time
        self.parameters = [parameters[k] for k in range(parameters.numel())]
        self.variables: dict[int, Any] = {}
        self.done: dict[int, Any] = dict(modes)
        self.homotopy: Any = None  # 0 at the simplified, 1 at the actual side of homotopy(...); None means 1

    def lower(self, roots: Iterable[int]) -> list[Any]:
        """SX of each root; every variable below must be in `variables`."""
        wanted = list(roots)
        nodes = self.pool.nodes
        done = self.done
        for number in self._missing(wanted):
            node = nodes[number]
            op = node[0]
            if op == "const":
                done[number] = ca.SX(node[1])
            elif op == "var":
                done[number] = self.variables[node[1]]
            elif op == "par":
                done[number] = self.parameters[node[1]]
            elif op == "time":
                done[number] = self.time
            elif op == "homotopy":
                actual, simplified = done[node[1]], done[node[2]]
                s = self.homotopy
                done[number] = actual if s is None else s * actual + (1 - s) * simplified
            else:
                done[number] = _BUILD[op](*[done[c] for c in node[1:]])
        return [done[r] for r in wanted]

    def _missing(self, roots: list[int]) -> list[int]:
        """Nodes not lowered yet, in evaluation order; nothing below a mode is visited."""
        nodes, done = self.pool.nodes, self.done
        seen: set[int] = set()
        stack = [r for r in roots if r not in done]
        while stack:
            number = stack.pop()
            if number in seen or number in done:
                continue
            seen.add(number)
            node = nodes[number]
            if node[0] not in ("const", "var", "par", "time"):
                stack.extend(node[1:])
        return sorted(seen)
