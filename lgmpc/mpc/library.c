/* The update of update.c in a program without Python: image.c has the controller's memory; update.c comes before. */
#include <stdlib.h>

void* lgmpc_image_create(void);
void lgmpc_image_destroy(void* image);
void* lgmpc_image_root(void* image);

lgmpc_mpc* lgmpc_mpc_create(void) { return lgmpc_image_create(); }
void lgmpc_mpc_destroy(lgmpc_mpc* mpc) { lgmpc_image_destroy(mpc); }

void lgmpc_mpc_reset_guess(lgmpc_mpc* mpc) { ((const Update*) lgmpc_image_root(mpc))->state[GUESSED] = NAN; }

int lgmpc_mpc_update(lgmpc_mpc* mpc, const lgmpc_mpc_inputs* in, lgmpc_mpc_plan* out) {
  const Update* u = lgmpc_image_root(mpc);
  const int status = lgmpc_mpc_attempt(u, in, out);
  if (status == LGMPC_MPC_SOLVED) {
    COPY(u->xs, (N + 1) * NX, u->good_xs), COPY(u->us, N * NU, u->good_us);
    u->state[PLANNED] = in->time, u->state[FAILURES] = 0;
    return status;
  }
  /* The next update starts from the last plan, unless that may have caused the failure. */
  const int stale = ++u->state[FAILURES] > u->plan[STALE];
  u->state[GUESSED] = NAN;
  if (status == LGMPC_MPC_NOT_FINITE && !stale && !isnan(u->state[PLANNED])) {
    set_guess(u, u->good_xs, u->good_us);
    u->state[GUESSED] = u->state[PLANNED];
  }
  return status == LGMPC_MPC_OVERFLOWN ? LGMPC_MPC_NOT_SOLVED : status;
}
