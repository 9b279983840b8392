"""Linear invariants: sums of equations in which everything but derivatives cancels, imposed as algebraic equations.

`der(a) - der(b) - der(c) == 0` means that a - b - c is constant. Integrating all three satisfies this only within the
tolerance of each, and if one is a small difference of the others, all its digits may be lost (problem E5 of the Bari
test set: 100 % wrong at every tolerance). A charge balance `der(q1) + der(q2) == 0` even saves an integration.

An invariant is used only where no digits are lost: its constant is zero by the declared starts, and one variable is the
sum of others of one sign. A total of 1 that consists mostly of one species is not used, because small species would
become differences of large numbers.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from math import isfinite
from typing import TypeGuard

from acausal.flatten.pool import Pool
from acausal.flatten.reduced import ReducedSystem

# Integers where possible: nearly all factors are 1 or -1, and fractions cost ten times as much.
Number = int | Fraction
Row = dict[int, Number]


@dataclass(frozen=True)
class _Balance:
    """A residual as a sum with constant factors: of derivatives (by variable) and of other terms (by node)."""

    derivatives: Row
    terms: Row


def use_invariants(reduced: ReducedSystem) -> ReducedSystem:
    """The system with one differential equation of each usable invariant replaced by the invariant itself.

    A model with `when`s is returned unchanged, because resets need not satisfy the invariant. Discrete equations and
    assertions change no state that is integrated.
    """
    if reduced.whens or reduced.delays:
        return reduced
    balances = _balances(reduced)
    combinations = null_combinations({i: b.terms for i, b in balances.items()})
    if not combinations:
        return reduced
    residuals = list(reduced.residuals)
    occurrences = _occurrences(reduced)
    dropped: set[int] = set()
    for combination in combinations:
        weights = combined([(w, balances[i].derivatives) for i, w in combination.items()])
        chosen = _choose(reduced, weights, occurrences, combination)
        if chosen is None or weights.keys() & dropped:
            continue
        equation, vanished = chosen
        residuals[equation] = _sum(reduced.pool, {reduced.pool.integral_of[d]: w for d, w in weights.items()})
        dropped |= vanished
    return _without(replace(reduced, residuals=tuple(residuals)), dropped) if dropped else reduced


def _balances(reduced: ReducedSystem) -> dict[int, _Balance]:
    """Residuals that are linear in derivatives with constant factors."""
    pool = reduced.pool
    balances = {}
    for i, residual in enumerate(reduced.residuals):
        if pool.integral_of.keys().isdisjoint(pool.variables_in(residual)):
            continue
        total: Row = {}
        add_terms(pool, residual, 1, total)
        derivatives: Row = {}
        terms: Row = {}
        for node, weight in total.items():
            kind, *rest = pool.nodes[node]
            if kind == "var" and rest[0] in pool.integral_of:
                derivatives[rest[0]] = weight
            else:
                terms[node] = weight
        if derivatives and not any(v in pool.integral_of for v in pool.variables_in(*terms)):
            balances[i] = _Balance(derivatives, terms)
    return balances


def _is_factor(value: float | None) -> TypeGuard[float]:
    return value is not None and isfinite(value)


def add_terms(pool: Pool, root: int, factor: Number, total: Row) -> None:
    """Add `factor` times an expression, split into its terms, to `total`."""
    stack: list[tuple[int, Number]] = [(root, factor)]
    while stack:
        number, weight = stack.pop()
        op, *args = pool.nodes[number]
        if op == "add" or op == "sub":
            stack += [(args[0], weight), (args[1], weight if op == "add" else -weight)]
        elif op == "neg":
            stack.append((args[0], -weight))
        elif op == "mul" and _is_factor(value := pool.value(args[0])):
            stack.append((args[1], weight * Fraction(value)))
        elif op == "mul" and _is_factor(value := pool.value(args[1])):
            stack.append((args[0], weight * Fraction(value)))
        elif op == "div" and _is_factor(value := pool.value(args[1])) and value:
            stack.append((args[0], weight / Fraction(value)))
        else:
            total[number] = total.get(number, 0) + weight
            if not total[number]:
                del total[number]


def null_combinations(sums: Mapping[int, Row]) -> list[Row]:
    """Combinations of rows in which all terms cancel.

    `sums` maps row indices to terms (node -> factor). Each combination maps row indices to weights; the last row that
    takes part comes first.
    """
    rows = dict(sums)
    users: dict[int, set[int]] = {}
    for i, row in rows.items():
        for term in row:
            users.setdefault(term, set()).add(i)
    # A row with a term that no other row has is in no combination; removing it may isolate another row.
    isolated = [next(iter(rows_)) for rows_ in users.values() if len(rows_) == 1]
    while isolated:
        i = isolated.pop()
        for term in rows.pop(i, {}):
            users[term].discard(i)
            isolated += [next(iter(users[term]))] if len(users[term]) == 1 else []
    combinations = []
    pivots: list[tuple[int, Row, Row]] = []  # (pivot term, reduced row, its combination of the original rows)
    for i, terms in rows.items():
        row = dict(terms)
        combination: Row = {i: 1}
        for term, other, combination_of_other in pivots:
            factor = Fraction(row.get(term, 0)) / other[term]
            if factor:
                row = combined([(1, row), (-factor, other)])
                combination = combined([(1, combination), (-factor, combination_of_other)])
        if row:
            pivots.append((next(iter(row)), row, combination))
        else:
            combinations.append(combination)
    return combinations


def combined(parts: list[tuple[Number, Row]]) -> Row:
    total: Row = {}
    for factor, row in parts:
        for key, weight in row.items():
            total[key] = total.get(key, 0) + factor * weight
    return {key: weight for key, weight in total.items() if weight}


def _choose(
    reduced: ReducedSystem, weights: Row, occurrences: Mapping[int, set[int]], combination: Row
) -> tuple[int, set[int]] | None:
    """(Residual to replace, derivatives that vanish with it); None if the invariant is not to be used."""
    pool = reduced.pool
    if len(weights) < 2 or not all(_starts_at_zero(reduced, pool.integral_of[d]) for d in weights):
        return None
    signs = {d: w > 0 for d, w in weights.items()}
    for d in weights:
        others = {s for e, s in signs.items() if e != d}
        if len(others) > 1 or (others == {signs[d]} and len(weights) > 2):
            continue
        users = occurrences[d]
        if len(users) == 1 and (equation := next(iter(users))) in combination:
            return equation, {e for e in weights if occurrences[e] == {equation}}
    return None


def _starts_at_zero(reduced: ReducedSystem, variable: int) -> bool:
    for scalar in reduced.aliases.get(variable, ()):
        start = reduced.flat.starts.get(scalar)
        if start is not None and start.is_fixed and reduced.flat.pool.value(start.node) == 0.0:
            return True
    return False


def _occurrences(reduced: ReducedSystem) -> dict[int, set[int]]:
    """Indices of the residuals that contain each derivative; -1 stands for any other use."""
    pool = reduced.pool
    residuals_with: dict[int, set[int]] = {d: set() for d in pool.integral_of}
    for i, residual in enumerate(reduced.residuals):
        for v in pool.variables_in(residual) & residuals_with.keys():
            residuals_with[v].add(i)
    for v in pool.variables_in(*reduced.image, *reduced.initial, *reduced.event_nodes) & residuals_with.keys():
        residuals_with[v].add(-1)
    for v in residuals_with.keys() & pool.derivative_of.keys():
        residuals_with[v].add(-1)  # differentiated again
    return residuals_with


def _sum(pool: Pool, weights: Row) -> int:
    return pool.sum(pool.mul(pool.const(float(w)), pool.var(v)) for v, w in weights.items())


def _without(reduced: ReducedSystem, dropped: set[int]) -> ReducedSystem:
    """The system in a new pool, without the `dropped` variables, which no equation contains any more."""
    old = reduced.pool
    kept = [v for v in range(old.n_variables) if v not in dropped]
    number = {v: k for k, v in enumerate(kept)}
    pool = Pool()
    pool.new_variables(len(kept))
    for d, x in old.integral_of.items():
        if d in number:
            pool.integral_of[number[d]] = number[x]
            pool.derivative_of[number[x]] = number[d]
    done = dict(zip(old.vars(number), pool.vars(number.values()), strict=True))
    slopes = [(node, slope) for node, slope in old._slopes.items() if not old.variables_in(node, slope) & dropped]
    roots = [*reduced.residuals, *reduced.image, *reduced.initial, *reduced.event_nodes]
    roots += [n for pair in slopes for n in pair]
    pool.copy(old, old.reachable(roots), done)
    pool._slopes.update((done[node], done[slope]) for node, slope in slopes)
    return replace(
        reduced.with_images(done),
        pool=pool,
        scalar=tuple(reduced.scalar[v] for v in kept),
        residuals=tuple(done[r] for r in reduced.residuals),
        inputs=tuple(number[v] for v in reduced.inputs),
        initial=tuple(done[n] for n in reduced.initial),
    )
