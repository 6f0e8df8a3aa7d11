/* Make the recorded updates again and compare.

   replay_mpc [FILE [TOLERANCE]]: exit code 0 if all plans are the same bits, or their forces differ by at most TOLERANCE,
   N. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "lgmpc_mpc.h"

typedef struct {
  double fresh; /* 1 if the update started at rest */
  lgmpc_mpc_inputs in;
  double status;
  lgmpc_mpc_plan plan;
} update_t;

int main(int count, char** arguments) {
  const char* name = count > 1 ? arguments[1] : "updates.bin";
  long updates = 0, others = 0, unequal = 0;
  double largest = 0, seconds = 0, tolerance = count > 2 ? atof(arguments[2]) : 0;
  lgmpc_mpc* mpc = lgmpc_mpc_create();
  FILE* file = fopen(name, "rb");
  static update_t one;
  static lgmpc_mpc_plan plan;
  if (!file || !mpc) return fprintf(stderr, "cannot read %s\n", name), 2;
  for (; fread(&one, sizeof one, 1, file) == 1; ++updates) {
    const double *mine = &plan.forces[0][0][0], *theirs = &one.plan.forces[0][0][0];
    clock_t start = clock();
    int status;
    size_t i;
    if (one.fresh != 0) lgmpc_mpc_reset_guess(mpc);
    status = lgmpc_mpc_update(mpc, &one.in, &plan);
    seconds += (double) (clock() - start) / CLOCKS_PER_SEC;
    if (status != (int) one.status) ++others;
    else if (status == LGMPC_MPC_SOLVED && memcmp(&plan, &one.plan, sizeof plan)) {
      ++unequal;
      for (i = 0; i < sizeof plan.forces / sizeof *mine; ++i) largest = fmax(largest, fabs(mine[i] - theirs[i]));
    }
  }
  fclose(file);
  lgmpc_mpc_destroy(mpc);
  printf("%ld updates: %ld with other plans (by %.3g N at most), %ld with another status; %.1f us an update\n", updates,
         unequal, largest, others, updates ? 1e6 * seconds / updates : 0);
  return !updates || others || (unequal && !(largest <= tolerance));
}
