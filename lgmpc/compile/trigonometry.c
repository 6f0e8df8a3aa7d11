/* Sine, cosine, tangent and the angle of a point in the plane, for all lanes of a vector at once, by Taylor series on
   reduced arguments: within three units in the last place. Lanes and single numbers (V is a double) have the same bits.
   Numbers beyond the reduction's range, infinite ones and NaN are left to the C library.

   The vectors' type V and the macros LANES, M, LANE, ALL, NOT and CHOOSE come before (see lgmpc.compile.simd). */

#define ABSOLUTE(x) CHOOSE((x) < ALL(0.0), -(x), (x))
/* To the nearest integer: of numbers that large, the last place is one. */
#define ROUNDED(x) (((x) + ALL(6755399441055744.0)) - ALL(6755399441055744.0))
#define FARTHEST 524288.0 /* products of a multiple of pi / 2 up to here with the pieces of pi / 2 are exact */

static inline int lgmpc_any(M m) {
  long long found = 0;
  int i;
  for (i = 0; i < LANES; ++i) found |= LANE(m, i);
  return found != 0;
}

/* The sine for shift 0, the cosine for shift 1. */
static inline V lgmpc_turned(V x, double shift) {
  /* x = n pi / 2 + r, with pi / 2 in three pieces of which the first two have 33 bits. */
  const V n = ROUNDED(x * ALL(0x1.45f306dc9c883p-1));
  const V r = ((x - n * ALL(0x1.921fb544p+0)) - n * ALL(0x1.0b4611a6p-34)) - n * ALL(0x1.3198a2e037073p-69);
  const V z = r * r, turns = n + ALL(shift), quarter = turns - ALL(4.0) * ROUNDED(turns * ALL(0.25));
  V s = ALL(-1.0 / 1307674368000.0), c = ALL(1.0 / 20922789888000.0), v;
  s = s * z + ALL(1.0 / 6227020800.0);
  s = s * z - ALL(1.0 / 39916800.0);
  s = s * z + ALL(1.0 / 362880.0);
  s = s * z - ALL(1.0 / 5040.0);
  s = s * z + ALL(1.0 / 120.0);
  s = s * z - ALL(1.0 / 6.0);
  s = r + r * (z * s);
  c = c * z - ALL(1.0 / 87178291200.0);
  c = c * z + ALL(1.0 / 479001600.0);
  c = c * z - ALL(1.0 / 3628800.0);
  c = c * z + ALL(1.0 / 40320.0);
  c = c * z - ALL(1.0 / 720.0);
  c = c * z + ALL(1.0 / 24.0);
  c = (ALL(1.0) - ALL(0.5) * z) + z * z * c;
  /* quarter is -2, -1, 0, 1 or 2. */
  v = CHOOSE(quarter * quarter == ALL(1.0), c, s);
  v = CHOOSE(quarter * quarter == ALL(4.0), -v, v);
  return CHOOSE(quarter == ALL(-1.0), -v, v);
}

#define BEYOND(x) lgmpc_any(NOT(ABSOLUTE(x) < ALL(FARTHEST)))

static V each_sin(V x) {
  V v = lgmpc_turned(x, 0.0);
  int i;
  if (BEYOND(x))
    for (i = 0; i < LANES; ++i)
      if (!(fabs(LANE(x, i)) < FARTHEST)) LANE(v, i) = sin(LANE(x, i));
  return v;
}

static V each_cos(V x) {
  V v = lgmpc_turned(x, 1.0);
  int i;
  if (BEYOND(x))
    for (i = 0; i < LANES; ++i)
      if (!(fabs(LANE(x, i)) < FARTHEST)) LANE(v, i) = cos(LANE(x, i));
  return v;
}

static V each_tan(V x) { return each_sin(x) / each_cos(x); }

/* With a the longer of |x| and |y| and b the shorter: atan(b / a) = base + atan((b - c a) / (a + c b)), where c is the
   tangent of the nearest multiple of pi / 8. */
static V each_atan2(V y, V x) {
  const V up = ABSOLUTE(y), ahead = ABSOLUTE(x);
  const V a = CHOOSE(up > ahead, up, ahead), b = CHOOSE(up > ahead, ahead, up);
  const V some = CHOOSE(b > a * ALL(0x1.975f5e0553158p-3), ALL(0x1.a827999fcef32p-2), ALL(0.0));
  const V c = CHOOSE(b > a * ALL(0x1.561b82ab7f990p-1), ALL(1.0), some);
  const V pi_8 = CHOOSE(c == ALL(0.0), ALL(0.0), ALL(0x1.921fb54442d18p-2));
  const V base = CHOOSE(c == ALL(1.0), ALL(0x1.921fb54442d18p-1), pi_8);
  const V t = (b - c * a) / (a + c * b), z = t * t;
  V v = ALL(-1.0 / 23.0);
  int i;
  v = v * z + ALL(1.0 / 21.0);
  v = v * z - ALL(1.0 / 19.0);
  v = v * z + ALL(1.0 / 17.0);
  v = v * z - ALL(1.0 / 15.0);
  v = v * z + ALL(1.0 / 13.0);
  v = v * z - ALL(1.0 / 11.0);
  v = v * z + ALL(1.0 / 9.0);
  v = v * z - ALL(1.0 / 7.0);
  v = v * z + ALL(1.0 / 5.0);
  v = v * z - ALL(1.0 / 3.0);
  v = base + (t + t * (z * v));
  v = CHOOSE(up > ahead, ALL(0x1.921fb54442d18p+0) - v, v);
  v = CHOOSE(x < ALL(0.0), ALL(0x1.921fb54442d18p+1) - v, v);
  v = CHOOSE(y < ALL(0.0), -v, v);
  /* Zeros, whose signs count, numbers that would underflow or overflow, and NaN. */
  if (lgmpc_any(NOT((b > ALL(1e-150)) & (a < ALL(1e150)))))
    for (i = 0; i < LANES; ++i)
      if (!(LANE(b, i) > 1e-150 && LANE(a, i) < 1e150)) LANE(v, i) = atan2(LANE(y, i), LANE(x, i));
  return v;
}
