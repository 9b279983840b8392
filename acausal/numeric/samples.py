"""Sample points of a model, and which sampled values are significant.

The first point is the declared start, the others are scattered around it. At such points the compiler decides which
pivots are safe. A value may consist of rounding errors only: 1/3 + 1/3 - 2/3 is 6e-17, and no pivot.

A value is significant when it exceeds a running error bound to first order: every operation propagates the errors of
its
operands by its partial derivatives and adds its own, of the size of its result (N. J. Higham, Accuracy and Stability of
Numerical Algorithms, 2002, section 3.3). Bounds are in units of the rounding error of one operation.

Such bounds are worst cases: over a chain of a hundred bodies they grow without limit, though the values stay right to
fourteen digits. Therefore a value that single precision reproduces is accepted before any bound is computed: a rounding
error would be 1e9 times as large there, or vanish.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

import numpy as np

from acausal.flatten.pool import LEAVES, Pool
from acausal.flatten.reduced import ReducedSystem
from acausal.language.expressions.external import Call
from acausal.numeric.evaluate import PARTIALS, Samples, operation, values

COUNT = 12
"""Number of points; the first is the declared start."""

EVERYWHERE = 60
"""Number of points for decisions that need more evidence; the first COUNT are the same."""


ALL_TRUE = 5
"""The point at which all Booleans are true."""

FAR = 48
"""Number of further points, far from the start: states are chosen once for wherever the run may go."""

STABILISATION_RATE = 100.0
"""Default rate [1/s] at which stabilised constraints decay; a run estimates a better one from its own time scale."""


@dataclass(frozen=True, eq=False)
class Visited:
    """Points of an earlier run: times [s], shape (k,), and values of scalar variables there by name, shape (k,)."""

    times: Samples
    values: Mapping[str, Samples]


@cache
def _draws() -> tuple[Samples, Samples]:
    """Random directions around the start, shape (997, EVERYWHERE), and factors far from it, shape (997, FAR).

    Drawn once per process: 155 000 random numbers took as long as the rest of compiling a small model.
    """
    random = np.random.default_rng(20090507)
    near = random.standard_normal((997, COUNT))
    near *= np.array([0.0, 0.7, 0.02, 0.1, 0.3, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0])
    more = random.standard_normal((997, EVERYWHERE - COUNT)) * np.linspace(0.1, 4.0, EVERYWHERE - COUNT)
    signs = np.sign(random.standard_normal((997, FAR)))
    draws = np.hstack([near, more]), signs * 10.0 ** random.uniform(-1.0, 1.2, (997, FAR))
    for numbers in draws:
        numbers.setflags(write=False)
    return draws


class SamplePoints:
    """Values of variables and nodes at the sample points, the same in every process: COUNT of them, or all EVERYWHERE.

    The last points are those `visited` by an earlier run, if any.
    """

    def __init__(self, reduced: ReducedSystem, visited: Visited | None = None) -> None:
        self.reduced, self.visited = reduced, visited
        self._directions, self._far = _draws()
        self._times = 0.37 * np.concatenate([np.linspace(0.0, 1.0, COUNT), np.linspace(0.0, 20.0, EVERYWHERE - COUNT)])
        if visited is not None:
            self._times[EVERYWHERE - len(visited.times) :] = visited.times
        self._known: dict[int, Samples] = {}
        self._definition: dict[int, int] = {}
        self._values: dict[int, Any] = {}
        self._bounds: dict[int, Any] = {}
        self._rough: dict[int, Any] = {}
        self._varies: dict[int, bool] = {}
        self._constant_values: dict[int, Samples] = {}

    def __getstate__(self) -> dict[str, Any]:
        """Everything but cached properties, which hold functions and are rebuilt on demand."""
        return {k: v for k, v in self.__dict__.items() if not isinstance(getattr(type(self), k, None), cached_property)}

    def define(self, variable: int, node: int) -> None:
        """Give the variable the value of `node` at every point from now on."""
        self._definition[variable] = node
        self._known.pop(variable, None)
        self._values.clear()
        self._bounds.clear()
        self._rough.clear()

    def of(self, node: int) -> Samples:
        """Values of a node, shape (COUNT,)."""
        return self.everywhere(node)[:COUNT]

    def everywhere(self, node: int) -> Samples:
        """Values of a node, shape (EVERYWHERE,)."""
        return np.broadcast_to(np.asarray(self._value(node), dtype=float), (EVERYWHERE,))

    def significant(self, node: int) -> Samples:
        """As `everywhere`, with zero for values that consist of rounding errors of cancelling terms."""
        known = self._constant_values.get(node)
        if known is not None:
            return known
        found = self._significant(node)
        if not self.varies(node):  # no later definition changes it, and equal cells of a field share the node
            self._constant_values[node] = found
        return found

    def _significant(self, node: int) -> Samples:
        found = self.everywhere(node)
        if agrees(self.reduced.pool, node, self._values, self._rough):
            return found
        certain = is_significant(self.reduced.pool, node, self._values, self._bounds)
        return np.where(certain | ~np.isfinite(found), found, 0.0)

    def varies(self, node: int) -> bool:
        """True when the node depends on a variable or on time."""
        nodes, known = self.reduced.pool.nodes, self._varies
        for here in self.reduced.pool.reachable([node], known):
            op, *operands = nodes[here]
            known[here] = op in ("var", "time") if op in LEAVES else any(known[c] for c in operands)
        return known[node]

    def _value(self, node: int) -> Any:
        """Value of a node; every node below it is evaluated once until a variable is redefined."""
        nodes, known = self.reduced.pool.nodes, self._values
        leaves: Mapping[str, Callable[[int], Any]] = {
            "var": self._variable,
            "par": self.parameters.__getitem__,
            "time": lambda _: self._times,
        }
        with np.errstate(all="ignore"):
            for here in self.reduced.pool.reachable([node], known):
                op, *operands = nodes[here]
                if op == "const":
                    known[here] = operands[0]
                elif op in LEAVES:
                    known[here] = leaves[op](operands[0] if operands else 0)
                else:
                    known[here] = operation(op)(*[known[c] for c in operands])
        return known[node]

    def _evaluate(self, variable: int) -> None:
        """Evaluate a defined variable after the variables its definition needs; without recursion, for long chains."""
        pool = self.reduced.pool
        stack = [variable]
        while stack:
            here = stack[-1]
            node = self._definition[here]
            waiting = [
                v for v in pool.variables_in(node) if v in self._definition and v not in self._known and v not in stack
            ]
            if waiting:
                stack.extend(waiting)
                continue
            stack.pop()
            self._known[here] = self.everywhere(node)

    @cached_property
    def parameters(self) -> tuple[float, ...]:
        """Values of the free parameters, followed by the stabilisation rate."""
        return (*self.reduced.flat.parameter_values, STABILISATION_RATE)

    def variable(self, variable: int) -> Samples:
        """Values of a variable, shape (COUNT,): its start, then scattered around it by its nominal magnitude."""
        return self._variable(variable)[:COUNT]

    def _variable(self, variable: int) -> Samples:
        if variable not in self._known and variable in self._definition:
            self._evaluate(variable)
        if variable not in self._known:
            reduced = self.reduced
            start, nominal, declared = 0.0, 1.0, None
            if variable < len(reduced.scalar):
                declared = reduced.flat.declaration(reduced.scalar[variable])
                nominal = declared.nominal
                start = self.start(variable)
            offset = 1.0 if variable >= 997 else 0.9
            found = start + offset * nominal * self._directions[(variable * 7919) % 997]
            if declared is not None and (declared.boolean or declared.integer):
                # Sample both branches of a switch, and no value that it never takes.
                found = np.mod(np.round(found - start) + start, 2.0) if declared.boolean else np.round(found)
                if declared.boolean:  # all friction elements stuck at once: chance would not hit this mode
                    found[ALL_TRUE] = 1.0
            seen = self._visited_values(variable)
            found[EVERYWHERE - len(seen) :] = seen
            self._known[variable] = found
        return self._known[variable]

    def _visited_values(self, variable: int) -> Samples:
        """Values at the points of an earlier run, shape (k,); empty without a run or where it has no such variable."""
        nothing = np.zeros(0)
        return nothing if self.visited is None else self.visited.values.get(self.reduced.name(variable), nothing)

    def anywhere(self, variable: int) -> Samples:
        """Values of a variable, shape (COUNT + FAR,): as `variable`, then far from its start on both sides.

        Nearby points are not enough to choose states by: x of a pendulum that starts at x = 5 with a nominal magnitude
        of 1 is positive at nearly all of them, and half the points around the start of a four-bar lie in one branch.
        Angles are sampled all around.
        """
        near = self.variable(variable)
        scalar = self.reduced.scalar
        declared = self.reduced.flat.declaration(scalar[variable]) if variable < len(scalar) else None
        if declared is not None and (declared.boolean or declared.integer):
            return np.concatenate([near, np.resize(near, FAR)])
        size = max(abs(float(near[0])), 1.0 if declared is None else abs(declared.nominal))
        seen = self._visited_values(variable)
        return np.concatenate([near, size * self._far[(variable * 7919) % 997][: FAR - len(seen)], seen])

    def start(self, variable: int) -> float:
        """Declared start of a variable or of one of its aliases, else 0."""
        reduced = self.reduced
        for scalar in reduced.aliases.get(variable, ()):
            declared = reduced.flat.starts.get(scalar)
            if declared is not None:
                value = self.constant(reduced.flat.pool, declared.node)
                negative = reduced.pool.nodes[reduced.image[scalar]][0] == "neg"
                return -value if negative else value
        return 0.0

    def constant(self, pool: Pool, node: int) -> float:
        """Value of an expression of parameters."""
        return float(values(pool, [node], {"par": self.parameters.__getitem__, "time": lambda _: 0.0})[node])

    @cached_property
    def leaves_anywhere(self) -> Mapping[str, Callable[[int], Any]]:
        """As `leaves`, at COUNT + FAR points."""
        times = np.concatenate([self._times[:COUNT], np.resize(self._times, FAR)])
        return {"var": self.anywhere, "par": self.parameters.__getitem__, "time": lambda _: times}

    @cached_property
    def leaves(self) -> Mapping[str, Callable[[int], Any]]:
        """Values of variables, parameters and time for `values` and `gradients`, at COUNT points."""
        return {"var": self.variable, "par": self.parameters.__getitem__, "time": lambda _: self._times[:COUNT]}


SIGNIFICANT = 1e-10
"""A value smaller than this times its error bound has less than six significant digits."""

AGREES = 0.1
"""Largest relative difference at which values in double and in single precision agree."""


def agrees(pool: Pool, node: int, values: dict[int, Any], rough: dict[int, Any]) -> bool:
    """Whether a node has the same value everywhere when it is computed in single precision.

    `values` holds it and every node below it; `rough` receives the values in single precision.
    """
    with np.errstate(all="ignore"):
        for here in pool.reachable([node], rough):
            op, *operands = pool.nodes[here]
            if op in LEAVES or isinstance(op, Call):  # an external function keeps its double precision
                rough[here] = np.asarray(values[here]).astype(np.float32)[()]
            else:
                rough[here] = operation(op)(*[rough[c] for c in operands])
        found = np.asarray(rough[node])
        exact = np.asarray(values[node], dtype=float)
        return found.dtype == np.float32 and bool((np.abs(found - exact) < AGREES * np.abs(exact)).all())


def is_significant(pool: Pool, node: int, values: dict[int, Any], bounds: dict[int, Any]) -> Samples:
    """At which points a node exceeds its rounding errors, shape (EVERYWHERE,) or ().

    `values` holds it and every node below it; `bounds` receives the bounds of these nodes, each computed once as long
    as the values stay the same.
    """
    with np.errstate(all="ignore"):
        for here in pool.reachable([node], bounds):
            op, *operands = pool.nodes[here]
            bounds[here] = _bound(op, operands, values[here], values, bounds)
        return np.asarray(np.abs(values[node]) > SIGNIFICANT * bounds[node])


def _bound(op: str, operands: list[int], y: Any, values: dict[int, Any], bounds: dict[int, Any]) -> Any:
    """Error bound of one operation from the bounds of its operands."""
    if op in LEAVES:
        return np.abs(y)
    if op == "where":
        return np.where(values[operands[0]], bounds[operands[1]], bounds[operands[2]])
    if op not in PARTIALS:
        return np.abs(np.asarray(y, dtype=float))
    total = np.abs(y) if op != "neg" else 0.0
    for slope, operand in zip(PARTIALS[op](y, *[values[c] for c in operands]), operands, strict=True):
        total = total + np.abs(slope) * bounds[operand]
    return total
