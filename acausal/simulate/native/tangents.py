"""The Jacobian of a function that is a program of columns, from the same program: no derivatives are written out.

CasADi writes the Jacobian of sixteen boxes on top of each other as 1.1 million instructions, in 1.2 s, and interprets
them in 4.4 ms. Here each value carries its derivatives by those inputs that it depends on: 0.7 million numbers in
65 000 vectors, which one compiled loop makes for any model. Where a vector ends, the next one of its length begins:
all that are needed at one time fit into a cache.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from acausal.simulate.native.columns import BINARY, CODES, Instructions, Program
from acausal.simulate.native.program import address

# Operations whose results do not change with their operands, but at once.
_STEP_NAMES = "NOT FLOOR CEIL SIGN LT LE EQ NE AND OR"
_STEPS = frozenset(CODES[getattr(ca, f"OP_{name}")] for name in _STEP_NAMES.split())
_CHOICE = CODES[ca.OP_IF_ELSE_ZERO]
_FIELDS = "op own a b to count of_a count_a of_b count_b map_a map_b"


class Tangents(ctypes.Structure):
    """`struct tangents` of tangents.c."""

    _fields_ = (
        ("instructions", ctypes.c_longlong),
        ("stores", ctypes.c_longlong),
        *((name, ctypes.c_void_p) for name in (*_FIELDS.split(), "maps", "store_of", "store_from", "store_to")),
        *((name, ctypes.c_void_p) for name in ("values", "derivatives", "none")),
    )

    kept: tuple[Any, ...]
    """The arrays that its fields point to."""


@dataclass(frozen=True, eq=False)
class Jacobian:
    """Derivatives of the first result of a program by one of its arguments."""

    tangents: Tangents
    sparsity: Any
    work: int
    """Derivatives that are computed on the way to those of the result."""


def jacobian(program: Program, argument: int, rows: int, columns: int) -> Jacobian:
    """The derivatives of a program's first result, `rows` entries, by the `columns` entries of an argument."""
    read = program.read
    inputs = _inputs(read, argument)
    used = _used(read)
    table, memory, held = _instructions(read, program.at, inputs, used)
    results = [(entry, place) for result, entry, place in read.stores if result == 0 and inputs[place]]
    entries = [(column, row, held[n], k) for row, n in results for k, column in enumerate(_bits(inputs[n]))]
    entries.sort()  # as CasADi stores them, column by column
    sparsity = ca.Sparsity.triplet(rows, columns, [row for _, row, *_ in entries], [column for column, *_ in entries])
    names = _FIELDS.split()
    todo = np.array(table.rows, dtype=np.int32).reshape(-1, len(names)).T
    arrays: dict[str, Any] = {name: np.ascontiguousarray(values) for name, values in zip(names, todo, strict=True)}
    arrays |= {"maps": _whole(table.maps), "store_of": _whole([of for *_, of, _ in entries])}
    arrays |= {"store_from": _whole([of + k for *_, of, k in entries]), "store_to": _whole(range(len(entries)))}
    arrays |= {"derivatives": memory, "none": np.zeros(len(memory), dtype=np.int8)}
    tangents = Tangents(instructions=len(table.rows), stores=len(entries), values=program.values)
    for name, array in arrays.items():
        setattr(tangents, name, address(array))
    tangents.kept = arrays, program
    return Jacobian(tangents, sparsity, sum(row[5] for row in table.rows))


def _inputs(read: Instructions, argument: int) -> list[int]:
    """Entries of the argument on which each value depends, as bits."""
    found = [0] * len(read.codes)
    for given, entry, place in read.loads:
        if given == argument:
            found[place] = 1 << entry
    left, right = read.left.tolist(), read.right.tolist()
    for k, code in enumerate(read.codes.tolist()):
        if code >= 0 and code not in _STEPS:
            found[k] = found[right[k]] if code == _CHOICE else found[left[k]] | found[right[k]]
    return found


def _used(read: Instructions) -> list[int]:
    """Where each value is used last; behind the end for those of the result, -1 for what the result does not need."""
    count = len(read.codes)
    found = [-1] * count
    for result, _, place in read.stores:
        if result == 0:
            found[place] = count
    left, right = read.left.tolist(), read.right.tolist()
    for k, code in reversed(list(enumerate(read.codes.tolist()))):
        if code >= 0 and found[k] >= 0:
            for operand in (left[k], right[k]):
                found[operand] = max(found[operand], k)
    return found


class _Table:
    """Rows of instructions, and maps from inputs of an operand to those of a result."""

    def __init__(self) -> None:
        self.rows: list[tuple[int, ...]] = []
        self.maps: list[int] = []
        self._known: dict[tuple[int, int], int] = {}

    def between(self, own: int, whole: int) -> int:
        """Where the map begins; before zero where inputs are the same."""
        if own in (0, whole):
            return -1
        if (own, whole) not in self._known:
            self._known[own, whole] = len(self.maps)
            places = {bit: k for k, bit in enumerate(_bits(whole))}
            self.maps.extend(places[bit] for bit in _bits(own))
        return self._known[own, whole]


def _instructions(
    read: Instructions, places: Any, inputs: Sequence[int], used: Sequence[int]
) -> tuple[_Table, NDArray[np.float64], dict[int, int]]:
    """What is to be done, the memory of derivatives, and where those of each value are that are held to the end."""
    table, free, held = _Table(), {}, {}  # type: ignore[var-annotated]
    seeds = [place for *_, place in read.loads if inputs[place]]
    held.update((place, k) for k, place in enumerate(seeds))
    end = len(seeds)
    left, right, value = read.left.tolist(), read.right.tolist(), places.tolist()
    for k, code in enumerate(read.codes.tolist()):
        own = inputs[k]
        if code < 0 or not own or used[k] < 0:
            continue
        count, operands = own.bit_count(), (left[k], right[k])
        if free.get(count):
            to = free[count].pop()
        else:
            to, end = end, end + count
        has = bool(inputs[operands[0]]) and code != _CHOICE, bool(inputs[operands[1]]) and code in BINARY
        of = [held[n] if own_has else -1 for n, own_has in zip(operands, has, strict=True)]
        counts = [inputs[n].bit_count() for n in operands]
        maps = [table.between(inputs[n], own) if own_has else -1 for n, own_has in zip(operands, has, strict=True)]
        at = value[k], value[operands[0]], value[operands[1]]
        table.rows.append((code, *at, to, count, of[0], counts[0], of[1], counts[1], *maps))
        held[k] = to
        for operand in set(operands):
            if used[operand] == k and inputs[operand] and read.codes[operand] >= 0:
                free.setdefault(inputs[operand].bit_count(), []).append(held.pop(operand))
    memory = np.zeros(end)
    memory[: len(seeds)] = 1.0
    return table, memory, held


def _bits(number: int) -> list[int]:
    return [k for k in range(number.bit_length()) if number >> k & 1]


def _whole(values: Any) -> NDArray[np.int32]:
    return np.ascontiguousarray(list(values), dtype=np.int32)
