/* The backward sweep of lgmpc.solvers.sweep, stage after stage. tiles.c comes before. */

EXPORT long long lgmpc_sweep_work(void) { return X * NX + W * NX + X * NW + W * (NW + LANES) + X * NU + W + X + 2 * W; }

/* The plan: N, whether all gaps are zero, and the interval to begin with: the last one, or an earlier one to continue a
   sweep whose cost-to-go behind it still holds. Returns 0, or 1 + the stage whose Quu is not positive definite. */
EXPORT int lgmpc_sweep(void** frame) {
  const long long* plan = (const long long*) frame[0];
  const double reg = *(const double*) frame[1];
  double *jacobian = frame[2], *hessian = frame[3], *gradient = frame[4], *gaps = frame[5];
  double *last_hessian = frame[6], *last_gradient = frame[7], *feedback = frame[8], *feedforward = frame[9];
  double *value = frame[10], *slope = frame[11], *control = frame[12], *work = frame[13];
  const long n = plan[0], closed = plan[1], first = plan[2];
  double *v = work, *ft = v + X * NX, *p = ft + W * NX, *q = p + X * NW, *gain = q + W * (NW + LANES);
  double *g = gain + X * NU, *s = g + W, *k = s + X, *reciprocal = k + W;
  long t, i, j;

  if (first == n - 1) {
    for (j = 0; j < NX; ++j) {
      copy(last_hessian + j * NX, NX, v + j * X);
      v[j + j * X] += reg;
      copy(v + j * X, NX, value + (n * NX + j) * NX);
    }
    copy(last_gradient, NX, s);
  } else {
    for (j = 0; j < NX; ++j) copy(value + ((first + 1) * NX + j) * NX, NX, v + j * X);
    copy(slope + (first + 1) * NX, NX, s);
  }
  for (t = first;; --t) {
    /* s: gradient of the cost-to-go behind the interval, where the gap in front of it is closed. */
    const int known = t == first && first < n - 1;
    if (!closed && !known) strip(1, X, NX, 1.0, v, X, columns(gaps + (t + 1) * NX, NX), s, X);
    copy(s, NX, slope + (t + 1) * NX);
    if (t < 0) return 0;
    const double *f = jacobian + t * NW * NX, *h = hessian + t * NW * NW;
    double *out = value + t * NX * NX, *feed = feedback + t * NU * NX;

    /* Q = H + F^T V F and g = h + F^T s. */
    transpose(f, NX, ft);
    for (j = 0; j < NW; ++j) copy(h + j * NW, NW, q + j * W);
    copy(gradient + t * NW, NW, g);
    memset(p, 0, sizeof(double) * X * NW);
    multiply(X, NW, NX, 1.0, v, X, columns(f, NX), p, X, 0);
    multiply(W, NW, NX, 1.0, ft, W, columns(p, X), q, W, 1);
    strip(1, W, NX, 1.0, ft, W, columns(s, X), g, W);

    copy(g + NX, NU, control + t * NU);
    if (!eliminate(q, reg, reciprocal)) return (int) t + 1;
    eliminate_gradient(q + NX * W, reciprocal, g, k);
    /* V = Qxx - half half^T, and K^T = half R^-1. */
    multiply(X, NX, NU, -1.0, q + NX * W, W, rows(q + NX * W, W), q, W, 1);
    for (j = 0; j < NX; ++j) q[j + j * W] += reg;
    mirror(q, v);
    copy(g, NX, s);
    for (j = 0; j < NU; ++j) copy(q + (NX + j) * W, NX, gain + j * X);
    for (j = 0; j < NU; ++j) {
      double* mine = gain + j * X;
      for (i = 0; i < X; i += LANES) *(Vector*) (mine + i) *= all(reciprocal[j]);
      k[j] *= reciprocal[j];
      for (i = j + 1; i < NU; ++i) {
        const double r = q[NX + j + (NX + i) * W];
        add(NX - 1, -r, mine, gain + i * X);
        k[i] -= r * k[j];
      }
      copy(mine, NX, feed + j * NX);
    }
    copy(k, NU, feedforward + t * NU);
    for (j = 0; j < NX; ++j) copy(v + j * X, NX, out + j * NX);
  }
}
