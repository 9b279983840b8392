/* Rows inside of a step.

   Dense output of CasADi's one-step methods is accurate for slow components. For a component that follows its source
   immediately, it is a polynomial through inaccurate stages. So each step with rows inside is checked at three points: the
   defect of its polynomial p, p' - f(p), is mapped to the states by the matrix of the step, which gives the error of the
   polynomial there (W. H. Enright, Continuous numerical methods for ODEs with defect control, Journal of Computational and
   Applied Mathematics 125, 2000; the matrix is added here for stiff components). A polynomial of degree four that is
   accurate at both ends and at three points between them is accurate everywhere. Otherwise the step is repeated up to the
   row.

   Errors of stiff components at the end of a step are much smaller than the tolerance, and guards depend on that: the
   current of a diode is a voltage divided by micro-ohms. So each row is corrected by the effect of the defect on stiff
   components: with the error e above and the matrix A = M/(h gamma) - J, the correction is e - A^-1 M e/(h gamma), which is
   e where J is large, and zero where it is small. */

enum { ROWS_MOST = 20000, ROWS_POINTS = 3, ROWS_LONGEST = 64, ROWS_MOST_REPEATS = 20 };
/* Allowed error in tolerances. For slow components, a step that just passes its error test has an error of one tolerance,
   when the true error is three (measured). */
#define ROWS_GOOD 2.0

struct acausal_rows {
  int point;               /* of the step that is being checked, 0 for none, ROWS_POINTS + 1 for the row */
  int at_candidate;        /* whether the equations at a candidate (steep.c) were requested */
  int repeats;             /* how often this step was repeated up to a candidate */
  int stepped;             /* whether a step was accepted that may have more candidates */
  casadi_int next;         /* how the method continues after that */
  casadi_real stop;        /* where it has to stop, apart from candidates */
  struct acausal_samples samples;
  casadi_real checked;     /* start of the step that was found accurate */
  casadi_int halting, bad; /* how many rows to come end steps without a check, and their number the last time */
  casadi_real *y, *f;
};

/* Request the equations at the next point of the step; the last one is the row. */
static int acausal_evaluate_point(struct casadi_ivp_data* d, struct acausal_rows* r) {
  const struct casadi_ivp_prob* p = d->prob;
  d->t_arg = ++r->point > ROWS_POINTS ? d->t_out : d->t0 + r->point * d->h / (ROWS_POINTS + 1.);
  if (r->point > ROWS_POINTS) casadi_copy(d->y_out, p->ny, r->y);
  else casadi_ivp_interpolate(d, d->t_arg, r->y);
  d->y_arg = r->y;
  d->res = r->f;
  return casadi_ivp_request(d, IVP_EVAL_RHS, IVP_DONE);
}

/* The largest error of the polynomial at this point, in tolerances; `f` becomes the correction to be added to it. */
static casadi_real acausal_error(struct casadi_ivp_data* d, METHOD_DATA* e, struct acausal_rows* r) {
  const struct casadi_ivp_prob* p = d->prob;
  casadi_int i, k, first[3], count[3];
  casadi_real found = 0, theta = (d->t_arg - d->t0) / d->h, scale = -1. / d->h;
  first[0] = 0; first[1] = p->nx; first[2] = p->nx + p->nz;
  count[0] = p->nx_err; count[1] = p->nz_err; count[2] = p->nq_err;
  casadi_clear(d->w_dense, p->n_stages);
  for (k = 0; k < p->n_dense; ++k) {
    casadi_axpy(p->n_stages, (k + 1) * scale, p->m_dense + k * p->n_stages, d->w_dense);
    scale *= theta;
  }
  for (k = 0; k < p->n_stages; ++k) { /* algebraic equations have no rates */
    casadi_axpy(p->nx, d->w_dense[k], d->U + k * p->ny, r->f);
    casadi_axpy(p->nq, d->w_dense[k], d->U + k * p->ny + first[2], r->f + first[2]);
  }
  METHOD_RELAX(d, e, r->f);
  for (k = 0; k < 3; ++k)
    for (i = first[k]; i < first[k] + count[k]; ++i) {
      casadi_real a = fabs(d->y0[i]), b = fabs(d->y[i]); /* as in the error test of the step */
      casadi_real error = fabs(r->f[i]) / (p->abstol + p->reltol * (a > b ? a : b));
      if (!(error <= found)) found = error;
      if (!casadi_ivp_isfinite(found)) return found;
    }
  return found;
}

#ifdef METHOD_IS_STIFF
/* Correct the errors of stiff components in the row. */
static void acausal_correct(struct casadi_ivp_data* d, METHOD_DATA* e, struct acausal_rows* r) {
  const struct casadi_ivp_prob* p = d->prob;
  casadi_int n = p->nx + p->nz;
  casadi_axpy(n, 1., r->f, d->y_out);
  casadi_clear(r->f + p->nx, p->nz + p->nq);
  casadi_scal(p->nx, 1. / e->h_gamma, r->f);
  METHOD_RELAX(d, e, r->f);
  casadi_axpy(n, -1., r->f, d->y_out);
}
#endif

/* Whether an event has stopped the solution before the row. */
static int acausal_is_stopped(struct casadi_ivp_data* d) {
  if (!d->jump || d->t >= d->t_out) return 0;
  casadi_copy(d->y, d->prob->ny, d->y_out);
  return !casadi_ivp_stop(d, IVP_SUCCESS);
}

/* Note the event that has stopped the solution at or before the row, and the step in which it is. */
static void acausal_note_stop(const struct casadi_ivp_data* d, struct acausal_run* run) {
  if (!d->jump || d->t > d->t_out) return;
  if (run->last) casadi_copy(d->y0, d->prob->ny, run->last);
  run->last_time = d->t0;
  run->last_end = d->t0 + d->h;
  run->stop = d->t;
}

/* Repeat the step, up to a time inside of it. */
static void acausal_repeat(struct casadi_ivp_data* d, struct acausal_rows* r, casadi_real stop) {
  if (d->prob->ne > 0 && d->ev_fired >= 0) {
    --d->n_events;
    d->ev_restart = d->jump = 0;
  }
  casadi_copy(d->y0, d->prob->ny, d->y);
  d->h_next = d->h;
  r->stepped = 0;
  r->samples.end = NAN;
  r->checked = NAN;
  casadi_ivp_reset(d, d->t0, d->u, 0);
  casadi_ivp_advance(d, d->t_out, stop, 0);
}

/* Request the equations at the next candidate of an accepted step; 0 if there is none. */
static int acausal_check_candidate(struct casadi_ivp_data* d, struct acausal_rows* r, struct acausal_run* run) {
  casadi_real t;
  if (r->repeats > ROWS_MOST_REPEATS) return 0;
  t = acausal_next_candidate(d, &r->samples, run, r->y, r->f);
  if (!(t < INFINITY)) {
    if (t != t) { ++run->doubts; r->samples.end = NAN; }
    return 0;
  }
  casadi_ivp_interpolate(d, t, r->y);
  r->at_candidate = 1;
  r->next = d->next;
  d->t_arg = t;
  d->y_arg = r->y;
  d->res = r->f;
  return casadi_ivp_request(d, IVP_EVAL_RHS, IVP_DONE);
}

/* The method up to the next row, with steps that end where they would step over a change of a steep function: 1 while a task is
   to be carried out, -1 if an event has stopped it. */
static int acausal_advance(struct casadi_ivp_data* d, METHOD_DATA* e, struct acausal_rows* r, struct acausal_run* run) {
  if (r->at_candidate) {
    int good = !d->fail && acausal_error(d, e, r) <= ROWS_GOOD;
    ++d->n_rhs;
    r->at_candidate = d->fail = 0;
    d->next = r->next;
    if (!good && ++r->repeats <= ROWS_MOST_REPEATS) acausal_repeat(d, r, d->t_arg);
    else if (!good) ++run->doubts;
  }
  for (;;) {
    if (r->stepped && acausal_check_candidate(d, r, run)) return 1;
    r->stepped = 0;
    if (acausal_is_stopped(d)) return -1;
    if (METHOD(d, e)) return 1;
    if (d->status != IVP_SUCCESS || !d->pause) return 0;
    if (d->next == IVP_DONE) {
      casadi_ivp_output(d);
      return 0;
    }
    r->stepped = 1;
    r->samples.ready = 0;
    if (d->t == d->t_stop && d->t_stop < r->stop) d->t_stop = r->stop;
    else r->repeats = 0;
  }
}

/* The method up to the next row, and the checks of a step with rows inside: 1 while a task is to be carried out. */
static int acausal_going(struct casadi_ivp_data* d, METHOD_DATA* e, struct acausal_rows* r, struct acausal_run* run) {
  if (r->point == 0) {
    int going = acausal_advance(d, e, r, run);
    if (going) return going > 0;
    if (d->status != IVP_SUCCESS || d->t == d->t_out) return 0;
    if (d->t0 == r->checked) r->point = ROWS_POINTS;
    return acausal_evaluate_point(d, r);
  }
  ++d->n_rhs;
  if (!d->fail && acausal_error(d, e, r) <= ROWS_GOOD) {
    if (r->point <= ROWS_POINTS) return acausal_evaluate_point(d, r);
    METHOD_CORRECT(d, e, r);
    r->point = 0;
    r->checked = d->t0;
    r->bad = 0;
    return 0;
  }
  /* repeat the step up to the row */
  r->point = 0;
  r->bad = r->bad ? (2 * r->bad < ROWS_LONGEST ? 2 * r->bad : ROWS_LONGEST) : 1;
  r->halting = r->bad;
  acausal_repeat(d, r, d->t_out);
  r->stop = d->t_out;
  return acausal_advance(d, e, r, run) > 0;
}

/* Continue to row k, and not past it if steps end at rows. */
static void acausal_to_row(struct casadi_ivp_data* d, struct acausal_rows* r, const struct acausal_run* run, casadi_int k) {
  int halts = d->prob->step_size > 0 || d->prob->ny > ROWS_MOST || r->halting > 0;
  if (r->halting > 0) --r->halting;
  if (k && d->prob->step_size > 0) casadi_ivp_reset(d, run->grid[k - 1], d->u, 0);
  r->stop = run->grid[halts ? k : run->n - 1];
  casadi_ivp_advance(d, run->grid[k], r->stop, 0);
  d->pause = run->sample && d->prob->step_size <= 0 && d->prob->ny <= ROWS_MOST;
}

