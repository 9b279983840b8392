"""Random models of `when`s, samples and discrete equations, as small trees that a reference and a compiler both read.

A tree is a tuple `(operator, *operands)`. Numbers: `("num", v)`, `("x", i)` a state, `("d", j)` a discrete variable,
`("pre", e)`, `("add", a, b)`, `("mul", v, a)`, `("if", c, a, b)`. Truths: `("gt", a, b)`, `("lt", a, b)`,
`("and", a, b)`, `("or", a, b)`, `("not", a)`, `("edge", c)`, `("change", d)`, `("sample", start, interval)`, and
booleans `("d", j)`.
"""

from __future__ import annotations

import random
from dataclasses import dataclass, replace
from typing import Any

Tree = tuple[Any, ...]


@dataclass(frozen=True)
class State:
    """x' = rate; the rate is another state, or made of numbers and of what is discrete."""

    start: float
    rate: Tree


@dataclass(frozen=True)
class Discrete:
    """A variable of kind "boolean", "integer" or "discrete" with its start; `equation` is None if `when`s set it."""

    kind: str
    start: float
    equation: Tree | None


@dataclass(frozen=True)
class Branch:
    """One branch: any of `conditions` becomes true; `actions` are `(("x", i) or ("d", j), value)`."""

    conditions: tuple[Tree, ...]
    actions: tuple[tuple[Tree, Tree], ...]


@dataclass(frozen=True)
class Hybrid:
    """A model: states, discrete variables, chains of `when` and `elsewhen`.

    With `curved`, relations read `z_i` instead of `x_i`, where z + 0.01 z^3 == x: a nonlinear algebraic equation each,
    and the same events (both sides of a relation go through the same increasing function).
    """

    states: tuple[State, ...]
    discretes: tuple[Discrete, ...]
    chains: tuple[tuple[Branch, ...], ...]
    stop: float = 2.0
    curved: bool = False


def children(e: Tree) -> list[Tree]:
    """Operands that are trees."""
    return [a for a in e[1:] if isinstance(a, tuple)]


def text(e: Tree, model: Hybrid) -> str:
    """The expression as a modeller writes it."""
    op, *rest = e
    if op == "num":
        return repr(rest[0])
    if op in ("x", "d"):
        return f"self.{op}{rest[0]}"
    a = [text(c, model) for c in children(e)]
    if op in ("gt", "lt"):
        if model.curved and rest[0][0] == "x" and rest[1][0] == "num":
            # the same instant: x > c where z > the root of z + 0.01 z^3 == c
            a = [f"self.z{rest[0][1]}", repr(uncurved(rest[1][1]))]
        return f"({a[0]} {'>' if op == 'gt' else '<'} {a[1]})"
    if op == "mul":
        return f"{rest[0]!r} * {a[0]}"
    if op == "sample":
        return f"sample({rest[0]!r}, {rest[1]!r})"
    joined = {"add": " + ", "and": " & ", "or": " | "}
    if op in joined:
        return f"({joined[op].join(a)})"
    if op == "not":
        return f"~{a[0]}"
    return f"{'where' if op == 'if' else op}({', '.join(a)})"


def uncurved(c: float) -> float:
    """z with z + 0.01 z^3 == c, by Newton's method."""
    z = c
    for _ in range(50):
        z -= (z + 0.01 * z**3 - c) / (1 + 0.03 * z**2)
    return z


def source(model: Hybrid, order: random.Random | None = None) -> str:
    """The model as a file; with `order`, statements are shuffled, which must mean the same."""
    lines = ["import acausal", "from acausal import *", "from acausal import Component, Equations, Real", "", ""]
    lines += ["class Model(Component):"]
    declared = [f"x{i}: Real = variable(default=fixed({s.start!r}))" for i, s in enumerate(model.states)]
    for j, d in enumerate(model.discretes):
        start = bool(d.start) if d.kind == "boolean" else int(d.start) if d.kind == "integer" else float(d.start)
        declared.append(f"d{j}: Real = {d.kind}(default={start!r})")
    if model.curved:
        declared += [f"z{i}: Real = variable()" for i in range(len(model.states))]
    said = [f"yield der(self.x{i}) == {text(s.rate, model)}" for i, s in enumerate(model.states)]
    if model.curved:
        said += [f"yield self.z{i} + 0.01 * self.z{i} ** 3 == self.x{i}" for i in range(len(model.states))]
    for j, d in enumerate(model.discretes):
        if d.equation is not None:
            right = text(d.equation, model)
            said.append(f"yield self.d{j} == {right}")
    for chain in model.chains:
        parts = []
        for branch in chain:
            actions = [f"reset({text(t, model)}, {text(v, model)})" for t, v in branch.actions]
            one = [text(c, model) for c in branch.conditions]
            parts.append(f"when({one[0] if len(one) == 1 else '(' + ', '.join(one) + ')'}, {', '.join(actions)})")
        said.append("yield " + ".else".join(parts))
    if order is not None:
        order.shuffle(declared)
        order.shuffle(said)
    lines += [f"    {line}" for line in declared]
    lines += ["", "    def equations(self) -> Equations:", *(f"        {line}" for line in said), ""]
    return "\n".join(lines)


class Maker:
    """Draws one model; discrete variables are numbered in an order in which all can be evaluated."""

    def __init__(self, seed: int) -> None:
        self.draw = random.Random(seed)
        self.kinds: list[str] = []
        self.n_states = 0

    def model(self) -> Hybrid:
        draw = self.draw
        self.n_states = draw.randint(1, 3)
        self.kinds = [draw.choice(["boolean", "integer", "discrete"]) for _ in range(draw.randint(1, 5))]
        chains = [self.chain(len(self.kinds)) for _ in range(draw.randint(1, 4))]
        assigned = {a[0][1] for c in chains for b in c for a in b.actions if a[0][0] == "d"}
        discretes = []
        for j, kind in enumerate(self.kinds):
            free = j not in assigned
            equation = (self.truth(j, 2) if kind == "boolean" else self.value(j, kind)) if free else None
            start = float(draw.random() < 0.5) if kind == "boolean" else float(draw.randint(0, 2))
            discretes.append(Discrete(kind, start, equation))
        states = []
        for i in range(self.n_states):
            start = draw.choice([-1.0, 0.0, 0.3, 0.8, 1.1])
            states.append(State(start, self.rate(i)))
        return Hybrid(tuple(states), tuple(discretes), tuple(chains), curved=draw.random() < 0.25)

    def rate(self, i: int) -> Tree:
        draw = self.draw
        if i > 0 and draw.random() < 0.3:
            return ("x", i - 1)
        rate: Tree = ("num", draw.choice([-2.0, -1.0, 0.7, 1.0, 1.3, 2.0]))
        if draw.random() < 0.5:
            c = self.truth(len(self.kinds), 1)
            rate = ("add", rate, ("if", c, ("num", draw.choice([-3.1, -1.3, 0.9, 2.2])), ("num", 0.0)))
        numbers = [j for j, k in enumerate(self.kinds) if k != "boolean"]
        if numbers and draw.random() < 0.3:
            rate = ("add", rate, ("mul", draw.choice([-0.4, 0.3]), ("d", draw.choice(numbers))))
        return rate

    def chain(self, last: int) -> tuple[Branch, ...]:
        """What is set comes after everything that decides it: the conditions of its branch and of those before."""
        draw = self.draw
        count = draw.choice([1, 1, 1, 2, 3])
        targets = [self.targets(last) for _ in range(count)]
        lowest = [min((t[1] for t in found if t[0] == "d"), default=last) for found in targets]
        return tuple(self.branch(targets[k], lowest[k], min(lowest[k:])) for k in range(count))

    def targets(self, last: int) -> list[Tree]:
        draw = self.draw
        found: list[Tree] = [("d", draw.randrange(last))] if draw.random() < 0.8 else []
        return [*found, ("x", draw.randrange(self.n_states))] if draw.random() < 0.45 or not found else found

    def branch(self, targets: list[Tree], lowest: int, below: int) -> Branch:
        draw = self.draw
        conditions = [self.truth(below, 2, sampled=True) for _ in range(draw.choice([1, 1, 1, 2]))]
        return Branch(tuple(conditions), tuple((t, self.new(t, lowest)) for t in targets))

    def new(self, target: Tree, below: int) -> Tree:
        draw = self.draw
        if target[0] == "x":
            kind = draw.randrange(4)
            if kind == 0:
                return ("num", draw.choice([-1.2, 0.1, 1.45, 2.3]))
            if kind == 1:
                return ("mul", draw.choice([-0.7, 0.5]), ("x", target[1]))
            return ("add", ("x", draw.randrange(self.n_states)), self.value(below, "discrete"))
        kind_of = self.kinds[target[1]]
        if kind_of == "boolean":
            return draw.choice([("not", ("pre", target)), self.truth(below, 1)])
        if draw.random() < 0.6:
            return ("add", ("pre", target), ("num", float(draw.choice([1, 1, 10]))))
        return self.value(below, kind_of)

    def value(self, below: int, kind: str) -> Tree:
        """A number for a discrete variable, of variables below `below` and of `pre` of all."""
        draw = self.draw
        numbers = [j for j, k in enumerate(self.kinds) if k == "integer" or (k == "discrete" and kind == "discrete")]
        readable = [j for j in numbers if j < below]
        pick = draw.random()
        if pick < 0.35 and readable:
            return ("add", ("d", draw.choice(readable)), ("num", float(draw.randint(0, 2))))
        if pick < 0.55 and numbers:
            return ("pre", ("d", draw.choice(numbers)))
        whole = kind == "integer"
        a, b = (float(draw.randint(0, 4)) if whole else draw.choice([0.0, 0.25, 1.5, 3.0]) for _ in range(2))
        return ("if", self.truth(below, 1), ("num", a), ("num", b))

    def truth(self, below: int, depth: int, sampled: bool = False) -> Tree:
        draw = self.draw
        pick = draw.random()
        booleans = [j for j, k in enumerate(self.kinds) if k == "boolean"]
        if depth > 0 and pick < 0.25:
            a, b = self.truth(below, depth - 1, sampled), self.truth(below, depth - 1)
            return (draw.choice(["and", "or"]), a, b)
        if depth > 0 and pick < 0.33:
            return ("edge", self.truth(below, 0))
        if sampled and pick < 0.5:
            return ("sample", draw.choice([0.1, 0.25, 0.35]), draw.choice([0.2, 0.45, 0.7]))
        if pick < 0.6 and booleans:
            j = draw.choice(booleans)
            leaf: Tree = ("d", j) if j < below else ("pre", ("d", j))
            return ("not", leaf) if draw.random() < 0.3 else leaf
        numbers = [j for j, k in enumerate(self.kinds) if k != "boolean"]
        if pick < 0.72 and numbers:
            j = draw.choice(numbers)
            number: Tree = ("d", j) if j < below else ("pre", ("d", j))
            return (draw.choice(["gt", "lt"]), number, ("num", draw.choice([0.5, 1.5, 2.5])))
        relation: Tree = (
            draw.choice(["gt", "gt", "lt"]),
            ("x", draw.randrange(self.n_states)),
            ("num", draw.choice([-0.5, 0.5, 1.0, 1.0, 1.25, 2.0])),
        )
        return relation


def random_model(seed: int) -> Hybrid:
    """The model of one seed."""
    return Maker(seed).model()


def smaller(model: Hybrid) -> list[Hybrid]:
    """All models with one statement, branch, action or operand less."""
    found = []
    for k in range(len(model.chains)):
        found.append(replace(model, chains=model.chains[:k] + model.chains[k + 1 :]))
        chain = model.chains[k]
        for i, branch in enumerate(chain):

            def put(new: tuple[Branch, ...], k: int = k, i: int = i, chain: tuple[Branch, ...] = chain) -> Hybrid:
                changed = (*chain[:i], *new, *chain[i + 1 :])
                return replace(model, chains=(*model.chains[:k], changed, *model.chains[k + 1 :]))

            if len(chain) > 1:
                found.append(put(()))
            if len(branch.actions) > 1:
                found += [
                    put((replace(branch, actions=branch.actions[:a] + branch.actions[a + 1 :]),))
                    for a in range(len(branch.actions))
                ]
            for a, (target, value) in enumerate(branch.actions):
                for less in fewer(value):
                    actions = (*branch.actions[:a], (target, less), *branch.actions[a + 1 :])
                    found.append(put((replace(branch, actions=actions),)))
            for c, condition in enumerate(branch.conditions):
                if len(branch.conditions) > 1:
                    found.append(put((replace(branch, conditions=(condition,)),)))
                for less in fewer(condition):
                    conditions = (*branch.conditions[:c], less, *branch.conditions[c + 1 :])
                    found.append(put((replace(branch, conditions=conditions),)))
    for j, d in enumerate(model.discretes):
        if d.equation is not None:
            simpler = [replace(d, equation=None), *(replace(d, equation=less) for less in fewer(d.equation))]
            found += [replace(model, discretes=(*model.discretes[:j], s, *model.discretes[j + 1 :])) for s in simpler]
    for i, s in enumerate(model.states):
        rates = [*fewer(s.rate), *([("num", 1.0)] if s.rate[0] != "num" else [])]
        found += [replace(model, states=(*model.states[:i], replace(s, rate=r), *model.states[i + 1 :])) for r in rates]
    if model.curved:
        found.append(replace(model, curved=False))
    return found


_NUMBERS = ("num", "x", "add", "mul", "if")


def fewer(e: Tree) -> list[Tree]:
    """The tree with one of its nodes replaced by one of its operands of the same kind."""
    op = e[0]
    found: list[Tree] = []
    for k, a in enumerate(e):
        if not isinstance(a, tuple):
            continue
        same = op in ("and", "or", "add") or (op == "not") or (op == "edge") or (op == "if" and k > 1)
        if same:
            found.append(a)
        if op not in ("gt", "lt", "pre", "mul"):
            found += [(*e[:k], less, *e[k + 1 :]) for less in fewer(a)]
    return found


def opened(model: Hybrid, draw: random.Random) -> str | None:
    """The same with other starts, which a `when(initial(), ...)` puts right; None where `pre` tells the two apart.

    During the start `pre` is what was declared: a condition or equation that reads it sees the difference.
    """
    equations = [d.equation for d in model.discretes if d.equation is not None]
    asked = [c for chain in model.chains for branch in chain for c in branch.conditions]
    if any(op in ("pre", "edge", "change", "sample") for e in equations for op in _operators(e)):
        return None
    if any(op == "pre" for c in asked for op in _operators(c)):
        return None
    discretes, states, actions = list(model.discretes), list(model.states), []
    for j, d in enumerate(discretes):
        if d.equation is None:
            start = bool(d.start) if d.kind == "boolean" else d.start
            actions.append(f"reset(self.d{j}, {start!r})")
            discretes[j] = replace(d, start=1.0 - d.start if d.kind == "boolean" else d.start + draw.choice([3, -2]))
    for i, x in enumerate(states):
        if draw.random() < 0.6:
            actions.append(f"reset(self.x{i}, {x.start!r})")
            states[i] = replace(x, start=x.start + draw.uniform(-2, 2))
    if not actions:
        return None
    other = replace(model, discretes=tuple(discretes), states=tuple(states))
    return source(other) + f"        yield when(initial(), {', '.join(actions)})\n"


def _operators(e: Tree) -> list[str]:
    return [e[0], *(op for c in children(e) for op in _operators(c))]
