/* Entry points, and sums of products that are rounded twice, as numpy's are: the head of lgmpc's own C sources. */
#include <math.h>

#ifdef __clang__
  #pragma STDC FP_CONTRACT OFF
#elif defined(__GNUC__)
  #pragma GCC optimize ("O3,fp-contract=off")
#endif
#ifdef __GNUC__
  #define EXPORT __attribute__((visibility("default")))
#else
  #define EXPORT
#endif

