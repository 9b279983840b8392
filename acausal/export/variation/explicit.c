/* Explicit steps of order 8 (explicit.py). */

/* Compute the stages of a step into `o->next`, their rates into `o->values`; the last of both belong to its end. */
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

/* Whether stability has limited the last steps, from the slope between the last two points of a step: it is beyond the
   stability limit, or a component decays within the step although the error estimate allows it (explicit.py). */
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

/* Variations at the end of a step, into `o->after`; their rates at the stages and at the end, into `o->right`. */
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
  double* own = o->sums; /* derivatives by the rate of a stage */
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
