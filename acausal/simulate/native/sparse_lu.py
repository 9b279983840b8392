"""The linear systems of a generated Rosenbrock integrator: a sparse LU that replaces CasADi's QR (`sparse_lu.c`).

The pattern is read from the generated source. It is ordered once, by minimum degree, with pivots on the diagonal. At
each step the values decide whether that is accurate enough; otherwise QR is used.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import casadi as ca
import numpy as np

_FIELDS = "iter", "iter_v", "iter_r"
# Each pattern must match once, or the source is left unchanged. C of the factorisation is inserted before the first.
_CHANGES: tuple[tuple[str, str], ...] = (
    (r"struct casadi_rosenbrock_data \{\n", r"\g<0>  int lu;\n"),
    (
        r"  casadi_qr\(rp->sp_iter, r->iter, ",
        "  r->lu = p->nadj == 0 && acausal_lu(r->iter, r->iter_v, r->qr_w);\n  if (r->lu) return 0;\n\\g<0>",
    ),
    (
        r"  casadi_qr_solve\(v, nrhs, tr, rp->sp_iter_v, ",
        "  if (r->lu) {\n    casadi_int k, n = rp->sp_iter[1];\n"
        "    for (k = 0; k < nrhs; ++k) acausal_lu_solve(r->iter_v, v + k * n, r->qr_w);\n    return;\n  }\n\\g<0>",
    ),
)
# Up to this many entries of L and U, factorisation and solution are written out without loops, which takes a third of
# the time for a ball of 13 states. The line of `sparse_lu.c` after which the loops are.
_MOST_WRITTEN_OUT, _LOOPS = 400, "/* loops */\n"
_INSERTION = "struct casadi_rosenbrock_prob {\n"


@dataclass(frozen=True)
class Elimination:
    """The entries of an LU factorisation of a sparse matrix, in the order of elimination.

    Attributes
    ----------
    order
        The row and column of the matrix that is eliminated at each step, shape (n,).
    left, right
        Columns of L and of U in each row, without the diagonal, ascending.
    given
        For each row, the columns of its entries, and their indices among the entries of the matrix by columns.
    """

    order: tuple[int, ...]
    left: tuple[tuple[int, ...], ...]
    right: tuple[tuple[int, ...], ...]
    given: tuple[tuple[tuple[int, int], ...], ...]

    @property
    def numbers(self) -> int:
        """Number of values that `sparse_lu.c` stores: L, U, pivots, and the largest entry of each row of U."""
        return sum(map(len, self.left)) + sum(map(len, self.right)) + 2 * len(self.order)


def elimination(pattern: ca.Sparsity) -> Elimination | None:
    """The elimination of a square matrix by minimum degree of A + A^T; None if its diagonal has zeros."""
    n = pattern.size1()
    if not all(pattern.has_nz(k, k) for k in range(n)):
        return None
    order = (pattern + pattern.T).amd()
    step = np.empty(n, dtype=int)
    step[order] = np.arange(n)
    given: list[list[tuple[int, int]]] = [[] for _ in range(n)]
    for index, (row, column) in enumerate(zip(*pattern.get_triplet(), strict=True)):
        given[step[row]].append((int(step[column]), index))
    left: list[list[int]] = []
    right: list[list[int]] = []
    for k in range(n):
        entries = {column for column, _ in given[k]}
        for column in range(min(entries), k):  # fill-in is to the right of the current column
            if column in entries:
                entries.update(right[column])
        left.append(sorted(c for c in entries if c < k))
        right.append(sorted(c for c in entries if c > k))
    lower, upper = tuple(map(tuple, left)), tuple(map(tuple, right))
    return Elimination(tuple(order), lower, upper, tuple(map(tuple, given)))


def with_lu(source: str) -> str:
    """Insert an LU before the QR of a generated Rosenbrock integrator; unchanged if LU needs more memory than QR."""
    arrays = [array for name in _FIELDS if (array := _array(source, name)) is not None]
    if len(arrays) < len(_FIELDS) or _INSERTION not in source:
        return source
    matrix, *factors = (ca.Sparsity.compressed(array) for array in arrays)
    plan = elimination(matrix)
    # it is stored in the memory for the factors of QR, which has to be large enough
    if plan is None or plan.numbers > sum(f.nnz() for f in factors) + matrix.size1():
        return source
    before, place, after = source.partition(_INSERTION)
    text = before + _code(plan) + place + after
    for pattern, replacement in _CHANGES:
        text, count = re.subn(pattern, replacement, text)
        if count != 1:
            return source
    return text


def _array(source: str, field: str) -> list[int] | None:
    """The sparsity that a field of the integrator points to, in CasADi's compressed form."""
    name = re.search(rf"\.sp_{field} = (casadi_s\d+);", source)
    array = name and re.search(rf"\b{name.group(1)}\[\d+\] =\s*\{{([-\d,\s]+)\}};", source)
    return [int(number) for number in array.group(1).split(",")] if array else None


def _code(plan: Elimination) -> str:
    arrays = {
        "order": plan.order,
        **_rows("left", plan.left),
        **_rows("right", plan.right),
        **_rows("given", [[column for column, _ in row] for row in plan.given]),
        "given_from": [place for row in plan.given for _, place in row],
    }
    template = Path(__file__).with_name("sparse_lu.c").read_text(encoding="utf-8")
    tests, loops = template.split(_LOOPS)
    lines = [f"#define LU_ROWS {len(plan.order)}\n", tests]
    if len(arrays["left_at"]) + len(arrays["right_at"]) <= _MOST_WRITTEN_OUT:
        return "".join((*lines, _factorisation(plan), _solution(plan)))
    for name, numbers in arrays.items():
        text = ", ".join(map(str, numbers)) or "0"
        lines.append(f"static const casadi_int lu_{name}[{max(len(numbers), 1)}] = {{{text}}};\n")
    return "".join((*lines, loops))


def _factorisation(plan: Elimination) -> str:
    """`acausal_lu` of `sparse_lu.c`, with the same operations in the same order."""
    head = "static int acausal_lu(const casadi_real* a, casadi_real* lu, casadi_real* x) {\n  (void) x;\n"
    lines, upper = [head], sum(map(len, plan.left))
    pivots = upper + sum(map(len, plan.right))
    left_at, right_at = 0, upper
    for i, (left, right, given) in enumerate(zip(plan.left, plan.right, plan.given, strict=True)):
        entries = dict(given)
        lines += [f"  casadi_real size{i} = 0, bound{i} = 0, top{i}, inverse{i};\n"]
        for c in sorted((*left, i, *right)):
            lines.append(f"  casadi_real x{i}_{c} = {f'a[{entries[c]}]' if c in entries else '0'};\n")
        lines += [f"  LU_LARGER(size{i}, x{i}_{c})\n" for c in entries]
        for k, c in enumerate(left):
            lines.append(f"  lu[{left_at + k}] = x{i}_{c} *= inverse{c};\n  bound{i} += fabs(x{i}_{c}) * top{c};\n")
            lines += [f"  x{i}_{j} -= x{i}_{c} * x{c}_{j};\n" for j in plan.right[c]]
        lines.append(f"  top{i} = fabs(x{i}_{i});\n  if (!(top{i} > 0)) return 0;\n")
        lines.append(f"  lu[{pivots + i}] = inverse{i} = 1 / x{i}_{i};\n")
        lines += [f"  lu[{right_at + k}] = x{i}_{c};\n  LU_LARGER(top{i}, x{i}_{c})\n" for k, c in enumerate(right)]
        lines.append(f"  LU_ACCEPTED(bound{i} + top{i}, size{i}, inverse{i})\n")
        left_at, right_at = left_at + len(left), right_at + len(right)
    return "".join((*lines, "  return 1;\n}\n"))


def _solution(plan: Elimination) -> str:
    """`acausal_lu_solve` of `sparse_lu.c`."""
    n = len(plan.order)
    lower, upper = sum(map(len, plan.left)), sum(map(len, plan.right))
    lines, at = [], 0
    for k, columns in enumerate(plan.left):
        terms = "".join(f" - lu[{at + j}]*x{c}" for j, c in enumerate(columns))
        lines.append(f"  casadi_real x{k} = v[{plan.order[k]}]{terms};\n")
        at += len(columns)
    for k in reversed(range(n)):
        at = lower + sum(map(len, plan.right[:k]))
        # the value computed last is subtracted last, so that the other terms need not wait for it
        terms = "".join(f" - lu[{at + j}]*x{c}" for j, c in reversed([*enumerate(plan.right[k])]))
        lines.append(f"  x{k} = (x{k}{terms}) * lu[{lower + upper + k}];\n")
    lines += [f"  v[{row}] = x{k};\n" for k, row in enumerate(plan.order)]
    head = "static void acausal_lu_solve(const casadi_real* lu, casadi_real* v, casadi_real* x) {\n  (void) x;\n"
    return "".join((head, *lines, "}\n"))


def _rows(name: str, rows: Sequence[Sequence[int]]) -> dict[str, list[int]]:
    """The index at which each row begins, and the columns of all rows."""
    ends = np.cumsum([0, *map(len, rows)]).tolist()
    return {name: ends, f"{name}_at": [column for row in rows for column in row]}
