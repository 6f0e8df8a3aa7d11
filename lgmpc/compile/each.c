static inline double sign(double x) { return x < 0 ? -1 : x > 0 ? 1 : x; }
#define EACH(f) static inline V each_##f(V a) \
  { V v; int i; for (i = 0; i < LANES; ++i) LANE(v, i) = f(LANE(a, i)); return v; }
#define EACH2(f) static inline V each_##f(V a, V b) \
  { V v; int i; for (i = 0; i < LANES; ++i) LANE(v, i) = f(LANE(a, i), LANE(b, i)); return v; }
