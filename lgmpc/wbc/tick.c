/* One tick of the whole-body QP, from state and targets to torques: what lgmpc.wbc.WholeBodyController.solve does. */
#include "lgmpc_tick.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "constants.h"

#define UNBOUNDED 1e20

enum { ARGUMENTS = 13 + LGMPC_TASKS + 14 }; /* the data's inputs and outputs */

int lgmpc_evaluate(void **frame);
int lgmpc_active_set(void **frame);
long long wbc_qp_lanes_work(void);

struct lgmpc_tick {
  lgmpc_inputs in;
  double limits[4 * NU], weights[2];
  double hessian[NX * NX], gradient[NX], equality[NB * NX], rhs[NB], rows[ROWS * NX], lower[ROWS], upper[ROWS];
  double box_lower[NX], box_upper[NX], x[NX], values[ROWS], bias[NU], summary[2], axes[9 * NC * NC];
  double tolerance, work[3 * NX * NX + 11 * NX];
  int active[3 * NX + (2 * NX + ROWS) / 4 + 1];
  long long plan[6], stages[1 + ARGUMENTS];
  double *arguments[ARGUMENTS], *now[ARGUMENTS], *scratch;
  void *data[4], *solver[15];
};

static void fill(double *to, int count, double value) {
  int i;
  for (i = 0; i < count; ++i) to[i] = value;
}

static void set_constants(lgmpc_tick *t) {
  int foot, i;
  memcpy(t->limits, LIMITS, sizeof t->limits);
  memcpy(t->weights, WEIGHTS, sizeof t->weights);
  fill(t->lower, ROWS, -UNBOUNDED), fill(t->upper, ROWS, UNBOUNDED);
  fill(t->box_lower, NX, -UNBOUNDED), fill(t->box_upper, NX, UNBOUNDED);
  fill(t->upper + NU, NC * FACETS, 0);
  for (i = NV; i < NX; ++i) t->hessian[i * NX + i] = WEIGHTS[0];
  for (foot = 0; foot < SOLES; ++foot) /* the sum of a sole's normal forces */
    for (i = POINTS[foot]; i < POINTS[foot + 1]; ++i) t->rows[(NU + NC * FACETS + foot) * NX + NV + 3 * i + 2] = 1;
  t->tolerance = TOLERANCE;
}

static void bind(lgmpc_tick *t) {
  double **next = t->arguments, *task = t->in.joint_friction + NU;
  lgmpc_inputs *in = &t->in;
  double *given[] = {in->q, in->v, in->stance, in->normals, in->target_forces, in->lowest_normal, in->highest_normal,
                     in->external_wrench, t->limits, in->horizon, t->weights, in->joint_load, in->joint_friction};
  double *made[] = {t->hessian, t->gradient, t->equality, t->rhs, t->rows, t->lower, t->upper, t->box_lower + NB,
                    t->box_upper + NB, t->bias, t->summary, t->axes, t->lower + NU + NC * FACETS,
                    t->upper + NU + NC * FACETS};
  void *solver[] = {t->plan, &t->tolerance, t->hessian, t->gradient, t->equality, t->rhs, t->rows, t->lower, t->upper,
                    t->box_lower, t->box_upper, t->x, t->values, t->work, t->active};
  int i;
  memcpy(next, given, sizeof given), next += sizeof given / sizeof *given;
  for (i = 0; i < LGMPC_TASKS; task += TASK_SIZES[i++]) *next++ = task;
  memcpy(next, made, sizeof made);
  memcpy(t->solver, solver, sizeof solver);
  t->plan[0] = NX, t->plan[1] = NB, t->plan[2] = ROWS, t->plan[3] = MOST_STEPS;
  t->stages[0] = 1;
  t->data[0] = t->arguments, t->data[1] = t->stages, t->data[2] = t->now, t->data[3] = t->scratch;
}

lgmpc_tick *lgmpc_tick_create(void) {
  lgmpc_tick *t = calloc(1, sizeof *t);
  if (!t) return 0;
  t->scratch = calloc((size_t) wbc_qp_lanes_work() + 1, sizeof(double));
  if (!t->scratch) return free(t), (lgmpc_tick *) 0;
  set_constants(t);
  bind(t);
  return t;
}

void lgmpc_tick_destroy(lgmpc_tick *t) {
  if (t) free(t->scratch);
  free(t);
}

void lgmpc_tick_reset(lgmpc_tick *t) { t->plan[4] = 0; }

int lgmpc_tick_solve(lgmpc_tick *t, const lgmpc_inputs *in, lgmpc_outputs *out) {
  int i, j;
  t->in = *in;
  for (i = 0; i < NC; ++i)
    for (j = 0; j < FACETS; ++j) {
      double *row = t->rows + (NU + i * FACETS + j) * NX + NV + 3 * i;
      row[0] = FACET_NORMALS[2 * j], row[1] = FACET_NORMALS[2 * j + 1], row[2] = -(in->friction[i] * HALF_WIDTH);
    }
  lgmpc_evaluate(t->data);
  if (!isfinite(t->summary[0])) return lgmpc_tick_reset(t), LGMPC_NOT_FINITE;
  if (lgmpc_active_set(t->solver)) return LGMPC_NOT_SOLVED;
  for (i = 0; i < NU; ++i) out->torques[i] = t->values[i] + t->bias[i];
  memcpy(out->acceleration, t->x, sizeof out->acceleration);
  if (t->summary[1] == 0) return memcpy(out->forces, t->x + NV, sizeof out->forces), LGMPC_SOLVED;
  for (i = 0; i < 3 * NC; ++i)
    for (out->forces[i] = 0, j = 0; j < 3 * NC; ++j) out->forces[i] += t->axes[3 * NC * i + j] * t->x[NV + j];
  return LGMPC_SOLVED;
}
