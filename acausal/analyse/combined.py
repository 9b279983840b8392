"""Unknowns that nonlinear equations know in one combination only: it becomes a variable of its own.

Two charges side by side say `q1 == f(a - b)` and `q2 == g(a - b)`. What they hide, f^-1(q1) == g^-1(q2), shows in no
sum, and index reduction sees two equations for two potentials. With `w == a - b` both stand for one unknown, and the
second is differentiated as any other constraint. Combinations are recognised as they are written, up to a factor.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass, replace

from acausal.analyse.analyse import Structure
from acausal.analyse.blocks.linear import LinearForm
from acausal.flatten.flat import FlatEquation, FlatSystem, FlatVariable
from acausal.flatten.pool import LEAVES, Pool
from acausal.flatten.reduced import ReducedSystem, nominal
from acausal.flatten.terms import SUMS, terms
from acausal.flatten.translated import with_variables


@dataclass(frozen=True)
class _Combination:
    """Unknowns and their factors, nodes; that of the first is one."""

    factors: tuple[tuple[int, int], ...]

    def share(self, pool: Pool, linear: dict[int, int]) -> int | None:
        """What this combination counts in a linear form that holds just that of its unknowns; None if none does."""
        first = linear.get(self.factors[0][0])
        if first is None:
            return None
        wanted = ((v, pool.mul(first, factor)) for v, factor in self.factors)
        fits = all(v in linear and _signed(pool, linear[v]) == _signed(pool, c) for v, c in wanted)
        return first if fits else None


@dataclass(frozen=True, eq=False)
class Combined:
    """A flat system with variables for combinations."""

    flat: FlatSystem  # its equations `rewritten` are stated as the reduced system had them
    rewritten: frozenset[int]
    image: dict[int, int]  # its nodes for those of the system that it was made of


def holding_combinations(structure: Structure, rows: Iterable[int], unknowns: Collection[int]) -> list[int]:
    """Those of these equations of the reduced system that hold combinations of unknowns in nonlinear terms.

    `unknowns` are the variables that are not known from states.
    """
    reduced = structure.reduced
    form = LinearForm(reduced.pool, unknowns)
    return [r for r in rows if form.of(reduced.residuals[r]) is None and _held(form, reduced.residuals[r])]


def with_combinations(structure: Structure, rows: Iterable[int], unknowns: Collection[int]) -> Combined:
    """A variable for each combination of unknowns that these equations hold in nonlinear terms."""
    reduced, pool = structure.reduced, structure.reduced.pool
    form = LinearForm(pool, unknowns)
    curved = list(dict.fromkeys(rows))
    held = {r: _held(form, reduced.residuals[r]) for r in curved}
    found = list(dict.fromkeys(c for r in curved for c in held[r].values()))
    own = {c: pool.new_variables(1) for c in found}
    first = reduced.flat.n_scalars
    flat, image = with_variables(reduced.flat, len(found))
    new = {own[c]: first + k for k, c in enumerate(found)}

    def number(variable: int) -> int:
        if variable in new:
            return new[variable]
        if variable >= len(reduced.scalar):
            return flat.pool.derivative(number(pool.integral_of[variable]))
        scalar = reduced.scalar[variable]
        return scalar if scalar < first else scalar + len(found)

    made = tuple(_variable(reduced, c, new[own[c]]) for c in found)
    equations = list(flat.equations)
    for r in curved:
        node = transferred(pool, _rewritten(form, reduced.residuals[r], own), flat.pool, number)
        place = reduced.equation[r]
        equations[place] = equations[place]._replace(left=node, right=flat.pool.zero)
    for c, v in zip(found, made, strict=True):
        meaning = pool.sum(pool.mul(factor, pool.var(x)) for x, factor in c.factors)
        here = equations[reduced.equation[next(r for r in curved if c in held[r].values())]]
        right = transferred(pool, meaning, flat.pool, number)
        text = f"{v.path} is one variable, as nonlinear equations hold it"
        equations.append(FlatEquation(flat.pool.var(v.first), right, here.origin, here.component, text))
    sizes = flat.nominals and (*flat.nominals, *(nominal(reduced, c.factors[0][0]) for c in found))
    flat = replace(flat, equations=tuple(equations), variables=(*flat.variables, *made), nominals=sizes)
    return Combined(flat, frozenset(reduced.equation[r] for r in curved), image)


def transferred(old: Pool, root: int, new: Pool, number: Callable[[int], int]) -> int:
    """A node of one pool in another, where variables have other numbers."""
    done: dict[int, int] = {}
    for node in old.reachable([root]):
        op, *operands = old.nodes[node]
        if op == "var":
            done[node] = new.var(number(operands[0]))
        elif op in LEAVES:
            done[node] = new.intern(old.nodes[node])
        else:
            done[node] = new.make(op, *[done[c] for c in operands])
    return done[root]


def _held(form: LinearForm, root: int) -> dict[int, _Combination]:
    """Nodes that are linear in several unknowns and stand in a term that is not, with their combinations."""
    pool, found = form.pool, dict[int, _Combination]()
    seen: set[int] = set()
    stack = [n for n, _ in terms(pool, root) if form.of(n) is None]
    while stack:
        number = stack.pop()
        if number in seen or pool.nodes[number][0] in LEAVES:
            continue
        seen.add(number)
        linear = form.of(number)
        if linear is None or (len(linear[1]) > 1 and pool.nodes[number][0] not in SUMS):
            stack += pool.nodes[number][1:]
        elif len(linear[1]) > 1:
            combination = _combination(pool, linear[1])
            if combination is not None:
                found[number] = combination
    return found


def _combination(pool: Pool, linear: dict[int, int]) -> _Combination | None:
    """The linear form by the factor of its first variable; None where that may be zero."""
    order = sorted(linear)
    first = linear[order[0]]
    value = pool.value(first)
    if value is not None:
        return _Combination(tuple((v, pool.div(linear[v], first)) for v in order))
    sign, core = _signed(pool, first)
    others = [_signed(pool, linear[v]) for v in order]
    if any(node != core for _, node in others):
        return None
    return _Combination(tuple((v, pool.const(sign * own)) for v, (own, _) in zip(order, others, strict=True)))


def _signed(pool: Pool, node: int) -> tuple[float, int]:
    """A factor as a sign and the rest: -1 / p and -(1 / p) are the same."""
    op, *operands = pool.nodes[node]
    if op == "const":
        return (-1.0, pool.const(-operands[0])) if operands[0] < 0.0 else (1.0, node)
    if op == "neg":
        sign, rest = _signed(pool, operands[0])
        return -sign, rest
    if op in ("mul", "div"):
        (one, a), (other, b) = (_signed(pool, n) for n in operands)
        return one * other, pool.make(op, a, b)
    return 1.0, node


def _rewritten(form: LinearForm, root: int, own: dict[_Combination, int]) -> int:
    """The expression with the combinations as variables, in its linear terms too."""
    pool = form.pool
    curved = pool.zero
    rest, total = pool.zero, dict[int, int]()
    image: dict[int, int] = {}
    for term, times in terms(pool, root):
        factor, linear = pool.const(float(times)), form.of(term)
        if linear is None:
            curved = pool.add(curved, pool.mul(factor, _image(form, term, own, image)))
            continue
        rest = pool.add(rest, pool.mul(factor, linear[0]))
        for v, c in linear[1].items():
            total[v] = pool.add(total.get(v, pool.zero), pool.mul(factor, c))
    return pool.add(curved, _named(pool, rest, total, own))


def _image(form: LinearForm, root: int, own: dict[_Combination, int], done: dict[int, int]) -> int:
    pool = form.pool
    for number in pool.reachable([root], done):
        op, *operands = pool.nodes[number]
        linear = form.of(number)
        if op in LEAVES:
            done[number] = number
        elif linear is not None and len(linear[1]) > 1 and op in SUMS:
            done[number] = _named(pool, linear[0], linear[1], own)
        else:
            made = pool.make(op, *[done[c] for c in operands])
            done[number] = pool.collected(made) if op in SUMS else made
    return done[root]


def _named(pool: Pool, rest: int, linear: dict[int, int], own: dict[_Combination, int]) -> int:
    """A linear form with what is one of the combinations as its variable."""
    left = dict(linear)
    for combination, variable in own.items():
        share = combination.share(pool, left)
        if share is not None:
            rest = pool.add(rest, pool.mul(share, pool.var(variable)))
            left = {v: c for v, c in left.items() if v not in dict(combination.factors)}
    return pool.add(rest, pool.sum(pool.mul(c, pool.var(v)) for v, c in left.items()))


def _variable(reduced: ReducedSystem, combination: _Combination, number: int) -> FlatVariable:
    """As declared as the first of its unknowns, under the words for the combination."""
    pool, words = reduced.pool, ""
    for v, factor in combination.factors:
        value = pool.value(factor)
        size = "" if value in (1.0, -1.0) else "... " if value is None else f"{abs(value):.6g} "
        words += (" - " if value is not None and value < 0.0 else " + ") + size + reduced.name(v)
    declared = reduced.flat.declaration(reduced.scalar[combination.factors[0][0]])
    return FlatVariable(f"({words[3:]})", declared, number, 1)
