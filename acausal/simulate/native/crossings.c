/* Detection of guards that are passed within a step.

   CasADi evaluates the distances of all guards at both ends of each step, and their slopes along its polynomial, which cost
   twice as much again, and sees a guard only if its sign has changed. Here slopes are evaluated if a guard was passed, to
   locate the crossing by a cubic, or if one is so small against its changes that it may be passed there and back. The
   integrator then stops at the lowest point of its cubic; integrate() of stretches.c judges by a step that ends there.
   Distances and rates at the start of a call are those of its node, and none are evaluated while events are ignored. */

#ifdef CROSSINGS
enum { CROSSING_LEFT = 100, CROSSING_RIGHT = 101 }; /* phases beside those of casadi_ivp_event */
enum { DISTANCES = 0, DISTANCES_AND_SLOPES = 1, SLOPES = 2 };

static int acausal_distances(struct casadi_ivp_data* d, struct acausal_run* run, casadi_real t, int phase, int slopes) {
  run->slopes = slopes;
  return casadi_ivp_event_eval(d, t, phase);
}

/* Whether guard i may be passed there and back in this step: a parabola that falls at its start as the guard did on average
   in the step before is lower than both ends by at most a quarter of these changes. */
static int acausal_may_dip(const struct casadi_ivp_data* d, const struct acausal_run* run, casadi_int i) {
  casadi_real change = fabs(d->e1[i] - d->e0[i]) + fabs(run->rates[i]) * d->h;
  return d->e0[i] >= 0 && !(change < d->e0[i] && change < d->e1[i]);
}

/* The first time at which a guard may be passed there and back in this step, and its index; INFINITY if there is none. Also
   whether this guard exceeds its noise at both ends of the step. */
static casadi_real acausal_first_dip(const struct casadi_ivp_data* d, struct acausal_run* run, casadi_int* which) {
  casadi_int i;
  casadi_real found = INFINITY, s;
  int is_away;
  for (i = 0; i < d->prob->ne; ++i) {
    if (!(d->e0[i] >= 0 && d->e1[i] >= 0)) continue;
    is_away = d->e0[i] > run->noises[i] && d->e1[i] > run->noises[i];
    s = dip_of(d->e0[i], d->h * d->edot0[i], d->e1[i], d->h * d->edot1[i], is_away ? 0.0 : STILL * run->noises[i]);
    if (d->t0 + s * d->h < found) {
      found = d->t0 + s * d->h;
      *which = i;
      run->away = is_away ? i : -1;
    }
  }
  return found;
}

/* Go on to the next step, for which the mean rates of guards in this one are remembered. */
static int acausal_no_event(struct casadi_ivp_data* d, struct acausal_run* run) {
  casadi_int i;
  for (i = 0; i < d->prob->ne; ++i) run->rates[i] = (d->e1[i] - d->e0[i]) / d->h;
  run->looked = d->t;
  casadi_copy(d->e1, d->prob->ne, d->e0);
  d->e_valid = 1;
  return casadi_ivp_event_done(d, IVP_SUCCESS);
}

static int acausal_event(struct casadi_ivp_data* d, struct acausal_run* run) {
  const struct casadi_ivp_prob* p = d->prob;
  casadi_int i;
  casadi_real crossing = INFINITY, dip;
  int any = 0, is_repeated;
  run->slopes = DISTANCES_AND_SLOPES;
  if (d->ev_phase == IVP_EV_TRIAL || d->ev_phase == IVP_EV_POST) return casadi_ivp_event(d);
  if (d->fail && d->ev_phase != IVP_EV_BEGIN) return casadi_ivp_event_done(d, IVP_EVAL_FAILED);
  switch ((int) d->ev_phase) {
  case IVP_EV_BEGIN:
    d->ev_fired = -1;
    if (run->is_blind) return casadi_ivp_event_done(d, IVP_SUCCESS);
    casadi_clear(d->e_mask, p->ne);
    if (!d->e_valid && run->distances && d->t0 == 0) {
      casadi_copy(run->distances, p->ne, d->e0);
      d->e_valid = 1;
    }
    if (d->e_valid) return acausal_distances(d, run, d->t, IVP_EV_END, DISTANCES);
    return acausal_distances(d, run, d->t0, IVP_EV_START, DISTANCES);
  case IVP_EV_START:
    casadi_copy(d->em, p->ne, d->e0);
    d->ev_restart = 0; /* nothing follows an event */
    return acausal_distances(d, run, d->t, IVP_EV_END, DISTANCES);
  case IVP_EV_END:
    casadi_copy(d->em, p->ne, d->e1);
    is_repeated = d->t0 != run->looked; /* the rates are those of its first attempt */
    for (i = 0; i < p->ne; ++i) {
      d->e_mask[i] = d->e0[i] >= 0 && d->e1[i] < 0; /* zero where the last event was */
      if (d->e_mask[i] != 0 || is_repeated || acausal_may_dip(d, run, i)) any = 1;
    }
    if (any) return acausal_distances(d, run, d->t0, CROSSING_LEFT, SLOPES);
    return acausal_no_event(d, run);
  case CROSSING_LEFT:
    casadi_copy(d->edot, p->ne, d->edot0);
    return acausal_distances(d, run, d->t, CROSSING_RIGHT, SLOPES);
  case CROSSING_RIGHT:
    casadi_copy(d->edot, p->ne, d->edot1);
    d->ev_ta = d->t0;
    d->ev_tb = d->t;
    d->ev_iter = 0;
    casadi_ivp_event_hermite(d, &crossing); /* stays infinite if no guard was passed */
    dip = acausal_first_dip(d, run, &i);
    run->is_dip = dip < crossing;
    if (run->is_dip) {
      d->ev_fired = i;
      d->t_ev = dip;
      d->ev_dt = p->event_tol;
      return casadi_ivp_event_fire(d);
    }
    if (crossing < INFINITY) return acausal_distances(d, run, crossing, IVP_EV_TRIAL, DISTANCES_AND_SLOPES);
    return acausal_no_event(d, run);
  default:
    return casadi_ivp_event_done(d, IVP_EVENT_FAILED);
  }
}
#endif

