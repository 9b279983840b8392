"""Maximum matching of equations with unknowns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from acausal.structure.graph import Incidence, IntArray

_MOST_WITHOUT_SCIPY = 500
"""Up to this many rows SciPy is not imported: the import takes a quarter of a second, the search a few milliseconds."""


def match(incidence: Incidence) -> IntArray:
    """Maximum matching: the column of each row, -1 for an unmatched row. Shape (n_rows,).

    As many rows as possible are matched. It is not specified which of several maximum matchings is found, though it is
    the same in every run; blocks (`blt.blocks`) and the coarse parts (`diagnose.dulmage_mendelsohn`) do not depend on
    it.

    Sources: Karp and Sipser, "Maximum matchings in sparse random graphs", FOCS 1981, for rows and columns with one
    partner; Hopcroft and Karp, "An n^(5/2) algorithm for maximum matchings in bipartite graphs", SIAM J. Comput. 2
    (1973), as implemented by SciPy, for the rest; augmenting paths one by one (H. W. Kuhn, Naval Res. Logist. Q. 2
    (1955)) if the rest is small.
    """
    # SciPy alone would be slow: its time on a causal (triangular) system grows with n^1.9, to 1.8 s for 1e5 rows. Most
    # models are causal except for small loops; for these the first step is linear and leaves hardly any work.
    row_to_column = _match_single_partners(incidence)
    free_column = np.ones(incidence.n_columns, dtype=bool)
    free_column[row_to_column[row_to_column >= 0]] = False
    rows, columns = np.flatnonzero(row_to_column < 0), np.flatnonzero(free_column)
    core = incidence.restrict(rows, columns)
    if core.n_entries:
        if len(rows) <= _MOST_WITHOUT_SCIPY:
            core_columns = _match_small(core)
        else:
            from scipy.sparse.csgraph import maximum_bipartite_matching

            # `perm_type` names the side that is *returned*, not the one that is permuted: the column of each row.
            core_columns = np.asarray(maximum_bipartite_matching(core.to_csr(), perm_type="column"), dtype=np.int64)
        row_to_column[rows[core_columns >= 0]] = columns[core_columns[core_columns >= 0]]
    return row_to_column


def stays_matched(rows: Sequence[Sequence[int]], matched: Sequence[int], changed: Mapping[int, Sequence[int]]) -> bool:
    """Whether all rows can still be matched after some of them change; `matched` is the column of each row before."""
    columns_of = list(rows)
    for row, columns in changed.items():
        columns_of[row] = columns
    lost = [row for row, columns in changed.items() if matched[row] not in columns]
    row_of = {column: row for row, column in enumerate(matched) if row not in lost}
    return all(_augment(columns_of, row_of, row) for row in lost)


def _match_small(core: Incidence) -> IntArray:
    """The column of each row, shape (n_rows,): rows one by one, each by a depth-first search for an augmenting path."""
    columns_of = core.rows()
    row_of: dict[int, int] = {}
    for start in range(core.n_rows):
        _augment(columns_of, row_of, start)
    row_to_column = np.full(core.n_rows, -1, dtype=np.int64)
    for column, row in row_of.items():
        row_to_column[row] = column
    return row_to_column


def _augment(columns_of: Sequence[Sequence[int]], row_of: dict[int, int], start: int) -> bool:
    """Match one more row, by a depth-first search for an augmenting path; `row_of` maps matched columns to rows."""
    seen: set[int] = set()
    path, ahead = [start], [iter(columns_of[start])]
    taken: list[int] = []  # taken[k] leads from path[k] to the row it is matched to, path[k + 1]
    while path:
        for column in ahead[-1]:
            if column not in seen:
                break
        else:
            path.pop()
            ahead.pop()
            if taken:
                taken.pop()
            continue
        seen.add(column)
        taken.append(column)
        row = row_of.get(column)
        if row is None:
            row_of.update(zip(taken, path, strict=True))
            return True
        path.append(row)
        ahead.append(iter(columns_of[row]))
    return False


def _match_single_partners(incidence: Incidence) -> IntArray:
    """Match rows and columns that have only one partner left, repeatedly (Karp-Sipser); shape (n_rows,).

    Some maximum matching contains the result, so that it can be completed to a maximum matching.
    """
    columns_of, rows_of = incidence.rows(), incidence.transpose().rows()
    row_open, column_open = [True] * len(columns_of), [True] * len(rows_of)
    # If the count is one, the sum is the one index that remains, so that it need not be searched.
    row_count, row_sum = [len(c) for c in columns_of], [sum(c) for c in columns_of]
    column_count, column_sum = [len(r) for r in rows_of], [sum(r) for r in rows_of]
    single = [(r, -1) for r, count in enumerate(row_count) if count == 1]
    single += [(-1, c) for c, count in enumerate(column_count) if count == 1]
    row_to_column = [-1] * len(columns_of)
    while single:
        row, column = single.pop()
        if column < 0:
            if not row_open[row] or row_count[row] != 1:
                continue
            column = row_sum[row]
        else:
            if not column_open[column] or column_count[column] != 1:
                continue
            row = column_sum[column]
        row_to_column[row] = column
        row_open[row] = column_open[column] = False
        for r in rows_of[column]:
            if row_open[r]:
                row_count[r] -= 1
                row_sum[r] -= column
                if row_count[r] == 1:
                    single.append((r, -1))
        for c in columns_of[row]:
            if column_open[c]:
                column_count[c] -= 1
                column_sum[c] -= row
                if column_count[c] == 1:
                    single.append((-1, c))
    return np.array(row_to_column, dtype=np.int64)
