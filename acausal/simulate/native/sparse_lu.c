/* Linear systems of a step by a sparse LU with pivots on the diagonal, whose pattern is known when the code is generated.

   CasADi's QR is robust, but takes four times the operations, and half of a run for a ball of 13 states. The matrix
   M/(h gamma) - J is dominated by its diagonal if steps are short, so pivoting is rarely needed. Its need can be detected:
   row i of the matrix that was actually factorised differs from row i of A by at most n roundings of |L||U| (N. J. Higham,
   Accuracy and Stability of Numerical Algorithms, 2002, theorem 9.3). If that exceeds LU_GROWTH times the largest entry of
   the row, if a pivot is zero, or if a value is not finite, QR is used, which also decides whether A is singular. Rows are
   judged separately, so that neither the units of states nor those of equations matter.

   Rows and columns are numbered in the order of elimination (sparse_lu.py). */

#define LU_GROWTH 1e3
/* a maximum in one instruction, which is nan if the value is */
#define LU_LARGER(largest, value) largest = largest > fabs(value) ? largest : fabs(value);
#define LU_ACCEPTED(bound, size, inverse) \
  if (!((bound) <= LU_GROWTH * (size)) || !casadi_ivp_isfinite(inverse)) return 0;

/* loops */
static int acausal_lu(const casadi_real* a, casadi_real* lu, casadi_real* x) {
  casadi_real *l = lu, *u = l + lu_left[LU_ROWS], *inverse = u + lu_right[LU_ROWS], *largest = inverse + LU_ROWS;
  casadi_int i, j, k;
  for (i = 0; i < LU_ROWS; ++i) {
    casadi_real size = 0, bound = 0, top;
    for (k = lu_left[i]; k < lu_left[i + 1]; ++k) x[lu_left_at[k]] = 0;
    for (k = lu_right[i]; k < lu_right[i + 1]; ++k) x[lu_right_at[k]] = 0;
    x[i] = 0;
    for (k = lu_given[i]; k < lu_given[i + 1]; ++k) {
      casadi_real entry = a[lu_given_from[k]];
      x[lu_given_at[k]] = entry;
      LU_LARGER(size, entry)
    }
    for (k = lu_left[i]; k < lu_left[i + 1]; ++k) {
      casadi_int c = lu_left_at[k];
      casadi_real factor = x[c] * inverse[c];
      l[k] = factor;
      if (factor == 0) continue;
      bound += fabs(factor) * largest[c];
      for (j = lu_right[c]; j < lu_right[c + 1]; ++j) x[lu_right_at[j]] -= factor * u[j];
    }
    top = fabs(x[i]);
    if (!(top > 0)) return 0;
    inverse[i] = 1 / x[i];
    for (k = lu_right[i]; k < lu_right[i + 1]; ++k) {
      u[k] = x[lu_right_at[k]];
      LU_LARGER(top, u[k])
    }
    largest[i] = top;
    LU_ACCEPTED(bound + top, size, inverse[i])
  }
  return 1;
}

static void acausal_lu_solve(const casadi_real* lu, casadi_real* v, casadi_real* x) {
  const casadi_real *l = lu, *u = l + lu_left[LU_ROWS], *inverse = u + lu_right[LU_ROWS];
  casadi_int i, k;
  for (i = 0; i < LU_ROWS; ++i) {
    casadi_real sum = v[lu_order[i]];
    for (k = lu_left[i]; k < lu_left[i + 1]; ++k) sum -= l[k] * x[lu_left_at[k]];
    x[i] = sum;
  }
  for (i = LU_ROWS - 1; i >= 0; --i) {
    casadi_real sum = x[i];
    for (k = lu_right[i]; k < lu_right[i + 1]; ++k) sum -= u[k] * x[lu_right_at[k]];
    x[i] = sum * inverse[i];
    v[lu_order[i]] = x[i];
  }
}

