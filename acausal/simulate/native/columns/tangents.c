/* The Jacobian of a program of columns: derivatives of each value with respect to only the inputs on which it depends.

   The derivatives of a value are contiguous. An instruction computes those of its result from those of its operands. Mostly
   these depend on the same inputs; otherwise a map gives the positions. Values are those that `acausal_columns` has computed. */

/* `Tangents` of tangents.py, field by field. */
struct tangents {
  count_t instructions, stores;
  const int *op, *own, *a, *b;                 /* of each instruction: operation, and indices of values */
  const int *to, *count;                       /* its derivatives: index at which they begin, and number */
  const int *of_a, *count_a, *of_b, *count_b;  /* those of the operands; negative if there are none */
  const int *map_a, *map_b;                    /* indices at which the maps begin; negative if none is needed */
  const int* maps;
  const int *store_of, *store_from, *store_to; /* entries of the Jacobian: start of a result's derivatives, source, target */
  const double* values;
  double* derivatives;
  char* none;                                  /* at the index where derivatives begin: whether all of them are zero now */
};

/* Derivatives of an operation with respect to its operands, with CasADi's conventions at kinks. */
INLINED void slopes(int op, double x, double y, double f, double* by_x, double* by_y) {
  switch (op) {
    case ADD: *by_x = *by_y = 1.0; break;
    case SUB: *by_x = 1.0; *by_y = -1.0; break;
    case MUL: *by_x = y; *by_y = x; break;
    case DIV: *by_x = 1.0 / y; *by_y = -f / y; break;
    case NEG: *by_x = -1.0; break;
    case COPY: *by_x = 1.0; break;
    case TWICE: *by_x = 2.0; break;
    case SQ: *by_x = 2.0 * x; break;
    case SQRT: *by_x = 0.5 / f; break;
    case EXP: *by_x = f; break;
    case LOG: *by_x = 1.0 / x; break;
    case INV: *by_x = -f * f; break;
    case SIN: *by_x = cos(x); break;
    case COS: *by_x = -sin(x); break;
    case TAN: *by_x = 1.0 + f * f; break;
    case ASIN: *by_x = 1.0 / sqrt(1.0 - x * x); break;
    case ACOS: *by_x = -1.0 / sqrt(1.0 - x * x); break;
    case ATAN: *by_x = 1.0 / (1.0 + x * x); break;
    case SINH: *by_x = cosh(x); break;
    case COSH: *by_x = sinh(x); break;
    case TANH: *by_x = 1.0 - f * f; break;
    case FABS: *by_x = x < 0.0 ? -1.0 : x > 0.0 ? 1.0 : 0.0; break;
    case IF: *by_x = 0.0; *by_y = x != 0.0; break;
    case FMIN: *by_x = x <= y; *by_y = !(x <= y); break;
    case FMAX: *by_x = x >= y; *by_y = !(x >= y); break;
    case POW: *by_x = y * pow(x, y - 1.0); *by_y = log(x) * f; break;
    case FMOD: *by_x = 1.0; *by_y = (f - x) / y; break;
    case COPYSIGN: *by_x = copysign(1.0, x) * copysign(1.0, y); *by_y = 0.0; break;
    case ATAN2: *by_x = y / (x * x + y * y); *by_y = -x / (x * x + y * y); break;
    case HYPOT: *by_x = x / f; *by_y = y / f; break;
    default: *by_x = *by_y = 0.0; /* steps: their value does not change, or jumps */
  }
}

INLINED void assign_scaled(double* restrict to, int n, double slope, const double* restrict from, int count, const int* map) {
  int k;
  if (map) {
    memset(to, 0, n * sizeof(double));
    for (k = 0; k < count; ++k) to[map[k]] = slope * from[k];
  } else for (k = 0; k < n; ++k) to[k] = slope * from[k];
}

INLINED void add_scaled(double* restrict to, double slope, const double* restrict from, int count, const int* map) {
  int k;
  if (map) for (k = 0; k < count; ++k) to[map[k]] += slope * from[k];
  else for (k = 0; k < count; ++k) to[k] += slope * from[k];
}

/* Whether an operand has derivatives: a branch that is not selected has none, even if the slope at its value is infinite. */
INLINED int has_derivatives(const struct tangents* g, int of) { return of >= 0 && !g->none[of]; }

VECTORISED void acausal_tangents(const struct tangents* g, double* wanted) {
  count_t i;
  for (i = 0; i < g->instructions; ++i) {
    int n = g->count[i], of_a = g->of_a[i], of_b = g->of_b[i], k;
    int has_a = has_derivatives(g, of_a), has_b = has_derivatives(g, of_b);
    const int* map_a = g->map_a[i] < 0 ? 0 : g->maps + g->map_a[i];
    const int* map_b = g->map_b[i] < 0 ? 0 : g->maps + g->map_b[i];
    double* restrict to = g->derivatives + g->to[i];
    const double* da = g->derivatives + of_a;
    const double* db = g->derivatives + of_b;
    double by_a = 0.0, by_b = 0.0;
    if (has_a || has_b) slopes(g->op[i], g->values[g->a[i]], g->values[g->b[i]], g->values[g->own[i]], &by_a, &by_b);
    has_a &= by_a != 0.0;
    has_b &= by_b != 0.0;
    g->none[g->to[i]] = !has_a && !has_b;
    if (has_a && has_b && !map_a && !map_b) for (k = 0; k < n; ++k) to[k] = by_a * da[k] + by_b * db[k];
    else if (has_a && has_b && map_a && !map_b) {
      assign_scaled(to, n, by_b, db, n, 0);
      add_scaled(to, by_a, da, g->count_a[i], map_a);
    } else if (has_a) {
      assign_scaled(to, n, by_a, da, g->count_a[i], map_a);
      if (has_b) add_scaled(to, by_b, db, g->count_b[i], map_b);
    } else if (has_b) assign_scaled(to, n, by_b, db, g->count_b[i], map_b);
  }
  for (i = 0; i < g->stores; ++i) wanted[g->store_to[i]] = g->none[g->store_of[i]] ? 0.0 : g->derivatives[g->store_from[i]];
}
