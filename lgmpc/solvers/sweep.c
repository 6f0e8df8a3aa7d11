/* The backward sweep of lgmpc.solvers.sweep, stage after stage. LANES and V (a vector of as many doubles) come before.

   Matrices are stored column after column; of symmetric ones the upper triangle is computed. Those in work memory have
   their columns padded with zeros to whole vectors, the block of the states and that of the controls each. */

#include <math.h>
#include <string.h>

#ifdef __clang__
  #pragma STDC FP_CONTRACT ON
#elif defined(__GNUC__)
  #pragma GCC optimize ("O3,fp-contract=fast")
#endif
#ifdef __GNUC__
  #define EXPORT __attribute__((visibility("default")))
  #define INLINE static inline __attribute__((always_inline))
typedef V Vector __attribute__((may_alias));
#else
typedef V Vector;
  #define EXPORT
  #define INLINE static inline
#endif

/* A matrix: entry (i, j) is at[i * row + j * column]. */
typedef struct { double* at; long row, column; } Matrix;

/* One whose columns are contiguous, `apart` numbers from one to the next. */
INLINE Matrix columns(double* at, long apart) { Matrix m = {at, 1, apart}; return m; }
INLINE Matrix block(Matrix m, long i, long j) { m.at += i * m.row + j * m.column; return m; }

/* C += sign A B for a tile of C, 3 vectors by 4 columns at most: what the registers hold. */
INLINE void tile(int height, int width, long depth, double sign, Matrix a, Matrix b, Matrix c) {
  V sum[4][3], left[3];
  int i, j;
  long k;
  for (j = 0; j < width; ++j)
    for (i = 0; i < height; ++i) sum[j][i] = *(const Vector*) (c.at + j * c.column + i * LANES);
  for (k = 0; k < depth; ++k) {
    for (i = 0; i < height; ++i) left[i] = *(const Vector*) (a.at + k * a.column + i * LANES);
    for (j = 0; j < width; ++j) {
      V right = all(sign * b.at[k * b.row + j * b.column]);
      for (i = 0; i < height; ++i) sum[j][i] += left[i] * right;
    }
  }
  for (j = 0; j < width; ++j)
    for (i = 0; i < height; ++i) *(Vector*) (c.at + j * c.column + i * LANES) = sum[j][i];
}

/* C += sign A B, for padded A (rows, depth) and C (rows, cols). Of a triangle, the rows down to the diagonal. */
INLINE void multiply(long rows, long cols, long depth, double sign, Matrix a, Matrix b, Matrix c, int triangle) {
  long i, j, width;
  for (j = 0; j < cols; j += width) {
    width = cols - j < 4 ? 1 : 4;
    long last = triangle && j + width < rows ? j + width : rows;
    for (i = 0; i < last; i += 3 * LANES) {
      Matrix x = block(a, i, 0), y = block(b, 0, j), z = block(c, i, j);
      long height = (last - i + LANES - 1) / LANES;
      if (width == 4 && height > 2) tile(3, 4, depth, sign, x, y, z);
      else if (width == 4 && height == 2) tile(2, 4, depth, sign, x, y, z);
      else if (width == 4) tile(1, 4, depth, sign, x, y, z);
      else if (height > 2) tile(3, 1, depth, sign, x, y, z);
      else if (height == 2) tile(2, 1, depth, sign, x, y, z);
      else tile(1, 1, depth, sign, x, y, z);
    }
  }
}

static void add(long rows, long cols, long depth, Matrix a, Matrix b, Matrix c) {
  multiply(rows, cols, depth, 1.0, a, b, c, 0);
}

static void add_triangle(long rows, long cols, long depth, Matrix a, Matrix b, Matrix c) {
  multiply(rows, cols, depth, 1.0, a, b, c, 1);
}

static void subtract(long rows, long cols, long depth, Matrix a, Matrix b, Matrix c) {
  multiply(rows, cols, depth, -1.0, a, b, c, 0);
}

static void subtract_triangle(long rows, long cols, long depth, Matrix a, Matrix b, Matrix c) {
  multiply(rows, cols, depth, -1.0, a, b, c, 1);
}

/* B = A^T, for A (rows, cols), four rows at a time. */
static void transpose(long rows, long cols, Matrix a, Matrix b) {
  long i, j, k;
  for (i = 0; i < rows; i += 4)
    for (j = 0; j < cols; ++j) {
      const double* from = a.at + i + j * a.column;
      double* to = b.at + j + i * b.column;
      if (i + 4 <= rows)
        for (k = 0; k < 4; ++k) to[k * b.column] = from[k];
      else
        for (k = 0; k < rows - i; ++k) to[k * b.column] = from[k];
    }
}

/* Replaces the upper triangle of A by U, A = U^T U, and writes the reciprocals of its diagonal; 0 if there is none. */
static int factorise(long n, Matrix a, double* reciprocal) {
  long i, j, k;
  for (j = 0; j < n; ++j)
    for (i = 0; i <= j; ++i) {
      double *left = block(a, 0, i).at, *right = block(a, 0, j).at, rest = right[i];
      for (k = 0; k < i; ++k) rest -= left[k] * right[k];
      if (i < j) right[i] = rest * reciprocal[i];
      else if (!(rest > 0)) return 0;
      else reciprocal[j] = 1 / (right[j] = sqrt(rest));
    }
  return 1;
}

static long whole(long n) { return (n + LANES - 1) / LANES * LANES; }

EXPORT long long lgmpc_sweep_work(long long nx, long long nu) {
  long x = whole(nx), w = x + whole(nu);
  return w * nx + x * nx + x * (nx + nu) + w * (nx + nu) + 2 * x * nu + w + x + 3 * whole(nu);
}

/* Returns 0, or 1 + the stage whose Quu is not positive definite. */
EXPORT int lgmpc_sweep(void** frame) {
  const long long* plan = (const long long*) frame[0];
  const double reg = *(const double*) frame[1];
  double *jacobian = frame[2], *hessian = frame[3], *gradient = frame[4], *gaps = frame[5];
  double *last_hessian = frame[6], *last_gradient = frame[7], *feedback = frame[8], *feedforward = frame[9];
  double *value = frame[10], *slope = frame[11], *control = frame[12], *work = frame[13];
  const long n = plan[0], nx = plan[1], nu = plan[2], closed = plan[3];
  const long nw = nx + nu, x = whole(nx), w = x + whole(nu);
  const Matrix v = columns(work, x), ft = columns(v.at + x * nx, w), p = columns(ft.at + w * nx, x);
  const Matrix q = columns(p.at + x * nw, w), quu = block(q, x, nx), half = columns(q.at + w * nw, x);
  const Matrix gain = columns(half.at + x * nu, x), g = columns(gain.at + x * nu, w), s = columns(g.at + w, x);
  double *k = s.at + x, *reciprocal = k + whole(nu);
  long t, i, j;

  memcpy(slope + n * nx, last_gradient, sizeof(double) * nx);
  for (j = 0; j < nx; ++j) {
    for (i = 0; i < nx; ++i) v.at[i + j * x] = last_hessian[i + j * nx] + (i == j ? reg : 0);
    memcpy(value + (n * nx + j) * nx, v.at + j * x, sizeof(double) * nx);
    s.at[j] = last_gradient[j];
  }
  for (t = n - 1;; --t) {
    /* s: gradient of the cost-to-go behind the interval, where the gap in front of it is closed. */
    if (!closed) add(x, 1, nx, v, columns(gaps + (t + 1) * nx, nx), s);
    memcpy(slope + (t + 1) * nx, s.at, sizeof(double) * nx);
    if (t < 0) return 0;
    const Matrix f = columns(jacobian + t * nw * nx, nx);
    const double *h = hessian + t * nw * nw, *r = gradient + t * nw;
    double *out = value + t * nx * nx, *feed = feedback + t * nu * nx;

    /* Q = H + F^T V F and g = h + F^T s. */
    transpose(nx, nx, f, ft);
    transpose(nx, nu, block(f, 0, nx), block(ft, x, 0));
    for (j = 0; j < nw; ++j) {
      memcpy(q.at + j * w, h + j * nw, sizeof(double) * nx);
      memcpy(q.at + j * w + x, h + j * nw + nx, sizeof(double) * nu);
    }
    memcpy(g.at, r, sizeof(double) * nx);
    memcpy(g.at + x, r + nx, sizeof(double) * nu);
    memset(p.at, 0, sizeof(double) * x * nw);
    add(x, nw, nx, v, f, p);
    add_triangle(x, nx, nx, ft, p, q);
    add(x, nu, nx, ft, block(p, 0, nx), block(q, 0, nx));
    add_triangle(w - x, nu, nx, block(ft, x, 0), block(p, 0, nx), quu);
    add(w, 1, nx, ft, s, g);

    /* With Quu = U^T U: half = Qxu U^-1, K^T = half U^-T, V = Qxx - half half^T; likewise of the gradients. */
    memcpy(control + t * nu, g.at + x, sizeof(double) * nu);
    for (j = 0; j < nu; ++j) quu.at[j + j * w] += reg;
    if (!factorise(nu, quu, reciprocal)) return (int) t + 1;
    for (j = 0; j < nu; ++j) {
      double *mine = half.at + j * x, *u = quu.at + j * w;
      memcpy(mine, q.at + (nx + j) * w, sizeof(double) * x);
      subtract(x, 1, j, half, columns(u, w), columns(mine, x));
      for (i = 0; i < x; ++i) mine[i] *= reciprocal[j];
      k[j] = g.at[x + j];
      for (i = 0; i < j; ++i) k[j] -= u[i] * k[i];
      k[j] *= reciprocal[j];
    }
    subtract_triangle(x, nx, nu, half, (Matrix) {half.at, x, 1}, q);
    memcpy(s.at, g.at, sizeof(double) * x);
    subtract(x, 1, nu, half, columns(k, nu), s);
    for (j = nu - 1; j >= 0; --j) {
      double* mine = gain.at + j * x;
      Matrix u = {quu.at + j + (j + 1) * w, w, 1};
      memcpy(mine, half.at + j * x, sizeof(double) * x);
      subtract(x, 1, nu - 1 - j, columns(mine + x, x), u, columns(mine, x));
      for (i = 0; i < x; ++i) mine[i] *= reciprocal[j];
      memcpy(feed + j * nx, mine, sizeof(double) * nx);
      for (i = j + 1; i < nu; ++i) k[j] -= quu.at[j + i * w] * k[i];
      k[j] *= reciprocal[j];
    }
    memcpy(feedforward + t * nu, k, sizeof(double) * nu);
    for (j = 0; j < nx; ++j) {
      for (i = 0; i < j; ++i) v.at[i + j * x] = v.at[j + i * x] = q.at[i + j * w];
      v.at[j + j * x] = q.at[j + j * w] + reg;
    }
    for (j = 0; j < nx; ++j) memcpy(out + j * nx, v.at + j * x, sizeof(double) * nx);
  }
}
