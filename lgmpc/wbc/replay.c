/* Solve the recorded ticks again and compare.

   replay [FILE [TOLERANCE]]: exit code 0 if all torques are the same bits, or differ by at most TOLERANCE, N.m. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "lgmpc_tick.h"

typedef struct {
  double fresh; /* 1 if the solver was reset before the tick */
  lgmpc_inputs in;
  double status;
  lgmpc_outputs out;
} tick_t;

int main(int count, char **arguments) {
  const char *name = count > 1 ? arguments[1] : "ticks.bin";
  long ticks = 0, others = 0, unequal = 0;
  double largest = 0, seconds = 0, tolerance = count > 2 ? atof(arguments[2]) : 0;
  lgmpc_tick *tick = lgmpc_tick_create();
  FILE *file = fopen(name, "rb");
  static tick_t one;
  lgmpc_outputs out;
  if (!file || !tick) return fprintf(stderr, "cannot read %s\n", name), 2;
  for (; fread(&one, sizeof one, 1, file) == 1; ++ticks) {
    clock_t start = clock();
    int status, i;
    if (one.fresh != 0) lgmpc_tick_reset(tick);
    status = lgmpc_tick_solve(tick, &one.in, &out);
    seconds += (double) (clock() - start) / CLOCKS_PER_SEC;
    if (status != (int) one.status) ++others;
    else if (status == LGMPC_SOLVED && memcmp(out.torques, one.out.torques, sizeof out.torques)) {
      ++unequal;
      for (i = 0; i < LGMPC_NU; ++i) largest = fmax(largest, fabs(out.torques[i] - one.out.torques[i]));
    }
  }
  fclose(file);
  lgmpc_tick_destroy(tick);
  printf("%ld ticks: %ld with other torques (by %.3g N.m at most), %ld with another status; %.1f us a tick\n", ticks,
         unequal, largest, others, ticks ? 1e6 * seconds / ticks : 0);
  return !ticks || others || (unequal && !(largest <= tolerance));
}
