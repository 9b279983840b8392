/* Evaluation of a function by columns, each instruction for all of its equal parts together.

   A program lists columns: the operation, the number of entries, where results go, and where operands are: contiguous, or in a
   list of indices. One library serves the programs of all models, as the compiled code does not depend on a model. */

#include <math.h>
#include <string.h>

typedef long long count_t;

/* Use the vector instructions of the machine at run time, if the compiler supports that. Results are identical. */
#if defined(__GNUC__) && !defined(__clang__) && defined(__x86_64__) && defined(__GLIBC__)
#define VECTORISED __attribute__((target_clones("avx512f", "avx2", "default")))
#define INLINED static inline __attribute__((always_inline))
#else
#define VECTORISED
#define INLINED static
#endif

/* Operations, in the order of columns.py. */
enum { NEG, EXP, LOG, SQRT, SQ, TWICE, SIN, COS, TAN, ASIN, ACOS, ATAN, NOT, FLOOR, CEIL, FABS, SIGN, INV, SINH, COSH, TANH, COPY,
       ADD, SUB, MUL, DIV, POW, LT, LE, EQ, NE, AND, OR, FMOD, COPYSIGN, IF, FMIN, FMAX, ATAN2, HYPOT };

/* `Program` of columns.py, field by field. */
struct program {
  count_t columns, loads, stores;
  const int *op, *size, *to, *a, *b; /* of each column; an operand is the index of its start, or -1 - that of its list */
  const int* places;                 /* lists: indices of values */
  const int *load_argument, *load_entry, *load_to;
  const int *store_result, *store_entry, *store_from;
  double* values;                    /* contains the constants already */
  double *left, *right;              /* memory for operands that are not contiguous */
};

INLINED const double* operand(const struct program* p, int at, int n, double* memory) {
  const double* values = p->values;
  const int* places;
  int k;
  if (at >= 0) return values + at;
  places = p->places - 1 - at;
  for (k = 0; k + 3 < n; k += 4) { /* four at a time, so that no load waits for a store */
    double first = values[places[k]], second = values[places[k + 1]], third = values[places[k + 2]], fourth = values[places[k + 3]];
    memory[k] = first, memory[k + 1] = second, memory[k + 2] = third, memory[k + 3] = fourth;
  }
  for (; k < n; ++k) memory[k] = values[places[k]];
  return memory;
}

/* A branch would be mispredicted. */
INLINED double value_if(double condition, double value) {
  union { double number; unsigned long long bits; } one;
  one.number = value;
  one.bits &= -(unsigned long long)(condition != 0.0);
  return one.number;
}

/* Like fmin and fmax, which compilers do not inline: nan is ignored if the other operand is a number. */
INLINED double least_of(double x, double y) { double found = x < y ? x : y; return y == y ? found : x; }
INLINED double largest_of(double x, double y) { double found = x > y ? x : y; return y == y ? found : x; }

/* In blocks, the last of which may have unused entries, so that no loop for a remainder is needed. */
#define BLOCK 8
#define EACH(value) for (first = 0; first < n; first += BLOCK) for (k = first; k < first + BLOCK; ++k) to[k] = value; break
#define ONE_BY_ONE(value) for (k = 0; k < n; ++k) to[k] = value; break

VECTORISED int acausal_columns(const struct program* p, const double** arg, double** res) {
  count_t c;
  for (c = 0; c < p->loads; ++c) {
    const double* from = arg[p->load_argument[c]];
    p->values[p->load_to[c]] = from ? from[p->load_entry[c]] : 0.0;
  }
  for (c = 0; c < p->columns; ++c) {
    int n = p->size[c], first, k;
    double* restrict to = p->values + p->to[c];
    const double* x = operand(p, p->a[c], n, p->left);
    const double* y = p->b[c] == p->a[c] ? x : operand(p, p->b[c], n, p->right);
    switch (p->op[c]) {
      case ADD: EACH(x[k] + y[k]);
      case SUB: EACH(x[k] - y[k]);
      case MUL: EACH(x[k] * y[k]);
      case DIV: EACH(x[k] / y[k]);
      case NEG: EACH(-x[k]);
      case EXP: ONE_BY_ONE(exp(x[k]));
      case LOG: ONE_BY_ONE(log(x[k]));
      case POW: ONE_BY_ONE(pow(x[k], y[k]));
      case SQRT: EACH(sqrt(x[k]));
      case SQ: EACH(x[k] * x[k]);
      case TWICE: EACH(2.0 * x[k]);
      case SIN: ONE_BY_ONE(sin(x[k]));
      case COS: ONE_BY_ONE(cos(x[k]));
      case TAN: ONE_BY_ONE(tan(x[k]));
      case ASIN: ONE_BY_ONE(asin(x[k]));
      case ACOS: ONE_BY_ONE(acos(x[k]));
      case ATAN: ONE_BY_ONE(atan(x[k]));
      case LT: EACH(x[k] < y[k]);
      case LE: EACH(x[k] <= y[k]);
      case EQ: EACH(x[k] == y[k]);
      case NE: EACH(x[k] != y[k]);
      case NOT: EACH(x[k] == 0.0);
      case AND: EACH((x[k] != 0.0) & (y[k] != 0.0));
      case OR: EACH((x[k] != 0.0) | (y[k] != 0.0));
      case FLOOR: ONE_BY_ONE(floor(x[k]));
      case CEIL: ONE_BY_ONE(ceil(x[k]));
      case FMOD: ONE_BY_ONE(fmod(x[k], y[k]));
      case FABS: EACH(fabs(x[k]));
      case SIGN: EACH(x[k] < 0.0 ? -1.0 : x[k] > 0.0 ? 1.0 : x[k]);
      case COPYSIGN: ONE_BY_ONE(copysign(x[k], y[k]));
      case IF: EACH(value_if(x[k], y[k]));
      case FMIN: EACH(least_of(x[k], y[k]));
      case FMAX: EACH(largest_of(x[k], y[k]));
      case INV: EACH(1.0 / x[k]);
      case SINH: ONE_BY_ONE(sinh(x[k]));
      case COSH: ONE_BY_ONE(cosh(x[k]));
      case TANH: ONE_BY_ONE(tanh(x[k]));
      case ATAN2: ONE_BY_ONE(atan2(x[k], y[k]));
      case HYPOT: ONE_BY_ONE(hypot(x[k], y[k]));
      case COPY: EACH(x[k]);
      default: return 1;
    }
  }
  for (c = 0; c < p->stores; ++c) {
    double* into = res[p->store_result[c]];
    if (into) into[p->store_entry[c]] = p->values[p->store_from[c]];
  }
  return 0;
}
