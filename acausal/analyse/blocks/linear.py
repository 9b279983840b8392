"""Symbolic linear forms of pool expressions: e = rest + sum of coefficient[v] * v."""

from __future__ import annotations

from collections.abc import Collection

from acausal.flatten.pool import LEAVES, Pool
from acausal.flatten.terms import LONG, SUMS, is_long, terms

Linear = tuple[int, dict[int, int]]


def linear_in(pool: Pool, root: int, variable: int) -> Linear | None:
    """(rest, {variable: coefficient}) of an expression, or None when it is not linear in the variable."""
    explicit = _explicit(pool, root, variable)
    return LinearForm(pool, (variable,)).of(root) if explicit is None else explicit


def _explicit(pool: Pool, root: int, variable: int) -> Linear | None:
    """The form of `factor * variable - expression` and similar, which most equations of large models have."""
    op, *sides = pool.nodes[root]
    if op not in SUMS:
        return None
    for k, side in enumerate(sides):
        factor = _factor(pool, side, variable)
        if factor is not None:
            other = sides[1 - k]
            if variable in pool.entries(other):
                return None
            if op == "add":
                return other, {variable: factor}
            return (pool.neg(other), {variable: factor}) if k == 0 else (other, {variable: pool.neg(factor)})
    return None


def _factor(pool: Pool, number: int, variable: int) -> int | None:
    """The factor in `factor * variable`, one for the variable itself; None for any other expression."""
    node = pool.nodes[number]
    wanted = ("var", variable)
    if node == wanted:
        return pool.one
    if node[0] == "mul":
        first: int = node[1]
        second: int = node[2]
        for this, other in ((first, second), (second, first)):
            if pool.nodes[this] == wanted and variable not in pool.entries(other):
                return other
    return None


class LinearForm:
    """Linear forms of expressions in a set of variables; shared sub-expressions are decomposed only once."""

    def __init__(self, pool: Pool, variables: Collection[int]) -> None:
        self.pool = pool
        self.variables = variables
        self._done: dict[int, Linear | None] = {}
        self._chains: dict[int, dict[int, int]] = {}

    def of(self, root: int) -> Linear | None:
        """(rest, {variable: coefficient}), or None when `root` is not linear in the variables."""
        done = self._done
        if root in done:
            return done[root]
        nodes = self.pool.nodes
        if len(self.variables) == 1 and (explicit := _explicit(self.pool, root, *self.variables)) is not None:
            return explicit
        unvisited = self.pool.reachable([root], done)
        if len(unvisited) <= LONG:  # too few nodes to contain a long sum
            for number in unvisited:
                node = nodes[number]
                if node[0] in LEAVES:
                    done[number] = self._leaf(number, node)
                    continue
                parts = [done[c] for c in node[1:]]
                is_apart = all([p is not None and not p[1] for p in parts])
                done[number] = (number, {}) if is_apart else self._combine(number, node[0], parts)
            return done[root]
        stack = [root]
        while stack:
            number = stack[-1]
            if number in done:
                stack.pop()
                continue
            node = nodes[number]
            if node[0] in LEAVES:
                done[number] = self._leaf(number, node)
                stack.pop()
                continue
            chain = self._chain(number) if node[0] in SUMS else None
            missing = [c for c in (node[1:] if chain is None else chain) if c not in done]
            if missing:
                stack.extend(missing)
                continue
            if chain is None:
                done[number] = self._combine(number, node[0], [done[c] for c in node[1:]])
            else:
                done[number] = self._add_up(number, chain)
            stack.pop()
        return done[root]

    def _chain(self, number: int) -> dict[int, int] | None:
        """Terms of a long sum with their factors; None for a short one."""
        chain = self._chains.get(number)
        if chain is None and is_long(self.pool, number):
            chain = self._chains[number] = dict(terms(self.pool, number))
        return chain

    def _add_up(self, number: int, chain: dict[int, int]) -> Linear | None:
        pool, done = self.pool, self._done
        rest, total = pool.zero, dict[int, int]()
        for term, times in chain.items():
            part = done[term]
            if part is None:
                return None
            if times not in (1, -1):
                factor = pool.const(float(times))
                part = pool.mul(factor, part[0]), {v: pool.mul(factor, c) for v, c in part[1].items()}
            combine = pool.sub if times == -1 else pool.add
            rest = combine(rest, part[0])
            for v, c in part[1].items():
                total[v] = combine(total.get(v, pool.zero), c)
        total = {v: c for v, c in total.items() if c != pool.zero}
        return (rest, total) if total else (number, {})

    def _leaf(self, number: int, node: tuple[object, ...]) -> Linear:
        if node[0] == "var" and node[1] in self.variables:
            return self.pool.zero, {node[1]: self.pool.one}  # type: ignore[dict-item]
        return number, {}

    def _combine(self, number: int, op: str, parts: list[Linear | None]) -> Linear | None:
        forms = [p for p in parts if p is not None]
        if len(forms) == len(parts) and not any(p[1] for p in forms):
            return number, {}
        if op == "where":
            return self._where(number, parts)
        if len(forms) != len(parts):
            return None
        pool = self.pool
        if op == "neg":
            return pool.neg(forms[0][0]), {v: pool.neg(c) for v, c in forms[0][1].items()}
        if op in ("add", "sub"):
            return self._sum(forms[0], forms[1], op)
        if op == "mul":
            for this, other in ((forms[0], forms[1]), (forms[1], forms[0])):
                if not other[1]:
                    factor = other[0]
                    return pool.mul(this[0], factor), {v: pool.mul(c, factor) for v, c in this[1].items()}
            return None
        if op == "homotopy":
            (a, of_a), (s, of_s) = forms
            variables = {*of_a, *of_s}
            mixed = {v: pool.make(op, of_a.get(v, pool.zero), of_s.get(v, pool.zero)) for v in variables}
            return pool.make(op, a, s), mixed
        if op == "div" and not forms[1][1]:
            d = forms[1][0]
            return pool.div(forms[0][0], d), {v: pool.div(c, d) for v, c in forms[0][1].items()}
        return None

    def _sum(self, a: Linear, b: Linear, op: str) -> Linear:
        pool = self.pool
        combine = pool.add if op == "add" else pool.sub
        total = dict(a[1])
        for v, c in b[1].items():
            total[v] = combine(total.get(v, pool.zero), c)
        return combine(a[0], b[0]), {v: c for v, c in total.items() if c != pool.zero}

    def _where(self, number: int, parts: list[Linear | None]) -> Linear | None:
        pool = self.pool
        condition, a, b = parts
        if condition is None or condition[1] or a is None or b is None:
            return None
        c = pool.nodes[number][1]
        variables = {*a[1], *b[1]}
        total = {v: pool.where(c, a[1].get(v, pool.zero), b[1].get(v, pool.zero)) for v in variables}
        return pool.where(c, a[0], b[0]), total
