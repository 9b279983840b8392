/* The linear map of a stretch of a run, stepped as the other files of this folder do it: explicit steps of order 8 until
   they turn out to be stiff, then Radau IIA with STAGES stages.

   Linked with CasADi's code of `value` and `slopes`: what parameters alone determine is in `constant`. The tables RADAU_C,
   RADAU_A, RADAU_5, RADAU_3, EXPLICIT_C, EXPLICIT_A, EXPLICIT_B, EXPLICIT_3 and EXPLICIT_5 are written in front of this. */

#include <math.h>
#include <stdlib.h>
#include <string.h>

typedef long long count_t;
enum { DONE = 0, FULL = 1, STIFF = 2, LOST = 3, NO_MEMORY = 4 };
enum { ITERATIONS = 10, EXPLICIT = 12, HEAD = 3, SUSPECTS = 15, CLEARED = 6, MOST_REFUSED = 150 };
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
  count_t stiff, suspects, cleared, guessed, capacity, steps, refused, due;
  double t, end, h, before, tolerance, radau_tolerance, least, shortest;
  double start, noise, probed, probed_ratio; /* as in control.py; `probed` is zero where no step is */
  const count_t *starts, *rows; /* of the slopes, column by column: by n variables, then by parameters */
  const double *constant, *modes;
  double *w, *x, *stages, *record, *total, *peak;
  const double *scale; /* of the variations, row by row; none where their error is not controlled */
};

struct space {
  const double** arg;
  double** res;
  casadi_int* iw;
  double *w, *value, *slopes, *next, *matrix, *small, *right, *residual, *stage_slopes, *values, *rate, *sums;
  double *after, *rates, *sizes; /* variations at the end of a step that is tried, rates at its start, allowed errors */
  double* missed; /* errors of that step that shorter ones would not make smaller; */
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
      o->sizes[r] = tolerance * (1e-3 * fmax(v->peak[r], size) + size + 1e-5 * v->scale[r]) + rounding;
    }
  }
}

/* Note errors of variations, or all that they move where a step is as short as instants are known. */
static void noted(const struct variation* v, struct space* o, const double* errors, int all) {
  count_t r;
  for (r = 0; r < v->nx * v->columns; ++r) o->missed[r] = all ? o->after[r] - v->x[r] : errors[r];
  o->has_missed = 1;
}

/* Add what has been noted to the errors that are carried behind the variations, if they are. */
static void accept_missed(struct variation* v, const struct space* o) {
  count_t m = v->columns, k = v->parameters, r, j;
  if (!o->has_missed || m < 2 * k) return;
  for (r = 0; r < v->nx; ++r)
    for (j = 0; j < k; ++j) v->x[r * m + k + j] += o->missed[r * m + j];
}

/* `ratio`, or less where shorter steps would be no better, as in control.py; `errors` are those of the variations, `whole`
   is the ratio before rounding is allowed for. */
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

/* to += what parameters add to the rates of variations. */
static void by_parameters(const struct variation* v, const double* slopes, double* to) {
  count_t c, e, m = v->columns;
  for (c = 0; c < v->parameters; ++c)
    for (e = v->starts[v->n + c]; e < v->starts[v->n + c + 1]; ++e) to[v->rows[e] * m + c] += slopes[e];
}

/* ---- Radau IIA ---- */

/* The derivative of the equation of the stages, from slopes at each of them, factorised. */
static int radau_matrix(const struct variation* v, struct space* o, double h) {
  count_t n = v->n, wide = STAGES * n, i, j, c, e;
  memset(o->matrix, 0, sizeof(double) * (size_t) (wide * wide));
  for (j = 0; j < STAGES; ++j) {
    const double* slopes = o->stage_slopes + j * v->entries;
    for (c = 0; c < n; ++c)
      for (e = v->starts[c]; e < v->starts[c + 1]; ++e) {
        count_t r = v->rows[e];
        if (r >= v->nx) o->matrix[(j * n + r) * wide + j * n + c] = slopes[e];
        else
          for (i = 0; i < STAGES; ++i) o->matrix[(i * n + r) * wide + j * n + c] = -h * RADAU_A[i][j] * slopes[e];
      }
    for (c = 0; c < v->nx; ++c) o->matrix[(j * n + c) * wide + j * n + c] += 1.0;
  }
  return are_finite(o->matrix, wide * wide) && factorised(o->matrix, wide, o->pivot);
}

static int slopes_at(const struct variation* v, struct space* o, double t, double h, const double* stages) {
  count_t i;
  for (i = 0; i < STAGES; ++i)
    if (evaluated(slopes, v, o, t + h * RADAU_C[i], stages + i * v->n, o->values + i * v->n, o->stage_slopes + i * v->entries))
      return 0;
  return 1;
}

static void radau_residual(const struct variation* v, struct space* o, double h, const double* stages) {
  count_t n = v->n, i, j, r;
  for (i = 0; i < STAGES; ++i) {
    double* to = o->residual + i * n;
    for (r = 0; r < v->nx; ++r) to[r] = stages[i * n + r] - v->w[r];
    for (j = 0; j < STAGES; ++j) added(to, -h * RADAU_A[i][j], o->values + j * n, v->nx);
    memcpy(to + v->nx, o->values + i * n + v->nx, sizeof(double) * (size_t) (n - v->nx));
  }
}

/* Newton's method for the stages in `o->next`, with the matrix of where it begins. */
static int radau_stages(const struct variation* v, struct space* o, double h) {
  count_t n = v->n, wide = STAGES * n, k, i;
  double last = INFINITY, share = 1.0;
  for (k = 0; k < ITERATIONS; ++k) {
    double size = 0;
    if (!k) {
      if (!slopes_at(v, o, v->t, h, o->next) || !radau_matrix(v, o, h)) return 0;
    } else
      for (i = 0; i < STAGES; ++i)
        if (evaluated(value, v, o, v->t + h * RADAU_C[i], o->next + i * n, o->values + i * n, 0)) return 0;
    radau_residual(v, o, h, o->next);
    if (!are_finite(o->residual, wide)) return 0;
    solved(o->matrix, wide, o->pivot, o->residual, 1);
    for (i = 0; i < wide; ++i) {
      double move;
      o->next[i] -= o->residual[i];
      move = fabs(o->residual[i]) / (1e-3 + fabs(o->next[i]));
      if (!(move <= size)) size = move;
    }
    if (!isfinite(size)) return 0;
    if (k) {
      share = size / last;
      if (share >= 0.9 && size > 1e-12) return 0;
    }
    /* what the moves to come add up to */
    if (size <= 1e-13 || (k && size * share / (1 - share) <= 1e-4 * v->radau_tolerance)) return 1;
    last = size;
  }
  return 0;
}

/* The error of a step from the sums of squares of both embedded errors over its n variables: that of order 5 where both are
   alike, since the solution is not smooth, of order 7 where it is. */
static double estimate(double five, double three, count_t n) {
  return five > 0 ? five / sqrt((five + 0.01 * three) * (double) n) : 0.0;
}

/* An embedded error of m columns into `to`, from the stages in `stages`, their start and the rate there. */
static void embedded(const struct variation* v, const struct space* o, double h, const double* weights, const double* stages,
                     const double* start, const double* rate, double* to, count_t m) {
  count_t nx = v->nx * m, n = v->n * m, i, r;
  memset(to, 0, sizeof(double) * (size_t) n);
  for (r = 0; r < nx; ++r) {
    to[r] = rate[r];
    for (i = 0; i < STAGES; ++i) to[r] += weights[i] * (stages[i * n + r] - start[r]) / h;
  }
  solved(o->small, v->n, o->small_pivot, to, m);
}

/* The error of the step by embedded methods, in tolerances; slopes at its start are in `o->slopes`. */
static double radau_error(const struct variation* v, struct space* o, double h) {
  count_t n = v->n, nx = v->nx, c, e, r;
  double sums[2] = {0, 0};
  int k;
  memset(o->small, 0, sizeof(double) * (size_t) (n * n));
  for (c = 0; c < n; ++c)
    for (e = v->starts[c]; e < v->starts[c + 1]; ++e) o->small[v->rows[e] * n + c] = -o->slopes[e];
  for (r = 0; r < nx; ++r) o->small[r * n + r] += RADAU_REAL / h;
  if (!are_finite(o->small, n * n) || !factorised(o->small, n, o->small_pivot)) return INFINITY;
  for (k = 0; k < 2; ++k) {
    embedded(v, o, h, k ? RADAU_3 : RADAU_5, o->next, v->w, o->value, o->rate, 1);
    for (r = 0; r < nx; ++r) {
      double size = fmax(fabs(v->w[r]), fabs(o->next[(STAGES - 1) * n + r]));
      double one = o->rate[r] / (v->radau_tolerance * (1e-3 + size));
      sums[k] += one * one;
    }
  }
  return nx ? estimate(sums[0], sums[1], nx) : 0.0;
}

/* Values of the polynomial through the stages at those of the next step, `ratio` times as long. */
static void extended(const struct variation* v, double ratio, double* to) {
  count_t n = v->n, i, j, k;
  for (i = 0; i < STAGES; ++i) {
    memset(to + i * n, 0, sizeof(double) * (size_t) n);
    for (k = 0; k < STAGES; ++k) {
      double weight = 1.0;
      for (j = 0; j < STAGES; ++j)
        if (j != k) weight *= (1 + ratio * RADAU_C[i] - RADAU_C[j]) / (RADAU_C[k] - RADAU_C[j]);
      added(to + i * n, weight, v->stages + k * n, n);
    }
  }
}

/* What parameters put on the right of the equations of the variations of the stages, added. */
static void radau_right(const struct variation* v, const struct space* o, double h, double* right, count_t m) {
  count_t n = v->n, i, j, c, e;
  for (j = 0; j < STAGES; ++j)
    for (c = 0; c < v->parameters; ++c)
      for (e = v->starts[n + c]; e < v->starts[n + c + 1]; ++e) {
        double slope = o->stage_slopes[j * v->entries + e];
        count_t r = v->rows[e];
        if (r >= v->nx) right[(j * n + r) * m + c] -= slope;
        else
          for (i = 0; i < STAGES; ++i) right[(i * n + r) * m + c] += h * RADAU_A[i][j] * slope;
      }
}

/* Variations at the end of a step, into `o->after`, from the stages in `o->next`; those of all stages are in `o->right`. */
static int radau_forward(const struct variation* v, struct space* o, double t, double h) {
  count_t n = v->n, m = v->columns, i;
  if (!slopes_at(v, o, t, h, o->next) || !radau_matrix(v, o, h)) return 0;
  memset(o->right, 0, sizeof(double) * (size_t) (STAGES * n * m));
  for (i = 0; i < STAGES; ++i) memcpy(o->right + i * n * m, v->x, sizeof(double) * (size_t) (v->nx * m));
  radau_right(v, o, h, o->right, m);
  solved(o->matrix, STAGES * n, o->pivot, o->right, m);
  memcpy(o->after, o->right + (STAGES - 1) * n * m, sizeof(double) * (size_t) (v->nx * m));
  return are_finite(o->after, v->nx * m);
}

/* Rates of the variations at the start of a step into `o->rates`, with the algebraic ones that belong to them; uses
   `o->matrix` and `o->sums`. */
static int radau_start(const struct variation* v, struct space* o) {
  count_t n = v->n, nx = v->nx, nz = n - nx, m = v->columns, c, e, i;
  double* algebraic = o->sums;
  memset(o->rates, 0, sizeof(double) * (size_t) (n * m));
  for (c = 0; c < nx; ++c)
    for (e = v->starts[c]; e < v->starts[c + 1]; ++e) added(o->rates + v->rows[e] * m, o->slopes[e], v->x + c * m, m);
  by_parameters(v, o->slopes, o->rates);
  if (!nz) return 1;
  memset(o->matrix, 0, sizeof(double) * (size_t) (nz * nz));
  for (c = nx; c < n; ++c)
    for (e = v->starts[c]; e < v->starts[c + 1]; ++e)
      if (v->rows[e] >= nx) o->matrix[(v->rows[e] - nx) * nz + c - nx] = o->slopes[e];
  if (!are_finite(o->matrix, nz * nz) || !factorised(o->matrix, nz, o->pivot)) return 0;
  for (i = 0; i < nz * m; ++i) algebraic[i] = -o->rates[nx * m + i];
  solved(o->matrix, nz, o->pivot, algebraic, m);
  for (c = nx; c < n; ++c)
    for (e = v->starts[c]; e < v->starts[c + 1]; ++e)
      if (v->rows[e] < nx) added(o->rates + v->rows[e] * m, o->slopes[e], algebraic + (c - nx) * m, m);
  return 1;
}

/* What rounding of variations and slopes does in a step to each variation, (nx, m), into `to`, as in radau.py; their algebraic
   ones at its start are in `algebraic`. */
static void radau_rounding(const struct variation* v, const struct space* o, double h, const double* algebraic, double* to) {
  count_t nx = v->nx, m = v->columns, c, e, r, j;
  memset(to, 0, sizeof(double) * (size_t) (nx * m));
  for (r = 0; r < nx; ++r) o->residual[r] = RADAU_REAL / h;
  for (c = 0; c < v->n; ++c) {
    const double* x = c < nx ? v->x + c * m : algebraic + (c - nx) * m;
    for (e = v->starts[c]; e < v->starts[c + 1]; ++e) {
      double slope = fabs(o->slopes[e]);
      r = v->rows[e];
      if (r >= nx) continue;
      if (r == c) o->residual[r] += slope;
      for (j = 0; j < m; ++j) to[r * m + j] += slope * fabs(x[j]);
    }
  }
  for (r = 0; r < nx; ++r)
    for (j = 0; j < m; ++j) to[r * m + j] *= ROUNDED / o->residual[r];
}

/* The error of the variations over a step, of the worst column, in what is allowed; `radau_error` and `radau_forward`
   have been called. */
static double radau_variation_error(struct variation* v, struct space* o, double h) {
  count_t nx = v->nx, m = v->columns, all = v->n * m, j, r;
  double *five = o->sums, *three = o->sums + all, *rounding = o->sums + 2 * all, most = 0, whole = 0;
  if (!v->scale) return 0.0;
  if (!radau_start(v, o)) return INFINITY;
  radau_rounding(v, o, h, o->sums, rounding);
  embedded(v, o, h, RADAU_5, o->right, v->x, o->rates, five, m);
  embedded(v, o, h, RADAU_3, o->right, v->x, o->rates, three, m);
  if (!are_finite(o->sums, 2 * all)) return INFINITY;
  allowed(v, o, v->radau_tolerance);
  for (j = 0; j < v->parameters; ++j) {
    double a = 0, b = 0, all_of_it = 0, found;
    for (r = j; r < nx * m; r += m) {
      double size = o->sizes[r] + rounding[r];
      a += five[r] * five[r] / (size * size);
      b += three[r] * three[r] / (size * size);
      all_of_it = fmax(all_of_it, fabs(five[r]) / o->sizes[r]);
    }
    found = nx ? estimate(a, b, nx) : 0.0;
    if (!(found <= most)) most = found;
    whole = fmax(whole, all_of_it);
  }
  return nx ? judged(v, o, h, most, whole, five) : 0.0;
}

static int radau_backward(const struct variation* v, struct space* o, double t, double h, const double* stages) {
  count_t n = v->n, m = v->columns, np = v->parameters, i, c, k, last = STAGES - 1;
  double* by = o->sums;
  if (!slopes_at(v, o, t, h, stages) || !radau_matrix(v, o, h)) return 0;
  memset(o->right, 0, sizeof(double) * (size_t) (STAGES * n * m));
  memcpy(o->right + last * n * m, v->x, sizeof(double) * (size_t) (v->nx * m));
  solved_transposed(o->matrix, STAGES * n, o->pivot, o->right, m);
  memset(v->x, 0, sizeof(double) * (size_t) (v->nx * m));
  for (i = 0; i < STAGES; ++i) added(v->x, 1.0, o->right + i * n * m, v->nx * m);
  memset(by, 0, sizeof(double) * (size_t) (STAGES * n * np));
  radau_right(v, o, h, by, np);
  for (k = 0; k < STAGES * n; ++k)
    for (c = 0; c < np; ++c)
      if (by[k * np + c] != 0.0) added(v->total + c * m, by[k * np + c], o->right + k * m, m);
  return 1;
}

/* ---- explicit, of order 8 ---- */

/* Stages of a step into `o->next`, their rates into `o->values`; the last of both are those of its end. */
static int explicit_stages(const struct variation* v, struct space* o, double t, double h, const double* w, int to_end) {
  count_t n = v->n, i, j;
  for (i = 0; i < EXPLICIT + to_end; ++i) {
    double* at = o->next + i * n;
    memcpy(at, w, sizeof(double) * (size_t) n);
    for (j = 0; j < i; ++j) {
      double f = i < EXPLICIT ? EXPLICIT_A[i][j] : EXPLICIT_B[j];
      if (f != 0.0) added(at, h * f, o->values + j * n, n);
    }
    if (evaluated(value, v, o, t + h * (i < EXPLICIT ? EXPLICIT_C[i] : 1.0), at, o->values + i * n, 0)) return 0;
  }
  return are_finite(o->values, n * (EXPLICIT + to_end));
}

static double explicit_error(const struct variation* v, struct space* o, double h) {
  count_t n = v->n, k, i;
  double five = 0, three = 0;
  for (k = 0; k < n; ++k) {
    double size = v->tolerance * (1e-3 + fmax(fabs(v->w[k]), fabs(o->next[EXPLICIT * n + k]))), a = 0, b = 0;
    for (i = 0; i <= EXPLICIT; ++i) {
      a += EXPLICIT_5[i] * o->values[i * n + k];
      b += EXPLICIT_3[i] * o->values[i * n + k];
    }
    five += a * a / (size * size);
    three += b * b / (size * size);
  }
  return h * estimate(five, three, n);
}

/* Whether steps are held back by what is stiff, by the slope that the last two points of a step tell, again and again:
   beyond stability, or where what decays is as fast as the steps and yet not seen by their error. */
static int is_held_back(struct variation* v, const struct space* o, double h, double most) {
  count_t n = v->n, k;
  double rates = 0, points = 0, damped = 0;
  for (k = 0; k < n; ++k) {
    double a = o->values[EXPLICIT * n + k] - o->values[(EXPLICIT - 1) * n + k];
    double b = o->next[EXPLICIT * n + k] - o->next[(EXPLICIT - 1) * n + k];
    rates += a * a;
    points += b * b;
    damped -= a * b;
  }
  if (points > 0 && (h * sqrt(rates / points) > STABLE || h * damped > most * points)) {
    v->cleared = 0;
    return ++v->suspects >= SUSPECTS;
  }
  if (++v->cleared >= CLEARED) v->suspects = 0;
  return 0;
}

/* Slopes at the stages of a step, which are in `o->next`, and at its end. */
static int explicit_slopes(const struct variation* v, struct space* o, double t, double h, int to_end) {
  count_t i;
  for (i = 0; i < EXPLICIT + to_end; ++i)
    if (evaluated(slopes, v, o, t + h * (i < EXPLICIT ? EXPLICIT_C[i] : 1.0), o->next + i * v->n, o->value,
                  o->stage_slopes + i * v->entries))
      return 0;
  return are_finite(o->stage_slopes, (EXPLICIT + to_end) * v->entries);
}

/* Variations at the end of a step, into `o->after`; their rates at the stages and at the end are in `o->right`. */
static int explicit_forward(const struct variation* v, struct space* o, double t, double h) {
  count_t m = v->columns, all = v->n * m, i, j;
  if (!explicit_slopes(v, o, t, h, 1)) return 0;
  memset(o->right, 0, sizeof(double) * (size_t) ((EXPLICIT + 1) * all));
  for (i = 0; i <= EXPLICIT; ++i) {
    const double* own = o->stage_slopes + i * v->entries;
    double* to = o->right + i * all;
    memcpy(o->after, v->x, sizeof(double) * (size_t) all);
    for (j = 0; j < i; ++j) {
      double f = i < EXPLICIT ? EXPLICIT_A[i][j] : EXPLICIT_B[j];
      if (f != 0.0) added(o->after, h * f, o->right + j * all, all);
    }
    multiplied(v, own, o->after, to, m, 0);
    by_parameters(v, own, to);
  }
  return are_finite(o->right, (EXPLICIT + 1) * all);
}

/* As `radau_variation_error`; `explicit_forward` has been called. */
static double explicit_variation_error(struct variation* v, struct space* o, double h) {
  count_t n = v->n, m = v->columns, all = n * m, i, j, r;
  double most = 0;
  if (!v->scale) return 0.0;
  allowed(v, o, v->tolerance);
  for (j = 0; j < v->parameters; ++j) {
    double five = 0, three = 0;
    for (r = j; r < all; r += m) {
      double a = 0, b = 0;
      for (i = 0; i <= EXPLICIT; ++i) {
        a += EXPLICIT_5[i] * o->right[i * all + r];
        b += EXPLICIT_3[i] * o->right[i * all + r];
      }
      o->rates[r] = h * a;
      five += a * a / (o->sizes[r] * o->sizes[r]);
      three += b * b / (o->sizes[r] * o->sizes[r]);
    }
    most = fmax(most, h * estimate(five, three, n));
  }
  return judged(v, o, h, most, most, o->rates);
}

static int explicit_backward(const struct variation* v, struct space* o, double t, double h) {
  count_t n = v->n, m = v->columns, all = n * m, i, j, c, e;
  double* own = o->sums; /* what a rate of a stage is worth */
  if (!explicit_slopes(v, o, t, h, 0)) return 0;
  memset(o->right, 0, sizeof(double) * (size_t) (EXPLICIT * all));
  for (i = EXPLICIT - 1; i >= 0; --i) {
    const double* slope = o->stage_slopes + i * v->entries;
    memset(own, 0, sizeof(double) * (size_t) all);
    added(own, h * EXPLICIT_B[i], v->x, all);
    for (j = i + 1; j < EXPLICIT; ++j)
      if (EXPLICIT_A[j][i] != 0.0) added(own, h * EXPLICIT_A[j][i], o->right + j * all, all);
    multiplied(v, slope, own, o->right + i * all, m, 1);
    for (c = 0; c < v->parameters; ++c)
      for (e = v->starts[n + c]; e < v->starts[n + c + 1]; ++e) added(v->total + c * m, slope[e], own + v->rows[e] * m, m);
  }
  for (i = 0; i < EXPLICIT; ++i) added(v->x, 1.0, o->right + i * all, all);
  return 1;
}

/* ---- both ---- */

static void recorded(struct variation* v, double t, double h, const double* from, count_t length) {
  double* to = v->record + v->steps++ * (HEAD + STAGES * v->n);
  to[0] = t; to[1] = h; to[2] = (double) v->stiff;
  memcpy(to + HEAD, from, sizeof(double) * (size_t) length);
}

/* One step that is accepted, and the variations over it. */
static int step(struct variation* v, struct space* o) {
  count_t n = v->n, i;
  if (evaluated(slopes, v, o, v->t, v->w, o->value, o->slopes)) return LOST;
  if (!(v->h > 0)) {
    v->h = v->stiff ? first_step(v, o->value, v->radau_tolerance, STAGES + 1) : first_step(v, o->value, v->tolerance, 8);
    v->guessed = 0;
  }
  for (;;) {
    double whole = v->h, h = v->t + 1.01 * v->h >= v->end ? v->end - v->t : v->h, t = v->t, damped = DAMPED, error, grown;
    const double* end;
    int ends = h == v->end - v->t, good;
    if (!(t + h > t) || h < v->least) return LOST;
    if (v->stiff) {
      if (v->guessed) extended(v, h / v->before, o->next);
      else
        for (i = 0; i < STAGES; ++i) memcpy(o->next + i * n, v->w, sizeof(double) * (size_t) n);
      good = radau_stages(v, o, h);
      error = good ? radau_error(v, o, h) : INFINITY;
      end = o->next + (STAGES - 1) * n;
    } else {
      good = explicit_stages(v, o, t, h, v->w, 1);
      error = good ? explicit_error(v, o, h) : INFINITY;
      end = o->next + EXPLICIT * n;
    }
    if (!good || !isfinite(error)) { v->h = h / 4; v->guessed = 0; continue; }
    if (error <= 1 && v->columns) {
      double own = INFINITY;
      if (v->stiff ? radau_forward(v, o, t, h) : explicit_forward(v, o, t, h))
        own = v->stiff ? radau_variation_error(v, o, h) : explicit_variation_error(v, o, h);
      if (!isfinite(own)) { v->h = h / 4; v->guessed = 0; continue; }
      if (own > error) { error = own; damped = DAMPED_VARIATIONS; }
    }
    if (!v->stiff && is_held_back(v, o, h, damped)) {
      v->stiff = 1;
      v->h = 0;
      return v->n > v->largest ? STIFF : DONE;
    }
    grown = error > 0 ? 0.9 * pow(error, -1.0 / 8) : 8.0;
    if (error > 1) { v->h = h * (v->probed > 0 ? PROBE : fmax(0.2, fmin(grown, 0.9))); v->guessed = 0; continue; }
    if (v->capacity) recorded(v, t, h, v->stiff ? o->next : v->w, v->stiff ? STAGES * n : n);
    memcpy(v->stages, v->stiff ? o->next : end, sizeof(double) * (size_t) (v->stiff ? STAGES * n : n));
    memcpy(v->x, o->after, sizeof(double) * (size_t) (v->nx * v->columns));
    accept_missed(v, o);
    for (i = 0; i < v->nx * v->columns; ++i) v->peak[i] = fmax(v->peak[i], fabs(v->x[i]));
    memcpy(v->w, v->stages + (v->stiff ? (STAGES - 1) * n : 0), sizeof(double) * (size_t) n);
    v->t = ends ? v->end : t + h;
    v->before = h;
    v->guessed = v->stiff;
    v->h = fmax(h * fmin(fmax(grown, 0.3), 8.0), h < whole ? whole : 0.0);
    return DONE;
  }
}

static int onwards(struct variation* v, struct space* o) {
  while (v->t < v->end) {
    int status;
    if (v->capacity && v->steps == v->capacity) return FULL;
    status = step(v, o);
    if (status) return status;
  }
  return DONE;
}

static int backwards(struct variation* v, struct space* o) {
  while (v->steps > 0) {
    const double* from = v->record + --v->steps * (HEAD + STAGES * v->n);
    int good;
    if (from[2] > 0) good = radau_backward(v, o, from[0], from[1], from + HEAD);
    else good = explicit_stages(v, o, from[0], from[1], from + HEAD, 0) && explicit_backward(v, o, from[0], from[1]);
    if (!good) return LOST;
  }
  return DONE;
}

static int called(struct variation* v, int (*what)(struct variation*, struct space*)) {
  casadi_int a[4], b[4];
  count_t n = v->n, wide = STAGES * n, most = n <= v->largest ? wide : 0, dense = n <= v->largest ? n : 0, k;
  count_t columns = v->columns > v->parameters ? v->columns : v->parameters;
  struct space o = {0};
  double *memory, *next;
  int status = NO_MEMORY;
  value_work(a, a + 1, a + 2, a + 3);
  slopes_work(b, b + 1, b + 2, b + 3);
  for (k = 0; k < 4; ++k)
    if (b[k] > a[k]) a[k] = b[k];
  {
    count_t sizes[] = {a[3], n, v->entries, (EXPLICIT + 1) * n, most * most, dense * dense, (EXPLICIT + 1) * n * columns,
                       wide, (EXPLICIT + 1) * v->entries, (EXPLICIT + 1) * n, n, wide * columns, n * columns, n * columns,
                       n * columns, n * columns};
    double** parts[] = {&o.w, &o.value, &o.slopes, &o.next, &o.matrix, &o.small, &o.right,
                        &o.residual, &o.stage_slopes, &o.values, &o.rate, &o.sums, &o.after, &o.rates, &o.sizes, &o.missed};
    count_t total = 0;
    for (k = 0; k < (count_t) (sizeof(sizes) / sizeof(*sizes)); ++k) total += sizes[k] + 1;
    memory = malloc(sizeof(double) * (size_t) total);
    next = memory;
    for (k = 0; memory && k < (count_t) (sizeof(sizes) / sizeof(*sizes)); ++k) { *parts[k] = next; next += sizes[k] + 1; }
  }
  o.arg = malloc(sizeof(double*) * (size_t) (a[0] + 5));
  o.res = malloc(sizeof(double*) * (size_t) (a[1] + 3));
  o.iw = malloc(sizeof(casadi_int) * (size_t) (a[2] + 1));
  o.pivot = malloc(sizeof(count_t) * (size_t) (wide + n + 2));
  if (memory && o.arg && o.res && o.iw && o.pivot) {
    o.small_pivot = o.pivot + wide + 1;
    status = what(v, &o);
  }
  free(memory); free(o.arg); free(o.res); free(o.iw); free(o.pivot);
  return status;
}

/* On to `end`, with the variations in `x`, nx rows, and each step into the record where that has room for any. */
CASADI_SYMBOL_EXPORT int acausal_vary(struct variation* v) { return called(v, onwards); }

/* Back over the record: `x` are derivatives by the states, one column each; those by parameters are added to `total`. */
CASADI_SYMBOL_EXPORT int acausal_vary_back(struct variation* v) { return called(v, backwards); }
