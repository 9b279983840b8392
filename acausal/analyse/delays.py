"""Delayed signals as data for a run: the signals to record, and polynomials by which the past enters the equations.

Over a stretch of a run that is no longer than the delay, the delayed signal is a known function of time: a Chebyshev
polynomial on the interval that the stretch reads, whose coefficients are modes. Every solver, compiled code included,
therefore integrates a smooth right-hand side, and nothing is compiled again.
"""

from __future__ import annotations

from dataclasses import dataclass

from acausal.analyse.blocks.solve import Solution
from acausal.errors import Span, UsageError
from acausal.flatten.flat import FlatSystem
from acausal.language.expressions.delay import Delayed

DEGREE = 24
"""Degree of the polynomial of one delayed signal over one stretch."""

WIDTH = DEGREE + 3
"""Number of modes of one delay: centre of the interval in the past [s], reciprocal half width [1/s], coefficients."""

PADE = "replace the delay by a rational approximation: PadeDelay of acausal.library.blocks"


@dataclass(frozen=True)
class Delay:
    """One delayed signal: index of its source signal, nodes of the delay and of its upper limit."""

    source: int
    time: int
    most: int | None
    is_constant: bool
    label: str
    component: str
    where: Span | None

    @property
    def name(self) -> str:
        """Text of the delay with its component."""
        return f"{self.label} in {self.component}" if self.component else self.label


@dataclass(frozen=True)
class Delays:
    """All delays of a model.

    `smoother[j, k]` is the number of integrations between delay j and source k, by which a discontinuity of the one
    becomes smoother in the other. Pairs without a path are left out.
    """

    items: tuple[Delay, ...] = ()
    sources: tuple[int, ...] = ()
    smoother: tuple[tuple[tuple[int, int], int], ...] = ()

    def __bool__(self) -> bool:
        return bool(self.items)

    @property
    def size(self) -> int:
        """Number of modes."""
        return WIDTH * len(self.items)

    @property
    def roots(self) -> list[int]:
        """Nodes that a run evaluates in addition to the equations: sources, then delays."""
        return [*self.sources, *(d.time for d in self.items)]


def find_delays(solution: Solution) -> Delays:
    """The delays of a solution."""
    reduced = solution.structure.reduced
    pool = reduced.pool
    sources: dict[int, int] = {}
    items = []
    for flat, (source, time, most) in zip(reduced.flat.delays, reduced.delays, strict=True):
        place = sources.setdefault(source, len(sources))
        span = flat.origin.span() if flat.origin is not None else None
        items.append(Delay(place, time, most, not pool.varies(time), flat.label, flat.component, span))
    if not items:
        return Delays()
    return Delays(tuple(items), tuple(sources), tuple(_smoother(solution, list(sources)).items()))


def _smoother(solution: Solution, sources: list[int]) -> dict[tuple[int, int], int]:
    """Integrations between each delay and each source, by a breadth-first search back from the source."""
    structure = solution.structure
    pool = structure.reduced.pool
    definition = dict(solution.definitions)
    algebraic = set(solution.algebraic)
    integrations: dict[tuple[int, int], int] = {}
    for k, source in enumerate(sources):
        nodes, seen, level = [source], set[int](), 0
        while nodes:
            states: set[int] = set()
            while nodes:
                for number in pool.reachable([nodes.pop()]):
                    op, *rest = pool.nodes[number]
                    if isinstance(op, Delayed):
                        integrations.setdefault((op.number, k), level)
                    if op != "var" or rest[0] in seen:
                        continue
                    seen.add(rest[0])
                    if rest[0] in definition:
                        nodes.append(definition[rest[0]])
                    elif rest[0] in algebraic:
                        nodes += solution.residuals
                    else:
                        states.add(rest[0])
            nodes = [*structure.rates(sorted(states.intersection(structure.states)))]
            level += 1
    return integrations


def refuse_delays(flat: FlatSystem, what: str, help_: str) -> None:
    """Refuse an operation that is not defined or not implemented for models with delays.

    Raises UsageError: AC035 with the first delay, its place and a remedy.
    """
    if not flat.delays:
        return
    first = flat.delays[0]
    more = f" and {len(flat.delays) - 1} more" if len(flat.delays) > 1 else ""
    raise UsageError(
        "AC035",
        f"{what} does not take {flat.name}: it holds {first.label}{more}",
        where=(first.origin.span(),) if first.origin is not None else (),
        evidence=[f"{first.label} stands in {first.component or flat.name}"],
        cause="a delayed signal depends on the past of a run, not on its present state alone",
        help=help_,
    )
