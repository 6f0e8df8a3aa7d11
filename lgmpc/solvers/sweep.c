/* The backward sweep of lgmpc.solvers.sweep, stage after stage. NX and NU (states and controls) and squares.c come
   before: sizes that the compiler knows save a third of the time.

   Matrices are stored column after column; of symmetric ones the upper triangle is computed. Those in work memory have
   their columns padded to whole vectors by numbers that no result depends on. */

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

#define WHOLE(n) (((n) + LANES - 1) / LANES * LANES)
enum { NW = NX + NU, X = WHOLE(NX), W = WHOLE(NW) }; /* rows of [x; u], and padded ones */

/* A factor of a product: entry (i, j) is at[i * row + j * column]. */
typedef struct { const double* at; long row, column; } Factor;

INLINE Factor columns(const double* at, long apart) { Factor f = {at, 1, apart}; return f; }
INLINE Factor rows(const double* at, long apart) { Factor f = {at, apart, 1}; return f; }

/* c += sign a b for a tile of c, 3 vectors by 4 columns at most: what the registers hold. Columns of a and c are
   `tall` and `apart` numbers long. */
INLINE void tile(int height, int width, long depth, double sign, const double* a, long tall, Factor b, double* c,
                 long apart) {
  V sum[4][3], left[3];
  int i, j;
  long k;
  for (j = 0; j < width; ++j)
    for (i = 0; i < height; ++i) sum[j][i] = *(const Vector*) (c + j * apart + i * LANES);
  for (k = 0; k < depth; ++k) {
    for (i = 0; i < height; ++i) left[i] = *(const Vector*) (a + k * tall + i * LANES);
    for (j = 0; j < width; ++j) {
      const V right = all(b.at[k * b.row + j * b.column]);
      for (i = 0; i < height; ++i)
        if (sign > 0) sum[j][i] += left[i] * right;
        else sum[j][i] -= left[i] * right;
    }
  }
  for (j = 0; j < width; ++j)
    for (i = 0; i < height; ++i) *(Vector*) (c + j * apart + i * LANES) = sum[j][i];
}

/* c += sign a b with `width` columns of c, and as many rows as whole vectors hold. */
INLINE void strip(int width, long height, long depth, double sign, const double* a, long tall, Factor b, double* c,
                  long apart) {
  long i;
  for (i = 0; i < height; i += 3 * LANES) {
    const long left = height - i;
    if (left > 2 * LANES) tile(3, width, depth, sign, a + i, tall, b, c + i, apart);
    else if (left > LANES) tile(2, width, depth, sign, a + i, tall, b, c + i, apart);
    else tile(1, width, depth, sign, a + i, tall, b, c + i, apart);
  }
}

/* c += sign a b for c (height, cols); of a triangle, the rows down to the diagonal. */
INLINE void multiply(long height, long cols, long depth, double sign, const double* a, long tall, Factor b, double* c,
                     long apart, int triangle) {
  long j;
  for (j = 0; j + 4 <= cols; j += 4) {
    const Factor right = {b.at + j * b.column, b.row, b.column};
    strip(4, triangle && j + 4 < height ? j + 4 : height, depth, sign, a, tall, right, c + j * apart, apart);
  }
  for (; j < cols; ++j) {
    const Factor right = {b.at + j * b.column, b.row, b.column};
    strip(1, triangle ? j + 1 : height, depth, sign, a, tall, right, c + j * apart, apart);
  }
}

/* b = a^T for a (NX, NW), without padding; columns of b have W numbers. */
static void transpose(const double* a, double* b) {
#if SQUARES && NX >= LANES && NX + NU >= LANES
  long i, j, c;
  for (j = 0; j < NW; j += LANES) {
    const long column = j + LANES <= NW ? j : NW - LANES; /* the last squares overlap those before */
    for (i = 0; i < NX; i += LANES) {
      const long row = i + LANES <= NX ? i : NX - LANES;
      V square[LANES];
      for (c = 0; c < LANES; ++c) square[c] = *(const Loose*) (a + row + (column + c) * NX);
      transpose_square(square);
      for (c = 0; c < LANES; ++c) *(Loose*) (b + column + (row + c) * W) = square[c];
    }
  }
#else
  long i, j;
  for (j = 0; j < NW; ++j)
    for (i = 0; i < NX; ++i) b[j + i * W] = a[i + j * NX];
#endif
}

/* v = q, the states' part of it, with both triangles. */
static void mirror(const double* q, double* v) {
  long i, j;
#if SQUARES
  long c;
  for (j = LANES; j < NX; j += LANES)
    for (i = 0; i < j; i += LANES) {
      V square[LANES];
      for (c = 0; c < LANES; ++c) square[c] = *(const Vector*) (q + i + (j + c) * W);
      for (c = 0; c < LANES && j + c < NX; ++c) *(Vector*) (v + i + (j + c) * X) = square[c];
      transpose_square(square);
      for (c = 0; c < LANES; ++c) *(Vector*) (v + j + (i + c) * X) = square[c];
    }
  for (j = 0; j < NX; ++j)
    for (i = j / LANES * LANES; i <= j; ++i) v[i + j * X] = v[j + i * X] = q[i + j * W];
#else
  for (j = 0; j < NX; ++j)
    for (i = 0; i <= j; ++i) v[i + j * X] = v[j + i * X] = q[i + j * W];
#endif
}

/* a += factor b, down to an entry. */
INLINE void add(long last, double factor, const double* b, double* a) {
  long i;
  for (i = 0; i <= last; i += LANES) *(Vector*) (a + i) += all(factor) * *(const Vector*) (b + i);
}

EXPORT long long lgmpc_sweep_work(void) { return X * NX + W * NX + X * NW + W * (NW + LANES) + X * NU + W + X + 2 * W; }

/* Returns 0, or 1 + the stage whose Quu is not positive definite. */
EXPORT int lgmpc_sweep(void** frame) {
  const long long* plan = (const long long*) frame[0];
  const double reg = *(const double*) frame[1];
  double *jacobian = frame[2], *hessian = frame[3], *gradient = frame[4], *gaps = frame[5];
  double *last_hessian = frame[6], *last_gradient = frame[7], *feedback = frame[8], *feedforward = frame[9];
  double *value = frame[10], *slope = frame[11], *control = frame[12], *work = frame[13];
  const long n = plan[0], closed = plan[1];
  double *v = work, *ft = v + X * NX, *p = ft + W * NX, *q = p + X * NW, *gain = q + W * (NW + LANES);
  double *g = gain + X * NU, *s = g + W, *k = s + X, *reciprocal = k + W;
  long t, i, j;

  for (j = 0; j < NX; ++j) {
    memcpy(v + j * X, last_hessian + j * NX, sizeof(double) * NX);
    v[j + j * X] += reg;
    memcpy(value + (n * NX + j) * NX, v + j * X, sizeof(double) * NX);
  }
  memcpy(s, last_gradient, sizeof(double) * NX);
  for (t = n - 1;; --t) {
    /* s: gradient of the cost-to-go behind the interval, where the gap in front of it is closed. */
    if (!closed) strip(1, X, NX, 1.0, v, X, columns(gaps + (t + 1) * NX, NX), s, X);
    memcpy(slope + (t + 1) * NX, s, sizeof(double) * NX);
    if (t < 0) return 0;
    const double *f = jacobian + t * NW * NX, *h = hessian + t * NW * NW;
    double *out = value + t * NX * NX, *feed = feedback + t * NU * NX;

    /* Q = H + F^T V F and g = h + F^T s. */
    transpose(f, ft);
    for (j = 0; j < NW; ++j) memcpy(q + j * W, h + j * NW, sizeof(double) * NW);
    memcpy(g, gradient + t * NW, sizeof(double) * NW);
    memset(p, 0, sizeof(double) * X * NW);
    multiply(X, NW, NX, 1.0, v, X, columns(f, NX), p, X, 0);
    multiply(W, NW, NX, 1.0, ft, W, columns(p, X), q, W, 1);
    strip(1, W, NX, 1.0, ft, W, columns(s, X), g, W);

    /* Eliminate the controls, from the last: Quu = R R^T with the upper triangular R; what is above becomes
       half = Qxu R^-T, and g becomes that of the states. */
    memcpy(control + t * NU, g + NX, sizeof(double) * NU);
    for (j = NW - 1; j >= NX; --j) {
      double* mine = q + j * W;
      const double rest = mine[j] + reg;
      if (!(rest > 0)) return (int) t + 1;
      const double inverse = reciprocal[j - NX] = 1 / sqrt(rest);
      for (i = 0; i < j; i += LANES) *(Vector*) (mine + i) *= all(inverse);
      k[j - NX] = g[j] * inverse;
      for (i = NX; i < j; ++i) add(i, -mine[i], mine, q + i * W);
      add(j - 1, -k[j - NX], mine, g);
    }
    /* V = Qxx - half half^T, and K^T = half R^-1. */
    multiply(X, NX, NU, -1.0, q + NX * W, W, rows(q + NX * W, W), q, W, 1);
    mirror(q, v);
    memcpy(s, g, sizeof(double) * NX);
    for (j = 0; j < NU; ++j) memcpy(gain + j * X, q + (NX + j) * W, sizeof(double) * NX);
    for (j = 0; j < NU; ++j) {
      double* mine = gain + j * X;
      for (i = 0; i < X; i += LANES) *(Vector*) (mine + i) *= all(reciprocal[j]);
      k[j] *= reciprocal[j];
      for (i = j + 1; i < NU; ++i) {
        const double r = q[NX + j + (NX + i) * W];
        add(NX - 1, -r, mine, gain + i * X);
        k[i] -= r * k[j];
      }
      memcpy(feed + j * NX, mine, sizeof(double) * NX);
    }
    memcpy(feedforward + t * NU, k, sizeof(double) * NU);
    for (j = 0; j < NX; ++j) {
      v[j + j * X] += reg;
      memcpy(out + j * NX, v + j * X, sizeof(double) * NX);
    }
  }
}
