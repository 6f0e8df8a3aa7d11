/* A pipeline of functions in lanes (see lgmpc.compile.pipeline): inputs and outputs are transposed, one stage to a lane.
   A group of stages that is not full repeats the last one. squares.c comes before. */

#ifdef __GNUC__
  #define EXPORT __attribute__((visibility("default")))
  #pragma GCC optimize ("O3")
#else
  #define EXPORT
#endif

typedef void Evaluate(const V* const* arguments, V* const* results, V* work);

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
        transpose_square(square);
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
        transpose_square(square);
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
