/* Rows of an augmented Lagrangian, of all stages; active_set.py says what is computed. exact.c comes before. */

typedef struct {
  const long long* plan; /* stages, rows of each, how far apart the stages' bounds are */
  double* numbers; /* the least known multiplier that counts, rho */
  const double *lower, *upper, *known;
  double *mu, *point, *weights, *targets;
  const double* rows;
  double *multipliers, *measures;
} Penalties;

#define EACH_ROW \
  for (long long k = 0; k < f->plan[0]; ++k) \
    for (long long j = 0, i = k * f->plan[1]; j < f->plan[1]; ++j, ++i)

#define BOUNDS const double lower = f->lower[k * f->plan[2] + j], upper = f->upper[k * f->plan[2] + j];

/* NaN for bounds that are. */
static inline double nearest(double value, double lower, double upper) {
  return value >= lower ? (value <= upper ? value : upper) : lower;
}

static void resume(const Penalties* f) {
  EACH_ROW {
    BOUNDS
    const double mu = fabs(f->known[i]) > f->numbers[0] ? f->known[i] : 0.0;
    f->mu[i] = mu;
    f->point[i] = mu > 0.0 ? upper : mu < 0.0 ? lower : nearest(0.0, lower, upper);
  }
}

static void penalise(const Penalties* f) {
  const double rho = f->numbers[1];
  EACH_ROW {
    BOUNDS
    const double shift = f->mu[i] / rho, target = nearest(f->point[i], lower - shift, upper - shift);
    f->targets[i] = target;
    f->weights[i] = f->point[i] != target ? rho : 0.0;
  }
}

static void measure(const Penalties* f) {
  const double rho = f->numbers[1];
  double difference = 0, residual = 0, changed = 0;
  EACH_ROW {
    BOUNDS
    const double shift = f->mu[i] / rho, row = f->rows[i], multiplier = f->weights[i] * (row - f->targets[i]);
    const double outside = row - nearest(row, lower - shift, upper - shift);
    const double apart = fabs(rho * outside - multiplier);
    const double error = fabs(row - nearest(row + multiplier, lower, upper));
    f->multipliers[i] = multiplier;
    difference = apart > difference ? apart : difference;
    residual = error > residual ? error : residual;
    residual = lower - upper > residual ? lower - upper : residual; /* no row satisfies bounds that contradict */
    changed += (f->weights[i] != 0.0) != (outside != 0.0);
  }
  f->measures[0] = difference;
  f->measures[1] = residual;
  f->measures[2] = changed;
}
