/* How well instants of guards are known: alone, and beside one that is passed now; the counterpart of guards.py. */

/* How close to zero guards can be located at a point (`Guards.located`). */
static int locate(struct event_loop* s, struct space* o, double t, const double* x) {
  static const double errors[6] = {-8, -5, -2, 2, 5, 8};
  double *least = o->beside_noise, *greatest = o->later;
  count_t k, n;
  for (n = 0; n < 6; ++n) {
    double up = errors[n] * EPSILON, there = t * (1 - up);
    for (k = 0; k < s->states; ++k) o->beside_x[k] = x[k] * (fmod(GOLDEN * (double) k, 1) < 0.5 ? 1 + up : 1 - up);
    o->arg[0] = &there; o->arg[1] = o->beside_x; o->arg[2] = o->held; o->arg[3] = o->error;
    o->res[0] = o->beside; o->res[1] = o->res[2] = o->res[3] = 0;
    if (judged(o->arg, o->res, o->iw, o->w, 0)) return UNUSUAL;
    for (k = 0; k < s->relations; ++k) {
      if (!n || o->beside[k] < least[k]) least[k] = o->beside[k];
      if (!n || o->beside[k] > greatest[k]) greatest[k] = o->beside[k];
    }
  }
  for (k = 0; k < s->relations; ++k) {
    double rounded = greatest[k] - least[k];
    o->located[k] = rounded > STILL * o->noise[k] ? STILL * o->noise[k] : most(rounded, LOCATED * o->noise[k]);
  }
  return 0;
}

/* Guards of the present point, `o->g`, that may be zero now (`Guards.are_reached`). */
static int find_reached(struct event_loop* s, struct space* o, double t) {
  count_t k, j, side;
  int unclear = 0;
  double *g = o->g, *apart = o->later;
  for (k = 0; k < s->relations; ++k) {
    o->reached[k] = g[k] <= STILL * o->noise[k];
    unclear |= s->relations > 1 && o->reached[k] && g[k] > LOCATED * o->noise[k] && o->rate[k] < -o->noise[k];
  }
  if (!unclear) return 0;
  take_errors(s, o, s->x);
  if (locate(s, o, t, s->x)) return UNUSUAL;
  for (k = 0; k < s->relations; ++k) apart[k] = INFINITY;
  for (j = 0; j < s->relations; ++j) {
    double *of_j = o->beside_noise, since;
    if (!(fabs(g[j]) <= o->located[j] && fabs(o->rate[j]) > o->noise[j])) continue; /* is not passed now */
    for (k = 0; k < s->relations; ++k) of_j[k] = 0.0;
    for (side = 0; side < SHIFTS; ++side) {
      for (k = 0; k < s->states; ++k) {
        double sign = side % 2 && fmod(GOLDEN * (double) k, 1) >= 0.5 ? -1 : 1;
        o->beside_x[k] = s->x[k] + sign * (double) (side / 2 + 1) * SHIFT * o->error[k];
      }
      o->arg[0] = &t; o->arg[1] = o->beside_x; o->arg[2] = o->held; o->arg[3] = o->error;
      o->res[0] = o->beside; o->res[1] = o->res[2] = o->res[3] = 0;
      if (judged(o->arg, o->res, o->iw, o->w, 0)) return UNUSUAL;
      since = (o->beside[j] - g[j]) / o->rate[j];
      for (k = 0; k < s->relations; ++k) of_j[k] = most(of_j[k], fabs(o->beside[k] - g[k] - since * o->rate[k]));
    }
    for (k = 0; k < s->relations; ++k) {
      double own = of_j[k] * STILL / SHIFT + (fabs(g[j]) + MARGIN * o->located[j]) * fabs(o->rate[k] / o->rate[j]);
      if (own < apart[k]) apart[k] = own;
    }
  }
  for (k = 0; k < s->relations; ++k)
    if (o->rate[k] < -o->noise[k] && g[k] > MARGIN * o->located[k] + apart[k]) o->reached[k] = 0;
  return 0;
}
