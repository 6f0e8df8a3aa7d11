/* The regulator of large stages; regulator.py says what it solves and which routines of BLAS and LAPACK it is given.
   Matrices are stored column after column; of symmetric ones the lower triangle is computed. A stage's matrices are
   [Q S^T; S R], [A B] and [C D]^T. */
#include <math.h>
#include <string.h>

typedef void (*gemm_t)(char*, char*, int*, int*, int*, double*, double*, int*, double*, int*, double*, double*, int*);
typedef void (*gemv_t)(char*, int*, int*, double*, double*, int*, double*, int*, double*, double*, int*);
typedef void (*symv_t)(char*, int*, double*, double*, int*, double*, int*, double*, double*, int*);
typedef void (*syrk_t)(char*, char*, int*, int*, double*, double*, int*, double*, double*, int*);
typedef void (*trsm_t)(char*, char*, char*, char*, int*, int*, double*, double*, int*, double*, int*);
typedef void (*potrf_t)(char*, int*, double*, int*, int*);

/* Returns 0, or 1 + the stage whose Hessian in the controls is not positive definite. */
__attribute__((visibility("default"))) int lgmpc_regulator(void** frame) {
  const long long *plan = frame[0], *places = frame[1];
  double *values = frame[2], *stages = frame[3], *factors = frame[4], *togo = frame[5], *slopes = frame[6];
  double *work = frame[7], *weights = frame[8], *last_hessian = frame[9], *last_gradient = frame[10];
  double *gradient = frame[11], *gaps = frame[12], *dx0 = frame[13], *targets = frame[14], *dxs = frame[15];
  double *dus = frame[16], *costates = frame[17], *rows = frame[18], *cost = frame[19], *multipliers = frame[20];
  double *residual = frame[21];
  gemm_t gemm = (gemm_t) frame[22];
  gemv_t gemv = (gemv_t) frame[23];
  symv_t symv = (symv_t) frame[24];
  syrk_t syrk = (syrk_t) frame[25];
  trsm_t trsm = (trsm_t) frame[26];
  potrf_t potrf = (potrf_t) frame[27];
  int n = (int) plan[0], nx = (int) plan[1], nu = (int) plan[2], ng = (int) plan[3], mode = (int) plan[6];
  long long size = plan[4], entries = plan[5], e;
  int w = nx + nu, half = w / 2, rest = w - w / 2, one = 1, info = 0, used, i, j;
  long long block = (long long) w * (w + nx + ng), t;
  double plus = 1, minus = -1, zero = 0;
  double *product = work, *scaled = product + nx * w, *g = scaled + ng * w, *pull = g + w, *z = pull + ng, *hz = z + w;

  if (mode == 0) {
    for (t = 0; t < n; ++t)
      for (e = 0; e < entries; ++e) stages[t * block + places[2 * e + 1]] = values[t * size + places[2 * e]];
    return 0;
  }
  if (mode == 3) {
    for (t = 0; t < n; ++t) {
      double *h = stages + t * block, *f = h + w * w, *c = f + nx * w, *out = residual + t * w;
      memcpy(z, dxs + t * nx, sizeof(double) * nx);
      memcpy(z + nx, dus + t * nu, sizeof(double) * nu);
      memcpy(out, gradient + t * w, sizeof(double) * w);
      symv("L", &w, &plus, h, &w, z, &one, &plus, out, &one);
      gemv("T", &nx, &w, &plus, f, &nx, costates + t * nx, &one, &plus, out, &one);
      if (ng) gemv("N", &w, &ng, &plus, c, &w, multipliers + t * ng, &one, &plus, out, &one);
      for (i = 0; i < nx; ++i) out[i] = t ? out[i] - costates[(t - 1) * nx + i] : 0;
    }
    return 0;
  }

  memcpy(togo + (long long) n * nx * nx, last_hessian, sizeof(double) * nx * nx);
  memcpy(slopes + n * nx, last_gradient, sizeof(double) * nx);
  for (t = n - 1; t >= 0; --t) {
    double *h = stages + t * block, *f = h + w * w, *c = f + nx * w, *next = togo + (t + 1) * nx * nx;
    double *k = factors + t * w * w, *quu = k + nx + (long long) nx * w, *qux = k + nx;
    double *weight = weights + t * ng, *target = targets + t * ng, *slope = slopes + t * nx, *du = dus + t * nu;
    double *b = gaps + t * nx, *q = gradient + t * w;
    if (mode == 1) {
      double *p = togo + t * nx * nx;
      gemm("N", "N", &nx, &w, &nx, &plus, next, &nx, f, &nx, &zero, product, &nx);
      memcpy(k, h, sizeof(double) * w * w);
      gemm("T", "N", &w, &half, &nx, &plus, f, &nx, product, &nx, &plus, k, &w);
      gemm("T", "N", &rest, &rest, &nx, &plus, f + half * nx, &nx, product + half * nx, &nx, &plus,
           k + half * (w + 1), &w);
      for (used = 0, i = 0; i < ng; ++i)
        if (weight[i] != 0) {
          double root = sqrt(weight[i]), *to = scaled + w * used++, *from = c + w * i;
          for (j = 0; j < w; ++j) to[j] = root * from[j];
        }
      if (used) syrk("L", "N", &w, &used, &plus, scaled, &w, &plus, k, &w);
      if (nu) {
        potrf("L", &nu, quu, &w, &info);
        if (info) return (int) t + 1;
        trsm("L", "L", "N", "N", &nu, &nx, &plus, quu, &w, qux, &w);
        syrk("L", "T", &nx, &nu, &minus, qux, &w, &plus, k, &w);
      }
      for (j = 0; j < nx; ++j)
        for (i = j; i < nx; ++i) p[i + j * nx] = p[j + i * nx] = k[i + j * w];
    }
    memcpy(product, slopes + (t + 1) * nx, sizeof(double) * nx);
    gemv("N", &nx, &nx, &plus, next, &nx, b, &one, &plus, product, &one);
    memcpy(g, q, sizeof(double) * w);
    gemv("T", &nx, &w, &plus, f, &nx, product, &one, &plus, g, &one);
    if (ng) {
      for (i = 0; i < ng; ++i) pull[i] = -weight[i] * target[i];
      gemv("N", &w, &ng, &plus, c, &w, pull, &one, &plus, g, &one);
    }
    memcpy(slope, g, sizeof(double) * nx);
    if (nu) {
      memcpy(du, g + nx, sizeof(double) * nu);
      trsm("L", "L", "N", "N", &nu, &one, &plus, quu, &w, du, &nu);
      gemv("T", &nu, &nx, &minus, qux, &w, du, &one, &plus, slope, &one);
    }
  }

  memcpy(dxs, dx0, sizeof(double) * nx);
  *cost = 0;
  for (t = 0; t < n; ++t) {
    double *h = stages + t * block, *f = h + w * w, *c = f + nx * w, *next = togo + (t + 1) * nx * nx;
    double *k = factors + t * w * w, *quu = k + nx + (long long) nx * w, *qux = k + nx;
    double *dx = dxs + t * nx, *after = dx + nx, *du = dus + t * nu, *costate = costates + t * nx;
    double *b = gaps + t * nx, *q = gradient + t * w;
    if (nu) {
      gemv("N", &nu, &nx, &plus, qux, &w, dx, &one, &plus, du, &one);
      trsm("L", "L", "T", "N", &nu, &one, &minus, quu, &w, du, &nu);
    }
    memcpy(z, dx, sizeof(double) * nx);
    memcpy(z + nx, du, sizeof(double) * nu);
    memcpy(after, b, sizeof(double) * nx);
    gemv("N", &nx, &w, &plus, f, &nx, z, &one, &plus, after, &one);
    memcpy(costate, slopes + (t + 1) * nx, sizeof(double) * nx);
    gemv("N", &nx, &nx, &plus, next, &nx, after, &one, &plus, costate, &one);
    if (ng) gemv("T", &w, &ng, &plus, c, &w, z, &one, &zero, rows + t * ng, &one);
    symv("L", &w, &plus, h, &w, z, &one, &zero, hz, &one);
    for (i = 0; i < w; ++i) *cost += (0.5 * hz[i] + q[i]) * z[i];
  }
  symv("L", &nx, &plus, last_hessian, &nx, dxs + n * nx, &one, &zero, hz, &one);
  for (i = 0; i < nx; ++i) *cost += (0.5 * hz[i] + last_gradient[i]) * dxs[n * nx + i];
  return 0;
}
