"""Incidence of unknowns in equations, as integers.

Rows are equations, columns are unknowns; their meaning is left to the caller. Every pass of this package takes an
`Incidence` and returns vectors of integers, so that it can be tested with tables.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, cast

import numpy as np
import numpy.typing as npt

from acausal.errors import InternalError

if TYPE_CHECKING:
    from scipy import sparse

IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]

_REPR_ROWS = 12


@dataclass(frozen=True, eq=False, repr=False)
class Incidence:
    """A bipartite graph between equations (rows) and unknowns (columns), in compressed rows.

    Parameters
    ----------
    indptr
        Shape (n_rows + 1,): row `i` has its columns in `indices[indptr[i]:indptr[i + 1]]`.
    indices
        Shape (n_entries,): columns, ascending and without repetition in each row.
    n_columns
        Number of unknowns, including those that occur in no equation.

    Use `Incidence.from_rows` unless the arrays already have this form, because the constructor does not sort.
    """

    indptr: IntArray
    indices: IntArray
    n_columns: int

    @classmethod
    def from_rows(cls, rows: Iterable[Iterable[int]], n_columns: int) -> Incidence:
        """Graph from the columns of each row, in any order; repetitions are dropped.

        Raises InternalError (AC901) when a column is outside 0 .. n_columns - 1.
        """
        lists = [list(row) for row in rows]
        n_rows = len(lists)
        lengths = np.fromiter(map(len, lists), dtype=np.int64, count=n_rows)
        columns = np.fromiter((c for row in lists for c in row), dtype=np.int64, count=int(lengths.sum()))
        if columns.size and (columns.min() < 0 or columns.max() >= n_columns):
            raise InternalError(
                "AC901",
                f"an incidence row names column {int(columns.min())} or {int(columns.max())}, "
                f"outside 0 .. {n_columns - 1}",
            )
        # One sort of pairs (row, column), encoded as numbers, is ten times faster than a sort per row at 1e5 rows.
        keys = np.unique(np.repeat(np.arange(n_rows, dtype=np.int64), lengths) * max(n_columns, 1) + columns)
        row_of_entry = keys // max(n_columns, 1)
        return cls(_pointers(row_of_entry, n_rows), keys - row_of_entry * max(n_columns, 1), n_columns)

    @property
    def n_rows(self) -> int:
        """Number of equations."""
        return len(self.indptr) - 1

    @property
    def n_entries(self) -> int:
        """Number of occurrences of an unknown in an equation."""
        return len(self.indices)

    @property
    def row_of_entry(self) -> IntArray:
        """Row of each element of `indices`, shape (n_entries,)."""
        return np.repeat(np.arange(self.n_rows, dtype=np.int64), np.diff(self.indptr))

    def row(self, i: int) -> IntArray:
        """Columns of row `i`, ascending, shape (n_columns_in_row,)."""
        return self.indices[self.indptr[i] : self.indptr[i + 1]]

    def rows(self) -> list[list[int]]:
        """All rows as lists of Python integers, because loops over lists are several times faster than over arrays."""
        pointers, columns = self.indptr.tolist(), self.indices.tolist()
        return [columns[a:b] for a, b in pairwise(pointers)]

    def transpose(self) -> Incidence:
        """Graph with equations and unknowns exchanged."""
        # A stable sort by column leaves the rows of each column ascending.
        order = np.argsort(self.indices, kind="stable")
        return Incidence(_pointers(self.indices[order], self.n_columns), self.row_of_entry[order], self.n_rows)

    def restrict(self, rows: Sequence[int] | IntArray, columns: Sequence[int] | IntArray) -> Incidence:
        """Subgraph of the given rows and columns, renumbered by their positions in the arguments.

        `rows` and `columns` are sequences or arrays of shape (k,) without repetitions. Costs O(entries of those rows),
        whatever the size of the whole graph, because blocks are extracted one by one.
        """
        chosen_rows = np.asarray(rows, dtype=np.int64)
        chosen_columns = np.asarray(columns, dtype=np.int64)
        starts = self.indptr[chosen_rows]
        lengths = self.indptr[chosen_rows + 1] - starts
        ends = np.cumsum(lengths)
        total = int(ends[-1]) if len(ends) else 0
        entries = self.indices[np.arange(total) + np.repeat(starts - (ends - lengths), lengths)]
        new_row = np.repeat(np.arange(len(chosen_rows), dtype=np.int64), lengths)

        by_value = np.argsort(chosen_columns, kind="stable")
        position = np.searchsorted(chosen_columns, entries, sorter=by_value)
        inside = position < len(chosen_columns)
        new_column = by_value[position[inside]]
        is_chosen = chosen_columns[new_column] == entries[inside]
        new_row, new_column = new_row[inside][is_chosen], new_column[is_chosen]

        order = np.lexsort((new_column, new_row))
        return Incidence(_pointers(new_row, len(chosen_rows)), new_column[order], len(chosen_columns))

    def to_csr(self) -> sparse.csr_array:
        """SciPy matrix of shape (n_rows, n_columns) with a one for every occurrence."""
        from scipy import sparse  # late: the import takes a quarter of a second that small models need not spend

        # csgraph works on 32-bit indices and would convert in every call.
        return sparse.csr_array(
            (np.ones(self.n_entries), self.indices.astype(np.int32), self.indptr.astype(np.int32)),
            shape=(self.n_rows, self.n_columns),
        )

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Incidence):
            return NotImplemented
        return (
            self.n_columns == other.n_columns
            and np.array_equal(self.indptr, other.indptr)
            and np.array_equal(self.indices, other.indices)
        )

    def __repr__(self) -> str:
        text = f"Incidence({self.n_rows} rows, {self.n_columns} columns, {self.n_entries} entries"
        if self.n_rows == 0:
            return text + ")"
        shown = [f"{i}: {self.row(i).tolist()}" for i in range(min(self.n_rows, _REPR_ROWS))]
        if self.n_rows > _REPR_ROWS:
            shown.append("...")
        return text + "; " + ", ".join(shown) + ")"


def inverse(row_to_column: IntArray, n_columns: int) -> IntArray:
    """Column -> row of a matching given as row -> column; -1 where unmatched. Shape (n_columns,)."""
    column_to_row = np.full(n_columns, -1, dtype=np.int64)
    matched = np.flatnonzero(row_to_column >= 0)
    column_to_row[row_to_column[matched]] = matched
    return column_to_row


def _pointers(sorted_rows: IntArray, n_rows: int) -> IntArray:
    counts = np.bincount(sorted_rows, minlength=n_rows) if len(sorted_rows) else np.zeros(n_rows, dtype=np.int64)
    return cast(IntArray, np.concatenate(([0], np.cumsum(counts))).astype(np.int64))
