"""Writes the sizes of a generated integrator as constants, where CasADi reads them from a structure.

Vectors of a ball have 13 entries, and a step has eight stages. Compilers unroll loops of known length, and vectorise
loops whose arrays do not overlap. Together with functions that can be inlined, because they are hidden (`source.py`),
this saved a fifth of the compiled loop of a run of balls. Results are identical.
"""

from __future__ import annotations

import re

# Sizes that `casadi_ivp_setup` derives from those in the source, without sensitivities.
_DERIVED = {"nx": ("nx1",), "nz": ("nz1",), "nq": ("nq1",), "ny": ("nx1", "nz1", "nq1")}
_GIVEN = "nx1", "nz1", "nq1", "nfwd", "nadj", "n_stages", "n_dense", "nx_err", "nz_err", "nq_err"
_SETUP = "void casadi_ivp_setup(", "\n}\n"
# Functions that add to a vector which does not overlap with the others.
_RESTRICT = (
    (
        "void casadi_axpy(casadi_int n, casadi_real alpha, const casadi_real* x, casadi_real* y) {",
        "static inline void casadi_axpy(casadi_int n, casadi_real alpha, const casadi_real* restrict x, "
        "casadi_real* restrict y) {",
    ),
    (
        "void casadi_mv_dense(const casadi_real* x, casadi_int nrow_x, casadi_int ncol_x,\n"
        "    const casadi_real* y, casadi_real* z, casadi_int tr) {",
        "static inline void casadi_mv_dense(const casadi_real* restrict x, casadi_int nrow_x, casadi_int ncol_x,\n"
        "    const casadi_real* restrict y, casadi_real* restrict z, casadi_int tr) {",
    ),
)


def with_sizes(source: str) -> str:
    """Write the sizes into a generated integrator; returns it unchanged if it differs from the expected form."""
    matches = {name: re.findall(rf"(?m)^  p\.{name} = (\d+);$", source) for name in _GIVEN}
    start = source.find(_SETUP[0])
    if start < 0 or any(len(found) != 1 for found in matches.values()):
        return source
    sizes = {name: int(found[0]) for name, found in matches.items()}
    if sizes["nfwd"] or sizes["nadj"] or any(source.count(old) != 1 for old, _ in _RESTRICT):
        return source
    sizes |= {name: sum(sizes[part] for part in parts) for name, parts in _DERIVED.items()}
    end = source.index(_SETUP[1], start)
    size_field = re.compile(rf"\bp->({'|'.join(sizes)})\b(?! = )")

    def with_constants(text: str) -> str:
        return size_field.sub(lambda found: str(sizes[found[1]]), text)

    result = with_constants(source[:start]) + source[start:end] + with_constants(source[end:])
    for old, new in _RESTRICT:
        result = result.replace(old, new)
    return result
