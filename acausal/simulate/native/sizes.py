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

# Sums over stages of a small ODE, one entry after the other: CasADi adds vectors, and a processor waits where it loads
# two entries at once that were stored one by one just before, as the solution of a linear system is.
_LARGEST_SMALL = 8
_SMALL = (
    (
        "  casadi_copy(d->y0, p->ny, d->y_stage);\n"
        "  for (j = 0; j < i; ++j) if (a[j] != 0) casadi_axpy(p->ny, a[j], d->U + j * p->ny, d->y_stage);\n",
        "  casadi_int k;\n"
        "  for (k = 0; k < p->ny; ++k) {\n"
        "    casadi_real sum = d->y0[k];\n"
        "    for (j = 0; j < i; ++j) if (a[j] != 0) sum += a[j] * d->U[j * p->ny + k];\n"
        "    d->y_stage[k] = sum;\n"
        "  }\n",
    ),
    (
        "  for (j = 0; j < i; ++j) {\n"
        "    cij = rp->c[i * p->n_stages + j] / d->h;\n"
        "    casadi_axpy(p->nx, cij, d->U + j * p->ny, Ui);\n"
        "    casadi_axpy(p->nq, cij, d->U + j * p->ny + p->nx + p->nz, Ui + p->nx + p->nz);\n"
        "  }\n"
        "  casadi_axpy(p->ny, rp->gamma_sum[i] * d->h, r->dfdt, Ui);\n",
        "  casadi_int k;\n"
        "  casadi_real factors[p->n_stages];\n"
        "  for (j = 0; j < i; ++j) factors[j] = rp->c[i * p->n_stages + j] / d->h;\n"
        "  cij = rp->gamma_sum[i] * d->h;\n"
        "  for (k = 0; k < p->ny; ++k) {\n"
        "    casadi_real sum = Ui[k];\n"
        "    for (j = 0; j < i; ++j) sum += factors[j] * d->U[j * p->ny + k];\n"
        "    Ui[k] = sum + cij * r->dfdt[k];\n"
        "  }\n",
    ),
    (
        "  casadi_rosenbrock_gather(vx, vz, p->nx1, p->nz1, u0);\n  casadi_rosenbrock_iter_solve(r, u0, 1, 0);\n",
        "  casadi_rosenbrock_iter_solve(r, v, 1, 0);\n  return;\n",
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
    if sizes["ny"] == sizes["nx"] <= _LARGEST_SMALL:
        for old, new in _SMALL:
            source = source.replace(old, new)
        start = source.index(_SETUP[0])
    end = source.index(_SETUP[1], start)
    size_field = re.compile(rf"\bp->({'|'.join(sizes)})\b(?! = )")

    def with_constants(text: str) -> str:
        return size_field.sub(lambda found: str(sizes[found[1]]), text)

    result = with_constants(source[:start]) + source[start:end] + with_constants(source[end:])
    for old, new in _RESTRICT:
        result = result.replace(old, new)
    return result
