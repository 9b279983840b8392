"""Structural analysis of the reduced system: index reduction, choice of states, block lower triangular order."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence, Set
from dataclasses import dataclass, replace
from math import comb

import numpy as np

from acausal.diagnose.balance import balance, refuse_superfluous
from acausal.diagnose.constraints import differentiated_input, redundant_constraints, refuse_if_singular, undetermined
from acausal.diagnose.modes import refuse_changing_structure
from acausal.flatten.connections.connections import UnionFind
from acausal.flatten.reduced import ReducedSystem
from acausal.flatten.scalars.differentiate import differentiate
from acausal.numeric.evaluate import Samples, gradients
from acausal.numeric.samples import COUNT, FAR, SamplePoints, Visited
from acausal.structure import Block, Choice, Incidence, blocks, highest_derivatives, match, pantelides, select_dummies

_CHECKED_LEVELS = (5, 20)
"""Numbers of differentiations of one equation at which the system is checked for singularity; at the last one the model
is refused in any case. Published problems have index 3 or less."""


@dataclass(frozen=True, eq=False)
class Structure:
    """Equations, states, and the blocks in which the unknowns are solved for.

    Attributes
    ----------
    residuals
        Nodes that must be zero: those of the reduced system, then the differentiated ones.
    integral
        Maps a differentiated equation to the equation it is the derivative of.
    states
        Variables that are integrated; `derivative(x)` is the unknown that is their rate.
    blocks
        Rows are equations, columns unknowns; each block needs only states, inputs and earlier blocks.
    choices
        Choices of states made by index reduction.
    invariants
        Constraints that are stabilised instead of solved: (equation, node). Their variables are all states; the highest
        derivative of each is replaced by (d/dt + rate)^k g = 0, so that violations g decay (Baumgarte 1972).
    rate
        Node of the stabilisation rate [1/s], an additional parameter after those of the model; None without invariants.
    """

    reduced: ReducedSystem
    residuals: tuple[int, ...]
    integral: dict[int, int]
    states: tuple[int, ...]
    blocks: tuple[Block, ...]
    choices: tuple[Choice, ...]
    invariants: tuple[tuple[int, int], ...]
    rate: int | None
    points: SamplePoints

    def __repr__(self) -> str:
        sizes = [len(b.rows) for b in self.blocks]
        return (
            f"Structure({self.reduced.flat.name}: {len(self.states)} states, {sum(sizes)} unknowns in "
            f"{len(sizes)} blocks, largest {max(sizes, default=0)}, {len(self.integral)} differentiated equations)"
        )

    def derivative(self, state: int) -> int:
        """The variable that is the rate of a state."""
        return self.reduced.pool.derivative_of[state]

    def rates(self, states: Iterable[int]) -> tuple[int, ...]:
        """Nodes of the rates of states."""
        pool = self.reduced.pool
        return pool.vars([pool.derivative_of[x] for x in states])

    def flat_equation(self, equation: int) -> int:
        """Index of the flat equation that an equation equals or was differentiated from."""
        while equation in self.integral:
            equation = self.integral[equation]
        return self.reduced.equation[equation]


def analyse(reduced: ReducedSystem, keep_constraints: bool = False, visited: Visited | None = None) -> Structure:
    """Structural analysis: balance, index reduction, state choice, block order.

    With `keep_constraints` no states are chosen: every constraint is stabilised, and all its variables are integrated.
    Numeric decisions are checked at `visited` points of an earlier run as well.

    Raises
    ------
    StructureError
        AC201 too few or too many equations, AC206 dependent constraints, AC207 an input must be differentiated, AC213
        the structure depends on the mode.
    """
    _check_inputs(reduced)  # before the balance, which would report the derivative of an input as a missing equation
    system = _System(reduced)
    n = len(reduced.residuals)
    moving = set(reduced.pool.derivative_of)
    incidence = highest_derivatives(system, n)
    matched = match(incidence)
    # Each variable has one highest derivative: a perfect matching with these is one with the variables.
    if (matched < 0).any() or n != system.n_variables() - len(moving) - len(system.inputs):
        balance(reduced)
    else:
        refuse_superfluous(reduced)
    assigned, derivative = pantelides(system, matched.tolist())
    _check_inputs(reduced)  # again, for inputs in differentiated constraints
    integral = {new: old for old, new in derivative.items()}
    points = SamplePoints(reduced, visited)
    choices: list[Choice] = []
    invariants: list[tuple[int, int]] = []
    if integral:
        groups = _groups(system, [e for e in sorted(integral) if e not in derivative], set(assigned))
        choices = select_dummies(
            groups,
            integral,
            reduced.pool.integral_of,
            system.rows(points),
            preference(reduced),
            lambda e: system.hidden(integral[e], e),
            # Variables without a derivative in the model are solved for like algebraic ones: the near sample points
            # suffice.
            lambda v: None if v in moving else COUNT,
        )
        _check_choices(reduced, integral, choices)
        if keep_constraints:
            highest = [c for c in choices if not set(c.equations) & derivative.keys()]
            choices = [replace(c, dummies=(), floating=c.equations) for c in highest]
        invariants = system.stabilise([e for c in choices for e in c.floating], integral)
    dummies = {v for c in choices for v in c.dummies}
    pool = reduced.pool
    states = tuple(sorted(x for x, dx in pool.derivative_of.items() if dx not in dummies and x not in reduced.inputs))
    # Without differentiation the unknowns are the highest derivatives, which are matched already.
    order = _order(system, set(states), {e for e, _ in invariants}) if integral else blocks(incidence, matched)
    refuse_changing_structure(reduced, system.residuals, order, system.source)
    return Structure(
        reduced=reduced,
        residuals=tuple(system.residuals),
        integral=integral,
        states=states,
        blocks=order,
        choices=tuple(choices),
        invariants=tuple(invariants),
        rate=system.rate if invariants else None,
        points=points,
    )


def reordered(
    structure: Structure, residuals: Sequence[int], states: Sequence[int] | None = None, gone: Set[int] = frozenset()
) -> Structure:
    """The structure with other nodes for its equations, and recomputed blocks.

    `states` replace the states, if given; the variables `gone` no longer occur and are not solved for.

    Raises StructureError when the equations no longer determine the unknowns.
    """
    system = _System(structure.reduced)
    system.residuals = list(residuals)
    system.source = [structure.flat_equation(e) for e in range(len(residuals))]
    new_states = structure.states if states is None else tuple(states)
    order = _order(system, {*new_states, *gone}, {e for e, _ in structure.invariants})
    points = SamplePoints(structure.reduced, structure.points.visited)
    return replace(structure, residuals=tuple(residuals), states=new_states, blocks=order, points=points)


def _groups(system: _System, equations: Sequence[int], unknowns: set[int]) -> list[Block]:
    """Connected groups of the equations of highest derivative and their highest derivatives.

    These are larger than the blocks of the solving order: a preferred coordinate and the one it replaces as a state (a
    joint's and a body's) often occur in different blocks.
    """
    rows = [[v for v in system.incidence(e) if v in unknowns and v in system.pool.integral_of] for e in equations]
    owner: dict[int, int] = {}
    sets = UnionFind(len(equations))
    for k, row in enumerate(rows):
        for v in row:
            sets.union(k, owner.setdefault(v, k))
    members: dict[int, list[int]] = {}
    for k in range(len(equations)):
        members.setdefault(sets.find(k), []).append(k)
    return [
        Block(tuple(equations[k] for k in group), tuple(dict.fromkeys(v for k in group for v in rows[k])))
        for group in members.values()
    ]


def _order(system: _System, states: set[int], without: set[int]) -> tuple[Block, ...]:
    known = states | system.inputs
    equations = [e for e in range(len(system.residuals)) if e not in without]
    incidence = Incidence.from_rows(
        ([v for v in system.incidence(e) if v not in known] for e in equations), system.n_variables()
    )
    matched = match(incidence)
    unknowns = {v for v in range(system.n_variables()) if v not in known}
    if len(equations) != len(unknowns) or (matched < 0).any():
        unmatched = [system.source[equations[r]] for r in np.flatnonzero(matched < 0)]
        raise undetermined(system.reduced, unmatched, sorted(unknowns - set(matched.tolist())))
    return tuple(Block(tuple(equations[r] for r in b.rows), b.columns) for b in blocks(incidence, matched))


class _System:
    """The reduced system as a `Differentiable` for Pantelides' algorithm."""

    def __init__(self, reduced: ReducedSystem) -> None:
        self.reduced = reduced
        self.pool = reduced.pool
        self.derivative_of = reduced.pool.derivative_of
        self.residuals = list(reduced.residuals)
        self.source = list(reduced.equation)  # flat equation that each residual comes from
        self.level = [0] * len(self.residuals)  # how often each was differentiated
        self.inputs = set(reduced.inputs)
        self._rows: dict[int, list[int]] = {}

    def n_variables(self) -> int:
        return self.pool.n_variables

    def incidence(self, equation: int) -> list[int]:
        row = self._rows.get(equation)
        if row is None:
            row = sorted(self.pool.variables_in(self.residuals[equation]) - self.inputs)
            self._rows[equation] = row
        return row

    def differentiate_variable(self, variable: int) -> int:
        return self.pool.derivative(variable)

    def differentiate_equation(self, equation: int) -> int:
        level = self.level[equation] + 1
        if level in _CHECKED_LEVELS:
            refuse_if_singular(self.reduced, self.source[equation], level == _CHECKED_LEVELS[-1])
        self.level.append(level)
        self.residuals.append(differentiate(self.pool, self.residuals[equation]))
        self.source.append(self.source[equation])
        return len(self.residuals) - 1

    def hidden(self, equation: int, differentiated: int) -> list[int]:
        """Derivatives of variables of an equation that the differentiated one lacks, thanks to known rates."""
        rates = map(self.derivative_of.get, self.incidence(equation))
        shown = set(self.incidence(differentiated))
        return [v for v in rates if v is not None and v not in shown]

    def rows(self, points: SamplePoints) -> Callable[[Sequence[int], Sequence[int]], list[dict[int, Samples]]]:
        """Sparse rows of d(equation)/d(variable) times the nominal value of the variable, at the sample points."""

        def rows(equations: Sequence[int], variables: Sequence[int]) -> list[dict[int, Samples]]:
            slopes = gradients(self.pool, [self.residuals[e] for e in equations], variables, points.leaves_anywhere)
            size = {v: self._nominal(v) for v in variables}
            return [
                {v: np.broadcast_to(np.asarray(g * size[v], dtype=float), (COUNT + FAR,)) for v, g in row.items()}
                for row in slopes
            ]

        return rows

    def _nominal(self, variable: int) -> float:
        """Declared magnitude, so that charges of 1e-12 C are not negligible next to voltages of 1 V."""
        flat = self.reduced.flat
        sizes = (abs(flat.declaration(s).nominal) for s in self.reduced.aliases.get(variable, ()))
        return next((s for s in sizes if s not in (0.0, 1.0)), 1.0)

    @property
    def rate(self) -> int:
        """Node of the stabilisation rate."""
        return self.pool.par(len(self.reduced.flat.parameter_values))

    def stabilise(self, highest: Sequence[int], integral: dict[int, int]) -> list[tuple[int, int]]:
        """Replace highest derivatives of constraints by (d/dt + rate)^k g; return (equation, node) of all lower ones.

        These are the constraints themselves and their derivatives below the highest.
        """
        invariants = []
        original = list(self.residuals)
        derivative = {old: new for new, old in integral.items()}
        for floating in highest:
            chain = [floating]
            while chain[-1] in integral:
                chain.append(integral[chain[-1]])
            order = len(chain) - 1
            invariants += [(e, original[e]) for e in chain[1:]]
            while chain[0] in derivative:
                chain.insert(0, derivative[chain[0]])
            for k, e in enumerate(chain[: len(chain) - order]):
                self.residuals[e] = self._decaying([original[c] for c in chain[k : k + order + 1]])
                self._rows.pop(e, None)
        return invariants

    def _decaying(self, chain: Sequence[int]) -> int:
        """(d/dt + rate)^n g from the nodes of g^(n), ..., g', g."""
        pool = self.pool
        total, factor = chain[0], pool.one
        for k, lower in enumerate(chain[1:], start=1):
            factor = pool.mul(factor, self.rate)
            weight = pool.mul(pool.const(float(comb(len(chain) - 1, k))), factor)
            total = pool.add(total, pool.mul(weight, lower))
        return total


def preference(reduced: ReducedSystem) -> Callable[[int], float]:
    """Rank of a variable as a state, the largest first: by its declared preference, then by a declared fixed start."""

    def preference(variable: int) -> float:
        rank, is_fixed = 1.0, False
        for scalar in reduced.aliases.get(variable, ()):
            prefer = reduced.flat.declaration(scalar).prefer_state
            if prefer is not None:
                rank = max(rank, 2.0) if prefer else min(rank, 0.0)
            start = reduced.flat.starts.get(scalar)
            is_fixed = is_fixed or (start is not None and start.is_fixed)
        return rank + 0.5 * is_fixed if rank > 0.0 else rank

    return preference


def _check_inputs(reduced: ReducedSystem) -> None:
    for u in reduced.inputs:
        if u in reduced.pool.derivative_of:
            raise differentiated_input(reduced, u)


def _check_choices(reduced: ReducedSystem, integral: dict[int, int], choices: Sequence[Choice]) -> None:
    for choice in choices:
        if not choice.deficient:
            continue
        sources = []
        for e in choice.deficient:
            while e in integral:
                e = integral[e]
            sources.append(reduced.flat.equations[reduced.equation[e]])
        raise redundant_constraints(reduced, sources)
