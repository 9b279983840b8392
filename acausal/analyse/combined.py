"""Combinations of unknowns that occur as a whole in nonlinear equations become variables themselves.

Two nonlinear capacitors in parallel state `q1 == f(a - b)` and `q2 == g(a - b)`. Their hidden constraint, f^-1(q1) ==
g^-1(q2), is no linear combination of the equations, and structurally there are two equations for two potentials. With
`w == a - b` both contain the one unknown w, and the second is differentiated like any other constraint. Combinations
are recognised only as they are written, up to a factor.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass, replace

from acausal.analyse.analyse import Structure
from acausal.analyse.blocks.linear import LinearForm
from acausal.flatten.flat import FlatEquation, FlatSystem, FlatVariable, with_variables
from acausal.flatten.pool import LEAVES, Pool
from acausal.flatten.reduced import ReducedSystem, nominal
from acausal.flatten.terms import SUMS, terms


@dataclass(frozen=True)
class _Combination:
    """A linear combination: pairs (unknown, node of its factor), of which the first factor is one."""

    factors: tuple[tuple[int, int], ...]

    def factor_in(self, pool: Pool, linear: dict[int, int]) -> int | None:
        """The factor by which a linear form contains this combination; None if it does not."""
        first = linear.get(self.factors[0][0])
        if first is None:
            return None
        required = ((v, pool.mul(first, factor)) for v, factor in self.factors)
        fits = all(
            v in linear and _sign_and_magnitude(pool, linear[v]) == _sign_and_magnitude(pool, c) for v, c in required
        )
        return first if fits else None


@dataclass(frozen=True, eq=False)
class Combined:
    """A flat system with variables for combinations.

    Attributes
    ----------
    rewritten
        Indices of flat equations that have been replaced by those of the reduced system.
    image
        Maps nodes of the original flat system to nodes of this one.
    """

    flat: FlatSystem
    rewritten: frozenset[int]
    image: dict[int, int]


def holding_combinations(structure: Structure, rows: Iterable[int], unknowns: Collection[int]) -> list[int]:
    """Those equations `rows` of the reduced system that contain combinations of unknowns in nonlinear terms.

    `unknowns` are the variables that the states do not determine.
    """
    reduced = structure.reduced
    form = LinearForm(reduced.pool, unknowns)
    return [r for r in rows if form.of(reduced.residuals[r]) is None and _combinations_in(form, reduced.residuals[r])]


def with_combinations(structure: Structure, rows: Iterable[int], unknowns: Collection[int]) -> Combined:
    """The flat system with a variable for each combination of unknowns in nonlinear terms of the equations `rows`."""
    reduced, pool = structure.reduced, structure.reduced.pool
    form = LinearForm(pool, unknowns)
    nonlinear_rows = list(dict.fromkeys(rows))
    combinations_of = {r: _combinations_in(form, reduced.residuals[r]) for r in nonlinear_rows}
    combinations = list(dict.fromkeys(c for r in nonlinear_rows for c in combinations_of[r].values()))
    variable_of = {c: pool.new_variables(1) for c in combinations}
    first = reduced.flat.n_scalars
    flat, image = with_variables(reduced.flat, len(combinations))
    new = {variable_of[c]: first + k for k, c in enumerate(combinations)}

    def number(variable: int) -> int:
        if variable in new:
            return new[variable]
        if variable >= len(reduced.scalar):
            return flat.pool.derivative(number(pool.integral_of[variable]))
        scalar = reduced.scalar[variable]
        return scalar if scalar < first else scalar + len(combinations)

    added = tuple(_variable(reduced, c, new[variable_of[c]]) for c in combinations)
    equations = list(flat.equations)
    for r in nonlinear_rows:
        node = transferred(pool, _substitute(form, reduced.residuals[r], variable_of), flat.pool, number)
        index = reduced.equation[r]
        equations[index] = equations[index]._replace(left=node, right=flat.pool.zero)
    for c, v in zip(combinations, added, strict=True):
        meaning = pool.sum(pool.mul(factor, pool.var(x)) for x, factor in c.factors)
        here = equations[reduced.equation[next(r for r in nonlinear_rows if c in combinations_of[r].values())]]
        right = transferred(pool, meaning, flat.pool, number)
        text = f"{v.path} is one variable, because nonlinear equations contain it as a whole"
        equations.append(FlatEquation(flat.pool.var(v.first), right, here.origin, here.component, text))
    sizes = flat.nominals and (*flat.nominals, *(nominal(reduced, c.factors[0][0]) for c in combinations))
    flat = replace(flat, equations=tuple(equations), variables=(*flat.variables, *added), nominals=sizes)
    return Combined(flat, frozenset(reduced.equation[r] for r in nonlinear_rows), image)


def transferred(old: Pool, root: int, new: Pool, number: Callable[[int], int]) -> int:
    """Copy a node to another pool; `number` maps the old variables to the new ones."""
    variables = old.variables_in(root)
    done = dict(zip(old.vars(variables), new.vars(map(number, variables)), strict=True))
    new.copy(old, old.reachable([root]), done)
    return done[root]


def _combinations_in(form: LinearForm, root: int) -> dict[int, _Combination]:
    """Maps nodes inside nonlinear terms that are linear in several unknowns to their combinations."""
    pool, combination_of = form.pool, dict[int, _Combination]()
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
                combination_of[number] = combination
    return combination_of


def _combination(pool: Pool, linear: dict[int, int]) -> _Combination | None:
    """A linear form divided by the factor of its first variable; None where that may be zero."""
    order = sorted(linear)
    first = linear[order[0]]
    value = pool.value(first)
    if value is not None:
        return _Combination(tuple((v, pool.div(linear[v], first)) for v in order))
    sign, core = _sign_and_magnitude(pool, first)
    others = [_sign_and_magnitude(pool, linear[v]) for v in order]
    if any(node != core for _, node in others):
        return None
    return _Combination(tuple((v, pool.const(sign * other)) for v, (other, _) in zip(order, others, strict=True)))


def _sign_and_magnitude(pool: Pool, node: int) -> tuple[float, int]:
    """(Sign, node of the magnitude) of a factor, so that -1 / p and -(1 / p) compare equal."""
    op, *operands = pool.nodes[node]
    if op == "const":
        return (-1.0, pool.const(-operands[0])) if operands[0] < 0.0 else (1.0, node)
    if op == "neg":
        sign, rest = _sign_and_magnitude(pool, operands[0])
        return -sign, rest
    if op in ("mul", "div"):
        (one, a), (other, b) = (_sign_and_magnitude(pool, n) for n in operands)
        return one * other, pool.make(op, a, b)
    return 1.0, node


def _substitute(form: LinearForm, root: int, variable_of: dict[_Combination, int]) -> int:
    """An expression with the combinations replaced by variables, in its linear terms as well."""
    pool = form.pool
    curved = pool.zero
    rest, total = pool.zero, dict[int, int]()
    image: dict[int, int] = {}
    for term, times in terms(pool, root):
        factor, linear = pool.const(float(times)), form.of(term)
        if linear is None:
            curved = pool.add(curved, pool.mul(factor, _image(form, term, variable_of, image)))
            continue
        rest = pool.add(rest, pool.mul(factor, linear[0]))
        for v, c in linear[1].items():
            total[v] = pool.add(total.get(v, pool.zero), pool.mul(factor, c))
    return pool.add(curved, _substitute_linear(pool, rest, total, variable_of))


def _image(form: LinearForm, root: int, variable_of: dict[_Combination, int], done: dict[int, int]) -> int:
    pool = form.pool
    for number in pool.reachable([root], done):
        op, *operands = pool.nodes[number]
        linear = form.of(number)
        if op in LEAVES:
            done[number] = number
        elif linear is not None and len(linear[1]) > 1 and op in SUMS:
            done[number] = _substitute_linear(pool, linear[0], linear[1], variable_of)
        else:
            made = pool.make(op, *[done[c] for c in operands])
            done[number] = pool.collected(made) if op in SUMS else made
    return done[root]


def _substitute_linear(pool: Pool, rest: int, linear: dict[int, int], variable_of: dict[_Combination, int]) -> int:
    """A linear form with the combinations in it replaced by their variables."""
    remaining = dict(linear)
    for combination, variable in variable_of.items():
        factor = combination.factor_in(pool, remaining)
        if factor is not None:
            rest = pool.add(rest, pool.mul(factor, pool.var(variable)))
            remaining = {v: c for v, c in remaining.items() if v not in dict(combination.factors)}
    return pool.add(rest, pool.sum(pool.mul(c, pool.var(v)) for v, c in remaining.items()))


def _variable(reduced: ReducedSystem, combination: _Combination, number: int) -> FlatVariable:
    """The new variable, declared like the first unknown of its combination and named by the text of the combination."""
    pool, text_of_sum = reduced.pool, ""
    for v, factor in combination.factors:
        value = pool.value(factor)
        size = "" if value in (1.0, -1.0) else "... " if value is None else f"{abs(value):.6g} "
        text_of_sum += (" - " if value is not None and value < 0.0 else " + ") + size + reduced.name(v)
    declared = reduced.flat.declaration(reduced.scalar[combination.factors[0][0]])
    return FlatVariable(f"({text_of_sum[3:]})", declared, number, 1)
