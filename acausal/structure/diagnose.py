"""Dulmage-Mendelsohn decomposition: which part of a system has too many equations, and which too few."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from acausal.errors import InternalError
from acausal.structure.graph import Incidence, IntArray, inverse


class Subset(NamedTuple):
    """Some rows and some columns, each ascending."""

    rows: tuple[int, ...]
    columns: tuple[int, ...]


@dataclass(frozen=True)
class DulmageMendelsohn:
    """Coarse Dulmage-Mendelsohn parts; all tuples ascending.

    over
        More rows than columns; these rows contain no other columns. Any of the rows may be the surplus one.
    square
        As many rows as columns; the rows contain no column of the under-determined part.
    under
        More columns than rows; these columns occur in no other row. Any of the columns may be the free one.

    The parts do not depend on the maximum matching from which they are computed.
    """

    over_rows: tuple[int, ...]
    over_columns: tuple[int, ...]
    square_rows: tuple[int, ...]
    square_columns: tuple[int, ...]
    under_rows: tuple[int, ...]
    under_columns: tuple[int, ...]

    @property
    def surplus(self) -> int:
        """Number of equations too many."""
        return len(self.over_rows) - len(self.over_columns)

    @property
    def missing(self) -> int:
        """Number of equations too few."""
        return len(self.under_columns) - len(self.under_rows)


def dulmage_mendelsohn(incidence: Incidence, row_to_column: IntArray) -> DulmageMendelsohn:
    """Over-determined, square and under-determined part of a system.

    Parameters
    ----------
    incidence
        The graph, of any shape.
    row_to_column
        Shape (n_rows,): a *maximum* matching, see `matching.match`.

    Raises InternalError (AC903) when the matching is not maximum.

    Source: Dulmage and Mendelsohn, "Coverings of bipartite graphs", Canad. J. Math. 10 (1958); computed as in Pothen
    and Fan, "Computing the block triangular form of a sparse matrix", ACM TOMS 16 (1990), section 2.
    """
    column_to_row = inverse(row_to_column, incidence.n_columns)
    over = _alternating(incidence, np.flatnonzero(row_to_column < 0).tolist(), column_to_row)
    free = np.flatnonzero(column_to_row < 0).tolist()
    under_columns, under_rows = _alternating(incidence.transpose(), free, row_to_column) if free else Subset((), ())
    return DulmageMendelsohn(
        over_rows=over.rows,
        over_columns=over.columns,
        square_rows=_rest(incidence.n_rows, over.rows, under_rows),
        square_columns=_rest(incidence.n_columns, over.columns, under_columns),
        under_rows=under_rows,
        under_columns=under_columns,
    )


def minimal_over(incidence: Incidence, unmatched_row: int, row_to_column: IntArray) -> Subset:
    """Minimal over-determined subset that contains one unmatched row: n + 1 rows in n columns.

    `row_to_column`: shape (n_rows,), a maximum matching.

    Minimal by inclusion: if any one of its rows is removed, all others can be matched. The surplus equation is
    therefore one of these rows, and all of them are needed as evidence. (In matroid terms: the fundamental circuit of
    `unmatched_row` over the matched rows.) With a single unmatched row it is the only such subset of the system; with
    several, another maximum matching may give another, possibly smaller, circuit through the same row.

    Raises InternalError (AC903) when the row is matched or the matching is not maximum.
    """
    if row_to_column[unmatched_row] >= 0:
        raise InternalError("AC903", f"row {unmatched_row} is matched: it does not prove over-determination")
    return _alternating(incidence, [unmatched_row], inverse(row_to_column, incidence.n_columns))


def minimal_under(incidence: Incidence, unmatched_column: int, row_to_column: IntArray) -> Subset:
    """Minimal under-determined subset that contains one unmatched column: n + 1 columns that occur in n rows only.

    `row_to_column`: shape (n_rows,), a maximum matching.

    Minimal by inclusion among sets of columns: once any one of the columns is known, the rows determine the others.
    The missing equation therefore concerns one of these unknowns, and no column can be left out. The rows may contain
    further columns, which other rows determine. As for `minimal_over`, it is unique with a single unmatched column.

    Raises InternalError (AC903) when the column is matched or the matching is not maximum.
    """
    if np.any(row_to_column == unmatched_column):
        raise InternalError("AC903", f"column {unmatched_column} is matched: it does not prove under-determination")
    columns, rows = _alternating(incidence.transpose(), [unmatched_column], row_to_column)
    return Subset(rows, columns)


def _alternating(incidence: Incidence, start: Sequence[int], column_to_row: IntArray) -> Subset:
    """Rows and columns reached from `start` by alternating paths: row, any of its columns, the row matched to it."""
    rows = set(start)
    columns: set[int] = set()
    stack = list(start)
    while stack:
        for column in incidence.row(stack.pop()).tolist():
            if column in columns:
                continue
            columns.add(column)
            row = int(column_to_row[column])
            if row < 0:
                raise InternalError("AC903", "the matching is not maximum: a path connects two unmatched ends")
            # A matched row is entered through its own column only, so it is new.
            rows.add(row)
            stack.append(row)
    return Subset(tuple(sorted(rows)), tuple(sorted(columns)))


def _rest(count: int, first: Sequence[int], second: Sequence[int]) -> tuple[int, ...]:
    remaining = np.ones(count, dtype=bool)
    remaining[list(first)] = False
    remaining[list(second)] = False
    return tuple(np.flatnonzero(remaining).tolist())
