"""Smooth rates that sleep and wake for a moment, such as `y' = exp(-((x - c)/w)**2)`: where they are awake.

Far from c such a rate is constant to the last digit, so that nothing bounds the step, and a solver may pass the burst
without one evaluation in it. Its argument does not sleep: (x - c)/w is smooth, and changes its sign in the middle of
the burst. There a stretch ends, without an event, as at the kinks of `sleeping.py`: an error control that
has to arrive in the middle of a burst sees it.

What sleeps is an exponential, a quotient, a large power, or several steps (tanh, atan) in one equation, whose sum or
product may be a pulse. Its middle is where

- what it takes an even function of is zero: `w` of exp(-w**2), 1/(1 + w**2), exp(-fabs(w));
- sine or cosine in it have an extremum;
- of several of these, as in exp(-x**2 - y**2), of large powers, and of exponentials of what goes very far, as
  exp(1e6*(s - 1)), the argument itself has one: its rate is zero;
- the argument is zero, where there are several, as in (1 + tanh(a))*(1 - tanh(b)).

One step for itself is no burst: tanh(v/v0) of a friction, w/sqrt(1 + w**2), the exponential of a diode. The error
control sees the difference of both sides.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from acausal.analyse.blocks.solve import Solution
from acausal.flatten.pool import LEAVES, Pool
from acausal.flatten.scalars.differentiate import differentiate
from acausal.numeric.samples import SamplePoints

MOST = 60
"""Bursts that are watched."""

_STEPS = frozenset(("tanh", "atan"))
_EVEN = frozenset(("fabs", "cosh"))
_PARTNER = {"sin": "cos", "cos": "sin"}
_SMOOTH_FUNCTIONS = ("sin", "cos", "exp", "log", "cosh")
_SMOOTH = _STEPS | LEAVES | frozenset(("add", "sub", "neg", "mul", "div", "pow", "sqrt", *_SMOOTH_FUNCTIONS))
_LARGE = 8.0
_LEAST = -300.0
# The exponential of an argument that ranges over more is awake for a moment only; those of models/ go up to 800.
_STEEP = 3000.0
# A denominator of bounded terms that changes by less than this factor wakes nothing.
_FACTOR = 300.0


def may_burst(pool: Pool, number: int) -> bool:
    """Whether a node is of a kind that can be a burst."""
    node = pool.nodes[number]
    op = node[0]
    if op == "div" or op == "pow":
        fixed = node[2 if op == "div" else 1]
        return pool.nodes[fixed][0] not in ("const", "par") and not pool.is_constant(fixed)
    return op == "exp" or op in _STEPS


def bursts(
    solution: Solution, equations: Iterable[int], reachable: Iterable[int], moves: Callable[[int], bool]
) -> list[int]:
    """What changes its sign in the middle of each burst, as nodes.

    Of the `equations` of rates and the `reachable` nodes below them. `moves` says of a node whether it changes between
    events.
    """
    pool = solution.structure.reduced.pool
    kinds = [n for n in reachable if may_burst(pool, n)]
    found = _Bursts(solution, moves)
    for number in kinds:
        found.look(number)
    if any(pool.nodes[n][0] in _STEPS for n in kinds) or sum(pool.nodes[n][0] == "exp" for n in kinds) > 1:
        for root in equations:
            found.look_together(root)
    return list(found.middles)


def without_traces(pool: Pool, roots: Iterable[int], done: dict[int, int]) -> dict[int, int]:
    """Exponentials and high even powers, constant where they are below 1e-130; their images are added to `done`.

    A factorisation takes squares, and divides by one that is almost too small to be a number (1e-155 squared): a run
    stopped with AC400 far from any burst.
    """
    found: dict[int, int] = {}
    for number in pool.reachable(roots):
        op, *operands = pool.nodes[number]
        if number in done or op not in ("exp", "pow"):
            continue
        exponent = pool.nodes[operands[-1]]
        if op == "exp":
            pool.rewrite(operands, pool.var, done)
            cut = pool.make("exp", pool.make("max", done[operands[0]], pool.const(_LEAST)))
        elif exponent[0] == "const" and exponent[1] >= _LARGE and exponent[1] % 2.0 == 0.0:
            pool.rewrite(operands, pool.var, done)
            least = pool.const(float(np.exp(_LEAST / exponent[1])))
            cut = pool.make("pow", pool.make("max", pool.make("fabs", done[operands[0]]), least), operands[1])
        else:
            continue
        found[number] = done[number] = cut
    return found


class _Bursts:
    def __init__(self, solution: Solution, moves: Callable[[int], bool]) -> None:
        self.pool: Pool = solution.structure.reduced.pool
        self.points: SamplePoints = solution.structure.points
        self.states = frozenset(solution.structure.states)
        self.definition = dict(solution.definitions)
        self.moves = moves
        self.middles: dict[int, None] = {}

    def look(self, number: int) -> None:
        """A node that is a burst by itself."""
        op, *operands = self.pool.nodes[number]
        if op == "exp" and self.moves(operands[0]):
            self._wakes(operands[0], power=self._is_steep(operands[0]))
        elif op == "div" and self.moves(operands[1]):
            self._wakes(operands[1], numerator=operands[0])
        elif op == "pow" and self.moves(operands[0]) and not self.moves(operands[1]):
            exponent = float(self.points.of(operands[1])[0])
            if exponent < 0.0:
                self._wakes(operands[0], numerator=self.pool.one)
            elif exponent >= _LARGE:
                self._wakes(operands[0], power=True)

    def look_together(self, root: int) -> None:
        """An equation with several steps, or with the even power of one."""
        below = self.pool.reachable([root])
        nodes = self.pool.nodes
        steps = [n for n in below if nodes[n][0] in (*_STEPS, "exp") and self.moves(nodes[n][1])]
        divides = any(nodes[n][0] == "div" and self.moves(nodes[n][2]) for n in below)
        if not divides and not any(nodes[n][0] in _STEPS for n in steps):
            return
        arguments = {nodes[n][1] for n in steps}
        powers = [n for n in below if nodes[n][0] in ("mul", "pow") and self._squared(n) in steps]
        for u in arguments if len(arguments) > 1 else {nodes[self._squared(n)][1] for n in powers}:
            if not self._evens(u)[0]:
                self.middles[u] = None

    def _squared(self, number: int) -> int:
        op, *operands = self.pool.nodes[number]
        return operands[0] if op == "pow" or operands[0] == operands[1] else -1

    def _wakes(self, argument: int, numerator: int | None = None, power: bool = False) -> None:
        nodes, (evens, alone, rooted) = self.pool.nodes, self._evens(argument)
        if not alone:  # what else moves shifts where a bounded term has its extremum, but hardly that of a power
            evens = [n for n in evens if nodes[n][0] not in _PARTNER]
        if numerator is not None:
            if all(nodes[n][0] in _PARTNER for n in evens) and not self._is_wide(argument):
                return
            odd = self.pool.reachable([numerator])
            if rooted or not alone or any(n in odd for n in evens):
                return  # w/sqrt(1 + w**2) is a step, and 1/sqrt(1 + w**2) does not sleep
            if len(evens) > 1 and not self._has_floor(argument):
                return  # the attraction of a centre: it rules what its own argument does
        if len(evens) == 1:
            self.middles[evens[0]] = None
        elif evens or power:
            slope = self._slope(argument)
            if slope is not None:
                self.middles[slope] = None

    def _has_floor(self, number: int) -> bool:
        """Whether a constant stands in a sum, so that it does not vanish with all that moves."""
        op, *operands = self.pool.nodes[number]
        if op in ("mul", "pow", "neg", "div"):
            return any(self._has_floor(n) for n in operands if self.moves(n))
        return op in ("add", "sub") and any(not self.moves(n) or self._has_floor(n) for n in operands)

    def _is_steep(self, number: int) -> bool:
        """Whether an argument goes so far that its exponential is awake for a moment only; that of a diode does not."""
        values = self.points.everywhere(number)
        values = values[np.isfinite(values)]
        return bool(values.size and np.ptp(values) > _STEEP)

    def _is_wide(self, number: int) -> bool:
        values = np.abs(self.points.everywhere(number))
        values = values[np.isfinite(values)]
        return bool(values.size and values.max() > _FACTOR * values.min())

    def _evens(self, number: int) -> tuple[list[int], bool, bool]:
        """What vanishes where terms and factors of an expression have an extremum.

        And whether nothing else moves, and whether a square root is among them.
        """
        found: dict[int, None] = {}
        alone, rooted = True, False
        stack, seen = [number], {number}
        while stack:
            here = stack.pop()
            op, *operands = self.pool.nodes[here]
            if op == "var" and operands[0] in self.definition and operands[0] not in self.states:
                inner = [self.definition[operands[0]]]
            elif not self.moves(here):
                continue
            elif op in _EVEN or self._is_even_power(op, operands):
                w = operands[0]
                deeper, whole, _ = self._evens(w)
                found |= dict.fromkeys(deeper if deeper and whole else [w])
                continue
            elif op in _PARTNER:
                found[self.pool.make(_PARTNER[op], operands[0])] = None
                continue
            elif op in ("add", "sub", "neg", "mul", "div", "sqrt", "noevent", "pow"):
                inner = operands
                rooted |= op == "sqrt"
            else:
                alone = False
                continue
            stack += [n for n in inner if n not in seen]
            seen.update(inner)
        return list(found), alone, rooted

    def _is_even_power(self, op: str, operands: list[int]) -> bool:
        if op == "mul":
            return operands[0] == operands[1]
        if op != "pow" or self.moves(operands[1]):
            return False
        return float(self.points.of(operands[1])[0]) % 2.0 == 0.0

    def _slope(self, number: int) -> int | None:
        """The rate of an expression, where states and time alone determine it and it has one everywhere."""
        for _ in range(len(self.definition) + 1):
            others = self.pool.variables_in(number) - self.states
            if not others:
                smooth = all(self.pool.nodes[n][0] in _SMOOTH for n in self.pool.reachable([number]))
                return differentiate(self.pool, number) if smooth else None
            if not others <= self.definition.keys():
                return None
            done: dict[int, int] = {}
            self.pool.rewrite([number], self._defined, done)
            number = done[number]
        return None

    def _defined(self, variable: int) -> int:
        known = variable in self.definition and variable not in self.states
        return self.definition[variable] if known else self.pool.var(variable)
