/* A dual active-set method for small dense QPs; solver.py says which, and where it is from. */
#include <math.h>
#include <string.h>
#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC optimize ("O3")
#endif

#define DEPENDENT 1e-16 /* squared sine of the angle between a normal and the span of others */

/* A limit is 2 k, or 2 k + 1 for its upper side: of row k of the inequalities for k < m, else of variable k - m. */
typedef struct {
  int n, e, m, q;  /* variables, equalities, inequalities; columns of the factors, the equalities first */
  const double *hessian, *gradient, *equality, *rhs, *rows, *lower, *upper, *box_lower, *box_upper;
  double *x, *values;                     /* variables, rows' values */
  double *l, *inverse;                    /* Cholesky factor, row by row, and 1 / its diagonal */
  double *basis, *r;                      /* factors Q and R of the whitened normals, column by column */
  double *y0, *y, *u, *bound;             /* whitened minimiser and variables; columns' multipliers and bounds */
  double *given, *normal, *w, *z, *d, *v; /* values of fixed variables; work */
  double limit;                           /* bound of w, the whitened normal */
  int *first, *active;                    /* where rows of l begin; limits of the columns */
  char *fixed, *is_active;
} qp_t;

static double dot(int n, const double *a, const double *b) {
  double s0 = 0, s1 = 0, s2 = 0, s3 = 0;
  int i = 0;
  for (; i + 3 < n; i += 4) {
    s0 += a[i] * b[i];
    s1 += a[i + 1] * b[i + 1];
    s2 += a[i + 2] * b[i + 2];
    s3 += a[i + 3] * b[i + 3];
  }
  for (; i < n; ++i) s0 += a[i] * b[i];
  return (s0 + s1) + (s2 + s3);
}

static void add(int n, double factor, const double *restrict a, double *restrict to) {
  int i;
  for (i = 0; i < n; ++i) to[i] += factor * a[i];
}

/* Cholesky factor of the Hessian without the rows and columns of fixed variables; leading zeros of a row stay. */
static int factorise(qp_t *s) {
  int n = s->n, i, j;
  for (i = 0; i < n; ++i) {
    double *row = s->l + i * n, pivot;
    const double *h = s->hessian + i * n;
    s->first[i] = i;
    s->inverse[i] = 1;
    if (s->fixed[i]) continue;
    for (j = 0; j < i && (h[j] == 0 || s->fixed[j]); ++j) continue;
    s->first[i] = j;
    for (; j < i; ++j) {
      int k = s->first[j] > s->first[i] ? s->first[j] : s->first[i];
      row[j] = s->fixed[j] ? 0 : (h[j] - dot(j - k, row + k, s->l + j * n + k)) * s->inverse[j];
    }
    j = s->first[i];
    pivot = h[i] - dot(i - j, row + j, row + j);
    if (!(pivot > 0)) return 0;
    s->inverse[i] = 1 / sqrt(pivot);
  }
  return 1;
}

/* w = L^-1 normal */
static void whiten(qp_t *s, const double *normal, double *w) {
  int n = s->n, i;
  for (i = 0; i < n; ++i) {
    int j = s->first[i];
    w[i] = s->fixed[i] ? 0 : (normal[i] - dot(i - j, s->l + i * n + j, w + j)) * s->inverse[i];
  }
}

/* x = L^-T y; fixed variables stay as they are. */
static void unwhiten(qp_t *s) {
  int n = s->n, i;
  double *rest = s->v;
  memcpy(rest, s->y, sizeof(double) * n);
  for (i = n - 1; i >= 0; --i) {
    int j = s->first[i];
    if (s->fixed[i]) continue;
    s->x[i] = rest[i] * s->inverse[i];
    add(i - j, -s->x[i], s->l + i * n + j, rest + j);
  }
}

/* Whiten the normal of a limit that reads normal x >= limit. */
static void take_limit(qp_t *s, int limit) {
  int n = s->n, k = limit / 2, i;
  double sign = limit % 2 ? -1 : 1;
  memset(s->normal, 0, sizeof(double) * n);
  if (k < s->m) {
    add(n, sign, s->rows + k * n, s->normal);
    s->limit = sign * (limit % 2 ? s->upper : s->lower)[k];
  } else {
    s->normal[k - s->m] = sign;
    s->limit = sign * (limit % 2 ? s->box_upper : s->box_lower)[k - s->m];
  }
  s->limit -= dot(n, s->normal, s->given);
  whiten(s, s->normal, s->w);
}

/* Split w into Q d and the rest z; return |z|^2. */
static double split(qp_t *s) {
  double before, rest = dot(s->n, s->w, s->w);
  int k, pass = 0;
  memcpy(s->z, s->w, sizeof(double) * s->n);
  memset(s->d, 0, sizeof(double) * s->q);
  do { /* again if little is left: twice is enough for orthogonality to rounding */
    before = rest;
    for (k = 0; k < s->q; ++k) {
      double along = dot(s->n, s->basis + k * s->n, s->z);
      s->d[k] += along;
      add(s->n, -along, s->basis + k * s->n, s->z);
    }
    rest = dot(s->n, s->z, s->z);
  } while (rest < 0.25 * before && pass++ < 1);
  return rest;
}

/* Append the column w that has just been split. */
static void append(qp_t *s, double rest, int limit, double bound, double multiplier) {
  double size = sqrt(rest), *column = s->r + s->q * s->n, *direction = s->basis + s->q * s->n;
  int i;
  memcpy(column, s->d, sizeof(double) * s->q);
  column[s->q] = size;
  for (i = 0; i < s->n; ++i) direction[i] = s->z[i] / size;
  if (limit >= 0) s->is_active[limit / 2] = 1;
  s->active[s->q] = limit;
  s->bound[s->q] = bound;
  s->u[s->q++] = multiplier;
}

/* Remove column j; rotations make R triangular again. */
static void remove_column(qp_t *s, int j) {
  int n = s->n, last = --s->q, i, k;
  s->is_active[s->active[j] / 2] = 0;
  for (k = j; k < last; ++k) {
    memcpy(s->r + k * n, s->r + (k + 1) * n, sizeof(double) * (k + 2));
    s->active[k] = s->active[k + 1];
    s->bound[k] = s->bound[k + 1];
    s->u[k] = s->u[k + 1];
  }
  for (i = j; i < last; ++i) {
    double a = s->r[i * n + i], b = s->r[i * n + i + 1], size = sqrt(a * a + b * b), cosine = a / size, sine = b / size;
    double *left = s->basis + i * n, *right = left + n;
    for (k = i; k < last; ++k) {
      double above = s->r[k * n + i], below = s->r[k * n + i + 1];
      s->r[k * n + i] = cosine * above + sine * below;
      s->r[k * n + i + 1] = cosine * below - sine * above;
    }
    for (k = 0; k < n; ++k) {
      double one = left[k], other = right[k];
      left[k] = cosine * one + sine * other;
      right[k] = cosine * other - sine * one;
    }
  }
}

/* to = R^-1 from */
static void solve_upper(const qp_t *s, const double *from, double *to) {
  int j;
  memcpy(to, from, sizeof(double) * s->q);
  for (j = s->q - 1; j >= 0; --j) {
    to[j] /= s->r[j * s->n + j];
    add(j, -to[j], s->r + j * s->n, to);
  }
}

/* y, the point nearest to y0 at which the active constraints hold as equalities, and their multipliers u. */
static void project(qp_t *s) {
  int n = s->n, j;
  for (j = 0; j < s->q; ++j) s->v[j] = (s->bound[j] - dot(j, s->r + j * n, s->v)) / s->r[j * n + j];
  for (j = 0; j < s->q; ++j) s->v[j] -= dot(n, s->basis + j * n, s->y0);
  memcpy(s->y, s->y0, sizeof(double) * n);
  for (j = 0; j < s->q; ++j) add(n, s->v[j], s->basis + j * n, s->y);
  solve_upper(s, s->v, s->u);
}

/* Compute x and the rows' values; return the limit that x violates most, by more than the margin, or -1. */
static int most_violated(qp_t *s, double margin) {
  int k, worst = -1;
  unwhiten(s);
  for (k = 0; k < s->m + s->n; ++k) {
    int i = k - s->m, row = i < 0;
    double value = row ? (s->values[k] = dot(s->n, s->rows + k * s->n, s->x)) : s->x[i];
    double below = (row ? s->lower[k] : s->box_lower[i]) - value, above = value - (row ? s->upper[k] : s->box_upper[i]);
    if (s->is_active[k] || (!row && s->fixed[i])) continue;
    if (below > margin) margin = below, worst = 2 * k;
    if (above > margin) margin = above, worst = 2 * k + 1;
  }
  return worst;
}

/* Whether x and u satisfy the optimality conditions in the original numbers. */
static int optimal(qp_t *s, double tolerance) {
  int n = s->n, j, i;
  double *slope = s->v;
  memcpy(slope, s->gradient, sizeof(double) * n);
  for (i = 0; i < n; ++i) add(n, s->x[i], s->hessian + i * n, slope);
  for (j = 0; j < s->q; ++j) {
    int limit = s->active[j], k = limit / 2;
    double sign = limit % 2 ? -1 : 1, value, bound;
    if (j < s->e) {
      add(n, -s->u[j], s->equality + j * n, slope);
      value = dot(n, s->equality + j * n, s->x);
      bound = s->rhs[j];
    } else if (k < s->m) {
      add(n, -sign * s->u[j], s->rows + k * n, slope);
      value = s->values[k];
      bound = (limit % 2 ? s->upper : s->lower)[k];
    } else {
      slope[k - s->m] -= sign * s->u[j];
      value = s->x[k - s->m];
      bound = (limit % 2 ? s->box_upper : s->box_lower)[k - s->m];
    }
    if (!(fabs(value - bound) <= tolerance) || (j >= s->e && !(s->u[j] >= -tolerance))) return 0;
  }
  for (i = 0; i < n; ++i)
    if (!s->fixed[i] && !(fabs(slope[i]) <= tolerance)) return 0;
  return 1;
}

/* plan: n, e, m, most steps, number of limits in the guess (and at the end in the solution), steps.
   Returns 0 if the solution satisfies the tolerance. */
__attribute__((visibility("default"))) int lgmpc_active_set(void **frame) {
  long long *plan = frame[0];
  const double tolerance = *(const double *) frame[1], margin = 0.01 * tolerance;
  double *work = frame[13];
  int *guess = frame[14], guessed = (int) plan[4], steps = 0, i, j, k;
  int n = (int) plan[0], e = (int) plan[1], m = (int) plan[2], most = (int) plan[3];
  qp_t s = {n, e, m, 0, frame[2], frame[3], frame[4], frame[5], frame[6], frame[7], frame[8], frame[9], frame[10],
            frame[11], frame[12]};
  double rest, **part[] = {&s.inverse, &s.y0, &s.y, &s.u, &s.bound, &s.given, &s.normal, &s.w, &s.z, &s.d, &s.v};
  s.l = work;
  s.basis = s.l + n * n;
  s.r = s.basis + n * n;
  for (i = 0; i < 11; ++i) *part[i] = s.r + n * (n + i);
  s.first = guess + n;
  s.active = s.first + n;
  s.fixed = (char *) (s.active + n);
  s.is_active = s.fixed + n;
  plan[4] = plan[5] = 0;

  memset(s.is_active, 0, m + n);
  for (i = 0; i < n; ++i) {
    s.fixed[i] = s.box_lower[i] == s.box_upper[i];
    s.x[i] = s.given[i] = s.fixed[i] ? s.box_lower[i] : 0;
    s.normal[i] = -s.gradient[i];
  }
  for (i = 0; i < n; ++i)
    if (s.fixed[i]) add(n, -s.given[i], s.hessian + i * n, s.normal);
  if (!factorise(&s)) return 1;
  whiten(&s, s.normal, s.y0);
  for (k = 0; k < e; ++k) {
    whiten(&s, s.equality + k * n, s.w);
    rest = split(&s);
    if (s.q >= n || !(rest > DEPENDENT * dot(n, s.w, s.w))) return 1;
    append(&s, rest, -1, s.rhs[k] - dot(n, s.equality + k * n, s.given), 0);
  }

  for (k = 0; k < guessed && s.q < n; ++k) {
    if (guess[k] / 2 >= m && s.fixed[guess[k] / 2 - m]) continue;
    take_limit(&s, guess[k]);
    rest = split(&s);
    if (rest > DEPENDENT * dot(n, s.w, s.w)) append(&s, rest, guess[k], s.limit, 0);
  }
  for (;;) {
    project(&s);
    for (j = k = e; k < s.q; ++k)
      if (s.u[k] < s.u[j]) j = k;
    if (j >= s.q || s.u[j] >= 0) break;
    remove_column(&s, j);
    ++steps;
  }

  while ((k = most_violated(&s, margin)) >= 0) {
    double multiplier = 0, size, missing;
    take_limit(&s, k);
    size = dot(n, s.w, s.w);
    missing = s.limit - dot(n, s.w, s.y);
    for (;;) { /* the multiplier grows until the limit holds, or until that of an active one is zero */
      double step = HUGE_VAL;
      int blocking = -1, possible;
      if (++steps > most) return 1;
      rest = split(&s);
      possible = s.q < n && rest > DEPENDENT * size;
      solve_upper(&s, s.d, s.v);
      for (j = e; j < s.q; ++j)
        if (s.v[j] > 0 && s.u[j] < step * s.v[j]) step = fmax(s.u[j], 0) / s.v[j], blocking = j;
      if (possible && missing <= step * rest) step = missing / rest, blocking = -1;
      else if (blocking < 0) return 1; /* the limits contradict each other */
      add(s.q, -step, s.v, s.u);
      multiplier += step;
      if (possible) add(n, step, s.z, s.y), missing -= step * rest;
      if (blocking < 0) break;
      remove_column(&s, blocking);
    }
    append(&s, rest, k, s.limit, multiplier);
    project(&s);
  }
  plan[5] = steps;
  if (!optimal(&s, tolerance)) return 1;
  for (j = e; j < s.q; ++j) guess[plan[4]++] = s.active[j];
  return 0;
}
