/* The loop over stretches and their events, using event_loop.c: outputs and mesh points of a stretch, memory of a call. */

/* Whether a falling guard is within its noise at node 1, although by its rate it should have been passed: it may stay
   near zero (lingering.py). */
static int lingers(const struct event_loop* s, const struct space* o) {
  const struct node *left = o->node, *right = o->node + 1;
  count_t k;
  for (k = 0; k < s->relations; ++k)
    if (right->above[k] > 0 && right->above[k] <= right->noise[k]
        && -right->rate[k] * (right->t - left->t) > right->above[k]) return 1;
  return 0;
}

/* Process a row or mesh point that node 0 has reached; from there on, resting guards may go as far as their noise. */
static void mark_reached(struct event_loop* s, struct space* o, count_t* k) {
  count_t j;
  if (o->purpose[*k] & ROW) record(s, o->instants[*k], o->node[0].x);
  keep_trail(s, o->instants[*k], o->node[0].x);
  ++*k;
  for (j = 0; j < s->relations; ++j) {
    o->node[0].above[j] += o->later_band[j] - o->band[j];
    o->band[j] = o->later_band[j];
  }
}

/* Integrate from node 0 over the rows `*k` to `last`, at which a step ends, or to the first event before it. */
static int integrate(struct event_loop* s, struct space* o, count_t* k, count_t last, int* found) {
  int status;
  count_t j, away;
  while (*k <= last) {
    count_t first = *k;
    double instant = most(STILL * INSTANT * s->span, 0.05 * ROUNDINGS * fabs(o->instants[last])), begin = o->node[0].t, stop, t, beyond;
    status = advance(s, o, o->node, o->instants + first, last - first + 1, o->band, &stop);
    if (status) return status;
    /* the search integrates itself, and would overwrite the rows ahead */
    if (last > first) memcpy(o->ahead, o->row, (size_t) ((last - first + 1) * s->dynamic) * sizeof(double));
    while (*k <= last && o->instants[*k] <= stop) {
      if (last > first) memcpy(o->row, o->ahead + (*k - first) * s->dynamic, (size_t) s->dynamic * sizeof(double));
      read_row(s, o, 0, o->instants[*k], o->node + 1);
      status = evaluate_node(s, o, o->node + 1);
      if (!status && lingers(s, o)) status = UNUSUAL;
      o->limit = o->instants[*k];
      if (!status) status = search(s, o, instant, -1, found);
      if (status || *found) return status;
      mark_reached(s, o, k);
    }
    if (*k > last) return 0;
    o->limit = o->instants[*k];
    /* A guard was reached on dense output, or may be passed there and back. A step that ends there shows whether it is, and
       otherwise a step that ends where the one of the integrator did. */
    beyond = begin + s->run.last_end;
    t = stop - o->node[0].t > instant ? stop : beyond < o->instants[*k] ? beyond : o->instants[*k];
    status = t == stop ? step_to_stop(s, o, begin, t, o->node + 1) : step_to(s, o, o->node, t, o->node + 1);
    away = t == stop && s->run.is_dip ? s->run.away : -1;
    if (!status) status = search(s, o, instant, away, found);
    if (status || *found) return status;
    for (j = 0; t < o->instants[*k] && j < s->relations; ++j)
      *found |= j != away && o->node->above[j] <= STILL * o->node->noise[j] && o->node->rate[j] < 0;
    if (*found) return sharpen(s, o, o->node, o->node + 1);
    if (beyond > t + instant && t < o->instants[*k]) {
      t = beyond < o->instants[*k] ? beyond : o->instants[*k];
      status = step_to(s, o, o->node, t, o->node + 1);
      if (!status) status = search(s, o, instant, away, found);
      if (status || *found) return status;
    }
    if (t == o->instants[*k]) mark_reached(s, o, k);
  }
  return 0;
}

/* Whether the next bounce may be lower than the noise, estimated from the acceleration in the last one; rest.py decides,
   and predicts from the last few bounces when they end. `before` are the rates at the impact. Relations that no `when`
   resets, or that nothing holds at rest, are impossible. */
static int may_come_to_rest(const struct event_loop* s, struct space* o, double t, const double* before) {
  count_t k;
  if (take_rates(s, o, t)) return 1;
  for (k = 0; k < s->relations; ++k) {
    double approach = fabs(before[k]), away = fabs(o->rate[k]);
    if (!o->fired[k] || s->impossible[k] || !(away < approach)) continue;
    if (away * away * (t - s->last[k]) / (4 * approach) <= NEARLY * o->noise[k]) return 1;
  }
  return 0;
}

/* Number of mesh points in a time span, for MESH_POINTS in the whole run. A step ends at each. The fewest are two, as the
   cubics of crossings.c show what a guard does within a step (with four, those of a converter were half as long as its
   tolerance asks for). */
static count_t mesh_points(const struct event_loop* s, double span) {
  double found = most(FEWEST_POINTS, ceil(MESH_POINTS * span / s->span));
  return found < MESH_POINTS ? (count_t) found : MESH_POINTS;
}

/* Process the event at the end of a stretch. If it is not ordinary, the run stays before it, and keeps the stretch. */
static int pass_event(struct event_loop* s, struct space* o, double time) {
  struct event_loop kept = *s;
  count_t k;
  int changed = 0, status;
  status = find_fired(s, o, time);
  memcpy(o->x0, s->x, s->states * sizeof(double));
  memcpy(o->left_m, s->m, s->modes * sizeof(double));
  memcpy(o->approach, o->rate, s->relations * sizeof(double));
  for (k = 0; !status && k < s->relations; ++k)
    if (o->fired[k]) s->m[first_relation(s) + k] = 1.0 - s->m[first_relation(s) + k];
  if (!status) status = settle(s, o, time, o->left_m, 0);
  for (k = 0; k < s->states; ++k) changed |= s->x[k] != o->x0[k];
  if (!status && changed) status = may_come_to_rest(s, o, time, o->approach);
  if (!status) status = count_event(s, o, time);
  if (status) {
    *s = kept;
    memcpy(s->x, o->x0, s->states * sizeof(double));
    memcpy(s->m, o->left_m, s->modes * sizeof(double));
    s->arrived = 1;
    return ARRIVED;
  }
  record_event(s, time, o->fired);
  return 0;
}

/* Integrate over a stretch, and the event that ends it. */
static int integrate_stretch(struct event_loop* s, struct space* o) {
  double end = s->boundary[s->segment + 1], far = 1e-13 * most(s->span, fabs(s->here)), begin = s->here;
  count_t from = s->segment ? s->times_end[s->segment - 1] : 0, until = s->times_end[s->segment];
  count_t points = s->relations ? mesh_points(s, end - s->here) : 1, mesh = 1; /* the end is always one */
  count_t wide = 0, k, steps = s->steps;
  double time;
  int found = 0, resting = 0;
  s->begun = s->steps;
  s->run.doubts = s->run.sample ? 0 : 1;
  o->step = s->first;
  if (!s->fresh)
    while (from < until && !(s->times[from] > s->here + far)) ++from;
  if (from == until) { /* the event was at the end of the segment */
    ++s->segment;
    s->entered = 0;
    return 0;
  }
  if (s->rows + (until - from) + 3 > s->row_capacity || s->events + 1 >= s->event_capacity) return FULL;
  if (s->trail_capacity && s->trail + (until - from) + points + 1 > s->trail_capacity) return FULL;
  if (take_guards(s, o, s->here, s->x, o->g) || take_rates(s, o, s->here)) return UNUSUAL;
  if (find_reached(s, o, s->here)) return UNUSUAL;
  for (k = 0; k < s->relations; ++k) {
    o->resting[k] = o->reached[k] && o->rate[k] <= o->noise[k];
    resting |= o->resting[k];
    /* one that still falls, as its mode was kept a little longer, passes its guard by as much as can be distinguished */
    o->later_band[k] = o->resting[k] ? (o->rate[k] < -o->noise[k] ? 2 * STILL : 2) * o->noise[k] : 0.0;
    o->band[k] = !o->resting[k] && (fabs(o->g[k]) <= o->noise[k] || -o->g[k] <= o->rate[k] * LATE * as_one(s, s->here))
      ? most(-BEHIND * o->g[k], 0.0) : o->later_band[k];
    o->no_band[k] = NEVER;
  }
  if (resting && !are_steady(s, o, s->here, o->resting)) return UNUSUAL;
  for (k = from; k < until || mesh <= points;) { /* outputs and mesh points, merged */
    double at = mesh < points ? s->here + (end - s->here) * mesh / points : end;
    if (mesh <= points && (k == until || at <= s->times[k])) {
      int is_row = k < until && at == s->times[k];
      o->purpose[wide] = (unsigned char) (is_row ? MESH | ROW : MESH);
      k += is_row;
      ++mesh;
    } else {
      at = s->times[k++];
      o->purpose[wide] = ROW;
    }
    o->instants[wide++] = at;
  }
  o->node[0].t = s->here;
  memcpy(o->node[0].x, s->x, s->states * sizeof(double));
  if (evaluate_node(s, o, o->node)) return UNUSUAL;
  /* a guard that was passed by no more than its noise counts as being on it */
  for (k = 0; k < s->relations; ++k) o->node[0].above[k] = most(o->node[0].above[k], o->band[k]);
  o->first = s->first;
  o->past = 0.0;
  for (k = 0; k < wide && !found;) {
    count_t last = k;
    int status;
    /* only up to the first row, if the bands of guards are different until then */
    if (k || !memcmp(o->band, o->later_band, (size_t) s->relations * sizeof(double)))
      while (!(o->purpose[last] & MESH)) ++last;
    status = integrate(s, o, &k, last, &found);
    if (status) return status;
    if (found && k == wide - 1 && end - o->node[0].t <= as_one(s, end)) {
      /* it coincides with the event at the end */
      o->node[0].t = end;
      found = 0;
      mark_reached(s, o, &k);
    }
  }
  time = o->node[0].t;
  if (s->steps > steps && time > begin) s->first = (time - begin) / (s->steps - steps);
  o->step = s->first;
  s->here = time;
  s->fresh = 0;
  memcpy(s->x, o->node[0].x, s->states * sizeof(double));
  if (found) keep_trail(s, time, s->x);
  if (s->trail_capacity) {
    s->trail_end[s->stretches] = s->trail;
    s->stretch_steps[s->stretches] = s->steps - steps;
    s->stretch_doubts[s->stretches] = s->run.doubts;
    s->stretch_events[s->stretches++] = s->events;
  }
  if (!found) {
    ++s->segment;
    s->entered = 0;
    return 0;
  }
  record(s, time, s->x);
  return pass_event(s, o, time);
}

static count_t most_instants(const struct event_loop* s) {
  count_t k, found = 0;
  for (k = 0; k < s->boundaries - 1; ++k) {
    count_t own = s->times_end[k] - (k ? s->times_end[k - 1] : 0);
    if (own > found) found = own;
  }
  return found + MESH_POINTS + 1;
}

static casadi_int larger(casadi_int a, casadi_int b) { return a > b ? a : b; }

/* Divide the memory of a call into arrays, if it is allocated already; returns the number of doubles. */
static size_t lay_out(const struct event_loop* s, struct space* o, double* memory, count_t wide) {
  count_t r = s->relations, n = s->states, all = s->constants + s->modes + n + 1 + r, each = n + 3 * r;
  count_t c = s->conditions;
  count_t sizes[] = {s->assigned, n, s->modes, c, c, s->clauses, s->actions, c, s->memories, s->asserts, c, c,
                     r, r, n, r, r, r, r, r, r, r, r, r, n, n, s->modes, s->modes, wide, wide, wide * s->dynamic, wide * s->dynamic, all, n,
                     n, s->modes, r, r, r, r, r, r, r, n, HELD, s->constants + s->modes + s->discretes, (DEEPEST + 2) * each};
  double** parts[] = {&o->assigned, &o->next_x, &o->next_m, &o->next_was, &o->next_decided, &o->acting, &o->applied,
                      &o->conditions, &o->remembered, &o->asserts, &o->was, &o->decided, &o->g, &o->rate, &o->error,
                      &o->noise, &o->largest_noise, &o->band, &o->later_band, &o->no_band, &o->approach,
                      &o->beside, &o->beside_rate, &o->beside_noise, &o->beside_x, &o->before_x, &o->before_m, &o->left_m, &o->instants, &o->lengths, &o->row, &o->ahead, &o->parameters, &o->x0,
                      &o->known_x, &o->known_m, &o->known_g, &o->known_rate, &o->known_noise,
                      &o->relaxed_noise, &o->mean_rate, &o->located, &o->later, &o->last, &o->held, &o->regime, &o->nodes};
  size_t k, used = 0;
  for (k = 0; k < sizeof(sizes) / sizeof(*sizes); ++k) {
    if (memory) *parts[k] = memory + used;
    used += (size_t) sizes[k] + 1;
  }
  for (k = 0; memory && k < DEEPEST + 2; ++k) {
    double* q = o->nodes + k * (size_t) each;
    o->node[k].x = q;
    o->node[k].above = q + n; o->node[k].rate = q + n + r; o->node[k].noise = q + n + 2 * r;
  }
  return used;
}

/* Continue to the end of the run, until the record is full, or until something unusual is ahead. */
CASADI_SYMBOL_EXPORT int acausal_event_loop(struct event_loop* s) {
  casadi_int sizes[4] = {0, 0, 0, 0}, own[4]; /* of arguments, results, integers, doubles */
  int (*works[])(casadi_int*, casadi_int*, casadi_int*, casadi_int*) = {segment_work, determined_work, judged_work, event_round_work, relaxed_work};
  struct space o;
  count_t wide = most_instants(s), k;
  double* memory;
  size_t used;
  unsigned char* bytes;
  int status = DONE;
  for (k = 0; k < 5; ++k) {
    int j;
    works[k](own, own + 1, own + 2, own + 3);
    for (j = 0; j < 4; ++j) sizes[j] = larger(sizes[j], own[j]);
  }
  memset(&o, 0, sizeof(o));
  o.settled = 1.0; /* with PLAIN, no event needs rounds */
  used = lay_out(s, &o, 0, wide);
  memory = malloc(sizeof(double) * (used + (size_t) (sizes[3] + 1)));
  bytes = malloc((size_t) (5 * s->relations + wide + 1));
  o.arguments = sizes[0] + 9;
  o.results = sizes[1] + 13;
  o.arg = malloc(sizeof(double*) * (size_t) o.arguments);
  o.res = malloc(sizeof(double*) * (size_t) o.results);
  o.iw = malloc(sizeof(casadi_int) * (size_t) (sizes[2] + 1));
  o.flips = malloc(sizeof(count_t) * (size_t) (s->relations + 1));
  s->run.sample = 0;
#ifdef STEEP
  struct sampler sampler;
  memset(&sampler, 0, sizeof(sampler));
  if (s->columns && s->step <= 0 && sampler_of(s, &sampler)) status = UNUSUAL;
#endif
  if (memory && bytes && o.arg && o.res && o.iw && o.flips) {
    lay_out(s, &o, memory, wide);
    memcpy(o.regime, s->constant, s->constants * sizeof(double));
    s->run.held = o.held; /* up to date whenever the integrator is called */
    o.w = memory + used;
    o.fired = bytes; o.leaves = o.fired + s->relations; o.resting = o.leaves + s->relations;
    o.away = o.resting + s->relations; o.reached = o.away + s->relations;
    o.purpose = o.reached + s->relations;
    while (!status && s->segment < s->boundaries - 1) {
      struct event_loop kept = *s;
      memcpy(o.before_x, s->x, s->states * sizeof(double));
      memcpy(o.before_m, s->m, s->modes * sizeof(double));
      if (!s->entered && (s->rows + 1 > s->row_capacity || s->events + 1 > s->event_capacity)) status = FULL;
      else status = s->entered ? integrate_stretch(s, &o) : enter_segment(s, &o);
      if (status && status != ARRIVED) { /* undo the attempt; `last` and `crowd` change only after all that can fail */
        count_t rows = s->rows;
        *s = kept;
        if (status == INTERRUPTED) s->rows = rows;
        memcpy(s->x, o.before_x, s->states * sizeof(double));
        memcpy(s->m, o.before_m, s->modes * sizeof(double));
      }
    }
  } else status = UNUSUAL;
#ifdef STEEP
  free(sampler.arg); free(sampler.res); free(sampler.iw); free(sampler.w);
  s->run.sample = 0;
#endif
  s->run.held = 0;
  free(memory); free(bytes); free(o.arg); free(o.res); free(o.iw); free(o.flips);
  return status;
}
