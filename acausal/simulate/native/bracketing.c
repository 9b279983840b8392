/* Search for points between two points of a solution at which a guard may be passed.

   A guard is passed if its sign changes. It may be passed there and back if the tangents at both ends meet near zero (a
   kink, `abs(x) < 1e-3`), or if the Hermite cubic goes below zero. Such an interval gets another point, at the crossing or
   at the minimum of the cubic. If a guard has a kink, `maximum(u, 1e-9)`, cubics may shorten the interval by only a
   thousandth at a time. So if an interval was not halved, the next point is at the zero of the right-hand tangent, and the
   one after that is the middle (R. P. Brent, Algorithms for Minimization without Derivatives, 1973, chapter 4). New points
   are integrated and not interpolated, because dense output of stiff components is wrong by thousands of tolerances. */

#include <string.h>

#define LOW 0.05 /* no tangent is used that leads closer to the left node than this fraction of the interval */

/* A point of the solution: states, and of each guard its distance, its rate, and its noise. */
struct node {
  double t, *x, *above, *rate, *noise;
};

static double most(double a, double b) { return a > b ? a : b; }

/* The first point at which a cubic from p >= 0 to below zero falls below zero. */
static double first_zero_of(const struct cubic* c) {
  double low = 0.0, high = 1.0;
  int k;
  for (k = 0; k <= c->turns; ++k) {
    high = k < c->turns ? c->turn[k] : 1.0;
    if (value_of(c, high) < 0) break;
    low = high;
  }
  for (k = 0; k < 60; ++k) {
    double middle = 0.5 * (low + high);
    if (value_of(c, middle) < 0) high = middle;
    else low = middle;
  }
  return 0.5 * (low + high);
}

/* The first time between two nodes at which a guard may be passed; INFINITY if there is none. With `by_tangent`, after
   cubics have failed, guards that were passed are searched where their tangents at the right node are zero. Guards that are
   `away` exceed their noise at the ends of the interval that contains this one. */
static double next_candidate(long long relations, const struct node* left, const struct node* right, int is_there, int by_tangent,
                             const unsigned char* away) {
  double width = right->t - left->t, found = INFINITY;
  long long k;
  for (k = 0; k < relations; ++k) {
    double p = left->above[k], q = right->above[k], a = left->rate[k] * width, b = right->rate[k] * width;
    double near = away[k] ? 0.0 : STILL * most(left->noise[k], right->noise[k]), at = INFINITY;
    if (q < 0) {
      if (is_there) continue;
      if (by_tangent && b < 0 && 1 - q / b > LOW) at = 1 - q / b;
      else {
        struct cubic c = cubic_of(p, a, q, b);
        at = first_zero_of(&c);
      }
    } else at = dip_of(p, a, q, b, near);
    if (left->t + width * at < found) found = left->t + width * at;
  }
  return found;
}

static void copy_node(long long states, long long relations, const struct node* from, struct node* to) {
  to->t = from->t;
  memcpy(to->x, from->x, states * sizeof(double));
  memcpy(to->above, from->above, relations * sizeof(double));
  memcpy(to->rate, from->rate, relations * sizeof(double));
  memcpy(to->noise, from->noise, relations * sizeof(double));
}

