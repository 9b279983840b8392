/* The linear map over a stretch of a run, as in the Python files of this folder: explicit steps of order 8 until they turn
   out to be stiff, then Radau IIA with STAGES stages.

   Compiled together with CasADi's code of `value` and `slopes`, the coefficients (tables.py), shared.c, radau.c and
   explicit.c, which precede this file. `constant` has the inputs and parameters. */

static void recorded(struct variation* v, double t, double h, const double* from, count_t length) {
  double* to = v->record + v->steps++ * (HEAD + STAGES * v->n);
  to[0] = t; to[1] = h; to[2] = (double) v->stiff;
  memcpy(to + HEAD, from, sizeof(double) * (size_t) length);
}

/* Make one accepted step, with the variations over it. */
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
    v->h = v->probed > 0 ? h * PROBE : fmax(h * fmin(fmax(grown, 0.3), 8.0), h < whole ? whole : 0.0);
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

/* Step to `end`, with the variations in `x`, nx rows; each step is recorded if `capacity` is not zero. */
CASADI_SYMBOL_EXPORT int acausal_vary(struct variation* v) { return called(v, onwards); }

/* Go back over the record: `x` are derivatives by the states, one column each; those by parameters are added to `total`. */
CASADI_SYMBOL_EXPORT int acausal_vary_back(struct variation* v) { return called(v, backwards); }
