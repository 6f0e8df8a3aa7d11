/* The sweep of lgmpc.solvers.box: active sets, each tried with one call of sweep.c. Rows of matrices are contiguous:
   those of a Jacobian are the columns of [A B]. */

#include <math.h>
#include <string.h>

#ifdef __GNUC__
  #define EXPORT __attribute__((visibility("default")))
  #pragma GCC optimize ("O3")
#else
  #define EXPORT
#endif

typedef struct {
  long long* plan; /* N, nx, nu, whether all gaps are zero, most exchanges */
  const double *jacobian, *hessian, *gradient, *gaps, *feedback;
  double* feedforward;
  const double *value_hessian, *value_gradient, *us, *u_lower, *u_upper, *regularization, *rounding;
  long long* held;
  double *fixed_jacobian, *fixed_hessian, *fixed_gradient, *fixed_gaps, *dxs, *dus, *costate, *expected;
  long long* changed; /* whether the held controls of an interval have changed */
  const double *last_hessian, *last_gradient;
  int (*sweep)(void**);
  void** sweep_frame;
  long long* sweep_plan; /* N, whether all gaps are zero, the interval to begin with */
} Frame;

static double dot(long n, const double* a, const double* b) {
  double sum = 0;
  long i;
  for (i = 0; i < n; ++i) sum += a[i] * b[i];
  return sum;
}

static void add(long n, double factor, const double* a, double* sum) {
  long i;
  for (i = 0; i < n; ++i) sum[i] += factor * a[i];
}

/* The change of a control that is held; zero of one that is free. */
static double move(const Frame* f, long at) {
  return f->held[at] > 0 ? f->u_upper[at] - f->us[at] : f->held[at] < 0 ? f->u_lower[at] - f->us[at] : 0;
}

/* Writes the model in which held controls change by their moves and nothing else, of the intervals that have changed;
   returns whether any moves. */
static int fix(const Frame* f) {
  const long n = f->plan[0], nx = f->plan[1], nu = f->plan[2], w = nx + nu;
  long t, i, c;
  int any = 0;
  for (t = 0; t < n; ++t) {
    double *jacobian = f->fixed_jacobian + t * w * nx, *hessian = f->fixed_hessian + t * w * w;
    double *gradient = f->fixed_gradient + t * w, *gap = f->fixed_gaps + (t + 1) * nx;
    if (!f->changed[t]) continue;
    f->changed[t] = 0;
    memcpy(jacobian, f->jacobian + t * w * nx, sizeof(double) * w * nx);
    memcpy(hessian, f->hessian + t * w * w, sizeof(double) * w * w);
    memcpy(gradient, f->gradient + t * w, sizeof(double) * w);
    if (f->plan[3]) memset(gap, 0, sizeof(double) * nx);
    else memcpy(gap, f->gaps + (t + 1) * nx, sizeof(double) * nx);
    for (c = 0; c < nu; ++c) {
      const double by = move(f, t * nu + c);
      if (by == 0) continue;
      any = 1;
      add(w, by, f->hessian + (t * w + nx + c) * w, gradient);
      add(nx, by, f->jacobian + (t * w + nx + c) * nx, gap);
    }
    for (c = 0; c < nu; ++c) {
      if (!f->held[t * nu + c]) continue;
      memset(jacobian + (nx + c) * nx, 0, sizeof(double) * nx);
      memset(hessian + (nx + c) * w, 0, sizeof(double) * w);
      for (i = 0; i < w; ++i) hessian[i * w + nx + c] = 0;
      hessian[(nx + c) * (w + 1)] = 1;
      gradient[nx + c] = 0;
    }
  }
  return any;
}

/* Writes the minimiser under the sweep's gains; returns whether it is finite. */
static int follow(const Frame* f) {
  const long n = f->plan[0], nx = f->plan[1], nu = f->plan[2], w = nx + nu;
  long t, i, c;
  memcpy(f->dxs, f->fixed_gaps, sizeof(double) * (n + 1) * nx);
  for (t = 0; t < n; ++t) {
    const double *dx = f->dxs + t * nx, *jacobian = f->fixed_jacobian + t * w * nx;
    double *next = f->dxs + (t + 1) * nx, *du = f->dus + t * nu;
    for (c = 0; c < nu; ++c) {
      if (f->held[t * nu + c]) f->feedforward[t * nu + c] = -move(f, t * nu + c);
      du[c] = -f->feedforward[t * nu + c] - dot(nx, f->feedback + (t * nu + c) * nx, dx);
    }
    for (i = 0; i < nx; ++i) add(nx, dx[i], jacobian + i * nx, next);
    for (c = 0; c < nu; ++c) add(nx, du[c], jacobian + (nx + c) * nx, next);
  }
  return isfinite(dot((n + 1) * nx, f->dxs, f->dxs));
}

/* The regularised model's gradient by a control at the minimiser; f->costate is that behind the stage. */
static double slope(const Frame* f, long t, long c) {
  const long nx = f->plan[1], nu = f->plan[2], w = nx + nu, row = t * w + nx + c;
  const double *hessian = f->hessian + row * w, *du = f->dus + t * nu;
  return f->gradient[row] + dot(nx, hessian, f->dxs + t * nx) + dot(nu, hessian + nx, du)
    + *f->regularization * du[c] + dot(nx, f->jacobian + row * nx, f->costate);
}

/* Holds free controls beyond their bounds, frees held ones whose gradient points inwards; returns the last interval that
   has changed, -1 if none has. */
static long exchange(const Frame* f) {
  const long n = f->plan[0], nx = f->plan[1], nu = f->plan[2];
  long t, i, c, changed = -1;
  for (t = 0; t < n; ++t) {
    int known = 0;
    for (c = 0; c < nu; ++c) {
      const long at = t * nu + c;
      const double low = f->u_lower[at] - f->us[at], high = f->u_upper[at] - f->us[at];
      const double rounding = *f->rounding * (1 + fabs(f->us[at]));
      if (f->held[at] == 0) {
        if (f->dus[at] > high + rounding) f->held[at] = 1;
        else if (f->dus[at] < low - rounding) f->held[at] = -1;
        if (f->held[at]) f->changed[changed = t] = 1;
      } else if (low != high) {
        if (!known) { /* the sweep's gradients are those with closed gaps */
          const double *next = f->dxs + (t + 1) * nx, *gap = f->fixed_gaps + (t + 1) * nx;
          memcpy(f->costate, f->value_gradient + (t + 1) * nx, sizeof(double) * nx);
          for (i = 0; i < nx; ++i) add(nx, next[i] - gap[i], f->value_hessian + ((t + 1) * nx + i) * nx, f->costate);
          known = 1;
        }
        if (f->held[at] * slope(f, t, c) > 0) {
          f->held[at] = 0;
          f->changed[changed = t] = 1;
        }
      }
    }
  }
  return changed;
}

/* Writes the linear and the quadratic part of the model's decrease along the minimiser. */
static void expect(const Frame* f) {
  const long n = f->plan[0], nx = f->plan[1], nu = f->plan[2], w = nx + nu;
  long t, i;
  double linear = 0, quadratic = 0;
  for (t = 0; t < n; ++t) {
    const double *dx = f->dxs + t * nx, *du = f->dus + t * nu, *g = f->gradient + t * w;
    linear += dot(nx, g, dx) + dot(nu, g + nx, du);
    for (i = 0; i < w; ++i) {
      const double* row = f->hessian + (t * w + i) * w;
      quadratic += (i < nx ? dx[i] : du[i - nx]) * (dot(nx, row, dx) + dot(nu, row + nx, du));
    }
  }
  const double* last = f->dxs + n * nx;
  linear += dot(nx, f->last_gradient, last);
  for (i = 0; i < nx; ++i) quadratic += last[i] * dot(nx, f->last_hessian + i * nx, last);
  f->expected[0] = -linear;
  f->expected[1] = -quadratic;
}

/* Returns 0 if the active set converged. */
EXPORT int lgmpc_box(const Frame* f) {
  const long n = f->plan[0], all = n * f->plan[2];
  long long i, round;
  long last = n - 1;
  int moved = 0;
  for (i = 0; i < all; ++i)
    if (f->u_lower[i] == f->u_upper[i]) f->held[i] = 1;
  for (i = 0; i < n; ++i) f->changed[i] = 1;
  if (f->plan[3]) memset(f->fixed_gaps, 0, sizeof(double) * f->plan[1]);
  else memcpy(f->fixed_gaps, f->gaps, sizeof(double) * f->plan[1]);
  for (round = 0; round < f->plan[4]; ++round) {
    moved |= fix(f);
    f->sweep_plan[1] = f->plan[3] && !moved;
    f->sweep_plan[2] = last + 1 < n ? last + 1 : n - 1; /* the gap behind the changed interval has changed too */
    if (f->sweep(f->sweep_frame) || !follow(f)) return 1;
    last = exchange(f);
    if (last < 0) {
      expect(f);
      return 0;
    }
  }
  return 1;
}
