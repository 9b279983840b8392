/* ThickBlock as somebody would write it for CVODE: states s, v, s_tar [mm], right-hand side in C, dense Jacobian by
   differences inside CVODE, restarted at the corners of the profiles. The line force q solves a scalar monotone
   equation at each evaluation, by Newton's method from its last value.

   Usage: thick_block RTOL REPEAT; prints seconds of a run (median), steps, evaluations, s and s_tar [m] at the end. */
#include <cvode/cvode.h>
#include <math.h>
#include <nvector/nvector_serial.h>
#include <stdio.h>
#include <stdlib.h>
#include <sunlinsol/sunlinsol_dense.h>
#include <sunmatrix/sunmatrix_dense.h>
#include <time.h>

static const double PI = 3.14159265358979323846;
static const double Z_E = 2, D = 0.016, T_BLOCK = 0.05, K = 1e8, D_C = 2e4, M = 5, GAP = 1e-3;
static const double K_C11 = 2240e6, Z = 0.21, H_MIN = 1e-6, H_1 = 1e-3, W_MIN = 1e-9;
static double SIGMA, SLOPE, H_C, SIN2, SINS, EDGES, POWER, LOW;

typedef struct { double t0, f0, df, n0, dn, q; long calls; } Segment;

static double clamp(double x, double a, double b) { return x < a ? a : x > b ? b : x; }

/* Feed of one edge for a line force, and its derivative. */
static double feed(double x, double* slope) {
  double share, a, b;
  if (x <= 0) { *slope = LOW * H_1 / (K_C11 * H_1); return 0; }
  share = x / (K_C11 * H_1);
  a = H_1 * pow(share * pow(SIN2, Z), POWER);
  b = H_1 * share * LOW;
  if (a > b) { *slope = POWER * a / x; return a; }
  *slope = b / x;
  return b;
}

static int rates(sunrealtype t, N_Vector y, N_Vector ydot, void* user) {
  Segment* g = user;
  double *Y = N_VGetArrayPointer(y), *R = N_VGetArrayPointer(ydot);
  double s = Y[0], v = Y[1], s_tar = Y[2] * 1e-3, q = g->q, n = g->n0 + g->dn * (t - g->t0), f = g->f0 + g->df * (t - g->t0);
  double width = 2 * SLOPE * clamp(s, 0, H_C) - 2 * SLOPE * clamp(s - T_BLOCK, 0, H_C);
  double w = width + (s < 0 ? -2 * SLOPE * s : 0), fz = 0, slope, back, slope_back, r, dr, dq, h, kc, force;
  int k;
  if (w < W_MIN) w = W_MIN;
  for (k = 0; k < 60; ++k) {
    fz = feed((q > 0 ? q : 0) / EDGES, &slope);
    back = feed((q < 0 ? -q : 0) / EDGES, &slope_back);
    if (q < 0) slope = 0; else slope_back = 0;
    r = K * (s - s_tar) + D_C * (v - Z_E * n * (fz - back)) - w * q;
    dr = -D_C * Z_E * n * (slope + slope_back) / EDGES - w;
    dq = -r / dr;
    q += dq;
    if (fabs(dq) <= 1e-12 * (1 + fabs(q))) break;
  }
  g->q = q;
  g->calls++;
  fz = feed((q > 0 ? q : 0) / EDGES, &slope);
  h = fz * SIN2;
  kc = K_C11 * pow((h > H_MIN ? h : H_MIN) / H_1, -Z);
  force = SINS * Z_E * width / 2 * fz * kc;
  R[0] = v;
  R[1] = (f - force) / M;
  R[2] = s > 0 ? Z_E * n * fz * 1e3 : 0;
  return 0;
}

static int by_size(const void* a, const void* b) {
  double x = *(const double*) a, y = *(const double*) b;
  return (x > y) - (x < y);
}

int main(int argc, char** argv) {
  static const double FT[] = {0, 1, 2, 20, 22, 34, 35, 40}, F[] = {0, 0, 2000, 2000, 4000, 4000, 500, 500};
  static const double NT[] = {0, 5, 6, 28, 29, 36, 37, 40}, N[] = {0, 0, 9.28, 9.28, 4.64, 4.64, 0, 0};
  static const double T[] = {0, 1, 2, 5, 6, 20, 22, 28, 29, 34, 35, 36, 37, 40};
  double rtol = atof(argv[1]), all[1000], out[5][2];
  static const double CHECK[] = {1.5, 6, 10, 20, 30};
  int repeat = argc > 2 ? atoi(argv[2]) : 1, i, k, j, c;  /* at most 1000 */
  long steps = 0, calls = 0;
  SUNContext context;
  SIGMA = 118 * PI / 180; SLOPE = tan(SIGMA / 2); H_C = D / (2 * SLOPE); SIN2 = sin(SIGMA / 2); SINS = sin(SIGMA);
  EDGES = SINS * Z_E / 2; POWER = 1 / (1 - Z); LOW = pow(H_MIN / H_1, Z);
  if (SUNContext_Create(NULL, &context)) return 1;
  for (i = 0; i < repeat; ++i) {
    struct timespec a, b;
    N_Vector y = N_VNew_Serial(3, context), tol = N_VNew_Serial(3, context);
    double *Y = N_VGetArrayPointer(y), *A = N_VGetArrayPointer(tol), seconds, t;
    Segment g = {0, 0, 0, 0, 0, 0, 0};
    void* memory = CVodeCreate(CV_BDF, context);
    SUNMatrix matrix = SUNDenseMatrix(3, 3, context);
    SUNLinearSolver solver = SUNLinSol_Dense(y, matrix, context);
    for (k = 0; k < 3; ++k) A[k] = 1e-3 * rtol;
    Y[0] = -GAP; Y[1] = 0; Y[2] = 0;
    g.q = -K / (2 * SLOPE);
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &a);
    CVodeInit(memory, rates, 0, y);
    CVodeSVtolerances(memory, rtol, tol);
    CVodeSetUserData(memory, &g);
    CVodeSetLinearSolver(memory, solver, matrix);
    CVodeSetMaxNumSteps(memory, 1000000);
    steps = 0;
    c = 0;
    for (k = 0; k + 1 < (int) (sizeof T / sizeof *T); ++k) {
      long inner;
      g.t0 = T[k];
      for (j = 0; FT[j + 1] <= T[k]; ++j) {}
      g.df = (F[j + 1] - F[j]) / (FT[j + 1] - FT[j]); g.f0 = F[j] + g.df * (T[k] - FT[j]);
      for (j = 0; NT[j + 1] <= T[k]; ++j) {}
      g.dn = (N[j + 1] - N[j]) / (NT[j + 1] - NT[j]); g.n0 = N[j] + g.dn * (T[k] - NT[j]);
      if (k) CVodeReInit(memory, T[k], y);
      CVodeSetStopTime(memory, T[k + 1]);
      for (; c < 5 && CHECK[c] < T[k + 1]; ++c) {
        if (CVode(memory, CHECK[c], y, &t, CV_NORMAL) < 0) { printf("failed at %g\n", t); return 2; }
        out[c][0] = Y[0]; out[c][1] = Y[2] * 1e-3;
      }
      if (CVode(memory, T[k + 1], y, &t, CV_NORMAL) < 0) { printf("failed at %g\n", t); return 2; }
      for (; c < 5 && CHECK[c] <= T[k + 1]; ++c) { out[c][0] = Y[0]; out[c][1] = Y[2] * 1e-3; }
      CVodeGetNumSteps(memory, &inner);
      steps += inner;
    }
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &b);
    seconds = (b.tv_sec - a.tv_sec) + 1e-9 * (b.tv_nsec - a.tv_nsec);
    all[i] = seconds;
    calls = g.calls;
    if (i == repeat - 1) {
      qsort(all, repeat, sizeof *all, by_size);
      printf("%.9g %ld %ld", all[repeat / 2], steps, calls);
      for (k = 0; k < 5; ++k) printf(" %.15g %.15g", out[k][0], out[k][1]);
      printf(" %.15g %.15g\n", Y[0], Y[2] * 1e-3);
    }
    CVodeFree(&memory); SUNLinSolFree(solver); SUNMatDestroy(matrix); N_VDestroy(y); N_VDestroy(tol);
  }
  return 0;
}
