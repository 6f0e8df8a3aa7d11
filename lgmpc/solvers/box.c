/* What surrounds the sweep of lgmpc.solvers.box: fixing controls, the minimiser, the slopes. Rows of matrices are
   contiguous: those of a Jacobian are the columns of [A B]. */

#include <string.h>

#ifdef __GNUC__
  #define EXPORT __attribute__((visibility("default")))
  #pragma GCC optimize ("O3")
#else
  #define EXPORT
#endif

typedef struct {
  const long long* plan; /* N, nx, nu, whether all gaps are zero */
  const double *jacobian, *hessian, *gradient, *gaps, *feedback, *feedforward, *value_hessian, *value_gradient;
  const long long* held;
  const double *move, *regularization;
  double *fixed_jacobian, *fixed_hessian, *fixed_gradient, *fixed_gaps, *dxs, *dus, *slopes, *costate;
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

/* Writes the model in which controls change by `move`, and those held by nothing else. */
EXPORT void lgmpc_fix(const Frame* f) {
  const long n = f->plan[0], nx = f->plan[1], nu = f->plan[2], w = nx + nu;
  long t, i, c;
  memcpy(f->fixed_jacobian, f->jacobian, sizeof(double) * n * w * nx);
  memcpy(f->fixed_hessian, f->hessian, sizeof(double) * n * w * w);
  memcpy(f->fixed_gradient, f->gradient, sizeof(double) * n * w);
  if (f->plan[3]) memset(f->fixed_gaps, 0, sizeof(double) * (n + 1) * nx);
  else memcpy(f->fixed_gaps, f->gaps, sizeof(double) * (n + 1) * nx);
  for (t = 0; t < n; ++t) {
    double *jacobian = f->fixed_jacobian + t * w * nx, *hessian = f->fixed_hessian + t * w * w;
    double *gradient = f->fixed_gradient + t * w, *gap = f->fixed_gaps + (t + 1) * nx;
    for (c = 0; c < nu; ++c) {
      const double move = f->move[t * nu + c];
      if (move == 0) continue;
      add(w, move, f->hessian + (t * w + nx + c) * w, gradient);
      add(nx, move, f->jacobian + (t * w + nx + c) * nx, gap);
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
}

/* Writes the minimiser under the sweep's gains. */
EXPORT void lgmpc_follow(const Frame* f) {
  const long n = f->plan[0], nx = f->plan[1], nu = f->plan[2], w = nx + nu;
  long t, i, c;
  memcpy(f->dxs, f->fixed_gaps, sizeof(double) * (n + 1) * nx);
  for (t = 0; t < n; ++t) {
    const double *dx = f->dxs + t * nx, *jacobian = f->fixed_jacobian + t * w * nx;
    double *next = f->dxs + (t + 1) * nx, *du = f->dus + t * nu;
    for (c = 0; c < nu; ++c) du[c] = -f->feedforward[t * nu + c] - dot(nx, f->feedback + (t * nu + c) * nx, dx);
    for (i = 0; i < nx; ++i) add(nx, dx[i], jacobian + i * nx, next);
    for (c = 0; c < nu; ++c) add(nx, du[c], jacobian + (nx + c) * nx, next);
  }
}

/* Writes the regularised model's gradient by the controls at the minimiser. The sweep's gradients are those with closed
   gaps. */
EXPORT void lgmpc_slopes(const Frame* f) {
  const long n = f->plan[0], nx = f->plan[1], nu = f->plan[2], w = nx + nu;
  long t, i, c;
  for (t = 0; t < n; ++t) {
    const double *dx = f->dxs + t * nx, *du = f->dus + t * nu, *next = f->dxs + (t + 1) * nx;
    const double* gap = f->fixed_gaps + (t + 1) * nx;
    memcpy(f->costate, f->value_gradient + (t + 1) * nx, sizeof(double) * nx);
    for (i = 0; i < nx; ++i) add(nx, next[i] - gap[i], f->value_hessian + ((t + 1) * nx + i) * nx, f->costate);
    for (c = 0; c < nu; ++c) {
      const long row = t * w + nx + c;
      const double* hessian = f->hessian + row * w;
      f->slopes[t * nu + c] = f->gradient[row] + dot(nx, hessian, dx) + dot(nu, hessian + nx, du)
        + *f->regularization * du[c] + dot(nx, f->jacobian + row * nx, f->costate);
    }
  }
}
