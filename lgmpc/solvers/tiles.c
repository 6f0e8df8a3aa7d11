/* Products of small matrices, on tiles that the registers hold, and what else a Riccati recursion is made of. NX and NU
   (states and controls of a stage) and squares.c come before: sizes that the compiler knows save a third of the time.

   Matrices are stored column after column; of symmetric ones the upper triangle is computed. Columns in work memory
   are padded to whole vectors by numbers that no result depends on. */

#include <math.h>
#include <string.h>

#ifdef __clang__
  #pragma STDC FP_CONTRACT ON
#elif defined(__GNUC__)
  #pragma GCC optimize ("O3,fp-contract=fast,no-tree-loop-distribute-patterns")
#endif
#ifdef __GNUC__
  #define EXPORT __attribute__((visibility("default")))
  #define INLINE static inline __attribute__((always_inline))
  #define NOINLINE __attribute__((noinline))
typedef V Vector __attribute__((may_alias));
#else
typedef V Vector;
  #define EXPORT
  #define INLINE static inline
  #define NOINLINE
#endif

#define WHOLE(n) (((n) + LANES - 1) / LANES * LANES)
enum { NW = NX + NU, X = WHOLE(NX), W = WHOLE(NW) }; /* rows of [x; u], and padded ones */

/* A factor of a product: entry (i, j) is at[i * row + j * column]. */
typedef struct { const double* at; long row, column; } Factor;

INLINE Factor columns(const double* at, long apart) { Factor f = {at, 1, apart}; return f; }
INLINE Factor rows(const double* at, long apart) { Factor f = {at, apart, 1}; return f; }

#if SQUARES
/* A vector of its lanes' numbers. */
INLINE V places(void) {
  V v = {0};
  int lane;
  for (lane = 0; lane < LANES; ++lane) v[lane] = lane;
  return v;
}
#endif

/* Copies n numbers, known to the compiler, in whole vectors: memcpy moves halves of them, and a load of a vector then
   waits until both have left the store buffer. */
INLINE void copy(const double* from, const long n, double* to) {
  long i = 0;
#if SQUARES
  for (; i + LANES <= n; i += LANES) *(Loose*) (to + i) = *(const Loose*) (from + i);
#endif
  for (; i < n; ++i) to[i] = from[i];
}

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

/* Functions of their own: within larger ones the registers are given to other values. */
#define TILE(name, height, width, sign)                                                                           \
  static NOINLINE void name(long depth, const double* a, long tall, const double* at, double* c, long apart,     \
                            long row, long column) {                                                             \
    const Factor b = {at, row, column}; /* as a whole it would be passed in memory */                            \
    tile(height, width, depth, sign, a, tall, b, c, apart);                                                      \
  }
TILE(add_3_4, 3, 4, 1.0)
TILE(add_2_4, 2, 4, 1.0)
TILE(add_1_4, 1, 4, 1.0)
TILE(add_3_1, 3, 1, 1.0)
TILE(add_2_1, 2, 1, 1.0)
TILE(add_1_1, 1, 1, 1.0)
TILE(subtract_3_4, 3, 4, -1.0)
TILE(subtract_2_4, 2, 4, -1.0)
TILE(subtract_1_4, 1, 4, -1.0)
TILE(subtract_3_1, 3, 1, -1.0)
TILE(subtract_2_1, 2, 1, -1.0)
TILE(subtract_1_1, 1, 1, -1.0)

typedef void Tile(long depth, const double* a, long tall, const double* at, double* c, long apart, long row,
                  long column);

/* Of each sign the tiles of 3, 2 and 1 vectors by 4 columns, then by 1. */
static Tile* const tiles[2][2][3] = {
  {{subtract_3_4, subtract_2_4, subtract_1_4}, {subtract_3_1, subtract_2_1, subtract_1_1}},
  {{add_3_4, add_2_4, add_1_4}, {add_3_1, add_2_1, add_1_1}},
};

/* c += sign a b with `width` columns of c (4 or 1), and as many rows as whole vectors hold. */
INLINE void strip(int width, long height, long depth, double sign, const double* a, long tall, Factor b, double* c,
                  long apart) {
  Tile* const* of = tiles[sign > 0][width == 1];
  long i;
  for (i = 0; i < height; i += 3 * LANES) {
    const long left = height - i;
    of[left > 2 * LANES ? 0 : left > LANES ? 1 : 2](depth, a + i, tall, b.at, c + i, apart, b.row, b.column);
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

/* b = a^T for a (NX, NW), whose columns are `apart`; columns of b have W numbers. */
static void transpose(const double* a, long apart, double* b) {
#if SQUARES && NX >= LANES && NX + NU >= LANES
  long i, j, c;
  for (j = 0; j < NW; j += LANES) {
    const long column = j + LANES <= NW ? j : NW - LANES; /* the last squares overlap those before */
    for (i = 0; i < NX; i += LANES) {
      const long row = i + LANES <= NX ? i : NX - LANES;
      V square[LANES];
      for (c = 0; c < LANES; ++c) square[c] = *(const Loose*) (a + row + (column + c) * apart);
      transpose_square(square);
      for (c = 0; c < LANES; ++c) *(Loose*) (b + column + (row + c) * W) = square[c];
    }
  }
#else
  long i, j;
  for (j = 0; j < NW; ++j)
    for (i = 0; i < NX; ++i) b[j + i * W] = a[i + j * apart];
#endif
}

/* v = q, the states' part of it, with both triangles. */
static void mirror(const double* q, double* v) {
  long i, j;
#if SQUARES
  long c;
  for (j = 0; j < NX; j += LANES)
    for (i = 0; i <= j; i += LANES) {
      V square[LANES], turned[LANES];
      for (c = 0; c < LANES; ++c) turned[c] = square[c] = *(const Vector*) (q + i + (j + c) * W);
      transpose_square(turned);
      for (c = 0; c < LANES && j + c < NX; ++c)
        *(Vector*) (v + i + (j + c) * X) = i < j ? square[c] : CHOOSE(places() <= all((double) c), square[c], turned[c]);
      if (i < j)
        for (c = 0; c < LANES; ++c) *(Vector*) (v + j + (i + c) * X) = turned[c];
    }
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

/* Eliminates the controls from q, from the last: Quu + reg I = R R^T with the upper triangular R, whose diagonal's
   reciprocals are written; what is above becomes half = Qxu R^-T. Returns whether it is positive definite. */
INLINE int eliminate(double* q, double reg, double* reciprocal) {
  long i, j;
  for (j = NW - 1; j >= NX; --j) {
    double* mine = q + j * W;
    const double rest = mine[j] + reg;
    if (!(rest > 0)) return 0;
    const double inverse = reciprocal[j - NX] = 1 / sqrt(rest);
    for (i = 0; i < j; i += LANES) *(Vector*) (mine + i) *= all(inverse);
    for (i = NX; i < j; ++i) add(i, -mine[i], mine, q + i * W);
  }
  return 1;
}

/* The same of a gradient g: the states' remains, and k = R^-1 of the controls'; `controls` are the columns of q. */
INLINE void eliminate_gradient(const double* controls, const double* reciprocal, double* g, double* k) {
  long j;
  for (j = NU - 1; j >= 0; --j) {
    k[j] = g[NX + j] * reciprocal[j];
    add(NX + j - 1, -k[j], controls + j * W, g);
  }
}
