"""Delayed signals: which signals a run records, and how their past enters the equations.

Over a stretch of a run that is no longer than the delay, the delayed signal is a known function of time. It enters as a
Chebyshev polynomial on the interval of the past that the stretch reads, and the coefficients of the polynomial are
modes. Every solver, compiled code included, therefore integrates a smooth right-hand side without recompilation.
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
    """One delayed signal: index of its source signal, nodes of the delay (`time`) and of its upper limit (`most`)."""

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

    `smoother` has pairs ((j, k), n): n integrations lie between delay j and source k, so that a discontinuity of the
    delayed signal appears n orders smoother in the source. Pairs without a path are left out.
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
        """Nodes that a run evaluates in addition to the equations: the sources, then the delays."""
        return [*self.sources, *(d.time for d in self.items)]


def find_delays(solution: Solution) -> Delays:
    """The delays of a solution."""
    reduced = solution.structure.reduced
    pool = reduced.pool
    sources: dict[int, int] = {}
    items = []
    for flat, (source, time, most) in zip(reduced.flat.delays, reduced.delays, strict=True):
        index = sources.setdefault(source, len(sources))
        span = flat.origin.span() if flat.origin is not None else None
        items.append(Delay(index, time, most, not pool.varies(time), flat.label, flat.component, span))
    if not items:
        return Delays()
    return Delays(tuple(items), tuple(sources), tuple(_smoother(solution, list(sources)).items()))


def _smoother(solution: Solution, sources: list[int]) -> dict[tuple[int, int], int]:
    """Number of integrations between each delay and each source, by breadth-first search back from the source."""
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

    Raises UsageError: AC035, with the first delay, its place in the source and a remedy.
    """
    if not flat.delays:
        return
    first = flat.delays[0]
    more = f" and {len(flat.delays) - 1} more" if len(flat.delays) > 1 else ""
    raise UsageError(
        "AC035",
        f"{what} does not support {flat.name}: it contains {first.label}{more}",
        where=(first.origin.span(),) if first.origin is not None else (),
        evidence=[f"{first.label} is in {first.component or flat.name}"],
        cause="a delayed signal depends on the past of a run, not on its present state alone",
        help=help_,
    )
