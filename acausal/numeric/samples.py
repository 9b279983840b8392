"""Sample points of a model, and which sampled values are significant.

The first point is the declared start, the others are scattered around it. At these points the compiler decides which
pivots are safe. A value may consist of rounding errors only: 1/3 + 1/3 - 2/3 is 6e-17, which must not be a pivot.

A value is significant if it exceeds a running error bound of first order: every operation propagates the errors of its
operands by its partial derivatives and adds its own, of the size of its result (N. J. Higham, Accuracy and Stability of
Numerical Algorithms, 2002, section 3.3). Bounds are in units of the rounding error of one operation.

Such bounds are worst cases: over a chain of a hundred bodies they grow without limit, although the values are correct
to fourteen digits. A value that single precision reproduces is therefore accepted before any bound is computed: if it
were a rounding error, it would be 1e9 times as large in single precision, or vanish.
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
"""Number of additional points far from the start, because states are chosen once for everywhere a run may go."""

STABILISATION_RATE = 100.0
"""Default rate [1/s] at which stabilised constraints decay; a run estimates a better one from its time scale."""


@dataclass(frozen=True, eq=False)
class Visited:
    """Points of an earlier run: times [s], shape (k,), and values of scalar variables there by name, shape (k,)."""

    times: Samples
    values: Mapping[str, Samples]


@cache
def _draws() -> tuple[Samples, Samples]:
    """Random directions around the start, shape (997, EVERYWHERE), and factors far from it, shape (997, FAR).

    They are drawn once per process, as 155 000 random numbers take as long as the rest of compiling a small model.
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
    """Values of variables and nodes at COUNT or all EVERYWHERE sample points, which are the same in every process.

    The last points are those that an earlier run has `visited`, if any.
    """

    def __init__(self, reduced: ReducedSystem, visited: Visited | None = None) -> None:
        self.reduced, self.visited = reduced, visited
        self._directions, self._far = _draws()
        self._times = 0.37 * np.concatenate([np.linspace(0.0, 1.0, COUNT), np.linspace(0.0, 20.0, EVERYWHERE - COUNT)])
        if visited is not None:
            self._times[EVERYWHERE - len(visited.times) :] = visited.times
        self._samples: dict[int, Samples] = {}
        self._definition: dict[int, int] = {}
        self._values: dict[int, Any] = {}
        self._bounds: dict[int, Any] = {}
        self._single_precision: dict[int, Any] = {}
        self._varies: dict[int, bool] = {}
        self._constant_values: dict[int, Samples] = {}

    def __getstate__(self) -> dict[str, Any]:
        """Everything except cached properties, which contain functions and are rebuilt on demand."""
        return {k: v for k, v in self.__dict__.items() if not isinstance(getattr(type(self), k, None), cached_property)}

    def define(self, variable: int, node: int) -> None:
        """Give the variable the value of `node` at every point from now on."""
        self._definition[variable] = node
        self._samples.pop(variable, None)
        self._values.clear()
        self._bounds.clear()
        self._single_precision.clear()

    def of(self, node: int) -> Samples:
        """Values of a node, shape (COUNT,)."""
        return self.everywhere(node)[:COUNT]

    def everywhere(self, node: int) -> Samples:
        """Values of a node, shape (EVERYWHERE,)."""
        return np.broadcast_to(np.asarray(self._value(node), dtype=float), (EVERYWHERE,))

    def significant(self, node: int) -> Samples:
        """Like `everywhere`, with zero for values that consist of rounding errors of cancelling terms."""
        cached = self._constant_values.get(node)
        if cached is not None:
            return cached
        samples = self._significant(node)
        if not self.varies(node):  # later definitions do not change it, and equal cells of a field share the node
            self._constant_values[node] = samples
        return samples

    def _significant(self, node: int) -> Samples:
        samples = self.everywhere(node)
        if agrees(self.reduced.pool, node, self._values, self._single_precision):
            return samples
        certain = is_significant(self.reduced.pool, node, self._values, self._bounds)
        return np.where(certain | ~np.isfinite(samples), samples, 0.0)

    def varies(self, node: int) -> bool:
        """Whether the node depends on a variable or on time."""
        nodes, varying = self.reduced.pool.nodes, self._varies
        for here in self.reduced.pool.reachable([node], varying):
            op, *operands = nodes[here]
            varying[here] = op in ("var", "time") if op in LEAVES else any(varying[c] for c in operands)
        return varying[node]

    def _value(self, node: int) -> Any:
        """Value of a node; every node below it is evaluated only once, until a variable is redefined."""
        nodes, value_of = self.reduced.pool.nodes, self._values
        leaves: Mapping[str, Callable[[int], Any]] = {
            "var": self._variable,
            "par": self.parameters.__getitem__,
            "time": lambda _: self._times,
        }
        with np.errstate(all="ignore"):
            for here in self.reduced.pool.reachable([node], value_of):
                op, *operands = nodes[here]
                if op == "const":
                    value_of[here] = operands[0]
                elif op in LEAVES:
                    value_of[here] = leaves[op](operands[0] if operands else 0)
                else:
                    value_of[here] = operation(op)(*[value_of[c] for c in operands])
        return value_of[node]

    def _evaluate(self, variable: int) -> None:
        """Evaluate a defined variable after those in its definition; without recursion, because chains may be long."""
        pool = self.reduced.pool
        stack = [variable]
        while stack:
            here = stack[-1]
            node = self._definition[here]
            waiting = [
                v
                for v in pool.variables_in(node)
                if v in self._definition and v not in self._samples and v not in stack
            ]
            if waiting:
                stack.extend(waiting)
                continue
            stack.pop()
            self._samples[here] = self.everywhere(node)

    @cached_property
    def parameters(self) -> tuple[float, ...]:
        """Values of the free parameters, followed by the stabilisation rate."""
        return (*self.reduced.flat.parameter_values, STABILISATION_RATE)

    def variable(self, variable: int) -> Samples:
        """Values of a variable, shape (COUNT,): its start, then scattered around it by its nominal magnitude."""
        return self._variable(variable)[:COUNT]

    def _variable(self, variable: int) -> Samples:
        if variable not in self._samples and variable in self._definition:
            self._evaluate(variable)
        if variable not in self._samples:
            reduced = self.reduced
            start, nominal, declared = 0.0, 1.0, None
            if variable < len(reduced.scalar):
                declared = reduced.flat.declaration(reduced.scalar[variable])
                nominal = declared.nominal
                start = self.start(variable)
            offset = 1.0 if variable >= 997 else 0.9
            samples = start + offset * nominal * self._directions[(variable * 7919) % 997]
            if declared is not None and (declared.boolean or declared.integer):
                # Sample both branches of a switch, but no values that it never takes.
                samples = np.mod(np.round(samples - start) + start, 2.0) if declared.boolean else np.round(samples)
                if declared.boolean:  # for the mode in which all friction elements stick, which chance would not hit
                    samples[ALL_TRUE] = 1.0
            visited_values = self._visited_values(variable)
            samples[EVERYWHERE - len(visited_values) :] = visited_values
            self._samples[variable] = samples
        return self._samples[variable]

    def _visited_values(self, variable: int) -> Samples:
        """Values at the points of an earlier run, shape (k,); empty without a run, or if it has no such variable."""
        nothing = np.zeros(0)
        return nothing if self.visited is None else self.visited.values.get(self.reduced.name(variable), nothing)

    def anywhere(self, variable: int) -> Samples:
        """Values of a variable, shape (COUNT + FAR,): those of `variable`, then far from its start on both sides.

        Nearby points do not suffice for the choice of states: x of a pendulum that starts at x = 5 with a nominal
        magnitude of 1 is positive at nearly all of them, and half the points around the start of a four-bar linkage lie
        in one branch. Angles are sampled over whole turns.
        """
        near = self.variable(variable)
        scalar = self.reduced.scalar
        declared = self.reduced.flat.declaration(scalar[variable]) if variable < len(scalar) else None
        if declared is not None and (declared.boolean or declared.integer):
            return np.concatenate([near, np.resize(near, FAR)])
        size = max(abs(float(near[0])), 1.0 if declared is None else abs(declared.nominal))
        visited_values = self._visited_values(variable)
        return np.concatenate(
            [near, size * self._far[(variable * 7919) % 997][: FAR - len(visited_values)], visited_values]
        )

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
        """Like `leaves`, at COUNT + FAR points."""
        times = np.concatenate([self._times[:COUNT], np.resize(self._times, FAR)])
        return {"var": self.anywhere, "par": self.parameters.__getitem__, "time": lambda _: times}

    @cached_property
    def leaves(self) -> Mapping[str, Callable[[int], Any]]:
        """Values of variables, parameters and time for `values` and `gradients`, at COUNT points."""
        return {"var": self.variable, "par": self.parameters.__getitem__, "time": lambda _: self._times[:COUNT]}


SIGNIFICANT = 1e-10
"""A value that is smaller than this times its error bound has fewer than six significant digits."""

AGREES = 0.1
"""Largest relative difference at which values in double and in single precision agree."""


def agrees(pool: Pool, node: int, values: dict[int, Any], single: dict[int, Any]) -> bool:
    """Whether a node has the same value at all points if it is computed in single precision.

    `values` has those of the node and of every node below it; `single` receives the values in single precision.
    """
    with np.errstate(all="ignore"):
        for here in pool.reachable([node], single):
            op, *operands = pool.nodes[here]
            if op in LEAVES or isinstance(op, Call):  # an external function keeps its double precision
                single[here] = np.asarray(values[here]).astype(np.float32)[()]
            else:
                single[here] = operation(op)(*[single[c] for c in operands])
        approximate = np.asarray(single[node])
        exact = np.asarray(values[node], dtype=float)
        return approximate.dtype == np.float32 and bool((np.abs(approximate - exact) < AGREES * np.abs(exact)).all())


def is_significant(pool: Pool, node: int, values: dict[int, Any], bounds: dict[int, Any]) -> Samples:
    """Whether a node exceeds its rounding errors at each point, shape (EVERYWHERE,) or ().

    `values` has those of the node and of every node below it; `bounds` receives their error bounds, which are reused as
    long as the values stay the same.
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
