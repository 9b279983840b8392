"""Divisors that may pass zero, where rates may have poles.

At a pole of the first order or higher, such as that of 1/x at zero, the integral of a rate is infinite, and nothing
follows for the time after it. A solver does not always stop there: rounding decides whether one of its steps ends on
the other side.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

from acausal.flatten.pool import Pool
from acausal.numeric.intervals import EVERYTHING, Interval, interval


@dataclass(frozen=True)
class Divisors:
    """Nodes: factors of divisors, and arguments of tangents, whose cosines divide."""

    factors: tuple[int, ...]
    angles: tuple[int, ...]


def divisors(
    pool: Pool,
    definitions: Iterable[tuple[int, int]],
    residuals: Sequence[int],
    stated: Iterable[int],
    signs: Sequence[int],
    moves: Callable[[int], bool],
) -> Divisors:
    """The divisors in equations that vary between events and may pass zero.

    Those by which the equations are solved are chosen so that they do not pass zero
    (`acausal.simulate.record.divisors.pivots`).

    `definitions`: Variables and the nodes that define them, in evaluation order.
    `stated`: The residuals of the equations before they were solved.
    `signs`: Those of the parameters: -1, 0 or 1.
    `moves`: Whether a node varies between events.
    """
    bounds: dict[int, Interval] = {}
    defined: dict[int, int] = {}
    factors, angles, known = set[int](), set[int](), set(pool.reachable(stated))
    for variable, root in (*definitions, *((-1, n) for n in residuals)):
        for number in pool.reachable([root], bounds):
            op, *operands = pool.nodes[number]
            if op == "const":
                bounds[number] = (float(operands[0]), float(operands[0]))
            elif op == "par":
                sign = signs[operands[0]]
                bounds[number] = (min(0.0, sign * math.inf), max(0.0, sign * math.inf)) if sign else (0.0, 0.0)
            elif op == "var":
                bounds[number] = bounds[defined[operands[0]]] if operands[0] in defined else EVERYTHING
            else:
                bounds[number] = interval(op, operands, [bounds.get(n, EVERYTHING) for n in operands])
            if number not in known:
                continue
            if op == "div":
                factors |= _factors(pool, operands[1], defined, moves)
            elif op == "pow" and not moves(operands[1]) and bounds[operands[1]][0] < 0.0:
                factors |= _factors(pool, operands[0], defined, moves)
            elif op == "tan" and moves(operands[0]):
                angles.add(operands[0])
        defined[variable] = root
    return Divisors(tuple(sorted(n for n in factors if bounds[n][0] < 0.0 < bounds[n][1])), tuple(sorted(angles)))


def _factors(pool: Pool, divisor: int, defined: Mapping[int, int], moves: Callable[[int], bool]) -> set[int]:
    """What is zero where a divisor is: its factors, and what they are powers of, also by definitions of variables."""
    found, stack = set[int](), [divisor]
    while stack:
        here = stack.pop()
        op, *operands = pool.nodes[here]
        if not moves(here):
            continue
        if op == "mul":
            stack += operands
        elif op in ("div", "pow", "sqrt", "fabs", "neg"):
            stack.append(operands[0])
        elif op == "var" and operands[0] in defined:
            stack.append(defined[operands[0]])
        else:
            found.add(here)
    return found
