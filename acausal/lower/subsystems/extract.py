"""Canonical form of the expressions of one group of states.

Nodes and variables are numbered in the order of a traversal from the roots. Parameters, inputs, and constants that may
differ between equal groups become numbered holes. Two groups are equal if their canonical forms are.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from acausal.flatten.pool import LEAVES, Pool

# Constants that are structural: the pool simplifies products with them.
_STRUCTURAL = frozenset((0.0, 1.0, -1.0, 2.0, 0.5))


@dataclass(frozen=True, eq=False)
class Extract:
    """The expressions of a group."""

    # Nodes, whose operands are indices in this list, variables, or holes `("hole", k)`. Equal groups have equal
    # `entries`, `roots` and `definitions`.
    entries: tuple[tuple[Any, ...], ...]
    roots: tuple[int, ...]  # indices of the roots
    definitions: tuple[tuple[int, int], ...]  # (variable, index of its node) in the order of evaluation
    images: tuple[tuple[int, int], ...]  # (index of a node, index of the node that replaces it)
    variables: tuple[int, ...]  # variables of the whole model, by their numbers in this form
    # Content of each hole: `("par", k)`, `("const", value)` or `("input", k)` of the whole model.
    holes: tuple[tuple[str, float], ...]
    nodes: tuple[int, ...]  # nodes of the whole model, by their indices in this form

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
    """Canonical form of `roots` and everything below them.

    Parameters
    ----------
    definition
        Maps variables to their positions in the order of evaluation, and their nodes.
    images
        Maps nodes to those that replace them.
    inputs
        Maps variables that are inputs to their indices.
    """
    extraction = _Extraction(pool, definition, images, inputs)
    root_indices = extraction.enter_all(roots)
    visited = 0
    while visited < len(extraction.variables):  # definitions may contain further variables
        variable = extraction.variables[visited]
        visited += 1
        if variable in definition:
            extraction.enter_all([definition[variable][1]])
    defined = sorted(
        (definition[v][0], k, definition[v][1]) for k, v in enumerate(extraction.variables) if v in definition
    )
    return Extract(
        tuple(extraction.entries),
        tuple(root_indices),
        tuple((k, extraction.index_of[node]) for _, k, node in defined),
        tuple((extraction.index_of[a], extraction.index_of[b]) for a, b in extraction.images),
        tuple(extraction.variables),
        tuple(extraction.holes),
        tuple(extraction.nodes),
    )


class _Extraction:
    def __init__(
        self,
        pool: Pool,
        definition: Mapping[int, tuple[int, int]],
        images: Mapping[int, int],
        inputs: Mapping[int, int],
    ) -> None:
        self.pool, self.definition, self.replacement, self.inputs = pool, definition, images, inputs
        self.entries: list[tuple[Any, ...]] = []
        self.nodes: list[int] = []
        self.index_of: dict[int, int] = {}
        self.variables: list[int] = []
        self.number: dict[int, int] = {}
        self.holes: list[tuple[str, float]] = []
        self.images: list[tuple[int, int]] = []
        self.exponents: set[int] = set()

    def enter_all(self, roots: Iterable[int]) -> list[int]:
        """Add nodes, all nodes below them, and their replacements; return the indices of the roots."""
        nodes, roots = self.pool.nodes, list(roots)
        stack = roots[::-1]
        while stack:
            number = stack[-1]
            if number in self.index_of:
                stack.pop()
                continue
            op, *below = nodes[number]
            if op in LEAVES:
                self._enter(number, self._leaf(number, op, *below))
                stack.pop()
                continue
            if op == "pow":
                self.exponents.add(below[1])
            missing = [c for c in below if c not in self.index_of]
            if missing:
                stack.extend(reversed(missing))
                continue
            self._enter(number, (op, *(self.index_of[c] for c in below)))
            stack.pop()
            if number in self.replacement and self.replacement[number] != number:
                self.images.append((number, self.replacement[number]))
                stack.insert(0, self.replacement[number])
            elif number in self.replacement:
                self.images.append((number, number))
        return [self.index_of[r] for r in roots]

    def _enter(self, number: int, entry: tuple[Any, ...]) -> None:
        self.index_of[number] = len(self.entries)
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
        if op == "const" and (what[0] in _STRUCTURAL or number in self.exponents):
            return "const", what[0]
        self.holes.append(("input", self.inputs[what[0]]) if op == "var" else (op, what[0]))
        return "hole", len(self.holes) - 1
