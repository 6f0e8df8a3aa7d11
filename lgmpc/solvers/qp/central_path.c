/* Mehrotra's predictor and corrector, in the rows of all stages: the part of an interior point method without the
   minimisation of the cost with penalised rows. penalties.c comes before.

   A row ``lower <= row <= upper`` has a slack ``s = +-(bound - row)`` and a multiplier ``z`` for each of its bounds. The
   Newton step on ``s z = target`` minimises the cost with the penalties

       sum_bounds  1/2 (z / s) (row - bound)^2 +- (2 z + (target - s z) / s) row,

   which is, row by row, one weight and one target of the Riccati solver. Mehrotra, "On the implementation of a
   primal-dual interior point method", SIAM J. Optim. 2, 1992. Where both bounds are equal there is no interior: such
   rows are penalised throughout, with a multiplier that grows (Hestenes' and Powell's).

   The calls of a solve: begin, start, and in each iteration predict, correct, step, with a minimisation after each but
   start and step, the one after correct with the same weights as before. The path begins as near to its end as the
   known multipliers are. */

typedef struct {
  double limit, sign, active; /* sign: -1 from below, 1 from above; active: whether the last prediction took the slack */
  double slack, force, change; /* force: the multiplier; change: how much the product of the two has to */
  double slack_step, force_step; /* to the rows of the last minimisation */
  long long row;
} Bound;

typedef struct {
  const long long* plan; /* stages, rows of each, how far apart the stages' bounds are */
  double* numbers; /* penalty at the start, some control weights; that of equal bounds, much larger */
  const double *lower, *upper, *known, *rows;
  double *weights, *targets, *held;
  Bound* bounds; /* finite ones of rows that have an interior */
  long long* count; /* of these */
  double *point, *multipliers, *measures; /* measures: active bounds that changed, active bounds, length of the step */
} Path;

#define FLOOR 0.3 /* least multiplier at first, as a share of the largest */
#define TO_BOUNDARY 0.995 /* share of the longest step that keeps slacks and multipliers positive */

#define LIMITS const double lower = f->lower[k * f->plan[2] + j], upper = f->upper[k * f->plan[2] + j];

#define EACH_BOUND for (Bound *b = f->bounds, *end = b + *f->count; b < end; ++b)

static inline void add_bound(const Path* f, double limit, double sign, long long row) {
  const Bound bound = {.limit = limit, .sign = sign, .row = row};
  if (isfinite(limit)) f->bounds[(*f->count)++] = bound;
}

EXPORT void lgmpc_path_begin(const Path* f) {
  *f->count = 0;
  EACH_ROW {
    LIMITS
    f->weights[i] = f->numbers[lower == upper];
    f->targets[i] = nearest(0.0, lower, upper);
    f->held[i] = 0.0;
    if (lower != upper) {
      add_bound(f, lower, -1.0, i);
      add_bound(f, upper, 1.0, i);
    }
  }
}

EXPORT void lgmpc_path_start(const Path* f) {
  double worst = 1e-6;
  EACH_BOUND {
    const double outside = b->sign * (f->rows[b->row] - b->limit);
    worst = outside > worst ? outside : worst;
  }
  EACH_BOUND {
    const double gap = b->sign * (b->limit - f->rows[b->row]), known = b->sign * f->known[b->row];
    const double force = f->numbers[0] * ((gap < 0.0 ? -gap : 0.0) + FLOOR * worst);
    b->slack = gap > worst ? gap : worst;
    b->force = known > force ? known : force;
  }
}

/* Write the targets of the Newton step on ``slack force = slack force + change``, with the weights force / slack. */
static void aim(const Path* f) {
  EACH_ROW f->targets[i] = 0.0;
  EACH_BOUND f->targets[b->row] += (b->force * b->limit - b->sign * b->change) / b->slack - 2.0 * b->sign * b->force;
  EACH_ROW {
    LIMITS
    if (lower == upper)
      f->targets[i] = upper - f->held[i] / f->numbers[1];
    else if (f->weights[i] > 0.0)
      f->targets[i] /= f->weights[i];
  }
}

EXPORT void lgmpc_path_predict(const Path* f) {
  EACH_ROW {
    LIMITS
    f->weights[i] = lower == upper ? f->numbers[1] : 0.0;
  }
  EACH_BOUND {
    f->weights[b->row] += b->force / b->slack;
    b->change = -b->slack * b->force;
  }
  aim(f);
}

/* Compute the steps; return the longest one, at most 1, that makes no slack and no multiplier negative. */
static double longest(const Path* f) {
  double most = 1.0; /* reciprocal */
  EACH_BOUND {
    b->slack_step = b->sign * (b->limit - f->rows[b->row]) - b->slack;
    b->force_step = (b->change - b->force * b->slack_step) / b->slack;
    const double taken = -b->slack_step / b->slack, released = -b->force_step / b->force;
    most = taken > most ? taken : most;
    most = released > most ? released : most;
  }
  return 1.0 / most;
}

EXPORT void lgmpc_path_correct(const Path* f) {
  const double length = longest(f);
  double total = 0.0, left = 0.0, active = 0.0, changed = 0.0;
  EACH_BOUND {
    const double taken = b->slack_step * b->force < b->force_step * b->slack;
    changed += taken != b->active;
    active += taken;
    b->active = taken;
    total -= b->change;
    left += (b->slack + length * b->slack_step) * (b->force + length * b->force_step);
  }
  const double share = left / total, centre = total > 0.0 ? total / (double)*f->count * share * share * share : 0.0;
  EACH_BOUND b->change += centre - b->slack_step * b->force_step;
  aim(f);
  f->measures[0] = changed;
  f->measures[1] = active;
}

EXPORT void lgmpc_path_step(const Path* f) {
  const double most = TO_BOUNDARY * longest(f), length = most < 1.0 ? most : 1.0;
  EACH_BOUND {
    b->slack += length * b->slack_step;
    b->force += length * b->force_step;
  }
  EACH_ROW {
    LIMITS
    if (lower == upper) f->held[i] += length * f->numbers[1] * (f->rows[i] - upper);
  }
  f->measures[2] = length;
}

EXPORT void lgmpc_path_identify(const Path* f) {
  EACH_ROW {
    LIMITS
    f->point[i] = nearest(f->rows[i], lower, upper);
    f->multipliers[i] = f->held[i];
  }
  EACH_BOUND
    if (b->active != 0.0) {
      f->point[b->row] = b->limit;
      f->multipliers[b->row] += b->sign * b->force;
    }
}
