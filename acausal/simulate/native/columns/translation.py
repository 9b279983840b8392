"""Translation of a CasADi function to a program of columns, in which equal parts are evaluated together.

CasADi interprets instructions one by one, in 3 to 5 ns each; sixteen stacked boxes have sixteen contacts of 4000
instructions. Here, instructions with the same operation and operands of the same shapes form a column, as nodes do in
`acausal.lower.columns.patterns`; constants and inputs match any other. A column is evaluated as one instruction for all
its entries. Results are identical, and computed four times as fast with sixteen entries. One compiled library evaluates
the programs of all models, so that a model needs no compiler.
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

Int32Array = NDArray[np.int32]
# A program needs at least `_LEAST` instructions, and columns of mean length `_MEAN`: a column with a single entry takes
# as long as three instructions.
_LEAST, _MEAN = 5_000, 3.0
# Entries that are computed together (`BLOCK` of columns.c).
_BLOCK = 8
_FILES = "columns.c", "tangents.c"
# CasADi's operations in the order of columns.c.
_UNARY_NAMES = "NEG EXP LOG SQRT SQ TWICE SIN COS TAN ASIN ACOS ATAN NOT FLOOR CEIL FABS SIGN INV SINH COSH TANH ASSIGN"
_BINARY_NAMES = "ADD SUB MUL DIV POW LT LE EQ NE AND OR FMOD COPYSIGN IF_ELSE_ZERO FMIN FMAX ATAN2 HYPOT"
_UNARY, _BINARY = _UNARY_NAMES.split(), _BINARY_NAMES.split()
CODES = {getattr(ca, f"OP_{name}"): k for k, name in enumerate(_UNARY + _BINARY)} | {
    ca.OP_CONSTPOW: len(_UNARY) + _BINARY.index("POW")
}
"""The codes of operations in columns.c, by those of CasADi."""
BINARY = range(len(_UNARY), len(_UNARY) + len(_BINARY))
"""The codes of operations with two operands."""
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
    """The index in `values` of the result of each instruction."""
    kept: tuple[Any, ...]
    """The arrays to which its fields point, kept alive."""


@kept
def library() -> Any | None:
    """The library that evaluates programs; None without a compiler."""
    text = "".join(Path(__file__).with_name(name).read_text(encoding="utf-8") for name in _FILES)
    return made(cache.key("columns", text), lambda: text, lambda path: ctypes.CDLL(str(path)))


@dataclass(frozen=True, eq=False)
class Instructions:
    """The instructions of a function, each with a value of its own; operands are indices of instructions."""

    codes: Int32Array  # of the operation, negative for leaves
    left: Int32Array
    right: Int32Array
    shapes: Int32Array
    depths: Int32Array
    loads: Sequence[tuple[int, int, int]]  # argument, entry, place
    stores: Sequence[tuple[int, int, int]]  # result, entry, place
    constants: Sequence[tuple[int, float]]


def is_long(function: Any) -> bool:
    """Whether a function is in SX and has enough instructions for a program."""
    return bool(function.is_a("SXFunction") and function.n_instructions() >= _LEAST)


def program(function: Any) -> Program | None:
    """The program of an SX function; None if its columns are too short, or an operation is missing in columns.c."""
    if not is_long(function):
        return None
    read = _read(function)
    return None if read is None else _layout(read)


def _read(function: Any) -> Instructions | None:
    codes: list[int] = []
    left: list[int] = []
    right: list[int] = []
    shapes: list[int] = []
    depths: list[int] = []
    known: dict[tuple[int, int, int], int] = {}
    loads, stores, constants = [], [], []
    slots: dict[int, int] = {}  # the instruction whose result is in each entry of CasADi's work vector, now
    for k in range(function.n_instructions()):
        op = function.instruction_id(k)
        if op == ca.OP_OUTPUT:
            stores.append((*function.instruction_output(k)[:2], slots[function.instruction_input(k)[0]]))
            continue
        number = len(codes)
        if op == ca.OP_CONST:
            constants.append((number, function.instruction_constant(k)))
            entry = -1, number, number, _CONSTANT, 0
        elif op == ca.OP_INPUT:
            argument, place = function.instruction_input(k)[:2]
            loads.append((argument, place, number))
            entry = -1, number, number, _INPUT - argument, 0
        else:
            code = CODES.get(op)
            if code is None:
                return None
            operands = function.instruction_input(k)
            a = slots[operands[0]]
            b = a if code not in BINARY else slots[operands[1]]
            shape = known.setdefault((code, shapes[a], shapes[b]), len(known))
            entry = code, a, b, shape, 1 + max(depths[a], depths[b])
        slots[function.instruction_output(k)[0]] = number
        for values, value in zip((codes, left, right, shapes, depths), entry, strict=True):
            values.append(value)
    if len(codes) < _MEAN * len(known):
        return None
    operands = _int32(left), _int32(right)
    return Instructions(_int32(codes), *operands, _int32(shapes), _int32(depths), loads, stores, constants)


def _layout(read: Instructions) -> Program:
    """Arrange the entries of a column contiguously, in the order of their operands, so that most of these are too."""
    position = np.full(len(read.codes), -1)
    leaves = [*(n for *_, n in read.loads), *(n for n, _ in read.constants)]
    position[leaves] = np.arange(len(leaves))
    end = _padded(len(leaves))
    inner = np.flatnonzero(read.codes >= 0)
    order = inner[np.lexsort((inner, read.shapes[inner], read.depths[inner]))]
    columns: list[tuple[int, int, int, int, int]] = []
    lists: list[Any] = []
    listed = 0
    numbers = {int(position[n]): value for n, value in read.constants}
    repeated: dict[tuple[float, bool, int], int] = {}  # start of a constant that is stored so many times

    def operand(at: Any) -> int:
        """Index at which operands begin if they are contiguous; otherwise a negative code for a list of indices."""
        nonlocal listed, end
        if at[-1] - at[0] == len(at) - 1 and (np.diff(at) == 1).all():
            return int(at[0])
        value = numbers.get(int(at[0]))
        if value is not None and (at == at[0]).all():  # a third of the non-contiguous operands of stacked boxes
            kind = value, bool(np.signbit(value)), _padded(len(at))
            if kind not in repeated:
                repeated[kind] = end
                end += kind[2]
            return repeated[kind]
        lists.append(at)
        listed += len(at)
        return len(at) - listed - 1

    for members in np.split(order, np.flatnonzero(np.diff(read.shapes[order])) + 1):
        a, b = position[read.left[members]], position[read.right[members]]
        sorted_ = np.lexsort((b, a))
        members, a, b = members[sorted_], a[sorted_], b[sorted_]
        code = int(read.codes[members[0]])
        first = operand(a)
        second = first if code not in BINARY else operand(b)
        columns.append((code, len(members), end, first, second))
        position[members] = np.arange(end, end + len(members))
        end += _padded(len(members))
    values = np.zeros(end + _BLOCK)
    for n, value in read.constants:
        values[position[n]] = value
    for (value, _, count), begin in repeated.items():
        values[begin : begin + count] = value
    longest = _padded(max(n for _, n, *_ in columns))
    loads = [(argument, entry, position[n]) for argument, entry, n in read.loads]
    stores = [(result, entry, position[n]) for result, entry, n in read.stores]
    names = "op", "size", "to", "a", "b"
    arrays = dict(zip(names, map(_int32, zip(*columns, strict=True)), strict=True))
    for kind, own_names, rows in (
        ("load", ("argument", "entry", "to"), loads),
        ("store", ("result", "entry", "from"), stores),
    ):
        parts = zip(*rows, strict=True) if rows else ((), (), ())
        arrays |= {f"{kind}_{name}": _int32(part) for name, part in zip(own_names, parts, strict=True)}
    arrays["places"] = np.concatenate(lists).astype(np.int32) if lists else np.zeros(1, dtype=np.int32)
    memory = {"values": values, "left": np.zeros(longest), "right": np.zeros(longest)}
    pointers = {name: address(array) for name, array in (arrays | memory).items()}
    laid_out = Program(columns=len(columns), loads=len(loads), stores=len(stores), **pointers)
    laid_out.kept = arrays, memory
    laid_out.read, laid_out.at = read, position
    return laid_out


def _padded(count: int) -> int:
    """Round a number of entries up to whole blocks."""
    return -(-count // _BLOCK) * _BLOCK


def _int32(values: Any) -> Int32Array:
    return np.ascontiguousarray(list(values), dtype=np.int32)
