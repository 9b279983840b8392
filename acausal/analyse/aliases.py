"""Alias elimination: from the flat system to the reduced one.

Equations `v1 == +-v2`, `v == constant` and `v == der(x)` are substituted rather than solved: one variable represents
each alias class, constants disappear, and v takes the place of der(x). Definitions of rotation matrices are substituted
too, with their rates as known derivatives, so that frames add no unknowns.
"""

from __future__ import annotations

from array import array
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from acausal.diagnose.causes import contradiction
from acausal.flatten.flat import FlatSystem
from acausal.flatten.pool import Pool
from acausal.flatten.reduced import ReducedSystem, ReducedWhen
from acausal.structure import classes


def reduce(flat: FlatSystem, replacements: Mapping[int, int] | None = None) -> ReducedSystem:
    """Eliminate aliases and constants until none is left.

    `replacements` maps flat equations to nodes of the flat pool that replace their residuals
    (`acausal.analyse.hidden`).

    Raises
    ------
    StructureError
        AC205, or a more specific code, when equations contradict each other: a nonzero constant must be zero.
    """
    work = _Aliases(flat, replacements or {})
    while work.sweep():
        pass
    return work.finish()


class _Aliases:
    """Working state of the elimination; each substitution may reveal new aliases, which the next sweep finds."""

    def __init__(self, flat: FlatSystem, replacements: Mapping[int, int]) -> None:
        self.flat = flat
        self.pool = flat.pool
        self.nodes = self.pool.vars(range(flat.n_scalars))  # one per flat scalar
        sub = self.pool.sub
        self.residual = {k: sub(left, right) for k, (left, right, *_) in enumerate(flat.equations)}
        self.residual.update(replacements)
        self.dirty = list(self.residual)  # equations whose variables have changed since they were examined
        self.users = _Users()
        self.relations: list[tuple[int, int, int]] = []
        self.relation_source: list[int] = []
        self.constant: dict[int, tuple[int, int]] = {}  # representative -> (node without variables, equation)
        self.integral: dict[int, int] = {}  # inverse of `link`: derivative -> integral
        self.link: dict[int, tuple[int, int]] = {}  # representative -> (variable that is its derivative, equation)
        self.definition: dict[int, int] = {}  # overconstrained variable -> node
        self.trivial: list[int] = []
        self.redundant: list[int] = []
        self.inputs = set(flat.inputs)
        self.priority = _priorities(flat)
        self.done: dict[int, int] = {}
        self._classes()
        self._definitions()

    def _classes(self) -> None:
        """Recompute representatives after new relations; constants and links that no longer fit become equations."""
        pool = self.pool
        alias_classes = classes(self.flat.n_scalars, self.relations, self.priority)
        self.representative = alias_classes.representative.tolist()
        self.sign = alias_classes.sign.tolist()
        self.redundant = [self.relation_source[k] for k in alias_classes.redundant]
        constants = dict(self.constant)
        if alias_classes.zero.any():
            for k in alias_classes.zero.nonzero()[0].tolist():
                constants.setdefault(self.representative[k], (pool.zero, self.relation_source[-1]))
        self.constant = {}
        for scalar, (node, k) in constants.items():
            r = self.representative[scalar]
            value = node if self.sign[scalar] > 0 else pool.neg(node)
            if r in self.constant:
                self._restore(k, pool.sub(value, self.constant[r][0]))
            else:
                self.constant[r] = (value, k)
        links = self.link
        self.link, self.integral = {}, {}
        for x, (v, k) in links.items():
            (rx, same_x), (rv, same_v) = self._signed(x), self._signed(v)
            fits = same_x and same_v and not {rx, rv} & (self.constant.keys() | self.inputs)
            # Later aliases may identify two derivatives, or a variable with its own derivative.
            if fits and self._linkable(rx, rv):
                self.link[rx] = (rv, k)
                self.integral[rv] = rx
            else:
                self._restore(k, pool.sub(pool.var(v), pool.var(pool.derivative(x))))

    def _signed(self, variable: int) -> tuple[int, bool]:
        """(Representative, whether the sign is +); a derivative represents itself as long as its integral does."""
        pool, base = self.pool, variable
        while base in pool.integral_of:
            base = pool.integral_of[base]
        r, positive = self.representative[base], self.sign[base] > 0
        return (r, positive) if base == variable else (variable, positive and r == base and r not in self.constant)

    def _restore(self, k: int, residual: int) -> None:
        """Turn a relation that cannot stay an alias, constant or link back into an equation."""
        self.residual[k] = residual
        self.dirty.append(k)

    def _definitions(self) -> None:
        """Turn explicit equations of overconstrained variables into substitutions."""
        if not self.pool.slope:
            return
        for k, equation in enumerate(self.flat.equations):
            left = self.pool.nodes[equation.left]
            if left[0] == "var" and left[1] in self.pool.slope and left[1] not in self.definition:
                self.definition[left[1]] = equation.right
                del self.residual[k]
        self.dirty = list(self.residual)

    def leaf(self, variable: int) -> int:
        """Node of a flat variable or derivative after the substitutions found so far."""
        pool = self.pool
        base = pool.integral_of.get(variable)
        if base is None:
            r = self.representative[variable]
            node = self.constant[r][0] if r in self.constant else self._definition_image(r)
            return node if self.sign[variable] > 0 else pool.neg(node)
        node = self.leaf(base)
        op, *rest = pool.nodes[node]
        negative = op == "neg"
        if negative:
            op, *rest = pool.nodes[rest[0]]
        if op != "var":
            return pool.zero if op in ("const", "par") or not pool.variables_in(node) else pool.var(variable)
        x = rest[0]
        image = self.leaf(self.link[x][0]) if x in self.link else pool.var(pool.derivative(x))
        return pool.neg(image) if negative else image

    def _definition_image(self, variable: int) -> int:
        """Image of the definition of an overconstrained variable; without recursion, for long chains of frames."""
        pool = self.pool
        if variable not in self.definition:
            return self.nodes[variable]
        stack = [variable]
        while stack:
            node = self.definition[stack[-1]]
            if node in self.done:
                stack.pop()
                continue
            waiting = [
                r
                for r in (self.representative[v] for v in pool.variables_in(node) if v not in pool.integral_of)
                if r in self.definition and self.definition[r] not in self.done and r not in stack
            ]
            if waiting:
                stack.extend(waiting)
                continue
            stack.pop()
            pool.rewrite([node], self.leaf, self.done)
        return self.done[self.definition[variable]]

    def sweep(self) -> bool:
        """Substitute in changed equations, then use aliases and constants, or links if there are none; True if any."""
        self._substitute()
        relations = len(self.relations)
        touched: set[int] = set()
        nodes, residual = self.pool.nodes, self.residual
        used = [k for k in self.dirty if self._alias(k, nodes[residual[k]], touched)]
        for k in used:
            del residual[k]
        for k in self.dirty:  # equations that became aliases are not examined again
            if k in residual:
                self.users.add(k, self.pool.entries(residual[k]))
        if not used:
            with_derivatives = self.users.of(self.pool.integral_of, self.pool.n_variables)
            candidates = sorted(residual.keys() & with_derivatives)
            used = [k for k in candidates if self._link(k, nodes[residual[k]], touched)]
            for k in used:
                del residual[k]
        self.dirty = []
        if not used:
            return False
        if len(self.relations) > relations or any(x in self.link or x in self.integral for x in touched):
            self._classes()
        self.done = {}
        derivative_of = self.pool.derivative_of
        touched.update([derivative_of[v] for v in touched if v in derivative_of])
        changed = {*self.dirty, *self.users.pop(touched, self.pool.n_variables)}
        self.dirty = sorted(changed & residual.keys())
        return True

    def _substitute(self) -> None:
        pool, residual = self.pool, self.residual
        images = [residual[k] for k in self.dirty]
        if self.relations or self.constant or self.link or self.definition:  # otherwise nothing has changed yet
            pool.rewrite(images, self.leaf, self.done)
            images = [self.done[number] for number in images]
        for k, image in zip(self.dirty, images, strict=True):
            # A variable that cancels would mislead the structural analysis.
            residual[k] = pool.collected(image)

    def _alias(self, k: int, node: tuple[Any, ...], touched: set[int]) -> bool:
        """Use a residual as alias or constant; False when it must stay an equation."""
        if node[0] == "const":
            return self._trivial(k, node[1])
        first, sign, second = self._pattern(node)
        if first is None or first in self.pool.integral_of or first == second:
            return False
        if second is None or isinstance(second, _Constant):
            if first in self.inputs or first in touched:
                return False
            touched.add(first)
            self.constant[first] = (self.pool.zero if second is None else second.node, k)
            return True
        if second in self.pool.integral_of or (first in self.inputs and second in self.inputs):
            return False
        touched.update((first, second))
        self.relations.append((first, second, sign))
        self.relation_source.append(k)
        return True

    def _link(self, k: int, node: tuple[Any, ...], touched: set[int]) -> bool:
        """Use v == der(x): v becomes the derivative of x."""
        pool = self.pool
        first, sign, second = self._pattern(node)
        if first is None or not isinstance(second, int) or sign < 0:
            return False
        dx, v = (first, second) if first in pool.integral_of else (second, first)
        x = pool.integral_of.get(dx)
        if x is None or v in pool.integral_of or v in self.inputs or x in self.inputs:
            return False
        if not self._linkable(x, v):
            return False
        touched.update((x, v))
        self.integral[v] = x
        self.link[x] = (v, k)
        return True

    def _linkable(self, x: int, v: int) -> bool:
        """Whether v can become the derivative of x: both unlinked so far, and without a cycle."""
        if v in self.integral or x in self.link:
            return False
        above: int | None = x
        while above is not None:
            if above == v:
                return False  # x' = y, y' = x: one of the two stays an equation
            above = self.integral.get(above)
        return True

    def _trivial(self, k: int, value: float) -> bool:
        if abs(value) > 1e-12:
            raise contradiction(self.flat, self.flat.equations[k], value)
        self.trivial.append(k)
        return True

    def _pattern(self, node: tuple[Any, ...]) -> tuple[int | None, int, int | _Constant | None]:
        """(v, sign, other) for v = sign * other, v = constant or v = 0 (other None); v is None if no pattern fits."""
        pool = self.pool
        op = node[0]
        if op == "var":
            return node[1], 1, None
        if op == "neg" and pool.nodes[node[1]][0] == "var":
            return pool.nodes[node[1]][1], 1, None
        if op not in ("add", "sub"):
            return None, 1, None
        a, b = pool.nodes[node[1]], pool.nodes[node[2]]
        if a[0] == "neg" and pool.nodes[a[1]][0] == "var" and b[0] == "var":
            return pool.nodes[a[1]][1], 1 if op == "add" else -1, b[1]
        if a[0] == "var" and b[0] == "var":
            return a[1], 1 if op == "sub" else -1, b[1]
        for this, other in ((a, node[2]), (b, node[1])):
            if this[0] == "var" and pool.is_constant(other):
                constant: int = other
                return this[1], 1, _Constant(constant if op == "sub" else pool.neg(constant))
        return None, 1, None

    def finish(self) -> ReducedSystem:
        """Translate the remaining equations into a new pool."""
        self.users = _Users()  # frees memory
        pool = Pool()
        number: dict[int, int] = {}
        old = self.pool

        image_old = self._scalar_images()
        slopes_old = self._slopes()
        initial_old = [old.sub(e.left, e.right) for e in self.flat.initial_equations]
        old.rewrite(initial_old, self.leaf, self.done)
        initial_old = [self.done[n] for n in initial_old]
        whens_old = [ReducedWhen(w.conditions, w.earlier, tuple(v for _, v in w.actions)) for w in self.flat.whens]
        old.rewrite([n for w in whens_old for n in (*w.guards, *w.values)], self.leaf, self.done)
        whens_old = [w.mapped(self.done) for w in whens_old]
        assigned_old = self._images([a.node for a in self.flat.assignments])
        asserts_old = self._images([a.condition for a in self.flat.asserts])
        delays_old = [[n for n in (d.source, d.time, d.most) if n is not None] for d in self.flat.delays]
        delays_old = [self._images(nodes) for nodes in delays_old]
        roots = list(self.residual.values()) + image_old + [n for pair in slopes_old for n in pair] + initial_old
        roots += [n for w in whens_old for n in (*w.guards, *w.values)] + assigned_old + asserts_old
        roots += [n for nodes in delays_old for n in nodes]
        reachable = old.reachable(roots)
        for variable in sorted(node[1] for node in map(old.nodes.__getitem__, reachable) if node[0] == "var"):
            _number(variable, number, old, pool)
        for x, (v, _) in self.link.items():
            _number(x, number, old, pool)
            _number(v, number, old, pool)
            pool.derivative_of[number[x]] = number[v]
            pool.integral_of[number[v]] = number[x]
        done = dict(zip(old.vars(number), pool.vars(number.values()), strict=True))
        old.retire()  # the memory use of compilation peaks here
        pool.copy(old, reachable, done)
        for node, slope in slopes_old:
            if pool.nodes[done[node]][0] not in ("var", "const", "neg"):
                pool._slopes[done[node]] = done[slope]
        return ReducedSystem(
            flat=self.flat,
            pool=pool,
            scalar=tuple(sorted(number, key=number.__getitem__)),
            residuals=tuple(done[self.residual[k]] for k in sorted(self.residual)),
            equation=tuple(sorted(self.residual)),
            image=tuple(done[n] for n in image_old),
            inputs=tuple(number[s] for s in self.flat.inputs if s in number),
            redundant=(*self.redundant, *self.trivial),
            initial=tuple(done[n] for n in initial_old),
            whens=tuple(w.mapped(done) for w in whens_old),
            assignments=tuple(done[n] for n in assigned_old),
            asserts=tuple(done[n] for n in asserts_old),
            delays=tuple((done[n[0]], done[n[1]], done[n[2]] if len(n) > 2 else None) for n in delays_old),
        )

    def _images(self, roots: list[int]) -> list[int]:
        """Nodes after all substitutions."""
        self.pool.rewrite(roots, self.leaf, self.done)
        return [self.done[n] for n in roots]

    def _scalar_images(self) -> list[int]:
        """Nodes of all flat scalars, in the old pool."""
        pool, constant, definition = self.pool, self.constant, self.definition
        images = [self.nodes[r] for r in self.representative[: self.flat.n_scalars]]
        for k, (r, node) in enumerate(zip(self.representative, images, strict=False)):
            if r in constant or r in definition:
                images[k] = self.leaf(k)
            elif self.sign[k] < 0:
                images[k] = pool.neg(node)
        return images

    def _slopes(self) -> list[tuple[int, int]]:
        """Known derivatives of substituted definitions: (node, node of its derivative)."""
        pairs = []
        for variable in self.definition:
            if self.representative[variable] == variable and variable not in self.constant:
                slope = self.pool.slope[variable]
                self.pool.rewrite([slope], self.leaf, self.done)
                pairs.append((self._definition_image(variable), self.done[slope]))
        return pairs


def _number(variable: int, number: dict[int, int], old: Pool, new: Pool) -> None:
    """Number a variable of the old pool, and those it is a derivative of, in the new one."""
    if variable not in number:
        base = old.integral_of.get(variable)
        if base is not None:
            _number(base, number, old, new)
        number[variable] = new.new_variables(1) if base is None else new.derivative(number[base])


class _Users:
    """Which equations contain which variables: pairs in two arrays, searched for many variables at once."""

    def __init__(self) -> None:
        self.variable, self.equation = array("q"), array("q")

    def add(self, equation: int, variables: Sequence[int]) -> None:
        """Add a pair for each variable of an equation."""
        self.variable.extend(variables)
        self.equation.extend([equation] * len(variables))

    def _mask(self, variables: Collection[int], count: int) -> Any:
        """Mask of the pairs whose variable is in `variables`, all below `count`; shape (n_pairs,)."""
        marks = np.zeros(count, dtype=bool)
        marks[np.fromiter(variables, dtype=np.int64, count=len(variables))] = True
        return marks[np.frombuffer(self.variable, dtype=np.int64)]

    def of(self, variables: Collection[int], count: int) -> list[int]:
        """The equations that contain any of `variables`, possibly with repetitions."""
        equations: list[int] = np.frombuffer(self.equation, dtype=np.int64)[self._mask(variables, count)].tolist()
        return equations

    def pop(self, variables: Collection[int], count: int) -> list[int]:
        """Return the equations that contain any of `variables`, and remove these pairs."""
        hit = self._mask(variables, count)
        variable, equation = (np.frombuffer(a, dtype=np.int64) for a in (self.variable, self.equation))
        equations: list[int] = equation[hit].tolist()
        self.variable, self.equation = (array("q", a[~hit].tobytes()) for a in (variable, equation))
        return equations


@dataclass(frozen=True)
class _Constant:
    """Value of a variable: a node without variables."""

    node: int


def _priorities(flat: FlatSystem) -> list[int]:
    """Priority of each scalar as the representative of its alias class; the largest wins."""
    priority = [-100] * flat.n_scalars
    declared_ranks: dict[int, tuple[int, bool]] = {}
    starts, differentiated = flat.starts, set(flat.pool.integral_of.values())
    for path, d, first, size in flat.variables:
        if id(d) not in declared_ranks:
            rank = 8 * (d.prefer_state is True) - 8 * (d.prefer_state is False) - 2 * (d.kind.value == "flow")
            declared_ranks[id(d)] = rank, d.kind.value == "variable"
        rank, internal = declared_ranks[id(d)]
        rank -= "." in path
        for k in range(first, first + size):
            scalar_rank = rank + 4 if k in starts else rank
            if internal and k in differentiated:
                scalar_rank += 1  # prefers the voltage of a capacitor to the potential of a pin
            priority[k] = max(priority[k], scalar_rank)
    for k in flat.inputs:
        priority[k] = 100
    return priority
