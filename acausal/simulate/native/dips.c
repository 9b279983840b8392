/* Where a guard may be passed between two points of a solution at which it is positive, from its values and rates there. */

/* No point is closer to an end than this fraction of the interval. */
#define NEAREST 0.02
/* The fraction of the depth of a cubic below its ends by which it may be wrong: an oscillation of which a step is one
   radian is wrong by a fiftieth. */
#define CUBIC_ERROR 0.0625
/* Guards count as zero within this fraction of their noise. */
#define STILL 1e-2

/* The cubic from p at 0 to q at 1 with slopes a and b. */
struct cubic {
  double p, a, square, cube, turn[2];
  int turns;
};

static double value_of(const struct cubic* c, double s) { return c->p + s * (c->a + s * (c->square + s * c->cube)); }

static struct cubic cubic_of(double p, double a, double q, double b) {
  struct cubic c;
  double inside, r, found[2];
  int k;
  c.p = p; c.a = a; c.square = 3 * (q - p) - 2 * a - b; c.cube = a + b - 2 * (q - p); c.turns = 0;
  inside = c.square * c.square - 3 * a * c.cube;
  if (inside <= 0) return c;
  r = -(c.square + copysign(sqrt(inside), c.square));
  found[0] = c.cube != 0 ? r / (3 * c.cube) : 2.0;
  found[1] = r != 0 ? a / r : 2.0;
  if (found[1] < found[0]) { double other = found[0]; found[0] = found[1]; found[1] = other; }
  for (k = 0; k < 2; ++k)
    if (found[k] > 0 && found[k] < 1) c.turn[c.turns++] = found[k];
  return c;
}

/* The point at which a guard from p at 0 to q at 1, both positive, with slopes a and b there, may be passed in both
   directions; INFINITY if there is none. Guards below `near` count as zero: 0 between two points at which a guard exceeds its
   noise, because an error of the states moves all of its excursion, and does not make it longer or shorter. */
static double dip_of(double p, double a, double q, double b, double near) {
  double least = p < q ? p : q, low = (CUBIC_ERROR * least - near) / (1 + CUBIC_ERROR), at = INFINITY;
  struct cubic c;
  int k;
  if (p + a / 3 < low || q - b / 3 < low) { /* a cubic is nowhere below its control points */
    c = cubic_of(p, a, q, b);
    for (k = 0; k < c.turns; ++k)
      if (value_of(&c, c.turn[k]) < low) { at = c.turn[k]; low = value_of(&c, at); }
  }
  if (at > 1 && a < 0 && b > 0) { /* a kink, of which a cubic shows little, if one of the tangents leads below zero */
    double meet = (q - p - b) / (a - b);
    if (p + a * meet < -near || (least > near && (p + a < -near || q - b < -near)))
      at = meet < NEAREST ? NEAREST : meet > 1 - NEAREST ? 1 - NEAREST : meet;
  }
  return at;
}
