/* A pipeline of functions in lanes (see lgmpc.compile.pipeline): inputs and outputs are transposed, one stage to a lane.
   A group of stages that is not full repeats the last one. LANES and V come before. */

#ifdef __GNUC__
  #define EXPORT __attribute__((visibility("default")))
  #pragma GCC optimize ("O3")
#else
  #define EXPORT
#endif

#ifndef __has_builtin
  #define __has_builtin(name) 0
#endif

#if LANES > 1 && __has_builtin(__builtin_shufflevector)
  #define SQUARES 1
typedef double Loose __attribute__((vector_size(8 * LANES), aligned(8), may_alias));

/* Exchanges two rows' blocks off the diagonal: of `apart` numbers, where the numbers of the row pass `apart`. */
  #if LANES == 2
    #define EXCHANGED(a, b, apart) __builtin_shufflevector(a, b, 0, 2)
    #define OTHERS(a, b, apart) __builtin_shufflevector(a, b, 1, 3)
  #elif LANES == 4
    #define EXCHANGED(a, b, apart) (apart == 2 ? __builtin_shufflevector(a, b, 0, 1, 4, 5) \
      : __builtin_shufflevector(a, b, 0, 4, 2, 6))
    #define OTHERS(a, b, apart) (apart == 2 ? __builtin_shufflevector(a, b, 2, 3, 6, 7) \
      : __builtin_shufflevector(a, b, 1, 5, 3, 7))
  #else
    #define EXCHANGED(a, b, apart) (apart == 4 ? __builtin_shufflevector(a, b, 0, 1, 2, 3, 8, 9, 10, 11) \
      : apart == 2 ? __builtin_shufflevector(a, b, 0, 1, 8, 9, 4, 5, 12, 13) \
      : __builtin_shufflevector(a, b, 0, 8, 2, 10, 4, 12, 6, 14))
    #define OTHERS(a, b, apart) (apart == 4 ? __builtin_shufflevector(a, b, 4, 5, 6, 7, 12, 13, 14, 15) \
      : apart == 2 ? __builtin_shufflevector(a, b, 2, 3, 10, 11, 6, 7, 14, 15) \
      : __builtin_shufflevector(a, b, 1, 9, 3, 11, 5, 13, 7, 15))
  #endif

/* Transposes a square of rows. */
static inline __attribute__((always_inline)) void transpose(V* rows) {
  int apart, i;
  #pragma GCC unroll 8
  for (apart = LANES / 2; apart > 0; apart /= 2)
    #pragma GCC unroll 8
    for (i = 0; i < LANES; ++i)
      if (!(i & apart)) {
        const V a = rows[i], b = rows[i + apart];
        rows[i] = EXCHANGED(a, b, apart);
        rows[i + apart] = OTHERS(a, b, apart);
      }
}
#else
  #define SQUARES 0
#endif

typedef void Evaluate(const V* const* arguments, V* const* results, V* work);

EXPORT long long lgmpc_pipeline_lanes(void) { return LANES; }

/* plan: stages, inputs, outputs, steps, place of the work memory; of each input and output its size, how far apart the
   stages' are, and of an input its place, of an output where its entries' places begin in `entries`; of each step its
   numbers of arguments, results and repetitions, and of each argument and result its place and how far apart the
   repetitions' are. Places count vectors. */
EXPORT int lgmpc_pipeline(void** frame) {
  double** base = (double**) frame[0];
  const long long* plan = (const long long*) frame[1];
  Evaluate** evaluate = (Evaluate**) frame[2];
  V* memory = (V*) frame[3];
  V** given = (V**) frame[4];
  const long long* entries = (const long long*) frame[5];
  const long long n = plan[0], n_in = plan[1], n_out = plan[2], steps = plan[3];
  V* work = memory + plan[4];
  const long long* outside = plan + 5;
  long long k, i, j, s, t;
  int lane;
  for (k = 0; k < n; k += LANES) {
    const long long* step = outside + 3 * (n_in + n_out);
    for (i = 0; i < n_in; ++i) {
      const long long *wire = outside + 3 * i, size = wire[0];
      double* to = (double*) (memory + wire[2]);
      const double* from[LANES];
      for (lane = 0; lane < LANES; ++lane) from[lane] = base[i] + (k + lane < n ? k + lane : n - 1) * wire[1];
      j = 0;
#if SQUARES
      for (; j + LANES <= size; j += LANES) {
        V square[LANES];
        for (lane = 0; lane < LANES; ++lane) square[lane] = *(const Loose*) (from[lane] + j);
        transpose(square);
        for (lane = 0; lane < LANES; ++lane) ((V*) to)[j + lane] = square[lane];
      }
#endif
      for (; j < size; ++j)
        for (lane = 0; lane < LANES; ++lane) to[j * LANES + lane] = from[lane][j];
    }
    for (s = 0; s < steps; ++s) {
      const long long m = step[0], all_of_them = m + step[1], repeats = step[2];
      step += 3;
      for (t = 0; t < repeats; ++t) {
        for (i = 0; i < all_of_them; ++i) given[i] = memory + step[2 * i] + t * step[2 * i + 1];
        evaluate[s]((const V* const*) given, given + m, work);
      }
      step += 2 * all_of_them;
    }
    for (i = n_in; i < n_in + n_out; ++i) {
      const long long *wire = outside + 3 * i, size = wire[0], *from = entries + wire[2];
      const int used = n - k < LANES ? (int) (n - k) : LANES;
      double* to[LANES];
      for (lane = 0; lane < used; ++lane) to[lane] = base[i] + (k + lane) * wire[1];
      j = 0;
#if SQUARES
      for (; j + LANES <= size; j += LANES) {
        V square[LANES];
        for (lane = 0; lane < LANES; ++lane) square[lane] = memory[from[j + lane]];
        transpose(square);
        for (lane = 0; lane < used; ++lane) *(Loose*) (to[lane] + j) = square[lane];
      }
#endif
      for (; j < size; ++j) {
        const double* value = (const double*) (memory + from[j]);
        for (lane = 0; lane < used; ++lane) to[lane][j] = value[lane];
      }
    }
  }
  return 0;
}
