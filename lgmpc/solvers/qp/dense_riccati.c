/* The Riccati solver of large stages; dense_riccati.py says what it solves. tiles.c comes before.

   A stage's matrices are H = [Q S^T; S R] (W rows), F = [A B] (X rows), F^T (W rows) and [C D]^T (W rows, a column for
   each row of the path constraint). Factors are the controls' columns of the eliminated Hessian (W rows) and the
   reciprocals of R's diagonal (see tiles.c). */

enum { LOAD, FACTOR, SOLVE, MEASURE };

INLINE double dot(long n, const double* a, const double* b) {
  double sum = 0;
  long i;
  for (i = 0; i < n; ++i) sum += a[i] * b[i];
  return sum;
}

EXPORT long long lgmpc_dense_riccati_tall(void) { return W; }
EXPORT long long lgmpc_dense_riccati_high(void) { return X; }
EXPORT long long lgmpc_dense_riccati_stage(long long ng) { return W * NW + X * NW + W * NX + W * ng; }
EXPORT long long lgmpc_dense_riccati_factors(void) { return W * NU + WHOLE(NU); }
EXPORT long long lgmpc_dense_riccati_togo(void) { return X * NX; }
EXPORT long long lgmpc_dense_riccati_work(long long ng) { return X * NW + W * (NW + LANES) + W * ng + 6 * W + WHOLE(ng); }

/* Returns 0, or 1 + the stage whose Hessian in the controls is not positive definite. */
EXPORT int lgmpc_dense_riccati(void** frame) {
  const long long *plan = frame[0], *places = frame[1];
  double *values = frame[2], *stages = frame[3], *factors = frame[4], *togo = frame[5], *slopes = frame[6];
  double *work = frame[7], *weights = frame[8], *last_hessian = frame[9], *last_gradient = frame[10];
  double *gradient = frame[11], *gaps = frame[12], *dx0 = frame[13], *targets = frame[14], *dxs = frame[15];
  double *dus = frame[16], *costates = frame[17], *path = frame[18], *cost = frame[19], *multipliers = frame[20];
  double* residual = frame[21];
  const long n = plan[0], ng = plan[1], mode = plan[4];
  const long long size = plan[2], entries = plan[3];
  const long block = lgmpc_dense_riccati_stage(ng), kept = lgmpc_dense_riccati_factors(), square = X * NX;
  double *p = work, *q = p + X * NW, *scaled = q + W * (NW + LANES), *g = scaled + W * ng, *z = g + W, *hz = z + W;
  double *s = hz + W, *k = s + W, *pull = k + 2 * W;
  long long e;
  long t, i, j, used;

  if (mode == LOAD) {
    for (t = 0; t < n; ++t) {
      double* stage = stages + t * block;
      for (e = 0; e < entries; ++e) stage[places[2 * e + 1]] = values[t * size + places[2 * e]];
      transpose(stage + W * NW, X, stage + W * NW + X * NW);
    }
    for (j = 0; j < NX; ++j) copy(last_hessian + j * NX, NX, togo + n * square + j * X);
    return 0;
  }
  if (mode == MEASURE) {
    for (t = 0; t < n; ++t) {
      const double *h = stages + t * block, *ft = h + W * NW + X * NW, *c = ft + W * NX;
      copy(dxs + t * NX, NX, z);
      copy(dus + t * NU, NU, z + NX);
      copy(gradient + t * NW, NW, g);
      strip(1, W, NW, 1.0, h, W, columns(z, W), g, W);
      strip(1, W, NX, 1.0, ft, W, columns(costates + t * NX, NX), g, W);
      strip(1, W, ng, 1.0, c, W, columns(multipliers + t * ng, ng), g, W);
      for (i = 0; i < NX; ++i) g[i] = t ? g[i] - costates[(t - 1) * NX + i] : 0;
      copy(g, NW, residual + t * NW);
    }
    return 0;
  }

  copy(last_gradient, NX, slopes + n * NX);
  for (t = n - 1; t >= 0; --t) {
    const double *h = stages + t * block, *f = h + W * NW, *ft = f + X * NW, *c = ft + W * NX;
    const double *weight = weights + t * ng, *target = targets + t * ng, *next = togo + (t + 1) * square;
    double *controls = factors + t * kept, *reciprocal = controls + W * NU;
    if (mode == FACTOR) {
      memset(p, 0, sizeof(double) * X * NW);
      multiply(X, NW, NX, 1.0, next, X, columns(f, X), p, X, 0);
      memcpy(q, h, sizeof(double) * W * NW);
      multiply(W, NW, NX, 1.0, ft, W, columns(p, X), q, W, 1);
      for (used = 0, i = 0; i < ng; ++i)
        if (weight[i] != 0) {
          const V root = all(sqrt(weight[i]));
          double* to = scaled + W * used++;
          for (j = 0; j < W; j += LANES) *(Vector*) (to + j) = root * *(const Vector*) (c + W * i + j);
        }
      multiply(W, NW, used, 1.0, scaled, W, rows(scaled, W), q, W, 1);
      if (!eliminate(q, 0.0, reciprocal)) return (int) t + 1;
      multiply(X, NX, NU, -1.0, q + NX * W, W, rows(q + NX * W, W), q, W, 1);
      mirror(q, togo + t * square);
      memcpy(controls, q + NX * W, sizeof(double) * W * NU);
    }
    copy(slopes + (t + 1) * NX, NX, s);
    strip(1, X, NX, 1.0, next, X, columns(gaps + t * NX, NX), s, X);
    copy(gradient + t * NW, NW, g);
    strip(1, W, NX, 1.0, ft, W, columns(s, X), g, W);
    for (i = 0; i < ng; ++i) pull[i] = -weight[i] * target[i];
    strip(1, W, ng, 1.0, c, W, columns(pull, ng), g, W);
    eliminate_gradient(controls, reciprocal, g, k);
    copy(g, NX, slopes + t * NX);
    copy(k, NU, dus + t * NU);
  }

  copy(dx0, NX, dxs);
  *cost = 0;
  for (t = 0; t < n; ++t) {
    const double *h = stages + t * block, *f = h + W * NW, *c = f + X * NW + W * NX, *q_ = gradient + t * NW;
    const double *controls = factors + t * kept, *reciprocal = controls + W * NU;
    double *du = dus + t * NU, *after = dxs + (t + 1) * NX;
    /* R^T du = -(half^T dx + k). */
    copy(dxs + t * NX, NX, z);
    for (j = 0; j < NU; ++j) z[NX + j] = -(dot(NX + j, controls + j * W, z) + du[j]) * reciprocal[j];
    copy(z + NX, NU, du);
    copy(gaps + t * NX, NX, s);
    strip(1, X, NW, 1.0, f, X, columns(z, W), s, X);
    copy(s, NX, after);
    copy(slopes + (t + 1) * NX, NX, s);
    strip(1, X, NX, 1.0, togo + (t + 1) * square, X, columns(after, NX), s, X);
    copy(s, NX, costates + t * NX);
    for (i = 0; i < ng; ++i) path[t * ng + i] = dot(NW, c + i * W, z);
    memset(hz, 0, sizeof(double) * W);
    strip(1, W, NW, 1.0, h, W, columns(z, W), hz, W);
    for (i = 0; i < NW; ++i) *cost += (0.5 * hz[i] + q_[i]) * z[i];
  }
  const double* dx = dxs + n * NX;
  for (j = 0; j < NX; ++j) *cost += (0.5 * dot(NX, last_hessian + j * NX, dx) + last_gradient[j]) * dx[j];
  return 0;
}
