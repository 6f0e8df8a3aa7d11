/* One update of the centroidal MPC, from measured state and horizon to the plan: what lgmpc.mpc.CentroidalMpc.update does.
   exact.c, penalties.c, central_path.c, active_set.c and lgmpc_mpc.h come before. */

enum { N = LGMPC_MPC_NODES, NC = LGMPC_MPC_POINTS, NX = 9, NU = 3 * NC };

/* Addresses in the memory, in the order of lgmpc.mpc.compiled. */
typedef struct {
  const long long* plan; /* numbers of a node's parameters; iterations; failures from which plans are stale; calls of each
                            of the sequences; places of a node's parameters */
  const double* numbers; /* time between nodes, s; weight (3), N */
  double *parameters, *x0, *xs, *us, *base, *dxs, *fraction, *measured, *difference, *first;
  double *step_states, *step_controls, *step_costates, *step_multipliers;
  double *com, *com_velocity, *angular_velocity, *attitude, *rotation, *inertia;
  const double *standing, *stepping, *catching;
  double *good_xs, *good_us; /* of the last plan */
  double* state; /* time of the guess and of the last plan, s, NaN for none; failures in a row; factorisations */
  const Call *refer, *move, *expand, *subtract, *retract;
  const Solver* solver;
} Update;

enum { PARAMETERS, ITERATIONS, STALE, REFER, MOVE, EXPAND, POINTS, NORMALS, FLAGS, FRICTION, WRENCH, X_REFERENCE, X_WEIGHT,
       U_REFERENCE };
enum { GUESSED, PLANNED, FAILURES, FACTORISATIONS };
enum { LGMPC_MPC_OVERFLOWN = LGMPC_MPC_NOT_FINITE + 1 }; /* of inputs that are finite */

#define COPY(from, count, to) memcpy(to, from, sizeof(double) * (count))

/* Write the values of N intervals into the parameters of N + 1 nodes. */
static void write_intervals(const Update* u, int name, const double* values, int size) {
  double* to = u->parameters + u->plan[name];
  int k;
  for (k = 0; k <= N; ++k) COPY(values + (k < N ? k : N - 1) * size, size, to + k * u->plan[PARAMETERS]);
}

static int all_finite(const double* values, long long count) {
  double sum = 0;
  while (count-- > 0) sum += *values++;
  return isfinite(sum);
}

static void set_guess(const Update* u, const double* xs, const double* us) {
  COPY(xs, (N + 1) * NX, u->xs), COPY(us, N * NU, u->us);
  memset(u->step_states, 0, sizeof(double) * (N + 1) * NX), memset(u->step_controls, 0, sizeof(double) * N * NU);
  memset(u->step_costates, 0, sizeof(double) * N * NX);
  memset(u->step_multipliers, 0, sizeof(double) * u->solver->penalties->plan[0] * u->solver->penalties->plan[1]);
}

static void write_problem(const Update* u, const lgmpc_mpc_inputs* in) {
  const long long *at = u->plan, size = at[PARAMETERS];
  const double* weight = u->stepping;
  int k, i, j, all = 1;
  write_intervals(u, POINTS, in->points[0][0], 3 * NC), write_intervals(u, NORMALS, in->normals[0][0], 3 * NC);
  write_intervals(u, FLAGS, in->flags[0], NC), write_intervals(u, FRICTION, in->friction[0], NC);
  write_intervals(u, WRENCH, in->wrench[0], 6);
  COPY(in->com_reference, 3 * (N + 1), u->com), COPY(in->com_velocity_reference, 3 * (N + 1), u->com_velocity);
  COPY(in->angular_velocity_reference, 3 * (N + 1), u->angular_velocity);
  COPY(in->attitude_reference, 4, u->attitude), COPY(in->rotation, 9, u->rotation), COPY(in->inertia, 9, u->inertia);
  run(u->refer, at[REFER]);
  COPY(in->com, 3, u->x0), COPY(in->momentum, 6, u->x0 + 3);
  for (k = 0; k < N; ++k)
    for (i = 0; i < NC; ++i) all = all && in->flags[k][i] != 0;
  if (all) weight = u->standing;
  else if (in->catching != 0) weight = u->catching;
  for (k = 0; k <= N; ++k) {
    double *node = u->parameters + k * size, *forces = node + at[U_REFERENCE], carrying = 0;
    for (i = 0; in->legs_given != 0 && i < 3; ++i) node[at[X_REFERENCE] + 6 + i] += in->legs[k][i];
    COPY(weight + 3 * k, 3, node + at[X_WEIGHT]);
    for (i = 0; i < NC; ++i) carrying += node[at[FLAGS] + i];
    if (all) carrying = NC;
    for (i = 0; i < NC; ++i)
      for (j = 0; j < 3; ++j) {
        const double share = u->numbers[1 + j] / (carrying > 1 ? carrying : 1);
        forces[3 * i + j] = all ? share : node[at[FLAGS] + i] * share;
      }
  }
}

/* Shift the last trajectory to the present; without one, start from rest. */
static void warm_start(const Update* u, double time) {
  double ahead = (time - u->state[GUESSED]) / u->numbers[0];
  int k;
  if (!(0.0 <= ahead && ahead <= N)) {
    double xs[(N + 1) * NX], us[N * NU];
    for (k = 0; k <= N; ++k) COPY(u->x0, NX, xs + NX * k);
    for (k = 0; k < N; ++k) COPY(u->parameters + k * u->plan[PARAMETERS] + u->plan[U_REFERENCE], NU, us + NU * k);
    set_guess(u, xs, us);
  }
  for (; 0.0 <= ahead && ahead <= N && ahead > 0.0; ahead -= 1.0) {
    COPY(u->xs, (N + 1) * NX, u->base);
    *u->fraction = ahead < 1.0 ? ahead : 1.0;
    run(u->move, u->plan[MOVE]);
  }
  u->state[GUESSED] = time;
}

/* Expand the problem around the current trajectory, solve, and take the full step; 0 if there is no solution. */
static int iterate(const Update* u) {
  run(u->expand, u->plan[EXPAND]);
  lgmpc_qp_prepare(u->solver);
  COPY(u->x0, NX, u->measured);
  run(u->subtract, 1);
  COPY(u->difference, NX, u->first);
  u->solver->counts[0] = 0;
  if (!(u->solver->numbers[2] > 0.0)) return 0;
  lgmpc_qp_resume(u->solver);
  if (!lgmpc_qp_active_set(u->solver) && !lgmpc_qp_interior_point(u->solver)) return 0;
  COPY(u->xs, (N + 1) * NX, u->base), COPY(u->step_states, (N + 1) * NX, u->dxs);
  run(u->retract, 1);
  add(u->step_controls, N * NU, u->us);
  return 1;
}

/* Plan; unless LGMPC_MPC_SOLVED is returned the plan is as it was. */
EXPORT int lgmpc_mpc_attempt(const Update* u, const lgmpc_mpc_inputs* in, lgmpc_mpc_plan* out) {
  const long long size = u->plan[PARAMETERS];
  double forces[N * NU];
  int i, k;
  write_problem(u, in);
  u->state[FACTORISATIONS] = 0;
  if (!isfinite(in->time) || !all_finite(u->x0, NX) || !all_finite(u->parameters, (N + 1) * size))
    return LGMPC_MPC_NOT_FINITE;
  warm_start(u, in->time);
  for (i = 0; i < u->plan[ITERATIONS]; ++i) {
    if (!iterate(u)) return LGMPC_MPC_NOT_SOLVED;
    u->state[FACTORISATIONS] += u->solver->counts[0];
  }
  for (k = 0; k < N; ++k)
    for (i = 0; i < NU; ++i) forces[k * NU + i] = u->us[k * NU + i] * u->parameters[k * size + u->plan[FLAGS] + i / 3];
  if (!all_finite(u->xs, (N + 1) * NX) || !all_finite(forces, N * NU)) return LGMPC_MPC_OVERFLOWN;
  out->time = in->time;
  COPY(u->xs, (N + 1) * NX, out->states), COPY(forces, N * NU, out->forces);
  return LGMPC_MPC_SOLVED;
}
