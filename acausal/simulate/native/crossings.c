/* Detection of guards that are passed within a step.

   CasADi evaluates the distances of all guards at both ends of each step, and their slopes along its polynomial, which cost
   twice as much again. Here slopes are only evaluated if a guard was passed, to locate the crossing by a cubic. Distances at
   the start of a call are those of its node, and none are evaluated while events are ignored. */

#ifdef CROSSINGS
enum { CROSSING_LEFT = 100, CROSSING_RIGHT = 101 }; /* phases beside those of casadi_ivp_event */
enum { DISTANCES = 0, DISTANCES_AND_SLOPES = 1, SLOPES = 2 };

static int acausal_distances(struct casadi_ivp_data* d, struct acausal_run* run, casadi_real t, int phase, int slopes) {
  run->slopes = slopes;
  return casadi_ivp_event_eval(d, t, phase);
}

static int acausal_event(struct casadi_ivp_data* d, struct acausal_run* run) {
  const struct casadi_ivp_prob* p = d->prob;
  casadi_int i;
  casadi_real where = 0;
  int any = 0;
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
    d->ev_restart = 0; /* no restart is needed after an event, which has set the stop flag */
    return acausal_distances(d, run, d->t, IVP_EV_END, DISTANCES);
  case IVP_EV_END:
    casadi_copy(d->em, p->ne, d->e1);
    for (i = 0; i < p->ne; ++i) {
      d->e_mask[i] = d->e0[i] > 0 && d->e1[i] < 0;
      if (d->e_mask[i] != 0) any = 1;
    }
    if (any) return acausal_distances(d, run, d->t0, CROSSING_LEFT, SLOPES);
    casadi_copy(d->e1, p->ne, d->e0);
    d->e_valid = 1;
    return casadi_ivp_event_done(d, IVP_SUCCESS);
  case CROSSING_LEFT:
    casadi_copy(d->edot, p->ne, d->edot0);
    return acausal_distances(d, run, d->t, CROSSING_RIGHT, SLOPES);
  case CROSSING_RIGHT:
    casadi_copy(d->edot, p->ne, d->edot1);
    d->ev_ta = d->t0;
    d->ev_tb = d->t;
    d->ev_iter = 0;
    casadi_ivp_event_hermite(d, &where);
    return acausal_distances(d, run, where, IVP_EV_TRIAL, DISTANCES_AND_SLOPES);
  default:
    return casadi_ivp_event_done(d, IVP_EVENT_FAILED);
  }
}
#endif

