#include <math.h>

#ifndef LANES
  #if !defined(__GNUC__)
    #define LANES 1
  #elif defined(__AVX512F__)
    #define LANES 8
  #elif defined(__AVX__)
    #define LANES 4
  #elif defined(__SSE2__) || defined(__ARM_NEON)
    #define LANES 2
  #else
    #define LANES 1
  #endif
#endif

#if LANES > 1
typedef double V __attribute__((vector_size(8 * LANES)));
typedef long long M __attribute__((vector_size(8 * LANES)));
#define LANE(v, i) (v)[i]
#define ALL(x) all(x)
#define NOT(m) (~(M) (m))
#define CHOOSE(m, a, b) ((V) (((M) (a) & (M) (m)) | ((M) (b) & ~(M) (m))))
static inline V all(double x) { V zero = {0}; return x - zero; }
static inline V truth(M m) { return (V) (m & (M) all(1.0)); }
static inline V select(V c, V a) { return (V) ((M) a & (M) (c != all(0.0))); }
#else
#define V double
#define M int
#define LANE(v, i) (v)
#define ALL(x) (x)
#define NOT(m) (!(m))
#define CHOOSE(m, a, b) ((m) ? (a) : (b))
static inline V all(double x) { return x; }
static inline V truth(M m) { return m; }
static inline V select(V c, V a) {
  union { V number; long long bits; } masked;
  masked.number = a;
  masked.bits &= -(long long) (c != 0.0);
  return masked.number;
}
#endif

