"""The expressions of one group, written in an order that is the same for equal groups.

Nodes are numbered as they are met from the roots, variables too; parameters and inputs are numbered holes, and so are
numbers that equal groups may have different ones of. Two groups are equal where what is written is.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from acausal.flatten.pool import LEAVES, Pool

# Numbers that say more than a value: products with them are left out, and an exponent is no operand of many.
_PLAIN = frozenset((0.0, 1.0, -1.0, 2.0, 0.5))


@dataclass(frozen=True, eq=False)
class Extract:
    """The expressions of a group."""

    # Nodes over numbers of this list, variables and holes: `("hole", k)`. With `roots` and `definitions` they are what
    # equal groups have in common.
    entries: tuple[tuple[Any, ...], ...]
    roots: tuple[int, ...]  # where the given roots are
    definitions: tuple[tuple[int, int], ...]  # (variable, place of its node) in the order of evaluation
    images: tuple[tuple[int, int], ...]  # (place, place) of nodes that stand for others
    variables: tuple[int, ...]  # variables of the whole in the order of their numbers here
    # What fills each hole: `("par", k)`, `("const", value)` or `("input", k)` of the whole.
    holes: tuple[tuple[str, float], ...]
    nodes: tuple[int, ...]  # nodes of the whole by their places here

    @property
    def key(self) -> tuple[Any, ...]:
        """Equal for equal groups."""
        return self.entries, self.roots, self.definitions, self.images, tuple(kind for kind, _ in self.holes)


def extract(
    pool: Pool,
    roots: Sequence[int],
    definition: Mapping[int, tuple[int, int]],
    images: Mapping[int, int],
    inputs: Mapping[int, int],
) -> Extract:
    """What `roots` need.

    `definition`: By variable: its place in the order of evaluation, and its node.
    `images`: Nodes that stand for others.
    `inputs`: Number of each variable that is an input.
    """
    found = _Extraction(pool, definition, images, inputs)
    places = found.written(roots)
    done = 0
    while done < len(found.variables):  # what variables are equal to, which may name more of them
        variable = found.variables[done]
        done += 1
        if variable in definition:
            found.written([definition[variable][1]])
    defined = sorted((definition[v][0], k, definition[v][1]) for k, v in enumerate(found.variables) if v in definition)
    return Extract(
        tuple(found.entries),
        tuple(places),
        tuple((k, found.place[node]) for _, k, node in defined),
        tuple((found.place[a], found.place[b]) for a, b in found.images),
        tuple(found.variables),
        tuple(found.holes),
        tuple(found.nodes),
    )


class _Extraction:
    def __init__(
        self,
        pool: Pool,
        definition: Mapping[int, tuple[int, int]],
        images: Mapping[int, int],
        inputs: Mapping[int, int],
    ) -> None:
        self.pool, self.definition, self.standing, self.inputs = pool, definition, images, inputs
        self.entries: list[tuple[Any, ...]] = []
        self.nodes: list[int] = []
        self.place: dict[int, int] = {}
        self.variables: list[int] = []
        self.number: dict[int, int] = {}
        self.holes: list[tuple[str, float]] = []
        self.images: list[tuple[int, int]] = []
        self.exponents: set[int] = set()

    def written(self, roots: Iterable[int]) -> list[int]:
        """Places of these nodes, which are written with all below them and all that stand for these."""
        nodes, roots = self.pool.nodes, list(roots)
        stack = roots[::-1]
        while stack:
            number = stack[-1]
            if number in self.place:
                stack.pop()
                continue
            op, *below = nodes[number]
            if op in LEAVES:
                self._enter(number, self._leaf(number, op, *below))
                stack.pop()
                continue
            if op == "pow":
                self.exponents.add(below[1])
            missing = [c for c in below if c not in self.place]
            if missing:
                stack.extend(reversed(missing))
                continue
            self._enter(number, (op, *(self.place[c] for c in below)))
            stack.pop()
            if number in self.standing and self.standing[number] != number:
                self.images.append((number, self.standing[number]))
                stack.insert(0, self.standing[number])
            elif number in self.standing:
                self.images.append((number, number))
        return [self.place[r] for r in roots]

    def _enter(self, number: int, entry: tuple[Any, ...]) -> None:
        self.place[number] = len(self.entries)
        self.entries.append(entry)
        self.nodes.append(number)

    def _leaf(self, number: int, op: str, *what: Any) -> tuple[Any, ...]:
        if op == "time":
            return (op,)
        if op == "var" and what[0] not in self.inputs:
            if what[0] not in self.number:
                self.number[what[0]] = len(self.variables)
                self.variables.append(what[0])
            return "var", self.number[what[0]]
        if op == "const" and (what[0] in _PLAIN or number in self.exponents):
            return "const", what[0]
        self.holes.append(("input", self.inputs[what[0]]) if op == "var" else (op, what[0]))
        return "hole", len(self.holes) - 1
