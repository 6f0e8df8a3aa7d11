/* Transposition of squares of numbers in registers, as many rows as a vector has lanes. LANES and V come before.
   SQUARES is 0 where the compiler has no shuffles: whoever includes this then moves single numbers. */

#ifndef __has_builtin
  #define __has_builtin(name) 0
#endif

#if LANES > 1 && __has_builtin(__builtin_shufflevector)
  #define SQUARES 1
/* A vector at any address. */
typedef double Loose __attribute__((vector_size(8 * LANES), aligned(8), may_alias));

/* Two rows after an exchange of blocks of `apart` numbers: the first keeps those at its even blocks and takes the
   second's, the second keeps those at its odd blocks. */
  #if LANES == 2
    #define FIRST(a, b, apart) __builtin_shufflevector(a, b, 0, 2)
    #define SECOND(a, b, apart) __builtin_shufflevector(a, b, 1, 3)
  #elif LANES == 4
    #define FIRST(a, b, apart) (apart == 2 ? __builtin_shufflevector(a, b, 0, 1, 4, 5) \
      : __builtin_shufflevector(a, b, 0, 4, 2, 6))
    #define SECOND(a, b, apart) (apart == 2 ? __builtin_shufflevector(a, b, 2, 3, 6, 7) \
      : __builtin_shufflevector(a, b, 1, 5, 3, 7))
  #else
    #define FIRST(a, b, apart) (apart == 4 ? __builtin_shufflevector(a, b, 0, 1, 2, 3, 8, 9, 10, 11) \
      : apart == 2 ? __builtin_shufflevector(a, b, 0, 1, 8, 9, 4, 5, 12, 13) \
      : __builtin_shufflevector(a, b, 0, 8, 2, 10, 4, 12, 6, 14))
    #define SECOND(a, b, apart) (apart == 4 ? __builtin_shufflevector(a, b, 4, 5, 6, 7, 12, 13, 14, 15) \
      : apart == 2 ? __builtin_shufflevector(a, b, 2, 3, 10, 11, 6, 7, 14, 15) \
      : __builtin_shufflevector(a, b, 1, 9, 3, 11, 5, 13, 7, 15))
  #endif

static inline __attribute__((always_inline)) void transpose_square(V* rows) {
  int apart, i;
  #pragma GCC unroll 8
  for (apart = LANES / 2; apart > 0; apart /= 2)
    #pragma GCC unroll 8
    for (i = 0; i < LANES; ++i)
      if (!(i & apart)) {
        const V a = rows[i], b = rows[i + apart];
        rows[i] = FIRST(a, b, apart);
        rows[i + apart] = SECOND(a, b, apart);
      }
}
#else
  #define SQUARES 0
#endif
