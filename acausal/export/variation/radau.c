/* Steps of Radau IIA with STAGES stages (radau.py). */

/* The Jacobian of the stage equation, from the slopes at each stage, factorised. */
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

/* Simplified Newton method for the stages in `o->next`, with the Jacobian at its starting point. */
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
    /* the sum of the further moves, a geometric series */
    if (size <= 1e-13 || (k && size * share / (1 - share) <= 1e-4 * v->radau_tolerance)) return 1;
    last = size;
  }
  return 0;
}

/* An embedded error of m columns into `to`, from `stages`, their start and the rate there. */
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

/* The error of the step by the embedded methods, in tolerances; the slopes at its start are in `o->slopes`. */
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

/* Add the contribution of parameters to the right-hand sides of the equations for the variations of the stages. */
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

/* Rates of the variations at the start of a step into `o->rates`, with the variations of algebraic variables eliminated;
   these are left in `o->sums`. Overwrites `o->matrix`. */
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

/* Rounding error of a step in each variation, (nx, m), into `to`, as in radau.py; `algebraic` are the variations of the
   algebraic variables at its start. */
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

/* The error of the variations over a step, for the worst column, in units of the allowed error; call `radau_error` and
   `radau_forward` first. */
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
