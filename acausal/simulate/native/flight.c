/* Stretches and ordinary events of a run in one call.

   The meaning of an event is defined in Python (simulate/iteration.py, hybrid.py, rest.py); this does the same for what
   is ordinary: relations that flip, discrete equations, `when` clauses. Whatever is not (a relation that flips three
   times, rest, an end, a broken assertion, a crossing that the integrator has missed, anything not finite) is not
   decided here: the run is put back to the start of the stretch, or before the instant, and Python goes on from there.

   Linked with CasADi's code of `segment`, `watch`, `rates` and `reactions`. Where nothing but time makes events, PLAIN is
   defined: there is only a `segment`, without stop watch and stop flag behind its states. */

#include <stdlib.h>
#include <string.h>

enum { DONE = 0, FULL = 1, UNUSUAL = 2, INTERRUPTED = 100 };
enum { LOOKS = 16, AT_ONCE = 12, CHATTER = 3, MOST_ROUNDS = 400, SEQUENCE = 10, STANDING = 40, ENDLESS = 40 };
#define INSTANT 1e-12
#define LOCATED 1e-2

typedef long long count_t;

#ifdef PLAIN
#define WATCH 0
static int none(const double** arg, double** res, casadi_int* iw, double* w, int mem) {
  (void) arg; (void) res; (void) iw; (void) w; (void) mem;
  return 0;
}
static int none_work(casadi_int* arg, casadi_int* res, casadi_int* iw, casadi_int* w) {
  *arg = *res = *iw = *w = 0;
  return 0;
}
#define watch none
#define rates none
#define reactions none
#define watch_work none_work
#define rates_work none_work
#define reactions_work none_work
#else
#define WATCH 2
#endif

/* `Flight` of flight.py, field by field. */
struct flight {
  /* sizes */
  count_t states, dynamic, discretes, modes, timely, samples, memories, flags, relations, assigned, clauses, actions, asserts;
  count_t constants, boundaries;
  /* what does not change in a run */
  double span, relative, absolute, step;
  const count_t *assigned_at, *action_at, *action_of, *ends, *impossible;
  const double *scale, *nominal, *constant, *u, *p;
  const double *boundary, *timely_modes, *due, *times;
  const count_t *times_end;
  /* where it is; `entered` once the event at the start of its segment has been */
  count_t segment, entered, fresh;
  double here, first; /* `first` is the mean step of the stretch before, 0 at the start */
  double *x, *m;
  /* bounces (rest.py) */
  double last_time;
  count_t standing, count;
  double *last, *gap;
  count_t *crowd;
  /* the record */
  count_t rows, row_capacity, events, event_capacity, acts, act_capacity;
  double *row_time, *row_x, *row_m, *event_time;
  count_t *event_row, *acts_end, *act;
  unsigned char *fired;
  struct acausal_run run;
  count_t steps, rejected, rhs, jacobians;
};

typedef int (*function_t)(const double**, double**, casadi_int*, double*, int);

/* Memory of one call. */
struct space {
  const double** arg;
  double** res;
  casadi_int* iw;
  double* w;
  double *distance, *assigned, *values, *remembered, *asserts, *conditions; /* of reactions */
  double *g, *rate, *error, *noise, *doubt, *band, *ahead[3];
  double *before_x, *before_m, *left_m, *grid, *wide, *rows, *parameters, *x0;
  unsigned char *was, *fired, *asked;
  count_t* flips;
  casadi_int arguments, results;
};

static double most(double a, double b) { return a > b ? a : b; }

static int called(function_t f, const struct flight* s, struct space* o, double t, const double* x, const double* m,
                  int count, double** results) {
  int k;
  o->arg[0] = &t; o->arg[1] = x; o->arg[2] = 0; o->arg[3] = s->u; o->arg[4] = s->p; o->arg[5] = m;
  o->arg[6] = o->error; o->arg[7] = 0;
  for (k = 0; k < count; ++k) o->res[k] = results[k];
  return f(o->arg, o->res, o->iw, o->w, 0);
}

static int take_reactions(const struct flight* s, struct space* o, double t, const double* m) {
  double* results[6] = {o->distance, o->assigned, o->conditions, o->values, o->remembered, o->asserts};
  return called(reactions, s, o, t, s->x, m, 6, results);
}

static int take_guards(const struct flight* s, struct space* o, double t, const double* x, double* g) {
  count_t k;
  if (called(watch, s, o, t, x, s->m, 1, &g)) return UNUSUAL;
  for (k = 0; k < s->relations; ++k)
    if (!isfinite(g[k])) return UNUSUAL;
  return 0;
}

/* Rates of the guards along the solution, and by how much the guards can be wrong (guards.py). */
static int take_rates(const struct flight* s, struct space* o, double t) {
  double* results[5] = {o->rate, o->noise, 0, 0, 0};
  double instant = INSTANT * most(s->span, fabs(t));
  count_t k;
  for (k = 0; k < s->states; ++k)
    o->error[k] = 10 * (s->relative * fabs(s->x[k]) + s->absolute * s->nominal[k]);
  if (called(rates, s, o, t, s->x, s->m, 5, results)) return UNUSUAL;
  for (k = 0; k < s->relations; ++k) {
    o->noise[k] += 1e-15 + fabs(o->rate[k]) * instant;
    if (!isfinite(o->noise[k])) return UNUSUAL;
  }
  return 0;
}

static count_t first_memory(const struct flight* s) { return s->timely + s->samples; }
static count_t first_relation(const struct flight* s) { return s->modes - s->relations; }

static int up_to_date(const struct flight* s, const struct space* o) {
  count_t k;
  for (k = 0; k < s->memories; ++k)
    if (o->remembered[k] != s->m[first_memory(s) + k]) return 0;
  return 1;
}

/* Flip relations and apply discrete equations until all hold; what `reactions` says of it is left in `o`. */
static int decide(struct flight* s, struct space* o, double t, count_t* turn) {
  count_t round, k;
  for (round = 0; round < MOST_ROUNDS; ++round) {
    int moved = 0, wrong = 0, leaving, far = 1;
    if (take_reactions(s, o, t, s->m)) return UNUSUAL;
    for (k = 0; k < s->assigned; ++k) {
      double* held = s->x + s->assigned_at[k];
      if (o->assigned[k] != *held) { *held = o->assigned[k]; moved = 1; }
    }
    if (moved) continue;
    if (!s->relations) return 0;
    leaving = up_to_date(s, o);
    if (take_guards(s, o, t, s->x, o->g)) return UNUSUAL;
    for (k = 0; k < s->relations; ++k) far &= o->g[k] > 1.0;
    if (far) return 0;
    if (take_rates(s, o, t)) return UNUSUAL;
    for (k = 0; k < s->relations; ++k) {
      double noise = o->noise[k];
      o->doubt[k] = most(o->doubt[k], noise);
      if (o->flips[k] > 1) noise = o->doubt[k];
      if (o->g[k] < -2 * noise || (leaving && o->g[k] <= LOCATED * noise && o->rate[k] < -noise)) {
        double* mode = s->m + first_relation(s) + k;
        *mode = 1.0 - *mode;
        if (++o->flips[k] >= CHATTER) return UNUSUAL;
        wrong = 1;
      }
    }
    if (!wrong) return 0;
    if (++*turn >= AT_ONCE) return UNUSUAL;
  }
  return UNUSUAL;
}

/* Iterate from modes that have changed already to a fixed point; `before` are those that held. */
static int settle(struct flight* s, struct space* o, double t, const double* before, const double* due) {
  count_t k, a, round, turn = 0;
  int ticked = 0;
  if (take_reactions(s, o, t, before)) return UNUSUAL;
  for (k = 0; k < s->clauses; ++k) o->was[k] = o->conditions[k] > 0.5;
  for (k = 0; k < s->samples; ++k) s->m[s->timely + k] = due ? due[k] : 0.0;
  for (k = 0; k < s->flags; ++k) s->m[first_memory(s) + s->memories + k] = 0.0;
  for (k = 0; k < s->relations; ++k) { o->flips[k] = 0; o->doubt[k] = 0.0; }
  for (round = 0;; ++round) {
    int rising = 0, same;
    if (round == MOST_ROUNDS || decide(s, o, t, &turn)) return UNUSUAL;
    same = up_to_date(s, o);
    for (k = 0; k < s->clauses; ++k) rising |= o->conditions[k] > 0.5 && !o->was[k];
    if (!rising && same) break;
    for (k = 0; k < s->clauses; ++k) {
      if (!(o->conditions[k] > 0.5) || o->was[k]) continue;
      if (s->ends[k] || s->acts == s->act_capacity) return UNUSUAL;
      s->act[s->acts++] = k;
    }
    for (a = 0; a < s->actions; ++a) {
      count_t b;
      k = s->action_of[a];
      if (!(o->conditions[k] > 0.5) || o->was[k]) continue;
      for (b = 0; b < a; ++b) /* clauses that contradict each other */
        if (s->action_at[b] == s->action_at[a] && o->values[b] != o->values[a] && o->conditions[s->action_of[b]] > 0.5 &&
            !o->was[s->action_of[b]])
          return UNUSUAL;
      s->x[s->action_at[a]] = o->values[a];
    }
    for (k = 0; k < s->clauses; ++k) o->was[k] = o->conditions[k] > 0.5;
    for (k = 0; k < s->memories; ++k) s->m[first_memory(s) + k] = o->remembered[k];
  }
  for (k = 0; k < s->asserts; ++k)
    if (!(o->asserts[k] > 0.5)) return UNUSUAL;
  for (k = 0; k < s->samples; ++k) {
    ticked |= s->m[s->timely + k] != 0.0;
    s->m[s->timely + k] = 0.0;
  }
  if (ticked && s->memories) { /* samples are false again, also to what remembers them */
    if (take_reactions(s, o, t, s->m)) return UNUSUAL;
    for (k = 0; k < s->memories; ++k) s->m[first_memory(s) + k] = o->remembered[k];
  }
  for (k = 0; k < s->states; ++k)
    if (!isfinite(s->x[k])) return UNUSUAL;
  return 0;
}

static void record(struct flight* s, double t, const double* x) {
  s->row_time[s->rows] = t;
  memcpy(s->row_x + s->rows * s->states, x, s->states * sizeof(double));
  memcpy(s->row_m + s->rows * s->modes, s->m, s->modes * sizeof(double));
  ++s->rows;
}

/* The row after an event, and what made it. */
static void record_event(struct flight* s, double t, const unsigned char* fired) {
  s->event_time[s->events] = t;
  s->event_row[s->events] = s->rows;
  s->acts_end[s->events] = s->acts;
  if (fired) memcpy(s->fired + s->events * s->relations, fired, s->relations);
  else memset(s->fired + s->events * s->relations, 0, s->relations);
  ++s->events;
  record(s, t, s->x);
}

/* Which guards end the stretch at this event: all that are reached and falling; at least the nearest. */
static int find_fired(struct flight* s, struct space* o, double t) {
  count_t k, nearest = 0;
  int any = 0;
  double least = INFINITY, instant = INSTANT * most(s->span, fabs(t));
  if (take_guards(s, o, t, s->x, o->g) || take_rates(s, o, t)) return UNUSUAL;
  for (k = 0; k < s->relations; ++k) {
    double away = fabs(o->g[k]), speed = fabs(o->rate[k]);
    int near = away <= most(LOCATED * o->noise[k], speed * instant);
    o->fired[k] = o->g[k] < 0 || (near && o->rate[k] < 0);
    any |= o->fired[k];
    if (away / most(speed, 1e-30) < least) { least = away / most(speed, 1e-30); nearest = k; }
  }
  if (!any) o->fired[nearest] = 1;
  for (k = 0; k < s->relations; ++k) { /* low bounces come to rest */
    if (!o->fired[k] || s->crowd[k] < SEQUENCE || s->impossible[k]) continue;
    if (fabs(o->rate[k]) * (t - s->last[k]) / 4 <= o->noise[k]) return UNUSUAL;
  }
  return 0;
}

/* Count an event of relations (rest.py); UNUSUAL where events follow one another without end. */
static int count_bounce(struct flight* s, const struct space* o, double t, int changed) {
  count_t k;
  s->standing = t - s->last_time <= 1e-14 * most(s->span, fabs(t)) ? s->standing + 1 : 0;
  if (s->standing > STANDING) return UNUSUAL;
  for (k = 0; changed && k < s->relations; ++k)
    if (o->fired[k] && s->crowd[k] + 1 >= ENDLESS && t - s->last[k] <= 1e-9 * s->span) return UNUSUAL;
  ++s->count;
  s->last_time = t;
  for (k = 0; changed && k < s->relations; ++k) {
    double gap = t - s->last[k];
    if (!o->fired[k]) continue;
    s->crowd[k] = gap < s->gap[k] ? s->crowd[k] + 1 : 0;
    s->gap[k] = gap;
    s->last[k] = t;
  }
  return 0;
}

/* The event at the start of a segment. */
static int enter(struct flight* s, struct space* o) {
  double t = s->boundary[s->segment];
  memcpy(o->left_m, s->m, s->modes * sizeof(double));
  memcpy(s->m, s->timely_modes + s->segment * s->timely, s->timely * sizeof(double));
  if (settle(s, o, t, o->left_m, s->due + s->segment * s->samples)) return UNUSUAL;
  s->here = t;
  s->entered = s->fresh = 1;
  record_event(s, t, 0);
  return 0;
}

/* Whether a guard is passed at a row, or dips below zero and returns before it (looking.py). */
static int is_passed(const struct flight* s, const struct space* o, count_t row, count_t seen) {
  const double *a = o->ahead[0], *b = o->ahead[1], *c = o->ahead[2];
  double middle = row > 0 ? o->wide[row - 1] : s->here, first = row > 1 ? o->wide[row - 2] : s->here;
  double before = middle - first, after = o->wide[row] - middle;
  count_t k;
  for (k = 0; k < s->relations; ++k) {
    double rise, fall, curve, slope;
    if (c[k] < -o->band[k]) return 1;
    if (seen < 2) continue;
    rise = (b[k] - a[k]) / before;
    fall = (c[k] - b[k]) / after;
    curve = (fall - rise) / (before + after);
    slope = (rise * after + fall * before) / (before + after);
    if (curve > 0 && -slope > -2 * curve * before && -slope < 2 * curve * after
        && b[k] - slope * slope / (4 * curve) < -o->band[k]) return 1;
  }
  return 0;
}

/* Integrate to the next event or to the end of the segment; `stopped` is the row of the event, or the number of rows. */
static int integrate(struct flight* s, struct space* o, count_t wide, count_t* stopped, double* time, double* last) {
  count_t n = s->dynamic, size = n + WATCH, k, j;
  double* q = o->parameters;
  const double* end;
  int status;
  for (k = 0; k < n; ++k) o->x0[k] = s->x[k] / s->scale[k];
  for (k = 0; k < WATCH; ++k) o->x0[n + k] = 0.0;
  memcpy(q, s->constant, s->constants * sizeof(double)); q += s->constants;
  memcpy(q, s->m, s->modes * sizeof(double)); q += s->modes;
  memcpy(q, s->x + s->states - s->discretes, s->discretes * sizeof(double)); q += s->discretes;
  *q++ = s->here;
  memcpy(q, o->band, s->relations * sizeof(double));
  s->run.grid = o->grid; s->run.n = wide;
  s->run.reltol = s->relative; s->run.abstol = s->absolute; s->run.step = s->step;
  s->run.first = s->step > 0 ? 0.0 : s->first;
  /* arguments and results that are not asked for */
  memset(o->arg, 0, sizeof(double*) * (size_t) o->arguments);
  memset(o->res, 0, sizeof(double*) * (size_t) o->results);
  o->arg[0] = o->x0; o->arg[1] = o->x0; o->arg[2] = o->parameters; o->arg[3] = (const double*) &s->run;
  o->res[0] = o->rows;
  status = segment(o->arg, o->res, o->iw, o->w, 0);
  if (status) return status == INTERRUPTED ? INTERRUPTED : UNUSUAL;
  for (k = 0; k < wide * size; ++k)
    if (!isfinite(o->rows[k])) return UNUSUAL;
  end = o->rows + (wide - 1) * size;
  for (k = 0; k < wide && !(WATCH && o->rows[k * size + n + 1] > 0.5); ++k) {}
  *stopped = k;
  *time = k < wide ? s->here + end[n] : o->wide[wide - 1];
  if (k < wide && k) *time = most(*time, o->wide[k - 1]); /* an event on an output time, to rounding */
  for (j = 0; j < n; ++j) last[j] = end[j] * s->scale[j];
  memcpy(last + n, s->x + n, (s->states - n) * sizeof(double));
  return 0;
}

/* Whether a flight begins that may be lower than the noise; rest.py decides. `before` are the rates at the impact. */
static int may_land(const struct flight* s, struct space* o, double t, const double* before) {
  count_t k;
  if (take_rates(s, o, t)) return 1;
  for (k = 0; k < s->relations; ++k) {
    double gap = isfinite(s->last[k]) ? t - s->last[k] : t - s->boundary[0];
    if (!o->fired[k] || s->impossible[k]) continue;
    if (o->rate[k] * o->rate[k] * gap / (4 * most(fabs(before[k]), 1e-300)) <= 100 * o->noise[k]) return 1;
  }
  return 0;
}

/* A stretch, and the event that ends it. */
static int stretch(struct flight* s, struct space* o, double* x) {
  double end = s->boundary[s->segment + 1], far = 1e-13 * most(s->span, fabs(s->here));
  count_t from = s->segment ? s->times_end[s->segment - 1] : 0, until = s->times_end[s->segment];
  count_t looks = s->relations ? LOOKS : 1, look = 1; /* the end is always one */
  count_t wide = 0, k, j, stopped, seen = 0;
  double time;
  int changed = 0;
  if (!s->fresh)
    while (from < until && !(s->times[from] > s->here + far)) ++from;
  if (from == until) { /* the event was at the end of the segment */
    ++s->segment;
    s->entered = 0;
    return 0;
  }
  if (s->rows + (until - from) + 3 > s->row_capacity || s->events + 1 >= s->event_capacity) return FULL;
  if (take_guards(s, o, s->here, s->x, o->g) || take_rates(s, o, s->here)) return UNUSUAL;
  for (k = 0; k < s->relations; ++k) {
    int resting = o->g[k] <= LOCATED * o->noise[k] && o->rate[k] <= o->noise[k];
    o->band[k] = resting ? 2 * o->noise[k] : fabs(o->g[k]) <= o->noise[k] ? most(-2 * o->g[k], 0.0) : 0.0;
    o->ahead[2][k] = most(o->g[k], 0.0);
  }
  for (k = from; k < until || look <= looks;) { /* outputs and looks, merged */
    double at = look < looks ? s->here + (end - s->here) * look / looks : end;
    if (look <= looks && (k == until || at <= s->times[k])) {
      o->asked[wide] = k < until && at == s->times[k];
      k += o->asked[wide];
      ++look;
    } else {
      at = s->times[k++];
      o->asked[wide] = 1;
    }
    o->wide[wide] = at;
    o->grid[wide++] = at - s->here;
  }
  j = integrate(s, o, wide, &stopped, &time, x);
  if (j) return (int) j;
  s->steps += s->run.steps; s->rejected += s->run.rejected; s->rhs += s->run.rhs; s->jacobians += s->run.jac;
  for (k = 0; k < stopped; ++k) {
    double* oldest = o->ahead[0];
    for (j = 0; j < s->dynamic; ++j) o->rows[k * (s->dynamic + WATCH) + j] *= s->scale[j];
    memcpy(o->x0, o->rows + k * (s->dynamic + WATCH), s->dynamic * sizeof(double));
    memcpy(o->x0 + s->dynamic, s->x + s->dynamic, (s->states - s->dynamic) * sizeof(double));
    /* a row at the event itself may be past it, by rounding */
    if (stopped == wide || o->wide[k] < time - 1e-12 * most(s->span, fabs(time))) {
      o->ahead[0] = o->ahead[1]; o->ahead[1] = o->ahead[2]; o->ahead[2] = oldest;
      if (take_guards(s, o, o->wide[k], o->x0, oldest) || is_passed(s, o, k, ++seen)) return UNUSUAL;
    }
    if (o->asked[k]) record(s, o->wide[k], o->x0);
  }
  if (s->run.steps > 0 && time > s->here) s->first = (time - s->here) / s->run.steps;
  s->here = time;
  s->fresh = 0;
  memcpy(s->x, x, s->states * sizeof(double));
  if (stopped == wide) {
    ++s->segment;
    s->entered = 0;
    return 0;
  }
  record(s, time, s->x);
  if (find_fired(s, o, time)) return UNUSUAL;
  memcpy(o->left_m, s->m, s->modes * sizeof(double));
  memcpy(o->ahead[0], o->rate, s->relations * sizeof(double));
  for (k = 0; k < s->relations; ++k)
    if (o->fired[k]) s->m[first_relation(s) + k] = 1.0 - s->m[first_relation(s) + k];
  if (settle(s, o, time, o->left_m, 0)) return UNUSUAL;
  for (k = 0; k < s->states; ++k) changed |= s->x[k] != x[k];
  if (changed && may_land(s, o, time, o->ahead[0])) return UNUSUAL;
  if (count_bounce(s, o, time, changed)) return UNUSUAL;
  record_event(s, time, o->fired);
  return 0;
}

static count_t longest(const struct flight* s) {
  count_t k, found = 0;
  for (k = 0; k < s->boundaries - 1; ++k) {
    count_t own = s->times_end[k] - (k ? s->times_end[k - 1] : 0);
    if (own > found) found = own;
  }
  return found + LOOKS + 1;
}

static casadi_int larger(casadi_int a, casadi_int b) { return a > b ? a : b; }

/* Cut up the doubles of a call, where there are any yet; returns their number. */
static size_t carved(const struct flight* s, struct space* o, double* memory, count_t wide) {
  count_t r = s->relations, n = s->states, all = s->constants + s->modes + n + 1 + r;
  count_t sizes[] = {r, s->assigned, s->actions, s->memories, s->asserts, s->clauses, r, r, n, r, r, r, r, r, r,
                     n, s->modes, s->modes, wide, wide, wide * (s->dynamic + 2), all, n + 2};
  double** parts[] = {&o->distance, &o->assigned, &o->values, &o->remembered, &o->asserts, &o->conditions, &o->g,
                      &o->rate, &o->error, &o->noise, &o->doubt, &o->band, &o->ahead[0], &o->ahead[1], &o->ahead[2],
                      &o->before_x, &o->before_m, &o->left_m, &o->grid, &o->wide, &o->rows, &o->parameters, &o->x0};
  size_t k, used = 0;
  for (k = 0; k < sizeof(sizes) / sizeof(*sizes); ++k) {
    if (memory) *parts[k] = memory + used;
    used += (size_t) sizes[k] + 1;
  }
  return used;
}

/* Go on until the end of the run, until the record is full, or until something unusual is ahead. */
CASADI_SYMBOL_EXPORT int acausal_flight(struct flight* s) {
  casadi_int sizes[4] = {0, 0, 0, 0}, own[4];
  int (*works[])(casadi_int*, casadi_int*, casadi_int*, casadi_int*) = {segment_work, watch_work, rates_work, reactions_work};
  struct space o;
  count_t wide = longest(s), k;
  double *memory, *x;
  size_t used;
  unsigned char* bytes;
  int status = DONE;
  for (k = 0; k < 4; ++k) {
    int j;
    works[k](own, own + 1, own + 2, own + 3);
    for (j = 0; j < 4; ++j) sizes[j] = larger(sizes[j], own[j]);
  }
  memset(&o, 0, sizeof(o));
  used = carved(s, &o, 0, wide);
  memory = malloc(sizeof(double) * (used + (size_t) (s->states + 1 + sizes[3])));
  bytes = malloc((size_t) (s->clauses + s->relations + wide + 1));
  o.arguments = sizes[0] + 8;
  o.results = sizes[1] + 6;
  o.arg = malloc(sizeof(double*) * (size_t) o.arguments);
  o.res = malloc(sizeof(double*) * (size_t) o.results);
  o.iw = malloc(sizeof(casadi_int) * (size_t) (sizes[2] + 1));
  o.flips = malloc(sizeof(count_t) * (size_t) (s->relations + 1));
  if (memory && bytes && o.arg && o.res && o.iw && o.flips) {
    carved(s, &o, memory, wide);
    x = memory + used;
    o.w = x + s->states + 1;
    o.was = bytes; o.fired = bytes + s->clauses; o.asked = o.fired + s->relations;
    while (!status && s->segment < s->boundaries - 1) {
      struct flight kept = *s;
      memcpy(o.before_x, s->x, s->states * sizeof(double));
      memcpy(o.before_m, s->m, s->modes * sizeof(double));
      if (!s->entered && (s->rows + 1 > s->row_capacity || s->events + 1 > s->event_capacity)) status = FULL;
      else status = s->entered ? stretch(s, &o, x) : enter(s, &o);
      if (status) { /* as if it had not been tried; `last`, `gap`, `crowd` change only when nothing is left to fail */
        *s = kept;
        memcpy(s->x, o.before_x, s->states * sizeof(double));
        memcpy(s->m, o.before_m, s->modes * sizeof(double));
      }
    }
  } else status = UNUSUAL;
  free(memory); free(bytes); free(o.arg); free(o.res); free(o.iw); free(o.flips);
  return status;
}
