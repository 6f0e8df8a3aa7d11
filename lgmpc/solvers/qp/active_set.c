/* Active sets and the interior point method of active_set.py; penalties.c and central_path.c come before. */

#include <string.h>

#define FEW 4.0 /* rows that may change in any sweep of an active set, even if fewer did in the last one */
#define FIRST 0.03 /* share of the rows that may change in the first sweep */
#define CONTRACTION 0.7 /* share of a sweep's changes that the next one may make */
#define GROWTH 10.0 /* of the penalty with each update of the multipliers */
#define STIFFEST 1e5 /* penalty beyond which it does not grow, in control weights */
#define START 20.0 /* penalty of all rows where the central path begins, in control weights */
#define SHORTEST 1e-6 /* a shorter step counts as none */
#define LONG 0.8 /* a step as long as this separates the active bounds from the others */
#define SETTLED 0.02 /* share of the active bounds that may still change when they count as identified */
#define TRIAL 15 /* after so many steps the active bounds are tried as they are: steps may stay at 0.6 for ever */
#define REFINEMENTS 2 /* corrections of rounding; each takes a factor of the penalty's condition off */

typedef struct {
  int (*evaluate)(void** frame);
  void** frame;
} Call;

/* The Riccati solver's calls, and its minimiser. */
typedef struct {
  const long long* sizes; /* calls that factor, that solve; states, controls, costates; entries of the residual */
  const Call *factor, *solve, *measure, *correct; /* the last two are one call each, where there is a residual */
  double *states, *controls, *costates, *rows, *multipliers;
  const double *more_states, *more_controls, *more_costates, *more_rows; /* a correction of rounding */
  const double *cost, *residual;
  double *found_states, *found_controls, *found_costates, *found_multipliers; /* the solution */
} Riccati;

typedef struct {
  const Penalties* penalties;
  const Path* path;
  const Riccati* riccati;
  double* numbers; /* tolerance; the Riccati solver's penalty, in control weights; a control weight */
  long long* counts; /* factorisations; most sweeps of an active set, most steps of the interior point method; weights */
  const double* values; /* of the problem; the control weights among them */
  const long long* weights;
  double* work;
} Solver;

/* The number that has half of all below it; the order of the numbers changes. */
static double median(double* x, long long count) {
  const long long middle = count / 2;
  long long low = 0, high = count - 1;
  while (low < high) { /* Hoare's selection */
    const double pivot = x[middle];
    long long i = low, j = high;
    do {
      double other = 0;
      while (x[i] < pivot) ++i;
      while (pivot < x[j]) --j;
      if (i <= j) other = x[i], x[i++] = x[j], x[j--] = other;
    } while (i <= j);
    if (j < middle) low = i;
    if (middle < i) high = j;
  }
  return x[middle];
}

/* Read the scale of the penalties from the problem's matrices. */
EXPORT void lgmpc_qp_prepare(const Solver* s) {
  long long i;
  for (i = 0; i < s->counts[3]; ++i) s->work[i] = s->values[s->weights[i]];
  if (s->counts[3]) s->numbers[2] = median(s->work, s->counts[3]);
  s->penalties->numbers[1] = s->numbers[1] * s->numbers[2];
}

EXPORT int lgmpc_qp_resume(const Solver* s) { return resume(s->penalties), 1; }

static int run(const Call* calls, long long count) {
  int failed = 0;
  for (; count > 0; --count, ++calls) failed |= calls->evaluate(calls->frame);
  return !failed;
}

/* Whether all magnitudes are at most the tolerance; not if one is NaN. */
static int within(const double* values, long long count, double tolerance) {
  for (; count > 0; --count)
    if (!(fabs(*values++) <= tolerance)) return 0;
  return 1;
}

static void add(const double* values, long long count, double* to) {
  for (; count > 0; --count) *to++ += *values++;
}

static int factor(const Solver* s) {
  ++s->counts[0];
  return run(s->riccati->factor, s->riccati->sizes[0]) && isfinite(*s->riccati->cost);
}

/* Correct minimiser and multipliers by their rounding; return how often, -1 if they are not stationary. */
static int polish(const Solver* s) {
  const Riccati* r = s->riccati;
  const long long *sizes = r->sizes, rows = s->penalties->plan[0] * s->penalties->plan[1];
  int corrections;
  for (corrections = 0; sizes[5]; ++corrections) {
    long long i;
    run(r->measure, 1);
    if (within(r->residual, sizes[5], s->numbers[0])) break;
    if (corrections == REFINEMENTS) return -1;
    run(r->correct, 1);
    add(r->more_states, sizes[2], r->states), add(r->more_controls, sizes[3], r->controls);
    add(r->more_costates, sizes[4], r->costates), add(r->more_rows, rows, r->rows);
    for (i = 0; i < rows; ++i) r->multipliers[i] += s->penalties->weights[i] * r->more_rows[i];
  }
  return corrections;
}

/* Whether only rows at their bounds have multipliers, and all rows are within theirs. */
static int complementary(const Solver* s) {
  const Penalties* f = s->penalties;
  EACH_ROW {
    BOUNDS
    const double row = f->rows[i];
    if (!(fabs(row - nearest(row + f->multipliers[i], lower, upper)) <= s->numbers[0])) return 0;
  }
  return 1;
}

/* Take the minimiser, with rows within their bounds, and its multipliers, if it is stationary. */
static int accept(const Solver* s) {
  const Riccati* r = s->riccati;
  const long long *sizes = r->sizes, rows = s->penalties->plan[0] * s->penalties->plan[1];
  const int corrections = polish(s);
  if (corrections < 0 || (corrections && !complementary(s))) return 0;
  memcpy(r->found_states, r->states, sizeof(double) * sizes[2]);
  memcpy(r->found_controls, r->controls, sizeof(double) * sizes[3]);
  memcpy(r->found_costates, r->costates, sizeof(double) * sizes[4]);
  memcpy(r->found_multipliers, r->multipliers, sizeof(double) * rows);
  return 1;
}

/* Minimise the augmented Lagrangian from point and multiplier estimates; 0 if that takes too many sweeps. Active are
   rows of the point that are outside their bounds, shifted by the multipliers. */
EXPORT int lgmpc_qp_active_set(const Solver* s) {
  const Penalties* f = s->penalties;
  const double weight = s->numbers[2], tolerance = s->numbers[0], *measures = f->measures;
  const long long rows = f->plan[0] * f->plan[1];
  double allowed = FIRST * rows;
  long long sweeps;
  f->numbers[1] = s->numbers[1] * weight;
  for (sweeps = 0; sweeps < s->counts[1]; ++sweeps) {
    penalise(f);
    if (!factor(s)) return 0;
    measure(f);
    if (measures[1] <= tolerance && accept(s)) return 1;
    if (measures[2] > (allowed > FEW ? allowed : FEW)) return 0; /* no contraction: the guess was too far off */
    allowed = CONTRACTION * measures[2];
    if (measures[0] <= tolerance) { /* the minimiser for these multipliers */
      const double stiffer = fmin(GROWTH * f->numbers[1], STIFFEST * weight);
      EACH_ROW {
        BOUNDS
        f->mu[i] = f->multipliers[i];
        f->point[i] = nearest(f->rows[i] + f->multipliers[i], lower, upper);
      }
      f->numbers[1] = fmax(f->numbers[1], stiffer);
    } else
      memcpy(f->point, f->rows, sizeof(double) * rows);
  }
  return 0;
}

/* Take the minimiser if it satisfies the optimality conditions. */
static int optimal(const Solver* s) {
  measure(s->penalties);
  return s->penalties->measures[1] <= s->numbers[0] && accept(s);
}

/* Follow the central path until the active rows are known; 0 if it does not converge. */
EXPORT int lgmpc_qp_interior_point(const Solver* s) {
  const Path* path = s->path;
  const long long size = sizeof(double) * path->plan[0] * path->plan[1];
  long long steps;
  path->numbers[0] = START * s->numbers[2], path->numbers[1] = s->penalties->numbers[1];
  lgmpc_path_begin(path);
  if (!factor(s)) return 0;
  lgmpc_path_start(path);
  for (steps = 0; steps < s->counts[2]; ++steps) {
    lgmpc_path_predict(path);
    if (!factor(s)) return 0;
    lgmpc_path_correct(path);
    run(s->riccati->solve, s->riccati->sizes[1]);
    lgmpc_path_step(path);
    if (!(path->measures[2] > SHORTEST)) return 0;
    if (optimal(s)) return 1;
    const int settled = path->measures[0] <= SETTLED * path->measures[1] && path->measures[2] > LONG;
    if (settled || (steps + 1) % TRIAL == 0) {
      lgmpc_path_identify(path);
      memcpy(s->penalties->point, path->point, size), memcpy(s->penalties->mu, path->multipliers, size);
      if (lgmpc_qp_active_set(s)) return 1;
    }
  }
  return 0;
}
