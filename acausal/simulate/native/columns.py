"""A CasADi function as a program of columns, which one compiled library evaluates: equal parts of it at once.

CasADi interprets an instruction at a time, in 3 to 5 ns; of sixteen boxes on top of each other sixteen contacts of 4000
instructions each. Instructions of one shape, whose operands have one shape each, are a column here, as nodes are in
`acausal.lower.columns.patterns`; constants and inputs are holes. A column is one instruction for all of its entries,
so that the same numbers come out, four times as fast with sixteen of them, and no compiler has to see the model.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache as kept
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from acausal.simulate.native import cache
from acausal.simulate.native.cache import made
from acausal.simulate.native.program import address

Whole = NDArray[np.int32]
# Instructions from which on a program is written, and how long its columns have to be on the mean: a column of one
# takes as long as three instructions.
_LEAST, _MEAN = 5_000, 3.0
# Entries that are computed at once (`BLOCK` of columns.c).
_BLOCK = 8
_FILES = "columns.c", "tangents.c"
# CasADi's operations in the order of columns.c.
_UNARY_NAMES = "NEG EXP LOG SQRT SQ TWICE SIN COS TAN ASIN ACOS ATAN NOT FLOOR CEIL FABS SIGN INV SINH COSH TANH ASSIGN"
_BINARY_NAMES = "ADD SUB MUL DIV POW LT LE EQ NE AND OR FMOD COPYSIGN IF_ELSE_ZERO FMIN FMAX ATAN2 HYPOT"
_UNARY, _BINARY = _UNARY_NAMES.split(), _BINARY_NAMES.split()
CODES = {getattr(ca, f"OP_{name}"): k for k, name in enumerate(_UNARY + _BINARY)} | {
    ca.OP_CONSTPOW: len(_UNARY) + _BINARY.index("POW")
}
"""Numbers of operations in columns.c, by CasADi's."""
BINARY = range(len(_UNARY), len(_UNARY) + len(_BINARY))
"""Those of two operands."""
_CONSTANT, _INPUT = -1, -2  # shapes of leaves; inputs by argument, downwards


class Program(ctypes.Structure):
    """`struct program` of columns.c."""

    _fields_ = (
        *((name, ctypes.c_longlong) for name in ("columns", "loads", "stores")),
        *((name, ctypes.c_void_p) for name in ("op", "size", "to", "a", "b", "places")),
        *((name, ctypes.c_void_p) for name in ("load_argument", "load_entry", "load_to")),
        *((name, ctypes.c_void_p) for name in ("store_result", "store_entry", "store_from")),
        *((name, ctypes.c_void_p) for name in ("values", "left", "right")),
    )

    read: Instructions
    at: NDArray[np.int64]
    """Where the value of each instruction is."""
    kept: tuple[Any, ...]
    """The arrays that its fields point to."""


@kept
def library() -> Any | None:
    """The compiled library; None without a compiler."""
    text = "".join(Path(__file__).with_name(name).read_text(encoding="utf-8") for name in _FILES)
    return made(cache.key("columns", text), lambda: text, lambda path: ctypes.CDLL(str(path)))


@dataclass(frozen=True, eq=False)
class Instructions:
    """The instructions of a function, each with its own value; operands by their places in this list."""

    codes: Whole  # of the operation, negative for leaves
    left: Whole
    right: Whole
    shapes: Whole
    depths: Whole
    loads: Sequence[tuple[int, int, int]]  # argument, entry, place
    stores: Sequence[tuple[int, int, int]]  # result, entry, place
    constants: Sequence[tuple[int, float]]


def is_long(function: Any) -> bool:
    """Whether a function is in SX, and has so many instructions that its columns are looked for."""
    return bool(function.is_a("SXFunction") and function.n_instructions() >= _LEAST)


def program(function: Any) -> Program | None:
    """The program of an SX function; None where its columns would be too short, or it does what columns.c does not."""
    if not is_long(function):
        return None
    read = _read(function)
    return None if read is None else _laid_out(read)


def _read(function: Any) -> Instructions | None:
    codes: list[int] = []
    left: list[int] = []
    right: list[int] = []
    shapes: list[int] = []
    depths: list[int] = []
    known: dict[tuple[int, int, int], int] = {}
    loads, stores, constants = [], [], []
    slots: dict[int, int] = {}  # the work vector of CasADi's interpreter, whose entries serve again and again
    for k in range(function.n_instructions()):
        op = function.instruction_id(k)
        if op == ca.OP_OUTPUT:
            stores.append((*function.instruction_output(k)[:2], slots[function.instruction_input(k)[0]]))
            continue
        here = len(codes)
        if op == ca.OP_CONST:
            constants.append((here, function.instruction_constant(k)))
            entry = -1, here, here, _CONSTANT, 0
        elif op == ca.OP_INPUT:
            argument, place = function.instruction_input(k)[:2]
            loads.append((argument, place, here))
            entry = -1, here, here, _INPUT - argument, 0
        else:
            code = CODES.get(op)
            if code is None:
                return None
            operands = function.instruction_input(k)
            a = slots[operands[0]]
            b = a if code not in BINARY else slots[operands[1]]
            shape = known.setdefault((code, shapes[a], shapes[b]), len(known))
            entry = code, a, b, shape, 1 + max(depths[a], depths[b])
        slots[function.instruction_output(k)[0]] = here
        for values, value in zip((codes, left, right, shapes, depths), entry, strict=True):
            values.append(value)
    if len(codes) < _MEAN * len(known):
        return None
    operands = _whole(left), _whole(right)
    return Instructions(_whole(codes), *operands, _whole(shapes), _whole(depths), loads, stores, constants)


def _laid_out(read: Instructions) -> Program:
    """Entries of a column side by side, in the order of their operands, so that most operands are side by side too."""
    place = np.full(len(read.codes), -1)
    leaves = [*(n for *_, n in read.loads), *(n for n, _ in read.constants)]
    place[leaves] = np.arange(len(leaves))
    end = _padded(len(leaves))
    inner = np.flatnonzero(read.codes >= 0)
    order = inner[np.lexsort((inner, read.shapes[inner], read.depths[inner]))]
    columns: list[tuple[int, int, int, int, int]] = []
    lists: list[Any] = []
    listed = 0
    numbers = {int(place[n]): value for n, value in read.constants}
    repeated: dict[tuple[float, bool, int], int] = {}  # where a constant is so many times

    def operand(at: Any) -> int:
        """Where they begin; before zero where their places are listed."""
        nonlocal listed, end
        if at[-1] - at[0] == len(at) - 1 and (np.diff(at) == 1).all():
            return int(at[0])
        value = numbers.get(int(at[0]))
        if value is not None and (at == at[0]).all():  # a third of all that is not side by side in a stack of boxes
            kind = value, bool(np.signbit(value)), _padded(len(at))
            if kind not in repeated:
                repeated[kind] = end
                end += kind[2]
            return repeated[kind]
        lists.append(at)
        listed += len(at)
        return len(at) - listed - 1

    for own in np.split(order, np.flatnonzero(np.diff(read.shapes[order])) + 1):
        a, b = place[read.left[own]], place[read.right[own]]
        sorted_ = np.lexsort((b, a))
        own, a, b = own[sorted_], a[sorted_], b[sorted_]
        code = int(read.codes[own[0]])
        first = operand(a)
        second = first if code not in BINARY else operand(b)
        columns.append((code, len(own), end, first, second))
        place[own] = np.arange(end, end + len(own))
        end += _padded(len(own))
    values = np.zeros(end + _BLOCK)
    for n, value in read.constants:
        values[place[n]] = value
    for (value, _, count), begin in repeated.items():
        values[begin : begin + count] = value
    longest = _padded(max(n for _, n, *_ in columns))
    loads = [(argument, entry, place[n]) for argument, entry, n in read.loads]
    stores = [(result, entry, place[n]) for result, entry, n in read.stores]
    names = "op", "size", "to", "a", "b"
    arrays = dict(zip(names, map(_whole, zip(*columns, strict=True)), strict=True))
    for kind, own_names, rows in (
        ("load", ("argument", "entry", "to"), loads),
        ("store", ("result", "entry", "from"), stores),
    ):
        parts = zip(*rows, strict=True) if rows else ((), (), ())
        arrays |= {f"{kind}_{name}": _whole(part) for name, part in zip(own_names, parts, strict=True)}
    arrays["places"] = np.concatenate(lists).astype(np.int32) if lists else np.zeros(1, dtype=np.int32)
    memory = {"values": values, "left": np.zeros(longest), "right": np.zeros(longest)}
    pointers = {name: address(array) for name, array in (arrays | memory).items()}
    found = Program(columns=len(columns), loads=len(loads), stores=len(stores), **pointers)
    found.kept = arrays, memory
    found.read, found.at = read, place
    return found


def _padded(count: int) -> int:
    """Entries of the blocks that so many take."""
    return -(-count // _BLOCK) * _BLOCK


def _whole(values: Any) -> Whole:
    return np.ascontiguousarray(list(values), dtype=np.int32)
