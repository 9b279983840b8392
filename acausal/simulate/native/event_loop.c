/* Events of a run in compiled code; stretches.c integrates over stretches and ordinary events in one call.

   The generated function `event_round` (acausal/lower/events/round.py) evaluates the equations of an event. Around it,
   this code does the same as simulate/driver/hybrid.py, events/iteration.py and rest.py for ordinary events. It decides
   no others: a relation that flips three times, a guard that stays near zero, rest, the end of a run, a violated
   assertion, a crossing that the integrator has missed, anything that is not finite. There the run is reset to before
   the event, or to the start of the failed stretch, and Python continues.

   Linked with CasADi's code of `segment`, `judged` and `event_round`. If only time causes events, PLAIN is defined, and
   there is only a `segment`. */

#include <stdlib.h>
#include <string.h>

enum { DONE = 0, FULL = 1, UNUSUAL = 2, ARRIVED = 3, INTERRUPTED = 100 };
enum { MESH_POINTS = 64, FEWEST_POINTS = 2, AT_ONCE = 12, CHATTER = 3, TWICE = 2, MOST_ROUNDS = 400, ENDLESS = 40, NEARLY = 16 };
enum { ROW = 1, MESH = 2 }; /* purposes of an instant */
enum { DEEPEST = 60, MOST_POINTS = 400, SHARP_POINTS = 8, SHIFTS = 8 };
#define INSTANT 1e-12 /* instants closer than this fraction of the run, or of the time, coincide: guards.py */
#define FEW_INSTANTS 2.0 /* an interval this short is not divided where a guard jumps in it */
#define ROUNDINGS 2e-14
#define LOCATED 1e-6 /* guards are located to this fraction of their noise, or to their rounding errors */
#define EPSILON 2.2e-16 /* a rounding error */
#define MARGIN 4        /* by how much more two guards may differ: rounding errors are estimated from a few points */
#define SHIFT 1e-4     /* states are moved by a few multiples of this fraction of their errors */
#define BEHIND 1.001
#define ROUNDED 1e-15 /* noise of guards that depend on no error */
#define GOLDEN 0.618
#define STEADY 0.1 /* the least noise beside a point, in that of the point, where a guard counts as resting */
#define LATE 100
#define NEVER 1e300
#define LARGEST_STEP 0.785 /* the largest change of a phase within a step [rad]: phases.py */

typedef long long count_t;

#ifdef PLAIN
#define HELD 0
static int none(const double** arg, double** res, casadi_int* iw, double* w, int mem) {
  (void) arg; (void) res; (void) iw; (void) w; (void) mem;
  return 0;
}
static int none_work(casadi_int* arg, casadi_int* res, casadi_int* iw, casadi_int* w) {
  *arg = *res = *iw = *w = 0;
  return 0;
}
#define judged none
#define determined none
#define event_round none
#define relaxed none
#define relaxed_work none_work
#define judged_work none_work
#define determined_work none_work
#define event_round_work none_work
#endif

/* `EventLoopStructure` of event_loop.py, field by field. */
struct event_loop {
  /* sizes */
  count_t states, dynamic, discretes, modes, timely, samples, memories, flags, relations, assigned, conditions, clauses, actions, asserts;
  count_t constants, boundaries;
  /* constant in a run */
  double span, relative, absolute, step;
  const count_t *assigned_at, *ends, *ties, *timed, *impossible;
  const double *scale, *nominal, *constant, *u, *p;
  const double *boundary, *timely_modes, *due, *times;
  const count_t *times_end;
  /* the state of the run: `entered` after the event at the start of the segment, `arrived` at an event left to Python */
  count_t segment, entered, fresh, arrived;
  double here, first; /* time, and mean step of the previous stretch, 0 at the start */
  double *x, *m;
  /* bounces (rest.py) */
  count_t count;
  double *last;
  count_t *crowd;
  /* the record */
  count_t rows, row_capacity, events, event_capacity, acts, act_capacity;
  double *row_time, *row_x, *row_m, *event_time;
  count_t *event_row, *acts_end, *act;
  unsigned char *fired;
  struct acausal_run run;
  count_t steps, rejected, rhs, jacobians;
  count_t begun; /* steps before this stretch */
  /* actions that were taken, for derivatives of the run; nothing is stored if the capacity is 0 */
  count_t jumps, jump_capacity;
  double *jump_x, *jump_m, *jump_applied;
  count_t *jump_advances, *jumps_end;
  /* times and states at the samples and rows of each stretch, for a search of missed events; nothing is stored if the
     capacity is 0. For each stretch: the end of its trail, its steps, and the number of events before it */
  count_t trail, trail_capacity, stretches;
  double *trail_time, *trail_x;
  count_t *trail_end, *stretch_steps, *stretch_events;
  /* steep functions of the rates, if any are to be sampled: the number of columns and of functions, and the function to
     which each column belongs. For each stretch, the number of places that may have been stepped over */
  count_t columns, functions;
  const count_t* owners;
  count_t* stretch_doubts;
};

typedef int (*function_t)(const double**, double**, casadi_int*, double*, int);

/* Memory of one call. */
struct space {
  const double** arg;
  double** res;
  casadi_int* iw;
  double* w;
  double *assigned, *next_x, *next_m, *next_was, *next_decided, *acting, *applied, *conditions, *remembered, *asserts; /* of rounds */
  double *was, *decided;
  double next_level, settled, clash, level;
  double *g, *rate, *error, *noise, *largest_noise, *band, *later_band, *no_band, *approach, *beside, *beside_rate, *beside_noise;
  double *beside_x, *before_x, *before_m, *left_m, *instants, *lengths, *row, *ahead, *parameters, *x0, *nodes;
  struct node node[DEEPEST + 2];
  double first, past; /* state of the step size control */
  double limit;       /* the next row or mesh point, before which an event is sought */
  double step;        /* over which errors of stiff components have relaxed, 0 if unknown */
  double *known_x, *known_m, *known_g, *known_rate, *known_noise; /* point at which guards were evaluated last, and values */
  double *relaxed_noise; /* noises for a step */
  double *mean_rate;     /* of guards in the last step: crossings.c */
  double *located;       /* how close to zero guards can be located */
  double *later;         /* how far apart guards must be to be passed one after the other */
  double known_t, known_step;
  double turning; /* the largest rate of a phase where guards were evaluated last [rad/s] */
  int known; /* 0 nothing, 1 guards, rates and noises, 2 also noises for a step */
  double *regime, *held; /* constants, modes and discrete variables, and the values that they alone determine */
  int is_held;
  double* last; /* scaled states from which the integrator took its last step before it was stopped */
  unsigned char *fired, *leaves, *resting, *away, *reached, *purpose;
  count_t* flips;
  casadi_int arguments, results;
};

static double as_one(const struct event_loop* s, double t) { return most(INSTANT * s->span, ROUNDINGS * fabs(t)); }


#ifdef STEEP
/* Evaluates the samples of steep.c from scaled states and rates. */
struct sampler {
  const struct event_loop* s;
  const double** arg;
  double** res;
  casadi_int* iw;
  double *w, *x, *v;
  double start;
};

static int sample(void* sampler, double t, const double* y, const double* rate, double* found) {
  struct sampler* l = sampler;
  const struct event_loop* s = l->s;
  double at = l->start + t;
  count_t k;
  for (k = 0; k < s->dynamic; ++k) {
    l->x[k] = y[k] * s->scale[k];
    l->v[k] = rate[k] * s->scale[k];
  }
  memcpy(l->x + s->dynamic, s->x + s->dynamic, (size_t) (s->states - s->dynamic) * sizeof(double));
  l->arg[0] = &at; l->arg[1] = l->x; l->arg[2] = 0; l->arg[3] = s->u; l->arg[4] = s->p; l->arg[5] = s->m; l->arg[6] = l->v;
  l->res[0] = found; l->res[1] = found + s->columns; l->res[2] = found + 2 * s->columns;
  l->res[3] = found + 2 * (s->columns + s->functions);
  return steep(l->arg, l->res, l->iw, l->w, 0);
}

/* Allocate memory for samples; 1 if that fails. */
static int sampler_of(struct event_loop* s, struct sampler* l) {
  casadi_int sizes[4];
  size_t each = (size_t) (2 * s->columns + 3 * s->functions);
  steep_work(sizes, sizes + 1, sizes + 2, sizes + 3);
  memset(l, 0, sizeof(*l));
  l->s = s;
  l->arg = malloc(sizeof(double*) * (size_t) (sizes[0] + 7));
  l->res = malloc(sizeof(double*) * (size_t) (sizes[1] + 4));
  l->iw = malloc(sizeof(casadi_int) * (size_t) (sizes[2] + 1));
  l->w = malloc(sizeof(double) * ((size_t) sizes[3] + 2 * (size_t) s->states + (SAMPLES_OF_STEP + 2) * each + 1));
  if (!l->arg || !l->res || !l->iw || !l->w) return 1;
  l->x = l->w + sizes[3] + 1;
  l->v = l->x + s->states;
  s->run.sample = sample;
  s->run.sampler = l;
  s->run.sampled = l->v + s->states;
  s->run.owners = s->owners; s->run.columns = s->columns; s->run.functions = s->functions;
  return 0;
}
#endif

/* One call of the round at modes `m`, from the state after the last one. */
static int take_round(const struct event_loop* s, struct space* o, double t, const double* m) {
  double* results[13] = {o->assigned, o->next_x, o->next_m, o->next_was, o->next_decided, &o->next_level, &o->settled,
                         &o->clash, o->acting, o->applied, o->conditions, o->remembered, o->asserts};
  o->arg[0] = &t; o->arg[1] = s->x; o->arg[2] = 0; o->arg[3] = s->u; o->arg[4] = s->p; o->arg[5] = m;
  o->arg[6] = o->was; o->arg[7] = o->decided; o->arg[8] = &o->level;
  memcpy(o->res, results, sizeof(results));
  return event_round(o->arg, o->res, o->iw, o->w, 0);
}

/* Whether guards were last evaluated at this point, as a stretch begins at the point where its event has ended. */
static int is_known(const struct event_loop* s, const struct space* o, double t, const double* x) {
  return o->known && t == o->known_t && !memcmp(x, o->known_x, (size_t) s->states * sizeof(double))
    && !memcmp(s->m, o->known_m, (size_t) s->modes * sizeof(double));
}

/* Update the values that constants, modes and discrete variables alone determine. */
static int update_held(const struct event_loop* s, struct space* o, const double* x) {
  const double* discrete = x + s->states - s->discretes;
  double *modes = o->regime + s->constants, *own = modes + s->modes;
  size_t of_modes = (size_t) s->modes * sizeof(double), of_own = (size_t) s->discretes * sizeof(double);
  if (o->is_held && !memcmp(modes, s->m, of_modes) && !memcmp(own, discrete, of_own)) return 0;
  memcpy(modes, s->m, of_modes);
  memcpy(own, discrete, of_own);
  o->arg[0] = o->regime; o->res[0] = o->held;
  o->is_held = !determined(o->arg, o->res, o->iw, o->w, 0);
  return !o->is_held;
}

/* Bounds on the errors of states. */
static void take_errors(const struct event_loop* s, struct space* o, const double* x) {
  count_t k;
  for (k = 0; k < s->states; ++k)
    o->error[k] = 10 * (s->relative * fabs(x[k]) + s->absolute * s->nominal[k]);
}

/* Guards, together with their rates and noises, which are needed next and share most of the computation. */
static int take_guards(const struct event_loop* s, struct space* o, double t, const double* x, double* g) {
  size_t relations = (size_t) s->relations * sizeof(double);
  count_t k;
  if (!is_known(s, o, t, x)) {
    double* results[4] = {o->known_g, o->known_rate, o->known_noise, &o->turning};
    o->known = 0;
    if (update_held(s, o, x)) return UNUSUAL;
    take_errors(s, o, x);
    o->arg[0] = &t; o->arg[1] = x; o->arg[2] = o->held; o->arg[3] = o->error;
    memcpy(o->res, results, sizeof(results));
    if (judged(o->arg, o->res, o->iw, o->w, 0)) return UNUSUAL;
    for (k = 0; k < s->relations; ++k)
      if (!isfinite(o->known_g[k])) return UNUSUAL;
    memcpy(o->known_x, x, (size_t) s->states * sizeof(double));
    memcpy(o->known_m, s->m, (size_t) s->modes * sizeof(double));
    o->known_t = t;
    o->known = 1;
  }
  memcpy(g, o->known_g, relations);
  return 0;
}

/* Rates of the guards along the solution, and their noises, bounds on the errors of guards (guards.py). */
static int rates_at(const struct event_loop* s, struct space* o, double t, const double* x) {
  double instant = as_one(s, t);
  size_t relations = (size_t) s->relations * sizeof(double);
  count_t k;
  if (!is_known(s, o, t, x) && take_guards(s, o, t, x, o->noise)) return UNUSUAL;
  memcpy(o->rate, o->known_rate, relations);
  if (o->known == 2 && o->step == o->known_step) {
    memcpy(o->noise, o->relaxed_noise, relations);
    return 0;
  }
  memcpy(o->noise, o->known_noise, relations);
#ifdef METHOD_IS_STIFF
  {
    double left, which;
    take_errors(s, o, x);
    for (k = 0; k < s->relations && o->step > 0; ++k) {
      if (!(o->noise[k] > fabs(o->known_g[k]))) continue;
      which = (double) k;
      o->arg[0] = &t; o->arg[1] = x; o->arg[2] = 0; o->arg[3] = s->u; o->arg[4] = s->p; o->arg[5] = s->m;
      o->arg[6] = o->error; o->arg[7] = &o->step; o->arg[8] = &which;
      o->res[0] = &left;
      if (!relaxed(o->arg, o->res, o->iw, o->w, 0) && left < o->noise[k]) o->noise[k] = left;
    }
  }
#endif
  for (k = 0; k < s->relations; ++k) {
    o->noise[k] += fabs(o->rate[k]) * instant;
    if (o->noise[k] == 0) o->noise[k] = ROUNDED; /* independent of errors */
    if (!isfinite(o->noise[k])) return UNUSUAL;
  }
  memcpy(o->relaxed_noise, o->noise, relations);
  o->known_step = o->step;
  o->known = 2;
  return 0;
}

static int take_rates(const struct event_loop* s, struct space* o, double t) { return rates_at(s, o, t, s->x); }

/* Whether the noise of these guards is as large beside the states of this node, within their errors; if not, their
   slopes are steep for a moment only (`Guards.rates`). */
static int are_steady(struct event_loop* s, struct space* o, double t, const unsigned char* near) {
  count_t k, side;
  take_errors(s, o, s->x);
  for (k = 0; k < s->relations; ++k) o->beside[k] = ROUNDED; /* as in rates_at */
  for (side = 0; side < 2; ++side) {
    for (k = 0; k < s->states; ++k)
      o->beside_x[k] = s->x[k] + (side ? -1 : 1) * o->error[k] * (1 - 0.5 * fmod(GOLDEN * (double) k, 1));
    o->arg[0] = &t; o->arg[1] = o->beside_x; o->arg[2] = o->held; o->arg[3] = o->error;
    o->res[0] = 0; o->res[1] = o->beside_rate; o->res[2] = o->beside_noise; o->res[3] = 0;
    if (judged(o->arg, o->res, o->iw, o->w, 0)) return 0;
    for (k = 0; k < s->relations; ++k) {
      double noise = o->beside_noise[k] + fabs(o->beside_rate[k]) * as_one(s, t);
      if (isfinite(noise)) o->beside[k] = most(o->beside[k], noise);
    }
  }
  for (k = 0; k < s->relations; ++k)
    if (near[k] && o->beside[k] < STEADY * o->noise[k]) return 0;
  return 1;
}

/* How close to zero guards can be located, and which may be zero now, in reached.c. */
static int locate(struct event_loop* s, struct space* o, double t, const double* x);
static int find_reached(struct event_loop* s, struct space* o, double t);

static count_t first_relation(const struct event_loop* s) { return s->modes - s->relations; }

/* The rounds of an event, in rounds.c. */
static int settle(struct event_loop* s, struct space* o, double t, const double* before, const double* due);

static void record(struct event_loop* s, double t, const double* x) {
  s->row_time[s->rows] = t;
  memcpy(s->row_x + s->rows * s->states, x, s->states * sizeof(double));
  memcpy(s->row_m + s->rows * s->modes, s->m, s->modes * sizeof(double));
  ++s->rows;
}

/* Store time and states at an instant of a stretch. */
static void keep_trail(struct event_loop* s, double t, const double* x) {
  if (!s->trail_capacity) return;
  s->trail_time[s->trail] = t;
  memcpy(s->trail_x + s->trail * s->states, x, (size_t) s->states * sizeof(double));
  ++s->trail;
}

/* Record the row after an event, and the guards that caused it. */
static void record_event(struct event_loop* s, double t, const unsigned char* fired) {
  s->event_time[s->events] = t;
  s->event_row[s->events] = s->rows;
  s->acts_end[s->events] = s->acts;
  if (s->jump_capacity) s->jumps_end[s->events] = s->jumps;
  if (fired) memcpy(s->fired + s->events * s->relations, fired, s->relations);
  else memset(s->fired + s->events * s->relations, 0, s->relations);
  ++s->events;
  record(s, t, s->x);
}

/* Find the guards that end the stretch at this event: all that are reached and falling, at least the nearest. */
static int find_fired(struct event_loop* s, struct space* o, double t) {
  count_t k, nearest = 0;
  int any = 0;
  double least = INFINITY, instant = as_one(s, t);
  if (take_guards(s, o, t, s->x, o->g) || take_rates(s, o, t) || find_reached(s, o, t)) return UNUSUAL;
  for (k = 0; k < s->relations; ++k) {
    double away = fabs(o->g[k]), speed = fabs(o->rate[k]);
    o->fired[k] = o->g[k] < 0 || ((o->reached[k] || away <= speed * instant) && o->rate[k] < 0);
    any += o->fired[k];
    if (away / most(speed, 1e-30) < least) { least = away / most(speed, 1e-30); nearest = k; }
  }
  if (any > 1 && !are_steady(s, o, t, o->fired)) return UNUSUAL;
  if (!any) o->fired[nearest] = 1;
  return 0;
}

/* Count an event of relations (rest.py); UNUSUAL if events follow each other without end. */
static int count_event(struct event_loop* s, const struct space* o, double t) {
  double instant = as_one(s, t);
  count_t k;
  for (k = 0; k < s->relations; ++k)
    if (o->fired[k] && t - s->last[k] <= instant && s->crowd[k] >= ENDLESS) return UNUSUAL;
  ++s->count;
  for (k = 0; k < s->relations; ++k) {
    if (!o->fired[k]) continue;
    s->crowd[k] = t - s->last[k] <= instant ? s->crowd[k] + 1 : 0;
    s->last[k] = t;
  }
  return 0;
}

/* The event at the start of a segment. */
static int enter_segment(struct event_loop* s, struct space* o) {
  double t = s->boundary[s->segment];
  count_t k;
  int near = 0;
  o->step = s->first;
  memcpy(o->left_m, s->m, s->modes * sizeof(double));
  if (s->relations && take_guards(s, o, t, s->x, o->g)) return UNUSUAL;
  for (k = 0; k < s->relations; ++k) near |= o->g[k] <= 1.0;
  if (near && take_rates(s, o, t)) return UNUSUAL;
  memcpy(s->m, s->timely_modes + s->segment * s->timely, s->timely * sizeof(double));
  for (k = 0; near && k < s->relations; ++k) { /* see `Guards.exact` */
    double* mode = s->m + first_relation(s) + k;
    if (s->ties[k] >= 0 && *mode != (double) s->ties[k] && fabs(o->g[k]) <= fabs(o->rate[k]) * as_one(s, t) && o->rate[k] < -o->noise[k])
      *mode = 1.0 - *mode;
  }
  if (settle(s, o, t, o->left_m, s->due + s->segment * s->samples)) return UNUSUAL;
  s->here = t;
  s->entered = s->fresh = 1;
  record_event(s, t, 0);
  return 0;
}

/* The step over which errors have relaxed at a time of the stretch (`Search.relax`). */
static double step_of(const struct event_loop* s, double t) {
  double own = s->steps > s->begun && t > s->here ? (t - s->here) / (double) (s->steps - s->begun) : 0.0;
  return own > 0 && s->first > 0 ? (own < s->first ? own : s->first) : most(own, s->first);
}

/* Evaluate the guards of a node, whose time and states are set. */
static int evaluate_node(const struct event_loop* s, struct space* o, struct node* n) {
  count_t k;
  if (!s->relations) return 0;
  o->step = step_of(s, n->t);
  if (take_guards(s, o, n->t, n->x, n->above) || rates_at(s, o, n->t, n->x)) return UNUSUAL;
  for (k = 0; k < s->relations; ++k) {
    n->above[k] += o->band[k];
    n->rate[k] = o->rate[k];
    n->noise[k] = o->noise[k];
  }
  return 0;
}

/* Integrate from a node to `count` instants, or until a guard is `band` below zero. `o->row` are the scaled states there,
   up to `*stop`, which is INFINITY if no guard stops them. */
static int advance(struct event_loop* s, struct space* o, const struct node* from, const double* ends, count_t count,
                   const double* band, double* stop) {
  count_t n = s->dynamic, k;
  double* q = o->parameters;
  int status;
  for (k = 0; k < n; ++k) o->x0[k] = from->x[k] / s->scale[k];
  for (k = 0; k < count; ++k) o->lengths[k] = ends[k] - from->t;
#ifdef PLAIN
  memcpy(q, s->constant, s->constants * sizeof(double));
  memcpy(q + s->constants, s->m, s->modes * sizeof(double));
  memcpy(q + s->constants + s->modes, s->x + s->states - s->discretes, s->discretes * sizeof(double));
#else
  if (update_held(s, o, s->x)) return UNUSUAL;
#endif
  q += s->constants + s->modes + s->discretes;
  *q++ = from->t;
  memcpy(q, band, s->relations * sizeof(double));
  s->run.grid = o->lengths; s->run.n = count;
  s->run.reltol = s->relative; s->run.abstol = s->absolute; s->run.step = s->step;
  s->run.first = s->step > 0 ? 0.0 : o->first;
  s->run.past = o->past;
  s->run.last = o->last;
  s->run.is_blind = band == o->no_band;
  s->run.distances = from->above;
  s->run.noises = from->noise;
  memcpy(o->mean_rate, from->rate, (size_t) s->relations * sizeof(double));
  s->run.rates = o->mean_rate;
  s->run.looked = 0.0;
  s->run.longest = o->turning > 0 ? LARGEST_STEP / o->turning : 0.0;
#ifdef STEEP
  if (s->run.sample) ((struct sampler*) s->run.sampler)->start = from->t;
#endif
  /* arguments and results that are not used */
  memset(o->arg, 0, sizeof(double*) * (size_t) o->arguments);
  memset(o->res, 0, sizeof(double*) * (size_t) o->results);
  o->arg[0] = o->x0; o->arg[1] = o->x0; o->arg[2] = o->parameters; o->arg[3] = (const double*) &s->run;
  o->res[0] = o->row;
  status = segment(o->arg, o->res, o->iw, o->w, 0);
  if (status) return status == INTERRUPTED ? INTERRUPTED : UNUSUAL;
  for (k = 0; k < s->run.reached * n; ++k)
    if (!isfinite(o->row[k])) return UNUSUAL;
  s->steps += s->run.steps; s->rejected += s->run.rejected; s->rhs += s->run.rhs; s->jacobians += s->run.jac;
  *stop = from->t + s->run.stop;
  if (!(*stop < INFINITY)) {
    o->first = s->run.first;
    o->past = s->run.past;
  }
  return 0;
}

/* The states of a row, at time `t`. */
static void read_row(const struct event_loop* s, const struct space* o, count_t row, double t, struct node* to) {
  const double* from = o->row + row * s->dynamic;
  count_t k;
  to->t = t;
  for (k = 0; k < s->dynamic; ++k) to->x[k] = from[k] * s->scale[k];
  memcpy(to->x + s->dynamic, s->x + s->dynamic, (s->states - s->dynamic) * sizeof(double));
}

/* A node at `end`, even if guards are passed before it. */
static int step_to(struct event_loop* s, struct space* o, const struct node* from, double end, struct node* to) {
  double stop;
  int status = advance(s, o, from, &end, 1, o->no_band, &stop);
  if (status) return status;
  read_row(s, o, 0, end, to);
  return evaluate_node(s, o, to);
}

/* A node where the integrator was stopped, computed by a step that ends there. If it was stopped where a guard is lowest,
   node 0 becomes the start of its last step: a search from farther away would see less than that step did. */
static int step_to_stop(struct event_loop* s, struct space* o, double begin, double end, struct node* to) {
  struct node* from = o->node;
  double t = begin + s->run.last_time, first = o->first;
  count_t k;
  int status;
  if (t > from->t && t < end) { /* the last step began after the last row */
    memcpy(to->x, from->x, (size_t) s->states * sizeof(double));
    to->t = t;
    for (k = 0; k < s->dynamic; ++k) to->x[k] = o->last[k] * s->scale[k];
    o->first = end - t;
    from = to;
    if (s->run.is_dip) {
      int is_passed = 0;
      if (evaluate_node(s, o, to)) return UNUSUAL;
      for (k = 0; k < s->relations; ++k) is_passed |= to->above[k] < 0;
      if (!is_passed) copy_node(s->states, s->relations, to, o->node);
    }
  }
  status = step_to(s, o, from, end, to);
  o->first = first;
  return status;
}

/* How close to zero a guard of a node must be to be located there, after `count` points of a search: one that changes by
   more than its noise in a second as close as it can be, in an interval that is longer than an instant. */
static double zero_of(const struct space* o, const struct node* n, count_t k, int is_instant, count_t count) {
  if (is_instant || !(fabs(n->rate[k]) > n->noise[k])) return STILL * n->noise[k];
  return count < SHARP_POINTS ? LOCATED * n->noise[k] : o->located[k];
}

/* Go on from a node within the noise of guards to where the first of them is zero, if it falls at the same rate there.
   Steps of other lengths have led to the node and to the next one, which may differ by more than what lies between. */
static int sharpen(struct event_loop* s, struct space* o, struct node* here, struct node* to) {
  count_t k, which = -1;
  double t = o->limit;
  for (k = 0; k < s->relations; ++k) {
    double above = here->above[k], rate = here->rate[k];
    if (!(above <= STILL * here->noise[k]) || !(-rate > here->noise[k])) continue;
    if (above < LOCATED * here->noise[k]) return 0;
    if (here->t + above / -rate < t) { t = here->t + above / -rate; which = k; }
  }
  if (which < 0 || !(t > here->t)) return 0;
  if (step_to(s, o, here, t, to)) return UNUSUAL;
  if (!(fabs(to->rate[which] - here->rate[which]) < 0.5 * fabs(here->rate[which]))) return 0;
  for (k = 0; k < s->relations; ++k)
    if (k == which ? fabs(to->above[k]) > here->above[k] : to->above[k] < 0 && here->above[k] >= 0) return 0;
  copy_node(s->states, s->relations, to, here);
  return 0;
}

/* Search from node 0 to node 1 for an event, and leave the first one in node 0, or node 1 if there is none.
   Nodes 1, 2, ... are a stack of those still ahead. `away`: a guard that exceeds its noise around this interval, or -1. */
static int search(struct event_loop* s, struct space* o, double instant, count_t away, int* found) {
  struct node* left = o->node;
  count_t top = 1, count, k;
  double widths[2] = {INFINITY, INFINITY}; /* of the intervals that were divided last */
  int moved = 0;
  *found = 0;
  for (k = 0; k < s->relations; ++k)
    o->away[k] = k == away || (left->above[k] > left->noise[k] && o->node[1].above[k] > o->node[1].noise[k]);
  for (count = 0; count < MOST_POINTS; ++count) {
    struct node* right = o->node + top;
    int passed = 0, here = 0, far = 0, wide, is_there, status;
    double trial, width = right->t - left->t;
    int is_instant = width <= as_one(s, right->t);
    if (count == SHARP_POINTS && locate(s, o, right->t, right->x)) return UNUSUAL;
    for (k = 0; k < s->relations; ++k) {
      if (!(right->above[k] < 0)) continue;
      passed = 1;
      here |= moved && left->above[k] <= zero_of(o, left, k, is_instant, count) && left->rate[k] < 0;
      far |= right->above[k] < -zero_of(o, right, k, is_instant, count);
    }
    if (here) {
      *found = 1;
      return top < DEEPEST ? sharpen(s, o, left, o->node + top + 1) : 0;
    }
    wide = width > instant;
    is_there = passed && (!wide || !far);
    /* before a guard is reached, others may have been passed in both directions */
    trial = wide ? next_candidate(s->relations, left, right, is_there, width > 0.5 * widths[1], o->away) : INFINITY;
    if (!isfinite(trial)) {
      copy_node(s->states, s->relations, right, left);
      moved = 1;
      if (is_there) { *found = 1; return 0; }
      if (--top == 0) return 0;
      continue;
    }
    if (width > 0.5 * widths[0]) trial = 0.5 * (left->t + right->t);
    widths[0] = widths[1]; widths[1] = width;
    if (trial - left->t <= instant) {
      if (passed && !is_there && width <= FEW_INSTANTS * instant) { *found = 1; return 0; }
      trial = left->t + instant; /* a guard that jumps: a cubic through both sides crosses zero at once */
    }
    if (trial > right->t - 0.5 * instant) trial = right->t - 0.5 * instant;
    if (top == DEEPEST) return UNUSUAL;
    status = step_to(s, o, left, trial, o->node + ++top);
    if (status) return status;
    for (k = 0; k < s->relations && top > 1; ++k)
      if (o->node[top].above[k] < 0) { /* the first event is before it */
        copy_node(s->states, s->relations, o->node + top, o->node + 1);
        top = 1;
      }
  }
  return UNUSUAL;
}
