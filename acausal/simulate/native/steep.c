/* Candidates: instants inside of a step at which a steep function may rise and fall unnoticed.

   The rule is that of driver/missed/missed_events.py. A change of a steep function between two samples shows in the samples, except
   where its argument has an extremum, and where a step function, or a term in which an argument is even, is at its midpoint.
   There the step has to satisfy the equations. Here the solution between samples is the polynomial of the step, and its rates
   are known: an argument has an extremum where its slope changes sign. */

enum { SAMPLES_OF_STEP = 2, STEEP_TURNS = 30, STEEP_CANDIDATES = 3 };
/* As in missed_events.py: an instant is located if the value there is at most ZERO times the values at both ends; a function is
   unchanged if its values agree to the fraction UNCHANGED, or to NOTHING; a candidate closer to an end of the step than the
   fraction NEAR of it is ignored. */
#define STEEP_ZERO 1e-12
#define STEEP_UNCHANGED 1e-3
#define STEEP_NOTHING 1e-14
/* A function is constant if, by its rates, it changes over an interval by less than this fraction of UNCHANGED. */
#define STEEP_CONSTANT 0.25
#define STEEP_NEAR 1e-6

struct acausal_samples {
  int ready;              /* whether the samples at this step are taken */
  casadi_int sample, column; /* position of the search: extrema of all columns, then their zeros */
  casadi_int count;       /* candidates found there and not yet used */
  casadi_real candidates[STEEP_CANDIDATES];
  casadi_real end;        /* of the step whose last sample is stored */
};

/* Time derivatives of the polynomial of a step. */
static void acausal_rate(struct casadi_ivp_data* d, casadi_real t, casadi_real* rate) {
  const struct casadi_ivp_prob* p = d->prob;
  casadi_real theta = (t - d->t0) / d->h, scale = 1. / d->h;
  casadi_int k;
  casadi_clear(d->w_dense, p->n_stages);
  for (k = 0; k < p->n_dense; ++k) {
    casadi_axpy(p->n_stages, (k + 1) * scale, p->m_dense + k * p->n_stages, d->w_dense);
    scale *= theta;
  }
  casadi_clear(rate, p->ny);
  casadi_mv_dense(d->U, p->ny, p->n_stages, d->w_dense, rate, 0);
}

/* Sample columns, their slopes, heights and relative rates at a time of the step; `y` and `f` are memory for states, rates. */
static int acausal_sample_at(struct casadi_ivp_data* d, struct acausal_run* run, casadi_real t, casadi_real* y, casadi_real* f,
                           casadi_real* found) {
  casadi_int k;
  casadi_ivp_interpolate(d, t, y);
  acausal_rate(d, t, f);
  if (run->sample(run->sampler, t, y, f, found)) return 1;
  for (k = 0; k < 2 * run->columns; ++k)
    if (!casadi_ivp_isfinite(found[k])) return 1;
  return 0;
}

static casadi_int acausal_sample_size(const struct acausal_run* run) { return 2 * run->columns + 3 * run->functions; }

/* The values of a sample of the step; the one after the last is that of a candidate. */
static casadi_real* acausal_sample_of(const struct acausal_run* run, casadi_int sample) {
  return run->sampled + sample * acausal_sample_size(run);
}

static casadi_real acausal_sample_time(const struct casadi_ivp_data* d, casadi_int sample) {
  return sample == SAMPLES_OF_STEP ? d->t : d->t0 + sample * (d->t - d->t0) / SAMPLES_OF_STEP;
}

/* Take the samples of a step; 1 if that fails. */
static int acausal_samples(struct casadi_ivp_data* d, struct acausal_samples* l, struct acausal_run* run, casadi_real* y,
                         casadi_real* f) {
  casadi_int k = 0;
  if (l->end == d->t0) { /* the last sample of the step before */
    casadi_copy(acausal_sample_of(run, SAMPLES_OF_STEP), acausal_sample_size(run), acausal_sample_of(run, 0));
    k = 1;
  }
  l->sample = l->column = l->count = 0;
  l->end = NAN;
  for (; k <= SAMPLES_OF_STEP; ++k)
    if (acausal_sample_at(d, run, acausal_sample_time(d, k), y, f, acausal_sample_of(run, k))) return 1;
  l->end = d->t;
  return 0;
}

/* Whether the function of a column at the candidate sampled last differs from the samples before and after it. */
static int acausal_changes(const struct acausal_run* run, casadi_int sample, casadi_int column) {
  casadi_int first = 2 * run->columns + 2 * run->owners[column], k, side;
  const casadi_real* there = acausal_sample_of(run, SAMPLES_OF_STEP + 1) + first;
  for (side = 0; side < 2; ++side) {
    const casadi_real* around = acausal_sample_of(run, sample + side) + first;
    for (k = 0; k < 2; ++k)
      if (!(fabs(around[k] - there[k]) <= STEEP_UNCHANGED * fabs(there[k]) + STEEP_NOTHING)) return 1;
  }
  return 0;
}

/* Whether the function of a column is constant within `width` of the candidate sampled last, by its rates there and at the
   samples around it. Slopes at rest change their sign all the time due to rounding: in BreakthroughSurge, 63 000 of 70 000
   samples were taken for such zeros, of which 14 of 3800 were kept. */
static int acausal_is_constant(const struct acausal_run* run, casadi_int sample, casadi_int column, casadi_real width) {
  casadi_int rate = 2 * (run->columns + run->functions) + run->owners[column], k;
  for (k = 0; k < 3; ++k)
    if (!(acausal_sample_of(run, k == 2 ? SAMPLES_OF_STEP + 1 : sample + k)[rate] * width <= STEEP_CONSTANT * STEEP_UNCHANGED)) return 0;
  return !acausal_changes(run, sample, column);
}

/* The time at which entry `at` of a sample is zero, between two times with values `ga` and `gb` of opposite signs; an
   arbitrary time between them if the function of its column is constant. */
static casadi_real acausal_zero(struct casadi_ivp_data* d, struct acausal_run* run, casadi_int sample, casadi_int at,
                                casadi_real a, casadi_real ga, casadi_real b, casadi_real gb, casadi_real* y, casadi_real* f) {
  casadi_real small = STEEP_ZERO * fmax(fabs(ga), fabs(gb)), t = a, g, *found = acausal_sample_of(run, SAMPLES_OF_STEP + 1);
  int turn, before = 2;
  for (turn = 0; turn < STEEP_TURNS; ++turn) {
    int same;
    t = ga == gb ? a : a + (b - a) * ga / (ga - gb);
    if (acausal_sample_at(d, run, t, y, f, found)) return NAN;
    g = found[at];
    if (fabs(g) <= small || b - a <= STEEP_ZERO * fabs(d->h)) break;
    if (acausal_is_constant(run, sample, at % run->columns, b - a)) break;
    same = (g < 0) == (ga < 0);
    if (same) { a = t; ga = g; if (before == 1) gb *= 0.5; } /* an end that stays a second time counts half (Illinois) */
    else { b = t; gb = g; if (before == 0) ga *= 0.5; }
    before = same;
  }
  return t;
}

/* Keep a zero as a candidate if the function of the column changes there; 1 if the zero is unknown. */
static int acausal_keep_candidate(struct casadi_ivp_data* d, struct acausal_samples* l, struct acausal_run* run, casadi_int column,
                        casadi_real t) {
  casadi_real near = STEEP_NEAR * (d->t - d->t0);
  if (!casadi_ivp_isfinite(t)) return 1;
  if (t - d->t0 > near && d->t - t > near && acausal_changes(run, l->sample, column)) l->candidates[l->count++] = t;
  return 0;
}

/* Search the next column between two samples; 1 if that fails. */
static int acausal_search(struct casadi_ivp_data* d, struct acausal_samples* l, struct acausal_run* run, casadi_real* y,
                          casadi_real* f) {
  casadi_int n = run->columns, j = l->column++, column = j < n ? j : j - n, at = j < n ? n + j : column;
  const casadi_real *left = acausal_sample_of(run, l->sample), *right = acausal_sample_of(run, l->sample + 1);
  casadi_real a, b, t, top;
  if ((left[at] < 0) == (right[at] < 0) || (j >= n && column < run->functions && run->owners[column] == column)) return 0;
  a = acausal_sample_time(d, l->sample); b = acausal_sample_time(d, l->sample + 1);
  t = acausal_zero(d, run, l->sample, at, a, left[at], b, right[at], y, f);
  if (acausal_keep_candidate(d, l, run, column, t)) return 1;
  top = acausal_sample_of(run, SAMPLES_OF_STEP + 1)[column];
  if (j >= n || column < run->functions || !(top * left[column] < 0 && top * right[column] < 0)) return 0;
  /* if its extremum is beyond zero, the column has zeros on both sides of it */
  if (acausal_keep_candidate(d, l, run, column, acausal_zero(d, run, l->sample, column, a, left[column], t, top, y, f))) return 1;
  return acausal_keep_candidate(d, l, run, column, acausal_zero(d, run, l->sample, column, t, top, b, right[column], y, f));
}

/* The next candidate in a step, INFINITY if there are no more, NAN if that cannot be determined. */
static casadi_real acausal_next_candidate(struct casadi_ivp_data* d, struct acausal_samples* l, struct acausal_run* run, casadi_real* y,
                                 casadi_real* f) {
  if (!l->ready) {
    if (acausal_samples(d, l, run, y, f)) return NAN;
    l->ready = 1;
  }
  while (!l->count) {
    if (l->column == 2 * run->columns) { l->column = 0; ++l->sample; }
    if (l->sample == SAMPLES_OF_STEP) return INFINITY;
    if (acausal_search(d, l, run, y, f)) return NAN;
  }
  return l->candidates[--l->count];
}
