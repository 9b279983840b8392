/* Code shared by explicit and implicit steps of the linear map over a stretch: memory, linear algebra, and error control
   (control.py). `steps.c` has the entry points; tables.py writes the coefficients before this file. */

#include <math.h>
#include <stdlib.h>
#include <string.h>

typedef long long count_t;
enum { DONE = 0, FULL = 1, STIFF = 2, LOST = 3, NO_MEMORY = 4 };
enum { ITERATIONS = 10, EXPLICIT = 12, HEAD = 3, SUSPECTS = 15, CLEARED = 6, MOST_REFUSED = 150 };
#define LIMITING 0.1
#define PROBE 0.0625
#define NOISE 1e-3
#define UNRESOLVED 0.5
#define LARGE 20.0
#define ROUNDED 2e-15
#define STABLE 6.1
#define DAMPED 2.5
#define DAMPED_VARIATIONS 0.5

/* `Structure` of compiled.py, field by field. Matrices are row by row. */
struct variation {
  count_t n, nx, parameters, columns, entries, largest;
  count_t stiff, suspects, cleared, guessed, capacity, steps, refused, due, noted, streak, patience;
  double t, end, h, before, tolerance, radau_tolerance, least, shortest, loose;
  double start, noise, probed, probed_ratio, steady; /* as in control.py; `probed` is zero if no step has been probed */
  const count_t *starts, *rows; /* of the slopes, column by column: by n variables, then by parameters */
  const double *constant, *modes;
  double *w, *x, *stages, *record, *total, *peak;
  const double *scale; /* of the variations, row by row; null if their error is not controlled */
};

struct space {
  const double** arg;
  double** res;
  casadi_int* iw;
  double *w, *value, *slopes, *next, *matrix, *small, *right, *residual, *stage_slopes, *values, *rate, *sums;
  double *after, *rates, *sizes; /* variations at the end of the attempted step, rates at its start, allowed errors */
  double* missed; /* errors of that step that shorter steps would not reduce */
  int has_missed; /* whether there are any */
  count_t *pivot, *small_pivot;
};

static int evaluated(int (*f)(const double**, double**, casadi_int*, double*, int), const struct variation* v, struct space* o,
                     double t, const double* w, double* value, double* slopes) {
  o->arg[0] = &t; o->arg[1] = w; o->arg[2] = v->constant; o->arg[3] = v->modes;
  o->res[0] = value; o->res[1] = slopes;
  return f(o->arg, o->res, o->iw, o->w, 0);
}

static int are_finite(const double* a, count_t n) {
  count_t k;
  for (k = 0; k < n; ++k)
    if (!isfinite(a[k])) return 0;
  return 1;
}

/* LU with row exchanges; 0 where a pivot vanishes. */
static int factorised(double* restrict a, count_t n, count_t* pivot) {
  count_t i, j, k;
  for (k = 0; k < n; ++k) {
    count_t p = k;
    for (i = k + 1; i < n; ++i)
      if (fabs(a[i * n + k]) > fabs(a[p * n + k])) p = i;
    pivot[k] = p;
    if (!(fabs(a[p * n + k]) > 0)) return 0;
    if (p != k)
      for (j = 0; j < n; ++j) { double other = a[k * n + j]; a[k * n + j] = a[p * n + j]; a[p * n + j] = other; }
    for (i = k + 1; i < n; ++i) {
      double f = a[i * n + k];
      if (f == 0.0) continue;
      a[i * n + k] = f /= a[k * n + k];
      for (j = k + 1; j < n; ++j) a[i * n + j] -= f * a[k * n + j];
    }
  }
  return 1;
}

static void added(double* restrict to, double f, const double* restrict from, count_t m) {
  count_t j;
  for (j = 0; j < m; ++j) to[j] += f * from[j];
}

static void exchanged(double* b, count_t i, count_t k, count_t m) {
  count_t j;
  if (i != k)
    for (j = 0; j < m; ++j) { double other = b[k * m + j]; b[k * m + j] = b[i * m + j]; b[i * m + j] = other; }
}

/* Solve for m right-hand sides, the rows of `b` of length m. */
static void solved(const double* a, count_t n, const count_t* pivot, double* b, count_t m) {
  count_t i, k, j;
  for (k = 0; k < n; ++k) exchanged(b, pivot[k], k, m);
  for (i = 1; i < n; ++i)
    for (k = 0; k < i; ++k)
      if (a[i * n + k] != 0.0) added(b + i * m, -a[i * n + k], b + k * m, m);
  for (i = n - 1; i >= 0; --i) {
    for (k = i + 1; k < n; ++k)
      if (a[i * n + k] != 0.0) added(b + i * m, -a[i * n + k], b + k * m, m);
    for (j = 0; j < m; ++j) b[i * m + j] /= a[i * n + i];
  }
}

/* The same with the transposed matrix. */
static void solved_transposed(const double* a, count_t n, const count_t* pivot, double* b, count_t m) {
  count_t i, k, j;
  for (i = 0; i < n; ++i) {
    for (j = 0; j < m; ++j) b[i * m + j] /= a[i * n + i];
    for (k = i + 1; k < n; ++k)
      if (a[i * n + k] != 0.0) added(b + k * m, -a[i * n + k], b + i * m, m);
  }
  for (i = n - 1; i > 0; --i)
    for (k = 0; k < i; ++k)
      if (a[i * n + k] != 0.0) added(b + k * m, -a[i * n + k], b + i * m, m);
  for (k = n - 1; k >= 0; --k) exchanged(b, pivot[k], k, m);
}

/* to += slopes by variables times `x`, with m columns; transposed: times the transposed slopes. */
static void multiplied(const struct variation* v, const double* slopes, const double* x, double* to, count_t m, int transposed) {
  count_t c, e;
  for (c = 0; c < v->n; ++c)
    for (e = v->starts[c]; e < v->starts[c + 1]; ++e) {
      count_t r = v->rows[e];
      if (transposed) added(to + c * m, slopes[e], x + r * m, m);
      else added(to + r * m, slopes[e], x + c * m, m);
    }
}

static double first_step(const struct variation* v, const double* rate, double tolerance, double order) {
  double most = 1e-12;
  count_t k;
  for (k = 0; k < v->nx; ++k) {
    double found = fabs(rate[k]) / (1e-3 + fabs(v->w[k]));
    if (found > most) most = found;
  }
  return pow(tolerance, 1 / order) / most;
}

/* The largest value of a column of `scale`. */
static double largest_of(const struct variation* v, count_t column) {
  double largest = 0;
  count_t r;
  for (r = column; r < v->nx * v->columns; r += v->columns) largest = fmax(largest, v->scale[r]);
  return largest;
}

/* The errors that a step may have in its variations, which go from `v->x` to `o->after`, as in control.py; `v->peak` are
   their largest values since the start of the interval. */
static void allowed(const struct variation* v, struct space* o, double tolerance) {
  count_t m = v->columns, j, r;
  for (j = 0; j < v->parameters; ++j) {
    double rounding = 1e-15 * largest_of(v, j) + 1e-290;
    for (r = j; r < v->nx * m; r += m) {
      double size = fmax(fabs(v->x[r]), fabs(o->after[r]));
      o->sizes[r] = v->loose * tolerance * (1e-3 * fmax(v->peak[r], size) + size + 1e-5 * v->scale[r]) + rounding;
    }
  }
}

/* Note the errors of variations, or their whole change (`all`) if a step is as short as the uncertainty of its instants. */
static void noted(const struct variation* v, struct space* o, const double* errors, int all) {
  count_t r;
  for (r = 0; r < v->nx * v->columns; ++r) o->missed[r] = all ? o->after[r] - v->x[r] : errors[r];
  o->has_missed = 1;
}

/* Add the noted errors to the columns of errors that follow the variations, if there are any. */
static void accept_missed(struct variation* v, const struct space* o) {
  count_t m = v->columns, k = v->parameters, r, j;
  if (!o->has_missed) return;
  v->noted = 1;
  if (m < 2 * k) return;
  for (r = 0; r < v->nx; ++r)
    for (j = 0; j < k; ++j) v->x[r * m + k + j] += o->missed[r * m + j];
}

/* Whether an accepted step is to be followed by a probe, as steps have not grown for long; as in control.py. */
static int is_stuck(struct variation* v, double h, double ratio) {
  if (ratio < LIMITING || !(0.5 * v->steady < h && h < 2 * v->steady)) { v->steady = h; v->streak = 0; return 0; }
  if (++v->streak < v->patience || h >= 0.1 * (v->t - v->start)) return 0;
  v->streak = 0;
  v->patience *= 2;
  return 1;
}

/* `ratio`, or less if shorter steps would be no better, as in control.py; `errors` are those of the variations, `whole`
   is the ratio without the allowance for rounding. */
static double judged(struct variation* v, struct space* o, double h, double ratio, double whole, const double* errors) {
  int is_short = h <= v->shortest, is_noise;
  o->has_missed = 0;
  if (v->probed > 0) {
    if (ratio > NOISE * v->probed_ratio && ratio < UNRESOLVED * v->probed_ratio)
      v->noise = fmax(v->noise, 2 * v->probed_ratio / v->probed);
    v->probed = 0;
  }
  is_noise = ratio > 0 && ratio <= v->noise * h;
  if (is_noise || ratio <= 1) {
    if (whole > 1) noted(v, o, errors, 0);
    if (!is_noise && is_stuck(v, h, ratio)) { v->probed = h; v->probed_ratio = ratio; }
    return is_noise ? fmin(ratio, pow(ratio / (v->noise * h), 4)) : ratio;
  }
  if (++v->refused < MOST_REFUSED && !is_short) {
    if (v->refused >= v->due && ratio < LARGE && h < 0.1 * (v->t - v->start)) {
      v->due *= 2;
      v->probed = h;
      v->probed_ratio = ratio;
    }
    return ratio;
  }
  noted(v, o, errors, is_short);
  return is_short ? 0.1 : 0.0;
}

/* Add the contribution of parameters to the rates of variations. */
static void by_parameters(const struct variation* v, const double* slopes, double* to) {
  count_t c, e, m = v->columns;
  for (c = 0; c < v->parameters; ++c)
    for (e = v->starts[v->n + c]; e < v->starts[v->n + c + 1]; ++e) to[v->rows[e] * m + c] += slopes[e];
}

/* The error of a step from the sums of squares of both embedded errors over its n variables: of order 7 where the solution
   is smooth, of order 5 where it is not and both errors are similar. */
static double estimate(double five, double three, count_t n) {
  return five > 0 ? five / sqrt((five + 0.01 * three) * (double) n) : 0.0;
}
