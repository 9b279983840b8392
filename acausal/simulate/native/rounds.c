/* The rounds of an event, using event_loop.c; the counterpart of simulate/events/iteration.py. */

static count_t first_memory(const struct event_loop* s) { return s->timely + s->samples; }

static int memories_are_current(const struct event_loop* s, const struct space* o) {
  count_t k;
  for (k = 0; k < s->memories; ++k)
    if (o->remembered[k] != s->m[first_memory(s) + k]) return 0;
  return 1;
}

/* Flip relations and apply discrete equations until all hold; the results of the last round are left in `o`. */
static int decide(struct event_loop* s, struct space* o, double t, count_t* turn) {
  count_t round, k;
  for (round = 0; round < MOST_ROUNDS; ++round) {
    int moved = 0, wrong = 0, leaves = 0, leaving, far = 1;
    if (take_round(s, o, t, s->m)) return UNUSUAL;
    for (k = 0; k < s->assigned; ++k) {
      double* held = s->x + s->assigned_at[k];
      if (o->assigned[k] != *held) { *held = o->assigned[k]; moved = 1; }
    }
    if (moved) continue;
    if (!s->relations) return 0;
    leaving = memories_are_current(s, o);
    if (take_guards(s, o, t, s->x, o->g)) return UNUSUAL;
    for (k = 0; k < s->relations; ++k) far &= o->g[k] > 1.0;
    if (far) return 0;
    if (take_rates(s, o, t) || find_reached(s, o, t)) return UNUSUAL;
    for (k = 0; k < s->relations; ++k) {
      double noise = o->noise[k];
      o->largest_noise[k] = most(o->largest_noise[k], noise);
      if (o->flips[k] > 1) noise = o->largest_noise[k];
      int near = (o->flips[k] ? o->g[k] <= STILL * noise : o->reached[k]) || o->g[k] <= fabs(o->rate[k]) * as_one(s, t);
      double* mode = s->m + first_relation(s) + k;
      int untied = o->g[k] == 0.0 && o->rate[k] == 0.0 && o->flips[k] < TWICE && s->ties[k] >= 0 && *mode != (double) s->ties[k];
      o->leaves[k] = (leaving || s->timed[k]) && near && o->rate[k] < -noise;
      leaves |= o->leaves[k];
      if (o->g[k] < -2 * noise || untied || o->leaves[k]) {
        *mode = 1.0 - *mode;
        if (++o->flips[k] >= CHATTER) return UNUSUAL;
        wrong = 1;
      }
    }
    if (!wrong) return 0;
    if (leaves && !are_steady(s, o, t, o->leaves)) return UNUSUAL;
    if (++*turn >= AT_ONCE) return UNUSUAL;
  }
  return UNUSUAL;
}

static void reset_flips(const struct event_loop* s, struct space* o, count_t* turn) {
  count_t k;
  *turn = 0;
  for (k = 0; k < s->relations; ++k) { o->flips[k] = 0; o->largest_noise[k] = 0.0; }
}

/* Store the actions of a round, and the point at which they are taken; UNUSUAL if there is no room. */
static int keep_jump(struct event_loop* s, const struct space* o) {
  count_t k;
  int any = memcmp(s->m, o->next_m, (size_t) s->modes * sizeof(double)) != 0;
  for (k = 0; k < s->actions; ++k) any |= o->applied[k] > 0.5;
  if (!s->jump_capacity || !any) return 0;
  if (s->jumps == s->jump_capacity) return UNUSUAL;
  memcpy(s->jump_x + s->jumps * s->states, s->x, (size_t) s->states * sizeof(double));
  memcpy(s->jump_m + s->jumps * s->modes, s->m, (size_t) s->modes * sizeof(double));
  memcpy(s->jump_applied + s->jumps * s->actions, o->applied, (size_t) s->actions * sizeof(double));
  s->jump_advances[s->jumps++] = o->next_level == 0.0;
  return 0;
}

/* Repeat rounds, from modes that have already changed, until one changes nothing; `before` are the modes until now. */
static int settle(struct event_loop* s, struct space* o, double t, const double* before, const double* due) {
  count_t k, round, turn;
  int ticked = 0;
  size_t conditions = (size_t) s->conditions * sizeof(double);
  memset(o->was, 0, conditions);
  memset(o->decided, 0, conditions);
  o->level = 0.0;
  if (conditions) {
    if (take_round(s, o, t, before)) return UNUSUAL;
    memcpy(o->was, o->conditions, conditions);
  }
  for (k = 0; k < s->samples; ++k) s->m[s->timely + k] = due ? due[k] : 0.0;
  for (k = 0; k < s->flags; ++k) s->m[first_memory(s) + s->memories + k] = 0.0;
  reset_flips(s, o, &turn);
  for (round = 0;; ++round) {
    if (round == MOST_ROUNDS || decide(s, o, t, &turn) || o->clash != 0.0) return UNUSUAL;
    for (k = 0; o->next_level == 0.0 && k < s->clauses; ++k) {
      if (o->acting[k] == 0.0) continue;
      if (s->ends[k] || s->acts == s->act_capacity) return UNUSUAL;
      s->act[s->acts++] = k;
    }
    if (o->settled > 0.5) break;
    if (keep_jump(s, o)) return UNUSUAL;
    if (memcmp(s->x, o->next_x, (size_t) s->dynamic * sizeof(double))) reset_flips(s, o, &turn);
    memcpy(s->x, o->next_x, (size_t) s->states * sizeof(double));
    memcpy(s->m, o->next_m, (size_t) s->modes * sizeof(double));
    memcpy(o->was, o->next_was, conditions);
    memcpy(o->decided, o->next_decided, conditions);
    o->level = o->next_level;
  }
  for (k = 0; k < s->asserts; ++k)
    if (!(o->asserts[k] > 0.5)) return UNUSUAL;
  for (k = 0; k < s->samples; ++k) {
    ticked |= s->m[s->timely + k] != 0.0;
    s->m[s->timely + k] = 0.0;
  }
  if (ticked && (s->memories || s->assigned)) { /* samples are false again, and memories follow them */
    if (take_round(s, o, t, s->m)) return UNUSUAL;
    for (k = 0; k < s->assigned; ++k)
      if (o->assigned[k] != s->x[s->assigned_at[k]]) return UNUSUAL; /* a discrete equation reads them, and needs more rounds */
    for (k = 0; k < s->memories; ++k) s->m[first_memory(s) + k] = o->remembered[k];
  }
  for (k = 0; k < s->states; ++k)
    if (!isfinite(s->x[k])) return UNUSUAL;
  return 0;
}
